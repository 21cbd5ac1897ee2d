"""The speed of a machine without a wheel sensor: what its drive duty gives on level ground, less
what rolling, the slope and the crop take, as the receiver's Doppler teaches (paper, II: speed by
PWM).

All that takes speed off does so at any speed alike, for a motor's speed falls in proportion to its
load. A slope takes as much uphill as it gives downhill, so it is one vector for the whole field and
not a ratio to be learned anew on every side.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from host.core.messages import Fix, Telemetry
from host.core.vehicle import Vehicle
from host.estimate.recursive_fit import learn

LOSS_MPS: Final = ((0.0, 0.05), (0.0, 0.1), (0.0, 0.1), (0.05, 0.05))
"""Mean and standard deviation before anything is learned: of rolling beside the curve that was
measured; of the slope along x and y, 0.1 being 2 degrees; of crop before the blade."""
WALK_MPS: Final = (0.001, 0.006, 0.006, 0.002)
"""Growth per square root of a second: load and battery change, and the ground is no plane."""
SHOWN_MPS: Final = 0.08
"""Standard deviation of a phone's speed over ground, with bumps shorter than its smoothing."""
SMOOTHED_S: Final = 1.5
"""Of it: phones smooth over up to 1.5 s and lag by up to 0.8 s."""
MOST_MPS: Final = 0.35
"""Taken off or given: what 7 degrees do."""
LEAST_MPS: Final = 0.1
"""Slower, the Doppler is noise, and a share of the way too large."""
SCALE: Final = 0.02
"""Of the way, at least: wheel slip and the lag."""
BUMPS_MPS: Final = 0.06
"""What a metre of ground takes or gives that is 1.3 degrees steeper than the field."""


class DutySpeed:
    """Fed with all telemetry and all fixes. Speeds are signed, negative backwards."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        mean, sigma = np.array(LOSS_MPS).T
        self._loss: NDArray[np.float64] = mean.copy()
        self._p: NDArray[np.float64] = np.diag(sigma) ** 2
        self._h: NDArray[np.float64] = np.zeros(4)
        """What of these acts now."""
        self._level = 0.0
        """As the duty alone would have it, behind the drive's lag;"""
        self._shown = 0.0
        """and as a receiver would show that."""
        self._acts = 0.0
        """Share of that time for which the drive was on."""
        self.mps = 0.0

    def advance(self, telemetry: Telemetry, yaw_rad: float, dt: float) -> float:
        """The speed after `dt` seconds with this telemetry."""
        vehicle = self._vehicle
        target = vehicle.duty_speed(telemetry.drive_duty, telemetry.battery_v)
        sign = math.copysign(1.0, telemetry.drive_duty)
        slope = sign * math.cos(yaw_rad), sign * math.sin(yaw_rad)
        on = float(target != 0.0)
        self._h[:] = on, on * slope[0], on * slope[1], on * telemetry.blade
        lost = min(MOST_MPS, max(-MOST_MPS, float(self._h @ self._loss)))
        driven = sign * max(0.0, abs(target) - lost) if target != 0.0 else 0.0
        blend = 1.0 - math.exp(-dt / vehicle.drive_lag_s)
        self.mps += (driven - self.mps) * blend
        self._level += (target - self._level) * blend
        smooth = 1.0 - math.exp(-dt / SMOOTHED_S)
        self._shown += (self._level - self._shown) * smooth
        self._acts += (on - self._acts) * smooth
        return self.mps

    def learn(self, fix: Fix, dt: float) -> None:
        """From a Doppler speed that lasted `dt` seconds, the machine driving straight."""
        shown = abs(self._shown)
        if fix.speed_mps is None or fix.quality == 0 or shown < LEAST_MPS:
            return
        lost_mps, acts = shown - fix.speed_mps, self._acts * self._h
        learn(self._loss, self._p, acts, lost_mps, SHOWN_MPS**2, np.square(WALK_MPS) * dt)

    @property
    def unsure_mps(self) -> float:
        """Standard deviation of the speed while the drive is on."""
        return math.hypot(BUMPS_MPS, self._loss_sigma)

    @property
    def _loss_sigma(self) -> float:
        return math.sqrt(max(0.0, float(self._h @ self._p @ self._h)))

    @property
    def scale_sigma(self) -> float:
        """Standard deviation of the way, as a share of it."""
        return math.hypot(SCALE, self._loss_sigma / max(LEAST_MPS, abs(self.mps)))
