"""A sensor at one rear wheel tells what the middle of the axle does."""

from __future__ import annotations

import math

import pytest

from host.core.messages import Command, Request, State, Telemetry
from host.core.vehicle import Vehicle
from host.estimate.wheel_sensor import WheelPlace, WheelSensor

LOCK_1PM = math.tan(math.radians(50.0))
"""Curvature of the default machine's middle on its lock, to the left."""
LEFT, RIGHT = Vehicle(hall_left_m=0.35), Vehicle(hall_left_m=-0.35)


def told(k: int, wheel_mps: float, wheel_m: float) -> Telemetry:
    return Telemetry(
        0.02 * k, State.RUNNING, 0, 0.0, 0.0, 0, 120, False, wheel_mps, wheel_m, 12.0, 0, 0
    )


@pytest.mark.parametrize("vehicle", [LEFT, RIGHT])
@pytest.mark.parametrize("curvature_1pm", [LOCK_1PM, -LOCK_1PM, 0.0])
@pytest.mark.parametrize("speed_mps", [0.3, -0.3])
def test_on_a_circle_the_middle_goes_its_own_way(
    vehicle: Vehicle, curvature_1pm: float, speed_mps: float
) -> None:
    """By the circle's radii: the wheel's over the middle's."""
    radius_m = 1.0 / curvature_1pm if curvature_1pm else math.inf
    wheel = speed_mps * (1.0 if math.isinf(radius_m) else 1.0 - vehicle.hall_left_m / radius_m)
    sensor = WheelSensor(vehicle)
    first = sensor.at_the_middle(told(0, wheel, 7.0), curvature_1pm)
    last = first
    for k in range(1, 101):
        last = sensor.at_the_middle(told(k, wheel, 7.0 + wheel * 0.02 * k), curvature_1pm)
    assert last.speed_mps == pytest.approx(speed_mps)
    assert last.distance_m - first.distance_m == pytest.approx(speed_mps * 2.0)
    asked = sensor.asked_of_the_wheel(Command(Request.DRIVE, 0.5, speed_mps, True, "so"))
    assert asked.speed_mps == pytest.approx(wheel)
    assert asked == Command(Request.DRIVE, 0.5, asked.speed_mps, True, "so")


def test_a_wheel_that_was_steered_meanwhile_counts_by_the_mean_of_both_curvatures() -> None:
    sensor = WheelSensor(LEFT)
    before = sensor.at_the_middle(told(0, 0.3, 0.0), 0.0)
    after = sensor.at_the_middle(told(1, 0.3, 0.01), 1.0)
    assert after.distance_m - before.distance_m == pytest.approx(0.01 / (1.0 - 0.35 / 2))


def test_what_counts_the_axle_or_is_not_fitted_is_left_as_it_is() -> None:
    command = Command(Request.DRIVE, 0.0, 0.3)
    axle = WheelSensor(Vehicle(hall_left_m=0.0))
    assert axle.at_the_middle(told(0, 0.3, 1.0), LOCK_1PM) == told(0, 0.3, 1.0)
    assert axle.asked_of_the_wheel(command) == command
    none = Telemetry(0.0, State.RUNNING, 0, 0.0, 0.0, 0, 120, False, None, 0.0, 12.0, 0, 0)
    without = WheelSensor(LEFT)
    assert without.at_the_middle(none, LOCK_1PM) == none
    assert without.asked_of_the_wheel(command) == command


def test_no_other_request_is_touched() -> None:
    sensor = WheelSensor(LEFT)
    sensor.at_the_middle(told(0, 0.3, 0.0), LOCK_1PM)
    for request in (Request.STOP, Request.ARM, Request.CLEAR):
        command = Command(request, 0.1, 0.3)
        assert sensor.asked_of_the_wheel(command) is command


def test_a_wheel_beside_the_turn_s_middle_makes_no_way_of_nothing() -> None:
    sensor = WheelSensor(LEFT)
    sensor.at_the_middle(told(0, 0.0, 0.0), 1.0 / 0.35)
    assert sensor.at_the_middle(told(1, 0.0, 0.02), 1.0 / 0.35).distance_m == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("legs", "wrong"),
    [
        (((0.45, 1.0), (2.1, 1.0)), (0.45, 2.1)),
        (((2.1, -1.0), (0.45, -1.0)), (0.45, 2.1)),
        (((0.99, 1.0), (1.01, 1.0)), None),
        (((2.0, 1.0), (2.0, 1.0)), None),
        (((0.3, 1.0), (0.0, 1.0), (1.0, 1.0)), None),
        (((0.45, 1.0), (2.1, 0.1)), None),
        (((0.45, 1.0), (1.0, 1.0), (2.1, 1.0)), None),
    ],
    ids=["left", "right", "well", "pulses lost", "gyroscope hangs", "too short", "not in a row"],
)
def test_two_legs_that_contradict_each_other_show_the_sensor_on_another_wheel(
    legs: tuple[tuple[float, float], ...], wrong: tuple[float, float] | None
) -> None:
    """Times what was reckoned, and that, rad."""
    place = WheelPlace()
    for times, reckoned_rad in legs:
        place.take(times * reckoned_rad, reckoned_rad, ended=True)
    assert place.wrong == (None if wrong is None else pytest.approx(wrong))


def test_it_shows_before_the_second_leg_has_ended() -> None:
    place = WheelPlace()
    place.take(0.45, 1.0, ended=True)
    place.take(0.3, 0.14, ended=False)
    assert place.wrong is None, "as good as straight"
    place.take(0.4, 0.19, ended=False)
    assert place.wrong == pytest.approx((0.45, 0.4 / 0.19))


def test_what_is_driven_of_one_leg_does_not_contradict_its_end() -> None:
    """A wheel that is still on its way to its angle, and a gyroscope that tells late."""
    place = WheelPlace()
    for seen_rad in (0.4, 0.5, 0.6):
        place.take(seen_rad, 0.2, ended=False)
    place.take(0.6, 0.95, ended=True)
    assert place.wrong is None
