"""Facts about plans of fields with reflex corners and keep-outs."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely

from host.core.vehicle import Vehicle
from host.field.areas import areas_of
from host.route.anew import around
from host.route.plan import KEEP_OUT_M, MAX_WALKED, Plan, spiral
from host.route.preview import preview
from host.route.side import Side
from host.route.standing import Edge
from host.route.turn_choice import next_turn
from host.route.turn_legs import driven, shuttle_length, shuttle_room_m

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


@pytest.mark.parametrize("more_m", [0.01, 0.03, 0.045])
def test_no_strip_is_planned_that_the_overlap_has_cut(more_m: float) -> None:
    """A plan that is laid out anew would end with one of no width (random field 10118)."""
    for passes in (4, 5):
        wide = passes * VEHICLE.pass_m + more_m
        plan = spiral([(0.0, 0.0), (9.0, 0.0), (9.0, wide), (0.0, wide)], 0, VEHICLE, gap_m=2.0)
        assert min(side.width_m for side in plan.sides) >= VEHICLE.overlap_m / 2


@cache
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


def bent(count: int, radius_m: float = 40.0, wave: float = 0.08) -> shapely.Polygon:
    """A field of four corners whose sides bend `count` times each, in and out by turns."""
    corners = [(radius_m, -radius_m), (radius_m, radius_m), (-radius_m, radius_m)]
    corners = [(-radius_m, -radius_m), *corners]
    points = []
    for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
        dx, dy = (bx - ax) / (count + 1), (by - ay) / (count + 1)
        points.append((ax, ay))
        for k in range(1, count + 1):
            out = wave * (1 if k % 2 else -1)
            points.append((ax + k * dx + out * dy, ay + k * dy - out * dx))
    return shapely.Polygon(points)


def ways(plan: Plan, field: shapely.Polygon) -> tuple[float, float]:
    """(cutting, turning) of a plan, m."""
    shown = preview(plan, areas_of(field, 2.0), VEHICLE)
    return shown.cutting_m, shown.turning_m


@pytest.mark.parametrize("count", [1, 4, 9])
def test_an_edge_that_bends_is_one_side(count: int) -> None:
    field = bent(count)
    plan = spiral([(x, y) for x, y in field.exterior.coords[:-1]], 0, VEHICLE, gap_m=2.0)
    first = plan.sides[:4]
    assert [len(side.bends) for side in first] == [count] * 4
    assert not any(b.takes_again(a) for a, b in itertools.pairwise(first))
    cutting, turning = ways(plan, field)
    assert turning < cutting / 4
    assert plan.leftover_m2 < 0.01 * field.area


@pytest.mark.parametrize("askew_deg", [-2.0, -0.1, 0.0, 0.1, 2.0])
def test_from_an_ls_leg_a_shuttle_leads_to_an_edge_that_was_found_a_little_askew(
    askew_deg: float,
) -> None:
    """It is no turn by a fraction of a degree to the left, nor one of nearly 360."""
    y = 7.0 + 8.0 * math.tan(math.radians(askew_deg))
    field = [(0.0, 18.0), (0.0, 0.0), (4.5, 0.0), (4.5, 7.0), (12.5, y), (12.5, 18.0)]
    plan = spiral(field, 0, VEHICLE, gap_m=2.0)
    turns = [math.degrees(plan.corner_rad(k)) for k in range(len(plan.sides) - 1)]
    assert all(turn == 0.0 or 45.0 < turn < 180.0 for turn in turns)
    widening = [
        k for k, (a, b) in enumerate(itertools.pairwise(plan.sides)) if b.length_m > 2 * a.length_m
    ]
    assert any(turns[k] == 0.0 for k in widening), "out of the leg"


@pytest.mark.parametrize("turn_rad", [0.0, 1e-12, -1e-12, 1e-3, math.pi, math.pi - 1e-9])
@pytest.mark.parametrize("ahead_m", [-8.0, 0.2, 8.0])
def test_no_turn_between_strips_that_hardly_cross_is_longer_than_a_field(
    turn_rad: float, ahead_m: float
) -> None:
    """Whether the next begins beside the last, ahead of its end, or back beside it."""
    first = Side(0.0, 0.0, 0.0, 8.0, 0.9, 10.0)
    following = replace(first, x_m=8.0 + ahead_m, y_m=0.9, heading_rad=turn_rad)
    plan = Plan((first, following), "three_point", gap_m=2.0)
    turn = next_turn(plan, 0, VEHICLE, lambda _: 1.0)
    assert sum(leg.length_m for leg in driven(VEHICLE, turn)) < 150.0


@pytest.mark.parametrize("turn_deg", [-50.0, 40.0])
def test_a_corner_that_no_steering_follows_ends_a_side(turn_deg: float) -> None:
    """To the left a turn, to the right an inner corner."""
    turn = math.radians(turn_deg)
    end = (20 + 20 * math.cos(turn), 20 * math.sin(turn))
    ring = shapely.Polygon([(0, 0), (20, 0), end, (end[0], 60), (0, 60)])
    plan = spiral([(x, y) for x, y in ring.exterior.coords[:-1]], 0, VEHICLE, gap_m=2.0)
    assert all(abs(turn) < math.radians(46) for side in plan.sides for _, turn in side.bends)
    assert not any(len(side.bends) == 1 and side.length_m > 39 for side in plan.sides[:2])


@pytest.mark.parametrize("bend_deg", [20.0, 34.0])
def test_a_bent_side_that_has_lost_its_first_piece_is_taken_again(bend_deg: float) -> None:
    """Along what it goes on in; what begins at its end is another edge's."""
    bend = math.radians(bend_deg)
    past = Side(0.0, 0.0, 0.0, 40.0, 1.0, 40.0, bends=((2.0, bend), (20.0, 0.2)))
    x, y, heading = past.pose(3.0, 1.0)
    assert Side(x, y, heading, 37.0, 1.0, 37.0, bends=((17.0, 0.2),)).takes_again(past)
    x, y, heading = past.pose(40.0, 1.0)
    assert not Side(x, y, heading, 10.0, 1.0, 10.0).takes_again(past)


@pytest.mark.parametrize("along_m", [-2.0, 0.0, 5.0, 10.0, 13.0, 25.0])
def test_a_place_on_a_bent_side_lies_on_its_edge(along_m: float) -> None:
    side = Side(1.0, 2.0, 0.5, 20.0, 0.9, 20.0, bends=((6.0, 0.3), (12.0, -0.4)))
    x, y, heading = side.pose(along_m)
    edge = shapely.LineString(side.edge_line())
    assert edge.length == pytest.approx(20.0)
    on = min(max(along_m, 0.0), 20.0)
    assert edge.project(shapely.Point(x, y)) == pytest.approx(on)
    assert edge.distance(shapely.Point(x, y)) == pytest.approx(abs(along_m - on), abs=1e-9)
    left = side.pose(along_m, 1.0)
    assert left[:2] == pytest.approx((x - math.sin(heading), y + math.cos(heading)))


def test_a_field_that_falls_apart_says_what_no_turn_leads_to() -> None:
    """Two squares with a waist between: once the rounds have eaten the waist there are two."""
    field = [(0, 0), (20, 0), (24, 8), (28, 8), (32, 0), (52, 0), (52, 20), (32, 20), (28, 12)]
    field += [(24, 12), (20, 20), (0, 20)]
    plan = spiral([(float(x), float(y)) for x, y in field], 0, VEHICLE, gap_m=2.0)
    apart = sum(shapely.Polygon(part).area for part in plan.parts)
    cut = shapely.union_all(
        [
            shapely.LineString(side.edge_line()).buffer(
                side.width_m, single_sided=True, join_style="mitre"
            )
            for side in plan.sides
        ]
    )
    left = shapely.Polygon(field).difference(cut)
    assert left.area == pytest.approx(apart, abs=0.02 * shapely.Polygon(field).area)


def test_of_a_field_of_many_points_fewer_strips_are_tried_and_each_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each strip takes longer the more corners field and keep-outs have."""
    monkeypatch.setattr("host.route.plan.USUAL_POINTS", 2)
    centres = itertools.product(range(4, 20, 6), repeat=2)
    wells = [[(x, y), (x + 0.5, y), (x + 0.5, y + 0.5), (x, y + 0.5)] for x, y in centres]
    said: list[tuple[int, int]] = []
    square = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)]
    plan = spiral(square, 0, VEHICLE, gap_m=2.0, keep_outs=wells, tell=lambda *so: said.append(so))
    most = MAX_WALKED * 2 // (4 + 9 * 4)
    assert said == [(number, most) for number in range(1, len(said) + 1)]
    assert most < len(said) < most + 2 * len(plan.sides)


def test_a_place_lies_as_far_left_of_an_edge_as_its_distance_says() -> None:
    edge = Edge(((0.0, 0.0), (10.0, 0.0), (20.0, 3.0)), True)
    places = np.array(
        [(5.0, 2.0), (5.0, -2.0), (-50.0, 1.0), (20.0, 3.5), (20.0, 2.5), (60.0, 0.0)]
    )
    depths = edge.depths_of(places)
    assert np.sign(depths).tolist() == [1, -1, 1, 1, -1, -1]
    assert depths[:3] == pytest.approx([2.0, -2.0, 1.0])
    assert abs(depths) == pytest.approx(
        [edge.prolonged(1e4, 1e4).distance(p) for p in shapely.points(places)]
    )
    assert len(edge.depths_of(np.empty((0, 2)))) == 0


ELLS_WITH_A_WELL = [
    (
        [(23.4, -0.8), (24.5, 11.2), (10.8, 12.6), (10.1, 6.4), (2.8, 7.2), (2.1, 1.3)],
        [(15.9, 4.9), (15.5, 5.6), (14.9, 5.2), (15.3, 4.6)],
    ),
    (
        [(10.7, 24.1), (-0.9, 17.3), (6.0, 6.0), (12.5, 9.8), (17.8, 1.2), (22.9, 4.1)],
        [(9.0, 14.7), (8.5, 15.0), (8.3, 14.5), (8.7, 14.2)],
    ),
    (
        [(15.7, 20.0), (0.1, 13.7), (2.7, 6.8), (10.9, 10.0), (15.1, -0.5), (22.5, 2.5)],
        [(12.9, 14.0), (12.5, 14.5), (12.0, 14.1), (12.4, 13.6)],
    ),
]


@cache
def plan_of_an_ell(which: int) -> Plan:
    boundary, well = ELLS_WITH_A_WELL[which]
    return spiral(boundary, 0, VEHICLE, gap_m=2.0, keep_outs=[well])


@pytest.mark.parametrize("which", range(len(ELLS_WITH_A_WELL)))
def test_where_each_way_is_wrong_once_another_choice_leaves_little(which: int) -> None:
    """Each of the ways alone leaves up to two fifths of these, or parts them."""
    plan = plan_of_an_ell(which)
    assert plan.unreached_m2 < 0.015 * plan.area_m2
    boundary, well = ELLS_WITH_A_WELL[which]
    again = spiral(boundary, 0, VEHICLE, gap_m=2.0, keep_outs=[well])
    assert again.otherwise == plan.otherwise != ()


def test_a_plan_laid_out_anew_keeps_the_choices_that_were_made_otherwise() -> None:
    plan = plan_of_an_ell(1)
    found = [(x + 0.2, y - 0.1) for x, y in plan.boundary[:2]] + list(plan.boundary[2:])
    anew = around(plan, found, plan.cut_along(9), VEHICLE)
    assert anew is not None
    assert anew.otherwise == plan.otherwise
    assert anew.unreached_m2 < 0.02 * anew.area_m2
