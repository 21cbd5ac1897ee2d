"""Where the operator puts the machine down to begin a plan: its blade at the crop, or as much
farther in as the machine lacks room behind it."""

from __future__ import annotations

from typing import Final

import shapely

from host.core.vehicle import Vehicle
from host.field.areas import GAP_MARGIN_M, outline_of, placed
from host.route.plan import Plan
from host.route.side import Side, lane_pose

MOST_M: Final = 3.0
"""The machine's length, and more: with its blade so far in, all of it stands in the field."""
STEP_M: Final = 0.01
"""As finely as an operator can."""


def moved_up_m(plan: Plan, side: Side, vehicle: Vehicle) -> float:
    """How far past a side's first crop the blade must be at least, for all of the machine to stand
    in the field or in the gap around it, off the neighbour's crop, m; negative: it may stand
    before. `MOST_M` either way: or farther."""
    if plan.gap_m is None:
        return -MOST_M
    room_m = max(0.0, plan.gap_m - GAP_MARGIN_M)
    permitted = shapely.Polygon(plan.boundary).buffer(room_m, join_style="mitre")
    outline = outline_of(vehicle)
    shapely.prepare(permitted)
    along_m = -MOST_M
    while along_m < MOST_M:
        at = lane_pose(side, along_m, vehicle)
        if permitted.covers(shapely.Polygon(placed(outline, *at))):
            break
        along_m += STEP_M
    return along_m
