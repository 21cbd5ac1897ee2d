"""How old a picture is when it arrives: the pictures of a weaving drive turn as the machine did so
long ago."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from host.core.errors import UserError
from host.vision.pictures import Picture

Floats = NDArray[np.float64]
LONGEST_S: Final = 0.6
"""Of the delays tried."""
STEP_S: Final = 0.005
"""Between delays tried; the best is refined by a parabola."""
LEAST_PICTURES: Final = 40
"""Two seconds of weaving at 20 a second."""
LEAST_TURN_RAD: Final = 0.2
"""Between the leftmost and the rightmost heading of the drive."""
UPPER: Final = 0.6
"""Of the picture's height: what is farther away, and moves by the turning alone."""
STAMPS_S: Final = 0.02
"""How well telemetry and pictures are timed: by their arrival, and a picture's rows one after the
other."""
CLEAR: Final = 0.6
"""Correlation between pictures and wheels below which nothing is found."""


@dataclass(frozen=True, slots=True)
class Delay:
    """From shutter to host, s."""

    delay_s: float
    sigma_s: float
    correlation: float


def shift_px(before: Picture, after: Picture) -> float:
    """How far the upper part of a picture has moved to the right since the one before."""
    parts = []
    for picture in (before, after):
        grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)[: round(UPPER * picture.shape[0])]
        parts.append(cv2.resize(grey, None, fx=0.5, fy=0.5).astype(np.float64))
    window = cv2.createHanningWindow(parts[0].shape[::-1], cv2.CV_64F)
    (dx, _), _ = cv2.phaseCorrelate(parts[0], parts[1], window)
    return 2.0 * float(dx)


def delay_of(
    arrived_s: Sequence[float], shifts_px: Sequence[float], motion_s: Floats, yaw_rad: Floats
) -> Delay:
    """The delay with which the pictures' shifts (one fewer than pictures, which `arrived_s` times)
    follow the machine's yaw by its wheels and steering. UserError where the drive does not tell."""
    at, shifts = np.array(arrived_s), np.array(shifts_px)
    if len(at) < LEAST_PICTURES or np.ptp(yaw_rad) < LEAST_TURN_RAD:
        raise UserError(
            "the camera's delay: drive a few metres in curves to both sides, with the camera on; "
            f"{len(at)} pictures over {np.degrees(np.ptp(yaw_rad)):.0f} degrees do not tell"
        )
    shifts = np.clip(shifts, *np.percentile(shifts, [3, 97]))
    tries = np.arange(0.0, LONGEST_S, STEP_S)
    found = []
    for delay in tries:
        turned = np.diff(np.interp(at - delay, motion_s, yaw_rad))
        found.append(abs(float(np.corrcoef(turned, shifts)[0, 1])))
    best = int(np.argmax(found))
    if found[best] < CLEAR:
        raise UserError("the camera's delay: the pictures do not turn as the machine does")
    inside = 0 < best < len(tries) - 1
    low, mid, high = (found[best - 1], found[best], found[best + 1]) if inside else (0, 1, 0)
    bend = low - 2 * mid + high
    fine = 0.5 * (low - high) / bend if inside and bend < 0 else 0.0
    noise = 1.0 - mid**2
    curvature = max(1e-9, -bend / STEP_S**2)
    sigma = float(np.sqrt(noise / len(shifts) / curvature)) if inside else LONGEST_S
    sigma = math.hypot(sigma, STAMPS_S)
    return Delay(float(tries[best] + fine * STEP_S), sigma, float(mid))
