"""How steep the ground is, from how the camera's phone lies on a machine that goes about."""

from __future__ import annotations

import math

import pytest

from host.core.vehicle import Vehicle
from host.estimate.climb import Climb
from tests.helpers.drive import Drive

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


def roller(nose_up_deg: float, yaws: list[float]) -> Drive:
    """On ground that rises so much ahead, by a phone; it has been in those directions."""
    drive, up = Drive(), math.radians(nose_up_deg)
    drive.nose_up = MOUNT + up
    seen(drive.estimate.odometry.rolling.climb, yaws, (up, 0.0), MOUNT)
    return drive


@pytest.mark.parametrize("driven", [1.0, -1.0])
@pytest.mark.parametrize("nose_up_deg", [2.0, -2.0])
def test_the_ground_tells_which_way_a_braked_machine_rolls(
    driven: float, nose_up_deg: float
) -> None:
    """It creeps by as much either way, its wheels straight ahead."""
    drive = roller(nose_up_deg, WAYS)
    drive.go(2.0, 0.3 * driven)
    drive.go(1.0, 0.0)
    before = drive.error_m
    drive.go(3.0, -0.05 if nose_up_deg > 0.0 else 0.05, duty=0, driven=driven)
    assert drive.error_m == pytest.approx(before, abs=1.5 * PULSE_M)
    assert drive.estimate.motion.roll_doubt_m == 0.0


def test_a_machine_that_starts_or_stops_shows_no_ground() -> None:
    """It nods, and what it gains of speed looks like a slope."""
    drive = roller(2.0, WAYS)
    drive.go(3.0, 0.3)
    drive.go(0.05, 0.0)
    climb = drive.estimate.odometry.rolling.climb
    before = climb.uphill(0.0)
    drive.nose_up -= 0.2
    drive.go(0.8, 0.0)
    assert climb.uphill(0.0) == before
    drive.nose_up += 0.2
    drive.go(2.0, 0.0)
    assert climb.uphill(0.0) != before


def test_downhill_a_machine_that_becomes_faster_has_not_turned_round() -> None:
    drive = roller(-2.0, WAYS)
    drive.go(2.0, 0.3)
    drive.go(0.5, 0.03, duty=0)
    before = drive.error_m
    drive.go(3.0, 0.07, duty=0)
    assert drive.error_m == pytest.approx(before, abs=1.5 * PULSE_M)


@pytest.mark.parametrize("yaws", [[0.0], [0.0, 0.45]])
def test_ground_that_may_be_the_mount_tells_nothing(yaws: list[float]) -> None:
    drive = roller(2.0, yaws)
    drive.go(2.0, 0.3)
    drive.go(1.0, 0.0)
    drive.go(3.0, 0.05, duty=0)
    assert abs(drive.error_m) < 1.5 * PULSE_M, "it goes on, as far as anybody knows"
    assert drive.estimate.motion.roll_doubt_m == pytest.approx(0.15, abs=1.5 * PULSE_M)
