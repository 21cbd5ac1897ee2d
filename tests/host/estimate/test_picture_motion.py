"""Facts about pictures against motion: what does not move as the machine does is named, whichever
way it is wrong, and no good camera is accused."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.core.vehicle import Vehicle
from host.estimate.odometry import Motion
from host.estimate.picture_motion import PictureMotion
from host.vision.view import NAN, CropView

PICTURE_S = 0.1
SPEED_MPS, TURN_RADPS = 0.5, math.radians(15.0)
Shows = Callable[[Motion, Motion], tuple[float, float]]
"""(turn, way) that a picture shows of the motion since the one before."""


def driven(straight_s: float = 20.0) -> Iterator[Motion]:
    """A stand, a side, a turn by 90 degrees and another side, picture by picture."""
    at, x, y, yaw = 0.0, 0.0, 0.0, 0.0
    for k in range(round((2 * straight_s + 12.0) / PICTURE_S)):
        t = k * PICTURE_S
        speed = SPEED_MPS if t > 3.0 else 0.0
        rate = TURN_RADPS if 3.0 + straight_s < t <= 9.0 + straight_s else 0.0
        step = speed * PICTURE_S
        at, yaw = at + step, yaw + rate * PICTURE_S
        x, y = x + step * math.cos(yaw), y + step * math.sin(yaw)
        yield Motion(t, speed, 0.0, at, yaw, x, y, 0.001)


def as_it_is(before: Motion, now: Motion) -> tuple[float, float]:
    return now.yaw_rad - before.yaw_rad, now.distance_m - before.distance_m


def watched(
    shows: Shows = as_it_is,
    *,
    late: int = 0,
    same_ago: Callable[[int], int] = lambda _: 0,
    usable: Callable[[int], bool] = lambda _: True,
    turn_error: float = 0.0,
    gain: tuple[float, float] = (1.0, 1.0),
    motions: list[Motion] | None = None,
    seed: int = 0,
) -> tuple[str, Motion]:
    """What the watch says, and where; each picture comes so many pictures `late`."""
    watch, rng = PictureMotion(Vehicle()), np.random.default_rng(seed)
    motions = motions or list(driven())
    for k, motion in enumerate(motions):
        before, now = (motions[max(0, k - late - more)] for more in (1, 0))
        turn, way = shows(before, now)
        turn = gain[0] * turn + rng.normal(0.0, turn_error)
        view = CropView(
            0.9,
            shown_turn_rad=turn,
            shown_way_m=gain[1] * way,
            same_ago=same_ago(k),
            usable=usable(k),
        )
        watch.take(view, motion)
        if watch.wrong:
            return watch.wrong, motion
    return "", motions[-1]


@settings(max_examples=25, deadline=None)
@given(
    st.floats(0.65, 1.25), st.floats(0.3, 2.5), st.floats(0.0, 0.005), st.integers(0, 2),
    st.integers(0, 9),
)  # fmt: skip
def test_a_good_camera_is_not_accused(
    turn_gain: float, way_gain: float, turn_error: float, late: int, seed: int
) -> None:
    """Whatever crop makes of the way, with what pictures err, and a delay said wrong by 0.2 s."""
    found = watched(gain=(turn_gain, way_gain), turn_error=turn_error, late=late, seed=seed)
    assert found[0] == ""


def test_a_hanging_stream_is_named_within_half_a_metre() -> None:
    wrong, at = watched(same_ago=lambda k: max(0, min(100, k - 120)))
    assert "hangs" in wrong and "restart the phone's camera app" in wrong
    assert at.distance_m - (12.0 - 3.0) * SPEED_MPS < 0.6


def test_a_loop_is_named_though_it_moves_as_the_machine_does() -> None:
    wrong, at = watched(same_ago=lambda k: 30 if k >= 150 else 0)
    assert "they show again what they showed 1.5 m before" in wrong
    assert at.stamp < 15.5


def test_all_pictures_of_a_stand_are_the_same_and_so_are_those_from_a_place_come_back_to() -> None:
    stand = [Motion(0.1 * k, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) for k in range(200)]
    assert watched(motions=stand, same_ago=lambda k: min(k, 100))[0] == ""
    to_and_fro = [
        Motion(0.1 * k, 0.5, 0.0, 0.05 * k, 0.0, 0.05 * min(k, 60 - k), 0.0) for k in range(60)
    ]
    back = watched(motions=to_and_fro, same_ago=lambda k: 2 * (k - 30) if k > 30 else 0)
    assert back[0] == ""


def test_a_sensor_that_counts_with_the_drive_off_accuses_no_camera() -> None:
    rolls = [Motion(0.1 * k, 0.5, 0.0, 0.05 * k, 0.0, 0.05 * k, 0.0, rolls=True) for k in range(60)]
    assert watched(gain=(1.0, 0.0), motions=rolls, same_ago=lambda k: k)[0] == ""


def test_a_ground_that_stands_still_or_goes_away_is_named_within_a_metre() -> None:
    for share, why in ((0.0, "stood still"), (-0.3, "upside down")):
        wrong, at = watched(gain=(1.0, share))
        assert why in wrong and "camera" in wrong
        assert at.distance_m < 1.2


def test_ways_that_differ_from_step_to_step_accuse_no_camera() -> None:
    """Before a low camera the crop's face hides most of the ground. Over the last metre these show
    less than nothing (picture field 10321)."""
    shares = (0.5, 0.8, 0.5, 0.4, 0.2, 0.7, 0.4, 1.2, 1.0, 0.9, 0.2, 0.15, -0.5, -0.2)

    def shown(a: Motion, b: Motion) -> tuple[float, float]:
        share = shares[int(b.stamp / 0.5) % len(shares)]
        return b.yaw_rad - a.yaw_rad, share * (b.distance_m - a.distance_m)

    assert watched(shown)[0] == ""


def test_pulses_that_are_lost_while_the_machine_backs_accuse_no_camera() -> None:
    """Between them the sensor shows no speed, so no direction either."""
    backs = [
        Motion(0.1 * k, -0.3 if k % 4 == 0 else 0.0, 0.0, -0.12 * (k // 4), 0.0, 0.0, 0.0)
        for k in range(200)
    ]
    assert watched(lambda a, b: (0.0, -0.03 * (b.stamp > a.stamp)), motions=backs)[0] == ""


def test_a_mirrored_picture_is_named_early_in_the_first_turn() -> None:
    wrong, at = watched(lambda a, b: (a.yaw_rad - b.yaw_rad, b.distance_m - a.distance_m))
    assert "mirrored" in wrong and math.degrees(at.yaw_rad) < 25.0


@pytest.mark.parametrize("late", [5, 9, 15, 30])
def test_pictures_that_come_late_are_named_with_how_late_in_the_first_turn(late: int) -> None:
    wrong, at = watched(late=late)
    if late < 20:
        said = float(wrong.split("pictures come ")[1].split(" s")[0])
        assert said == pytest.approx(0.1 + 0.1 * late, abs=0.2)
        assert 20.0 < math.degrees(at.yaw_rad) <= 90.1
    else:
        assert "comes late" in wrong and at.distance_m < 1.2, "they stand still as it starts"


def test_pictures_of_another_place_are_named_where_the_gyroscope_tells_of_the_turn() -> None:
    def none_turns(a: Motion, b: Motion) -> tuple[float, float]:
        return 0.0, b.distance_m - a.distance_m

    assert "the phone is loose" in watched(none_turns)[0]
    by_angle = [
        Motion(m.stamp, m.speed_mps, 0.0, m.distance_m, m.yaw_rad, m.x_m, m.y_m) for m in driven()
    ]
    assert watched(none_turns, motions=by_angle)[0] == "", "or the potentiometer is wrong"


NEAR_TURNED = """
0.4 1 1.4 3 0.7 3.2 2 0.8 3.3 0.6 1.5 1.2 2.2 -0.2 0.9 0.9 2.1 -0.4 0.9 2.1 -0.4 0.9 2.2
0.9 -0.4 0.9 2.2 -0.4 0.9 1 2.2 -0.3 0.9 1 2.2 -0.3 0.9 1 2.3 -0.3 0.9 0.9 2.2 -0.3 0.9
1 1.1 1.3 2.9 1.8 2 0.8 3.3 0.6 1.2 1.5 -0.6 0.1 -0 0
"""
NEAR_SHOWN = """
0.8 1 1.8 2 2 2.1 2 2 1.5 1.5 1.2 1.2 0.9 1 0.7 0.9 1 1 1.1 0.9 1 1.1 1 1.1 0.9 1.1 1
1.1 1.1 1.2 0.9 1.1 1.2 1.1 1.2 1 1.1 0.9 1.3 1.4 1.6 - 1.2 1.1 1.2 1.4 - 2.9 - - -4.4
2.2 - - 6.8 3.8 1.2 0.3 0 -0
"""
"""A low camera's turn at a corner, deg a picture: as its end crop comes before the lens, after
pictures that show nothing (-), and shifts by five times what the machine turns (random field
10001)."""


def test_near_crop_that_shifts_by_more_than_the_turn_accuses_no_camera() -> None:
    turned = [0.0] * 50 + [float(v) for v in NEAR_TURNED.split()] + [0.0] * 20
    shown = [0.0] * 50 + [NAN if v == "-" else float(v) for v in NEAR_SHOWN.split()] + [0.0] * 20
    yaw = np.radians(np.cumsum(turned))
    motions = [
        Motion(0.1 * k, 0.15, 0.0, 0.015 * k, float(y), 0.015 * k, 0.0, 0.001)
        for k, y in enumerate(yaw)
    ]

    def shows(a: Motion, b: Motion) -> tuple[float, float]:
        return math.radians(shown[round(b.stamp / 0.1)]), b.distance_m - a.distance_m

    assert watched(shows, motions=motions)[0] == ""


def test_what_pictures_drift_by_while_the_machine_stands_hides_none_of_its_way() -> None:
    """A drive in short pieces, with long stands between, whose pictures drift backwards."""
    at, motions = 0.0, []
    for k in range(1500):
        speed = SPEED_MPS if k % 150 < 10 else 0.0
        at += speed * PICTURE_S
        motions.append(Motion(k * PICTURE_S, speed, 0.0, at, 0.0, at, 0.0))

    def drifts(a: Motion, b: Motion) -> tuple[float, float]:
        way_m = b.distance_m - a.distance_m
        return 0.0, way_m if way_m > 0.0 else -0.005

    assert watched(drifts, motions=motions)[0] == ""


def test_pictures_that_are_not_believed_tell_nothing() -> None:
    hangs = watched(same_ago=lambda k: max(0, k - 120), usable=lambda k: k < 122)
    assert hangs[0] == "", "the machine stands for that, and goes on by itself"
    by_turns = watched(gain=(1.0, 0.0), usable=lambda k: k % 2 == 0)
    assert by_turns[0] == "", "what a picture shows since one that is not believed"
    dark = watched(gain=(1.0, NAN))
    assert dark[0] == ""


def test_stems_right_before_the_lens_tell_of_no_motion() -> None:
    """They pass by otherwise than the ground does (random field 10132)."""
    watch = PictureMotion(Vehicle())
    for before, now in itertools.pairwise(driven()):
        shown_rad = -3.0 * (now.yaw_rad - before.yaw_rad)
        view = CropView(0.0, hidden=True, shown_turn_rad=shown_rad, shown_way_m=0.0)
        watch.take(view, now)
    assert watch.wrong == ""


def test_a_way_that_a_sharp_turn_hides_accuses_no_camera() -> None:
    """A shuttle's turns, to and fro on the lock: what a low camera sees shifts by the turn alone
    (random field 10107)."""
    at, yaw, motions = 0.0, 0.0, []
    for k in range(300):
        way = 1.0 if k % 60 < 30 else -1.0
        at, yaw = at + 0.02 * way, yaw + way * math.radians(2.0)
        motions.append(Motion(k * PICTURE_S, 0.2 * way, 0.0, at, yaw, at, 0.0, 0.001))

    assert watched(lambda a, b: (b.yaw_rad - a.yaw_rad, 0.0), motions=motions)[0] == ""
