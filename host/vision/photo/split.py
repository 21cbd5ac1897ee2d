"""The straight line that best divides a picture's features into standing and cut.

Over features whitened by their total covariance, the share of the variance that a division explains
is Fisher's criterion in another guise, and needs first-order sums only: every line of a fan is
tried. A cut face, a shadow or trampled stalks may lie between crop and stubble as a strip of a
third kind; the crop then ends at the border of a division into three. Which of the two divisions is
meant is weighed: how much more the three explain, and how well each tells the two kinds apart
beside its line.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from host.vision.photo.fisher import Features, Reach, learn

Floats = NDArray[np.floating]
Side = Literal["left", "right", "top", "bottom"]
SIDES: tuple[Side, ...] = ("left", "right", "top", "bottom")
TOWARDS_CROP: dict[Side, float] = {"right": 0.0, "bottom": 90.0, "left": 180.0, "top": 270.0}
"""Direction of the standing crop in degrees, from u towards v."""

HALF_FAN_DEG = 65.0
"""Lines that lean further from the vertical are no side of a swath."""
FAN_STEP_DEG = 5.0
"""From one line of the fan to the next."""
LEAST_VARIANCE = 0.02
"""Directions in which the features vary less than this share are left small."""
NEAR_SHARE = 0.12
"""Of the shorter side: how far from a line the two kinds are looked at."""


@dataclass(frozen=True, slots=True)
class Search:
    """What `best_line` may be told."""

    strip_share: float = 0.10
    """Greatest width of a strip, of the picture's shorter side."""
    strip_gain: float = 0.02
    """Gain in explained variance, of all features' together, that makes a strip believed where both
    divisions tell crop from cut equally well."""
    least_share: float = 0.05
    """Of the picture on either side of the line."""


@dataclass(frozen=True, slots=True)
class Line:
    """Where u cos + v sin = offset, in pixels or cells; standing crop is where it is greater."""

    angle_rad: float
    """Direction towards the standing crop, from u towards v."""
    offset: float
    explained: float = 0.0
    """Fisher's criterion 0..1 of the division into two: the share of the variance that it explains
    in the direction in which the two kinds differ most."""
    strip: float = 0.0
    """Width of the strip beside it, 0 without."""

    def signed(self, u: Floats, v: Floats) -> NDArray[np.float64]:
        """Distance, positive on the standing side."""
        d = u * math.cos(self.angle_rad) + v * math.sin(self.angle_rad) - self.offset
        return np.asarray(d)

    def scaled(self, factor: float) -> Line:
        """The same line on a grid that is finer by `factor`."""
        return Line(self.angle_rad, self.offset * factor, self.explained, self.strip * factor)


@numba.njit(cache=True, nogil=True, boundscheck=False, fastmath={"reassoc", "nsz"})
def _covariance(planes: Features, out: NDArray[np.float64]) -> None:
    """Of (n, cells) planes, from which their means are taken away. Plain loops: a threaded matrix
    product costs more than it saves at this size."""
    n, cells = planes.shape
    for j in range(n):
        total = 0.0
        for i in range(cells):
            total += planes[j, i]
        mean = np.float32(total / cells)
        for i in range(cells):
            planes[j, i] -= mean
    for j in range(n):
        for k in range(j + 1):
            product = np.float32(0.0)
            for i in range(cells):
                product += planes[j, i] * planes[k, i]
            out[j, k] = out[k, j] = product / cells


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _turned(planes: Features, turn: NDArray[np.float32], out: Features) -> None:
    n, cells = planes.shape
    column = np.empty(cells, np.float32)
    for j in range(n):
        column[:] = 0.0
        for k in range(n):
            factor = turn[k, j]
            for i in range(cells):
                column[i] += planes[k, i] * factor
        for i in range(cells):
            out[i, j] = column[i]


def whiten(features: Features) -> Features:
    """(h, w, n) features to (h, w, n) with zero mean and unit covariance."""
    h, w, n = features.shape
    planes = np.array(features.reshape(-1, n).T, order="C")  # a copy: it is centred in place
    covariance = np.empty((n, n))
    _covariance(planes, covariance)
    deviation = np.sqrt(np.diag(covariance))
    scale = np.where(deviation > 1e-6, deviation, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    turn = vectors / np.sqrt(np.maximum(values, LEAST_VARIANCE)) / scale[:, None]
    out = np.empty((h * w, n), np.float32)
    _turned(planes, turn.astype(np.float32), out)
    return out.reshape(h, w, n)


@functools.lru_cache(maxsize=64)
def _fan(side: Side) -> NDArray[np.float32]:
    """Angles in radians around the side's own direction."""
    a = np.arange(-HALF_FAN_DEG, HALF_FAN_DEG + FAN_STEP_DEG / 2, FAN_STEP_DEG)
    return np.radians(TOWARDS_CROP[side] + a).astype(np.float32)


@numba.njit(cache=True, nogil=True)
def _explained(
    f: Features,
    angles: NDArray[np.float32],
    widest: int,
    least: float,
    two: NDArray[np.float64],
    three: NDArray[np.float64],
    strip: NDArray[np.int32],
) -> None:
    """For every angle and bin border: the variance explained by the division there, the greatest by
    that division with a strip before it, and that strip's width in bins."""
    height, width, n = f.shape
    bins = two.shape[1]
    sums = np.zeros((bins + 1, n))
    counts = np.zeros(bins + 1)
    for a in range(angles.shape[0]):
        sums[:] = 0.0
        counts[:] = 0.0
        c, s = math.cos(angles[a]), math.sin(angles[a])
        middle = 0.5 * bins - c * 0.5 * (width - 1) - s * 0.5 * (height - 1)
        for v in range(height):
            for u in range(width):
                b = int(c * u + s * v + middle) + 1
                counts[b] += 1.0
                for k in range(n):
                    sums[b, k] += f[v, u, k]
        for b in range(bins):
            counts[b + 1] += counts[b]
            for k in range(n):
                sums[b + 1, k] += sums[b, k]
        total = counts[bins]
        for b in range(1, bins):
            before, after = counts[b], total - counts[b]
            if before < least * total or after < least * total:
                continue
            crop, cut = 0.0, 0.0
            for k in range(n):
                crop += (sums[bins, k] - sums[b, k]) ** 2
                cut += sums[b, k] ** 2
            crop /= after
            two[a, b] = (crop + cut / before) / total
            for w in range(2, min(widest, b - 1) + 1):
                rest, inside = counts[b - w], before - counts[b - w]
                if rest < least * total or inside < 0.01 * total:
                    continue
                cut, between = 0.0, 0.0
                for k in range(n):
                    cut += sums[b - w, k] ** 2
                    between += (sums[b, k] - sums[b - w, k]) ** 2
                value = (crop + cut / rest + between / inside) / total
                if value > three[a, b]:
                    three[a, b] = value
                    strip[a, b] = w


@dataclass(frozen=True, slots=True)
class _Division:
    line: Line
    variance: float
    """Explained, of all features together."""


def _divisions(
    features: Features, angles: NDArray[np.float32], search: Search
) -> tuple[_Division, _Division]:
    """The best division into two, and the best into three with a strip, over the angles."""
    h, w, _ = features.shape
    bins = math.ceil(math.hypot(h, w)) + 2
    two, three = np.zeros((len(angles), bins)), np.zeros((len(angles), bins))
    strip = np.zeros((len(angles), bins), np.int32)
    widest = int(search.strip_share * min(h, w))
    _explained(features, angles, widest, search.least_share, two, three, strip)
    explained = float(two.max())

    def best(values: NDArray[np.float64], width: NDArray[np.int32]) -> _Division:
        a, b = (int(i) for i in np.unravel_index(int(values.argmax()), values.shape))
        angle = float(angles[a])
        middle = math.cos(angle) * 0.5 * w + math.sin(angle) * 0.5 * h
        line = Line(angle, b - 0.5 * bins + middle, explained, float(width[a, b]))
        return _Division(line, float(values[a, b]))

    return best(two, np.zeros_like(strip)), best(three, strip)


def divided(features: Features, side: Side) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Angles (n,) of the coarse fan, and (n, bins) the variance that a division at each bin's lower
    border explains (`beyond`), of whitened (h, w, m) features."""
    h, w, _ = features.shape
    angles = _fan(side)
    shape = (len(angles), math.ceil(math.hypot(h, w)) + 2)
    two, three, strip = np.zeros(shape), np.zeros(shape), np.zeros(shape, np.int32)
    _explained(features, angles, 0, Search().least_share, two, three, strip)
    return angles, two


def beyond(angle_rad: float, border: int, bins: int, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Mask (h, w) of the cells that lie on the crop's side of a border of `divided`."""
    h, w = shape
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    middle = 0.5 * bins - c * 0.5 * (w - 1) - s * 0.5 * (h - 1)
    along = c * np.arange(w) + s * np.arange(h)[:, None] + middle
    return np.asarray(along.astype(np.int32) + 1 > border)


def _around(line: Line) -> NDArray[np.float32]:
    fan = line.angle_rad + np.radians(np.arange(-3.0, 3.1, 1.5))
    return np.asarray(fan, np.float32)


def _apart(features: Features, line: Line) -> float:
    """How well the features tell the two kinds apart beside the line."""
    h, w, _ = features.shape
    u, v = np.arange(w) + 0.5, np.arange(h)[:, None] + 0.5
    near = NEAR_SHARE * min(h, w)
    cut = near if line.strip == 0 else max(2.0, min(near, line.strip))
    kinds = learn(features, line.signed(u, v).astype(np.float32), Reach(near, cut, 0.5))
    return max(0.1, kinds.discriminant().apart) if kinds else 0.1


def best_line(
    features: Features, side: Side, search: Search | None = None, *, sets: int = 1
) -> Line:
    """The dividing line of (h, w, n) features on a grid of square cells, in cells (cell (i, j)
    covers [j, j + 1) x [i, i + 1)). The features are so many `sets` of whitened ones side by side,
    and what a line explains is the mean over them."""
    found = _best_line(features, side, search or Search())
    return replace(found, explained=found.explained / sets)


def _best_line(features: Features, side: Side, search: Search) -> Line:
    # the direction shows at half the sharpness too
    half = cv2.resize(features, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    half = np.asarray(half, np.float32).reshape(*half.shape[:2], -1)
    two, three = _divisions(half, _fan(side), search)
    coarse = two.line.angle_rad
    two, beside = _divisions(features, _around(two.line), search)
    if math.isinf(search.strip_gain):
        return two.line
    if three.line.angle_rad == coarse:
        three = beside
    else:
        _, three = _divisions(features, _around(three.line), search)
    gain = (three.variance - two.variance) / (features.shape[2] * search.strip_gain)
    better = math.log(_apart(features, three.line) / _apart(features, two.line))
    return three.line if three.line.strip > 0 and gain + better > 1.0 else two.line
