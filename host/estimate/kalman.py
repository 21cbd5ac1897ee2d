"""The one update that every measurement makes, and what it leaves for the record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from host.core.compiled import compiled

Array = NDArray[np.float64]
PRUNED = 0.15
"""Probability below which the less likely of two meanings is dropped, as in multiple hypothesis
tracking. Smaller: ends that are as expected leave the place less sure."""
APART_M = 0.5
"""From where on two meanings are kept apart, m. Nearer, one normal distribution holds both."""
FORGOTTEN = 0.05
"""Probability below which the alternative is dropped: as much as the geofence's two standard
deviations leave of the state itself."""
TOGETHER = 2.0
"""Squared Mahalanobis distance, up to which state and alternative are merged: nothing that is
measured tells them apart."""
LIKELIER = 0.7
"""And above which it is taken for the state: not at once, for the machine changes its course."""
SAYS_MOST = 0.5
"""By which one measurement that has a gate changes the logarithm of the alternative's odds at most:
pictures that follow each other err alike."""
TINY = 1e-9
"""Of a likelihood, whose logarithm is taken, and of a variance, by which is divided."""
KEPT = 64
"""Innovations that wait for a reader, at most: some seconds'."""


Indices = NDArray[np.int64]
"""(n,)."""


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


@compiled("(f8[::1], f8[:, ::1], f8[::1], f8, f8, f8, i8[::1])")
def _fuse(
    x: Array, p: Array, h: Array, z: float, noise: float, gate: float, held: Indices
) -> tuple[float, float]:
    """Joseph's form for one number, in place; nothing beyond the gate. `held`: states that are
    considered and not changed. Returns the innovation's variance and its normalised
    square. Compiled: numpy takes ten times as long for so few states."""
    n, hp = len(x), _times(h, p)
    variance = noise
    for k in range(n):
        variance += hp[k] * h[k]
    nis = z * z / variance
    if nis > gate:
        return variance, nis
    gain = hp / variance
    for k in held:
        gain[k] = 0.0
    for k in range(n):
        x[k] += gain[k] * z
        for i in range(n):
            taken = gain[k] * hp[i] + hp[k] * gain[i]
            p[k, i] += gain[k] * gain[i] * variance - taken
    return variance, nis


@compiled("(f8[:, ::1], f8[::1], f8, f8, f8, f8)")
def _meanings(
    p: Array, h: Array, z: float, noise: float, share: float, more: float
) -> tuple[float, float, float]:
    """Of a number that is what it seems, or with probability `share` of something else, with a
    noise whose variance is larger by `more`: how likely it is the former, how likely it is at all,
    and how far apart the two would lead what it measures."""
    hp = _times(h, p)
    own = 0.0
    for k in range(len(h)):
        own += hp[k] * h[k]
    sure, wide = own + noise, own + noise + more
    likely = (1.0 - share) * math.exp(-0.5 * z * z / sure) / math.sqrt(sure)
    unlikely = share * math.exp(-0.5 * z * z / wide) / math.sqrt(wide)
    total = likely + unlikely
    apart = abs(z) * own * (1.0 / sure - 1.0 / wide)
    return (likely / total if total > 0.0 else 0.0), total, apart


@compiled("(f8[::1], f8[:, ::1], f8[::1], f8, f8, f8, f8, i8[::1])")
def _fuse_either(
    x: Array, p: Array, h: Array, z: float, noise: float, more: float, weight: float, held: Indices
) -> tuple[float, float]:
    """`_fuse` of a number that is what it seems with probability `weight`, and otherwise has a
    noise whose variance is larger by `more`; it has no gate. Each of the two is taken; mean and
    covariance are those of the mixture of both (Gaussian sum, Sorenson and Alspach, Automatica 7,
    1971, merged to one normal distribution as in probabilistic data association, Bar-Shalom et al.
    2001, 6.4). So a number that may be either moves the state by a part, and leaves it less
    sure."""
    n, hp = len(x), _times(h, p)
    own = 0.0
    for k in range(n):
        own += hp[k] * h[k]
    sure, wide = own + noise, own + noise + more
    if min(weight, 1.0 - weight) < PRUNED:
        weight = round(weight)
    gain = weight / sure + (1.0 - weight) / wide
    apart = 1.0 / sure - 1.0 / wide
    spread = weight * (1.0 - weight) * apart * apart * z * z
    step = hp.copy()
    for k in held:
        step[k] = 0.0
    for k in range(n):
        x[k] += gain * z * step[k]
        for i in range(n):
            taken = gain * (step[k] * hp[i] + hp[k] * step[i])
            p[k, i] += (gain + spread) * step[k] * step[i] - taken
    return sure, z * z / sure


class _Taken(NamedTuple):
    """What a measurement makes of a state."""

    x: Array
    p: Array
    innovation: Innovation
    log_likelihood: float
    """But for a constant."""


def _gain(
    p: Array, measurement: Measurement, frozen: Sequence[int]
) -> tuple[Array, Array, Array, Innovation]:
    """The gain, H P, the innovation's covariance, and what is left for the record."""
    h, z = measurement.h, measurement.innovation
    hp = h @ p
    s = hp @ h.T + np.diag(measurement.variances)
    nis = float(z @ np.linalg.solve(s, z))
    gain = np.asarray(np.linalg.solve(s, hp).T, np.float64)
    if frozen:
        gain[list(frozen)] = 0.0
    used = nis <= measurement.gate
    return gain, hp, s, _innovation(measurement, s[0, 0], nis, used=used)


def _innovation(m: Measurement, variance: float, nis: float, *, used: bool) -> Innovation:
    z = m.innovation
    return Innovation(m.name, float(z[0]), math.sqrt(variance), nis, len(z), used)


def _taken(x: Array, p: Array, measurement: Measurement, frozen: Sequence[int]) -> _Taken:
    """Of a measurement with a gate. Writes to `p`."""
    z = measurement.innovation
    if len(z) == 1:
        x, held = x.copy(), np.array(frozen, np.int64)
        h, noise = measurement.h[0], float(measurement.variances[0])
        variance, nis = _fuse(x, p, h, float(z[0]), noise, measurement.gate, held)
        innovation = _innovation(measurement, variance, nis, used=nis <= measurement.gate)
        return _Taken(x, p, innovation, -0.5 * (nis + math.log(variance)))
    gain, hp, s, innovation = _gain(p, measurement, frozen)
    log_likelihood = -0.5 * (innovation.nis + float(np.linalg.slogdet(s)[1]))
    if innovation.used:
        taken = gain @ hp
        x = x + gain @ z
        # Joseph's form, multiplied out: it holds for any gain, and costs states squared.
        p = p - taken - taken.T + gain @ s @ gain.T
    return _Taken(x, p, innovation, log_likelihood)


def _taken_either(x: Array, p: Array, measurement: Measurement, frozen: Sequence[int]) -> _Taken:
    """Of a number that may be of something else. Writes to `p`."""
    x, held = x.copy(), np.array(frozen, np.int64)
    h, z = measurement.h[0], float(measurement.innovation[0])
    noise, (share, more) = float(measurement.variances[0]), measurement.other
    weight, total, _ = _meanings(p, h, z, noise, share, more)
    variance, nis = _fuse_either(x, p, h, z, noise, more, weight, held)
    innovation = _innovation(measurement, variance, nis, used=True)
    return _Taken(x, p, innovation, math.log(max(total, TINY)))


class Filter:
    """State and covariance, and at times an alternative to both, that is kept until measurements
    have decided between the two (a Gaussian sum of two, merged where they come together).
    Subclasses predict."""

    def __init__(self, x: Array, p: Array) -> None:
        self._x, self._p = x, p
        self._apart: Array = np.zeros(len(x))
        """From the state to its alternative,"""
        self._other_p: Array = p
        """and the alternative's covariance."""
        self.likely = 0.0
        """The alternative's probability; 0: there is none."""
        self.innovations: list[Innovation] = []
        """Since whoever reads them has emptied it; the latest KEPT at most."""

    @property
    def _covariances(self) -> tuple[Array, ...]:
        """The state's, and the alternative's if there is one."""
        return (self._p,) if self.likely == 0.0 else (self._p, self._other_p)

    def fuse(self, measurement: Measurement, *, frozen: Sequence[int] = ()) -> bool:
        """Takes the measurement and returns True, or refuses it. The states `frozen` are considered
        and not changed (Schmidt-Kalman)."""
        either = measurement.other[0] > 0.0
        if either and self.likely == 0.0 and self._taken_apart(measurement, frozen):
            return True
        take = _taken_either if either else _taken
        before = self._x
        here = take(before, self._p, measurement, frozen)
        self._x, self._p = here.x, here.p
        self._note(here.innovation)
        if self.likely > 0.0:
            from_there = replace(
                measurement, innovation=measurement.innovation - measurement.h @ self._apart
            )
            there = take(before + self._apart, self._other_p, from_there, frozen)
            self._apart, self._other_p = there.x - here.x, there.p
            most = math.inf if either else SAYS_MOST
            self.heed(there.log_likelihood - here.log_likelihood, most)
        return here.innovation.used

    def taken_if(
        self, by: Array, measurement: Measurement, *, frozen: Sequence[int] = ()
    ) -> tuple[Array, Array]:
        """State and covariance if the state errs by `by`, (states,), besides what is known, and the
        measurement is of nothing else."""
        only = replace(measurement, other=(0.0, 0.0))
        taken = _taken(self._x, self._p + np.outer(by, by), only, frozen)
        return taken.x, taken.p

    def may_err(self, by: Array) -> None:
        """The state may err by `by`, (states,), all in one: its standard deviation."""
        for p in self._covariances:
            p[:] += np.outer(by, by)

    def _taken_apart(self, measurement: Measurement, frozen: Sequence[int]) -> bool:
        """Takes what may be of something else for what is likelier, and keeps the other as an
        alternative, where the two lead far apart."""
        z, noise = float(measurement.innovation[0]), float(measurement.variances[0])
        share, more = measurement.other
        weight, _, leads = _meanings(self._p, measurement.h[0], z, noise, share, more)
        if leads < APART_M or min(weight, 1.0 - weight) < FORGOTTEN:
            return False
        sure, wide = (
            _taken(
                self._x,
                self._p.copy(),
                replace(measurement, gate=math.inf, variances=measurement.variances + more_m2),
                frozen,
            )
            for more_m2 in (0.0, more)
        )
        here, there = (sure, wide) if weight >= 0.5 else (wide, sure)
        self._x, self._p = here.x, here.p
        self.keep_apart(there.x - here.x, there.p, min(weight, 1.0 - weight))
        self._note(sure.innovation)
        return True

    def heed(self, log_ratio: float, most: float = SAYS_MOST) -> None:
        """Something is so much likelier (the logarithm of the likelihoods' ratio) if the
        alternative is true; it counts `most` at most."""
        if self.likely == 0.0:
            return
        says = math.exp(min(most, max(-most, log_ratio)))
        self.likely *= says / (1.0 - self.likely + self.likely * says)
        if self.likely > LIKELIER:
            self._x = self._x + self._apart
            self._apart, self.likely = -self._apart, 1.0 - self.likely
            self._p, self._other_p = self._other_p, self._p
        if self.likely < FORGOTTEN:
            self.forget()

    def keep_apart(self, by: Array, p: Array, likely: float) -> None:
        """The state may also be another, (states,) `by` from it, with the covariance `p` and that
        probability. What was its alternative is forgotten."""
        self._apart, self._other_p, self.likely = by, p, likely

    def settle(self, of: Sequence[int]) -> None:
        """Merges state and alternative where they are together, as far as the states `of` say, m:
        near each other, or no farther apart than either is unsure of."""
        if self.likely == 0.0:
            return
        at = list(of)
        by, apart = self._apart[at], [p[np.ix_(at, at)] for p in self._covariances]
        near = float(np.abs(by).max()) < APART_M / 2
        if near or all(
            by @ np.linalg.solve(p + TINY * np.eye(len(at)), by) < TOGETHER for p in apart
        ):
            self.merge()

    def merge(self) -> None:
        """State and alternative become one: the mean and the covariance of both."""
        by, likely = self._apart, self.likely
        self._x = self._x + likely * by
        self._p = (1.0 - likely) * self._p + likely * self._other_p
        self._p = self._p + likely * (1.0 - likely) * np.outer(by, by)
        self.forget()

    def forget(self) -> None:
        """There is no alternative any more."""
        self.keep_apart(np.zeros(len(self._x)), self._p, 0.0)

    def sigma(self, h: Array) -> float:
        """Standard deviation, about the state, of what has the derivative `h`, (states,): where
        there is an alternative, of both."""
        # `dot` gives what `@` does, and for so few states in half of its time.
        variance = float(h.dot(self._p).dot(h))
        if self.likely > 0.0:
            other = float(h @ self._other_p @ h) + float(h @ self._apart) ** 2
            variance += self.likely * (other - variance)
        return math.sqrt(max(0.0, variance))

    def _note(self, innovation: Innovation) -> None:
        self.innovations.append(innovation)
        del self.innovations[:-KEPT]

    def yield_to(
        self, bound: Measurement, *, moves: Sequence[int], alone: int | None = None
    ) -> None:
        """Moves the states `moves` towards a bound that they violate, or instead of them all the
        one `alone`, as far. It says nothing of how surely they are known there: the covariance
        stays."""
        gain, _, _, innovation = _gain(self._p, bound, ())
        self._note(innovation)
        if innovation.used:
            at, step = list(moves), gain[list(moves)] @ bound.innovation
            if alone is not None:
                at, step = [alone], bound.h[:, at] @ step / bound.h[0, alone]
            self._x = self._x.copy()
            self._x[at] += step

    def doubt(self, measurement: Measurement, states: Sequence[int], growth: float) -> None:
        """Takes back some of what these states say of what was measured: its standard deviation
        grows so many times."""
        h = np.zeros_like(measurement.h)
        at = list(states)
        h[:, at] = measurement.h[:, at]
        for p in self._covariances:
            ph = np.zeros((len(p), len(h)))
            ph[at] = p[at] @ h.T
            grown = np.linalg.pinv(h @ ph) @ ph.T
            p[:] += (growth**2 - 1.0) * ph @ grown
