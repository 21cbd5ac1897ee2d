"""How steep the ground is, from how the camera's phone lies on a machine that goes about."""

from __future__ import annotations

import math

import pytest

from host.core.messages import State, Telemetry, Turned
from host.core.vehicle import Vehicle
from host.estimate.climb import Climb
from host.estimate.odometry import Odometry

WAYS = [k * math.pi / 2 for k in range(4)]
PULSE_M = 1.0 / Vehicle().hall_pulses_per_m


def seen(climb: Climb, yaws: list[float], slope: tuple[float, float], mount: float) -> None:
    """Half a minute in each direction."""
    for yaw in yaws:
        up = slope[0] * math.cos(yaw) + slope[1] * math.sin(yaw)
        for _ in range(300):
            climb.learn(yaw, mount + up, 0.1)


@pytest.mark.parametrize("mount_deg", [-28.0, -5.0, 2.0])
def test_a_mount_and_a_slope_are_told_apart_by_going_about(mount_deg: float) -> None:
    climb, slope = Climb(), (math.radians(2.0), math.radians(-1.0))
    seen(climb, WAYS, slope, math.radians(mount_deg))
    for yaw in WAYS:
        uphill, sigma = climb.uphill(yaw)
        true = slope[0] * math.cos(yaw) + slope[1] * math.sin(yaw)
        assert math.degrees(uphill) == pytest.approx(math.degrees(true), abs=0.2)
        assert math.degrees(sigma) < 0.5


def test_in_one_direction_they_are_one() -> None:
    climb = Climb()
    seen(climb, [0.3], (math.radians(2.0), 0.0), math.radians(-5.0))
    _, sigma = climb.uphill(0.3)
    assert math.degrees(sigma) > 2.0


@pytest.mark.parametrize("nose_up_rad", [math.nan, math.radians(30.0)])
def test_what_shows_nothing_or_is_no_camera_that_sees_the_crop_teaches_nothing(
    nose_up_rad: float,
) -> None:
    """The screen's camera looks up where the back camera looks down."""
    climb = Climb()
    before = climb.uphill(0.0)
    for yaw in WAYS:
        climb.learn(yaw, nose_up_rad, 10.0)
    assert climb.uphill(0.0) == before


@pytest.mark.parametrize("driven", [1, -1])
@pytest.mark.parametrize("nose_up_deg", [2.0, -2.0])
def test_the_ground_tells_which_way_a_braked_machine_rolls(driven: int, nose_up_deg: float) -> None:
    """Its wheels point straight ahead, and it creeps by as much either way."""
    odometry = Odometry(Vehicle())
    now, odometer, true_m = 0.0, 0.0, 0.0

    def go(seconds: float, speed: float, duty: int) -> None:
        nonlocal now, odometer, true_m
        for _ in range(round(seconds / 0.05)):
            now += 0.05
            true_m += speed * 0.05
            odometer += abs(speed) * 0.05 * driven
            up = math.radians(nose_up_deg) * math.cos(odometry.now.yaw_rad)
            odometry.take_turned(Turned(now - 0.1, 0.0, 0.0, math.radians(-5.0) + up))
            counted = math.floor(odometer / PULSE_M + 1e-9) * PULSE_M
            odometry.update(
                Telemetry(
                    stamp=now,
                    state=State.RUNNING,
                    faults=0,
                    setpoint_rad=0.0,
                    angle_rad=0.0,
                    steer_duty=0,
                    drive_duty=duty,
                    blade=False,
                    speed_mps=abs(speed) * driven,
                    distance_m=counted,
                    battery_v=12.0,
                    last_seq=0,
                    frames_bad=0,
                )
            )

    seen(odometry.rolling.climb, WAYS, (math.radians(nose_up_deg), 0.0), math.radians(-5.0))
    go(2.0, 0.3 * driven, 100 * driven)
    go(1.0, 0.0, 0)
    before = odometry.now.distance_m - true_m
    go(3.0, -0.05 if nose_up_deg > 0.0 else 0.05, 0)
    assert odometry.now.distance_m - true_m == pytest.approx(before, abs=1.5 * PULSE_M)
    assert odometry.now.rolled_m == 0.0, "nothing is unsure of it"
