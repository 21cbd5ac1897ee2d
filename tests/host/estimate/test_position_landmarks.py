"""The boundary's corners as landmarks: what exact small drives teach the position of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from host.core.vehicle import Vehicle
from host.estimate.measurements.end import EARLY_M
from host.estimate.odometry import Motion
from host.estimate.position import Position
from host.estimate.states import CRAB
from host.route.boundary_edges import BoundaryEdges
from host.route.plan import Plan
from host.route.side import Side
from host.runs.resume import remaining
from tests.helpers.places import followed

VEHICLE = Vehicle()
RING = [(0.0, 0.0), (14.0, 0.0), (14.0, 10.0), (0.0, 10.0)]
WIDTH = VEHICLE.pass_m
FIRST, SECOND = map(
    BoundaryEdges(RING).namer(),
    [
        Side(0.0, 0.0, 0.0, 14.0, WIDTH, 14.0),
        Side(14.0, WIDTH, math.pi / 2, 10.0 - WIDTH, WIDTH, 10.0 - WIDTH),
    ],
)
STEP_M = 0.1


class Driven:
    """A position whose machine is driven exactly."""

    def __init__(self, position: Position) -> None:
        self.position = position
        self.distance = self.yaw = 0.0
        position.place(FIRST, 0.0, 0.0, 0.0)
        self._move()

    def _move(self) -> None:
        now = Motion(0.0, 0.5, 0.0, self.distance, self.yaw, 0.0, 0.0)
        self.position.predict(now, cutting=False)

    def on(self, metres: float, *, beside: bool = True) -> None:
        """Straight on; with `beside` exactly on the lane."""
        for k in range(round(metres / STEP_M)):
            self.distance += STEP_M
            self._move()
            if beside and k % 5 == 4:
                followed(self.position, 0.0, 0.02)

    def pivot(self, by_rad: float) -> None:
        self.yaw += by_rad
        self._move()

    def turn_to_second(self, by_rad: float) -> None:
        """From the end of the first side, on the spot where the rear axle meets the next lane, as
        far inside of its edge as it was."""
        beyond = VEHICLE.blade_x_m - VEHICLE.inset_m * math.tan(by_rad / 2)
        self.on(beyond, beside=False)
        self.pivot(by_rad)
        self.position.begin(SECOND)


def found(position: Position) -> np.ndarray:
    return np.array(position.outline.corners)


@pytest.mark.parametrize("longer_m", [-1.0, 0.0, 1.0])
def test_the_end_of_a_side_shows_where_the_corner_lies(longer_m: float) -> None:
    driven = Driven(Position(VEHICLE, RING, 1.0))
    position = driven.position
    before = position.end_sigma_m(FIRST)
    driven.on(14.0 + longer_m - EARLY_M)
    position.at_end(FIRST, 0.0)
    corners = found(position)
    assert math.dist(corners[0], corners[1]) == pytest.approx(14.0 + longer_m, abs=0.1)
    assert before > 1.0
    assert position.end_sigma_m(FIRST) < 0.2
    assert position.at(FIRST).side.length_m == pytest.approx(14.0 + longer_m, abs=0.1)


@pytest.mark.parametrize("again", [False, True])
def test_a_beginning_that_is_met_again_moves_no_corner(again: bool) -> None:
    position = along_second(0.0)
    before = found(position)
    position.less_sure_along(SECOND, 0.1)
    position.at_begin(SECOND, 5.0, again=again)
    assert bool(np.abs(found(position) - before).max() > 1e-3) is not again


@pytest.mark.parametrize("again", [False, True])
def test_what_strip_after_strip_errs_of_a_border_moves_its_corners_no_farther(again: bool) -> None:
    """Each of ten ends is seen 0.3 m late."""
    driven = Driven(Position(VEHICLE, RING, 0.3))
    driven.on(14.0 - EARLY_M)
    position = driven.position
    position.at_end(FIRST, 0.0)
    before, where = found(position)[1], position.pose[0]
    for _ in range(10):
        position.less_sure_along(FIRST, 0.02)
        position.at_end(FIRST, -0.3, again=again)
    moved_m = math.dist(found(position)[1], before)
    assert moved_m < 1e-6 if again else moved_m > 0.05
    assert where - position.pose[0] > 0.1, "the machine is moved all the same"


def along_second(off_rad: float) -> Position:
    """Both sides driven, where the second edge runs off_rad otherwise than planned."""
    driven = Driven(Position(VEHICLE, RING, 1.0))
    driven.on(14.0 - EARLY_M)
    driven.position.at_end(FIRST, 0.0)
    driven.on(EARLY_M, beside=False)
    driven.turn_to_second(math.pi / 2 + off_rad)
    driven.on(6.0)
    return driven.position


@pytest.mark.parametrize("off_deg", [-8.0, -3.0, 3.0, 8.0])
def test_the_second_edges_direction_is_found_by_driving_along_it(off_deg: float) -> None:
    position = along_second(math.radians(off_deg))
    turned = position.outline.heading_rad(1) - position.outline.heading_rad(0)
    assert math.degrees(turned) == pytest.approx(90.0 + off_deg, abs=1.0)


def likeliest_length_m(off_rad: float) -> float:
    """Of the second edge, where the corners have moved least for the first edge to be as long as
    planned and the corner between them off_rad wider."""

    def edges(corners: np.ndarray) -> tuple[float, float, float]:
        ways = np.diff(corners.reshape(4, 2), axis=0)
        one, other = (math.atan2(y, x) for x, y in ways[:2])
        return math.hypot(*ways[0]), other - one, math.hypot(*ways[1])

    ring = np.array(RING).ravel()
    exact = (
        {"type": "eq", "fun": lambda corners: edges(corners)[0] - 14.0},
        {"type": "eq", "fun": lambda corners: edges(corners)[1] - math.pi / 2 - off_rad},
    )
    found = minimize(lambda corners: ((corners - ring) ** 2).sum(), ring, constraints=exact)
    return edges(found.x)[2]


@pytest.mark.parametrize("off_deg", [-8.0, -4.0, 4.0, 8.0])
def test_what_is_seen_beside_the_lane_does_not_tell_how_long_the_edge_is(off_deg: float) -> None:
    """Though the edge has turned since its uncertainty was laid out along it: its length is what
    the boundary that was walked makes likeliest."""
    position = along_second(math.radians(off_deg))
    corners = found(position)
    likeliest = likeliest_length_m(math.radians(off_deg))
    assert math.dist(corners[1], corners[2]) == pytest.approx(likeliest, abs=0.3)
    assert position.end_sigma_m(SECOND) > 1.2


def test_beside_a_border_the_machine_knows_its_place_though_not_in_the_field() -> None:
    driven = Driven(Position(VEHICLE, RING, 1.0))
    position = driven.position
    x, y, _ = position.pose
    near, far = np.array([[x, y]]), np.array([[13.5, 9.0]])
    assert np.sqrt(np.diag(position.covariance)[:2]).min() > 0.9
    assert np.sqrt(np.diag(position.borders.covariance_of(near)[0])).max() < 0.25
    assert np.sqrt(np.diag(position.borders.covariance_of(far)[0])).min() > 0.9
    driven.on(7.0)
    x, y, _ = position.pose
    beside = position.borders.covariance_of(np.array([[x, y]]))[0, 1, 1]
    assert math.sqrt(beside) < 0.25


def test_the_end_is_taken_to_lie_exactly_where_it_is_said_to() -> None:
    position = Driven(Position(VEHICLE, RING, 1.0)).position
    left = FIRST.length_m - position.along(FIRST)
    pose, along = position.pose, position.along(FIRST)
    position.ends_at(FIRST, 15.3, 0.4**2)
    assert position.along(FIRST) == pytest.approx(along, abs=0.05), "nor the side's beginning"
    place = position.at(FIRST)
    assert place.side.length_m - place.blade_m == pytest.approx(left + 1.3, abs=0.02)
    assert position.pose == pose, "the corners give way and not the machine"
    assert position.end_sigma_m(FIRST) == pytest.approx(0.4, abs=0.02)
    eigenvalues = np.linalg.eigvalsh(position.covariance)
    assert eigenvalues.min() > 0.0


def test_a_boundary_that_is_known_is_none_to_be_found() -> None:
    positions = [Position(VEHICLE, RING, 0.0), Position(VEHICLE)]
    for position in positions:
        assert position.outline.states == 0
        driven = Driven(position)
        driven.on(14.0)
        position.at_end(FIRST, 0.0)
        driven.turn_to_second(math.pi / 2)
        driven.on(4.0)
        position.course(0.02, 0.5)
        assert position.course_rad == position.pose[2] + position.x[CRAB]
        assert position.at(FIRST).side is FIRST
    one, other = positions
    assert one.pose == other.pose
    assert np.array_equal(one.covariance, other.covariance)


def test_where_the_boundary_is_to_be_found_courses_are_compared_with_its_own_direction() -> None:
    """A walked boundary may lie some degrees askew of them: that is no error of the machine's."""
    driven = Driven(Position(VEHICLE, RING, 1.0))
    position = driven.position
    turned = position.against_lane()[1]
    for _ in range(200):
        off = math.radians(3) - (position.course_rad - driven.yaw)
        position.course(off, 0.5)
    assert position.course_rad == pytest.approx(math.radians(3), abs=0.01)
    assert position.against_lane()[1] == pytest.approx(turned, abs=0.01)


def test_laid_out_anew_the_corners_lie_where_the_plan_has_them() -> None:
    driven = Driven(Position(VEHICLE, RING, 1.0))
    driven.on(15.0 - EARLY_M)
    position = driven.position
    position.at_end(FIRST, 0.0)
    pose, end_sigma = position.pose, position.end_sigma_m(FIRST)
    corners = position.outline.corners
    astray_m = position.outline.astray_m
    assert astray_m > 0.3
    position.laid_anew(corners, FIRST)
    assert not position.outline.moved_m.any()
    assert position.outline.corners == corners
    position.outline.move(np.full(position.outline.states, 1e-6))
    assert position.outline.astray_m == pytest.approx(astray_m), "it was walked only once"
    assert position.pose == pose
    assert position.end_sigma_m(FIRST) == pytest.approx(end_sigma, rel=0.05)


def test_a_side_taken_up_again_near_its_end_stretches_by_no_more_than_its_end_gives_way() -> None:
    """The machine stands as far past the corner as it had cut, not at a share of an edge."""
    whole = Plan((FIRST, SECOND), boundary=tuple(RING), sigma_m=1.0)
    rest = remaining(whole, 0, 12.8).sides[0]
    position = Position(VEHICLE, RING, 1.0)
    position.place(rest, 0.0, 0.0, 0.0)
    along = position.along(rest)
    assert position.end_sigma_m(rest) == pytest.approx(math.sqrt(2.0), abs=0.05)
    position.ends_at(rest, rest.length_m + 0.5, 0.5**2)
    moved = found(position) - np.array(RING)
    assert moved[1][0] - moved[0][0] == pytest.approx(0.5, abs=0.05)
    assert np.abs(moved).max() < 0.6
    assert position.along(rest) == pytest.approx(along, abs=0.05)
    assert position.outline.found(rest).length_m == pytest.approx(rest.length_m + 0.5, abs=0.05)


def test_before_it_has_a_place_its_corners_are_as_unsure_as_they_were_given() -> None:
    assert Position(VEHICLE, RING, 0.7).corners_sigma_m == 0.7
    assert Position(VEHICLE, RING, 0.0).corners_sigma_m == 0.0
