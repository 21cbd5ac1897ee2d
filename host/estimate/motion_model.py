"""How the filter's state moves with dead reckoning, and what that errs."""

from __future__ import annotations

import math
from typing import NamedTuple

from host.core.compiled import compiled
from host.estimate.kalman import Array
from host.estimate.odometry import Motion
from host.estimate.outline import STRAYS_M
from host.estimate.states import (
    CRAB,
    CURVE,
    GRADE_X,
    GRADE_Y,
    GYRO,
    GYRO_SCALE,
    SCALE,
    SIGHT,
    SLIP,
    WANDER,
    YAW,
    X,
    Y,
)

STEP_SIGMA = (0.03, 0.02)
"""Error of a step as a share of it, along (wheels slip, most where they start and stop) and
across."""
ROLL_SHARE = 1.0
"""Error along of a machine that rolls with its drive off, as a share of how far it has rolled: one
taken for the other way is off by twice as much. Where it is known which way, each step of it errs
by itself. Of 310 rolls of 16 random fields 95 % were off by
no more than twice that; 0.02 m by 0.04 m, 0.05 m by 0.08 m, 0.2 m by 0.36 m."""
SLIP_SIGMA = 0.015
"""Of the share of their way that the driven wheels lose by pushing the blade through crop, before
anything is learned of it."""
SCALE_SIGMA = 0.02
"""Of what they always lose: tyres slip by as much as rolling resistance is of the load that they
can pull, some 2 %, and the sensor's scale was taped to 1 %."""
GRADE_SIGMA = 0.012
"""Of what they lose uphill, as much as they gain downhill: 1.4 % on a slope of 2 degrees (a tyre
whose slip grows by 1 % with each 30 N of pull)."""
YAW_SIGMA_PER_M = math.radians(0.25)
YAW_SIGMA_SHARE = 0.03
"""Error of the yaw by dead reckoning: per square root of a metre, and as a share of what was turned
(the prior of the steering's gain, `odometry.YAW_GAIN_PRIOR`). On strips of six random fields it was
0.29 degrees over a metre and 0.84 over three, RMS: most of it the bias that CURVE holds."""
GYRO_SCALE_SIGMA = 0.01
"""Of the gyroscope's scale (Bosch BMI160 data sheet)."""
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
SIGHT_SIGMA_M, SIGHT_OVER_M = 0.045, 150.0
"""Of what the mount, the lens and the detector err alike in every picture of a machine (0.048 m
over 120 random fields, each with a mount and a lens of its own), and the way over which that is
another: some sides, along which light and dust are another's. Strip after strip is so much wider or
narrower than planned: turns by dead reckoning and the ends of the sides across tell it."""


class Wander(NamedTuple):
    """How an edge, and what the detector makes of it, lie beside the lane's straight line: a
    first-order Gauss-Markov process along the way. Longer waves are the lane's."""

    sigma_m: float
    over_m: float
    """The way over which it is another's."""


DRILLED = Wander(0.02, 0.5)
"""Of a straight edge, the detector's error alone: RMSE in clean air
(docs/understand/vision/measured.md). What dust adds is judged before (host.pilot.sight)."""
CUT = Wander(0.035, 0.7)
"""Of an edge that the machine has left, its way too: 0.03 m RMS beside the straight line (81 strips
of 8 random fields, from the fourth metre on)."""
BENT = Wander(STRAYS_M, 2.0)
"""Of an edge that bends beside its straight piece, and of those that strips have left along it: a
piece of 5 m is on either side of it by turns."""
TRIMMED = Wander(0.2, 10.0)
"""Of a side's first crop, which the turn before may have trimmed, by up to 0.35 m (model field
11335): what pictures show of it errs alike all the way there. Narrower: they turn a machine that
knows better; wider: one that a turn has left askew finds its lane later."""
BESIDE = Wander(0.12, 2.0)
"""Of the next strip's edge as a machine sees it that backs beside it: an edge that the machine has
left, and what the detector errs of crop beside its way (docs/understand/vision.md)."""
PRESSED = Wander(0.3, 10.0)
"""Of an edge where wheels have pressed down the crop: the detector looks for the right end of what
stands before the blade, and what it then takes of an edge at the picture's border is 0.2 to 0.3 m
off, all along."""


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
    along_m2 = STEP_SIGMA[0] ** 2 * run
    if motion.rolls:
        # One roll errs one way all along.
        whole_m = max(run, motion.roll_doubt_m)
        along_m2 = ROLL_SHARE**2 * (whole_m**2 - (whole_m - run) ** 2)
    _move(x, p, step, turn, lasted, motion.gyro_noise, cutting, along_m2, *wander)


@compiled("(f8[::1], f8[:, ::1], f8, f8, f8, f8, b1, f8, f8, f8)")
def _move(
    x: Array,
    p: Array,
    step: float,
    turn: float,
    lasted: float,
    gyro_noise: float,
    cutting: bool,
    along_m2: float,
    wander_sigma_m: float,
    wander_m: float,
) -> None:
    """`move` by a step and a turn, compiled: of the Jacobian all rows are the unit matrix's but
    those of the pose, of CRAB, WANDER and SIGHT, and those hold few states."""
    run = abs(step)
    of_scale = 0.0
    if gyro_noise > 0.0:
        of_scale = -turn
        turn -= x[GYRO] * lasted + x[GYRO_SCALE] * turn
        turns_by, of_turn = GYRO, -lasted
        yaw = gyro_noise**2 * lasted
    else:
        turn += x[CURVE] * step
        turns_by, of_turn = CURVE, step
        yaw = YAW_SIGMA_PER_M**2 * run + YAW_SIGMA_SHARE**2 * abs(turn)
    middle = x[YAW] + turn / 2
    c, s = math.cos(middle), math.sin(middle)
    lost = step if cutting else 0.0
    grade, across = x[GRADE_X] * c + x[GRADE_Y] * s, x[GRADE_Y] * c - x[GRADE_X] * s
    whole = step
    step -= lost * x[SLIP] + whole * x[SCALE] + run * grade
    aside = run * x[CRAB]
    crab, same = math.exp(-abs(turn) / CRAB_TURN_RAD), math.exp(-run / wander_m)
    alike = math.exp(-run / SIGHT_OVER_M)
    ahead, left = step * c - aside * s, step * s + aside * c
    x[X] += ahead
    x[Y] += left
    x[YAW] += turn
    x[CRAB] *= crab
    x[WANDER] *= same
    x[SIGHT] *= alike
    for columns in (False, True):
        q = p.T if columns else p
        for k in range(len(x)):
            by_turn = of_turn * q[turns_by, k] + of_scale * q[GYRO_SCALE, k]
            # The way was made at the middle of the turn.
            yawed = q[YAW, k] + by_turn / 2
            slip = lost * q[SLIP, k] + whole * q[SCALE, k]
            slip += run * (c * q[GRADE_X, k] + s * q[GRADE_Y, k] + across * yawed)
            crabbed = run * q[CRAB, k]
            q[X, k] += -left * yawed - c * slip - s * crabbed
            q[Y, k] += ahead * yawed - s * slip + c * crabbed
            q[YAW, k] += by_turn
            q[CRAB, k] *= crab
            q[WANDER, k] *= same
            q[SIGHT, k] *= alike
    # Neighbouring steps err alike: their errors grow along a metre as one.
    across_m2 = STEP_SIGMA[1] ** 2 * run
    p[X, X] += c * c * along_m2 + s * s * across_m2
    p[Y, Y] += s * s * along_m2 + c * c * across_m2
    p[X, Y] += c * s * (along_m2 - across_m2)
    p[Y, X] += c * s * (along_m2 - across_m2)
    p[YAW, YAW] += yaw
    p[CURVE, CURVE] += CURVE_PER_M**2 * run
    p[SIGHT, SIGHT] += SIGHT_SIGMA_M**2 * (1.0 - alike**2)
    p[CRAB, CRAB] += CRAB_SIGMA**2 * (1.0 - crab**2)
    p[WANDER, WANDER] += wander_sigma_m**2 * (1.0 - same**2)
