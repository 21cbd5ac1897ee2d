"""Crop that stands beside the machine's way, left of it: where a machine that has come off its
strip sees nothing ahead, the edge that it should follow is in the picture all the same."""

from __future__ import annotations

from typing import Final

import numba
import numpy as np

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
NEAREST, FARTHEST = np.float32(BESIDE_M[0]), np.float32(BESIDE_M[1])


@numba.njit(cache=True, nogil=True)
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
