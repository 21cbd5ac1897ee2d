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
from host.route.standing import BEND_RAD

START_SIGMA: Final = (0.1, 0.1, math.radians(2))
"""Of where an operator puts the machine, along and beside its lane, m, and of its direction."""
PLAN_SIGMA_RAD: Final = math.radians(3)
"""Of a walked boundary's direction against the courses'."""
RECORDED_SIGMA_RAD: Final = math.radians(0.7)
"""The same of one that a receiver has recorded point by point: of 20 simulated walks each was
turned by 0.1 to 1.5 degrees. Larger: a machine that follows what bends all along turns with it."""
ALIKE_M: Final = 8.5
"""Way along a boundary that a receiver has recorded over which its points err alike (first-order
Gauss-Markov): of 25 simulated walks of fields that bend the errors have correlations of 0.7, 0.5
and 0.3 after 3, 6 and 10 m. Longer: a bow that was recorded wrongly is believed for longer;
shorter: pieces of 3 m may lie askew by ten degrees, and the machine turns them after each bump."""
OWN_SHARE: Final = 0.5
"""Of the variance of a real corner, that is its own: it was rounded by the walker and the survey's
smoothing, and sharpened again. Smaller: a corner that is a metre off pulls what lies beside it
along."""
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


def corners(ring: Array, sigma_m: float, recorded: bool) -> Array:
    """(2n, 2n), m2, of the n corners of a boundary, x and y by turns, each known to `sigma_m`. What
    was recorded point by point is righter in its shape than in its places, but for real corners;
    who enters corners one by one errs at each anew."""
    alike = np.eye(len(ring))
    if recorded:
        ways = np.roll(ring, -1, axis=0) - ring
        steps, headings = np.hypot(*ways.T), np.arctan2(ways[:, 1], ways[:, 0])
        turns = np.abs(np.remainder(headings - np.roll(headings, 1) + math.pi, math.tau) - math.pi)
        at = np.cumsum(steps) - steps
        apart = np.abs(at[:, None] - at)
        alike = np.exp(-np.minimum(apart, steps.sum() - apart) / ALIKE_M)
        shared = np.sqrt(np.where(turns > BEND_RAD[0], 1.0 - OWN_SHARE, 1.0))
        alike *= np.outer(shared, shared)
        np.fill_diagonal(alike, 1.0)
    found: Array = np.kron(sigma_m**2 * alike, np.eye(2)).astype(np.float64)
    return found
