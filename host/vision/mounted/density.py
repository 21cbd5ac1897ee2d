"""Sums over a picture's neighbourhoods that OpenCV takes five times as long for: what is summed is
lit or not, so that whole neighbourhoods fit into bytes."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from host.vision.pictures import Mask

ACROSS, ALONG = 8, 4
"""Columns and rows that a neighbourhood reaches to either side: 17 by 9 pixels."""
PIXELS = (2 * ACROSS + 1) * (2 * ALONG + 1)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def mark_dense(lit: Mask, least: int, out: Mask) -> None:
    """255 where at least `least` of a neighbourhood's pixels are lit (255), 0 elsewhere. Beyond the
    picture's border the picture goes on mirrored, the border itself not repeated."""
    height, width = lit.shape
    one, most, enough = np.uint8(1), np.uint8(255), np.uint8(least)
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
            here[u] = most if count >= enough else np.uint8(0)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def ninths(lit: Mask, counts: NDArray[np.int64]) -> None:
    """How much of each ninth of a picture is lit (255), three by three, in ninths of a pixel: a
    pixel that a border divides counts on both sides by its share. All of it is the picture's number
    of pixels."""
    height, width = lit.shape
    for i in range(3):
        for j in range(3):
            counts[i, j] = 0
    for v in range(height):
        row = lit[v]
        for j in range(3):
            # The borders lie at thirds of a pixel.
            begin, end = width * j, width * (j + 1)
            whole = (begin + 2) // 3
            total = np.int32(0)
            for u in range(whole, end // 3):
                total += np.int32(row[u] & np.uint8(1))
            thirds = 3 * np.int64(total)
            if whole * 3 > begin:
                thirds += (min(whole * 3, end) - begin) * (row[whole - 1] & 1)
            if end > whole * 3:
                thirds += (end % 3) * (row[end // 3] & 1)
            for i in range(3):
                share = min(3 * v + 3, height * (i + 1)) - max(3 * v, height * i)
                if share > 0:
                    counts[i, j] += share * thirds
