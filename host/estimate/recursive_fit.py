"""A recursive least squares fit: a Kalman filter of states that only wander, one value a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from host.core.compiled import compiled


@compiled("(f8[::1], f8[:, ::1], f8[::1], f8, f8, f8[::1])")
def learn(
    x: NDArray[np.float64],
    p: NDArray[np.float64],
    h: NDArray[np.float64],
    value: float,
    variance: float,
    growth: NDArray[np.float64],
) -> None:
    """One value that is h @ x, known to `variance`: states x (n,) and covariance p (n, n) in place,
    whose diagonal has grown by `growth` (n,) since the last."""
    n = len(x)
    ph = np.zeros(n)
    off = value
    for k in range(n):
        p[k, k] += growth[k]
        off -= h[k] * x[k]
        for m in range(n):
            ph[k] += p[k, m] * h[m]
        variance += h[k] * ph[k]
    for k in range(n):
        x[k] += ph[k] / variance * off
        for m in range(n):
            p[k, m] -= ph[k] * ph[m] / variance
