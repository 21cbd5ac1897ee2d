"""Two kinds of ground beside an edge, learnt from the picture itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

Features = NDArray[np.float32]
Distances = NDArray[np.float32]

RIDGE = 0.15
"""Of each feature's variance within the kinds, added to it: too few cells must not make a feature
look sharp."""
CELLS_PER_FEATURE = 3
"""Of a kind of ground, for its covariance to be known."""
ALIKE = 0.6
"""Weight of the two kinds' mean covariance in each one's own."""
STRANGE = 0.5
"""Share of what is not crop that is like neither kind (a cut face, a shadow, trampled stalks): all
that is known of it is that it varies about the crop."""
WIDER = 3.0
"""By this factor more, in variance, than crop itself does."""
FLATTER = 0.7
"""Neighbouring cells tell the same thing: factor on the logarithm of the odds."""
SUM_PER = 32
"""Steps of the table of logarithms of sums, for each unit of the logarithm."""
SUM = np.log1p(np.exp(-np.arange(0, 12, 1 / SUM_PER))).astype(np.float32)
"""What the logarithm of a sum is above that of its greater part, by how far their logarithms are
apart, in steps of 1 / SUM_PER."""


@dataclass(frozen=True, slots=True)
class Reach:
    """Which cells are learnt from, by their distance to the edge; all in the distances' unit."""

    crop: float
    """Depth on the standing side."""
    cut: float
    dead: float
    """Nearer than this a cell may hold both kinds."""


@dataclass(frozen=True, slots=True)
class Kinds:
    """Mean and covariance of crop (0) and of cut (1)."""

    means: NDArray[np.float64]
    """(2, n)."""
    covariances: NDArray[np.float64]
    """(2, n, n)."""

    def discriminant(self) -> Discriminant:
        """Fisher's."""
        within = self.covariances.mean(0)
        scale = _deviation(within)
        apart = (self.means[0] - self.means[1]) / scale
        weights = np.linalg.solve(_ridged(within, scale), apart)
        return Discriminant(
            (weights / scale).astype(np.float32),
            float(self.means.mean(0) @ (weights / scale)),
            math.sqrt(max(0.0, float(apart @ weights))),
        )

    def odds(self, features: Features) -> NDArray[np.float32]:
        """(h, w) logarithm of the odds that (h, w, n) features are crop, the kinds being normal and
        a share of what is not crop strange to both."""
        n = self.means.shape[1]
        within = self.covariances.mean(0)
        scale = _deviation(within)
        own = (1.0 - ALIKE) * self.covariances + ALIKE * within
        roots = np.stack([np.linalg.cholesky(_ridged(c, scale)) for c in own])
        inverse = np.stack([np.linalg.inv(r) for r in roots]) / scale
        volume = np.log(np.stack([np.diag(r) for r in roots])).sum(1)
        lead = np.array(
            [
                math.log(1.0 - STRANGE) + volume[0] - volume[1],
                math.log(STRANGE) - 0.5 * n * math.log(WIDER),
            ]
        )
        out = np.empty(features.shape[:2], np.float32)
        _odds(
            features,
            self.means.astype(np.float32),
            inverse.astype(np.float32),
            lead.astype(np.float32),
            out,
        )
        return out


@dataclass(frozen=True, slots=True)
class Discriminant:
    """`features @ weights - middle` is positive for standing crop."""

    weights: NDArray[np.float32]
    middle: float
    apart: float
    """By how many standard deviations the two kinds' means differ."""

    def value(self, features: Features) -> NDArray[np.float32]:
        """(h, w) of (h, w, n) features."""
        return np.asarray(features @ self.weights - np.float32(self.middle), np.float32)


def _deviation(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.sqrt(np.maximum(np.diag(covariance), 1e-6)))


def _ridged(covariance: NDArray[np.float64], scale: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(covariance / np.outer(scale, scale) + RIDGE * np.eye(len(scale)))


@numba.njit(cache=True, nogil=True, boundscheck=False, fastmath={"reassoc", "nsz"})
def _moments(
    features: Features,
    distances: Distances,
    reach: tuple[float, float, float],
    counts: NDArray[np.float64],
    means: NDArray[np.float64],
    covariances: NDArray[np.float64],
) -> None:
    """Cells, means (2, n) and covariances (2, n, n) of crop and of cut. Either kind's cells are put
    side by side first, feature by feature: sums over neighbours are what compilers make quick."""
    height, width, n = features.shape
    crop, cut, dead = reach
    for k in range(2):
        low, high = (dead, crop) if k == 0 else (-cut, -dead)
        side = np.empty((n, height * width), np.float32)
        count = 0
        for i in range(height):
            for j in range(width):
                if low < distances[i, j] < high:
                    for a in range(n):
                        side[a, count] = features[i, j, a]
                    count += 1
        counts[k] = count
        for a in range(n):
            total = 0.0
            for c in range(count):
                total += side[a, c]
            means[k, a] = total / max(1, count)
            middle = np.float32(means[k, a])
            for c in range(count):
                side[a, c] -= middle
        for a in range(n):
            for b in range(a + 1):
                product = np.float32(0.0)
                for c in range(count):
                    product += side[a, c] * side[b, c]
                covariances[k, a, b] = covariances[k, b, a] = product / max(1, count - 1)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _odds(
    features: Features,
    means: NDArray[np.float32],
    inverse: NDArray[np.float32],
    lead: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """`inverse`: of the roots (lower triangles) of the covariances; `lead`: of cut and of what is
    strange, the logarithm of its density before crop's, its own distance left out. A row at a time,
    feature by feature: inner loops over neighbours are what compilers make quick."""
    height, width, n = features.shape
    x = np.empty((n, width), np.float32)
    y = np.empty(width, np.float32)
    squared = np.empty((2, width), np.float32)
    half, wider, flatter = np.float32(0.5), np.float32(1.0 / WIDER), np.float32(FLATTER)
    per, last = np.float32(SUM_PER), np.float32(SUM.shape[0] - 1.5)
    for i in range(height):
        for k in range(2):
            for a in range(n):
                for j in range(width):
                    x[a, j] = features[i, j, a] - means[k, a]
            squared[k, :] = 0.0
            for a in range(n):
                y[:] = 0.0
                for b in range(a + 1):
                    factor = inverse[k, a, b]
                    for j in range(width):
                        y[j] += factor * x[b, j]
                for j in range(width):
                    squared[k, j] += y[j] * y[j]
        for j in range(width):
            cut = lead[0] - half * squared[1, j]
            strange = lead[1] - half * squared[0, j] * wider
            # the logarithm of a sum, by a table, since logarithms are slow
            at = min(last, per * abs(cut - strange))
            n_th = int(at)
            more = SUM[n_th] + (at - n_th) * (SUM[n_th + 1] - SUM[n_th])
            out[i, j] = flatter * (-half * squared[0, j] - max(cut, strange) - more)


def learn(features: Features, distances: Distances, reach: Reach) -> Kinds | None:
    """From (h, w, n) features and (h, w) signed distances to the edge, positive on standing crop,
    NaN where a cell does not count. None where one side holds too little."""
    n = features.shape[2]
    counts, means, covariances = np.zeros(2), np.zeros((2, n)), np.zeros((2, n, n))
    _moments(features, distances, (reach.crop, reach.cut, reach.dead), counts, means, covariances)
    if counts.min() < CELLS_PER_FEATURE * n:
        return None
    return Kinds(means, covariances)
