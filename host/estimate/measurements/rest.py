"""What the gyroscope shows while the machine stands: its offset (zero-velocity update; Foxlin, IEEE
Computer Graphics and Applications 25(6), 2005). What it was off since the last stand has turned the
yaw, and their covariance takes that back."""

from __future__ import annotations

import numpy as np

from host.estimate.kalman import Array, Measurement
from host.estimate.states import GYRO


def rest(x: Array, rate_radps: float, variance: float) -> Measurement:
    """rate_radps, besides what has been taken off it."""
    h = np.zeros((1, len(x)))
    h[0, GYRO] = 1.0
    return Measurement("rest", h, np.array([rate_radps - x[GYRO]]), np.array([variance]))
