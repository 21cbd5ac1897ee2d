"""What cut lanes tell of what lies beside and across them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from host.core.vehicle import Vehicle
from host.estimate.kalman import Array, Measurement
from host.estimate.lane import Lane
from host.estimate.lanes import LEAST_KEPT, Known, Lanes
from host.estimate.leading_lane import tie
from host.estimate.measurements.begin import begin
from host.estimate.measurements.border import BOUNDARY, Across
from host.estimate.measurements.edge import edge
from host.estimate.measurements.end import end
from host.estimate.measurements.goes_on import to_border
from host.estimate.odometry import Motion
from host.estimate.outline import STRAYS_M, Outline
from host.estimate.position import Position
from host.estimate.states import LANE_OFFSET, LANE_YAW, SIGHT, YAW, X, Y
from host.route.boundary_edges import BoundaryEdges
from host.route.side import Side
from tests.helpers.places import followed

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


COUNT = OUTLINE.at.stop + 2 * LEAST_KEPT
KEPT_AT = range(OUTLINE.at.stop, COUNT, 2)
NOTHING = np.zeros((COUNT, COUNT))


def kept(*cut: tuple[Side, float, float]) -> tuple[Lanes, Array, list[int]]:
    """Lanes of sides that were cut, each so many m and rad off, the state that holds them, and
    where."""
    found, x, at = Lanes(WIDTH, KEPT_AT), np.zeros(COUNT), []
    for side, offset_m, askew_rad in cut:
        at.append(found.keep(side, x, NOTHING))
        x[at[-1] : at[-1] + 2] = offset_m, askew_rad
    return found, x, at


def beyond_m(across: Across, x: Array) -> float:
    assert across.by is not None
    return across.beyond_m + float(across.by @ x)


def offset_m(lane: Known, x: Array) -> float:
    return float(lane.at[0] + lane.by[0] @ x)


@pytest.mark.parametrize(("side", "way", "sign"), [(ACROSS, 1, -1.0), (BACK, -1, 1.0)])
def test_what_was_cut_across_lies_where_its_lane_was_found(
    side: Side, way: int, sign: float
) -> None:
    """A lane that lies 0.3 m inside of its place leaves a side so much shorter, and errs by what
    the lane does."""
    found, x, (at,) = kept((UP, 0.3, 0.0))
    across = found.across(OUTLINE, side, way)
    assert beyond_m(across, x) == pytest.approx(sign * 0.3)
    assert across.by is not None
    assert across.by[at] == pytest.approx(sign)
    assert across.sigma_m == 0.0


def test_a_lane_that_lies_askew_is_met_where_the_side_ends() -> None:
    found, x, _ = kept((UP, 0.0, 0.1))
    across = found.across(OUTLINE, ACROSS, 1)
    assert beyond_m(across, x) == pytest.approx(-0.1 * (INSIDE - WIDTH))


def test_where_no_lane_lies_across_the_border_is_the_fields_own() -> None:
    found, _, _ = kept((UP, 0.3, 0.0))
    assert Lanes(WIDTH, KEPT_AT).across(OUTLINE, ACROSS, 1) == BOUNDARY
    assert found.across(OUTLINE, ACROSS, -1) == BOUNDARY
    assert found.across(Outline(()), ACROSS, 1) == BOUNDARY, "a known boundary"


def test_an_end_at_a_border_that_bends_is_known_no_better_than_the_border() -> None:
    """Recorded point by point: each edge of RING in three pieces."""
    ring = np.array(RING)
    ways = np.roll(ring, -1, axis=0) - ring
    points = np.concatenate([ring + k / 3 * ways for k in range(3)]).reshape(3, 4, 2)
    pieces = [(float(x), float(y)) for x, y in points.transpose(1, 0, 2).reshape(-1, 2)]
    bent = Outline(pieces, strays_m=STRAYS_M)
    of_piece = {0: 2, 1: 3, 2: 6, 3: 9}
    up = replace(UP, edges=(of_piece[1],), places_m=UP.places_m)
    ends = replace(ACROSS, edges=(0,), ends_at=of_piece[1], begins_at=11)
    found, _, _ = kept((up, 0.3, 0.0))
    assert found.across(bent, ends, 1).sigma_m == pytest.approx(STRAYS_M), "that was cut along"
    assert found.across(bent, ends, -1) == Across(0.0, pytest.approx(STRAYS_M))


@pytest.mark.parametrize(("measured", "along_m"), [(begin, 0.0), (end, ACROSS.length_m)])
def test_a_border_that_a_strip_has_left_is_met_where_that_lies(
    measured: Callable[..., Measurement], along_m: float
) -> None:
    """Farther on by so much, less surely, and where it is met tells what pictures show amiss."""
    position = Position(VEHICLE, RING, 1.0)
    position.place(ACROSS, along_m, 0.0, 0.0)
    place = position.at(ACROSS)
    own = measured(place, 0.0, 0.0)
    by = np.zeros(COUNT)
    by[SIGHT] = 2.0
    left = measured(place, 0.0, 0.0, Across(0.3, 0.4, by))
    assert left.innovation[0] - own.innovation[0] == pytest.approx(0.3 + 2.0 * place.x[SIGHT])
    assert left.variances[0] - own.variances[0] > 0.15
    assert left.h[0, SIGHT] == pytest.approx(-2.0)
    assert own.h[0, SIGHT] == 0.0


def test_inside_the_field_no_lane_is_known_as_surely_as_the_boundary() -> None:
    """Of an edge that strips along another edge of the boundary have left."""
    found = Lanes(WIDTH, KEPT_AT)
    at_boundary, inside = (found.beside(side, COUNT) for side in (FIRST, ACROSS))
    assert math.sqrt(at_boundary.noise[0, 0]) < 0.1
    assert math.sqrt(inside.noise[0, 0]) > 0.25


def test_a_strip_along_another_edge_takes_no_lane_from_its_own() -> None:
    """Two edges of the boundary in one line: a strip of the one lies beside the last of the other,
    and takes a part of what that has left."""
    long = NAMED(Side(0.0, 0.0, 0.0, 14.0, WIDTH, 14.0))
    beside = replace(Side(10.0, WIDTH, 0.0, 3.0, WIDTH, 3.0), edges=(long.edge + 1,))
    inner = NAMED(Side(WIDTH, WIDTH, 0.0, 14.0 - 2.0 * WIDTH, WIDTH, 14.0 - WIDTH))
    found, x, _ = kept((long, 0.4, 0.0), (beside, 0.0, 0.0))
    assert offset_m(found.beside(inner, COUNT), x) == pytest.approx(0.4)


def test_of_the_lanes_that_are_kept_those_inside_lie_along_no_border() -> None:
    """Of too many the oldest is kept among the states no more."""
    found, _, at = kept((UP, 0.0, 0.0), (FIRST, 0.0, 0.0), (ACROSS, 0.0, 0.0))
    assert found.inside() == [(UP, at[0]), (ACROSS, at[2])]
    for k in range(LEAST_KEPT - 2):
        found.keep(replace(FIRST, edges=(k + 4,)), np.zeros(COUNT), NOTHING)
    assert found.inside() == [(ACROSS, at[2])]


def rings(position: Position, count: int) -> list[float]:
    """Strip after strip along the first edge, each seen where it is believed; how surely the place
    beside it is known at the end of each."""
    run_m, sigmas = 0.0, []
    for k in range(count):
        side = NAMED(Side(0.0, k * WIDTH, 0.0, 14.0, WIDTH, 14.0))
        side = replace(side, edges=FIRST.edges, places_m=((0.0, k * WIDTH),))
        if k == 0:
            position.place(side, 0.0, 0.0, 0.0)
        position.begin(side, straight=False)
        for _ in range(28):
            run_m += 0.5
            at = Motion(0.0, 0.5, 0.0, run_m, 0.0, run_m, 0.0)
            position.predict(at, cutting=False)
            followed(position, 0.0, 0.02)
        sigmas.append(position.beside_sigma_m(side))
        run_m -= 14.0
        for way_m, yaw in ((run_m, 0.0), (run_m, 1.571), (run_m + WIDTH, 1.571)):
            position.predict(Motion(0.0, 0.5, 0.0, way_m, yaw, way_m, 0.0), cutting=False)
        run_m += WIDTH
        position.predict(Motion(0.0, 0.5, 0.0, run_m, 0.0, run_m, 0.0), cutting=False)
    return sigmas


def test_strip_after_strip_the_place_becomes_no_surer_beside_them() -> None:
    """Each lane lies where the place has put it: the next strip that is cut beside it shows where
    the machine is against that, and nothing of where that is."""
    sigmas = rings(Position(VEHICLE, RING, 0.3), 5)
    assert min(sigmas[1:]) > 0.95 * sigmas[0]


def cut_first(position: Position) -> None:
    """Along FIRST, from its beginning to its end."""
    position.place(FIRST, 0.0, 0.0, 0.0)
    position.begin(FIRST, straight=False)
    for k in range(28):
        at = Motion(0.0, 0.5, 0.0, 0.5 * k, 0.0, 0.5 * k, 0.0)
        position.predict(at, cutting=False)
        followed(position, 0.0, 0.02)


def put_aside(position: Position) -> None:
    """The machine is surely 0.3 m left of where it believed to be."""
    h = np.zeros((1, len(position.x)))
    h[0, Y] = 1.0
    position.fuse(Measurement("put", h, np.array([0.3]), np.array([1e-6])))


def test_where_the_machine_is_found_to_be_elsewhere_the_lanes_that_it_has_cut_are_too() -> None:
    """Seen from the place that was wrong, they are wrong by as much."""
    position = Position(VEHICLE)
    cut_first(position)
    position.begin(replace(FIRST, y_m=WIDTH, places_m=((0.0, WIDTH),)), straight=False)
    put_aside(position)
    assert position.on_lane().lane_at(13.0) == pytest.approx(0.3, abs=0.1)


@pytest.mark.parametrize(("ring", "moves_m"), [(40, 0.3), (4, 0.0)])
def test_the_lanes_along_all_pieces_of_a_ring_that_bends_stay_where_the_machine_is_found(
    ring: int, moves_m: float
) -> None:
    """Forty pieces after it was cut, the first one's lane moves with the machine still. Beside a
    ring of four edges there is no room for so many."""
    turns = [math.tau * k / ring for k in range(ring)]
    position = Position(VEHICLE, [(30.0 * math.cos(t), 30.0 * math.sin(t)) for t in turns])
    cut_first(position)
    for k in range(1, 40):
        places = ((0.0, 3.0 * k),)
        position.begin(replace(FIRST, edges=(k,), y_m=3.0 * k, places_m=places), straight=False)
    put_aside(position)
    position.begin(replace(FIRST, y_m=WIDTH, places_m=((0.0, WIDTH),)), straight=False)
    assert position.on_lane().lane_at(13.0) == pytest.approx(moves_m, abs=0.1)


def test_of_too_many_lanes_the_oldest_is_known_as_well_but_alone() -> None:
    position = Position(VEHICLE)
    sides = [
        replace(FIRST, edges=(k,), y_m=3.0 * k, places_m=((0.0, 3.0 * k),))
        for k in range(LEAST_KEPT + 2)
    ]
    position.place(sides[0], 0.0, 0.0, 0.0)
    position.begin(sides[0])
    for _ in range(5):
        followed(position, 0.1, 0.02)
    known = position.on_lane().lane_at(0.0), position.sigma(np.eye(len(position.x))[LANE_OFFSET])
    for side in sides[1:]:
        position.begin(side)
    inner = replace(sides[0], y_m=WIDTH, places_m=((0.0, WIDTH),))
    position.begin(inner, straight=False)
    alike_m = float(position.x[SIGHT])
    assert position.on_lane().lane_at(0.0) == pytest.approx(known[0] + alike_m, abs=0.001)
    sigma = position.sigma(np.eye(len(position.x))[LANE_OFFSET])
    assert known[1] < sigma < known[1] + 0.1


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
    known, x, _ = kept((UP, 0.05, 0.0))
    assert offset_m(known.beside(beside, COUNT), x) == pytest.approx(0.05)
    left = known.beside(replace(beside, left_over=True), COUNT)
    assert offset_m(left, x) == 0.0
    assert math.sqrt(left.noise[0, 0]) > 0.25


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


RECORDED = [*RING[:3], (12.0, 10.3), (10.0, 10.0), (8.0, 10.3), (6.0, 10.0), (4.0, 10.3), RING[3]]
"""The same with a third edge that bends."""


def test_pictures_along_what_bends_tell_less_of_the_place_beside_it() -> None:
    """The edge is on either side of the straight piece for metres, alike in all pictures there."""
    drawn, recorded = Position(VEHICLE, RECORDED, 0.3), Position(VEHICLE, RECORDED, 0.3, True)
    for position in (drawn, recorded):
        cut_first(position)
    more_m2 = recorded.beside_sigma_m(FIRST) ** 2 - drawn.beside_sigma_m(FIRST) ** 2
    assert more_m2 > 0.08**2
    end_m2 = recorded.sigma(to_border(recorded.at(FIRST), 1)) ** 2
    assert recorded.end_sigma_m(FIRST) ** 2 == pytest.approx(end_m2 + STRAYS_M**2), "nor its end"


def test_a_recorded_boundary_is_turned_against_the_courses_by_less_than_one_that_is_told() -> None:
    """Courses that show the machine askew of where it follows the plan. How many corners it has
    says nothing of that."""
    askew_rad = []
    for is_recorded in (False, True):
        position = Position(VEHICLE, RECORDED, 0.3, is_recorded)
        cut_first(position)
        before = position.course_rad - position.pose[2]
        for _ in range(30):
            position.course(math.radians(4.0), 0.5)
        askew_rad.append(position.course_rad - position.pose[2] - before)
    drawn, recorded = np.degrees(askew_rad)
    assert drawn > 3.0
    assert recorded < 0.5


@pytest.mark.parametrize("recorded", [False, True])
def test_an_edge_that_bends_teaches_nothing_of_the_gyroscope(recorded: bool) -> None:
    """It runs aside as the straight one does for a machine whose gyroscope shows too much."""
    position = Position(VEHICLE, RECORDED, 0.3, recorded)
    position.place(FIRST, 0.0, 0.0, 0.0)
    position.begin(FIRST, straight=False)
    lane = Lane(position, VEHICLE.blade_x_m)
    for k in range(28):
        at = Motion(float(k), 0.5, 0.0, 0.5 * k, 0.0, 0.5 * k, 0.0, gyro_noise=0.002)
        position.predict(at, cutting=False)
        lane.correct(0.0005 * k**2 - lane.blade_offset_m, math.nan, 0.95, (0.0, 0.0))
    offset_radps, _, scale = position.take_gyro()
    assert (offset_radps == scale == 0.0) is recorded
