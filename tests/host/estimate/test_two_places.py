"""A filter that keeps two meanings apart until measurements have decided, and a position that may
be at two places."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.vehicle import Vehicle
from host.estimate import states as states_of
from host.estimate.borders import Borders
from host.estimate.kalman import FORGOTTEN, LIKELIER, SAYS_MOST, Filter, Measurement
from host.estimate.measurements.rest import rest
from host.estimate.odometry import Motion
from host.estimate.outline import Outline
from host.estimate.position import WRONG_PLACE, Position
from host.route.plan import Plan, spiral
from host.route.side import Side
from tests.helpers.places import followed

VEHICLE = Vehicle()
RING = [(0.0, 0.0), (14.0, 0.0), (14.0, 10.0), (0.0, 10.0)]
SIGMA_M = 0.3
ALONG = np.array([1.0, 0.0])


class Two(Filter):
    """Of two numbers, of which the first is measured; shows what it holds."""

    def __init__(self) -> None:
        super().__init__(np.zeros(2), np.diag([SIGMA_M**2, 1.0]))

    @property
    def here(self) -> float:
        return float(self._x[0])

    @property
    def there(self) -> float:
        return float(self._x[0] + self._apart[0])

    @property
    def own_sigma(self) -> float:
        return math.sqrt(self._p[0, 0])

    @property
    def other_sigma(self) -> float:
        return math.sqrt(self._other_p[0, 0])


def border(at: float, one: Two | None = None) -> Measurement:
    """A border 0.25 m unsure is met where the first number should be `at`."""
    off = at - (one.here if one is not None else 0.0)
    h = ALONG[np.newaxis]
    return Measurement("end", h, np.array([off]), np.array([0.25**2]), other=(0.12, 1.0))


def picture(at: float, one: Two, sigma: float = 0.1, gate: float = 9.0) -> Measurement:
    off = np.array([at - one.here])
    return Measurement("edge", ALONG[np.newaxis], off, np.array([sigma**2]), gate)


def two(at: float = 1.2) -> Two:
    """Of which a border may be one or none."""
    one = Two()
    assert one.fuse(border(at))
    assert one.likely > 0.0
    return one


def test_a_border_that_may_be_none_leaves_two_places_and_each_as_sure_as_it_would_be() -> None:
    one, taken, not_taken = two(), Two(), Two()
    taken.fuse(Measurement("end", ALONG[np.newaxis], np.array([1.2]), np.array([0.25**2])))
    not_taken.fuse(Measurement("end", ALONG[np.newaxis], np.array([1.2]), np.array([1.0625])))
    expected = {round(taken.here, 6), round(not_taken.here, 6)}
    assert {round(one.here, 6), round(one.there, 6)} == expected
    assert min(one.own_sigma, not_taken.own_sigma) <= one.own_sigma <= not_taken.own_sigma + 1e-9


def test_near_by_or_impossible_there_is_one_place() -> None:
    for at in (0.0, 0.3, 0.6, 4.0):
        one = Two()
        one.fuse(border(at))
        assert one.likely == 0.0
    assert abs(one.here) < 0.4


@pytest.mark.parametrize("true_m", [0.0, 1.2])
def test_the_next_borders_decide_between_them(true_m: float) -> None:
    one = two()
    for _ in range(3):
        one.fuse(border(true_m, one))
    assert one.likely < 0.05
    assert one.here == pytest.approx(true_m, abs=0.25)


@pytest.mark.parametrize("true_m", [0.0, 1.2])
def test_pictures_decide_too_but_each_says_little(true_m: float) -> None:
    one = two()
    odds = math.log(one.likely / (1.0 - one.likely))
    is_there = abs(one.there - true_m) < abs(one.here - true_m)
    one.fuse(picture(true_m, one))
    grown = math.log(one.likely / (1.0 - one.likely)) - odds
    assert grown == pytest.approx(SAYS_MOST if is_there else -SAYS_MOST)
    for _ in range(12):
        one.fuse(picture(true_m, one))
    assert one.here == pytest.approx(true_m, abs=0.2)
    assert one.likely < 2 * FORGOTTEN


def test_what_neither_expects_changes_neither() -> None:
    one = two()
    before = one.here, one.there
    assert not one.fuse(picture(9.0, one))
    assert (one.here, one.there) == pytest.approx(before)


def test_the_likelier_is_taken_for_the_state_and_the_other_kept() -> None:
    one = two()
    here, there, other_sigma = one.here, one.there, one.other_sigma
    assert other_sigma != one.own_sigma
    one.heed(math.log(LIKELIER / (1 - LIKELIER) * (1 - one.likely) / one.likely) - 0.01, 9.0)
    assert one.here == here, "not at once"
    one.heed(0.02)
    assert (one.here, one.there) == pytest.approx((there, here))
    assert one.likely == pytest.approx(1.0 - LIKELIER, abs=0.01)
    assert one.own_sigma == other_sigma


def test_together_they_are_as_unsure_as_both_and_how_far_apart_they_are() -> None:
    one = two()
    apart, likely = one.there - one.here, one.likely
    about_here = one.sigma(ALONG)
    assert about_here > math.sqrt(likely) * abs(apart)
    mean = one.here + likely * apart
    one.merge()
    assert one.likely == 0.0
    assert one.here == pytest.approx(mean)
    # The same spread, about the mean.
    assert one.sigma(ALONG) ** 2 + (likely * apart) ** 2 == pytest.approx(about_here**2)
    assert one.own_sigma == pytest.approx(one.sigma(ALONG))


@given(st.lists(st.floats(-3.0, 3.0), max_size=12), st.booleans())
def test_the_probability_is_one_and_no_variance_negative(seen: list[float], pictures: bool) -> None:
    one = two()
    for at in seen:
        one.fuse(picture(at, one) if pictures else border(at, one))
        assert one.likely == 0.0 or FORGOTTEN <= one.likely <= LIKELIER
        assert 0.0 < one.own_sigma <= one.sigma(ALONG) + 1e-9 or one.likely > 0.0


# ---- the position --------------------------------------------------------------------------------


def plan(sigma_m: float = 0.0) -> Plan:
    return spiral(RING, 0, VEHICLE, gap_m=2.0, sigma_m=sigma_m)


class Drive:
    """A machine that drives exactly where it believes to, along the first side."""

    def __init__(self, along_m: float, sigma_m: float = 0.0) -> None:
        self.plan = plan(sigma_m)
        self.position = Position(VEHICLE, self.plan.boundary, sigma_m)
        self.position.place(self.side, 0.0, 0.0, 0.0)
        self.distance_m = self.yaw_rad = 0.0
        self.move(0.0)
        self.on(along_m)

    @property
    def side(self) -> Side:
        return self.plan.sides[0]

    def move(self, by_m: float, turn_rad: float = 0.0) -> None:
        self.distance_m += by_m
        self.yaw_rad += turn_rad
        motion = Motion(0.0, 0.5, 0.0, self.distance_m, self.yaw_rad, 0.0, 0.0)
        self.position.predict(motion, cutting=False)

    def on(self, metres: float) -> None:
        for _ in range(round(metres / 0.1)):
            self.move(0.1)
            followed(self.position, 0.0, 0.02)

    def ends_early(self, by_m: float) -> None:
        """A look finds the side's end where the machine stands, so far before it."""
        self.position.at_end(self.side, 0.0, 0.0, 0.35, by_m)

    def places(self) -> list[tuple[float, float]]:
        return [borders.pose[:2] for borders in self.position.all_borders]


def found_early(by_m: float = 2.0) -> Drive:
    drive = Drive(14.0 - by_m)
    drive.ends_early(by_m)
    return drive


def test_an_end_found_where_none_is_believed_leaves_the_place_and_one_at_the_end() -> None:
    drive = found_early()
    (x, y), (x_other, y_other) = drive.places()
    assert drive.position.likely == pytest.approx(WRONG_PLACE)
    assert x == pytest.approx(12.0 - VEHICLE.blade_x_m, abs=0.2)
    assert x_other == pytest.approx(14.0 - VEHICLE.blade_x_m, abs=0.3)
    assert y_other == pytest.approx(y, abs=0.02)


def test_both_places_go_on_as_the_machine_does() -> None:
    drive = found_early()
    before = np.diff(drive.places(), axis=0)[0]
    drive.move(1.0)
    drive.move(0.0, math.pi / 2)
    drive.move(2.0)
    assert np.diff(drive.places(), axis=0)[0] == pytest.approx(before, abs=0.02)
    (x, y), _ = drive.places()
    assert (x, y) == pytest.approx((13.0 - VEHICLE.blade_x_m, VEHICLE.inset_m + 2.0), abs=0.2)


def apart(drive: Drive, **states: float) -> Position:
    """It may also be elsewhere, by so much of each of these states."""
    position = drive.position
    by = np.zeros(len(position.x))
    for name, value in states.items():
        by[getattr(states_of, name)] = value
    more = 0.5 * np.eye(len(by))
    position.keep_apart(by, more @ more, 0.4)
    return position


def test_the_other_place_moves_by_its_own_direction_and_grows_as_unsure() -> None:
    drive = Drive(5.0)
    position = apart(drive, X=1.0, YAW=0.1)
    before = position.all_borders[1].p[0, 0]
    drive.move(2.0)
    (x, y), (x_other, y_other) = drive.places()
    assert y_other - y == pytest.approx(2.0 * math.sin(0.1), abs=1e-3)
    assert x_other - x == pytest.approx(1.0 + 2.0 * (math.cos(0.1) - 1.0), abs=1e-3)
    assert position.all_borders[1].p[0, 0] > before


def test_of_a_new_lane_both_places_know_the_same() -> None:
    drive = Drive(5.0)
    position = apart(drive, X=1.0, LANE_OFFSET=0.4, WANDER=0.1)
    position.begin(drive.plan.sides[1])
    here, there = position.all_borders
    lane = [states_of.LANE_OFFSET, states_of.LANE_YAW, states_of.WANDER]
    assert there.x[lane] == pytest.approx(here.x[lane])
    assert there.p[states_of.WANDER, states_of.WANDER] == here.p[states_of.WANDER, states_of.WANDER]


def test_an_end_that_is_put_elsewhere_is_there_for_both_places() -> None:
    """By how far before the blade it lies."""
    drive = Drive(12.0, sigma_m=0.5)
    position = apart(drive, X=1.0)
    position.ends_at(drive.side, 13.0, 0.01)
    here, there = position.all_borders
    place = np.array([[14.0, 0.5]])
    (end,), (other,) = (borders.against(np.zeros((1, 2)), place)[1] for borders in (here, there))
    assert 14.0 + end[0] - here.pose[0] == pytest.approx(14.0 + other[0] - there.pose[0], abs=0.05)


def test_where_an_edge_turns_what_lies_between_the_places_turns_with_it() -> None:
    drive = Drive(2.0, sigma_m=1.0)
    position = apart(drive, X=1.0)
    corner = np.zeros((1, len(position.x)))
    corner[0, states_of.CORNERS + 3] = 1.0  # the second one's y: it turns the first edge
    position.fuse(Measurement("corner", corner, np.array([1.4]), np.array([1e-6])))
    before = np.diff(drive.places(), axis=0)[0]
    position.take(rest(position.x, 0.0, 1.0))
    after = np.diff(drive.places(), axis=0)[0]
    turned_rad = position.outline.heading_rad(0)
    assert turned_rad > 0.05
    c, s = math.cos(turned_rad), math.sin(turned_rad)
    assert after == pytest.approx(np.array([[c, -s], [s, c]]) @ before, abs=1e-6)


def turned(drive: Drive, true_m: float) -> Drive:
    """Onto the second side, whose edge is seen from where the machine really is."""
    position, second = drive.position, drive.plan.sides[1]
    drive.move(1.0)
    drive.move(0.0, math.pi / 2)
    position.begin(second)
    x = drive.places()[0][0] + true_m
    for _ in range(15):
        drive.move(0.1)
        left_m = position.at(second).across_m + drive.places()[0][0] - x
        followed(position, left_m, 0.02)
    return drive


@pytest.mark.parametrize("wrong_place", [False, True])
def test_the_next_sides_edge_tells_which_it_is(wrong_place: bool) -> None:
    drive = found_early()
    (x, _), (x_other, _) = drive.places()
    turned(drive, x_other - x if wrong_place else 0.0)
    expected = (x_other if wrong_place else x) + 1.0
    assert drive.places()[0][0] == pytest.approx(expected, abs=0.3)
    assert drive.position.likely < 0.1


def test_crop_at_the_blade_tells_against_a_place_at_the_end() -> None:
    drive = found_early()
    before = drive.position.likely
    drive.move(0.5)
    drive.position.crop_at(drive.side, 0.0)
    assert drive.position.likely == pytest.approx(
        before * math.exp(-SAYS_MOST) / (1 - before + before * math.exp(-SAYS_MOST))
    )
    for _ in range(10):
        drive.position.crop_at(drive.side, 0.0)
    assert drive.position.likely == 0.0


def test_crop_that_stood_before_the_end_of_either_place_tells_nothing() -> None:
    drive = found_early()
    before = drive.position.likely
    drive.move(0.5)
    drive.position.crop_at(drive.side, 1.5)
    assert drive.position.likely == pytest.approx(before, abs=0.01)


@pytest.mark.parametrize("ago_m", [0.0, -2.0])
def test_an_end_that_surely_was_one_leaves_the_place_from_which_it_lies_there(ago_m: float) -> None:
    """Met where the machine stands, or two metres before it."""
    drive = found_early()
    drive.position.ended(drive.side, ago_m)
    assert drive.position.likely == 0.0
    (x, _), *others = drive.places()
    assert not others
    assert x == pytest.approx(14.0 + ago_m - VEHICLE.blade_x_m, abs=0.3)


def test_at_one_place_an_end_that_was_one_moves_nothing() -> None:
    drive = Drive(12.0)
    before = drive.places()
    drive.position.ended(drive.side, 0.0)
    assert drive.places() == before


def test_two_places_that_have_come_together_are_one() -> None:
    assert found_early(0.2).position.likely == 0.0
    drive = found_early()
    wide = drive.position.end_sigma_m(drive.side)
    drive.position.less_sure_along(drive.side, 2.0)
    drive.position.crop_at(drive.side, 0.0)
    assert drive.position.likely == 0.0, "nothing tells them apart any more"
    assert drive.position.end_sigma_m(drive.side) > wide


def test_put_down_anew_it_is_at_one_place() -> None:
    drive = found_early()
    drive.position.place(drive.side, 3.0, 0.0, 0.0)
    assert len(drive.position.all_borders) == 1


def test_how_far_the_end_is_is_as_unsure_as_both_places() -> None:
    drive = found_early()
    (x, _), (x_other, _) = drive.places()
    expected = math.sqrt(WRONG_PLACE) * abs(x_other - x)
    assert drive.position.end_sigma_m(drive.side) > expected
    assert math.sqrt(drive.position.covariance[0, 0]) > expected
    assert drive.position.beside_sigma_m(drive.side) < 0.15


def test_where_corners_are_found_the_other_place_has_corners_of_its_own() -> None:
    """An end of a boundary that was walked moves the border more than the machine."""
    drive = Drive(12.0, sigma_m=0.5)
    drive.position.at_end(drive.side, 0.0, 0.0, 0.0, 2.0)
    here, there = drive.position.all_borders
    place = np.array([[14.0, 5.0]])
    _, shift = here.against(np.zeros((1, 2)), place)
    _, shift_there = there.against(np.zeros((1, 2)), place)
    along = there.pose[0] - here.pose[0]
    assert 14.0 + shift_there[0, 0] - there.pose[0] == pytest.approx(VEHICLE.blade_x_m, abs=0.4)
    assert along + abs(shift_there[0, 0] - shift[0, 0]) > 0.5


def test_corners_that_lie_elsewhere_from_the_other_place_alone_count_there() -> None:
    outline = Outline(RING)
    x = np.zeros(states_of.CORNERS + 8)
    point = np.array([[7.0, 0.2]])
    more_m = np.array([[0.0, -1.0], [0.0, -1.0], [0.0, 0.0], [0.0, 0.0]])
    assert Borders(x, np.eye(len(x)), outline).as_planned(point) == pytest.approx(point)
    there = Borders(x, np.eye(len(x)), outline, more_m)
    assert there.as_planned(point) == pytest.approx(np.array([[7.0, 1.2]]))
