"""A turn under way, in any frame of dead reckoning."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.estimate.odometry import Motion
from host.pilot.turn_progress import Turning
from host.route.turn_legs import Follow, Goal, Leg, Turn

LANE_RAD = 0.5
LEGS = (
    Leg(0.0, False, Goal.X, 2.0),
    Leg(0.6, False, Goal.HEADING, 0.3),
    Leg(-0.6, True, Goal.HEADING, LANE_RAD),
    Leg(0.0, True, Goal.ALONG, -1.0, Follow.NEW_LANE),
)
TURN = Turn(LEGS, 3.0, 1.0, LANE_RAD, 0.4)
METRES = st.floats(-50.0, 50.0)
ANGLES = st.floats(-7.0, 7.0)


def at(
    origin: tuple[float, float, float],
    place: tuple[float, float, float],
    speed_mps: float = 0.0,
    curvature_1pm: float = 0.0,
) -> Motion:
    """The motion of a machine at a place (x, y, heading) of the turn's frame."""
    x0, y0, direction = origin
    x, y, heading = place
    c, s = math.cos(direction), math.sin(direction)
    east, north = x0 + c * x - s * y, y0 + s * x + c * y
    return Motion(0.0, speed_mps, curvature_1pm, 0.0, direction + heading, east, north)


@given(st.tuples(METRES, METRES, ANGLES), st.tuples(METRES, METRES, ANGLES))
def test_what_is_left_of_a_leg_is_counted_the_way_it_is_driven(
    origin: tuple[float, float, float], place: tuple[float, float, float]
) -> None:
    x, y, heading = place
    along = (x - 3.0) * math.cos(LANE_RAD) + (y - 1.0) * math.sin(LANE_RAD)
    turning = Turning(0.0, TURN, origin)
    for left in (2.0 - x, 0.3 - heading, LANE_RAD - heading, along + 1.0):
        assert turning.to_go(at(origin, place), 0.2) == pytest.approx(left, abs=1e-9)
        turning.next(0.0)
    assert turning.leg is None


def test_a_leg_ends_as_much_sooner_as_the_machine_coasts() -> None:
    """A fifth of a second at 0.5 m/s, or backwards; on an arc of 2 m radius a twentieth of a
    radian."""
    origin = (5.0, -3.0, 2.0)
    turning = Turning(0.0, TURN, origin)
    assert turning.to_go(at(origin, (1.9, 0.0, 0.0), 0.5), 0.2) == pytest.approx(0.0)
    turning.next(0.0)
    assert turning.to_go(at(origin, (0.0, 0.0, 0.25), 0.5, 0.5), 0.2) == pytest.approx(0.0)
    turning.next(0.0)
    assert turning.to_go(at(origin, (0.0, 0.0, 0.45), -0.5, -0.5), 0.2) == pytest.approx(0.0)
    turning.next(0.0)
    c, s = math.cos(LANE_RAD), math.sin(LANE_RAD)
    place = (3.0 - 0.9 * c, 1.0 - 0.9 * s, LANE_RAD)
    assert turning.to_go(at(origin, place, -0.5), 0.2) == pytest.approx(0.0)


def test_the_new_lane_is_where_the_turn_puts_it() -> None:
    origin = (5.0, -3.0, 2.0)
    turning = Turning(0.0, TURN, origin)
    c, s = math.cos(LANE_RAD), math.sin(LANE_RAD)
    behind = at(origin, (3.0 - 2.0 * c - 0.1 * s, 1.0 - 2.0 * s + 0.1 * c, 0.7))
    assert turning.against_lane(behind) == pytest.approx((0.1, 0.2))
    assert turning.crop_expected_m(behind, 1.5) == pytest.approx(0.9)


def test_every_leg_waits_for_its_steering() -> None:
    turning = Turning(1.0, TURN, (0.0, 0.0, 0.0))
    assert (turning.since, turning.running, turning.backing) == (1.0, False, False)
    turning.running = True
    turning.next(5.0)
    assert (turning.since, turning.running) == (5.0, False)
    turning.next(6.0)
    turning.next(7.0)
    assert turning.backing
    turning.next(8.0)
    assert turning.leg is None
    assert not turning.backing


def test_another_way_replaces_what_was_left_of_the_turn_and_counts_from_the_lane() -> None:
    origin = (0.0, 0.0, 0.0)
    turning = Turning(0.0, TURN, origin)
    turning.next(0.0)
    turning.running = True
    legs = (Leg(0.6, False, Goal.HEADING, 0.1), Leg(0.0, True, Goal.WAY, 0.5))
    turning.lay_anew(legs, 1.0)
    assert (turning.running, turning.since) == (False, 1.0)
    assert turning.leg is not None
    assert turning.leg.value == pytest.approx(0.1 + LANE_RAD)
    begun = at(origin, (0.0, 0.0, 0.0))
    assert turning.to_go(begun, 0.0) == pytest.approx(0.1 + LANE_RAD)
    turning.next(2.0)
    for on_m in (0.0, -0.4, -0.5):
        later = replace(begun, distance_m=begun.distance_m + on_m)
        assert turning.to_go(later, 0.0) == pytest.approx(0.5 + on_m)


def test_a_way_backwards_ends_so_much_sooner_as_the_machine_coasts() -> None:
    turning = Turning(0.0, TURN, (0.0, 0.0, 0.0))
    turning.lay_anew((Leg(0.0, True, Goal.WAY, 0.5),), 0.0)
    begun = replace(at((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), speed_mps=-0.3)
    assert turning.to_go(begun, 0.2) == pytest.approx(0.5 - 0.06)


def test_the_place_beside_the_lane_is_the_turns_seen_from_there() -> None:
    turning = Turning(0.0, TURN, (0.0, 0.0, 0.0))
    for place in ((0.3, -0.2, 0.4), (0.0, 0.0, -1.0)):
        beside = turning.beside_lane(at((0.0, 0.0, 0.0), place))
        assert beside.x_m == pytest.approx(TURN.along(*place[:2]))
        assert beside.y_m == pytest.approx(TURN.offset(*place[:2]))
        assert beside.heading_rad == pytest.approx(place[2] - LANE_RAD)
