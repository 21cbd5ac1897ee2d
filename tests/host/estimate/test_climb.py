"""How steep the ground is, from how the camera's phone lies on a machine that goes about."""

from __future__ import annotations

import math

import pytest

from host.core.messages import State, Telemetry, Turned
from host.core.vehicle import Vehicle
from host.estimate.climb import Climb
from host.estimate.odometry import Odometry

WAYS = [k * math.pi / 2 for k in range(4)]
MOUNT = math.radians(-5.0)
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


class Roller:
    """A braked machine on ground that rises along x; its wheels point straight ahead."""

    def __init__(self, nose_up_deg: float, driven: int, yaws: list[float]) -> None:
        """`yaws`: the directions in which it has been."""
        self.odometry, self.driven = Odometry(Vehicle()), driven
        self.up = math.radians(nose_up_deg)
        self.now = self.odometer = self.true_m = 0.0
        seen(self.odometry.rolling.climb, yaws, (self.up, 0.0), MOUNT)

    @property
    def error_m(self) -> float:
        """Of dead reckoning."""
        return self.odometry.now.distance_m - self.true_m

    def go(self, seconds: float, speed: float, duty: int) -> None:
        """The wheels' sensor counts as the machine was driven."""
        for _ in range(round(seconds / 0.05)):
            self.now += 0.05
            self.true_m += speed * 0.05
            self.odometer += abs(speed) * 0.05 * self.driven
            self.odometry.take_turned(Turned(self.now - 0.1, 0.0, 0.0, MOUNT + self.up))
            counted = math.floor(self.odometer / PULSE_M + 1e-9) * PULSE_M
            self.odometry.update(
                Telemetry(
                    stamp=self.now,
                    state=State.RUNNING,
                    faults=0,
                    setpoint_rad=0.0,
                    angle_rad=0.0,
                    steer_duty=0,
                    drive_duty=duty,
                    blade=False,
                    speed_mps=abs(speed) * self.driven,
                    distance_m=counted,
                    battery_v=12.0,
                    last_seq=0,
                    frames_bad=0,
                )
            )


@pytest.mark.parametrize("driven", [1, -1])
@pytest.mark.parametrize("nose_up_deg", [2.0, -2.0])
def test_the_ground_tells_which_way_a_braked_machine_rolls(driven: int, nose_up_deg: float) -> None:
    """It creeps by as much either way."""
    roller = Roller(nose_up_deg, driven, WAYS)
    roller.go(2.0, 0.3 * driven, 100 * driven)
    roller.go(1.0, 0.0, 0)
    before = roller.error_m
    roller.go(3.0, -0.05 if nose_up_deg > 0.0 else 0.05, 0)
    assert roller.error_m == pytest.approx(before, abs=1.5 * PULSE_M)
    assert roller.odometry.now.rolled_m == 0.0, "nothing is unsure of it"


def test_a_machine_that_starts_or_stops_shows_no_ground() -> None:
    """It nods, and what it gains of speed looks like a slope."""
    roller = Roller(2.0, 1, WAYS)
    roller.go(3.0, 0.3, 100)
    roller.go(0.05, 0.0, 0)
    before = roller.odometry.rolling.climb.uphill(0.0)
    roller.up -= 0.2
    roller.go(0.8, 0.0, 0)
    assert roller.odometry.rolling.climb.uphill(0.0) == before
    roller.up += 0.2
    roller.go(2.0, 0.0, 0)
    assert roller.odometry.rolling.climb.uphill(0.0) != before


def test_downhill_a_machine_that_becomes_faster_has_not_turned_round() -> None:
    roller = Roller(-2.0, 1, WAYS)
    roller.go(2.0, 0.3, 100)
    roller.go(0.5, 0.03, 0)
    before = roller.error_m
    roller.go(3.0, 0.07, 0)
    assert roller.error_m == pytest.approx(before, abs=1.5 * PULSE_M)


@pytest.mark.parametrize("yaws", [[0.0], [0.0, 0.45]])
def test_ground_that_may_be_the_mount_tells_nothing(yaws: list[float]) -> None:
    roller = Roller(2.0, 1, yaws)
    roller.go(2.0, 0.3, 100)
    roller.go(1.0, 0.0, 0)
    roller.go(3.0, 0.05, 0)
    assert abs(roller.error_m) < 1.5 * PULSE_M, "it goes on, as far as anybody knows"
    assert roller.odometry.now.rolled_m == pytest.approx(0.15, abs=1.5 * PULSE_M)
