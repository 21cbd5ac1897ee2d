"""Which way the machine rolls when its drive is off: downhill, as its own driving tells.

One hall sensor counts pulses, not their direction, and a braked drive creeps on a slope. But uphill
the machine is slower than its duty says, and downhill faster, in whatever direction it drives.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
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
        self._p = self._p + np.eye(4) * DRIFT_MPS**2
        gain = self._p @ h / (h @ self._p @ h + NOISE_MPS**2)
        self._x = self._x + gain * (abs(duty_mps) - abs(speed_mps) - h @ self._x)
        self._p = self._p - np.outer(gain, h @ self._p)

    def rolls(self, yaw_rad: float) -> int:
        """1 where a machine with this yaw rolls forward, -1 where backward, 0 where that is not
        known or it stands."""
        h = np.array([0.0, math.cos(yaw_rad), math.sin(yaw_rad), 0.0])
        uphill = float(h @ self._x)
        if abs(uphill) < max(LEAST_MPS, SURE * math.sqrt(h @ self._p @ h)):
            return 0
        return -1 if uphill > 0 else 1
