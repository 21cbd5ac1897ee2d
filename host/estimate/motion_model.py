"""How the filter's state moves with dead reckoning, and what that errs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from host.estimate.kalman import Array
from host.estimate.odometry import Motion
from host.estimate.states import CRAB, CURVE, GYRO, SLIP, STATES, WANDER, YAW

STEP_SIGMA = (0.03, 0.02)
"""Error of a step as a share of it, along (wheels slip, most where they start and stop) and
across."""
SLIP_SIGMA = 0.015
"""Of the share of their way that the driven wheels lose while they push the blade through crop,
before anything is learned of it."""
YAW_SIGMA_PER_M = math.radians(0.25)
YAW_SIGMA_SHARE = 0.03
"""Error of the yaw by dead reckoning: per square root of a metre, and as a share of what was turned
(the prior of the steering's gain, `odometry.YAW_GAIN_PRIOR`)."""
GYRO_SIGMA_PER_ROOT_S = math.radians(0.08)
GYRO_SIGMA_SHARE = 0.01
"""The same by the gyroscope: what a machine that drives shakes it by, and its scale."""
GYRO_WALK = math.radians(0.003)
"""Change of what it shows at rest, rad/s per square root of a second: a part that warms up by a
kelvin a minute, twice."""
CURVE_SIGMA_1PM = 0.006
"""Of the curvature that the pot does not show (its calibration, a side slope), at the start."""
CURVE_PER_M = 0.0005
"""Its growth per square root of a metre."""
CRAB_SIGMA = 0.01
"""Of what the machine drifts aside on a side slope, a share of its way: tyres of this load slip by
half a degree on a slope of five (Lenain et al. 2006)."""
CRAB_TURN_RAD = 0.7
"""What is known of it is gone by a turn of so much: the slope is another's."""


class Wander(NamedTuple):
    """How an edge, and what the detector makes of it, lie beside the lane's straight line: a
    first-order Gauss-Markov process along the way. Longer waves are the lane's."""

    sigma_m: float
    over_m: float
    """The way over which it is another's."""


DRILLED = Wander(0.02, 0.5)
"""Of a straight edge, the detector's error alone (docs/understand/vision.md)."""
CUT = Wander(0.035, 0.7)
"""Of an edge that the machine has left, its way too: 0.03 m RMS beside the straight line (81 strips
of 8 random fields, from the fourth metre on)."""


def move(
    x: Array, p: Array, past: Motion, motion: Motion, wander: Wander, *, cutting: bool
) -> None:
    """Moves the state `x` and its covariance `p` from one motion to a later one, in place."""
    lasted = max(0.0, motion.stamp - past.stamp)
    p[GYRO, GYRO] += GYRO_WALK**2 * lasted
    step = motion.distance_m - past.distance_m
    turn = motion.yaw_rad - past.yaw_rad
    if step == 0.0 and turn == 0.0:
        return
    run = abs(step)
    jacobian = np.eye(STATES)
    if motion.by_gyro:
        turn -= float(x[GYRO]) * lasted
        jacobian[YAW, GYRO] = -lasted
        yaw = GYRO_SIGMA_PER_ROOT_S**2 * lasted + GYRO_SIGMA_SHARE**2 * abs(turn)
    else:
        turn += float(x[CURVE]) * step
        jacobian[YAW, CURVE] = step
        yaw = YAW_SIGMA_PER_M**2 * run + YAW_SIGMA_SHARE**2 * abs(turn)
    middle = x[YAW] + turn / 2
    c, s = math.cos(middle), math.sin(middle)
    lost = step if cutting else 0.0
    step -= lost * float(x[SLIP])
    aside = run * float(x[CRAB])
    crab, same = math.exp(-abs(turn) / CRAB_TURN_RAD), math.exp(-run / wander.over_m)
    x[: YAW + 1] += step * c - aside * s, step * s + aside * c, turn
    x[CRAB] *= crab
    x[WANDER] *= same
    jacobian[:YAW, YAW] = -step * s - aside * c, step * c - aside * s
    jacobian[:YAW, SLIP] = -lost * c, -lost * s
    jacobian[:YAW, CRAB] = -run * s, run * c
    jacobian[:YAW] += jacobian[:YAW, YAW : YAW + 1] * (jacobian[YAW] - np.eye(STATES)[YAW]) / 2
    jacobian[CRAB, CRAB], jacobian[WANDER, WANDER] = crab, same
    p[:STATES] = jacobian @ p[:STATES]
    p[:, :STATES] = p[:, :STATES] @ jacobian.T
    # Neighbouring steps err alike: their errors grow along a metre as one.
    turned = np.array([[c, -s], [s, c]])
    p[:YAW, :YAW] += turned @ np.diag(np.square(STEP_SIGMA) * run) @ turned.T
    p[YAW, YAW] += yaw
    p[CURVE, CURVE] += CURVE_PER_M**2 * run
    p[CRAB, CRAB] += CRAB_SIGMA**2 * (1.0 - crab**2)
    p[WANDER, WANDER] += wander.sigma_m**2 * (1.0 - same**2)
