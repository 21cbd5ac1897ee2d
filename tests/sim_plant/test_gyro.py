"""The simulated phone's gyroscope against a rotation that scipy makes."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim_plant.gyro import GRAVITY, Gyro, GyroSpec, sensors_json

CLEAN = GyroSpec(
    noise_dps=0, offset_dps=0, walk_dps=0, scale_error=0, vibration_dps=0, force_zero_mps2=0
)
UPRIGHT_TO_VEHICLE = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
"""Columns: x, y, z of a phone on its side, its camera looking ahead, in the vehicle's frame:
up, left, back (Android, sensor coordinate system)."""


@pytest.mark.parametrize("pitch_deg", [0.0, 14.0, 30.0])
def test_it_turns_about_the_phones_axes_as_the_phone_is_mounted(pitch_deg: float) -> None:
    down = Rotation.from_euler("y", pitch_deg, degrees=True)
    axes = down.as_matrix() @ UPRIGHT_TO_VEHICLE
    sample = Gyro(CLEAN, 1, math.radians(pitch_deg)).sample(3.0, 0.4, 0.0, 0.0, 0.5)
    assert sample.rate_radps == pytest.approx(axes.T @ [0.0, 0.0, 0.4])
    assert sample.force_mps2 == pytest.approx(axes.T @ [0.0, 0.0, GRAVITY], abs=0.1)


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(4.0, 0.0), (0.0, 5.0), (-3.0, -6.0)])
def test_the_accelerometer_shows_how_the_machine_stands(roll_deg: float, pitch_deg: float) -> None:
    """As `Field.slopes` and the machine's weight have it: the left side up, and the nose down."""
    stands = Rotation.from_euler("YX", [pitch_deg, roll_deg], degrees=True).as_matrix()
    axes = stands @ UPRIGHT_TO_VEHICLE
    roll, pitch = math.radians(roll_deg), math.radians(pitch_deg)
    sample = Gyro(CLEAN, 1, 0.0).sample(3.0, 0.0, roll, pitch, 0.0)
    assert sample.force_mps2 == pytest.approx(axes.T @ [0.0, 0.0, GRAVITY], abs=0.1)


def test_its_offset_is_drawn_and_wanders() -> None:
    spec = CLEAN.model_copy(update={"offset_dps": 0.5, "walk_dps": 0.01})
    rest = np.array(
        [[Gyro(spec, seed, 0.0).sample(0, 0, 0, 0, 0).rate_radps[0]] for seed in range(300)]
    )
    assert math.degrees(rest.std()) == pytest.approx(0.5, rel=0.15)
    gyro = Gyro(spec.model_copy(update={"offset_dps": 0.0}), 1, 0.0)
    rates = [gyro.sample(k / 50, 0, 0, 0, 0).rate_radps for k in range(50 * 100)]
    ends = np.degrees(np.array(rates)[[0, -1]])
    assert 0.01 < np.abs(ends[1] - ends[0]).max() < 0.4


def test_a_moving_machine_shakes_it_and_a_standing_one_does_not() -> None:
    gyro = Gyro(CLEAN.model_copy(update={"vibration_dps": 1.0}), 1, 0.0)
    stands = [gyro.sample(k / 50, 0, 0, 0, 0.0).rate_radps[0] for k in range(200)]
    moves = [gyro.sample(4 + k / 50, 0, 0, 0, 0.5).rate_radps[0] for k in range(200)]
    assert np.std(stands) == 0.0
    assert math.degrees(np.std(moves)) == pytest.approx(1.0, rel=0.2)


def test_its_accelerometer_shows_too_much_of_each_axis_and_always_as_much() -> None:
    spec = CLEAN.model_copy(update={"force_zero_mps2": 0.2})
    forces = [
        [Gyro(spec, seed, 0.0).sample(t, 0, 0, 0, 0).force_mps2 for t in (0.0, 9.0)]
        for seed in range(300)
    ]
    off = np.array(forces)[:, 0] - [GRAVITY, 0.0, 0.0]
    assert off.std(axis=0) == pytest.approx([0.2, 0.2, 0.2], rel=0.15)
    assert np.array(forces)[:, 1] == pytest.approx(np.array(forces)[:, 0], abs=0.1)


def test_noises_of_rate_and_force_are_strangers_to_each_other() -> None:
    gyro = Gyro(CLEAN.model_copy(update={"noise_dps": 0.5}), 1, 0.0)
    samples = [gyro.sample(k / 50, 0, 0, 0, 0.0) for k in range(2000)]
    values = np.array([[*s.rate_radps, *s.force_mps2] for s in samples])
    assert np.abs(np.corrcoef(values.T) - np.eye(6)).max() < 0.1


def test_the_same_seed_gives_the_same_samples() -> None:
    one, other = (Gyro(GyroSpec(), 7, 0.2) for _ in range(2))
    assert [one.sample(t, 0.1, 0, 0, 1) for t in range(9)] == [
        other.sample(t, 0.1, 0, 0, 1) for t in range(9)
    ]


def test_an_answer_has_the_apps_form() -> None:
    gyro = Gyro(CLEAN, 1, 0.0)
    told = json.loads(
        sensors_json([gyro.sample(0.0, 0.1, 0, 0, 0), gyro.sample(0.02, 0.1, 0, 0, 0)])
    )
    (first, rates), (second, _) = told["gyro"]["data"]
    assert second - first == 20  # milliseconds
    assert rates == pytest.approx([0.1, 0.0, 0.0])
    assert told["gyro"]["unit"] == "rad/s"
    assert len(told["accel"]["data"]) == 2
