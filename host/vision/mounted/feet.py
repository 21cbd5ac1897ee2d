"""Where the stems' feet are: block by block of columns, in one picture."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from host.vision.mounted.evidence import Sums
from host.vision.pictures import Mask

BLOCK_PX = 16
"""Columns that share a foot."""


@numba.njit(cache=True, nogil=True, boundscheck=False)
def block_sums(steps: Mask, grey: Mask, sums: NDArray[np.int32]) -> None:
    """Sums of steps and of grey per block of columns and row, running from the top:
    (2, rows + 1, blocks)."""
    for v in range(steps.shape[0]):
        for b in range(sums.shape[2]):
            step, level = np.int32(0), np.int32(0)
            for u in range(b * BLOCK_PX, (b + 1) * BLOCK_PX):
                step += np.int32(steps[v, u] & 1)
                level += np.int32(grey[v, u])
            sums[0, v + 1, b] = sums[0, v, b] + step
            sums[1, v + 1, b] = sums[1, v, b] + level


@numba.njit(cache=True, nogil=True)
def feet_of(
    dense: Mask,
    sums: NDArray[np.int32],
    horizon: int,
    limit: NDArray[np.int32],
    windows: NDArray[np.int32],
    spread: Sums,
    feet: NDArray[np.int32],
) -> None:
    """Per block of columns the row of its foot, -1 without: below the lowest dense row, the
    division of the rows above from those below with the greatest difference, at most down to
    `limit` of the dense row."""
    height = dense.shape[0]
    for b in range(feet.shape[0]):
        feet[b] = -1
        middle = b * BLOCK_PX + BLOCK_PX // 2
        rough = -1
        for v in range(height - 1, horizon - 1, -1):
            if dense[v, middle]:
                rough = v
                break
        if rough < 0:
            continue
        best, at = -1.0, rough
        for v in range(rough - windows[rough] // 2, min(height - 2, limit[rough]) + 1):
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
