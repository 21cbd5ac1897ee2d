"""Fisher's discriminant of the two kinds beside an edge, learnt from the picture itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

Features = NDArray[np.float32]
Distances = NDArray[np.float32]

RIDGE = 0.15
"""Of the mean variance within the kinds, added to each: too few cells must not make a feature look
sharp."""
CELLS_PER_FEATURE = 3


@dataclass(frozen=True, slots=True)
class Reach:
    """Which cells are learnt from, by their distance to the edge; all in the distances' unit."""

    crop: float
    """Depth on the standing side."""
    cut: float
    dead: float
    """Nearer than this a cell may hold both kinds."""


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


@numba.njit(cache=True, nogil=True)
def _moments(
    features: Features,
    distances: Distances,
    reach: tuple[float, float, float],
    counts: NDArray[np.float64],
    means: NDArray[np.float64],
    within: NDArray[np.float64],
) -> None:
    """Cells, means (2, n) of crop and cut, and the mean of their two covariances (n, n)."""
    height, width, n = features.shape
    crop, cut, dead = reach
    side = np.full((height, width), -1, np.int8)
    for i in range(height):
        for j in range(width):
            d = distances[i, j]
            if dead < d < crop:
                side[i, j] = 0
            elif -cut < d < -dead:
                side[i, j] = 1
            else:
                continue
            k = side[i, j]
            counts[k] += 1.0
            for a in range(n):
                means[k, a] += features[i, j, a]
    for k in range(2):
        for a in range(n):
            means[k, a] /= max(1.0, counts[k])
    squares = np.zeros((2, n, n), np.float32)
    centred = np.zeros(n, np.float32)
    middle = means.astype(np.float32)
    for i in range(height):
        for j in range(width):
            k = side[i, j]
            if k < 0:
                continue
            for a in range(n):
                centred[a] = features[i, j, a] - middle[k, a]
            for a in range(n):
                for b in range(a + 1):
                    squares[k, a, b] += centred[a] * centred[b]
    for a in range(n):
        for b in range(a + 1):
            total = 0.0
            for k in range(2):
                total += 0.5 * squares[k, a, b] / max(1.0, counts[k] - 1.0)
            within[a, b] = total
            within[b, a] = total


def discriminant(features: Features, distances: Distances, reach: Reach) -> Discriminant | None:
    """Learnt from (h, w, n) features and (h, w) signed distances to the edge, positive on standing
    crop, NaN where a cell does not count. None where one side holds too little."""
    n = features.shape[2]
    counts, means, within = np.zeros(2), np.zeros((2, n)), np.zeros((n, n))
    _moments(features, distances, (reach.crop, reach.cut, reach.dead), counts, means, within)
    if counts.min() < CELLS_PER_FEATURE * n:
        return None
    scale = np.sqrt(np.maximum(np.diag(within), 1e-6))
    apart = (means[0] - means[1]) / scale
    weights = np.linalg.solve(within / np.outer(scale, scale) + RIDGE * np.eye(n), apart)
    return Discriminant(
        (weights / scale).astype(np.float32),
        float(0.5 * (means[0] + means[1]) @ (weights / scale)),
        math.sqrt(max(0.0, float(apart @ weights))),
    )
