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
SHOWS_RAD: Final = math.radians(0.5)
"""That a gyroscope must show of a machine that rolls with its wheels turned, to tell which way: a
phone's errs by a tenth of a degree meanwhile."""
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
        self._counted: NDArray[np.float64] = np.zeros(2)
        """Since it was slowest, as if it went on: m, and what that turned by the steering angle,
        rad;"""
        self._taken: NDArray[np.float64] = np.zeros(2)
        """and as it was taken to go."""
        self._way = 1
        self._turned = False
        """Whether it has come to roll against the way it was driven."""
        self._on_rad = 0.0
        """Turned in one sense of late, as the gyroscope shows; positive: the way it was driven."""

    def shown(self, seen_rad: float, reckoned_rad: float) -> None:
        """The gyroscope has shown seen_rad while it rolled, and the steering angle reckoned_rad, as
        it is taken to roll: wheels that are turned tell which way that is."""
        on_rad = math.copysign(seen_rad, seen_rad * reckoned_rad * self._way)
        self._on_rad = on_rad + (self._on_rad if on_rad * self._on_rad > 0.0 else 0.0)

    def take(
        self, step_m: float, yaw_rad: float, speed_mps: float, by_slope: int
    ) -> tuple[float, float, int]:
        """What was counted since the last call, and what that turned by the steering angle, as if
        it went on; `by_slope`: -1 where the ground lets it roll against the way that it was driven,
        1 along it, 0 where nobody knows. Returns the two as they were, and 1 or -1: which way it
        goes. What turns out to have been taken for the other way is given back."""
        step = np.array([step_m, yaw_rad])
        slower = abs(speed_mps) <= self._slowest_mps and not self._turned
        if slower:
            self._slowest_mps = abs(speed_mps)
            self._counted[:], self._taken[:] = 0.0, 0.0
        else:
            self._counted += step
        far = abs(self._counted[0]) >= TURNED_M
        slowest = self._slowest_mps
        stopped = 0.0 < slowest < min(TURNS_MPS, abs(speed_mps) / TURNED_SHARE)
        told = abs(self._on_rad) > SHOWS_RAD
        self._turned = self._on_rad < 0.0 if told else self._turned or (far and stopped)
        against = self._turned or (not told and by_slope < 0 and slowest < TURNS_MPS)
        self._way = -1 if against else 1
        took = self._way * step
        if not slower and (self._turned or told):
            took = self._way * self._counted - self._taken
        self._taken += took
        if slower or told:
            self._counted[:], self._taken[:] = 0.0, 0.0
        return float(took[0]), float(took[1]), self._way
