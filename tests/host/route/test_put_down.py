"""Where a machine is put down that lacks room behind its first crop."""

from __future__ import annotations

import pytest
import shapely

from host.core.vehicle import Vehicle
from host.field.areas import GAP_MARGIN_M, outline_of, placed
from host.route.plan import spiral
from host.route.put_down import MOST_M, STEP_M, moved_up_m
from host.route.side import lane_pose

VEHICLE = Vehicle()
LENGTH_M = 1.75
"""Of the machine behind its blade's line."""
SQUARE = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)]
BLUNT = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (-20.0, 20.0)]
"""135 degrees at the first corner."""
SHARP = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (20.0 / 3, 20.0)]


@pytest.mark.parametrize("gap_m", [0.4, 1.0, 1.5, 2.5])
@pytest.mark.parametrize("corners", [SQUARE, BLUNT, SHARP])
def test_so_far_up_it_just_has_room(corners: list[tuple[float, float]], gap_m: float) -> None:
    plan = spiral(corners, 0, VEHICLE, gap_m=gap_m)
    side = plan.sides[0]
    room_m = max(0.0, gap_m - GAP_MARGIN_M)
    permitted = shapely.Polygon(corners).buffer(room_m, join_style="mitre")

    def outside_m2(along_m: float) -> float:
        body = shapely.Polygon(placed(outline_of(VEHICLE), *lane_pose(side, along_m, VEHICLE)))
        return float(body.difference(permitted).area)

    up_m = moved_up_m(plan, side, VEHICLE)
    assert outside_m2(up_m) == 0.0
    assert outside_m2(up_m - 2 * STEP_M) > 0.0


@pytest.mark.parametrize(("gap_m", "up_m"), [(0.25, 1.7), (1.0, 0.95), (1.5, 0.45), (3.0, -1.05)])
def test_at_a_square_corner_it_lacks_what_its_length_exceeds_the_gap_by(
    gap_m: float, up_m: float
) -> None:
    """Beside the narrowest one its blade's right end stands outside all along."""
    plan = spiral(SQUARE, 0, VEHICLE, gap_m=gap_m)
    assert up_m == pytest.approx(LENGTH_M + GAP_MARGIN_M - gap_m)
    assert moved_up_m(plan, plan.sides[0], VEHICLE) == pytest.approx(up_m, abs=STEP_M)


def test_at_a_blunt_corner_it_lacks_more() -> None:
    """Behind its first crop the border leads away aslant."""
    square, blunt = (spiral(corners, 0, VEHICLE, gap_m=1.5) for corners in (SQUARE, BLUNT))
    lacks_m = moved_up_m(square, square.sides[0], VEHICLE)
    assert moved_up_m(blunt, blunt.sides[0], VEHICLE) > lacks_m + 0.2


def test_where_nobody_has_measured_the_gap_it_may_stand_anywhere() -> None:
    plan = spiral(SQUARE, 0, VEHICLE)
    assert moved_up_m(plan, plan.sides[0], VEHICLE) == -MOST_M
