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
from host.vision.pictures import Picture, u8

Floats = NDArray[np.float64]
Grey = NDArray[np.uint8]

EARLIEST_S: Final = -0.1
"""The least delay that is believed, s: telemetry is some milliseconds late, too."""
LATEST_S: Final = 1.2
"""The longest, s: later pictures are no use to drive by."""
STEP_S: Final = 0.01
"""Between delays tried, s."""
NEAR_S: Final = 0.3
"""From the likest delay, s: so far a parabola through the likeness finds its top. The turning's
likeness with itself falls by a tenth in it."""
OVER_S: Final = 0.5
"""Turns over so long are compared, s: ten pulses of the wheels' sensor, which comes in steps, and a
fifth of a swing to one side."""
EVERY_S: Final = 0.02
"""Between the turns that are compared, s: telemetry's period."""
LEAST_PICTURES: Final = 40
"""In a weave of 15 s: one in each of the turns that are compared, at least."""
LEAST_TURN_RAD: Final = 0.1
"""Between the leftmost and the rightmost heading of the drive, rad. The slowest steering of the
design turns a machine of 1.2 m wheelbase by 0.13. A drive that turned by 0.2 told the delay to 4
ms."""
UPPER: Final = 0.6
"""Of the picture's height: what is farther away, and moves by the turning alone."""
WIDE_PX: Final = 320
"""Columns of what is compared: a picture shifts by some of them while the machine turns."""
BELIEVED: Final = (3, 97)
"""Percentiles that bound the shifts: beyond lies what phase correlation has mistaken."""
STAMPS_S: Final = 0.02
"""How well telemetry and pictures are timed, s: by their arrival, and a picture's rows one after
the other."""
CLEAR: Final = 0.8
"""Correlation between pictures and wheels below which nothing is found. Ten pulses a metre leave
0.96, fifty 0.999; chance reaches 0.6 in one drive of some hundreds."""


@dataclass(frozen=True, slots=True)
class Delay:
    """From shutter to host, s."""

    delay_s: float
    sigma_s: float


def far_part(picture: Picture) -> Grey:
    """What of a picture is compared: small, so that a whole drive's can be kept."""
    height, width = picture.shape[:2]
    rows = round(UPPER * height)
    grey = cv2.cvtColor(picture[:rows], cv2.COLOR_BGR2GRAY)
    size = (WIDE_PX, max(1, round(rows * WIDE_PX / width)))
    return u8(cv2.resize(grey, size, interpolation=cv2.INTER_AREA))


def shift_px(before: Grey, after: Grey) -> float:
    """How far a picture's far part has moved to the right since the one before."""
    window = cv2.createHanningWindow(before.shape[::-1], cv2.CV_64F)
    (dx, _), _ = cv2.phaseCorrelate(before.astype(np.float64), after.astype(np.float64), window)
    return float(dx)


def delay_of(
    arrived_s: Sequence[float], shifts_px: Sequence[float], motion_s: Floats, yaw_rad: Floats
) -> Delay:
    """The delay with which the pictures' shifts (one fewer than pictures, which `arrived_s` times)
    follow the machine's yaw by its wheels and steering. UserError where the drive does not tell."""
    if len(arrived_s) < LEAST_PICTURES:
        raise UserError(
            f"the camera's delay: only {len(arrived_s)} pictures came, and it takes "
            f"{LEAST_PICTURES}: choose a smaller picture in the phone's app, go nearer"
        )
    if (turned := float(np.ptp(yaw_rad))) < LEAST_TURN_RAD:
        raise UserError(
            f"the camera's delay: the machine turned by {math.floor(math.degrees(turned))} degrees "
            f"only, and it takes {math.ceil(math.degrees(LEAST_TURN_RAD))}: see whether it steers "
            "and drives, and whether its wheels' sensor counts"
        )
    at = np.array(arrived_s)
    clipped = np.clip(shifts_px, *np.percentile(shifts_px, BELIEVED))
    shown = np.concatenate([[0.0], np.cumsum(clipped)])
    times = np.arange(at[0] + OVER_S / 2, at[-1] - OVER_S / 2, EVERY_S)
    shifts = _over(times, at, shown)
    delays = np.arange(EARLIEST_S - NEAR_S, LATEST_S + NEAR_S, STEP_S)
    alike = np.array([_alike(shifts, _over(times - delay, motion_s, yaw_rad)) for delay in delays])
    best = int(np.argmax(alike))
    if alike.min() < -max(CLEAR, alike[best]):
        raise UserError(
            "the camera's delay: the pictures turn to the other side than the machine: turn off "
            "in the phone's app what mirrors them or stands them on their head; or they come "
            "seconds late: restart the app"
        )
    bend, slope, _ = np.polyfit(*_near(delays, alike, best), 2)
    delay = -slope / (2 * bend) if bend < 0 else delays[best]
    if alike[best] < CLEAR or delay < EARLIEST_S:
        raise UserError(
            "the camera's delay: the pictures do not turn as the machine does: fasten the phone, "
            "see that it is this machine's and has more to see than sky; where its pictures "
            "stutter, choose a smaller one in the app, go nearer"
        )
    if delay > LATEST_S:
        raise UserError(
            f"the camera's delay: the pictures come more than {LATEST_S:g} s late: restart the "
            "phone's camera app, choose a smaller picture, go nearer"
        )
    turns = (at[-1] - at[0]) / OVER_S
    sigma = math.sqrt((1.0 - alike[best] ** 2) / turns / max(1e-9, -2 * bend))
    return Delay(float(max(0.0, delay)), math.hypot(sigma, STAMPS_S))


def _over(times: Floats, at: Floats, values: Floats) -> Floats:
    """What a value that is known `at` some times changes by over OVER_S, the middles at `times`."""
    half = OVER_S / 2
    return np.interp(times + half, at, values) - np.interp(times - half, at, values)


def _alike(one: Floats, other: Floats) -> float:
    """Their correlation; 0 where one does not change at all."""
    return float(np.corrcoef(one, other)[0, 1]) if np.ptp(one) > 0 < np.ptp(other) else 0.0


def _near(delays: Floats, alike: Floats, best: int) -> tuple[Floats, Floats]:
    """Delays near the best one, and their likenesses."""
    near = np.abs(delays - delays[best]) < NEAR_S + STEP_S / 2
    return delays[near], alike[near]
