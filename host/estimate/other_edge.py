"""An edge that contradicts the lane until that is doubted enough: where it lies too far away for
the lane to be there, it is another one, of more than a strip before.

Then it leads the machine, whose place is no more than doubted. Moved with the lane, a place that is
known to half a metre would end two strips aside, and as sure as before.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from host.estimate.kalman import Array, Measurement
from host.estimate.states import LANE_OFFSET, YAW

FAR_M: Final = 1.0
FAR_SIGMAS: Final = 4.0
"""Beside where the lane was believed to be before it was doubted: farther than both. A strip is
0.9 m wide, and a place that is known no better than to a quarter of it tells no two apart."""
DOUBTED_M: Final = 0.5
"""By which the place is doubted then, as a standard deviation: it may have been wrong after all."""
LANE_TIMES: Final = 4.0
"""Times that way, the lane is: it takes 98 % of what is seen."""


def is_one(seen: Measurement, sigma_m: float, undoubted_m: float) -> bool:
    """Whether an edge that is about to be taken is another. The standard deviations of where the
    lane's is expected: now, and before it was doubted (inf: it was not)."""
    off_m, noise = float(seen.innovation[0]), float(seen.variances[0])
    far_m = FAR_SIGMAS * math.hypot(undoubted_m, math.sqrt(noise))
    taken = off_m**2 <= seen.gate * (sigma_m**2 + noise)
    return taken and abs(off_m) >= max(FAR_M, far_m)


def expect(p: Array, direction: tuple[float, float], off_m: float) -> None:
    """Lets a covariance of the state know that the lane, of that direction, may lie so far aside of
    where it is believed."""
    across = np.array([-direction[1], direction[0]])
    p[:YAW, :YAW] += np.outer(across, across) * DOUBTED_M**2
    p[LANE_OFFSET, LANE_OFFSET] += (LANE_TIMES * off_m) ** 2
