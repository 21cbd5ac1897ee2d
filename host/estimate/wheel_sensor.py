"""From the wheel that carries the sensor's magnets to the rear axle's middle.

Each rear wheel turns as its own way asks: in a turn the inner one goes less than the middle, the
outer one more. On the default machine's lock that is 42 % of the way.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from host.core.messages import Command, Request, Telemetry
from host.core.vehicle import Vehicle

LEAST_SHARE: Final = 0.2
"""Of the middle's way that a wheel is taken to go at least. One that is nearly where the machine
turns about tells nothing of its way; no tricycle that the firmware steers comes to less."""


LEG_RAD: Final = math.radians(20.0)
"""A shorter turn's leg shows slack rather than wheel or scale."""
OTHERWISE: Final = 1.5
"""Times as much, in one leg of a turn, and as little in the next, as no other fault does: pulses
that are lost make all legs longer. The sensor on the other wheel of the default machine makes 0.45
and 2.1 of them, one on the axle 0.6 and 1.4. A steering whose middle is 10 degrees off comes near
it, and shows before, driving straight."""


def wheel_share(left_m: float, curvature_1pm: float) -> float:
    """What a wheel so far left of the middle goes of the middle's way, where that turns so to the
    left."""
    return max(LEAST_SHARE, 1.0 - left_m * curvature_1pm)


class WheelSensor:
    """One machine's. Fed with all telemetry; what it gives counts the middle of the rear axle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._left_m = vehicle.hall_left_m
        self._counted: float | None = None
        """What the wheel had travelled at the last telemetry, m;"""
        self._middle_m = 0.0
        """and the middle by then;"""
        self._share = 1.0
        """and what the wheel went of the middle's speed."""

    def at_the_middle(self, telemetry: Telemetry, curvature_1pm: float) -> Telemetry:
        """The telemetry of a sensor at the axle's middle, on a machine that turns so now."""
        if self._left_m == 0.0 or telemetry.speed_mps is None:
            return telemetry
        before, self._counted = self._counted, telemetry.distance_m
        share = wheel_share(self._left_m, curvature_1pm)
        mean, self._share = (share + self._share) / 2.0, share
        if before is None:
            self._middle_m = telemetry.distance_m
        else:
            self._middle_m += (telemetry.distance_m - before) / mean
        return replace(telemetry, speed_mps=telemetry.speed_mps / share, distance_m=self._middle_m)

    def asked_of_the_wheel(self, command: Command) -> Command:
        """The command by which the middle goes as fast as was decided, on a machine that turns as
        it did at the last telemetry: what the firmware holds is the speed of the wheel that it
        counts, where it counts one."""
        if self._counted is None or command.request is not Request.DRIVE:
            return command
        return replace(command, speed_mps=command.speed_mps * self._share)


class WheelPlace:
    """Whether the legs of turns show the sensor's wheel where it is said to run: on a wheel of the
    other side the machine seems to turn too far to the one side, and too little to the other."""

    def __init__(self) -> None:
        self._before: float | None = None
        """What the gyroscope showed of the leg before, over what was reckoned."""
        self.wrong: tuple[float, float] | None = None
        """The least and the most of that, where two legs have shown that it runs elsewhere."""

    def take(self, seen_rad: float, reckoned_rad: float, *, ended: bool) -> None:
        """A turn's leg, or what has been driven of it, as the gyroscope shows it and by the wheel's
        way and the steering angle."""
        if max(abs(reckoned_rad), abs(seen_rad)) < LEG_RAD or seen_rad * reckoned_rad <= 0.0:
            return
        before, ratio = self._before, seen_rad / reckoned_rad
        if ended:
            self._before = ratio
        if before is not None and self.wrong is None:
            least, most = sorted((before, ratio))
            if least < 1.0 / OTHERWISE and most > OTHERWISE:
                self.wrong = least, most
