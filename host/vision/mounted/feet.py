"""Where the stems' feet are: block by block of columns, in one picture."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from host.core.compiled import compiled
from host.vision.mounted.evidence import Floats, Sums
from host.vision.mounted.grain import uprightness
from host.vision.pictures import Mask

BLOCK_PX = 16
"""Columns that share a foot."""
TIMES = 2
"""So often what lies flat is looked past: a swath, and stubble behind it."""


class Flat(NamedTuple):
    """What lies flat, and is no foot. Heights are those at which it is seen, if it stood there."""

    to_x_m: float
    """What has its foot farther off is not looked at."""
    low_m: float
    high_m: float
    """Between these heights the texture tells how it runs."""
    below_m: float
    """All of it is seen below this height,"""
    clear_to_m: float
    """and from there up to this one nothing else is,"""
    next_x_m: float
    """but for crop that begins here."""
    upright: float
    """Its steps across the picture, squared, are at most so many times those along it."""


Figures = tuple[float, float, float, float, float, float, float]
"""A `Flat`'s, as compiled functions take it."""


@numba.njit(cache=True, nogil=True, boundscheck=False)
def block_sums(steps: Mask, grey: Mask, sums: NDArray[np.int32]) -> None:
    """Sums of steps and of grey per block of columns and row, running from the top:
    (2, rows + 1, blocks)."""
    blocks = sums.shape[2]
    # Neighbours are added up in pairs, then pairs of pairs: whole rows at once.
    two = np.empty(blocks * BLOCK_PX // 2, np.uint16)
    four = np.empty(blocks * BLOCK_PX // 4, np.uint16)
    low, one = np.uint16(255), np.uint16(1)
    for b in range(blocks):
        sums[0, 0, b], sums[1, 0, b] = 0, 0
    for v in range(steps.shape[0]):
        for which in range(2):
            row = (steps[v] if which == 0 else grey[v])[: blocks * BLOCK_PX].view(np.uint16)
            if which == 0:
                for k in range(row.shape[0]):
                    two[k] = (row[k] & one) + (row[k] >> np.uint16(8) & one)
            else:
                for k in range(row.shape[0]):
                    two[k] = (row[k] & low) + (row[k] >> np.uint16(8))
            for k in range(four.shape[0]):
                four[k] = two[2 * k] + two[2 * k + 1]
            before, after = sums[which, v], sums[which, v + 1]
            for b in range(blocks):
                four_b = np.int32(four[4 * b]) + np.int32(four[4 * b + 1])
                after[b] = (
                    before[b] + four_b + np.int32(four[4 * b + 2]) + np.int32(four[4 * b + 3])
                )


@numba.njit(cache=True, nogil=True)
def feet_of(
    dense: Mask,
    sums: NDArray[np.int32],
    horizon: int,
    limit: NDArray[np.int32],
    windows: NDArray[np.int32],
    spread: Sums,
    lowest: NDArray[np.int32],
    feet: NDArray[np.int32],
) -> None:
    """Per block of columns the row of its foot, -1 without: below the lowest dense row, from the
    row `lowest` up (-1: the foot is left as it is), the division of the rows above from those below
    with the greatest difference, at most down to `limit` of the dense row."""
    height = dense.shape[0]
    for b in range(feet.shape[0]):
        if lowest[b] < 0:
            continue
        feet[b] = -1
        middle = b * BLOCK_PX + BLOCK_PX // 2
        rough = -1
        for v in range(lowest[b], horizon - 1, -1):
            if dense[v, middle]:
                rough = v
                break
        if rough < 0:
            continue
        best, at = -1.0, rough
        end = min(height - 2, limit[rough], lowest[b])
        for v in range(rough - windows[rough] // 2, end + 1):
            n = windows[v]
            lo, hi = max(0, v - n), min(height, v + max(3, n // 2))
            above, below = float((v - lo) * BLOCK_PX), float((hi - v) * BLOCK_PX)
            if above <= 0.0 or below <= 0.0:
                continue
            score = 0.0
            for k in range(2):
                d = (sums[k, v, b] - sums[k, lo, b]) / above
                d -= (sums[k, hi, b] - sums[k, v, b]) / below
                if k == 0 and d < 0.0:
                    d = 0.0
                score += (d / spread[k + 1]) ** 2
            if score > best:
                best, at = score, v
        feet[b] = at


@numba.njit(cache=True, nogil=True)
def look_past(
    grey: Mask,
    dense: Mask,
    feet: NDArray[np.int32],
    ground_x: Floats,
    upward: Floats,
    camera: tuple[float, float, float],
    flat: Figures,
    lowest: NDArray[np.int32],
) -> bool:
    """Marks in `lowest` above which row a block's foot is to be looked for anew, because what has
    its foot there lies flat: neither upright, nor as high as crop would be. -1 for the others.
    `flat`: a `Flat`. Whether there is any."""
    to_x, low, high, below, clear, next_x, upright = flat
    blocks = feet.shape[0]
    top, bottom = np.zeros(blocks, np.int32), np.zeros(blocks, np.int32)
    for b in range(blocks):
        foot, u = feet[b], b * BLOCK_PX + BLOCK_PX // 2
        lowest[b] = -1
        if foot < 0 or ground_x[foot, u] > to_x:
            continue
        away, v, z, reaches = ground_x[foot, u] - camera[0], foot, 0.0, 0.0
        clear_to = min(clear, camera[2] * (1.0 - away / (next_x - camera[0])))
        while v > 0 and z < clear_to:
            if dense[v, u]:
                reaches = z
            v -= 1
            z = camera[2] + away * upward[v, u]
            if z < low:
                bottom[b] = v
            if z < high:
                top[b] = v
        if below < clear_to <= z and reaches < below:
            lowest[b] = v
    runs = np.empty(blocks, np.float64)
    uprightness(grey, top, bottom, BLOCK_PX, runs)
    any_flat = False
    for b in range(blocks):
        if lowest[b] >= 0 and not 0.0 < runs[b] < upright:
            lowest[b] = -1
        any_flat = any_flat or lowest[b] >= 0
    return any_flat


@compiled(
    "(u1[:, ::1], u1[:, ::1], u1[:, ::1], i8, i4[::1], i4[::1], f8[::1], f4[:, ::1], f4[:, ::1], "
    "f4[:, ::1], UniTuple(f8, 3), UniTuple(f8, 7))"
)
def contour(
    steps: Mask,
    grey: Mask,
    dense: Mask,
    horizon: int,
    limit: NDArray[np.int32],
    windows: NDArray[np.int32],
    spread: Sums,
    ground_x: Floats,
    across: Floats,
    upward: Floats,
    camera: tuple[float, float, float],
    flat: Figures,
) -> tuple[Floats, Floats]:
    """(x, y) on the ground of the foot of each block of columns that has one. `ground_x`, `across`,
    `upward`: (height, width) x of the ground that a pixel shows, m, and its ray's parts to the left
    and upward over the one that points forward; `camera`: its place, m. `flat`: a `Flat`; what
    is one is looked past."""
    blocks = steps.shape[1] // BLOCK_PX
    sums = np.empty((2, steps.shape[0] + 1, blocks), np.int32)
    block_sums(steps, grey, sums)
    feet = np.empty(blocks, np.int32)
    lowest = np.full(blocks, steps.shape[0] - 1, np.int32)
    feet_of(dense, sums, horizon, limit, windows, spread, lowest, feet)
    for _ in range(TIMES):
        if not look_past(grey, dense, feet, ground_x, upward, camera, flat, lowest):
            break
        feet_of(dense, sums, horizon, limit, windows, spread, lowest, feet)
    x, y = np.empty(blocks, np.float32), np.empty(blocks, np.float32)
    n = 0
    for b in range(blocks):
        v, u = feet[b], b * BLOCK_PX + BLOCK_PX // 2
        if v >= 0:
            x[n] = ground_x[v, u]
            y[n] = np.float32(camera[1] + np.float64(across[v, u]) * (np.float64(x[n]) - camera[0]))
            n += 1
    return x[:n], y[:n]


@compiled("(f4[::1], f4[::1], f8, f8, f8, f8)")
def reached(
    x: Floats, y: Floats, half_m: float, enough_m: float, camera_x: float, focal_px: float
) -> tuple[float, float]:
    """Of feet at `x`, `y` less than `half_m` aside: the least x up to which blocks with a foot are
    together as wide as `enough_m` (inf: they never are), and how wide all of them are, m."""
    near = np.sort(x[np.abs(y) < np.float32(half_m)])
    width, at = 0.0, np.inf
    for one in near:
        width += BLOCK_PX * (one - camera_x) / focal_px
        if at == np.inf and width >= enough_m:
            at = np.float64(one)
    return at, width
