"""Upright line pieces in a binary picture, followed along rails that lean as true verticals do."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

from host.core.compiled import compiled
from host.vision.geometry import Camera
from host.vision.pictures import Mask

Words = NDArray[np.uint32]

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


GROUP = 32
"""Rails that are worked on at once: no more than a pixel apart, they lie in as many pixels."""


_LIT = (np.arange(256)[:, None] >> np.arange(8) & 1) > 0
EIGHT: Final = np.where(_LIT, 255, 0).astype(np.uint8).view(np.uint64).ravel()
"""Eight pixels, 0 or 255, in a word, of which a byte has the bits: the first has the lowest."""


class Rails(NamedTuple):
    """Where rails cross the rows of pictures of one size, worked out once; group by group of them.
    Columns count from 1; 0 and the width + 1 are outside."""

    firsts: NDArray[np.int16]
    """(pairs of rows, groups): the column of a group's first rail."""
    offsets: Mask
    """(pairs of rows, rails): how many columns a rail lies right of its group's first."""
    spans: NDArray[np.int16]
    """(pairs of rows, 2): the first group with a rail inside the picture, and the first beyond."""


_MASK: Final = types.uint8[:, ::1]
_COLUMNS: Final = types.int16[:, ::1]
_RAILS: Final = types.NamedTuple([_COLUMNS, _MASK, _COLUMNS], Rails)  # type: ignore[no-untyped-call]


def _pieces_of(tilts: int) -> tuple[types.Type, ...]:
    """The types for so many tilts: two of the stems, three of the paper's lines."""
    tracks = types.UniTuple(_RAILS, tilts)  # type: ignore[no-untyped-call]
    return (_MASK, tracks, types.float32[::1], types.int64, _MASK)


def rails(width: int, height: int, camera: Camera | None, tilt_deg: float) -> Rails:
    """A rail is the image of a true vertical, leant by `tilt_deg` to the right at its upper end.
    Neighbouring rails are never more than one pixel apart, so together they visit every pixel."""
    point = camera.upright_vanishing_point() if camera else None
    shift = math.tan(math.radians(tilt_deg)) * height
    if point is None:
        lean = float(camera.lean_rad([[0.0, 0.0]])[0]) if camera else 0.0
        shift += math.tan(lean) * height
        top = np.arange(-math.ceil(abs(shift)), width + math.ceil(abs(shift)), dtype=np.float64)
        bottom = top
    else:
        pu, pv = point
        scale = (height - pv) / (0.0 - pv)
        margin = math.ceil(abs(shift)) + math.ceil(width * abs(scale - 1))
        n = np.arange(-margin, width + margin, dtype=np.float64)
        below = pv > height / 2
        top, bottom = (n, pu + (n - pu) * scale) if below else (pu + (n - pu) / scale, n)
    track = np.column_stack([top, bottom - shift]).astype(np.float32)
    pairs, groups = height // 2, -(-len(track) // GROUP)
    # Rails that fill up the last group are the last one again.
    filled = np.concatenate([track, np.repeat(track[-1:], groups * GROUP - len(track), 0)])
    places = _places(filled, width, pairs).reshape(pairs, groups, GROUP)
    firsts = np.ascontiguousarray(places[..., 0])
    offsets = (places - firsts[..., None]).astype(np.uint8).reshape(pairs, groups * GROUP)
    inside: NDArray[np.bool_] = np.any((places > 0) & (places <= width), axis=2)
    spans = np.stack([inside.argmax(1), groups - inside[:, ::-1].argmax(1)], 1).astype(np.int16)
    return Rails(firsts, offsets, spans)


def _places(track: NDArray[np.float32], width: int, pairs: int) -> NDArray[np.int16]:
    """(pairs of rows, rails): the column of each rail, in (0, width + 1), by the columns (n, 2) at
    which it crosses the picture's top and bottom rows."""
    slope = (track[:, 1] - track[:, 0]) / np.float32(pairs)
    row = np.arange(pairs, dtype=np.float32)[:, None]
    at = track[:, 0] + np.float32(1.5) + slope * row
    return np.clip(at, 0, width + 1).astype(np.int16)


# Each loop below does one thing, over neighbours, in bytes or bits: that is what compilers make
# quick. To look a rail's pixel up by its place would take ten times as long. So would choosing by a
# condition: LLVM makes vector instructions of masks, 0 or 255, not of that.


@numba.njit(cache=True, nogil=True, boundscheck=False, inline="always")
def _where(so: bool) -> np.uint8:
    """The mask of a condition: 255 where it holds."""
    return np.uint8(-np.int8(so))


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _lengths(lit: Mask, length: Mask, since: Mask, gap: int) -> None:
    """One row further down. `lit` becomes the length, up to here, of the piece that a lit place
    belongs to; `length` and `since` are the length so far and the rows since, of each rail."""
    bridged, most, none, one = np.uint8(gap), np.uint8(254), np.uint8(0), np.uint8(1)
    for r in range(lit.shape[0]):
        away, before = since[r], length[r]
        on, near = _where(lit[r] != none), _where(away <= bridged)
        # the sum of both, at most 254, without leaving the bytes
        bridging = np.uint8(np.uint8(min(before, np.uint8(most - away)) + away) + one)
        now = np.uint8(((bridging & near) | (one & ~near)) & on)
        length[r] = np.uint8(now | (before & ~on))
        lit[r] = now
        since[r] = np.uint8(np.uint8(min(away, most) + one) & ~on)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _keep(lengths: Mask, kept: Mask, since: Mask, least: int, gap: int) -> None:
    """One row further up. `lengths` becomes 1 where the piece, whose lowest row tells its whole
    length, is at least so long; `kept` says so of each rail's piece."""
    bridged, most, none, one = np.uint8(gap), np.uint8(254), np.uint8(0), np.uint8(1)
    enough = np.uint8(least)
    for r in range(lengths.shape[0]):
        length, away, before = lengths[r], since[r], kept[r]
        on, new = _where(length != none), _where(away > bridged)
        long = one & _where(length >= enough)
        keep = np.uint8(((long & new) | (before & ~new)) & on)
        kept[r] = np.uint8(keep | (before & ~on))
        lengths[r] = keep
        since[r] = np.uint8(np.uint8(min(away, most) + one) & ~on)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _from_pixels(
    bits: Words, first: NDArray[np.int16], offset: Mask, here: Mask, windows: Words
) -> None:
    """For each rail of some groups, 0 or 1: its pixel of a row of `bits`. `windows`: room for a
    word for each group."""
    for g in range(first.shape[0]):
        at = first[g]
        word, shift = at >> 5, np.uint64(at & 31)
        both = np.uint64(bits[word]) | np.uint64(bits[word + 1]) << np.uint64(32)
        windows[g] = np.uint32(both >> shift)
    for g in range(first.shape[0]):
        window = windows[g]
        for k in range(GROUP):
            bit = np.uint32(1) << np.uint32(offset[GROUP * g + k] & np.uint8(31))
            here[GROUP * g + k] = np.uint8(bit & window != np.uint32(0))


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _to_pixels(here: Mask, first: NDArray[np.int16], offset: Mask, bits: Words) -> None:
    """Sets the pixels of those rails of some groups that are 1."""
    for g in range(first.shape[0]):
        window = np.uint32(0)
        for k in range(GROUP):
            shift = np.uint32(offset[GROUP * g + k] & np.uint8(31))
            window |= np.uint32(np.uint32(here[GROUP * g + k]) << shift)
        at = first[g]
        word, both = at >> 5, np.uint64(window) << np.uint64(at & 31)
        bits[word] |= np.uint32(both)
        bits[word + 1] |= np.uint32(both >> np.uint64(32))


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _mark(
    on: Words,
    firsts: NDArray[np.int16],
    offsets: Mask,
    spans: NDArray[np.int16],
    least: Mask,
    gap: int,
    out: Words,
) -> None:
    """Sets `out` on the pieces along some rails; `on` and `out` have a bit for each pixel of a pair
    of rows. `least` and `gap` count in such pairs."""
    pairs, n = offsets.shape
    lengths = np.empty((pairs, n), np.uint8)
    length, since = np.zeros(n, np.uint8), np.full(n, 255, np.uint8)
    windows = np.empty(n // GROUP, np.uint32)
    for v in range(pairs):
        g, h = spans[v]
        a, b = GROUP * g, GROUP * h
        _from_pixels(on[v], firsts[v, g:h], offsets[v, a:b], lengths[v, a:b], windows)
        _lengths(lengths[v, a:b], length[a:b], since[a:b], gap)
    kept = np.zeros(n, np.uint8)
    since[:] = 255
    for v in range(pairs - 1, -1, -1):
        g, h = spans[v]
        a, b = GROUP * g, GROUP * h
        _keep(lengths[v, a:b], kept[a:b], since[a:b], least[v], gap)
        _to_pixels(lengths[v, a:b], firsts[v, g:h], offsets[v, a:b], out[v])


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _packed(on: Mask, bits: Words) -> None:
    """Sets the bits of the pixels that are lit in either of a pair of rows."""
    width = on.shape[1]
    lit = np.zeros(32 * bits.shape[1], np.uint8)
    eights = lit.view(np.uint64)
    for v in range(bits.shape[0]):
        upper, lower, row = on[2 * v], on[2 * v + 1], bits[v].view(np.uint8)
        for u in range(width):
            lit[u + 1] = (upper[u] | lower[u]) & np.uint8(1)
        for k in range(row.shape[0]):
            # brings bit 8n of a word to bit 56 + n
            row[k] = np.uint8(eights[k] * np.uint64(0x0102040810204080) >> np.uint64(56))


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _unpacked(on: Mask, bits: Words, out: Mask) -> None:
    """`on` where a pair of rows has its bit set."""
    width = on.shape[1]
    mask = np.empty(32 * bits.shape[1], np.uint8)
    eights = mask.view(np.uint64)
    for v in range(bits.shape[0]):
        row = bits[v].view(np.uint8)
        for k in range(row.shape[0]):
            eights[k] = EIGHT[row[k]]
        for half in range(2):
            pixel, kept = on[2 * v + half], out[2 * v + half]
            for u in range(width):
                kept[u] = pixel[u] & mask[u + 1]


def upright_pieces(
    on: Mask, tracks: list[Rails], least_px: NDArray[np.float32], gap_px: int = 1
) -> Mask:
    """Keeps the lit pixels of `on` that lie on a piece along a rail which is at least `least_px` of
    the piece's lowest row long (height,); gaps up to `gap_px` rows are bridged. A piece's lowest
    row is where a stem stands, so that a length in metres becomes its projection there.

    Rows are taken in pairs, which halves the work; what is longer than 510 rows is always enough.
    """
    out = np.empty_like(on)
    _pieces(on, tuple(tracks), least_px, gap_px // 2, out)
    return out


@compiled(_pieces_of(2), _pieces_of(3), boundscheck=False)
def _pieces(
    on: Mask, tracks: tuple[Rails, ...], least_px: NDArray[np.float32], gap: int, out: Mask
) -> None:
    """As `upright_pieces`, into `out`; `gap` counts in pairs of rows."""
    pairs, width = on.shape[0] // 2, on.shape[1]
    # One word more than the pixels and the two columns outside fill: windows reach into it.
    lit = np.empty((pairs, (width + 2 + 31) // 32 + 1), np.uint32)
    _packed(on, lit)
    least = np.empty(pairs, np.uint8)
    for v in range(pairs):
        least[v] = min(255, max(1, math.ceil(least_px[2 * v + 1] / 2)))
    marked = np.zeros_like(lit)
    for track in tracks:
        _mark(lit, track.firsts, track.offsets, track.spans, least, gap, marked)
    _unpacked(on, marked, out)
    out[2 * pairs :] = 0
