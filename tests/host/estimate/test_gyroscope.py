"""What the gyroscope adds to dead reckoning, and when it is not believed."""

from __future__ import annotations

import math

import pytest

from tests.helpers.drive import STEP_S, Drive


def test_a_pot_of_a_wrong_scale_does_not_turn_the_yaw() -> None:
    without, having = Drive(pot_scale=0.93), Drive(pot_scale=0.93)
    without.late = math.inf
    for drive in (without, having):
        drive.go(3.0, 0.0)
        drive.quarter()
    assert abs(without.error_rad) > math.radians(8)
    assert abs(having.error_rad) < math.radians(0.5)


def test_what_it_shows_at_a_stand_is_its_offset() -> None:
    drive = Drive(offset_radps=math.radians(1.5))
    drive.go(4.0, 0.0)
    drive.go(40.0, 0.5)
    assert drive.estimate.odometry.now.by_gyro
    assert abs(drive.error_rad) < math.radians(0.5)


@pytest.mark.parametrize("counted", [True, False])
def test_a_creep_between_two_pulses_of_a_turned_machine_is_no_rest(counted: bool) -> None:
    """A braked machine creeps down a slope by some centimetres a second; on the lock it turns
    meanwhile by a degree and more."""
    drive = Drive()
    drive.counted = counted
    drive.go(4.0, 0.0)
    drive.go(20.0, -0.3)
    for steer_deg in (40.0, -40.0):
        drive.go(1.5, 0.025, math.radians(steer_deg), duty=0)
    drive.go(30.0, 0.3)
    assert drive.estimate.odometry.now.by_gyro
    assert abs(drive.error_rad) < math.radians(0.6 if counted else 1.5)
    assert abs(drive.estimate.odometry.gyroscope.offset) < math.radians(0.02)


def test_a_long_stand_with_turned_wheels_shows_the_offset() -> None:
    """What creeps gives a pulse in the end."""
    drive = Drive(offset_radps=math.radians(1.5))
    drive.go(30.0, 0.0, math.radians(40))
    assert drive.estimate.odometry.gyroscope.offset == pytest.approx(
        math.radians(1.5), abs=math.radians(0.1)
    )


def test_a_machine_that_never_stood_goes_by_the_steering_angle() -> None:
    drive = Drive(offset_radps=math.radians(1.5))
    drive.go(20.0, 0.5)
    assert not drive.estimate.odometry.now.by_gyro
    assert drive.error_rad == pytest.approx(0.0, abs=1e-9)


def test_it_teaches_the_pots_zero_driving_straight() -> None:
    drive = Drive(pot_off_rad=math.radians(2.0))
    drive.go(3.0, 0.0)
    drive.go(20.0, 0.5)
    assert drive.estimate.odometry.trim_rad == pytest.approx(
        math.radians(2.0), abs=math.radians(0.2)
    )


def test_it_teaches_the_pots_scale_in_turns() -> None:
    drive = Drive(pot_scale=0.93)
    drive.go(3.0, 0.0)
    for _ in range(12):
        drive.quarter()
    reckoned = math.tan(math.radians(45 * 0.93)) * drive.estimate.odometry.yaw_gain
    assert reckoned == pytest.approx(math.tan(math.radians(45)), rel=0.02)


@pytest.mark.parametrize(
    ("counts", "hangs", "elsewhere"),
    [
        ((2.2, 0.45), False, True),
        ((0.45, 2.2), False, True),
        ((1.0, 1.0), False, False),
        ((0.5, 0.5), False, False),
        ((1.0, 1.0), True, False),
    ],
    ids=["right wheel", "left wheel", "well", "loses pulses", "gyroscope hangs"],
)
def test_the_two_legs_of_a_turn_show_a_wheel_sensor_on_another_wheel(
    counts: tuple[float, float], hangs: bool, elsewhere: bool
) -> None:
    """Forward on the left lock and back on the right one the machine turns to the left."""
    drive = Drive()
    drive.go(3.0, 0.0)
    drive.gyro_turns = not hangs
    for way, times in zip((1.0, -1.0), counts, strict=True):
        drive.counts = times
        drive.go(2.5, way * 0.3, way * math.radians(45))
        drive.go(1.0, 0.0)
    assert (drive.estimate.odometry.wheel_place.wrong is not None) is elsewhere


def test_one_that_hangs_is_not_believed_and_takes_nothing_along() -> None:
    drive = Drive()
    drive.go(3.0, 0.0)
    drive.go(10.0, 0.5)
    drive.gyro_turns = False
    drive.quarter()
    assert not drive.estimate.odometry.now.by_gyro
    assert abs(drive.error_rad) < math.radians(3)


def test_one_that_is_back_is_believed_after_a_turn_that_agrees() -> None:
    drive = Drive()
    drive.go(3.0, 0.0)
    drive.gyro_turns = False
    drive.quarter()
    drive.gyro_turns = True
    drive.go(10.0, 0.5)
    assert not drive.estimate.odometry.now.by_gyro
    drive.quarter()
    drive.go(1.0, 0.5)
    assert drive.estimate.odometry.now.by_gyro


def test_silence_of_the_phone_is_bridged_by_the_steering_angle_and_caught_up() -> None:
    drive = Drive(pot_scale=0.93)
    drive.go(3.0, 0.0)
    drive.late = 1.0
    drive.go(3.0, 0.3, math.radians(30))
    assert abs(drive.error_rad) > math.radians(0.5)
    drive.late = 0.1
    drive.go(1.0, 0.5)
    assert abs(drive.error_rad) < math.radians(0.5)


def test_a_machine_that_is_pushed_round_at_a_stand_does_not_teach_the_offset() -> None:
    drive = Drive()
    drive.go(4.0, 0.0)
    drive.offset = math.radians(20)  # somebody turns it, its wheels stand
    drive.go(9.0, 0.0)
    drive.offset = 0.0
    drive.go(20.0, 0.5)
    assert drive.estimate.odometry.now.by_gyro
    assert abs(drive.error_rad) < math.radians(1)


def test_an_offset_that_leaps_is_noticed_and_given_back_with_what_it_taught() -> None:
    drive = Drive()
    drive.go(3.0, 0.0)
    drive.go(10.0, 0.5)
    drive.offset = math.radians(5.0)
    drive.go(4.0, 0.5)
    assert not drive.estimate.odometry.now.by_gyro
    assert abs(drive.error_rad) < math.radians(1.5)
    assert abs(drive.estimate.odometry.trim_rad) < math.radians(0.3)


def test_one_whose_samples_keep_missing_is_not_counted_as_known() -> None:
    drive = Drive()
    drive.go(3.0, 0.0)
    drive.breaks = True
    drive.go(3.0, 0.5)
    assert not drive.estimate.odometry.now.by_gyro


def test_one_that_is_shaken_at_rest_is_not_taken_for_sure() -> None:
    quiet, shaken = Drive(), Drive()
    shaken.shake = math.radians(3.0)
    for drive in (quiet, shaken):
        drive.go(2.0, 0.0)
        drive.go(1.0, 0.5)
    assert quiet.estimate.odometry.now.by_gyro
    assert not shaken.estimate.odometry.now.by_gyro


@pytest.mark.parametrize("unknown_s", [0.0, 0.15])
def test_one_that_tells_late_of_a_turn_to_and_fro_is_believed(unknown_s: float) -> None:
    """A shuttle's S: while the machine turns back it still tells of the way out."""
    drive = Drive(late_s=0.2, unknown_s=unknown_s)
    drive.go(3.0, 0.0)
    for steer_deg in (48, -48):
        for _ in range(30):
            drive.go(0.1, -0.33, math.radians(steer_deg))
            assert not drive.estimate.odometry.gyroscope.contradicted
    drive.go(1.0, 0.0)
    assert drive.estimate.odometry.now.by_gyro


@pytest.mark.parametrize("shake_dps", [0.3, 2.0])
def test_what_the_machine_shakes_it_by_is_what_it_is_taken_to_err(shake_dps: float) -> None:
    """Of independent samples of 50 ms: that over the square root of a second."""
    drive = Drive()
    drive.go(4.0, 0.0)
    drive.shake = math.radians(shake_dps)
    drive.go(60.0, 0.5)
    expected = math.radians(shake_dps) * math.sqrt(STEP_S)
    assert drive.estimate.motion.gyro_noise == pytest.approx(expected, rel=0.25)


def test_a_scale_that_courses_contradict_is_taken_off() -> None:
    """Two per cent too much, a quarter of a turn at a time, with the receiver's course after each:
    the filter knows that it is the scale which errs."""
    drive = Drive()
    drive.scale = 1.02
    position = drive.estimate.position
    position.open(0.0, 0.0, 0.1, math.radians(1))
    drive.go(4.0, 0.0)
    for _ in range(8):
        for _ in range(30):
            drive.go(1.0, 0.5)
            off = drive.yaw - position.course_rad
            position.course(math.remainder(off, math.tau), 0.5)
        drive.quarter()
    before = drive.yaw, drive.estimate.motion.yaw_rad
    drive.quarter()
    turned = drive.yaw - before[0], drive.estimate.motion.yaw_rad - before[1]
    assert turned[1] == pytest.approx(turned[0], rel=0.01)


@pytest.mark.parametrize("pot_deg", [-4.0, 4.0])
def test_a_pot_whose_middle_is_off_from_the_start_contradicts_no_gyroscope(pot_deg: float) -> None:
    drive = Drive(pot_off_rad=math.radians(pot_deg))
    drive.go(3.0, 0.0)
    for _ in range(80):
        drive.go(0.1, 0.5)
        assert not drive.estimate.odometry.gyroscope.contradicted
    assert abs(drive.error_rad) < math.radians(1.0)
    assert drive.estimate.odometry.trim_rad == pytest.approx(math.radians(pot_deg), abs=0.01)


@pytest.mark.parametrize("driven", [-1.0, 1.0])
@pytest.mark.parametrize("back", [True, False])
def test_it_tells_which_way_a_machine_rolls_whose_wheels_are_turned(
    driven: float, back: bool
) -> None:
    """A braked machine creeps as slowly back as it does on, and one hall sensor counts both alike.
    Taken for the other way, it had turned a machine by twice what it turned."""
    drive = Drive()
    drive.go(3.0, 0.0)
    drive.go(2.0, 0.3 * driven)
    drive.go(0.8, 0.03 * driven, duty=0)
    rolls = -0.07 * driven if back else 0.07 * driven
    drive.go(3.0, rolls, math.radians(45), duty=0, driven=driven)
    assert not drive.estimate.odometry.gyroscope.contradicted
    assert drive.estimate.motion.distance_m == pytest.approx(drive.distance, abs=0.05)
    assert drive.estimate.motion.roll_doubt_m < 0.1, "from then on the way is known"
    drive.go(1.0, 0.0)
    assert abs(drive.error_rad) < math.radians(1.0)


def test_a_machine_that_runs_out_with_turned_wheels_and_comes_back_is_seen_to_do_both() -> None:
    drive = Drive()
    drive.go(3.0, 0.0)
    drive.go(2.0, 0.3)
    drive.go(1.0, 0.06, math.radians(45), duty=0)
    drive.go(3.0, 0.065, math.radians(45), duty=0)
    drive.go(3.0, -0.065, math.radians(45), duty=0, driven=1.0)
    assert drive.estimate.motion.distance_m == pytest.approx(drive.distance, abs=0.06)


def test_what_it_showed_of_a_machine_that_still_ran_out_tells_nothing_of_how_it_rolls_later() -> (
    None
):
    """On the lock it runs out, its wheels go straight, and only then it comes back."""
    drive = Drive()
    drive.go(3.0, 0.0)
    drive.go(2.0, 0.3, math.radians(45))
    drive.go(0.25, 0.2, math.radians(45), duty=0)
    drive.go(0.5, 0.03, duty=0)
    before = drive.error_m
    drive.go(3.0, -0.07, duty=0, driven=1.0)
    assert drive.error_m == pytest.approx(before, abs=0.05), "its speed tells"


def test_with_straight_wheels_it_tells_not_which_way_a_machine_rolls() -> None:
    """An offset has crept in: two degrees in some seconds."""
    drive = Drive()
    drive.go(3.0, 0.0)
    drive.go(2.0, 0.3)
    drive.go(0.5, 0.07, duty=0)
    drive.offset = math.radians(-0.5)
    drive.go(4.0, 0.07, math.radians(5.0), duty=0)
    assert drive.estimate.motion.distance_m == pytest.approx(drive.distance, abs=0.05)


def test_without_it_a_machine_that_rolled_back_has_turned_by_its_angle_of_then() -> None:
    """It is found out by its growing speed, when the wheels are on the lock already."""
    drive = Drive(late_s=math.inf)
    drive.go(2.0, -0.3)
    drive.go(0.4, -0.03, duty=0)
    drive.go(0.5, 0.05, duty=0, driven=-1.0)
    drive.go(0.5, 0.08, math.radians(45), duty=0, driven=-1.0)
    assert drive.estimate.motion.distance_m == pytest.approx(drive.distance, abs=0.03)
    assert abs(drive.error_rad) < math.radians(2.0)


def test_what_a_machine_turned_while_it_rolled_contradicts_no_gyroscope() -> None:
    """It is reckoned to have turned one way, and has turned the other; the phone tells late."""
    drive = Drive(late_s=0.5)
    drive.go(3.0, 0.0)
    drive.go(2.0, 0.3)
    drive.go(0.8, 0.12, duty=0)
    for _ in range(40):
        drive.go(0.05, -0.12, math.radians(45), duty=0, driven=1.0)
        assert not drive.estimate.odometry.gyroscope.contradicted
