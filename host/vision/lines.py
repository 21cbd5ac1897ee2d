"""Upright line pieces in a binary picture, followed along rails that lean as true verticals do."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from host.vision.geometry import Camera
from host.vision.pictures import Mask

LONGER = 1.7
"""Than stubble: the least length of a standing stem."""
RAGGED_M = 0.02
"""Stubble stands this much above the blade's height."""
LEAST_PX = 6.0


def least_length_px(camera: Camera, blade_height_m: float) -> NDArray[np.float32]:
    """For every picture row, the least length of a line that stands there and is no stubble."""
    stubble = camera.stem_rows_px(blade_height_m + RAGGED_M)
    return np.asarray(np.maximum(LEAST_PX, LONGER * stubble), np.float32)


def rails(width: int, height: int, camera: Camera | None, tilt_deg: float) -> NDArray[np.float32]:
    """(n, 2): the columns at which each rail crosses the picture's top and bottom rows. A rail is
    the image of a true vertical, leant by `tilt_deg` to the right at its upper end. Neighbouring
    rails are never more than one pixel apart, so together they visit every pixel."""
    point = camera.upright_vanishing_point() if camera else None
    shift = math.tan(math.radians(tilt_deg)) * height
    if point is None:
        lean = float(camera.lean_rad([[0.0, 0.0]])[0]) if camera else 0.0
        shift += math.tan(lean) * height
        n = np.arange(-math.ceil(abs(shift)), width + math.ceil(abs(shift)), dtype=np.float64)
        return np.column_stack([n, n - shift]).astype(np.float32)
    pu, pv = point
    scale = (height - pv) / (0.0 - pv)
    below = pv > height / 2
    margin = math.ceil(abs(shift)) + math.ceil(width * abs(scale - 1))
    n = np.arange(-margin, width + margin, dtype=np.float64)
    top, bottom = (n, pu + (n - pu) * scale) if below else (pu + (n - pu) / scale, n)
    return np.column_stack([top, bottom - shift]).astype(np.float32)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _mark(
    on: Mask, track: NDArray[np.float32], least: NDArray[np.float32], gap: int, out: Mask
) -> None:
    """Rows are taken in pairs, which halves the work; gaps count in pairs too."""
    height, width = on.shape
    pairs = height // 2
    for r in range(track.shape[0]):
        slope = 2.0 * (track[r, 1] - track[r, 0]) / height
        start = track[r, 0] + 0.5
        begin, end = 0, pairs
        if slope != 0.0:  # the pairs of rows in which the rail is inside the picture
            enters, leaves = -start / slope, (width - start) / slope
            if enters > leaves:
                enters, leaves = leaves, enters
            begin, end = max(0, int(enters) + 1), min(pairs, int(leaves))
        elif start < 0.0 or start >= width:
            continue
        first = -1  # pair where the running piece began
        last = -1  # its lowest lit pair so far
        for v in range(begin, end):
            u = int(start + slope * v)
            if on[2 * v, u] | on[2 * v + 1, u]:
                if first < 0:
                    first = v
                last = v
            elif first >= 0 and 2 * (v - last) > gap:
                if 2 * (last - first + 1) >= least[2 * last + 1]:
                    _light(on, start, slope, first, last, out)
                first = -1
        if first >= 0 and 2 * (last - first + 1) >= least[2 * last + 1]:
            _light(on, start, slope, first, last, out)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _light(on: Mask, start: float, slope: float, first: int, last: int, out: Mask) -> None:
    for v in range(first, last + 1):
        u = int(start + slope * v)
        out[2 * v, u] = on[2 * v, u]
        out[2 * v + 1, u] = on[2 * v + 1, u]


def upright_pieces(
    on: Mask, tracks: list[NDArray[np.float32]], least_px: NDArray[np.float32], gap_px: int = 1
) -> Mask:
    """Keeps the lit pixels of `on` that lie on a piece along a rail which is at least `least_px` of
    the piece's lowest row long (height,); gaps up to `gap_px` rows are bridged. A piece's lowest
    row is where a stem stands, so that a length in metres becomes its projection there."""
    out = np.zeros_like(on)
    for track in tracks:
        _mark(on, track, least_px, gap_px, out)
    return out
