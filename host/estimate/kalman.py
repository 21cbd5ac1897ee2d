"""The one update that every measurement makes, and what it leaves for the record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
PRUNED = 0.15
"""Probability below which the less likely of two meanings is dropped, as in multiple hypothesis
tracking. Smaller: ends that are as expected leave the place less sure."""
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
    other: tuple[float, float] = (0.0, 0.0)
    """Of a single number, instead of a gate: the share of such measurements that are of something
    else, and by how much their variance is larger for it."""


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


@njit(cache=True, nogil=True)
def _times(h: Array, p: Array) -> Array:
    """H P of one number; most of `h` is zero."""
    hp = np.zeros(len(h))
    for k in range(len(h)):
        if h[k] != 0.0:
            for i in range(len(h)):
                hp[i] += h[k] * p[k, i]
    return hp


@njit(cache=True, nogil=True)
def _fuse(
    x: Array, p: Array, h: Array, z: float, noise: float, gate: float, held: int
) -> tuple[float, float]:
    """Joseph's form for one number, in place; nothing beyond the gate. `held`: a state that is
    considered and not changed, -1 for none. Returns the innovation's variance and its normalised
    square. Compiled: numpy takes ten times as long for so few states."""
    n, hp = len(x), _times(h, p)
    variance = noise
    for k in range(n):
        variance += hp[k] * h[k]
    nis = z * z / variance
    if nis > gate:
        return variance, nis
    gain = hp / variance
    if held >= 0:
        gain[held] = 0.0
    for k in range(n):
        x[k] += gain[k] * z
        for i in range(n):
            taken = gain[k] * hp[i] + hp[k] * gain[i]
            p[k, i] += gain[k] * gain[i] * variance - taken
    return variance, nis


@njit(cache=True, nogil=True)
def _fuse_either(
    x: Array, p: Array, h: Array, z: float, noise: float, share: float, more: float, held: int
) -> tuple[float, float]:
    """`_fuse` of a number that is what it seems, or with probability `share` of something else,
    with a noise whose variance is larger by `more`; it has no gate. Each of the two is taken; mean
    and covariance are those of the mixture of both (Gaussian sum, Sorenson and Alspach, Automatica
    7, 1971, merged to one normal distribution as in probabilistic data association, Bar-Shalom et
    al. 2001, 6.4). So a number that may be either moves the state by a part, and leaves it less
    sure."""
    n, hp = len(x), _times(h, p)
    own = 0.0
    for k in range(n):
        own += hp[k] * h[k]
    sure, wide = own + noise, own + noise + more
    likely = (1.0 - share) * math.exp(-0.5 * z * z / sure) / math.sqrt(sure)
    unlikely = share * math.exp(-0.5 * z * z / wide) / math.sqrt(wide)
    total = likely + unlikely
    weight = likely / total if total > 0.0 else 0.0
    if min(weight, 1.0 - weight) < PRUNED:
        weight = round(weight)
    gain = weight / sure + (1.0 - weight) / wide
    apart = 1.0 / sure - 1.0 / wide
    spread = weight * (1.0 - weight) * apart * apart * z * z
    step = hp.copy()
    if held >= 0:
        step[held] = 0.0
    for k in range(n):
        x[k] += gain * z * step[k]
        for i in range(n):
            taken = gain * (step[k] * hp[i] + hp[k] * step[i])
            p[k, i] += (gain + spread) * step[k] * step[i] - taken
    return sure, z * z / sure


class Filter:
    """State and covariance. Subclasses predict."""

    def __init__(self, x: Array, p: Array) -> None:
        self._x, self._p = x, p
        self.innovations: list[Innovation] = []
        """Since whoever reads them has emptied it; the latest KEPT at most."""

    def fuse(self, measurement: Measurement, *, frozen: Sequence[int] = ()) -> bool:
        """Takes the measurement and returns True, or refuses it. The states `frozen` are considered
        and not changed (Schmidt-Kalman)."""
        if len(measurement.innovation) == 1 and len(frozen) <= 1:
            return self._fuse_one(measurement, frozen)
        gain, hp, s = self._gain(measurement, frozen)
        if gain is None:
            return False
        self._x = self._x + gain @ measurement.innovation
        taken = gain @ hp
        # Joseph's form, multiplied out: it holds for any gain, and costs states squared.
        self._p = self._p - taken - taken.T + gain @ s @ gain.T
        return True

    def _fuse_one(self, measurement: Measurement, frozen: Sequence[int]) -> bool:
        """`fuse` of a single number, as most are."""
        z, x, held = float(measurement.innovation[0]), self._x.copy(), frozen[0] if frozen else -1
        h, noise = measurement.h[0], float(measurement.variances[0])
        share, more = measurement.other
        if share > 0.0:
            variance, nis = _fuse_either(x, self._p, h, z, noise, share, more, held)
        else:
            variance, nis = _fuse(x, self._p, h, z, noise, measurement.gate, held)
        used = nis <= measurement.gate
        self._note(Innovation(measurement.name, z, math.sqrt(variance), nis, 1, used))
        if used:
            self._x = x
        return used

    def _note(self, innovation: Innovation) -> None:
        self.innovations.append(innovation)
        del self.innovations[:-KEPT]

    def yield_to(self, bound: Measurement, *, moves: Sequence[int]) -> None:
        """Moves the states `moves` towards a bound that they violate. It says nothing of how surely
        they are known there: the covariance stays."""
        gain, _, _ = self._gain(bound, ())
        if gain is not None:
            at = list(moves)
            self._x = self._x.copy()
            self._x[at] += gain[at] @ bound.innovation

    def doubt(self, measurement: Measurement, states: slice, growth: float) -> None:
        """Takes back some of what these states say of what was measured: its standard deviation
        grows so many times."""
        h = np.zeros_like(measurement.h)
        h[:, states] = measurement.h[:, states]
        ph = np.zeros((len(self._p), len(h)))
        ph[states] = self._p[states] @ h.T
        grown = np.linalg.solve(h @ ph, ph.T)
        self._p = self._p + (growth**2 - 1.0) * ph @ grown

    def _gain(
        self, measurement: Measurement, frozen: Sequence[int]
    ) -> tuple[Array | None, Array, Array]:
        """The gain (None beyond the measurement's gate), H P and the innovation's covariance.
        Leaves the innovation for the record."""
        h, z = measurement.h, measurement.innovation
        hp = h @ self._p
        s = hp @ h.T + np.diag(measurement.variances)
        nis = float(z @ np.linalg.solve(s, z))
        used = nis <= measurement.gate
        self._note(Innovation(measurement.name, float(z[0]), math.sqrt(s[0, 0]), nis, len(z), used))
        if not used:
            return None, hp, s
        gain = np.asarray(np.linalg.solve(s, hp).T, np.float64)
        if frozen:
            gain[list(frozen)] = 0.0
        return gain, hp, s
