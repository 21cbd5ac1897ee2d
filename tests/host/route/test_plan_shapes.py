"""Facts about plans of fields with reflex corners and keep-outs."""

from __future__ import annotations

import math

import pytest
import shapely

from host.core.vehicle import Vehicle
from host.route.plan import KEEP_OUT_M, Plan, Side, spiral
from host.route.turn_legs import shuttle_length, shuttle_room_m

VEHICLE = Vehicle()


def end_of(side: Side) -> shapely.Point:
    """The middle of a strip's end."""
    c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
    across = side.width_m / 2
    return shapely.Point(
        side.x_m + c * side.length_m - s * across, side.y_m + s * side.length_m + c * across
    )


@pytest.mark.parametrize("depth_m", [0.95, 1.0, 1.4, 1.8])
def test_beside_a_narrow_strip_the_lane_lies_further_out_but_never_beside_the_body(
    depth_m: float,
) -> None:
    """The strip before a reflex corner is narrower than a pass."""
    step = [(0, 0), (10, 0), (10, depth_m), (5, depth_m), (5, 8), (0, 8)]
    plan = spiral(step, 0, VEHICLE, gap_m=2.0)
    strips = math.ceil(depth_m / VEHICLE.pass_m)
    narrow = [s for s in plan.sides if s.width_m == pytest.approx(depth_m / strips, abs=1e-3)]
    assert narrow
    room = VEHICLE.pass_m - depth_m / strips
    for side in narrow:
        assert side.shift_m == pytest.approx(min(room, 0.35), abs=1e-3)


def plan_around(hole: shapely.Polygon) -> Plan:
    field = [(0.0, 0.0), (15.0, 0.0), (15.0, 13.0), (0.0, 13.0)]
    ring = [(x, y) for x, y in hole.exterior.coords[:-1]]
    return spiral(field, 0, VEHICLE, gap_m=2.0, keep_outs=[ring])


@pytest.mark.parametrize(("x", "y"), [(3.6, 7.0), (9.0, 4.2), (11.4, 9.5), (7.1, 6.6)])
def test_a_side_ends_blind_just_where_a_keep_out_ends_it(x: float, y: float) -> None:
    hole = shapely.box(x, y, x + 0.8, y + 0.8)
    around = hole.buffer(KEEP_OUT_M, join_style="mitre")
    for side in plan_around(hole).sides:
        assert side.blind_end is (around.distance(end_of(side)) < 0.01)


def test_at_slanting_corners_the_plan_says_where_crop_is_seen_and_where_the_edge_runs() -> None:
    """Corners of 135 degrees at the beginning and 45 degrees at the end: the strip's ends slant
    over its width; crop that fills 22 % of the blade's width is seen."""
    plan = spiral([(0.0, 0.0), (12.0, 0.0), (8.0, 4.0), (-4.0, 4.0)], 0, VEHICLE, gap_m=2.0)
    first, width = plan.sides[0], VEHICLE.pass_m
    assert (first.x_m, first.length_m) == pytest.approx((-width, 12.0 + width), abs=0.01)
    assert first.begin_seen_m == pytest.approx(0.22 * width, abs=0.02)
    assert first.end_seen_m == pytest.approx(0.22 * width, abs=0.02)
    assert first.edge_begin_m == pytest.approx(width, abs=0.02)
    assert first.edge_end_m == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize(("x", "y"), [(3.6, 7.0), (9.0, 4.2), (11.4, 9.5), (7.1, 6.6), (6.0, 2.0)])
def test_around_a_keep_out_no_shuttle_is_planned_without_room(x: float, y: float) -> None:
    plan = plan_around(shapely.box(x, y, x + 0.8, y + 0.8))
    least = shuttle_length(VEHICLE, VEHICLE.pass_m, 0.0)
    for k, side in enumerate(plan.sides[1:]):
        if plan.corner_rad(k) == 0.0:
            assert shuttle_room_m(VEHICLE, side.back_m, plan.gap_m) >= least
