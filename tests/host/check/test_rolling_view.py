"""The camera's angles from what a rolling machine sees, on points drawn where they must appear."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from host.check.rolling_view import Rolled, delay_s, mounted
from host.core.vehicle import LOW, MAST, Mount
from host.vision.geometry import Camera

POINTS = 900
FRAMES = 13
STEP_M = 0.025


def scene() -> NDArray[np.float64]:
    """Ground at the right, stems with heads at the left."""
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0.5, 12.0, POINTS), rng.uniform(-4.0, 5.0, POINTS)
    return np.column_stack([x, y, np.where(y > 0.3, rng.uniform(0.2, 0.9, POINTS), 0.0)])


def pictures(
    true: Mount,
    sway_deg: float = 0.0,
    curve_1pm: float = 0.0,
    wind_m: float = 0.0,
    ways: Sequence[float] = tuple(k * STEP_M for k in range(FRAMES)),
) -> list[Rolled]:
    """What a camera mounted so sees after each of these ways, one each tenth of a second; over all
    of them the body rolls by sway_deg, and what stands higher than the camera leans to the left by
    wind_m."""
    camera, standing, out = Camera(true), scene(), []
    high = standing[:, 2] > true.z_m
    for k, way in enumerate(ways):
        points = standing.copy()
        points[high, 1] += wind_m * k / (len(ways) - 1)
        roll, yaw = math.radians(sway_deg) * k / (len(ways) - 1), curve_1pm * way
        c, s = math.cos(yaw), math.sin(yaw)
        ahead = points - np.array([way, curve_1pm * way**2 / 2, 0.0])
        ahead = ahead @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        c, s = math.cos(roll), math.sin(roll)
        ahead = ahead @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        grey = np.full((true.height_px, true.width_px), 90.0)
        rng = np.random.default_rng(2)
        for (u, v), light in zip(camera.project(ahead), rng.uniform(-80, 150, POINTS), strict=True):
            if 6 < u < true.width_px - 6 and 6 < v < true.height_px - 6:
                i, j = round(v), round(u)
                dv, du = np.mgrid[i - 4 : i + 5, j - 4 : j + 5]
                grey[i - 4 : i + 5, j - 4 : j + 5] += light * np.exp(
                    -((dv - v) ** 2 + (du - u) ** 2) / 3
                )
        out.append(Rolled(0.1 * k, way, grey.clip(0, 255).astype(np.uint8)))
    return out


@pytest.mark.parametrize(
    ("off", "sway_deg", "curve_1pm"),
    [({"yaw_deg": 5.0, "pitch_deg": -4.0}, 1.0, 0.02), ({}, -1.0, 0.0)],
)
def test_a_camera_that_is_turned_is_told_from_a_body_that_sways_and_a_way_that_bends(
    off: dict[str, float], sway_deg: float, curve_1pm: float
) -> None:
    true = MAST.model_copy(update={key: getattr(MAST, key) + by for key, by in off.items()})
    found = mounted(pictures(true, sway_deg, curve_1pm), MAST)
    assert found is not None
    assert found.yaw_deg == pytest.approx(off.get("yaw_deg", 0.0), abs=1.0)
    assert found.pitch_deg == pytest.approx(off.get("pitch_deg", 0.0), abs=1.0)


def test_a_way_too_short_tells_nothing() -> None:
    assert mounted(pictures(MAST)[:5], MAST) is None


def test_ears_that_the_wind_moves_above_the_camera_do_not_turn_it() -> None:
    found = mounted(pictures(LOW, wind_m=0.15), LOW)
    assert found is not None
    assert found.yaw_deg == pytest.approx(0.0, abs=0.5)
    assert found.pitch_deg == pytest.approx(0.0, abs=1.0)


SPEED_MPS = 0.2
RESTS_S = 1.2


def rolled_m(t: float) -> float:
    """Rests, and then rolls."""
    return max(0.0, t - RESTS_S) * SPEED_MPS


@pytest.mark.parametrize(("late_s", "pulses_per_m"), [(0.1, 100.0), (0.3, 100.0), (0.3, 20.0)])
def test_the_delay_is_that_of_the_pictures_and_not_of_a_coarse_sensor(
    late_s: float, pulses_per_m: float
) -> None:
    shown = pictures(MAST, ways=[rolled_m(0.1 * k) for k in range(45)])
    arrived = [(picture.stamp + late_s, picture.grey) for picture in shown]
    # on average the first pulse comes after half of the way between two
    stamps = [0.05 * k for k in range(100)]
    ways = [(t, math.floor(rolled_m(t) * pulses_per_m + 0.5) / pulses_per_m) for t in stamps]
    half_a_pulse_s = 0.5 / (SPEED_MPS * pulses_per_m)
    assert delay_s(arrived, ways, MAST) == pytest.approx(late_s, abs=0.02 + half_a_pulse_s)


def test_pictures_that_roll_before_the_wheels_do_tell_no_delay() -> None:
    shown = pictures(MAST, ways=[rolled_m(0.1 * k) for k in range(45)])
    arrived = [(picture.stamp - 0.6, picture.grey) for picture in shown]
    ways = [(0.05 * k, rolled_m(0.05 * k)) for k in range(100)]
    assert delay_s(arrived, ways, MAST) is None
