"""Facts about the direction check: swapped wires are found, a slow receiver is not blamed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.messages import Fix
from host.estimate.course_check import AVERAGED, DirectionCheck
from host.estimate.odometry import Motion


def motion(distance_m: float, speed_mps: float) -> Motion:
    return Motion(0.0, speed_mps, 0.0, distance_m, 0.0, 0.0, 0.0)


def fix(speed_mps: float | None, course_rad: float | None, quality: int = 1) -> Fix:
    return Fix(0.0, 31.5, 74.3, quality, 1.0, 8, speed_mps, course_rad)


def driven(
    seconds: int, speed_mps: float, along_mps: float, heading_rad: float = 0.3
) -> list[bool]:
    """What the check says at each second's fix of a drive at a reckoned speed, while the receiver
    sees another along the heading."""
    check, out, distance = DirectionCheck(), [], 0.0
    for _ in range(seconds):
        for _ in range(10):
            distance += speed_mps / 10
            check.move(motion(distance, speed_mps))
        course = heading_rad if along_mps >= 0 else heading_rad + math.pi
        seen = fix(abs(along_mps), course)
        out.append(check.contradicted(seen, motion(distance, speed_mps), heading_rad))
    return out


@pytest.mark.parametrize("speed", [0.5, 0.3, -0.3])
def test_swapped_wires_are_found_after_a_metre_and_two_fixes(speed: float) -> None:
    said = driven(8, speed, -speed)
    first = said.index(True)
    assert abs(speed) * first >= 1.0
    assert abs(speed) * first <= 1.0 + 2 * abs(speed)


@given(
    st.sampled_from([0.5, 0.3, -0.3]),
    st.floats(-0.3, 0.3),
    st.floats(-math.pi, math.pi),
)
def test_what_moves_as_it_is_told_is_never_blamed(speed: float, noise: float, yaw: float) -> None:
    assert not any(driven(10, speed, speed + noise * abs(speed), yaw))


def test_a_receiver_that_is_two_seconds_late_is_not_blamed_at_a_change_of_direction() -> None:
    check, distance = DirectionCheck(), 0.0
    past = [0.3] * 30 + [-0.3] * 60
    for k, speed in enumerate(past):
        distance += speed / 10
        check.move(motion(distance, speed))
        if k % 10 == 0:
            seen = past[max(0, k - 20)]
            course = 0.0 if seen > 0 else math.pi
            assert not check.contradicted(fix(abs(seen), course), motion(distance, speed), 0.0)


def courses(off_rad: float, noise_rad: float, seconds: int = 120) -> DirectionCheck:
    """After a straight drive whose courses are off, and noisy."""
    check, distance, rng = DirectionCheck(), 0.0, np.random.default_rng(3)
    for _ in range(seconds):
        distance += 0.5
        check.move(motion(distance, 0.5))
        course = 0.3 + off_rad + rng.normal(0.0, noise_rad)
        check.contradicted(fix(0.5, course), motion(distance, 0.5), 0.3)
    return check


@pytest.mark.parametrize("noise_deg", [0.0, 8.0, 20.0])
def test_a_machine_that_drives_askew_of_what_it_believes_is_found(noise_deg: float) -> None:
    found = courses(math.radians(-14), math.radians(noise_deg)).askew_rad
    assert math.degrees(found) == pytest.approx(-14, abs=6)


@pytest.mark.parametrize("off_deg", [0.0, 4.0])
@pytest.mark.parametrize("noise_deg", [0.0, 8.0, 20.0, 60.0])
def test_noise_and_small_angles_are_not_askew(off_deg: float, noise_deg: float) -> None:
    assert courses(math.radians(off_deg), math.radians(noise_deg)).askew_rad == 0.0


def test_what_a_machine_has_found_of_its_direction_since_is_over() -> None:
    """Put down along an arc 30 degrees askew, it finds that within half a minute of driving."""
    check, mean_deg = DirectionCheck(), 0.0
    for k in range(60):
        off_deg = max(2.0, 30.0 - 0.8 * k)
        mean_deg += off_deg / 60
        at = motion(0.5 * (k + 3), 0.5)
        check.move(at)
        check.contradicted(fix(0.5, 0.3 + math.radians(off_deg)), at, 0.3)
    assert mean_deg > 8.0
    assert check.askew_rad == 0.0


@pytest.mark.parametrize("noise_deg", [0.0, 8.0, 20.0])
@pytest.mark.parametrize("off_deg", [90.0, -90.0, 150.0])
def test_a_machine_at_another_corner_is_found_within_metres(
    off_deg: float, noise_deg: float
) -> None:
    noise = math.radians(noise_deg)
    assert courses(math.radians(off_deg), noise, seconds=4).askew_rad == 0.0
    found = courses(math.radians(off_deg), noise, seconds=12).askew_rad
    assert math.degrees(found) == pytest.approx(off_deg, abs=25)


@pytest.mark.parametrize(
    ("off_deg", "may"), [(-10.0, True), (0.0, False), (14.0, False), (90.0, False)]
)
def test_strips_turn_by_degrees_and_not_at_once(off_deg: float, may: bool) -> None:
    assert courses(math.radians(off_deg), 0.0).may_have_turned is may


@pytest.mark.parametrize(("fixes", "may"), [(AVERAGED - 1, False), (AVERAGED, True)])
def test_courses_that_lie_askew_again_at_once_show_no_strips_that_have_turned(
    fixes: int, may: bool
) -> None:
    check, off_rad = courses(math.radians(-14.0), 0.0), math.radians(10.0)
    check.forget()
    assert check.askew_rad == 0.0
    for k in range(fixes):
        at = motion(100.0 + 0.5 * k, 0.5)
        check.move(at)
        check.contradicted(fix(0.5, off_rad), at, 0.0)
    assert check.askew_rad == pytest.approx(off_rad)
    assert check.may_have_turned is may


def test_a_few_fixes_and_those_in_turns_say_nothing_of_it() -> None:
    assert courses(math.radians(30), 0.0, seconds=20).askew_rad == 0.0
    check = DirectionCheck()
    for k in range(200):
        turning = Motion(0.0, 0.5, 0.5, 0.5 * k, 0.0, 0.0, 0.0)
        check.move(turning)
        check.contradicted(fix(0.5, 0.5), turning, 0.0)
    assert check.askew_rad == 0.0


@pytest.mark.parametrize("seen", [fix(None, math.pi), fix(0.5, None), fix(0.5, math.pi, quality=0)])
def test_a_fix_without_speed_or_course_says_nothing(seen: Fix) -> None:
    check = DirectionCheck()
    check.move(motion(0.1, 0.5))
    assert not any(check.contradicted(seen, motion(5.0, 0.5), 0.0) for _ in range(5))


def test_at_a_crawl_a_course_says_nothing() -> None:
    assert not any(driven(30, 0.15, -0.15))


def test_one_wrong_fix_is_not_enough() -> None:
    check = DirectionCheck()
    check.move(motion(0.1, 0.5))
    wrong, right = fix(0.5, math.pi), fix(0.5, 0.0)
    now = motion(5.0, 0.5)
    assert [check.contradicted(f, now, 0.0) for f in (wrong, right, wrong, right, wrong)] == [
        False
    ] * 5
