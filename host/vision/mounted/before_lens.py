"""Whether crop stands right before the lens of a camera below the tops, and hides all else.

The ground, stubble, swath and crop some way off are full of small steps. Stems a hand's breadth
away are wide bands without any. A veil of dust has no small steps either, but no bands.
"""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

from host.vision.pictures import Mask

CELL_PX: Final = 8
FLAT: Final = 2.5
"""Median over the cells of the grey levels' standard deviation within one, 255ths of the
logarithmic range: 1.2 to 2 with stems before the lens, 4 and more without, in 10,489 pictures of
ten drives, dust and all."""
BANDS: Final = 1.6
"""Times that, the cells' means differ from one to the next beside it, in the lower third: of smooth
ground they hardly do. 1.9 and more of such pictures in nineteen of twenty, down to 0.8 of a wall of
one colour."""


@numba.njit(cache=True, nogil=True)
def before_lens(grey: Mask) -> bool:
    """`grey`: (height, width) below the horizon, on the logarithmic scale of the evidence."""
    rows, columns = grey.shape[0] // CELL_PX, grey.shape[1] // CELL_PX
    if rows == 0 or columns < 2:
        return False
    spread = np.empty(rows * columns, np.float32)
    steps, lower = 0.0, rows - max(1, rows // 3)
    count = CELL_PX * CELL_PX // 2
    for i in range(rows):
        before = 0.0
        for j in range(columns):
            total, squares = 0, 0
            for v in range(CELL_PX * i, CELL_PX * (i + 1), 2):
                for u in range(CELL_PX * j, CELL_PX * (j + 1)):
                    g = int(grey[v, u])
                    total += g
                    squares += g * g
            mean = total / count
            spread[i * columns + j] = np.sqrt(max(0.0, squares / count - mean * mean))
            if j > 0 and i >= lower:
                steps += abs(mean - before)
            before = mean
    flat = float(np.median(spread))
    return flat < FLAT and steps / ((rows - lower) * (columns - 1)) > BANDS * flat
