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
APART_M = 0.5
"""From where on two meanings are kept apart, m. Nearer, one normal distribution holds both."""
FORGOTTEN = 0.02
"""Probability below which the alternative is dropped."""
LIKELIER = 0.7
"""And above which it is taken for the state: not at once, for the machine changes its course."""
SAYS_MOST = 0.5
"""By which one measurement that has a gate changes the logarithm of the alternative's odds at most:
pictures that follow each other err alike."""
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
def _dot(h: Array, v: Array) -> float:
    total = 0.0
    for k in range(len(h)):
        total += h[k] * v[k]
    return total


@njit(cache=True, nogil=True)
def _fuse(
    x: Array, p: Array, h: Array, z: float, noise: float, gate: float, held: int, apart: Array
) -> tuple[float, float, float]:
    """Joseph's form for one number, in place; nothing beyond the gate. `held`: a state that is
    considered and not changed, -1 for none. `apart`: to the state's alternative, which takes the
    number for itself; zeros where there is none. Returns the innovation's variance, its normalised
    square, and the alternative's. Compiled: numpy takes ten times as long for so few states."""
    n, hp, other_z = len(x), _times(h, p), z - _dot(h, apart)
    variance = noise
    for k in range(n):
        variance += hp[k] * h[k]
    nis, other = z * z / variance, other_z * other_z / variance
    gain = hp / variance
    if held >= 0:
        gain[held] = 0.0
    for k in range(n):
        if other <= gate:
            apart[k] += gain[k] * other_z
        if nis <= gate:
            apart[k] -= gain[k] * z
    if nis > gate:
        return variance, nis, other
    for k in range(n):
        x[k] += gain[k] * z
        for i in range(n):
            taken = gain[k] * hp[i] + hp[k] * gain[i]
            p[k, i] += gain[k] * gain[i] * variance - taken
    return variance, nis, other


@njit(cache=True, nogil=True)
def _meanings(z: float, sure: float, wide: float, share: float) -> tuple[float, float]:
    """How likely a number z off is what it seems, of variance `sure`, and no other, of variance
    `wide`, as `share` of such numbers are; and how likely the number is at all."""
    likely = (1.0 - share) * math.exp(-0.5 * z * z / sure) / math.sqrt(sure)
    unlikely = share * math.exp(-0.5 * z * z / wide) / math.sqrt(wide)
    total = likely + unlikely
    return (likely / total if total > 0.0 else 0.0), total


@njit(cache=True, nogil=True)
def _merged(z: float, sure: float, wide: float, weight: float) -> tuple[float, float]:
    """Of both meanings of a number taken together: the gain, for each unit of H P, and by how much
    their distance makes the state less sure."""
    if min(weight, 1.0 - weight) < PRUNED:
        weight = round(weight)
    apart = 1.0 / sure - 1.0 / wide
    return weight / sure + (1.0 - weight) / wide, weight * (1.0 - weight) * apart * apart * z * z


@njit(cache=True, nogil=True)
def _fuse_either(
    x: Array,
    p: Array,
    h: Array,
    z: float,
    noise: float,
    share: float,
    more: float,
    held: int,
    apart: Array,
    likely: float,
) -> tuple[float, float, float]:
    """`_fuse` of a number that is what it seems, or with probability `share` of something else,
    with a noise whose variance is larger by `more`; it has no gate. Where the two lead far apart,
    the likelier is taken and the other is the state's alternative from now on (Gaussian sum,
    Sorenson and Alspach, Automatica 7, 1971). Otherwise, or where there is one already, mean and
    covariance are those of the mixture of both (probabilistic data association, Bar-Shalom et al.
    2001, 6.4). Returns the innovation's variance and normalised square, and the alternative's
    probability, which was `likely`."""
    n, hp, other_z = len(x), _times(h, p), z - _dot(h, apart)
    own = _dot(hp, h)
    sure, wide = own + noise, own + noise + more
    weight, total = _meanings(z, sure, wide, share)
    gain, spread = _merged(z, sure, wide, weight)
    other_gain, leads = 0.0, own * (1.0 / sure - 1.0 / wide) * z
    if likely > 0.0:
        other_weight, other_total = _meanings(other_z, sure, wide, share)
        other_gain, other_spread = _merged(other_z, sure, wide, other_weight)
        of_both = (1.0 - likely) * total + likely * other_total
        likely = likely * other_total / of_both if of_both > 0.0 else likely
        mean = (1.0 - likely) * gain + likely * other_gain
        more_p = (1.0 - likely) * spread + likely * other_spread
    elif abs(leads) > APART_M and min(weight, 1.0 - weight) > FORGOTTEN:
        likely = min(weight, 1.0 - weight)
        gain, other_gain = 1.0 / sure, 1.0 / wide
        if weight < 0.5:
            gain, other_gain = other_gain, gain
        mean, more_p = (1.0 - likely) * gain + likely * other_gain, 0.0
    else:
        mean, more_p = gain, spread
    step = hp.copy()
    if held >= 0:
        step[held] = 0.0
    for k in range(n):
        x[k] += gain * z * step[k]
        if likely > 0.0:
            apart[k] += (other_gain * other_z - gain * z) * step[k]
        for i in range(n):
            taken = mean * (step[k] * hp[i] + hp[k] * step[i])
            p[k, i] += (mean + more_p) * step[k] * step[i] - taken
    return sure, z * z / sure, likely


class Filter:
    """State and covariance, and at times an alternative: another state, of the same covariance,
    that is kept until measurements have decided between the two. Subclasses predict."""

    def __init__(self, x: Array, p: Array) -> None:
        self._x, self._p = x, p
        self._apart: Array = np.zeros(len(x))
        """From the state to its alternative."""
        self.likely = 0.0
        """The alternative's probability; 0: there is none."""
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
        z = measurement.innovation
        other_z = z - measurement.h @ self._apart
        self._x = self._x + gain @ z
        self._apart = self._apart + gain @ (other_z - z)
        taken = gain @ hp
        # Joseph's form, multiplied out: it holds for any gain, and costs states squared.
        self._p = self._p - taken - taken.T + gain @ s @ gain.T
        self.heed(float(z @ np.linalg.solve(s, z) - other_z @ np.linalg.solve(s, other_z)) / 2)
        return True

    def _fuse_one(self, measurement: Measurement, frozen: Sequence[int]) -> bool:
        """`fuse` of a single number, as most are."""
        z, x, held = float(measurement.innovation[0]), self._x.copy(), frozen[0] if frozen else -1
        h, noise, apart = measurement.h[0], float(measurement.variances[0]), self._apart
        share, more = measurement.other
        if share > 0.0:
            variance, nis, self.likely = _fuse_either(
                x, self._p, h, z, noise, share, more, held, apart, self.likely
            )
            self._x = x
            self._decide()
        else:
            gate = measurement.gate
            variance, nis, other = _fuse(x, self._p, h, z, noise, gate, held, apart)
            self._x = x
            self.heed((nis - other) / 2)
        used = nis <= measurement.gate
        self._note(Innovation(measurement.name, z, math.sqrt(variance), nis, 1, used))
        return used

    def heed(self, log_ratio: float) -> None:
        """Something is so much likelier (the logarithm of its likelihoods' ratio) if the
        alternative is true."""
        if self.likely > 0.0:
            says = math.exp(min(SAYS_MOST, max(-SAYS_MOST, log_ratio)))
            self.likely *= says / (1.0 - self.likely + self.likely * says)
            self._decide()

    def keep_apart(self, by: Array, likely: float) -> None:
        """The state may also be another, (states,) `by` from it, with that probability. What was
        its alternative is forgotten."""
        self._apart, self.likely = by, likely

    def _decide(self) -> None:
        """Drops an alternative that is unlikely, and takes one that is likelier."""
        if self.likely > LIKELIER:
            self._x = self._x + self._apart
            self._apart, self.likely = -self._apart, 1.0 - self.likely
        if 0.0 < self.likely < FORGOTTEN:
            self.forget()

    def merge(self) -> None:
        """State and alternative become one: the mean and the covariance of both."""
        by, likely = self._apart, self.likely
        self._x = self._x + likely * by
        self._p = self._p + likely * (1.0 - likely) * np.outer(by, by)
        self.forget()

    def forget(self) -> None:
        """There is no alternative any more."""
        self.keep_apart(np.zeros(len(self._x)), 0.0)

    def sigma(self, h: Array) -> float:
        """Standard deviation, about the state, of what has the derivative `h`, (states,): where
        there is an alternative, of both."""
        own = float(h @ self._p @ h)
        if self.likely > 0.0:
            own += self.likely * float(h @ self._apart) ** 2
        return math.sqrt(max(0.0, own))

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
