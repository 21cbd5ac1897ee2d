"""The phone's gyroscope on a machine at rest: is it there, quick enough, and at rest too?"""

from __future__ import annotations

import math
from typing import Final

from host.check.notes import Notes
from host.core.messages import Turned

REST_S: Final = 2.0
"""Of rest that is listened to."""
PATIENCE_S: Final = 6.0
"""For the first word: an app takes seconds to connect."""
QUIET_DPS: Final = 3.0
"""deg/s that a good one shows at rest, at most (Bosch BMI160 data sheet, zero-rate offset)."""


def gyroscope(notes: Notes) -> None:
    """Without one the steering angle tells what the machine turns, as it can, so nothing of this
    keeps the harvest from starting."""
    hands = notes.hands
    heard: list[Turned] = []
    end = hands.clock() + PATIENCE_S
    while hands.clock() < end and (not heard or heard[-1].stamp - heard[0].stamp < REST_S):
        if not heard and hands.gyro_problem and hands.clock() > end - PATIENCE_S / 2:
            break
        hands.pump(0.1)
        turned = hands.turned()
        if turned is not None:
            heard = [one for one in heard if one.since == turned.since] + [turned]
    if not heard:
        notes.note("gyroscope", "warn", "gyroscope.none", why=hands.gyro_problem or "-")
        return
    lasted = heard[-1].stamp - heard[0].stamp
    if lasted < REST_S:
        notes.note("gyroscope", "warn", "gyroscope.slow")
        return
    rate = math.degrees(heard[-1].yaw_rad - heard[0].yaw_rad) / lasted
    fine = abs(rate) < QUIET_DPS
    finding = "gyroscope.ok" if fine else "gyroscope.restless"
    notes.note("gyroscope", "ok" if fine else "warn", finding, dps=abs(rate))
