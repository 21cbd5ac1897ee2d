"""The kinds of ground on a field's grid, and the kind at a point.

A grid is indexed [row j along y, column i along x] with the corner of cell (0, 0) at (x0, y0) and
square cells of `cell` metres.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

SOIL: Final = 0
CROP: Final = 1
STUBBLE: Final = 2
WINDROW: Final = 3
"""Cut straw lying in a swath, over stubble or soil."""
GRASS: Final = 4
"""Weeds and grass on ground without crop."""
NEIGHBOUR: Final = 5
NEIGHBOUR_STUBBLE: Final = 6
"""Crop of a neighbour that the blade has cut: must never exist."""
OBSTACLE: Final = 7
"""A house or a keep-out."""
TRUNK: Final = 8
"""Of a tree."""


@njit(cache=True, nogil=True)
def kind_at(kind: NDArray[np.uint8], x0: float, y0: float, cell: float, x: float, y: float) -> int:
    """Kind of the cell that holds a point; SOIL outside the grid."""
    i = math.floor((x - x0) / cell)
    j = math.floor((y - y0) / cell)
    if i < 0 or j < 0 or j >= kind.shape[0] or i >= kind.shape[1]:
        return SOIL
    return int(kind[j, i])
