"""Whether crop stands right before the lens of a camera below the tops, and hides all else.

The ground, stubble, swath and crop some way off are full of small steps. Stems a hand's breadth
away are wide bands without any. A veil of dust has no small steps either, but no bands.
"""

from __future__ import annotations

import math
from typing import Final

from host.core.compiled import compiled
from host.vision.pictures import Mask

HIDES: Final = "stems stand right before the lens"
"""In words, for the view."""
CELL_PX: Final = 8
FLAT: Final = 2.5
"""Standard deviation of the grey levels within a cell, 255ths of the logarithmic range: most cells
have 1.2 to 2 with stems before the lens, and 4 and more without, dust and all;"""
MOST: Final = 2 / 3
"""and so many must be below it, as where smooth stubble lies beside crop they are not."""
BANDS: Final = 2.4
"""Times the mean of those, the cells' means differ from one to the next beside it, in the lower
third: of smooth ground they hardly do. Chosen on ten drives, in which 209 of 278 such pictures are
known and no others are, and on 101 photographs, of which none is."""


@compiled("(u1[:, ::1],)")
def before_lens(grey: Mask) -> bool:
    """`grey`: (height, width) below the horizon, on the logarithmic scale of the evidence."""
    rows, columns = grey.shape[0] // CELL_PX, grey.shape[1] // CELL_PX
    if rows == 0 or columns < 2:
        return False
    smooth, spread = 0, 0.0
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
            variance = max(0.0, squares / count - mean * mean)
            if variance < FLAT * FLAT:
                smooth += 1
                spread += math.sqrt(variance)
            if j > 0 and i >= lower:
                steps += abs(mean - before)
            before = mean
    if smooth < MOST * rows * columns:
        return False
    return bool(steps / ((rows - lower) * (columns - 1)) > BANDS * spread / smooth)
