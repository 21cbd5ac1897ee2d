"""What the filters' state vectors mean, by index."""

from __future__ import annotations

from typing import Final

OFFSET, HEADING, BIAS = range(LANE_STATES := 3)
"""Of the lane filter: rear axle left of the lane, m; heading against it, rad; curvature that the
pot does not show, 1/m."""

X, Y, YAW, SLIP, LANE_OFFSET, LANE_YAW, PLAN_YAW = range(STATES := 7)
"""Of the position: pose in the field frame, m and rad; share of their way that the driven wheels
lose while cutting; the present lane against the edge that it runs along, m and rad; the courses'
direction against the plan's, rad. Behind them, two by two, how far the boundary's corners lie from
where they are taken to be, m."""
LANE: Final = slice(LANE_OFFSET, LANE_YAW + 1)
