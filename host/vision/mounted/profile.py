"""Across the face, bin by bin from right to left: what stands there, and where it ends."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from host.core.compiled import compiled
from host.vision.mounted.evidence import Floats, Sums
from host.vision.pictures import Mask

BIN_M = 0.005
"""Across the face."""
TRACK_M = 0.08
"""The right end moves by a centimetre from picture to picture; what is this far from where it was
is more likely something else, an end of dust for one."""
ELSEWHERE = 0.35
"""Factor on how much such a place differs, squared."""
WINDOW_M = 0.3
"""Looked at on either side of a possible right end."""
NARROW_M = 0.12
AROUND_M = 0.06
"""Which of two grounds a place belongs to shows in a wide window, where exactly they meet in a
narrow one: looked for so far around."""
PIECE_M = 0.1
"""Crop that goes on is looked for in pieces of this width."""
AS_DENSE = 0.7
"""Of the stems' share in the machine's way, what crop beside it has at least: a gap, grass and what
stands behind it have a half and less."""
AGAIN_M = (0.05, 0.1, 0.7)
"""From the right end, how wide, and how far at most: pieces of the face beside it. Dust hides no
more of a face than 0.6 m; farther right a machine that stands askew sees the next crop."""
AGAIN_PIXELS = 50.0
"""A piece with fewer tells nothing."""


@compiled(
    "(u1[:, ::1], u1[:, ::1], u1[:, ::1], f4[:, ::1], f4[:, ::1], f4[:, ::1], "
    "f8, UniTuple(f8, 2), UniTuple(f8, 4), f8, f8[:, ::1])",
    boundscheck=False,
)
def profile(
    upright: Mask,
    steps: Mask,
    grey: Mask,
    across: Floats,
    upward: Floats,
    reach: Floats,
    scale: float,
    origin: tuple[float, float],
    bands: tuple[float, float, float, float],
    right: float,
    sums: Sums,
) -> None:
    """Per lateral bin of the face's two bands of height (lower from, to, upper from, to), from the
    right end: pixels, stems, steps, grey (n, 4). `reach`: least and greatest `upward` of each row.

    A bin's counts of some rows share a word: pixels, stems and steps of 14 bits, grey of 22. The
    first and the last bin are for what is outside. Columns take turns between two sets of bins:
    neighbours often share a bin, and would wait for each other."""
    height, width = upright.shape
    bins = sums.shape[0]
    low = np.float32((bands[0] - origin[1]) / scale), np.float32((bands[2] - origin[1]) / scale)
    high = np.float32((bands[1] - origin[1]) / scale), np.float32((bands[3] - origin[1]) / scale)
    first, per = np.float32((origin[0] - right) / BIN_M + 1.0), np.float32(scale / BIN_M)
    none, last = np.float32(0.0), np.float32(bins + 1)
    counts = np.zeros(2 * (bins + 2), np.int64)
    place, word = np.empty(width, np.int32), np.empty(width, np.int64)
    # Of each set a bin is of half a row at most, so of 2^13 pixels: a word holds their grey.
    together = max(1, (1 << 14) // (width + 1))
    sums[:] = 0.0
    rows = 0
    for v in range(height):
        least, most = reach[v]
        if not ((least <= high[0] and most >= low[0]) or (least <= high[1] and most >= low[1])):
            continue
        stem, step, level, aside, z = upright[v], steps[v], grey[v], across[v], upward[v]
        for u in range(width):
            inside = ((low[0] <= z[u]) & (z[u] <= high[0])) | ((low[1] <= z[u]) & (z[u] <= high[1]))
            b = min(last, max(none, first + per * aside[u]))
            place[u] = 2 * (np.int32(b) if inside else np.int32(0)) + (u & 1)
        for u in range(width):
            lit = 1 | np.int64(stem[u] & 1) << 14 | np.int64(step[u] & 1) << 28
            word[u] = lit | np.int64(level[u]) << 42
        for u in range(width):
            counts[place[u]] += word[u]
        rows += 1
        if rows == together:
            _empty(counts, sums)
            rows = 0
    _empty(counts, sums)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _empty(counts: NDArray[np.int64], sums: Sums) -> None:
    """Adds the counts of `profile` to its sums, and sets them back."""
    field = (1 << 14) - 1
    for b in range(sums.shape[0]):
        for k in range(2 * b + 2, 2 * b + 4):
            word = counts[k]
            sums[b, 0] += word & field
            sums[b, 1] += word >> 14 & field
            sums[b, 2] += word >> 28 & field
            sums[b, 3] += word >> 42
    counts[:] = 0


@numba.njit(cache=True, nogil=True)
def right_end(
    sums: Sums, window: int, last: int, expected: float, spread: Sums
) -> tuple[int, float, float, float]:
    """The bin, before `last`, where the crop on the left (higher bins) ends towards the right, the
    shares of stems on the crop's side and on the other, and by how many spreads the sides differ;
    -1 without.

    It is the division with the greatest difference of the windows on either side, or one as good
    that lies wholly right of it: a stand beside the others is the outer one. What is far from the
    bin that is `expected` (NaN: nowhere) must differ by more."""
    n = sums.shape[0]
    run = np.zeros((n + 1, 4))
    for i in range(n):
        for k in range(4):
            run[i + 1, k] = run[i, k] + sums[i, k]
    score = np.zeros(n)
    inside = np.zeros(n)
    outside = np.zeros(n)
    at = -1
    for i in range(4, min(n - 4, last)):
        lo, hi = max(0, i - window), min(n, i + window)
        below, above = run[i, 0] - run[lo, 0], run[hi, 0] - run[i, 0]
        if above < 1.0 or below < 1.0:
            continue
        outside[i], inside[i] = (run[i, 1] - run[lo, 1]) / below, (run[hi, 1] - run[i, 1]) / above
        if inside[i] < 0.03 or inside[i] <= 2.0 * outside[i]:
            continue
        total = 0.0
        for k in range(1, 4):
            d = (run[i, k] - run[lo, k]) / below - (run[hi, k] - run[i, k]) / above
            total += (d / spread[k - 1]) ** 2
        share = above / (above + below)
        score[i] = total * 4.0 * share * (1.0 - share)
        if abs(i - expected) > TRACK_M / BIN_M:
            score[i] *= ELSEWHERE
        if at < 0 or score[i] > score[at]:
            at = i
    if at < 0:
        return -1, 0.0, 0.0, 0.0
    further = at
    for i in range(4, at - window):
        if score[i] > 0.5 * score[at] and (further == at or score[i] > score[further]):
            further = i
    differ = score[further]
    if abs(further - expected) > TRACK_M / BIN_M:
        differ /= ELSEWHERE
    return _meet(run, further, spread), inside[further], outside[further], math.sqrt(differ)


@numba.njit(cache=True, nogil=True)
def _meet(run: Sums, at: int, spread: Sums) -> int:
    """The bin near `at` where narrow windows differ most; `run` are running sums."""
    narrow, around = round(NARROW_M / BIN_M), round(AROUND_M / BIN_M)
    best, found = 0.0, at
    for i in range(max(narrow, at - around), min(run.shape[0] - narrow, at + around + 1)):
        below = run[i, 0] - run[i - narrow, 0]
        above = run[i + narrow, 0] - run[i, 0]
        if below < 1.0 or above < 1.0:
            continue
        total = 0.0
        for k in range(1, 4):
            d = (run[i + narrow, k] - run[i, k]) / above - (run[i, k] - run[i - narrow, k]) / below
            if k > 1 or d > 0.0:
                total += (d / spread[k - 1]) ** 2
        if total > best:
            best, found = total, i
    return found


@compiled("(f8[:, ::1], i8, f8, f8[::1], UniTuple(i8, 2))")
def right_side(
    sums: Sums, last: int, expected: float, spread: Sums, way: tuple[int, int]
) -> tuple[int, float, float, float, int, int]:
    """As `right_end`; then how many bins lie between the end and the first with a pixel, and what
    `goes_on_to` says of the machine's `way`, left and right."""
    at, inside, outside, differ = right_end(sums, round(WINDOW_M / BIN_M), last, expected, spread)
    out_to = goes_on_to(sums, way[0], way[1])
    if at < 0:
        return at, inside, outside, differ, 0, out_to
    first = 0
    while first < sums.shape[0] - 1 and sums[first, 0] <= 0.0:
        first += 1
    return at, inside, outside, differ, at - first, out_to


@numba.njit(cache=True, nogil=True)
def goes_on_to(sums: Sums, left: int, right: int) -> int:
    """The bin to which crop goes on towards the right from bins [right, left), the machine's way,
    without a break; `right` where it does not."""
    piece = round(PIECE_M / BIN_M)
    way = sums[right:left].sum(axis=0)
    if way[0] < AGAIN_PIXELS or way[1] <= 0.0:
        return right
    while right >= piece:
        beside = sums[right - piece : right].sum(axis=0)
        dense = beside[0] > AGAIN_PIXELS and beside[1] * way[0] >= AS_DENSE * way[1] * beside[0]
        if not dense:
            break
        right -= piece
    return right


@compiled("(f8[:, ::1], i8)")
def stems_beyond(sums: Sums, at: int) -> float:
    """The greatest share of stems right of an end: of a true one nothing stands there, but what
    dust or weeds hide of a face goes on behind them."""
    last, wide = at - round(AGAIN_M[0] / BIN_M), round(AGAIN_M[1] / BIN_M)
    least = max(0, at - round(AGAIN_M[2] / BIN_M))
    most = 0.0
    while last - wide >= least:
        piece = sums[last - wide : last].sum(axis=0)
        if piece[0] > AGAIN_PIXELS:
            most = max(most, piece[1] / piece[0])
        last -= wide
    return most


@compiled("(f8[:, ::1], i8)")
def steps_beyond(sums: Sums, at: int) -> float:
    """The share of steps in the window right of a bin over that in the window left of it."""
    window = round(WINDOW_M / BIN_M)
    beyond = sums[max(0, at - window) : at].sum(axis=0)
    within = sums[at : at + window].sum(axis=0)
    share = within[2] / max(1.0, within[0])
    return float(beyond[2] / max(1.0, beyond[0]) / max(share, 1e-3))
