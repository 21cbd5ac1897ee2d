"""Which way the machine rolls when its drive is off: downhill, as its own driving tells.

One hall sensor counts pulses, not their direction, and a braked drive creeps on a slope. But uphill
the machine is slower than its duty says, and downhill faster, in whatever direction it drives; and
a machine that runs out uphill all but stops before it comes back.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

PRIOR_MPS: Final = (0.1, 0.3, 0.3, 0.15)
"""Standard deviations of what rolling, slopes and crop before the blade take of the duty's
speed."""
NOISE_MPS: Final = 0.2
"""Of one telemetry's speed; bumps last for some ten of them."""
DRIFT_MPS: Final = 0.002
"""Growth with each: the ground is no plane, and dead reckoning turns."""
SURE: Final = 1.0
LEAST_MPS: Final = 0.02
TURNS_MPS: Final = 0.08
TURNED_SHARE: Final = 1.15
TURNED_M: Final = 0.04
"""A braked machine that rolls on only slows down. One that had all but stopped and is the faster
again, by such a factor at least after so far (two pulses), has turned round."""


@njit(cache=True, nogil=True)
def _learn(
    x: NDArray[np.float64],
    p: NDArray[np.float64],
    h: tuple[float, float, float, float],
    lost_mps: float,
) -> None:
    """One step of the fit, in place, compiled: telemetry comes fifty times a second."""
    ph = np.zeros(4)
    variance, off = NOISE_MPS**2, lost_mps
    for k in range(4):
        p[k, k] += DRIFT_MPS**2
        off -= h[k] * x[k]
        for n in range(4):
            ph[k] += p[k, n] * h[n]
        variance += h[k] * ph[k]
    for k in range(4):
        x[k] += ph[k] / variance * off
        for n in range(4):
            p[k, n] -= ph[k] * ph[n] / variance


class Slope:
    """A recursive least squares fit of (rolling loss, uphill x, uphill y, crop's drag), m/s of the
    duty's speed, in dead reckoning's frame."""

    def __init__(self) -> None:
        self._x: NDArray[np.float64] = np.zeros(4)
        self._p: NDArray[np.float64] = np.diag(PRIOR_MPS) ** 2

    def learn(self, yaw_rad: float, speed_mps: float, duty_mps: float, *, cutting: bool) -> None:
        """Driving steadily and straight at a speed whose duty gives duty_mps on the level."""
        sign = math.copysign(1.0, speed_mps)
        h = (1.0, sign * math.cos(yaw_rad), sign * math.sin(yaw_rad), float(cutting))
        _learn(self._x, self._p, h, abs(duty_mps) - abs(speed_mps))

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
        self._since_slowest_m = 0.0
        self.turned = False
        """Whether it has come to roll against the way it was driven."""

    @property
    def slowed(self) -> bool:
        """Whether it has been so slow that it may have turned round since."""
        return self._slowest_mps < TURNS_MPS

    def take(self, step_m: float, speed_mps: float) -> float:
        """With what was counted since the last call: how much of all that was counted so far went
        the other way, and was not known to."""
        if self.turned:
            return step_m
        if abs(speed_mps) <= self._slowest_mps:
            self._slowest_mps, self._since_slowest_m = abs(speed_mps), 0.0
        else:
            self._since_slowest_m += step_m
        far = abs(self._since_slowest_m) >= TURNED_M
        stopped = 0.0 < self._slowest_mps < min(TURNS_MPS, abs(speed_mps) / TURNED_SHARE)
        self.turned = far and stopped
        return self._since_slowest_m if self.turned else 0.0
