"""What cut lanes tell of what lies beside and across them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from host.core.vehicle import Vehicle
from host.estimate.kalman import Measurement
from host.estimate.lane import Lane
from host.estimate.lanes import Lain, Lanes
from host.estimate.leading_lane import tie
from host.estimate.measurements.begin import begin
from host.estimate.measurements.border import BOUNDARY, Across
from host.estimate.measurements.edge import edge
from host.estimate.measurements.end import end
from host.estimate.odometry import Motion
from host.estimate.outline import Outline
from host.estimate.position import Position
from host.estimate.states import LANE_YAW, SIGHT, YAW, X, Y
from host.route.boundary_edges import BoundaryEdges
from host.route.side import Side

VEHICLE = Vehicle()
WIDTH = VEHICLE.pass_m
RING = [(0.0, 0.0), (14.0, 0.0), (14.0, 10.0), (0.0, 10.0)]
OUTLINE = Outline(RING)
NAMED = BoundaryEdges(RING).namer()
INSIDE = 2.0 * WIDTH
UP = NAMED(Side(14.0 - WIDTH, WIDTH, math.pi / 2, 10.0 - INSIDE, WIDTH, 10.0 - WIDTH))
"""The second strip along the second edge."""
ACROSS = NAMED(Side(WIDTH, INSIDE, 0.0, 14.0 - 3.0 * WIDTH, WIDTH, 14.0 - WIDTH))
"""The third along the first: it ends where UP was cut."""
FIRST = NAMED(Side(0.0, 0.0, 0.0, 14.0, 0.9, 14.0))
"""The first along it."""
BACK = NAMED(Side(14.0 - INSIDE, 10.0 - WIDTH, math.pi, 14.0 - 3.0 * WIDTH, WIDTH, 14.0))
"""Along the third: it begins there."""


def lanes(offset_m: float, askew_rad: float, *, seen_beside: float = 2.0) -> Lanes:
    found = Lanes(WIDTH)
    covariance = np.diag([0.04, 0.0])
    lane = np.array([offset_m, askew_rad])
    found.keep(Lain(UP, lane, 0.0, np.array([seen_beside, 0.0]), covariance))
    return found


@pytest.mark.parametrize(("side", "way", "sign"), [(ACROSS, 1, -1.0), (BACK, -1, 1.0)])
def test_what_was_cut_across_lies_where_its_lane_was_found(
    side: Side, way: int, sign: float
) -> None:
    """A lane that lies 0.3 m inside of its place leaves a side so much shorter, as surely as it is
    known; what pictures show amiss counts once for each strip from the boundary."""
    across = lanes(0.3, 0.0).across(OUTLINE, side, way, 0.05)
    assert across.beyond_m == pytest.approx(sign * (0.3 + 2.0 * 0.05))
    assert across.sigma_m == pytest.approx(0.2)
    assert across.by_sight == pytest.approx(sign * 2.0)


def test_a_lane_that_lies_askew_is_met_where_the_side_ends() -> None:
    across = lanes(0.0, 0.1).across(OUTLINE, ACROSS, 1, 0.0)
    assert across.beyond_m == pytest.approx(-0.1 * (INSIDE - WIDTH))


def test_where_no_lane_lies_across_the_border_is_the_fields_own() -> None:
    assert Lanes(WIDTH).across(OUTLINE, ACROSS, 1, 0.0) == BOUNDARY
    assert lanes(0.3, 0.0).across(OUTLINE, ACROSS, -1, 0.0) == BOUNDARY
    assert lanes(0.3, 0.0).across(Outline(()), ACROSS, 1, 0.0) == BOUNDARY, "a known boundary"


@pytest.mark.parametrize(("measured", "along_m"), [(begin, 0.0), (end, ACROSS.length_m)])
def test_a_border_that_a_strip_has_left_is_met_where_that_lies(
    measured: Callable[..., Measurement], along_m: float
) -> None:
    """Farther on by so much, less surely, and where it is met tells what pictures show amiss."""
    position = Position(VEHICLE, RING, 1.0)
    position.place(ACROSS, along_m, 0.0, 0.0)
    place = position.at(ACROSS)
    own = measured(place, 0.0, 0.0)
    left = measured(place, 0.0, 0.0, Across(0.3, 0.4, 2.0))
    assert left.innovation[0] - own.innovation[0] == pytest.approx(0.3)
    assert left.variances[0] - own.variances[0] > 0.15
    more = measured(place, 0.0, 0.0, Across(0.3 + 2.0 * 0.1, 0.4, 2.0))
    by_sight = (more.innovation[0] - left.innovation[0]) / 0.1
    assert left.h[0, SIGHT] == pytest.approx(-by_sight)
    assert own.h[0, SIGHT] == 0.0


def test_inside_the_field_no_lane_is_known_as_surely_as_the_boundary() -> None:
    """Of an edge that strips along another edge of the boundary have left."""
    found = Lanes(WIDTH)
    at_boundary, inside = (found.beside(side, 0.0) for side in (FIRST, ACROSS))
    assert math.sqrt(at_boundary.p[0, 0]) < 0.1
    assert math.sqrt(inside.p[0, 0]) > 0.25


def test_a_strip_along_another_edge_takes_no_lane_from_its_own() -> None:
    """Two edges of the boundary in one line: a strip of the one lies beside the last of the other,
    and takes a part of what that has left."""
    known = np.array([0.4, 0.0])
    long = NAMED(Side(0.0, 0.0, 0.0, 14.0, WIDTH, 14.0))
    beside = replace(Side(10.0, WIDTH, 0.0, 3.0, WIDTH, 3.0), edges=(long.edge + 1,))
    inner = NAMED(Side(WIDTH, WIDTH, 0.0, 14.0 - 2.0 * WIDTH, WIDTH, 14.0 - WIDTH))
    found = Lanes(WIDTH)
    found.keep(Lain(long, known, 0.0, np.zeros(2), np.diag([0.04, 0.0])))
    found.keep(Lain(beside, np.zeros(2), 0.0, np.zeros(2), np.diag([1e-4, 0.0])))
    assert found.beside(inner, 0.0).x[0] == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("inside_m", "straight", "trimmed"),
    [(4.0, True, True), (4.0, False, False), (0.0, True, False)],
)
def test_a_first_crop_that_the_turn_has_trimmed_turns_no_machine(
    inside_m: float, straight: bool, trimmed: bool
) -> None:
    """Pictures on the way to it all show it a third of a metre aside: the machine is led there, and
    knows place and direction as before. The boundary is as it was sown, and before a bend of the
    same strip there was no turn."""
    side = Side(0.0, 0.0, 0.0, 12.0, WIDTH, 12.0, places_m=((0.0, inside_m),))
    position = Position(VEHICLE)
    past = replace(side, y_m=-WIDTH, places_m=((0.0, inside_m - WIDTH),))
    position.place(past, -2.0, WIDTH, 0.0)
    position.begin(side, straight=straight)
    at = Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    lane, before = Lane(position, VEHICLE.blade_x_m), position.pose
    for k in range(40):
        at = replace(at, stamp=0.1 * k, distance_m=0.03 * k)
        position.predict(at, cutting=False)
        lane.correct(-0.3, math.nan, 0.95, (0.0, 0.0), ahead_m=1.2 - 0.03 * k, cutting=False)
    assert lane.blade_offset_m == pytest.approx(0.3, abs=0.06)
    aside_m, turned_rad = position.pose[1] - before[1], position.pose[2] - before[2]
    assert (aside_m < 0.1) is trimmed
    assert (math.degrees(turned_rad) < 1.5) is trimmed


def test_of_what_strips_have_left_no_lane_is_known_whatever_was_cut_beside_it() -> None:
    beside = NAMED(Side(14.0 - INSIDE, INSIDE, math.pi / 2, 6.0, WIDTH, 8.0))
    known = lanes(0.05, 0.0)
    assert known.beside(beside, 0.0).x[0] == pytest.approx(0.05)
    left = known.beside(replace(beside, left_over=True), 0.0)
    assert left.x[0] == 0.0
    assert math.sqrt(left.p[0, 0]) > 0.25


@pytest.mark.parametrize("left_over", [False, True])
def test_an_edge_of_what_strips_have_left_leads_the_machine_and_moves_neither_place_nor_border(
    left_over: bool,
) -> None:
    """Learnt from, the borders moved by 2 m while the machine gathered, and the machine's way with
    them, into the neighbour's crop (model field 11057)."""
    position = Position(VEHICLE, RING, 0.3)
    position.place(ACROSS, 2.0, 0.0, 0.0, (0.1, 0.1, 0.02))
    position.begin(replace(ACROSS, left_over=left_over))
    place, corners = np.array(position.pose), np.array(position.outline.corners)
    expected_m = edge(position.on_lane(), 0.1, math.nan, 0.9, (0.0, 0.0), 0.0).innovation[0]
    for bound in (False, True):
        seen = edge(position.on_lane(), 0.1, math.nan, 0.9, (0.0, 0.0), 0.0)
        if bound:
            position.lies_right(seen)
        else:
            position.see_edge(seen, learn=False)
    moved = np.abs(np.array(position.pose) - place).max()
    borders = np.abs(np.array(position.outline.corners) - corners).max()
    assert bool(max(moved, borders) == 0.0) is left_over
    still_m = edge(position.on_lane(), 0.1, math.nan, 0.9, (0.0, 0.0), 0.0).innovation[0]
    assert abs(still_m) < 0.5 * abs(expected_m)


@pytest.mark.parametrize(("along", "moves"), [(FIRST, True), (ACROSS, False)])
def test_crop_on_the_right_inside_the_field_tells_of_the_lane_alone(
    along: Side, moves: bool
) -> None:
    """Others may have left it there: taken for what lies inside of the edge, it moved a machine by
    five metres in four strips, and that to the neighbour's crop (model field 11364). Along the
    boundary nothing else stands there."""
    position = Position(VEHICLE, RING, 0.3)
    position.place(along, 2.0, 0.0, 0.0, (0.1, 0.3, 0.02))
    position.begin(along)
    lane, place = Lane(position, VEHICLE.blade_x_m), np.array(position.pose)
    for _ in range(5):
        assert lane.lies_right(-0.5, (0.0, 0.0))
    assert lane.blade_offset_m > 0.3, "it moves aside"
    assert bool(np.abs(np.array(position.pose) - place).max() > 0.0) is moves


def gathered(place_sigma_m: float) -> Position:
    """On a strip that others have left, by a place that is no surer than that across it."""
    position = Position(VEHICLE, RING, 0.3)
    position.place(ACROSS, 2.0, 0.0, 0.0, (0.1, place_sigma_m, 0.02))
    position.begin(replace(ACROSS, left_over=True))
    return position


def test_a_lane_that_only_leads_takes_all_of_the_edge_that_pictures_show() -> None:
    """Known in the field, it took a quarter of it, and the machine looked for its edge until it
    gave up, with sure pictures of it all the time (model field 11288)."""
    position = gathered(0.6)
    lane = Lane(position, VEHICLE.blade_x_m)
    assert lane.offset_sigma_m > 0.5
    for _ in range(3):
        assert lane.correct(0.4, math.nan, 0.95, (0.0, 0.0), learn=False)
    assert lane.blade_offset_m == pytest.approx(-0.4, abs=0.03)
    assert lane.offset_sigma_m < 0.1


@pytest.mark.parametrize("seen", [False, True])
def test_tied_to_the_machine_a_lane_is_as_sure_as_before(seen: bool) -> None:
    """What is believed of it against the machine stays, whatever is found of the machine's place
    later: a border that was met moves both."""
    position = gathered(0.6)
    lane = Lane(position, VEHICLE.blade_x_m)
    if seen:
        lane.correct(0.1, math.nan, 0.95, (0.0, 0.0), learn=False)
    covariance, place = position.borders.p.copy(), position.on_lane()
    h = place.ahead(VEHICLE.blade_x_m, place.blade_m)
    turned = place.turned()
    turned[LANE_YAW] = -1.0
    before = h @ covariance @ h, turned @ covariance @ turned, h @ covariance @ turned
    tie(covariance, place)
    after = h @ covariance @ h, turned @ covariance @ turned, h @ covariance @ turned
    assert after == pytest.approx(before)
    assert (covariance @ h)[[X, Y, YAW]] == pytest.approx(0.0, abs=1e-12), "its errors are its own"
    assert np.allclose(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12
