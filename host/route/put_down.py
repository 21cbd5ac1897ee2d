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
"""The machine's length, and more: with its blade so far in, none of its rear stands outside."""
STEP_M: Final = 0.01
"""As finely as an operator can."""
ALIKE: Final = 1.0 + 1e-6
"""Times as much of the machine stands outside at two places at which it is the same."""


def moved_up_m(plan: Plan, side: Side, vehicle: Vehicle) -> float:
    """How far past a side's first crop the blade must be at least, for no more of the machine to
    stand outside of the field and the gap around it than farther in, m; negative: it may stand
    before, `-MOST_M` or farther. Beside a gap of a few decimetres the blade's end always does."""
    if plan.gap_m is None:
        return -MOST_M
    room_m = max(0.0, plan.gap_m - GAP_MARGIN_M)
    permitted = shapely.Polygon(plan.boundary).buffer(room_m, join_style="mitre")
    outline = outline_of(vehicle)
    shapely.prepare(permitted)

    def outside_m2(along_m: float) -> float:
        body = shapely.Polygon(placed(outline, *lane_pose(side, along_m, vehicle)))
        return 0.0 if permitted.covers(body) else float(body.difference(permitted).area)

    most_m2 = outside_m2(MOST_M) * ALIKE
    along_m = -MOST_M
    while along_m < MOST_M and outside_m2(along_m) > most_m2:
        along_m += STEP_M
    return along_m
