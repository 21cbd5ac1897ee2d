"""What is known before anything is seen: of sensors and wheels, and of where the machine begins."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from host.estimate import gyroscope
from host.estimate.kalman import Array
from host.estimate.motion_model import (
    CURVE_SIGMA_1PM,
    GRADE_SIGMA,
    GYRO_SCALE_SIGMA,
    SCALE_SIGMA,
    SIGHT_SIGMA_M,
    SLIP_SIGMA,
)
from host.estimate.states import (
    CURVE,
    GRADE_X,
    GRADE_Y,
    GYRO,
    GYRO_SCALE,
    PLAN_YAW,
    SCALE,
    SIGHT,
    SLIP,
)

START_SIGMA: Final = (0.1, 0.1, math.radians(2))
"""Of where an operator puts the machine, along and beside its lane, m, and of its direction."""
PLAN_SIGMA_RAD: Final = math.radians(3)
"""Of a walked boundary's direction against the courses'."""
RECORDED_SIGMA_RAD: Final = math.radians(0.7)
"""The same of one that a receiver has recorded point by point: of 20 simulated walks each was
turned by 0.1 to 1.5 degrees. Larger: a machine that follows what bends all along turns with it."""
OPEN_SIGMA: Final = (0.1, math.radians(5))
"""Of where a machine without a plan, or not placed in it yet, begins beside its lane."""
SIGMAS: Final = {
    SLIP: SLIP_SIGMA,
    PLAN_YAW: PLAN_SIGMA_RAD,
    CURVE: CURVE_SIGMA_1PM,
    GYRO: gyroscope.OFFSET_SIGMA,
    GYRO_SCALE: GYRO_SCALE_SIGMA,
    SIGHT: SIGHT_SIGMA_M,
    SCALE: SCALE_SIGMA,
    GRADE_X: GRADE_SIGMA,
    GRADE_Y: GRADE_SIGMA,
}
"""Of the states, in their units."""


def covariance(states: int) -> Array:
    """(states, states), of a machine that has no place yet."""
    found = np.zeros((states, states))
    for state, sigma in SIGMAS.items():
        found[state, state] = sigma**2
    return found
