"""Upright line pieces in a binary picture, followed along rails that lean as true verticals do."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from host.vision.geometry import Camera
from host.vision.pictures import Mask, u8

Places = NDArray[np.int16]

LONGER = 1.7
"""Than stubble: the least length of a standing stem."""
RAGGED_M = 0.02
"""Stubble stands this much above the blade's height."""
LEAST_PX = 6.0
"""A stem's line is at least so long, however far away: shorter ones are noise."""


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


# Each loop below does one thing, over neighbours, in bytes: that is what compilers make quick.


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _places(track: NDArray[np.float32], width: int, places: Places, spans: Places) -> None:
    """Per pair of rows and rail the column of the rail, in (0, width) limited to -1 and `width`;
    and which rails are inside."""
    pairs, n = places.shape
    slope = (track[:, 1] - track[:, 0]) / np.float32(pairs)
    start = track[:, 0] + np.float32(1.5)
    low, high = np.float32(0.0), np.float32(width + 1)
    for v in range(pairs):
        place, row = places[v], np.float32(v)
        for r in range(n):
            place[r] = np.int16(min(high, max(low, start[r] + slope[r] * row))) - 1
        spans[v, 0] = np.searchsorted(place, 0)
        spans[v, 1] = np.searchsorted(place, width)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _lengths(lit: Mask, length: Mask, since: Mask, gap: int) -> None:
    """One row further down. `lit` becomes the length, up to here, of the piece that a lit place
    belongs to; `length` and `since` are the length so far and the rows since, of each rail."""
    bridged, most, none, one = np.uint8(gap), np.uint8(254), np.uint8(0), np.uint8(1)
    for r in range(lit.shape[0]):
        on, away = lit[r], since[r]
        now = np.uint8(min(length[r] + away, most) + one) if away <= bridged else one
        length[r] = now if on else length[r]
        lit[r] = now if on else none
        since[r] = none if on else np.uint8(min(away, most) + one)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _keep(lengths: Mask, kept: Mask, since: Mask, least: int, gap: int) -> None:
    """One row further up. `lengths` becomes 1 where the piece, whose lowest row tells its whole
    length, is at least so long; `kept` says so of each rail's piece."""
    bridged, most, none, one = np.uint8(gap), np.uint8(254), np.uint8(0), np.uint8(1)
    enough = np.uint8(least)
    for r in range(lengths.shape[0]):
        length, away, before = lengths[r], since[r], kept[r]
        long = one if length >= enough else none
        keep = long if away > bridged else before
        kept[r] = keep if length else before
        lengths[r] = keep if length else none
        since[r] = none if length else np.uint8(min(away, most) + one)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _mark(on: Mask, track: NDArray[np.float32], least: Mask, gap: int, out: Mask) -> None:
    """Sets `out` on the pieces of one track; `on` and `out` are 0 or 1, a row for a pair of rows.
    `least` and `gap` count in such pairs."""
    pairs, width = on.shape
    n = track.shape[0]
    places, spans = np.empty((pairs, n), np.int16), np.empty((pairs, 2), np.int16)
    _places(track, width, places, spans)
    lengths = np.empty((pairs, n), np.uint8)
    length, since = np.zeros(n, np.uint8), np.full(n, 255, np.uint8)
    for v in range(pairs):
        first, end = spans[v]
        row, place, here = on[v], places[v], lengths[v]
        for r in range(first, end):
            here[r] = row[place[r]]
        _lengths(here[first:end], length[first:end], since[first:end], gap)
    kept = np.zeros(n, np.uint8)
    since[:] = 255
    for v in range(pairs - 1, -1, -1):
        first, end = spans[v]
        row, place, here = out[v], places[v], lengths[v]
        _keep(here[first:end], kept[first:end], since[first:end], least[v], gap)
        for r in range(first, end):
            row[place[r]] |= here[r]


def upright_pieces(
    on: Mask, tracks: list[NDArray[np.float32]], least_px: NDArray[np.float32], gap_px: int = 1
) -> Mask:
    """Keeps the lit pixels of `on` that lie on a piece along a rail which is at least `least_px` of
    the piece's lowest row long (height,); gaps up to `gap_px` rows are bridged. A piece's lowest
    row is where a stem stands, so that a length in metres becomes its projection there.

    Rows are taken in pairs, which halves the work; what is longer than 510 rows is always enough.
    """
    pairs = on.shape[0] // 2
    both = on[: 2 * pairs].reshape(pairs, 2, -1)
    lit = u8(np.bitwise_or(both[:, 0], both[:, 1]) & 1)
    least = np.clip(np.ceil(least_px[1 : 2 * pairs : 2] / 2), 1, 255).astype(np.uint8)
    marked = np.zeros_like(lit)
    for track in tracks:
        _mark(lit, track, least, gap_px // 2, marked)
    out = np.zeros_like(on)
    np.multiply(both, marked[:, None], out=out[: 2 * pairs].reshape(pairs, 2, -1))
    return out
