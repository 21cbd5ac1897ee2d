"""The wheels' speed as a receiver shows it, which smooths its own over a second or two: the two can
be compared only where the machine has gone straight on at one speed for longer than that: beside
the axle an antenna goes another way in a bend, and a creep's Doppler is noise."""

from __future__ import annotations

import math
from typing import Final

from host.core.messages import Telemetry
from host.estimate.speed_watch import MOVING_MPS, SAME_MPS, STRAIGHT_RAD

SMOOTHED_S: Final = (1.0, 3.0)
"""Time constants of the two means that say whether the speed is the same: phones smooth over up to
1.5 s. Shorter: a start counts as a speed, at which a receiver shows less than the wheels."""


class SteadySpeed:
    """Fed with all telemetry; without a sensor it says nothing."""

    def __init__(self) -> None:
        self._stamp = -math.inf
        self._means = [0.0, 0.0]
        self._straight = False

    def take(self, telemetry: Telemetry) -> None:
        """Speeds are negative backwards."""
        dt = telemetry.stamp - self._stamp
        self._stamp = telemetry.stamp
        if not 0.0 < dt < 1.0 or telemetry.speed_mps is None:
            self._means = [0.0, 0.0]
            return
        for k, over_s in enumerate(SMOOTHED_S):
            self._means[k] += (telemetry.speed_mps - self._means[k]) * -math.expm1(-dt / over_s)
        self._straight = abs(telemetry.angle_rad) < STRAIGHT_RAD

    @property
    def mps(self) -> float | None:
        """None where it has not lasted."""
        late, long = self._means
        same = abs(late - long) < SAME_MPS and abs(late) > MOVING_MPS
        return late if same and self._straight else None
