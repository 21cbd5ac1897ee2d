"""Where the boundary is found to lie, and the sides with it, against plans laid out around it."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from host.core.vehicle import Vehicle
from host.estimate.outline import PARALLEL, STRAIGHT_M, STRAYS_M, Outline
from host.estimate.position import Position
from host.route.boundary_edges import BoundaryEdges
from host.route.plan import spiral
from host.route.side import NO_EDGE, Side

VEHICLE = Vehicle()
STEP_M = 1e-4
"""Of the central differences."""
Ring = list[tuple[float, float]]
Moves = NDArray[np.float64]
RECTANGLE: Ring = [(0.0, 0.0), (14.0, 0.0), (14.0, 10.0), (0.0, 10.0)]
SKEW: Ring = [(0.3, -0.6), (13.2, 0.7), (14.5, 9.4), (-0.8, 10.3)]
BENT: Ring = [(0.0, 0.0), (6.0, -0.8), (12.0, 0.0), (12.0, 9.0), (0.0, 9.0)]

ROUND: Ring = [
    (20.0 * math.cos(k * math.tau / 12), 20.0 * math.sin(k * math.tau / 12)) for k in range(12)
]
"""What bends all along, as it was recorded."""

offsets = st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8).map(
    lambda moves: np.array(moves).reshape(4, 2)
)


@st.composite
def quadrilaterals(draw: st.DrawFn) -> Ring:
    ring = np.array(RECTANGLE) + draw(offsets)
    return [(float(x), float(y)) for x, y in ring]


@cache
def planned(skew: bool) -> tuple[Side, ...]:
    """The first two rounds."""
    return spiral(SKEW if skew else RECTANGLE, 0, VEHICLE).sides[:8]


@cache
def bent() -> Side:
    """The outermost side around corner 1, cut after those that have left its ends."""
    sides = [side for side in spiral(BENT, 0, VEHICLE).sides if side.edges == (0, 1)]
    return min(sides, key=lambda side: side.places_m[0][1])


def moved(ring: Ring, moves: Moves) -> Ring:
    return [(float(x), float(y)) for x, y in np.array(ring) + moves]


def outline_at(ring: Ring, moves: Moves) -> Outline:
    outline = Outline(ring)
    outline.move(moves.ravel())
    return outline


def slope(value: list[float]) -> float:
    return (value[1] - value[0]) / (2 * STEP_M)


def tips(side: Side) -> list[tuple[float, float]]:
    """Where its outer edge begins and ends."""
    along = (side.edge_begin_m, side.length_m - side.edge_end_m)
    return [side.pose(at)[:2] for at in along]


# ---- the derivatives -----------------------------------------------------------------------------


@given(quadrilaterals(), offsets, offsets, st.integers(0, 3))
def test_an_edges_direction_turns_as_its_derivative_says(
    ring: Ring, found: Moves, way: Moves, edge: int
) -> None:
    """Also where the corners were found elsewhere before."""
    derivative = outline_at(ring, found).turning(edge)
    headings = [outline_at(ring, found + sign * STEP_M * way).heading_rad(edge) for sign in (-1, 1)]
    turned = math.remainder(headings[1] - headings[0], math.tau) / (2 * STEP_M)
    assert turned == pytest.approx(float(derivative @ way.ravel()), abs=1e-5)


@given(quadrilaterals(), offsets, offsets, st.integers(0, 3), st.floats(0.0, 1.0))
def test_an_edges_line_moves_aside_as_its_derivative_says(
    ring: Ring, found: Moves, way: Moves, edge: int, share: float
) -> None:
    outline = outline_at(ring, found)
    a, b = (np.array(outline.corners[k % 4]) for k in (edge, edge + 1))
    at = a + share * (b - a)
    c, s = (b - a) / math.dist(a, b)
    left = (-s, c)
    derivative = outline.along(edge, (float(at[0]), float(at[1])), left)
    beside = []
    for sign in (-1, 1):
        e = BoundaryEdges(moved(ring, found + sign * STEP_M * way))
        ec, es = e.directions[edge]
        # How far left of the place the moved line crosses the old line's normal.
        off = es * (at[0] - e.corners[edge][0]) - ec * (at[1] - e.corners[edge][1])
        beside.append(off / (ec * c + es * s))
    assert slope(beside) == pytest.approx(float(derivative @ way.ravel()), abs=1e-5)


def crossing(side: Side, border: int, ring: Ring, inside_m: float) -> float:
    """How far along the line of a side, which stands still, that line crosses the parallel to an
    edge that is inside_m inside it."""
    e = BoundaryEdges(ring)
    (bc, bs), (x0, y0) = e.directions[border], e.corners[border]
    c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
    inside = (side.y_m - y0) * bc - (side.x_m - x0) * bs
    return float((inside_m - inside) / (s * bc - c * bs))


@given(st.booleans(), offsets, st.integers(0, 7), st.sampled_from([-1, 1]))
def test_a_sides_ends_move_with_their_borders_as_the_derivative_says(
    skew: bool, way: Moves, index: int, which: int
) -> None:
    """Of the first round's sides and of the second's, whose ends are parallels to the edges."""
    ring, side = SKEW if skew else RECTANGLE, planned(skew)[index]
    border = side.begins_at if which < 0 else side.ends_at
    outline = Outline(ring)
    derivative = outline.end(side, which)
    x, y = tips(side)[0 if which < 0 else 1]
    e = BoundaryEdges(ring)
    (bc, bs), (x0, y0) = e.directions[border], e.corners[border]
    inside = (y - y0) * bc - (x - x0) * bs
    along = [crossing(side, border, moved(ring, sign * STEP_M * way), inside) for sign in (-1, 1)]
    assert slope(along) == pytest.approx(float(derivative @ way.ravel()), abs=1e-4)


def test_an_end_that_no_edge_has_left_moves_with_its_own_edge() -> None:
    """A side that ends at a keep-out, say."""
    side = Side(0.0, 0.0, 0.0, 6.0, 0.9, 6.0, edges=(0,), places_m=((0.0, 0.0),))
    assert side.ends_at == NO_EDGE
    along = Outline(RECTANGLE).end(side, 1).reshape(4, 2)
    assert along[:, 1] == pytest.approx([0.0] * 4)
    assert along[:, 0] == pytest.approx([8 / 14, 6 / 14, 0.0, 0.0])


# ---- the border nearest to a place ---------------------------------------------------------------


def test_the_border_nearest_to_a_place_moves_with_the_corners_that_it_lies_between() -> None:
    places = np.array([[3.5, 0.4], [13.0, 5.0], [-0.5, -0.5], [7.0, 11.0]])
    found = Outline(RECTANGLE).nearest(places)
    assert found[0] == pytest.approx([0.75, 0.25, 0.0, 0.0])
    assert found[1] == pytest.approx([0.0, 0.5, 0.5, 0.0])
    assert found[2] == pytest.approx([1.0, 0.0, 0.0, 0.0]), "outside of a corner: the corner itself"
    assert found[3] == pytest.approx([0.0, 0.0, 0.5, 0.5])


@given(quadrilaterals(), offsets, st.floats(0.05, 0.95), st.integers(0, 3), st.floats(-1, 1))
def test_a_place_taken_back_lies_to_the_plans_border_as_it_does_to_the_one_found(
    ring: Ring, moves: Moves, share: float, edge: int, left_m: float
) -> None:
    """To the second order in the moves: what the geofence judges a place by."""
    small = 0.05 * moves
    outline = outline_at(ring, small)
    a, b = (np.array(outline.corners[k % 4]) for k in (edge, edge + 1))
    c, s = (b - a) / math.dist(a, b)
    place = a + share * (b - a) + left_m * np.array([-s, c])
    back = place - outline.nearest(place[np.newaxis])[0] @ small
    e = BoundaryEdges(ring)
    (pc, ps), (x0, y0) = e.directions[edge], e.corners[edge]
    assert (back[1] - y0) * pc - (back[0] - x0) * ps == pytest.approx(left_m, abs=2e-3)


# ---- the sides as they lie -----------------------------------------------------------------------


MOVES: Moves = np.array([[0.6, -0.8], [-0.9, 0.5], [0.7, 0.9], [-0.4, -1.0]])


@pytest.mark.parametrize(("share", "most_m"), [(0.3, 0.07), (0.03, 0.0007)])
@pytest.mark.parametrize("skew", [False, True])
def test_a_side_is_found_where_a_plan_around_the_corners_would_have_it(
    skew: bool, share: float, most_m: float
) -> None:
    """Up to what is of the second order in the moves."""
    ring, moves = SKEW if skew else RECTANGLE, share * MOVES
    outline = outline_at(ring, moves)
    true = spiral(moved(ring, moves), 0, VEHICLE).sides[:8]
    for side, laid in zip(planned(skew), true, strict=True):
        for a, b in zip(tips(outline.found(side)), tips(laid), strict=True):
            assert math.dist(a, b) < most_m


def test_nothing_moves_without_a_boundary_or_while_nothing_was_found() -> None:
    assert Outline().states == 0
    for outline in (Outline(), Outline(RECTANGLE)):
        outline.move(np.zeros(outline.states))
        assert all(outline.found(side) is side for side in planned(False))


def test_a_side_of_which_nothing_is_known_stays_where_it_is() -> None:
    outline = outline_at(RECTANGLE, np.ones((4, 2)))
    lonely = Side(0.0, 0.0, 0.0, 6.0, 0.9, 6.0)
    assert outline.found(lonely) is lonely


def test_moves_add_up_and_what_was_found_before_is_forgotten() -> None:
    side = planned(False)[0]
    outline = outline_at(RECTANGLE, np.full((4, 2), 0.2))
    outline.found(side)
    outline.move(np.full(8, 0.3))
    found = outline.found(side)
    assert (found.x_m, found.y_m) == pytest.approx((0.5, 0.5))
    assert outline.corners[0] == pytest.approx((0.5, 0.5))


def test_a_longer_side_has_its_fence_farther_on() -> None:
    side = planned(False)[4]
    out = np.zeros((4, 2))
    out[1:3, 0] = 0.5
    found = outline_at(RECTANGLE, out).found(side)
    assert found.length_m == pytest.approx(side.length_m + 0.5)
    assert found.fence_m == pytest.approx(side.fence_m + 0.5)


@given(
    st.lists(st.floats(-0.3, 0.3), min_size=8, max_size=8),
    st.integers(0, 7),
    st.floats(0.5, 2.0),
    st.floats(0.0, 1.2),
    st.floats(0.0, 1.2),
)
def test_a_short_strip_turns_as_its_edge_does_also_where_it_is_nothing_but_tips(
    moves: list[float], index: int, length_m: float, begin_m: float, end_m: float
) -> None:
    """Found by its ends it lay the other way round, which is where the machine then turned to
    (model fields 10635 and 10646)."""
    whole = planned(True)[index]
    side = replace(whole, length_m=length_m, edge_begin_m=begin_m, edge_end_m=end_m)
    outline = outline_at(SKEW, np.array(moves).reshape(4, 2))
    found = outline.found(side)
    turned = math.remainder(found.heading_rad - side.heading_rad, math.tau)
    before = Outline(SKEW)
    by_edge = outline.heading_rad(side.edge) - before.heading_rad(side.edge)
    short = length_m - begin_m - end_m <= STRAIGHT_M
    assert turned == pytest.approx(math.remainder(by_edge, math.tau), abs=1e-9 if short else 0.4)
    assert found.length_m == pytest.approx(length_m, abs=1.0)
    assert math.dist(found.pose(0.0)[:2], side.pose(0.0)[:2]) < 1.5


# ---- bent sides ----------------------------------------------------------------------------------


@given(st.lists(st.floats(-0.1, 0.1), min_size=10, max_size=10))
def test_a_bent_side_is_found_with_each_of_its_pieces(moves: list[float]) -> None:
    by = np.array(moves).reshape(5, 2)
    outline = outline_at(BENT, by)
    found = outline.found(bent())
    bend = found.pose(found.bends[0][0])[:2]
    assert bend == pytest.approx(outline.corners[1], abs=5e-3)
    turn = outline.heading_rad(1) - outline.heading_rad(0)
    assert found.bends[0][1] == pytest.approx(turn, abs=1e-2)
    for at, edge in ((found.edge_begin_m, 0), (found.length_m - found.edge_end_m, 1)):
        x, y = found.pose(at)[:2]
        c, s = math.cos(outline.heading_rad(edge)), math.sin(outline.heading_rad(edge))
        x0, y0 = outline.corners[edge]
        assert (y - y0) * c - (x - x0) * s == pytest.approx(0.0, abs=1e-2)
    pieces = outline.pieces(bent())
    for (start, piece), (following, _) in itertools.pairwise(pieces):
        assert following == pytest.approx(start + piece.length_m)
    assert found.length_m == pytest.approx(sum(piece.length_m for _, piece in pieces))


@pytest.mark.parametrize("ring", [RECTANGLE, ROUND])
def test_only_an_edge_that_was_recorded_strays_from_its_pieces(ring: Ring) -> None:
    """However many they are."""
    assert Position(VEHICLE, ring, 0.3, True).outline.strays_m == STRAYS_M
    assert Position(VEHICLE, ring, 0.3).outline.strays_m == 0.0, "it was drawn corner by corner"
    assert Position(VEHICLE, ring, 0.0, True).outline.strays_m == 0.0, "it is known exactly"
    position = Position(VEHICLE, ring, 0.3, True)
    position.laid_anew(ring, planned(skew=False)[0])
    assert position.outline.strays_m == STRAYS_M, "laid out anew it still does"


@pytest.mark.parametrize(("askew_deg", "times"), [(90.0, 1.0), (30.0, 2.0), (2.0, 1 / PARALLEL)])
@pytest.mark.parametrize("way", [1, -1])
def test_a_border_that_strays_ends_a_side_the_less_surely_the_shallower_it_is_met(
    way: int, askew_deg: float, times: float
) -> None:
    outline = Outline(ROUND, strays_m=STRAYS_M)
    bend = 0.3
    heading = outline.heading_rad(5) + math.radians(askew_deg) - (bend if way > 0 else 0.0)
    side = Side(0.0, 0.0, heading, 9.0, 1.0, 9.0, bends=((4.0, bend),), edges=(1, 2))
    side = replace(side, ends_at=5) if way > 0 else replace(side, begins_at=5)
    assert outline.end_strays_m(side, way) == pytest.approx(STRAYS_M * times)
    assert outline.end_strays_m(side, -way) == STRAYS_M, "at no border it ends as it was cut"
    straight = Outline(RECTANGLE)
    assert straight.end_strays_m(replace(side, ends_at=2, begins_at=2), way) == 0.0


def test_only_an_edge_that_was_recorded_point_by_point_may_bend() -> None:
    """What others have left lies along none of them."""
    side = Side(0.0, 0.0, 0.0, 20.0, 1.0, 20.0, edges=(0,), places_m=((0.0, 0.0),))
    recorded = Outline(RECTANGLE, strays_m=STRAYS_M)
    assert recorded.bends(side)
    assert not recorded.bends(replace(side, left_over=True))
    assert not Outline(RECTANGLE).bends(side)
