"""Crop that stands beside the machine's way. Left of it: where a machine that has come off its
strip sees nothing ahead, the edge that it should follow is in the picture all the same. Right of
it: that machine is in the crop, and what it cuts has no right end in view."""

from __future__ import annotations

from typing import Final

import numpy as np

from host.core.compiled import compiled
from host.vision.mounted.evidence import Floats
from host.vision.view import BESIDE_M, NAN

BLOCKS: Final = 3
"""Blocks of columns with a foot there, at least: one is a weed's."""
OUTSIDE_M: Final = 0.2
"""Left of the machine's middle, at least: what stands farther right stands in its way."""
REACH_M: Final = 1.5
"""And at most. Farther off it may be another field's, and foreshortened a decimetre is no pixel."""
QUARTILE: Final = 0.25
"""Of the feet from right to left, the one that is near the right end: what is seen between the
stalks, and stands behind them, lies left of it."""
NEAR_M: Final = 0.15
"""Feet within so much of that are the right end's: a row's unevenness, and 5 degrees askew."""
WALL_AHEAD_M: Final = (-0.4, -0.05)
"""Before the blade's line, where crop right of the machine stands beside what it has just cut,"""
WALL_ASIDE_M: Final = (0.05, 0.4)
"""and how far right of where its edge should be: nearer it may be the face, farther off it may be
the neighbour's."""
WALL_BLOCKS: Final = 3
"""Blocks of columns with a foot there, at least. Chosen on 144 standing views of seed 79: in 47 of
48 in the crop, in none of 48 on the edge, in 7 of 48 beside what an earlier strip has left."""
NEAREST, FARTHEST = np.float32(BESIDE_M[0]), np.float32(BESIDE_M[1])


@compiled("(f4[::1], f4[::1], f8)")
def right_end_beside(x: Floats, y: Floats, blade_x_m: float) -> float:
    """Where its right end lies, m left of the vehicle's x axis, of the feet of standing crop (n,)
    `x`, `y`, m in the vehicle frame; NaN without (docs/understand/vision.md says how exact)."""
    ahead = x - np.float32(blade_x_m)
    along = (ahead > NEAREST) & (ahead < FARTHEST)
    feet = np.sort(y[along & (y > np.float32(OUTSIDE_M)) & (y < np.float32(REACH_M))])
    n = len(feet)
    if n < BLOCKS:
        return NAN
    at = QUARTILE * (n - 1)
    k = int(at)
    right = feet[k] + np.float32(at - k) * (feet[k + 1] - feet[k])
    near = feet[np.abs(feet - right) < np.float32(NEAR_M)]
    n = len(near)
    if n < BLOCKS:
        return NAN
    return float(np.float32(0.5) * (near[(n - 1) // 2] + near[n // 2]))


@compiled("(f4[::1], f4[::1], f8, f8)")
def stands_right(x: Floats, y: Floats, blade_x_m: float, edge_y_m: float) -> bool:
    """Whether feet of standing crop (n,) `x`, `y`, m in the vehicle frame, stand beside the blade,
    right of where its edge should be, edge_y_m."""
    count = 0
    for k in range(len(x)):
        ahead, aside = x[k] - blade_x_m, edge_y_m - y[k]
        if WALL_AHEAD_M[0] < ahead < WALL_AHEAD_M[1] and WALL_ASIDE_M[0] < aside < WALL_ASIDE_M[1]:
            count += 1
    return count >= WALL_BLOCKS
