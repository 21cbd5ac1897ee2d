"""Facts about what a taped drive and a weaving drive tell."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from host.core.errors import UserError
from host.tune.camera_delay import delay_of, shift_px
from host.tune.taped_drive import taped_drive


@pytest.mark.parametrize("off_deg", [-2.0, 0.0, 1.5])
@pytest.mark.parametrize("true_ppm", [45.0, 50.0, 100.0])
def test_a_taped_drive_tells_wheels_and_steering(off_deg: float, true_ppm: float) -> None:
    way, wheelbase = 10.0, 1.0
    bend = math.tan(math.radians(off_deg)) / wheelbase
    along = math.sin(bend * way) / bend if bend else way
    aside = (1 - math.cos(bend * way)) / bend if bend else 0.0
    counted = way * true_ppm / 50.0
    found = taped_drive(counted, 50.0, along, aside, wheelbase)
    assert found.pulses_per_m == pytest.approx(true_ppm, rel=1e-3)
    assert found.steer_off_deg == pytest.approx(off_deg, abs=0.05)
    assert found.pulses_sigma == pytest.approx(0.002 * true_ppm, rel=0.05)


@pytest.mark.parametrize(("counted", "taped"), [(0.0, 10.0), (1.0, 1.0)])
def test_a_drive_that_tells_nothing_is_refused(counted: float, taped: float) -> None:
    with pytest.raises(UserError):
        taped_drive(counted, 50.0, taped, 0.0, 1.0)


def weave(delay_s: float, noise_px: float = 1.0, amplitude: float = 0.3) -> tuple[np.ndarray, ...]:
    """(arrivals, shifts, motion's stamps, yaws) of a weaving drive."""
    rng = np.random.default_rng(3)
    motion = np.arange(0, 14, 0.02)
    yaw = amplitude * np.sin(math.tau * motion / 5.0)
    arrived = np.arange(1.0, 14.0, 0.1)
    turned = np.diff(np.interp(arrived - delay_s, motion, yaw))
    return arrived, 530 * turned + rng.normal(0, noise_px, len(turned)), motion, yaw


@pytest.mark.parametrize("delay_s", [0.05, 0.1, 0.25, 0.4])
def test_pictures_of_a_weaving_drive_tell_how_old_they_are(delay_s: float) -> None:
    arrived, shifts, motion, yaw = weave(delay_s)
    found = delay_of(list(arrived), list(shifts), motion, yaw)
    assert found.delay_s == pytest.approx(delay_s, abs=0.02)
    assert found.sigma_s >= 0.02


@pytest.mark.parametrize("how", [{"amplitude": 0.02}, {"noise_px": 200.0}])
def test_a_drive_that_does_not_tell_the_delay_is_refused(how: dict[str, float]) -> None:
    arrived, shifts, motion, yaw = weave(0.1, **how)
    with pytest.raises(UserError, match="delay"):
        delay_of(list(arrived), list(shifts), motion, yaw)


def test_a_shift_is_that_of_the_picture() -> None:
    rng = np.random.default_rng(1)
    wide = cv2.GaussianBlur(rng.integers(0, 255, (240, 400, 3)).astype(np.uint8), (0, 0), 3)
    assert shift_px(wide[:, 40:360], wide[:, 28:348]) == pytest.approx(12, abs=0.5)
