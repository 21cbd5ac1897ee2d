"""Which way the machine rolls when its drive is off: downhill, as its own driving tells.

One hall sensor counts pulses, not their direction, and a braked drive creeps on a slope. But uphill
the machine is slower than its duty says, and downhill faster, in whatever direction it drives; and
a machine that runs out uphill all but stops before it comes back.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from host.core.messages import Telemetry
from host.core.vehicle import Vehicle
from host.estimate.climb import Climb
from host.estimate.recursive_fit import learn

PRIOR_MPS: Final = (0.1, 0.3, 0.3, 0.15)
"""Standard deviations of what rolling, slopes and crop before the blade take of the duty's
speed."""
NOISE_MPS: Final = 0.2
"""Of one telemetry's speed; bumps last for some ten of them."""
DRIFT_MPS: Final = 0.002
"""Growth with each: the ground is no plane, and dead reckoning turns."""
GROWTH: Final = np.full(4, DRIFT_MPS**2)
"""The same, as variances."""
STEADY_S: Final = 1.0
"""After the drive is switched, until speed and lie are the ground's and not the start's."""
STOPS_S: Final = 0.3
"""After it is switched off, until a machine that still moves rolls, and does not coast."""
TELLS_1PM: Final = 0.2
"""With its wheels turned so far at least, a machine that rolls turns so that it tells which way."""
ROLLS_RAD: Final = math.radians(0.3)
"""On less steep ground nobody knows which way it rolls."""
SURE: Final = 1.0
LEAST_MPS: Final = 0.02
TURNS_MPS: Final = 0.08
TURNED_SHARE: Final = 1.15
SHOWS_RAD: Final = math.radians(0.5)
"""That a gyroscope must show of a machine that rolls with its wheels turned, to tell which way: a
phone's errs by a tenth of a degree meanwhile."""
TURNED_M: Final = 0.04
"""A braked machine that rolls on only slows down. One that had all but stopped and is the faster
again, by such a factor at least after so far (two pulses), has turned round."""


class Slope:
    """A recursive least squares fit of (rolling loss, uphill x, uphill y, crop's drag), m/s of the
    duty's speed, in dead reckoning's frame."""

    def __init__(self) -> None:
        self._x: NDArray[np.float64] = np.zeros(4)
        self._p: NDArray[np.float64] = np.diag(PRIOR_MPS) ** 2

    def learn(self, yaw_rad: float, speed_mps: float, duty_mps: float, *, cutting: bool) -> None:
        """Driving steadily and straight at a speed whose duty gives duty_mps on the level."""
        sign = math.copysign(1.0, speed_mps)
        h = np.array([1.0, sign * math.cos(yaw_rad), sign * math.sin(yaw_rad), float(cutting)])
        learn(self._x, self._p, h, abs(duty_mps) - abs(speed_mps), NOISE_MPS**2, GROWTH)

    def rolls(self, yaw_rad: float) -> int:
        """1 where a machine with this yaw rolls forward, -1 where backward, 0 where that is not
        known or it stands."""
        h = np.array([0.0, math.cos(yaw_rad), math.sin(yaw_rad), 0.0])
        uphill = float(h @ self._x)
        if abs(uphill) < max(LEAST_MPS, SURE * math.sqrt(h @ self._p @ h)):
            return 0
        return -1 if uphill > 0 else 1


class Coast:
    """A machine since its drive was switched off."""

    def __init__(self) -> None:
        self._slowest_mps = math.inf
        self._counted = (0.0, 0.0)
        """Since it was slowest, as if it went on: m, and what that turned by the steering angle,
        rad;"""
        self._taken = (0.0, 0.0)
        """and as it was taken to go."""
        self._turned = False
        """Whether it has come to roll against the way it was driven."""
        self._on_rad = 0.0
        """Turned in one sense of late, as the gyroscope shows; positive: the way it was driven."""

    @property
    def told(self) -> bool:
        """Whether the gyroscope tells which way it rolls."""
        return abs(self._on_rad) > SHOWS_RAD

    def shown(self, on_rad: float) -> None:
        """The gyroscope has shown on_rad while it rolled, positive if the machine turned as it does
        the way that it was driven: wheels that are turned tell which way it rolls."""
        self._on_rad = on_rad + (self._on_rad if on_rad * self._on_rad > 0.0 else 0.0)

    def take(
        self, step_m: float, yaw_rad: float, speed_mps: float, by_slope: int, *, sure: bool
    ) -> tuple[float, float, int]:
        """What was counted since the last call, and what that turned by the steering angle, as if
        it went on; `by_slope`: -1 where the ground lets it roll against the way that it was driven,
        1 along it, 0 where nobody knows, and whether that is `sure`. Returns the two as they were,
        and 1 or -1: which way it goes. What turns out to have been taken for the other way is given
        back."""
        slower = abs(speed_mps) <= self._slowest_mps and not self._turned
        if slower:
            self._slowest_mps = abs(speed_mps)
            self._counted = self._taken = (0.0, 0.0)
        else:
            self._counted = (self._counted[0] + step_m, self._counted[1] + yaw_rad)
        far = abs(self._counted[0]) >= TURNED_M
        slowest = self._slowest_mps
        stopped = 0.0 < slowest < min(TURNS_MPS, abs(speed_mps) / TURNED_SHARE)
        if self.told:
            self._turned = self._on_rad < 0.0
        elif far and stopped and not sure:
            self._turned = True
        against = self._turned or (not self.told and by_slope < 0 and slowest < TURNS_MPS)
        way = -1 if against else 1
        (counted_m, counted_rad), (taken_m, taken_rad) = self._counted, self._taken
        took_m, took_rad = way * step_m, way * yaw_rad
        if not slower and (self._turned or self.told):
            took_m, took_rad = way * counted_m - taken_m, way * counted_rad - taken_rad
        self._taken = (taken_m + took_m, taken_rad + took_rad)
        if slower or self.told:
            self._counted = self._taken = (0.0, 0.0)
        return took_m, took_rad, way


class Rolling:
    """Which way the machine goes: as its drive says, and with that off, as the ground and the
    gyroscope do."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._slope = Slope()
        self.climb = Climb()
        """The ground as the phone's accelerometer shows it."""
        self._coast = Coast()
        self._driven = 1
        """Which way it was driven last: 1 forward, -1 back;"""
        self._driven_s = 0.0
        """since when the drive is on; negative: off."""
        self.doubt_m = 0.0
        """How far it has rolled since then, to and fro, while neither ground nor gyroscope told
        which way."""

    @property
    def off(self) -> bool:
        """Whether the drive has been off for longer than the machine coasts."""
        return self._driven_s < -STOPS_S

    @property
    def steady(self) -> bool:
        """Whether it is long since the drive was switched."""
        return abs(self._driven_s) > STEADY_S

    def shown(self, seen_rad: float, curvature_1pm: float) -> None:
        """What the gyroscope has shown since its last word: a machine that rolls with turned wheels
        shows which way."""
        # One that still runs out shows how it was driven, and not yet how it rolls.
        if self.off and abs(curvature_1pm) > TELLS_1PM:
            self._coast.shown(math.copysign(seen_rad, seen_rad * curvature_1pm * self._driven))

    def take(
        self,
        step_m: float,
        turned_rad: float,
        telemetry: Telemetry,
        dt: float,
        yaw_rad: float,
        *,
        straight: bool,
    ) -> tuple[float, float, float]:
        """What was counted, what that turned, and the speed, with their true signs: one hall sensor
        counts a machine that rolls back down a slope as going on."""
        speed = telemetry.speed_mps
        assert speed is not None
        if telemetry.drive_duty != 0:
            self._driven_s = max(0.0, self._driven_s) + dt
            self._driven = 1 if telemetry.drive_duty > 0 else -1
            self._coast, self.doubt_m = Coast(), 0.0
            if straight and self._driven_s > STEADY_S and speed != 0.0:
                level = self._vehicle.duty_speed(telemetry.drive_duty, telemetry.battery_v)
                self._slope.learn(yaw_rad, speed, level, cutting=telemetry.blade)
            return step_m, turned_rad, speed
        self._driven_s = min(0.0, self._driven_s) - dt
        downhill, sure = self._downhill(yaw_rad)
        by_slope = downhill * round(math.copysign(1.0, step_m or speed))
        step_m, turned_rad, way = self._coast.take(step_m, turned_rad, speed, by_slope, sure=sure)
        if self.off and not (sure or self._coast.told):
            self.doubt_m += abs(step_m)
        return step_m, turned_rad, way * speed

    def _downhill(self, yaw_rad: float) -> tuple[int, bool]:
        """1 forward, -1 back, 0 nobody knows; and whether it is sure."""
        if self._driven_s > -STOPS_S:
            return 0, False
        uphill, sigma = self.climb.uphill(yaw_rad)
        if abs(uphill) > max(ROLLS_RAD, 2.0 * sigma):
            return (-1 if uphill > 0.0 else 1), True
        return self._slope.rolls(yaw_rad), False
