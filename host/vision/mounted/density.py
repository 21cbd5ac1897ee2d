"""Sums over a picture's neighbourhoods that OpenCV takes five times as long for: what is summed is
lit or not, so that whole neighbourhoods fit into bytes."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from host.core.compiled import compiled
from host.vision.pictures import Mask

ACROSS, ALONG = 8, 4
"""Columns and rows that a neighbourhood reaches to either side: 17 by 9 pixels."""
PIXELS = (2 * ACROSS + 1) * (2 * ALONG + 1)


@compiled("(u1[:, ::1], i8, u1[:, ::1])", boundscheck=False)
def mark_dense(lit: Mask, least: int, out: Mask) -> None:
    """1 where at least `least` of a neighbourhood's pixels are lit (255), 0 elsewhere. Beyond the
    picture's border the picture goes on mirrored, the border itself not repeated."""
    height, width = lit.shape
    one, enough = np.uint8(1), np.uint8(least)
    column = np.zeros(width + 2 * ACROSS, np.uint8)
    two, four, eight = np.empty_like(column), np.empty_like(column), np.empty_like(column)
    for v in range(-ALONG, ALONG):
        row = lit[abs(v)]
        for u in range(width):
            column[ACROSS + u] += row[u] & one
    for v in range(height):
        below, above = v + ALONG, v - ALONG - 1
        row = lit[below if below < height else 2 * (height - 1) - below]
        if v > 0:
            gone = lit[abs(above)]
            for u in range(width):
                column[ACROSS + u] += (row[u] & one) - (gone[u] & one)
        else:
            for u in range(width):
                column[ACROSS + u] += row[u] & one
        for k in range(ACROSS):
            column[ACROSS - 1 - k] = column[ACROSS + 1 + k]
            column[ACROSS + width + k] = column[ACROSS + width - 2 - k]
        for u in range(width + 15):
            two[u] = column[u] + column[u + 1]
        for u in range(width + 13):
            four[u] = two[u] + two[u + 2]
        for u in range(width + 9):
            eight[u] = four[u] + four[u + 4]
        here = out[v]
        for u in range(width):
            count = np.uint8(eight[u] + eight[u + 8] + column[u + 16])
            here[u] = one if count >= enough else np.uint8(0)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def ninths(lit: Mask, counts: NDArray[np.int64]) -> None:
    """How much of each ninth of a picture is lit (255), three by three, in ninths of a pixel: a
    pixel that a border divides counts on both sides by its share. All of it is the picture's number
    of pixels."""
    height, width = lit.shape
    one = np.uint8(1)
    columns = np.zeros(width, np.int32)
    for i in range(3):
        columns[:] = 0
        # The borders lie at thirds of a pixel.
        top, bottom = height * i, height * (i + 1)
        for v in range(top // 3, (bottom + 2) // 3):
            row = lit[v]
            share = np.int32(min(3 * v + 3, bottom) - max(3 * v, top))
            for u in range(width):
                columns[u] += share * np.int32(row[u] & one)
        for j in range(3):
            left, right = width * j, width * (j + 1)
            total = 0
            for u in range(left // 3, (right + 2) // 3):
                total += (min(3 * u + 3, right) - max(3 * u, left)) * columns[u]
            counts[i, j] = total


@compiled("(u1[:, ::1],)", "(u1[:, :],)")
def shares(lit: Mask) -> tuple[float, float]:
    """Of a picture's ninths, in whole 255ths, how much is lit (255): their mean and the least."""
    counts = np.empty((3, 3), np.int64)
    ninths(lit, counts)
    share = np.rint(255.0 * counts.ravel() / lit.size) / 255.0
    pairs = share[:8:2] + share[1:8:2]
    total = (pairs[0] + pairs[1]) + (pairs[2] + pairs[3]) + share[8]
    return float(total / 9.0), float(share.min())


@compiled("(u1[:, ::1],)", "(u1[:, :],)", boundscheck=False)
def tops_of(dense: Mask) -> float:
    """Rows from the lower border up to the topmost dense pixel of a column, median over the columns
    that have one; NaN where less than half of them have."""
    height, width = dense.shape
    top = np.full(width, height, np.int32)
    for v in range(height - 1, -1, -1):
        row = dense[v]
        for u in range(width):
            top[u] = np.int32(v) if row[u] else top[u]
    some = np.sort(top[top < height])
    n = some.shape[0]
    if n < 0.5 * width:
        return np.nan
    return float(height - 0.5 * (some[(n - 1) // 2] + some[n // 2]))


@compiled("(u1[:, ::1],)", boundscheck=False)
def mean_of(grey: Mask) -> float:
    """Mean of a picture; 0 of an empty one."""
    total = 0
    for v in range(grey.shape[0]):
        row = grey[v]
        here = np.int32(0)
        for u in range(grey.shape[1]):
            here += np.int32(row[u])
        total += int(here)
    return total * (1.0 / grey.size) if grey.size else 0.0
