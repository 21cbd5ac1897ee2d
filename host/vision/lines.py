"""Upright line pieces in a binary picture, followed along rails that lean as true verticals do."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from host.vision.geometry import Camera
from host.vision.pictures import Mask


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
    height, width = on.shape
    for r in range(track.shape[0]):
        slope = (track[r, 1] - track[r, 0]) / height
        first = -1  # row where the running piece began
        last = -1  # its lowest lit row so far
        for v in range(height + 1):
            lit = False
            if v < height:
                u = int(track[r, 0] + slope * v + 0.5)
                lit = 0 <= u < width and on[v, u] != 0
            if lit:
                if first < 0:
                    first = v
                last = v
            elif first >= 0 and (v - last > gap or v == height):
                if last - first + 1 >= least[last]:
                    for w in range(first, last + 1):
                        u = int(track[r, 0] + slope * w + 0.5)
                        if 0 <= u < width and on[w, u] != 0:
                            out[w, u] = 255
                first = -1


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
