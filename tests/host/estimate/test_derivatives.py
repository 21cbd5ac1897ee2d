"""Each measurement's derivative is that of its own expectation, the corners of a walked boundary
among the states: held against finite differences, not against another formula."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from host.core.vehicle import Vehicle
from host.estimate.kalman import Array, Measurement
from host.estimate.measurements import begin, course, edge, end
from host.estimate.motion_model import DRILLED, move
from host.estimate.odometry import Motion
from host.estimate.outline import Outline
from host.estimate.place import Place
from host.estimate.states import CORNERS, CRAB, WANDER, YAW, X, Y
from host.route.plan import spiral

VEHICLE = Vehicle()
RING = [(0.0, 0.0), (14.0, 1.0), (13.0, 10.0), (1.0, 9.0)]
STEP = 1e-5


def seen(place: Place) -> Measurement:
    return edge.edge(place, 0.1, math.nan, 1.0, (0.0, 0.0), 0.4)


def begun(place: Place) -> Measurement:
    return begin.begin(place, 0.2)


def ended(place: Place) -> Measurement:
    return end.end(place, 0.2, 0.0)


@pytest.mark.parametrize("index", [0, 1, 4, 5])
@pytest.mark.parametrize("take", [seen, begun, ended])
def test_a_measurements_derivative_is_that_of_what_it_expects(
    take: Callable[[Place], Measurement], index: int
) -> None:
    side = spiral(RING, 0, VEHICLE, sigma_m=1.0).sides[index]
    x, y, heading = side.pose(0.7 * side.length_m - VEHICLE.blade_x_m, VEHICLE.inset_m + 0.1)
    state = np.zeros(CORNERS + 2 * len(RING))
    state[[X, Y, YAW]] = x, y, heading + 0.05

    def innovation(change: Array) -> float:
        outline = Outline(RING)
        outline.move(change[CORNERS:])
        own = state + np.concatenate([change[:CORNERS], np.zeros(2 * len(RING))])
        place = Place(own, outline.found(side), VEHICLE.blade_x_m, VEHICLE.inset_m, outline)
        return float(take(place).innovation[0])

    at = Place(state, side, VEHICLE.blade_x_m, VEHICLE.inset_m, Outline(RING))
    stated = take(at).h[0]
    before = innovation(np.zeros(len(state)))
    for k in range(len(state)):
        change = np.zeros(len(state))
        change[k] = STEP
        slope = -(innovation(change) - before) / STEP
        # How a border slants against the strip changes too; that is left out, and small.
        assert stated[k] == pytest.approx(slope, abs=0.06 if take is seen else 0.25), k


def test_a_courses_derivative_is_that_of_the_course_it_expects() -> None:
    """It is given against the machine's yaw: what that moves, moves what was measured."""
    seen_rad, yaw = 0.3, 0.1
    state = np.linspace(0.01, 0.02, CORNERS)
    state[YAW] = yaw

    def at(change: Array) -> Measurement:
        x = state + change
        return course.course(x, seen_rad - float(x[YAW]), 0.5)

    before = at(np.zeros(CORNERS))
    for k in range(CORNERS):
        change = np.zeros(CORNERS)
        change[k] = STEP
        slope = -(at(change).innovation[0] - before.innovation[0]) / STEP
        assert before.h[0, k] == pytest.approx(slope, abs=1e-6), k


@pytest.mark.parametrize("by_gyro", [False, True])
@pytest.mark.parametrize("cutting", [False, True])
def test_what_is_not_known_moves_as_what_is(by_gyro: bool, cutting: bool) -> None:
    """The covariance after a step, less what the step itself errs, is that of the moved state."""
    rng = np.random.default_rng(7)
    state = 0.02 * rng.standard_normal(CORNERS + 2)
    state[CRAB] = 0.0  # what a turn takes of the drift is taken to be known
    past = motion(0.0, 0.0, 1.0, by_gyro)
    later = motion(0.4, 0.15, 1.5, by_gyro)

    def moved(x: Array, p: Array) -> tuple[Array, Array]:
        x, p = x.copy(), p.copy()
        move(x, p, past, later, DRILLED, cutting=cutting)
        return x, p

    nothing = np.zeros((len(state), len(state)))
    own, noise = moved(state, nothing)
    jacobian = np.empty_like(nothing)
    for k in range(len(state)):
        change = np.zeros(len(state))
        change[k] = STEP
        jacobian[:, k] = (moved(state + change, nothing)[0] - own) / STEP
    a = rng.standard_normal(nothing.shape)
    before = a @ a.T
    _, after = moved(state, before)
    assert after - noise == pytest.approx(jacobian @ before @ jacobian.T, abs=2e-3)
    assert own[WANDER] == pytest.approx(state[WANDER] * math.exp(-0.4 / DRILLED.over_m))


def motion(distance_m: float, yaw_rad: float, stamp: float, by_gyro: bool) -> Motion:
    noise = math.radians(0.1) if by_gyro else 0.0
    return Motion(stamp, 0.5, 0.0, distance_m, yaw_rad, 0.0, 0.0, noise)
