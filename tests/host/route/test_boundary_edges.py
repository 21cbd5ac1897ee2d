"""Which of the boundary's edges a side belongs to, and plans laid out anew around found corners."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from host.core.errors import UserError
from host.core.vehicle import Vehicle
from host.route.anew import around
from host.route.boundary_edges import BoundaryEdges
from host.route.plan import KEEP_OUT_M, Plan, spiral, strip_by_strip
from host.route.side import NO_EDGE, Side

VEHICLE = Vehicle()
WIDTH = VEHICLE.pass_m
Ring = list[tuple[float, float]]
RECTANGLE: Ring = [(0.0, 0.0), (7.0, 0.0), (7.0, 5.0), (0.0, 5.0)]
MOVED: Ring = [(0.3, -0.4), (7.6, 0.2), (7.1, 5.7), (-0.5, 5.2)]
L_SHAPE: Ring = [(0.0, 0.0), (8.0, 0.0), (8.0, 4.0), (4.0, 4.0), (4.0, 8.0), (0.0, 8.0)]
BENT: Ring = [(0.0, 0.0), (5.0, -0.5), (10.0, 0.0), (10.0, 8.0), (0.0, 8.0)]


@cache
def plan_of(name: str) -> Plan:
    ring = {"rectangle": RECTANGLE, "l": L_SHAPE, "bent": BENT}[name]
    return spiral(ring, 0, VEHICLE)


def turned(ring: Ring, by_rad: float, x_m: float = 0.0, y_m: float = 0.0) -> Ring:
    c, s = math.cos(by_rad), math.sin(by_rad)
    return [(c * x - s * y + x_m, s * x + c * y + y_m) for x, y in ring]


# ---- which edge ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "apart"), [("rectangle", 4), ("l", 1)])
def test_strip_after_strip_along_an_edge_begins_and_ends_at_the_same_borders(
    name: str, apart: int
) -> None:
    """A rectangle's come round by round, an L's first ones by shuttles."""
    sides = plan_of(name).sides
    first, again = sides[0], sides[apart]
    assert again.begins_as(first)
    assert again.ends_as(first)
    other = next(side for side in sides if side.edge != first.edge)
    assert not other.begins_as(first)
    assert not other.ends_as(first)
    unknown = replace(first, begins_at=NO_EDGE, ends_at=NO_EDGE)
    assert not unknown.begins_as(unknown)
    assert not unknown.ends_as(unknown)


def test_a_rectangles_sides_run_along_its_edges_in_turn() -> None:
    sides = plan_of("rectangle").sides
    for k, side in enumerate(sides[:8]):
        assert side.edges == (k % 4,)
        assert (side.begins_at, side.ends_at) == ((k - 1) % 4, (k + 1) % 4)
    assert all(side.edge != NO_EDGE for side in sides)


def test_each_round_lies_a_pass_farther_inside_and_begins_a_pass_later() -> None:
    sides = plan_of("rectangle").sides
    assert sides[0].places_m[0] == pytest.approx((0.0, 0.0), abs=1e-6)
    assert sides[4].places_m[0] == pytest.approx((WIDTH, WIDTH), abs=1e-3)
    assert sides[5].places_m[0] == pytest.approx((2 * WIDTH, WIDTH), abs=1e-3)


def test_shuttles_are_strips_of_one_edge_and_end_at_the_same_borders() -> None:
    """Those that cut an L's arm down to its reflex corner."""
    sides = plan_of("l").sides
    arm = list(itertools.takewhile(lambda side: side.edges == sides[0].edges, sides))
    assert len(arm) > 3
    assert {(side.begins_at, side.ends_at) for side in arm} == {(arm[0].begins_at, arm[0].ends_at)}
    assert NO_EDGE not in (arm[0].begins_at, arm[0].ends_at)
    inside = [side.places_m[0][1] for side in arm]
    assert np.diff(inside) == pytest.approx([arm[0].width_m] * (len(arm) - 1), abs=1e-3)
    after = sides[len(arm)]
    assert after.begins_at == arm[0].edge, "what the shuttles have left is their edge's border"


def test_a_bent_sides_pieces_each_have_their_edge() -> None:
    bent = plan_of("bent").sides[0]
    assert bent.edges == (0, 1)
    assert (bent.begins_at, bent.ends_at) == (4, 2)
    (_, first), (_, last) = bent.pieces()
    assert (first.edges, first.begins_at, first.ends_at) == ((0,), 4, NO_EDGE)
    assert (last.edges, last.begins_at, last.ends_at) == ((1,), NO_EDGE, 2)
    assert first.places_m == bent.places_m[:1]
    assert last.places_m == bent.places_m[1:]


@given(
    st.integers(0, 3),
    st.floats(0.1, 0.9),
    st.floats(0.3, 2.0),
    st.floats(-math.pi, math.pi),
    st.floats(-0.04, 0.04),
)
def test_a_strips_edge_is_found_however_the_field_lies(
    edge: int, share: float, inside_m: float, by_rad: float, askew_rad: float
) -> None:
    e = BoundaryEdges(turned(RECTANGLE, by_rad, 30.0, -20.0))
    (c, s), at = e.directions[edge], e.corners[edge] + share * e.lengths[edge] * e.directions[edge]
    x, y = float(at[0] - s * inside_m), float(at[1] + c * inside_m)
    heading = float(e.headings[edge])
    assert e.beside(x, y, heading + askew_rad) == edge
    assert e.beside(x, y, heading + 0.1) == NO_EDGE, "askew"
    out_x, out_y = float(at[0] + s * 0.3), float(at[1] - c * 0.3)
    assert e.beside(out_x, out_y, heading) == NO_EDGE, "outside"


def test_without_a_boundary_no_side_has_an_edge() -> None:
    side = Side(0.0, 0.0, 0.0, 5.0, WIDTH, 5.0)
    assert BoundaryEdges([]).namer()(side) == side
    assert side.edge == NO_EDGE


def test_what_lies_beside_is_told_by_the_edge_where_plans_were_laid_out_anew() -> None:
    """Two sides of one edge whose directions differ by more than strips do."""
    past = plan_of("rectangle").sides[0]
    askew = replace(plan_of("rectangle").sides[4], heading_rad=math.radians(4))
    assert askew.left_by(past, VEHICLE.blade_width_m)
    assert askew.begins_past(past) == pytest.approx(WIDTH, abs=1e-3)
    other = replace(askew, edges=(2,))
    assert not other.left_by(past, VEHICLE.blade_width_m)


# ---- laid out anew -------------------------------------------------------------------------------


def test_sides_that_were_cut_stay_and_the_rest_lies_around_the_moved_corners() -> None:
    plan = plan_of("rectangle")
    cut = tuple(side.edge for side in plan.sides[:3])
    anew = around(spiral(RECTANGLE, 0, VEHICLE), MOVED, cut, VEHICLE)
    assert anew is not None
    assert tuple(side.edge for side in anew.sides[:3]) == cut
    assert anew.sides[3].edge == 3
    for k, side in enumerate(anew.sides[:3]):
        assert side.pose(side.edge_begin_m)[:2] == pytest.approx(MOVED[k], abs=WIDTH + 0.2)
        way = np.subtract(MOVED[k + 1], MOVED[k])
        assert side.heading_rad == pytest.approx(math.atan2(way[1], way[0]), abs=1e-6)
    left = shapely.Polygon(MOVED)
    for side in anew.sides:
        strip = shapely.LineString(side.edge_line()).buffer(
            side.width_m, single_sided=True, join_style="mitre"
        )
        left = left.difference(strip.buffer(1e-6))
    assert left.area < 0.02 * shapely.Polygon(MOVED).area


@pytest.mark.parametrize("cut", [(0,) * 9, (7,)], ids=["more than it holds", "no such edge"])
def test_strips_that_cannot_have_been_cut_are_refused(cut: tuple[int, ...]) -> None:
    with pytest.raises(UserError, match="strips that were cut"):
        list(strip_by_strip(RECTANGLE, 0, VEHICLE, Plan(), [], cut))


def test_a_plan_laid_out_anew_counts_on_where_the_old_one_was() -> None:
    whole = replace(plan_of("rectangle"), gap_m=2.0, sigma_m=1.0, recorded=True)
    rest = replace(whole, sides=whole.sides[2:], done=2, before=(0, 1))
    anew = around(rest, MOVED, rest.cut_along(2), VEHICLE)
    assert anew is not None
    assert [side.edge for side in anew.sides[:3]] == [2, 3, 0]
    assert (anew.done, anew.before) == (2, (0, 1))
    assert (anew.gap_m, anew.sigma_m, anew.turn) == (2.0, 1.0, rest.turn)
    assert anew.recorded
    assert np.array(anew.boundary) == pytest.approx(np.array(MOVED))
    assert anew.name(1) == f"side 4 of {2 + len(anew.sides)}"


def test_where_no_plan_has_the_sides_that_were_cut_none_is_laid_out() -> None:
    plan = plan_of("rectangle")
    small: Ring = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.5), (0.0, 1.5)]
    crossed: Ring = [RECTANGLE[0], RECTANGLE[2], RECTANGLE[1], RECTANGLE[3]]
    assert around(plan, small, plan.cut_along(10), VEHICLE) is None
    assert around(plan, crossed, plan.cut_along(1), VEHICLE) is None


@pytest.mark.parametrize("by_rad", [0.0, 0.05, -0.08])
def test_keep_outs_move_and_turn_with_the_corners(by_rad: float) -> None:
    ring: Ring = [(0.0, 0.0), (9.0, 0.0), (9.0, 8.0), (0.0, 8.0)]
    well: Ring = [(4.2, 3.7), (4.8, 3.7), (4.8, 4.3), (4.2, 4.3)]
    first = Side(0.0, 0.0, 0.0, 9.0, WIDTH, 9.0, edges=(0,), places_m=((0.0, 0.0),))
    plan = Plan((first,), boundary=tuple(ring), gap_m=2.0, keep_outs=(tuple(well),))
    found = turned(ring, by_rad, 0.7, -0.4)
    anew = around(plan, found, plan.cut_along(1), VEHICLE)
    assert anew is not None
    [out] = anew.keep_outs
    true = shapely.Polygon(turned(well, by_rad, 0.7, -0.4))
    assert shapely.Polygon(out).symmetric_difference(true).area < 1e-6
    away = true.buffer(KEEP_OUT_M - 0.02, join_style="mitre")
    for side in anew.sides:
        strip = shapely.LineString(side.edge_line()).buffer(
            side.width_m - 0.02, single_sided=True, join_style="mitre"
        )
        assert not strip.intersects(away)
