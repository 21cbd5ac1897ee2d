"""Facts about the receiver's speed against the wheels': when it can be compared, what it tells."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.messages import Fix, State, Telemetry
from host.core.vehicle import Vehicle
from host.estimate.estimator import Estimator
from host.estimate.measurements.speed import speed
from host.estimate.motion_model import DRILLED, move
from host.estimate.odometry import Motion
from host.estimate.states import CORNERS, GRADE_X, GRADE_Y, SCALE, SLIP, YAW, X, Y
from host.estimate.steady_speed import SteadySpeed
from host.route.plan import spiral

TICK_S = 0.02
VEHICLE = Vehicle()
FIELD = [(0.0, 0.0), (150.0, 0.0), (150.0, 20.0), (0.0, 20.0)]


def told(
    t: float, speed_mps: float | None, way_m: float = 0.0, angle_rad: float = 0.0, *, blade: bool
) -> Telemetry:
    return Telemetry(
        t, State.RUNNING, 0, 0.0, angle_rad, 0, 120, blade, speed_mps, way_m, 12.0, 0, 0
    )


def steady_after(*legs: tuple[float, float | None], angle_rad: float = 0.0) -> float | None:
    """What can be compared after legs of (seconds, speed)."""
    steady, t = SteadySpeed(), 0.0
    for seconds, speed_mps in legs:
        for _ in range(round(seconds / TICK_S)):
            t += TICK_S
            steady.take(told(t, speed_mps, angle_rad=angle_rad, blade=True))
    return steady.mps


@pytest.mark.parametrize("speed_mps", [0.5, -0.3])
def test_one_speed_straight_on_can_be_compared_once_a_receiver_shows_it(speed_mps: float) -> None:
    assert steady_after((2.0, speed_mps)) is None
    assert steady_after((12.0, speed_mps)) == pytest.approx(speed_mps, abs=1e-3)


@pytest.mark.parametrize("next_mps", [0.0, 0.3, -0.3, 0.7])
def test_after_another_speed_it_is_none_at_first(next_mps: float) -> None:
    assert steady_after((12.0, 0.5), (0.8, next_mps)) is None


def test_no_speed_in_a_bend_at_a_creep_or_without_a_sensor() -> None:
    assert steady_after((12.0, 0.5), angle_rad=0.3) is None
    assert steady_after((12.0, 0.1)) is None
    assert steady_after((12.0, 0.5), (0.1, None)) is None


@given(
    st.floats(-0.05, 0.05),
    st.floats(-0.05, 0.05),
    st.floats(-0.03, 0.03),
    st.floats(-0.03, 0.03),
    st.floats(-3.1, 3.1),
    st.sampled_from([0.5, -0.3]),
    st.booleans(),
)
def test_it_expects_the_speed_at_which_the_filter_moves_the_machine(
    scale: float, slip: float, up_x: float, up_y: float, yaw: float, wheels: float, cutting: bool
) -> None:
    """And no change of what the wheels lose is told otherwise than the motion takes it."""
    state = np.zeros(CORNERS)
    state[[SCALE, SLIP, GRADE_X, GRADE_Y, YAW]] = scale, slip, up_x, up_y, yaw
    moved, p = state.copy(), np.eye(CORNERS)
    begun = Motion(0.0, wheels, 0.0, 0.0, yaw, 0.0, 0.0)
    move(moved, p, begun, Motion(1.0, wheels, 0.0, wheels, yaw, 0.0, 0.0), DRILLED, cutting=cutting)
    ahead = math.cos(yaw) * moved[X] + math.sin(yaw) * moved[Y]
    found = speed(state, wheels, ahead, cutting=cutting)
    assert float(found.innovation[0]) == pytest.approx(0.0, abs=1e-12)
    for k in (SCALE, SLIP, GRADE_X, GRADE_Y):
        changed = state.copy()
        changed[k] += 0.01
        after = speed(changed, wheels, ahead, cutting=cutting)
        more = float(found.innovation[0] - after.innovation[0])
        assert more == pytest.approx(0.01 * found.h[0, k], abs=1e-12)


def found_scale(
    counted: float, *, true_mps: float = 0.5, shown: float = 1.0, underway: bool = True
) -> tuple[float, float]:
    """What the wheels are believed to lose, and how surely, after 200 s straight on."""
    plan, rng = spiral(FIELD, 0, VEHICLE), np.random.default_rng(3)
    estimate = Estimator(VEHICLE, plan)
    estimate.position.place(plan.sides[0], 0.0, 0.0, 0.0)
    for k in range(1, 10_000):
        t = k * TICK_S
        telemetry = told(t, counted * true_mps, counted * true_mps * t, blade=False)
        estimate.take_telemetry(telemetry)
        if k % 50 == 0:
            east, north = true_mps + rng.normal(0, 0.05), rng.normal(0, 0.05)
            course = math.atan2(north, east)
            fix = Fix(t, 31.5, 74.3, 1, 0.8, 9, shown * math.hypot(east, north), course)
            estimate.take_fix(fix, telemetry, underway=underway)
    x = estimate.position.x
    lost = np.zeros(len(x))
    lost[[SCALE, GRADE_X]] = 1.0, math.copysign(1.0, true_mps)
    return float(lost @ x), estimate.position.sigma(lost)


@pytest.mark.parametrize("counted", [0.97, 1.0, 1.03])
def test_wheels_that_count_too_much_are_found_out(counted: float) -> None:
    lost, sigma = found_scale(counted)
    assert lost == pytest.approx(1.0 - 1.0 / counted, abs=0.013)
    assert sigma < 0.012


def test_backwards_they_are_found_out_too() -> None:
    assert found_scale(1.06, true_mps=-0.3)[0] > 0.02
    assert found_scale(0.94, true_mps=-0.3)[0] < -0.02


def test_a_receiver_that_hangs_tells_nothing_of_the_wheels() -> None:
    assert found_scale(1.0, shown=0.0)[0] == 0.0


def test_without_leave_a_fix_tells_nothing_of_the_wheels() -> None:
    assert found_scale(1.03, underway=False)[0] == 0.0
