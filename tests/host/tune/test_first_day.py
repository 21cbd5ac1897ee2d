"""Facts about what a taped drive and a weaving drive tell."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from host.core.errors import UserError
from host.tune.camera_delay import LATEST_S, delay_of, far_part, shift_px
from host.tune.taped_drive import taped_drive


@pytest.mark.parametrize("off_deg", [-2.0, 0.0, 1.5])
@pytest.mark.parametrize("true_ppm", [45.0, 50.0, 100.0])
@pytest.mark.parametrize("left_m", [0.0, 0.35, -0.35])
def test_a_taped_drive_tells_wheels_and_steering(
    off_deg: float, true_ppm: float, left_m: float
) -> None:
    way, wheelbase = 10.0, 1.0
    bend = math.tan(math.radians(off_deg)) / wheelbase
    along = math.sin(bend * way) / bend if bend else way
    aside = (1 - math.cos(bend * way)) / bend if bend else 0.0
    counted = way * (1.0 - left_m * bend) * true_ppm / 50.0
    found = taped_drive(counted, 50.0, along, aside, wheelbase, left_m)
    assert found.pulses_per_m == pytest.approx(true_ppm, rel=1e-3)
    assert found.steer_off_deg == pytest.approx(off_deg, abs=0.05)
    assert found.pulses_sigma == pytest.approx(0.002 * true_ppm, rel=0.05)


@pytest.mark.parametrize(("counted", "taped"), [(0.0, 10.0), (1.0, 1.0)])
def test_a_drive_that_tells_nothing_is_refused(counted: float, taped: float) -> None:
    with pytest.raises(UserError):
        taped_drive(counted, 50.0, taped, 0.0, 1.0)


def weave(
    delay_s: float,
    *,
    noise_px: float = 1.0,
    amplitude: float = 0.3,
    fps: float = 10.0,
    pulse_rad: float = 0.0,
    seed: int = 3,
) -> tuple[list[float], list[float], np.ndarray, np.ndarray]:
    """(arrivals, shifts, motion's stamps, yaws) of a weaving drive whose wheels' sensor shows a
    turn in steps of `pulse_rad`."""
    rng = np.random.default_rng(seed)
    motion = np.arange(0, 14, 0.02)
    arrived = np.arange(1.0 + delay_s, 14.0, 1 / fps)

    def yaw(at: np.ndarray) -> np.ndarray:
        return np.asarray(amplitude * np.sin(math.tau * at / 5.0))

    shifts = 265 * np.diff(yaw(arrived - delay_s))
    shown = np.round(yaw(motion) / pulse_rad) * pulse_rad if pulse_rad else yaw(motion)
    return list(arrived), list(shifts + rng.normal(0, noise_px, len(shifts))), motion, shown


@pytest.mark.parametrize("delay_s", [0.0, 0.05, 0.1, 0.25, 0.4, 1.0])
@pytest.mark.parametrize("fps", [5.0, 10.0, 30.0])
def test_pictures_of_a_weaving_drive_tell_how_old_they_are(delay_s: float, fps: float) -> None:
    found = delay_of(*weave(delay_s, fps=fps))
    assert found.delay_s == pytest.approx(delay_s, abs=0.02)
    assert found.sigma_s >= 0.02


@pytest.mark.parametrize("pulse_rad", [0.01, 0.05])
def test_a_sensor_of_few_pulses_tells_the_delay_less_surely(pulse_rad: float) -> None:
    """At 0.5 1/m of curvature and 10 pulses a metre each pulse is 0.05 rad."""
    found = delay_of(*weave(0.15, fps=30.0, noise_px=0.3, pulse_rad=pulse_rad))
    assert found.delay_s == pytest.approx(0.15, abs=0.02)
    fine = delay_of(*weave(0.15, fps=30.0, noise_px=0.3))
    assert found.sigma_s > fine.sigma_s


REFUSED = {
    "the machine turned by 2 degrees": {"amplitude": 0.02},
    "do not turn as the machine does": {"noise_px": 200.0},
    "only 26 pictures": {"fps": 2.0},
    "more than 1.2 s late": {"delay_s": LATEST_S + 0.1},
    "to the other side": {"delay_s": 2.2},
}


@pytest.mark.parametrize("said", REFUSED)
def test_a_drive_that_does_not_tell_the_delay_is_refused(said: str) -> None:
    with pytest.raises(UserError, match=f"the camera's delay: .*{said}"):
        delay_of(*weave(**{"delay_s": 0.1} | REFUSED[said]))


@pytest.mark.parametrize("seed", range(20))
def test_pictures_that_turn_by_chance_are_refused(seed: int) -> None:
    with pytest.raises(UserError, match="do not turn as"):
        delay_of(*weave(0.1, noise_px=200.0, seed=seed))


def test_shifts_that_are_mistaken_now_and_then_change_little() -> None:
    arrived, shifts, motion, yaw = weave(0.1)
    shifts[20], shifts[60], shifts[90] = 150.0, -150.0, 140.0
    found = delay_of(arrived, shifts, motion, yaw)
    assert found.delay_s == pytest.approx(0.1, abs=0.03)
    assert 0.022 < found.sigma_s < 0.03


def test_a_delay_below_zero_is_none() -> None:
    """Telemetry may be some milliseconds later than a quick camera's pictures."""
    assert delay_of(*weave(-0.05)).delay_s == 0.0


def test_pictures_that_are_mirrored_are_refused() -> None:
    arrived, shifts, motion, yaw = weave(0.1)
    with pytest.raises(UserError, match="mirrors them"):
        delay_of(arrived, [-shift for shift in shifts], motion, yaw)


@pytest.mark.parametrize("times", [1, 3])
def test_a_shift_is_that_of_the_picture_whatever_its_size(times: int) -> None:
    rng = np.random.default_rng(1)
    wide = cv2.GaussianBlur(rng.integers(0, 255, (240, 400, 3)).astype(np.uint8), (0, 0), 3)
    wide = cv2.resize(wide, None, fx=times, fy=times)
    before, after = (far_part(wide[:, times * at : times * (at + 320)]) for at in (40, 28))
    assert before.shape == (144, 320)
    assert shift_px(before, after) == pytest.approx(12, abs=0.5)
