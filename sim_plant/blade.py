"""The blade: which cells a segment sweeps between two poses, and the straw that it lays."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_plant import noise
from sim_plant.ground import CROP, GRASS, NEIGHBOUR, NEIGHBOUR_STUBBLE, SOIL, STUBBLE, WINDROW


@njit(cache=True, nogil=True)
def _edge(ax: float, ay: float, bx: float, by: float, x: float, y: float) -> float:
    return (bx - ax) * (y - ay) - (by - ay) * (x - ax)


@njit(cache=True, nogil=True)
def _inside_triangle(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    cx: float,
    cy: float,
    x: float,
    y: float,
) -> bool:
    """Border included, either orientation; a degenerate triangle holds nothing but its border."""
    eps = 1e-12
    p = _edge(ax, ay, bx, by, x, y)
    q = _edge(bx, by, cx, cy, x, y)
    r = _edge(cx, cy, ax, ay, x, y)
    if abs(_edge(ax, ay, bx, by, cx, cy)) < eps:
        return False
    return (p >= -eps and q >= -eps and r >= -eps) or (p <= eps and q <= eps and r <= eps)


@njit(cache=True, nogil=True)
def sweep(
    kind: NDArray[np.uint8],
    x0: float,
    y0: float,
    cell: float,
    old: NDArray[np.float64],
    new: NDArray[np.float64],
    straw: bool,
    seed: int,
    counts: NDArray[np.int64],
    box: NDArray[np.int64],
) -> None:
    """Cuts what the segment `old` = (left x, left y, right x, right y) sweeps on its way to `new`.

    The swept quadrilateral is split into two triangles whose borders belong to it, so that nothing
    is skipped between successive calls at any speed. Adds to `counts` (crop cells, neighbour cells)
    and grows `box` (j0, j1, i0, i1) by the cells that changed. With `straw` the swept cells that
    hold no crop become windrow at a seeded 85 % instead of being cut.
    """
    rows, columns = kind.shape
    lo_x = min(old[0], old[2], new[0], new[2])
    hi_x = max(old[0], old[2], new[0], new[2])
    lo_y = min(old[1], old[3], new[1], new[3])
    hi_y = max(old[1], old[3], new[1], new[3])
    i0 = max(0, math.floor((lo_x - x0) / cell))
    i1 = min(columns - 1, math.floor((hi_x - x0) / cell))
    j0 = max(0, math.floor((lo_y - y0) / cell))
    j1 = min(rows - 1, math.floor((hi_y - y0) / cell))
    for j in range(j0, j1 + 1):
        y = y0 + (j + 0.5) * cell
        for i in range(i0, i1 + 1):
            here = kind[j, i]
            if straw:
                if here not in (SOIL, STUBBLE, GRASS) or noise.mix(seed, i, j) > 3650722201:
                    continue
                into = WINDROW
            elif here == CROP:
                into = STUBBLE
            elif here == NEIGHBOUR:
                into = NEIGHBOUR_STUBBLE
            else:
                continue
            x = x0 + (i + 0.5) * cell
            if not (
                _inside_triangle(old[0], old[1], old[2], old[3], new[2], new[3], x, y)
                or _inside_triangle(old[0], old[1], new[2], new[3], new[0], new[1], x, y)
            ):
                continue
            kind[j, i] = into
            if into == STUBBLE:
                counts[0] += 1
            elif into == NEIGHBOUR_STUBBLE:
                counts[1] += 1
            box[0] = min(box[0], j)
            box[1] = max(box[1], j + 1)
            box[2] = min(box[2], i)
            box[3] = max(box[3], i + 1)


@njit(cache=True, nogil=True)
def blade_ends(
    x: float, y: float, yaw: float, ahead_m: float, right_m: float, left_m: float
) -> NDArray[np.float64]:
    """(left x, left y, right x, right y) of a segment across the vehicle, y left positive."""
    c, s = math.cos(yaw), math.sin(yaw)
    bx, by = x + ahead_m * c, y + ahead_m * s
    return np.array([bx - left_m * s, by + left_m * c, bx - right_m * s, by + right_m * c])


@njit(cache=True, nogil=True)
def cut_between(
    kind: NDArray[np.uint8],
    x0: float,
    y0: float,
    cell: float,
    old: tuple[float, float, float],
    new: tuple[float, float, float],
    ahead_m: float,
    width_m: float,
    beside_m: float,
    straw_m: float,
    seed: int,
    counts: NDArray[np.int64],
    box: NDArray[np.int64],
) -> int:
    """`Field.cut`, the straw laid too; `box` becomes the cells that changed."""
    before = counts[0] + counts[1]
    box[0], box[1], box[2], box[3] = 1 << 30, 0, 1 << 30, 0
    half = width_m / 2
    a = blade_ends(old[0], old[1], old[2], ahead_m, -half, half)
    b = blade_ends(new[0], new[1], new[2], ahead_m, -half, half)
    sweep(kind, x0, y0, cell, a, b, False, seed, counts, box)
    cut: int = counts[0] + counts[1] - before
    if cut and straw_m > 0:
        right = -half - beside_m
        a = blade_ends(old[0], old[1], old[2], ahead_m - 0.4, right - straw_m, right)
        b = blade_ends(new[0], new[1], new[2], ahead_m - 0.4, right - straw_m, right)
        sweep(kind, x0, y0, cell, a, b, True, seed, counts, box)
    return cut
