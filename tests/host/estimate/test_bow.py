"""Between the points of a boundary that was recorded the crop's edge is a curve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.vehicle import Vehicle
from host.estimate.lane import Lane
from host.estimate.measurements import edge
from host.estimate.odometry import Motion
from host.estimate.outline import Outline
from host.estimate.place import Place
from host.estimate.position import Position
from host.estimate.states import CORNERS, YAW, X, Y
from host.route.boundary_edges import BoundaryEdges
from host.route.side import NO_EDGE, Side
from tests.helpers.places import followed

VEHICLE = Vehicle()
Ring = Sequence[tuple[float, float]]


def circle(radius_m: float, count: int) -> list[tuple[float, float]]:
    angles = np.arange(count) * math.tau / count
    return [(radius_m * math.cos(a), radius_m * math.sin(a)) for a in angles]


def piece(ring: Ring, edge: int, begin: float = 0.0, end: float = 1.0) -> Side:
    """Of the ring's edge, between two shares of it. Other borders end it where it is not whole."""
    edges = BoundaryEdges(ring)
    length, heading = edges.lengths.item(edge), edges.headings.item(edge)
    x, y = edges.corners[edge] + begin * length * edges.directions[edge]
    borders = {"begins_at": edge - 1 if begin > 0 else NO_EDGE, "ends_at": edge if end < 1 else -1}
    side = Side(x, y, heading, (end - begin) * length, VEHICLE.pass_m, length, **borders)
    return replace(side, edges=(edge,), places_m=((begin * length, 0.0),))


def outline(ring: Ring) -> Outline:
    return Outline(ring, strays_m=0.1)


@pytest.mark.parametrize("radius_m", [8.0, 14.0, 40.0])
def test_points_on_a_circle_are_joined_by_the_circle_and_a_strip_is_led_on_by_it(
    radius_m: float,
) -> None:
    ring = circle(radius_m, 24)
    side = piece(ring, 3)
    for share in np.linspace(-0.5, 1.5, 17).tolist():
        along = share * side.length_m
        left, _ = outline(ring).bow(side, along)
        x, y, _ = side.pose(along, left)
        assert math.hypot(x, y) == pytest.approx(radius_m, abs=1e-3 * radius_m)


@given(
    st.lists(st.floats(-21.0, 21.0), min_size=6, max_size=12),
    st.lists(st.floats(1.5, 6.0), min_size=12, max_size=12),
)
def test_at_a_point_that_is_no_corner_the_edge_runs_on(
    turns_deg: list[float], lengths_m: list[float]
) -> None:
    heading, points = 0.0, [np.zeros(2)]
    for turn, length in zip(turns_deg, lengths_m, strict=False):
        points.append(points[-1] + length * np.array([math.cos(heading), math.sin(heading)]))
        heading += math.radians(turn)
    ring = [(float(x), float(y)) for x, y in points]
    edges, bows = BoundaryEdges(ring), outline(ring)
    for k in range(len(turns_deg) - 1):
        one, after = piece(ring, k), piece(ring, k + 1)
        end, begin = bows.bow(one, one.length_m), bows.bow(after, 0.0)
        assert (end[0], begin[0]) == pytest.approx((0.0, 0.0), abs=1e-9)
        onto = edges.headings[k] + end[1] - edges.headings[k + 1] - begin[1]
        assert math.remainder(onto, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_between_two_corners_it_is_straight() -> None:
    square = [(0.0, 0.0), (9.0, 0.0), (9.0, 7.0), (0.0, 7.0)]
    assert outline(square).bow(piece(square, 1), 3.0) == (0.0, 0.0)


def test_beside_a_corner_it_bends_no_more() -> None:
    """A cubic without curvature where the corner is has half the direction of its other end."""
    ring = [(0.0, 0.0), (5.0, 0.0), (10.0, 1.0), (10.0, 9.0), (0.0, 9.0)]
    bows, side = outline(ring), piece(ring, 0)
    at_corner, at_bend = bows.bow(side, 0.0)[1], bows.bow(side, side.length_m)[1]
    assert at_bend > 0.05
    assert at_corner == pytest.approx(-at_bend / 2)


def test_a_boundary_that_was_entered_corner_by_corner_has_straight_edges() -> None:
    ring = circle(14.0, 24)
    assert Outline(ring).bow(piece(ring, 3), 1.0) == (0.0, 0.0)


@pytest.mark.parametrize(("begin", "end"), [(0.3, 1.0), (0.0, 0.6), (0.2, 0.7)])
def test_a_piece_that_borders_cut_off_bends_as_the_whole_does(begin: float, end: float) -> None:
    ring = circle(14.0, 20)
    bows, whole, part = outline(ring), piece(ring, 4), piece(ring, 4, begin, end)
    for along in np.linspace(0.0, part.length_m, 5).tolist():
        of_whole = bows.bow(whole, begin * whole.length_m + along)
        assert bows.bow(part, along) == pytest.approx(of_whole)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.9])
def test_a_machine_is_led_along_the_curve_and_not_along_its_chord(share: float) -> None:
    ring = circle(12.0, 24)
    side = piece(ring, 5)
    along_m = share * side.length_m
    left_m, slope = outline(ring).bow(side, along_m)
    position = Position(VEHICLE, ring, 0.3, recorded=True)
    aside_m = left_m - VEHICLE.blade_x_m * math.sin(slope)
    position.place(side, along_m, aside_m, math.atan(slope))
    position.begin(side, straight=False)
    lane = Lane(position, VEHICLE.blade_x_m)
    assert (lane.blade_offset_m, lane.heading_rad) == pytest.approx((0.0, 0.0), abs=0.01)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.8])
def test_a_pictures_derivative_is_that_of_the_curve_that_it_expects(share: float) -> None:
    """Held against finite differences: a place farther along an arc has its edge elsewhere."""
    ring = circle(12.0, 24)
    side, count = piece(ring, 5), 2 * len(ring)
    bows = outline(ring)
    along_m = share * side.length_m
    x, y, heading = side.pose(along_m - VEHICLE.blade_x_m, VEHICLE.inset_m)
    state = np.zeros(CORNERS + count)
    state[[X, Y, YAW]] = x, y, heading + 0.05

    def innovation(change: np.ndarray) -> float:
        place = Place(state + change, side, VEHICLE.blade_x_m, VEHICLE.inset_m, bows)
        return float(edge.edge(place, 0.0, math.nan, 1.0, (0.0, 0.0), 0.0).innovation[0])

    at = Place(state, side, VEHICLE.blade_x_m, VEHICLE.inset_m, bows)
    stated = edge.edge(at, 0.0, math.nan, 1.0, (0.0, 0.0), 0.0).h[0]
    assert abs(innovation(np.zeros(len(state)))) > 0.01, "the arc lies beside its chord"
    for k in (X, Y, YAW):
        change = np.zeros(len(state))
        change[k] = 1e-5
        slope = -(innovation(change) - innovation(-change)) / 2e-5
        assert stated[k] == pytest.approx(slope, abs=0.01), k
    # Moved as one with its corners the machine sees what it saw.
    for k, way in ((X, 0), (Y, 1)):
        assert stated[k] + stated[CORNERS + way :: 2].sum() == pytest.approx(0.0, abs=1e-9)


def along_arc(ring: Ring, radius_m: float, farther_m: float) -> tuple[float, float]:
    """(degrees, m): how far right of the truth a machine on a circle believes to head after a
    quarter of it, and how far before its true place to be; it believes at the start to be
    `farther_m` before that. The pictures show it beside its edge all the time."""
    axle_m = math.sqrt(radius_m**2 - VEHICLE.blade_x_m**2) - VEHICLE.inset_m
    behind_rad = math.asin(VEHICLE.blade_x_m / radius_m)
    position = Position(VEHICLE, ring, 0.3, recorded=True)
    sides, at = [piece(ring, k) for k in range(len(ring))], 0
    heading = math.pi / 2 - behind_rad
    leaves = heading - sides[0].heading_rad
    aside_m = -VEHICLE.blade_x_m * math.sin(leaves)
    sigmas = 1.0, 0.1, math.radians(4)
    position.place(sides[0], 0.0, aside_m, leaves, sigmas, 1 / radius_m)
    position.begin(sides[0], straight=False)
    for k in range(250):
        turned_rad = 0.1 * k / axle_m
        position.predict(Motion(0.2 * k, 0.5, 0.0, 0.1 * k, turned_rad, 0.0, 0.0), cutting=False)
        if position.along(sides[at]) > sides[at].length_m:
            at += 1
            position.begin(sides[at], straight=False)
        followed(position, 0.0, 0.02)
        truly = heading + farther_m / radius_m + turned_rad
        if k % 5 == 0:
            position.course(math.remainder(truly - position.pose[2], math.tau), 0.5)
    x, y, _ = position.at(sides[at]).side.pose(position.along(sides[at]))
    before_m = farther_m - radius_m * math.remainder(math.atan2(y, x) - turned_rad, math.tau)
    return math.degrees(truly - position.pose[2]), before_m


def test_who_stands_farther_along_an_arc_is_told_so_by_the_courses() -> None:
    """Every place of a circle shows the same edge. The direction alone tells one from another."""
    ring = circle(14.0, 30)
    assert along_arc(ring, 14.0, 0.0) == (pytest.approx(0.0, abs=1.0), pytest.approx(0.0, abs=0.5))
    assert along_arc(ring, 14.0, 2.5) == (pytest.approx(0.0, abs=1.0), pytest.approx(0.0, abs=0.5))
