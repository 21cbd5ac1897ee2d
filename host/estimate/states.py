"""What the filter's state vector means, by index."""

from __future__ import annotations

from typing import Final

(
    X,
    Y,
    YAW,
    SLIP,
    LANE_OFFSET,
    LANE_YAW,
    PLAN_YAW,
    CURVE,
    GYRO,
    CRAB,
    WANDER,
    SIGHT,
    SCALE,
    GYRO_SCALE,
    GRADE_X,
    GRADE_Y,
    CORNERS,
) = range(17)
"""Pose in the field frame, m and rad; share of their way that the driven wheels lose by pushing the
blade through crop; the present lane against the edge that it runs along, m and rad; the courses'
direction against the plan's, rad; curvature that the pot does not show, 1/m; what the gyroscope
shows at rest, besides what has been taken off it, rad/s; how far the machine drifts to its left, m
for each metre; how far left of its lane's straight line the crop's edge lies here, m; how far left
of its true place every picture shows it, m; share of their way that the wheels always lose, by
rolling and by what their sensor's scale is wrong; share of what is turned that the gyroscope shows
too much, besides what has been taken off it; and what of their way the wheels lose uphill, along x
and y of the field frame. From CORNERS on, two by two, how far the boundary's corners lie
from where they are taken to be, m, if they are to be found (`Outline.at`); and behind them, two by
two, lanes that were cut, as the present one (`host.estimate.lanes`)."""
POSE: Final = slice(X, YAW + 1)
LANE: Final = slice(LANE_OFFSET, LANE_YAW + 1)
RATES: Final = (CURVE, GYRO, GYRO_SCALE)
"""What makes a machine turn otherwise than it seems to. An edge that bends tells nothing of them:
how it runs would pass for a rate of turning. Stands, courses and turns tell of that."""
