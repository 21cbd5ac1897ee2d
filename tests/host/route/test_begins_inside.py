"""Facts about plans of a recorded boundary that begin where its edge goes on, at no corner."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from host.core.frames import LocalFrame
from host.core.vehicle import Vehicle
from host.field.areas import areas_of
from host.field.boundary_file import Boundary
from host.route.anew import around
from host.route.field_plan import plan_of
from host.route.plan import Plan, spiral
from host.route.preview import preview
from host.route.side import NO_EDGE
from host.runs.resume import remaining

VEHICLE = Vehicle()
RADIUS_M = 17.0
POINTS = 30


def circle(radius_m: float = RADIUS_M) -> list[tuple[float, float]]:
    turns = np.arange(POINTS) * math.tau / POINTS
    return [(radius_m * math.cos(t), radius_m * math.sin(t)) for t in turns.tolist()]


def planned(start: int, *, recorded: bool = True) -> Plan:
    return spiral(circle(), start, VEHICLE, gap_m=2.0, recorded=recorded)


ANY_SIDE = spiral([(0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0)], 0, VEHICLE).sides[0]


@pytest.mark.parametrize("start", [0, 7, POINTS - 1])
def test_a_round_field_is_begun_where_its_walk_began_in_standing_crop(start: int) -> None:
    """Before, the owner was sent to another point of the edge, or 4 m back over the gap."""
    plan = planned(start)
    first, place = plan.sides[0], circle()[start]
    assert plan.boundary[plan.begins_inside] == pytest.approx(place)
    assert (first.x_m, first.y_m) == pytest.approx(place)
    assert (first.begins_at, first.begin_seen_m) == (NO_EDGE, 0.0)
    shown = preview(plan, areas_of(shapely.Polygon(plan.boundary), 2.0), VEHICLE)
    assert shown.coverage > 0.998, "what stood behind the machine is cut by the first round's end"


def test_the_first_round_ends_at_no_border_where_the_first_side_began() -> None:
    plan = planned(0)
    outer = [side for side in plan.sides if side.edges and side.inside_m < 0.1]
    x, y, _ = outer[-1].pose(outer[-1].length_m)
    assert math.dist((x, y), circle()[0]) < 0.1
    assert outer[-1].ends_at == NO_EDGE
    assert all(a.ends_at != NO_EDGE for a, _ in itertools.pairwise(outer))


def test_a_field_is_begun_at_its_corner_where_it_has_one_or_was_drawn() -> None:
    square = [(0.0, 0.0), (15.0, 0.0), (20.0, 0.4), (25.0, 0.0), (25.0, 20.0), (0.0, 20.0)]
    assert spiral(square, 0, VEHICLE, gap_m=2.0, recorded=True).begins_inside == NO_EDGE
    assert spiral(square, 2, VEHICLE, gap_m=2.0, recorded=False).begins_inside == NO_EDGE
    assert planned(0, recorded=False).begins_inside == NO_EDGE


@pytest.mark.parametrize("start", [0, POINTS - 1])
def test_the_edge_runs_as_a_circle_through_three_points_does(start: int) -> None:
    askew_rad, bend_1pm = planned(start).begins_along
    assert askew_rad == pytest.approx(-math.pi / POINTS)
    assert bend_1pm == pytest.approx(1 / RADIUS_M, rel=0.01)


@given(
    st.floats(0.0, math.tau), st.floats(0.05, 0.3), st.floats(0.05, 0.3), st.integers(0, POINTS - 1)
)
def test_however_far_apart_the_points_lie(
    begin_rad: float, before_rad: float, behind_rad: float, at: int
) -> None:
    """Along the tangent, which is askew of the next piece by half of what that spans."""
    other = (0.0, 0.0)
    ring = [other] * POINTS
    for k, turn in ((at - 1, -before_rad), (at, 0.0), ((at + 1) % POINTS, behind_rad)):
        angle = begin_rad + turn
        ring[k] = (RADIUS_M * math.cos(angle), RADIUS_M * math.sin(angle))
    side = replace(ANY_SIDE, x_m=ring[at][0], y_m=ring[at][1])
    plan = Plan((side,), boundary=tuple(ring), begins_inside=at)
    askew_rad, bend_1pm = plan.begins_along
    assert askew_rad == pytest.approx(-behind_rad / 2, rel=0.01)
    assert bend_1pm == pytest.approx(1 / RADIUS_M, rel=0.01)


def test_what_was_begun_before_begins_along_nothing() -> None:
    whole = planned(0)
    assert remaining(whole, 0, 3.0).begins_along == (0.0, 0.0)
    assert remaining(whole, 0, 0.0).begins_along == whole.begins_along
    assert remaining(whole, 1, 0.0).begins_along == (0.0, 0.0)


def test_laid_out_anew_it_begins_where_it_began() -> None:
    """Around a boundary that was found a decimetre larger."""
    whole = planned(7)
    grown = [(x * 1.006, y * 1.006) for x, y in whole.boundary]
    anew = around(whole, grown, whole.cut_along(1), VEHICLE)
    assert anew is not None
    assert anew.begins_inside == whole.begins_inside
    assert (anew.sides[0].x_m, anew.sides[0].y_m) == pytest.approx(grown[whole.begins_inside])


def test_the_terminal_takes_the_corner_where_the_walk_began() -> None:
    frame = LocalFrame(31.5, 74.3)
    ring = tuple(frame.to_wgs84(x, y) for x, y in circle())
    field = Boundary(ring, sigma_m=0.3, recorded=True)
    for start in (0, 11):
        frame_of, plan = plan_of(field, start, VEHICLE, "three_point", 2.0)
        place = frame_of.to_wgs84(*plan.boundary[plan.begins_inside])
        assert place == pytest.approx(ring[start], abs=1e-6)


def test_without_a_plan_nothing_is_begun_along_anything() -> None:
    assert Plan().begins_along == (0.0, 0.0)


def test_a_round_closes_where_the_first_side_began_and_nowhere_else() -> None:
    plan = planned(0)
    outer = [side for side in plan.sides if side.edges and side.inside_m < 0.1]
    assert [plan.closes(side) for side in outer] == [False] * (len(outer) - 1) + [True]
    assert not plan.closes(replace(outer[0], ends_at=NO_EDGE)), "at no border, but far from there"
    assert not replace(plan, begins_inside=NO_EDGE).closes(outer[-1])
