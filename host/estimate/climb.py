"""How steep the ground is, as the phone's accelerometer shows: which way a machine rolls that
stands on it.

An accelerometer at rest shows which way is up, and so how far the camera looks above the horizon.
That is the mount's pitch and the ground's, and the mount turns with the machine while the ground
does not: a machine that has stood and driven in some directions knows the two apart.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from host.core.compiled import compiled
from host.estimate.kalman import Array

MOUNT_SIGMA: Final = math.radians(45.0)
"""Of the camera's pitch, with the accelerometer's own zero: nothing is believed of either."""
SLOPE_SIGMA: Final = math.radians(3.0)
"""Of a field's slope along x and y before anything is seen of it."""
NOISE: Final = math.radians(2.0)
"""Of a second: bumps, and what the machine shakes."""
DRIFT: Final = math.radians(0.02)
"""Growth of the slope's, per square root of a second: the ground is no plane."""
UP_RAD: Final = math.radians(8.0)
"""A camera that looks up by more is not the one that sees the crop: the phone lies the other way
round."""


@compiled("(f8[::1], f8[:, ::1], f8, f8, f8)")
def _learn(x: Array, p: Array, yaw_rad: float, nose_up_rad: float, lasted_s: float) -> None:
    """`Climb.learn`, in place, due at each of a phone's samples."""
    h = np.array([1.0, math.cos(yaw_rad), math.sin(yaw_rad)])
    p[1, 1] += DRIFT**2 * lasted_s
    p[2, 2] += DRIFT**2 * lasted_s
    ph = np.zeros(3)
    for k in range(3):
        ph[k] = p[k, 0] * h[0] + p[k, 1] * h[1] + p[k, 2] * h[2]
    spread = h[0] * ph[0] + h[1] * ph[1] + h[2] * ph[2] + NOISE**2 / lasted_s
    off = nose_up_rad - (h[0] * x[0] + h[1] * x[1] + h[2] * x[2])
    for k in range(3):
        x[k] += ph[k] / spread * off
        for n in range(3):
            p[k, n] -= ph[k] / spread * ph[n]


class Climb:
    """A recursive least squares fit of (mount's pitch, slope along x, slope along y), rad, in dead
    reckoning's frame."""

    def __init__(self) -> None:
        self._x = np.zeros(3)
        self._p = np.diag([MOUNT_SIGMA, SLOPE_SIGMA, SLOPE_SIGMA]) ** 2

    def learn(self, yaw_rad: float, nose_up_rad: float, lasted_s: float) -> None:
        """The camera has looked so far above the horizon for so long."""
        if not nose_up_rad < UP_RAD or not 0.0 < lasted_s < math.inf:
            return
        _learn(self._x, self._p, yaw_rad, nose_up_rad, lasted_s)

    def uphill(self, yaw_rad: float) -> tuple[float, float]:
        """How steeply the ground rises ahead of a machine with this yaw, rad, and its standard
        deviation."""
        h = np.array([0.0, math.cos(yaw_rad), math.sin(yaw_rad)])
        return float(h @ self._x), math.sqrt(max(0.0, float(h @ self._p @ h)))
