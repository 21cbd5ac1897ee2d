"""Facts about the speed watch: it names a wheels' sensor that lies, and no honest one."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from host.core.messages import Fix, State, Telemetry
from host.core.vehicle import Vehicle
from host.estimate.speed_watch import SpeedWatch

V = Vehicle()
STEP_S = 0.05


@functools.cache
def duty_of(speed_mps: float) -> int:
    """The lowest drive duty that gives the speed on level ground."""
    return next(d for d in range(256) if V.duty_speed(d, 12.0) >= speed_mps)


def watched(
    counts: float,
    *,
    seconds: float = 30.0,
    duty_share: float = 1.0,
    receiver: bool = True,
    fitted: bool = True,
    angle_rad: float = 0.0,
    seed: int = 1,
) -> tuple[str, float]:
    """What the watch says of a sensor that counts this share of a true 0.5 m/s, and when."""
    watch, rng = SpeedWatch(V), np.random.default_rng(seed)
    duty = duty_of(0.5 / duty_share)
    for k in range(1, round(seconds / STEP_S)):
        t = k * STEP_S
        speed = counts * 0.5 if fitted else None
        told = Telemetry(t, State.RUNNING, 0, 0.0, angle_rad, 0, duty, True, speed, 0.0, 12.0, 0, 0)
        watch.take_telemetry(told)
        if receiver and k % 20 == 0:
            doppler = abs(0.5 + rng.normal(0, 0.06))
            watch.take_fix(Fix(t, 31.5, 74.3, 1, 0.8, 9, round(doppler, 2), 0.0), told)
        if watch.wrong:
            return watch.wrong, t
    return "", seconds


@pytest.mark.parametrize("duty_share", [0.5, 0.75, 1.0, 1.2])
@pytest.mark.parametrize("counts", [0.97, 1.0, 1.03])
def test_an_honest_sensor_is_believed_on_slopes_and_in_crop(
    counts: float, duty_share: float
) -> None:
    for seed in range(5):
        assert watched(counts, duty_share=duty_share, seed=seed)[0] == ""


def steady(duty: int, speed: float) -> tuple[str, float]:
    """What the watch says of a sensor that shows this speed at this drive duty, and when."""
    watch, seconds = SpeedWatch(V), 10.0
    for k in range(1, round(seconds / STEP_S)):
        t = k * STEP_S
        watch.take_telemetry(
            Telemetry(t, State.RUNNING, 0, 0.0, 0.0, 0, duty, True, speed, 0.0, 12.0, 0, 0)
        )
        if watch.wrong:
            return watch.wrong, t
    return "", seconds


def test_a_creep_up_a_steep_slope_is_believed() -> None:
    # The hillside's: 0.05 m/s where the duty would give 0.4 on level ground.
    duty = duty_of(0.4)
    assert steady(duty, 0.05)[0] == ""


def test_three_of_four_pulses_are_missed_within_seconds_without_a_receiver() -> None:
    # The firmware's speed loop has followed such a sensor to full duty.
    why, at = steady(255, V.full_duty_speed_mps / 4)
    assert "0.25 of the speed that the drive duty gives" in why
    assert at < 3.0


def test_half_of_the_pulses_are_missed_by_the_receiver_s_fourth_speed() -> None:
    assert watched(0.5)[1] < 11.0


@pytest.mark.parametrize("counts", [0.7, 0.8, 1.4])
def test_what_is_less_is_seen_by_the_receiver(counts: float) -> None:
    why, at = watched(counts)
    assert why.endswith("of the receiver's speed")
    assert float(why.split()[-5]) == pytest.approx(counts, rel=0.1)
    assert at < 30.0


def test_without_a_sensor_or_in_a_curve_nothing_is_said() -> None:
    assert watched(0.3, fitted=False)[0] == ""
    assert watched(0.8, angle_rad=0.6)[0] == ""


def unsteady(
    counts: float,
    smoothing_s: float,
    seed: int,
    go_s: float,
    rest_s: float,
    slow_mps: float,
    *,
    loaded: bool = False,
) -> tuple[str, float]:
    """The same of a machine that drives and slows down again and again, whose sensor shows whole
    pulses, and whose receiver speaks five times a second and smooths. `loaded`: a load slows it,
    not its drive."""
    watch, rng = SpeedWatch(V), np.random.default_rng(seed)
    true = smoothed = 0.0
    for k in range(1, round(90.0 / STEP_S)):
        t = k * STEP_S
        wanted = 0.5 if t % (go_s + rest_s) < go_s else slow_mps
        true += (wanted - true) * STEP_S / 0.3
        smoothed += (true - smoothed) * STEP_S / max(smoothing_s, STEP_S)
        pulse_mps = 0.06
        speed = pulse_mps * round((counts * true + rng.uniform(-0.03, 0.03)) / pulse_mps)
        duty = duty_of(0.5 if loaded else wanted)
        told = Telemetry(t, State.RUNNING, 0, 0.0, 0.0, 0, duty, True, speed, 0.0, 12.0, 0, 0)
        watch.take_telemetry(told)
        if k % 4 == 0:
            doppler = abs(smoothed + rng.normal(0, 0.06))
            watch.take_fix(Fix(t, 31.5, 74.3, 1, 0.8, 9, round(doppler, 2), 0.0), told)
        if watch.wrong:
            return watch.wrong, t
    return "", 90.0


@pytest.mark.parametrize("smoothing_s", [0.0, 1.5])
def test_pulses_that_are_lost_show_in_a_machine_that_stops_and_goes(smoothing_s: float) -> None:
    """With whole pulses the sensor never shows one speed for long."""
    for seed in range(5):
        why, at = unsteady(0.5, smoothing_s, seed, 6.0, 3.0, 0.0)
        assert why.endswith("of the receiver's speed")
        assert at < 16.0


@pytest.mark.parametrize(
    ("go_s", "rest_s", "slow_mps"), [(6.0, 3.0, 0.0), (1.5, 4.0, 0.2), (0.2, 20.0, 0.14)]
)
@pytest.mark.parametrize("smoothing_s", [0.0, 0.7, 1.5])
@pytest.mark.parametrize("counts", [0.97, 1.0, 1.03])
def test_an_honest_sensor_is_believed_whatever_the_speed_does(
    counts: float, smoothing_s: float, go_s: float, rest_s: float, slow_mps: float
) -> None:
    """A receiver that smooths shows more than is driven while the machine slows down, and now and
    then any receiver shows more than a creep."""
    for seed in range(10):
        assert unsteady(counts, smoothing_s, seed, go_s, rest_s, slow_mps)[0] == ""


@pytest.mark.parametrize(("go_s", "rest_s"), [(1.5, 4.0), (2.0, 2.0), (6.0, 3.0)])
def test_an_honest_sensor_is_believed_where_crop_slows_the_machine(
    go_s: float, rest_s: float
) -> None:
    for seed in range(10):
        assert unsteady(1.0, 1.5, seed, go_s, rest_s, 0.25, loaded=True)[0] == ""


@pytest.mark.parametrize("speed_mps", [0.2, 0.3, 0.36])
def test_an_honest_sensor_of_a_slow_machine_is_believed(speed_mps: float) -> None:
    """Of a receiver that errs a part of the fixes shows more, whatever limit one draws."""
    for seed in range(10):
        assert unsteady(1.0, 0.7, seed, 0.0, 90.0, speed_mps)[0] == ""


def ways(
    counted_mps: float,
    shown_mps: float,
    driven_mps: float,
    *,
    late_s: float = 0.0,
    rests_s: float = 0.0,
    quality: int = 1,
    seconds: float = 60.0,
) -> tuple[str, float]:
    """What the watch says of a sensor on the lock, where no speeds are compared, and how far the
    sensor has counted by then; `late_s`: that the receiver's own filter takes; `rests_s`: of each
    ten seconds the machine stands."""
    watch, shown, counted_m = SpeedWatch(V), 0.0, 0.0
    duty = next(d for d in range(256) if V.duty_speed(d, 12.0) >= driven_mps)
    for k in range(1, round(seconds / STEP_S)):
        t = k * STEP_S
        goes = t % 10.0 >= rests_s
        shown += (goes * shown_mps - shown) * min(1.0, STEP_S / late_s if late_s else 1.0)
        counted_m += goes * counted_mps * STEP_S
        told = Telemetry(
            t, State.RUNNING, 0, 0.0, 0.8, 0, goes * duty, True, goes * counted_mps, 0.0, 12.0, 0, 0
        )
        watch.take_telemetry(told)
        if k % 20 == 0:
            watch.take_fix(Fix(t, 31.5, 74.3, quality, 0.8, 9, shown, 0.0), told)
        if watch.wrong:
            return watch.wrong, counted_m
    return "", counted_m


@pytest.mark.parametrize(
    ("counted_mps", "true_mps", "driven_mps"), [(0.3, 0.05, 0.0), (0.5, 0.25, 0.34)]
)
def test_pulses_that_nothing_explains_are_named_within_metres_on_the_lock_too(
    counted_mps: float, true_mps: float, driven_mps: float
) -> None:
    """A sensor that counts while the machine stands, and one that counts double."""
    wrong, counted_m = ways(counted_mps, true_mps, driven_mps)
    assert wrong.startswith("the wheels' sensor has counted")
    assert counted_m < 6.0


@pytest.mark.parametrize("rests_s", [0.0, 5.0, 8.0])
@pytest.mark.parametrize("late_s", [0.0, 1.0, 2.0])
def test_a_receiver_that_is_late_makes_no_pulses_false(late_s: float, rests_s: float) -> None:
    """Not even where the drive, down a slope, explains none of them."""
    assert ways(0.5, 0.5, 0.0, late_s=late_s, rests_s=rests_s)[0] == ""


def test_a_receiver_without_a_fix_or_that_shows_no_creep_names_no_sensor() -> None:
    assert ways(0.5, 0.0, 0.0, quality=0)[0] == ""
    assert ways(0.15, 0.0, 0.0)[0] == ""


def test_a_receiver_that_hangs_names_no_sensor_that_the_drive_explains() -> None:
    assert ways(0.5, 0.0, 0.5)[0] == ""
