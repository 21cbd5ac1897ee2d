"""What is wrong with a camera shows in its pictures as it should, and only where it is asked."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError

from sim_plant.camera import MAST, Camera
from sim_plant.disturbance import DisturbanceSpec, Lens, Shake, hunting, white_balance
from sim_plant.field import Field
from sim_plant.field_spec import FieldSpec
from sim_plant.sky import WeatherSpec

SPEC = FieldSpec(size_m=(8.0, 6.0), bare=0, thin=0)
POSE = (0.3, 1.0, 1.5, 0.0)
MORNING = WeatherSpec(hour=8.0, dust=0.0)
"""The sun in the east, ahead of `POSE`."""


@cache
def field() -> Field:
    half_cut = Field(SPEC, 1)
    half_cut.clear(((-1, -1), (9, -1), (9, 1), (-1, 1)))
    return half_cut


def picture(pose: tuple[float, ...] = POSE, **wrong: Any) -> NDArray[np.uint8]:
    lens = MAST.model_copy(update={"disturbance": DisturbanceSpec(**wrong), "noise": 0.0})
    return Camera(field(), lens, MORNING, seed=1, threads=1).capture(*pose)


@cache
def sound() -> NDArray[np.uint8]:
    return picture()


def times(count: int = 400, step_s: float = 0.1) -> list[float]:
    return [step_s * k for k in range(count)]


@pytest.mark.parametrize(
    "wrong",
    [
        {"white_balance_mired": 60.0},
        {"hunting_ev": 1.0},
        {"flare": 0.5},
        {"spots": 0.1},
        {"straws": 3},
        {"mud": 0.1},
        {"shake_deg": 0.5},
    ],
)
def test_each_shows_and_repeats(wrong: dict[str, float]) -> None:
    shown = picture(**wrong)
    assert np.array_equal(shown, picture(**wrong))
    assert np.abs(shown.astype(int) - sound()).mean() > 1.0


def test_what_is_off_changes_no_bit() -> None:
    assert np.array_equal(sound(), picture(shake_hz=50.0, hunting_s=3.0, white_balance_s=2.0))


def test_white_balance_drifts_to_either_side_and_not_in_brightness() -> None:
    spec = DisturbanceSpec(white_balance_mired=60.0)
    drawn = np.array([white_balance(spec, 1, t) for t in times(4000)])
    ratio = drawn[:, 2] / drawn[:, 0]
    assert ratio.min() < 0.88
    assert ratio.max() > 1.12
    assert np.abs(drawn[:, 1] - 1).max() < 0.15
    assert np.abs(np.diff(ratio)).max() < 0.1


def test_a_colder_guess_of_noon_shows_as_much_as_plancks_law_says() -> None:
    """The colour of 4300 K against that of 5500 K, red over blue, in linear light."""
    spec = DisturbanceSpec(white_balance_mired=50.0)
    most = max(white_balance(spec, 1, t)[2] / white_balance(spec, 1, t)[0] for t in times(4000))
    bound = math.exp(1.4388e-2 * 50e-6 * (1 / 465e-9 - 1 / 610e-9)) ** (1 / 2.2)
    assert bound * 0.93 < most < bound * 1.01


def test_hunting_swings_by_the_stops_that_are_asked_for() -> None:
    stops = 2.2 * np.log2([hunting(DisturbanceSpec(hunting_ev=0.7), 1, t) for t in times()])
    assert stops.max() == pytest.approx(0.7, abs=0.1)
    assert stops.min() == pytest.approx(-0.7, abs=0.1)


def test_flare_needs_the_sun_before_the_lens() -> None:
    away = (0.3, 4.0, 1.5, math.pi)
    assert np.array_equal(picture(away, flare=1.0), picture(away))


def test_flare_takes_contrast() -> None:
    assert picture(flare=1.0).std() < 0.6 * sound().std()


def test_mud_hides_the_share_that_is_asked_for() -> None:
    looks = np.zeros((240, 320, 2), np.float32)
    lens = Lens(DisturbanceSpec(mud=0.2), looks, 300.0, 1)
    seen = lens(np.full((240, 320, 3), 200, np.uint8), np.array([0.0, 0.0, -1.0]), 1.0)
    assert (seen.max(2) < 150).mean() == pytest.approx(0.2, abs=0.06)


def test_a_mount_at_rest_moves_nothing() -> None:
    field = np.arange(48 * 64 * 3, dtype=np.uint8).reshape(48, 64, 3)
    spec = DisturbanceSpec(shake_deg=1e-9)
    assert np.array_equal(Shake(spec, (64, 48), 60.0, 0.02, 0.004, 1)(field, 1.0), field)


def test_rows_shift_by_the_angle_at_their_time() -> None:
    """A thin upright line, half a swing between the first and the last row."""
    height, width, focal = 200, 160, 400.0
    spec = DisturbanceSpec(shake_deg=0.5, shake_hz=25.0)
    shake = Shake(spec, (width, height), focal, readout_s=0.02, shutter_s=0.0, seed=3)
    line = np.zeros((height, width, 3), np.uint8)
    line[:, 80] = 240
    weight = shake(line, 2.0)[..., 0].astype(float)
    seen = (weight * np.arange(width)).sum(1) / weight.sum(1)
    rows = 2.0 + ((np.arange(height) + 0.5) / height - 0.5) * 0.02
    right, _, around = shake.turned_rad(rows).T
    lever = np.arange(height) - height / 2
    assert np.abs(seen - (80 - focal * right + lever * around)).max() < 0.3
    assert np.ptp(seen) > 3.0


def test_a_longer_exposure_blurs_what_shakes() -> None:
    spec = DisturbanceSpec(shake_deg=0.5)
    line = np.zeros((64, 160, 3), np.uint8)
    line[:, 80] = 240
    sharp, blurred = (
        Shake(spec, (160, 64), 400.0, 0.02, s, 3)(line, 2.0).max(1).mean() for s in (0.0, 0.02)
    )
    assert blurred < 0.7 * sharp


@pytest.mark.parametrize(
    ("wrong", "where"),
    [({"mud": 0.9}, "mud"), ({"straws": -1}, "straws"), ({"fog": 1.0}, "fog")],
)
def test_what_no_camera_has_is_refused(wrong: dict[str, float], where: str) -> None:
    with pytest.raises(ValidationError, match=where):
        DisturbanceSpec.model_validate(wrong)
