"""The one update that every filter here makes, and what it leaves for the record."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
KEPT = 64
"""Innovations that wait for a reader, at most: some seconds'."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """What a sensor says, linear about the state: (n, states) `h`, (n,) `innovation` (measured
    minus expected) and (n,) `variances` of its noise. Beyond `gate`, in the squared Mahalanobis
    distance, it is not this measurement."""

    name: str
    h: Array
    innovation: Array
    variances: Array
    gate: float = math.inf


@dataclass(frozen=True, slots=True)
class Innovation:
    """What a filter made of a measurement. `value` is the first component, in m or rad, `sigma` its
    standard deviation; `nis` the normalised innovation squared of all `dimensions`, which is that
    many on average where the model holds."""

    name: str
    value: float
    sigma: float
    nis: float
    dimensions: int
    used: bool


class Filter:
    """State and covariance. Subclasses predict."""

    def __init__(self, x: Array, p: Array) -> None:
        self._x, self._p = x, p
        self.innovations: list[Innovation] = []
        """Since whoever reads them has emptied it; the latest KEPT at most."""

    def fuse(self, measurement: Measurement, *, frozen: int | None = None) -> bool:
        """Takes the measurement (Joseph form) and returns True, or refuses it. The state `frozen`
        is considered and not changed."""
        gain = self._gain(measurement, frozen)
        if gain is None:
            return False
        h = measurement.h
        self._x = self._x + gain @ measurement.innovation
        keep = np.eye(len(self._x)) - gain @ h
        self._p = keep @ self._p @ keep.T + gain @ np.diag(measurement.variances) @ gain.T
        return True

    def yield_to(self, bound: Measurement, *, frozen: slice) -> None:
        """Moves the state towards a bound that it violates, but for what is `frozen`. It says
        nothing of how surely the state is known there: the covariance stays."""
        gain = self._gain(bound, frozen)
        if gain is not None:
            self._x = self._x + gain @ bound.innovation

    def _gain(self, measurement: Measurement, frozen: int | slice | None) -> Array | None:
        """None beyond the measurement's gate. Leaves the innovation for the record."""
        h, z = measurement.h, measurement.innovation
        s = h @ self._p @ h.T + np.diag(measurement.variances)
        nis = float(z @ np.linalg.solve(s, z))
        used = nis <= measurement.gate
        self.innovations.append(
            Innovation(measurement.name, float(z[0]), math.sqrt(s[0, 0]), nis, len(z), used)
        )
        del self.innovations[:-KEPT]
        if not used:
            return None
        gain = np.asarray(np.linalg.solve(s, h @ self._p).T, np.float64)
        if frozen is not None:
            gain[frozen] = 0.0
        return gain
