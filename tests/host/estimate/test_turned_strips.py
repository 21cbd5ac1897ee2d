"""Strips that have turned against the boundary: all at once, about the field's middle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.messages import Fix, State, Telemetry
from host.core.vehicle import Vehicle
from host.estimate import turned_strips
from host.estimate.estimator import Estimator
from host.estimate.odometry import Motion
from host.estimate.outline import Outline
from host.estimate.position import Position
from host.estimate.states import LANE_OFFSET, LANE_YAW, YAW, X, Y
from host.route.plan import spiral
from host.route.side import Side
from tests.helpers.places import followed

VEHICLE = Vehicle()
WIDTH = VEHICLE.pass_m
RING = [(0.0, 0.0), (14.0, 0.0), (14.0, 10.0), (0.0, 10.0)]
MIDDLE = np.array([7.0, 5.0])
PLAN = spiral(RING, 0, VEHICLE, sigma_m=0.3, recorded=True)
OUTER = PLAN.sides[0]
INNER = next(side for side in PLAN.sides if side.inside_m > WIDTH / 2)
"""The first side that is cut along what another has left."""


def turned(place: np.ndarray, by_rad: float) -> np.ndarray:
    """A place, turned left about the middle."""
    c, s = math.cos(by_rad), math.sin(by_rad)
    return np.array([[c, -s], [s, c]]) @ (place - MIDDLE) + MIDDLE


@given(st.floats(0.0, 14.0), st.floats(0.0, 10.0), st.floats(-3.0, 3.0), st.floats(0.0, 6.0))
def test_place_and_lanes_move_as_what_is_turned_about_the_middle(
    x_m: float, y_m: float, heading_rad: float, along_m: float
) -> None:
    """By a small angle."""
    angle = 1e-5
    state = np.zeros(60)
    state[X], state[Y] = x_m, y_m
    side = Side(y_m, x_m, heading_rad, 8.0, WIDTH, 8.0)
    by = angle * turned_strips.as_one(state, Outline(RING), [(side, LANE_OFFSET)])
    place = np.array([x_m, y_m])
    assert by[[X, Y]] == pytest.approx(turned(place, angle) - place, abs=1e-8)
    assert by[YAW] == by[LANE_YAW] == angle
    on_edge = np.array(side.pose(along_m)[:2])
    left = np.array([-math.sin(heading_rad), math.cos(heading_rad)])
    moved_m = float((turned(on_edge, angle) - on_edge) @ left)
    assert by[LANE_OFFSET] + along_m * by[LANE_YAW] == pytest.approx(moved_m, abs=1e-8)


def test_without_a_boundary_to_be_found_it_turns_about_the_machine() -> None:
    state = np.zeros(60)
    state[X], state[Y] = 3.0, 4.0
    by = turned_strips.as_one(state, Outline(), [])
    assert by[[X, Y]] == pytest.approx((0.0, 0.0))


def driven(position: Position, side: Side) -> None:
    """A few metres along a side, seen where it is believed."""
    position.begin(side, straight=False)
    for k in range(8):
        position.predict(Motion(0.0, 0.5, 0.0, 0.5 * k, 0.0, 0.5 * k, 0.0), cutting=False)
        followed(position, 0.0, 0.02)


def inside() -> Position:
    """On the first inner side, after the outer one along the same edge."""
    position = Position(VEHICLE, RING, 0.3)
    position.place(OUTER, 0.0, 0.0, 0.0)
    driven(position, OUTER)
    position.place(INNER, 0.0, 0.0, 0.0)
    driven(position, INNER)
    return position


def test_strips_that_may_have_turned_follow_the_courses_and_the_boundary_does_not() -> None:
    position, believer = inside(), inside()
    assert position.may_be_turned(math.radians(7.0))
    for one in (position, believer):
        before, corners = one.x.copy(), one.outline.corners
        for _ in range(30):
            one.course(math.radians(7.0) - (one.x[YAW] - before[YAW]), 0.5)
        moved = one.x - before
        if one is believer:
            assert math.degrees(moved[YAW]) < 4.0
            continue
        assert math.degrees(moved[YAW]) > 5.0
        assert moved[LANE_YAW] == pytest.approx(moved[YAW], rel=0.15), "its lane with it"
        away = np.array(one.pose[:2]) - MIDDLE
        about = moved[YAW] * np.array([-away[1], away[0]])
        assert moved[[X, Y]] == pytest.approx(about, abs=0.15)
        assert np.array(one.outline.corners) == pytest.approx(np.array(corners), abs=0.1)


def test_along_the_boundary_nothing_has_turned() -> None:
    position = Position(VEHICLE, RING, 0.3)
    position.place(OUTER, 0.0, 0.0, 0.0)
    before = position.covariance.copy()
    assert not position.may_be_turned(math.radians(7.0))
    assert (position.covariance == before).all()


def course_after(side: Side, off_deg: float, seconds: int) -> tuple[float, float]:
    """(how far the courses are said to lie askew, how far the heading has turned to them), both in
    degrees, of a machine that drives along a side, the courses that much left of its own."""
    estimate = Estimator(VEHICLE, PLAN)
    position = estimate.position
    position.place(OUTER, 0.0, 0.0, 0.0)
    position.begin(OUTER, straight=False)
    position.place(side, 0.0, 0.0, 0.0)
    position.begin(side, straight=False)
    begun = float(position.x[YAW])
    for k in range(10 * seconds):
        t = 0.1 * k
        told = Telemetry(t, State.RUNNING, 0, 0.0, 0.0, 0, 120, False, 0.3, 0.3 * t, 12.0, 0, 0)
        estimate.take_telemetry(told)
        followed(position, 0.0, 0.02)
        if k % 10 == 0:
            left = begun + math.radians(off_deg)
            fix = Fix(t, 31.5, 74.3, 1, 0.8, 9, 0.3, left)
            estimate.take_fix(fix, told, underway=True)
            if estimate.askew_rad != 0.0:
                break
    turned_deg = math.degrees(float(position.x[YAW]) - begun)
    return math.degrees(estimate.askew_rad), turned_deg


def test_inside_the_field_courses_turn_what_is_believed_and_along_the_boundary_they_stop() -> None:
    askew, followed_deg = course_after(INNER, 15.0, 60)
    assert askew == 0.0
    assert followed_deg > 10.0
    askew, followed_deg = course_after(OUTER, 15.0, 60)
    assert askew > 7.0
    assert followed_deg < 8.0


def test_courses_that_are_wrong_at_once_turn_nothing() -> None:
    """No strip turns by so much from one round to the next."""
    askew, followed_deg = course_after(INNER, 25.0, 60)
    assert askew > 12.0
    assert followed_deg < 15.0


def test_what_the_strips_have_turned_by_is_taken_once() -> None:
    """The courses that told it are about the direction of before."""
    estimate = Estimator(VEHICLE, PLAN)
    estimate.position.place(INNER, 0.0, 0.0, 0.0)
    for k in range(60):
        told = Telemetry(k, State.RUNNING, 0, 0.0, 0.0, 0, 120, False, 0.3, 0.3 * k, 12.0, 0, 0)
        estimate.take_telemetry(told)
        heading = estimate.position.course_rad
        fix = Fix(k, 31.5, 74.3, 1, 0.8, 9, 0.3, heading + math.radians(10.0))
        estimate.direction.contradicted(fix, estimate.motion, heading)
    assert estimate.direction.may_have_turned
    before = estimate.position.covariance[YAW, YAW]
    estimate.take_fix(fix, told, underway=True)
    assert estimate.position.covariance[YAW, YAW] > before
    assert estimate.askew_rad == estimate.direction.askew_rad == 0.0
    assert not estimate.direction.may_have_turned


def test_who_stands_at_another_corner_has_turned_no_strips() -> None:
    askew, followed_deg = course_after(INNER, 90.0, 60)
    assert askew > 45.0
    assert followed_deg < 30.0
