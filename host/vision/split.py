"""The straight line that best divides a picture's features into two kinds.

Fisher's criterion for two classes, after the features were whitened by their total covariance, is a
monotone function of p1 p2 |m1 - m2|^2 (p: shares, m: means), the share R^2 of the variance that the
division explains. That needs first-order sums only, so that every line of a fan can be tried.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Literal

import numba
import numpy as np
from numpy.typing import NDArray

Side = Literal["left", "right", "top", "bottom"]
SIDES: tuple[Side, ...] = ("left", "right", "top", "bottom")
TOWARDS_CROP: dict[Side, float] = {"right": 0.0, "bottom": 90.0, "left": 180.0, "top": 270.0}
"""Direction of the standing crop in degrees, from u towards v."""

Features = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Line:
    """Where u cos + v sin = offset, in pixels; standing crop is where it is greater."""

    angle_rad: float
    """Direction towards the standing crop, from u towards v."""
    offset_px: float
    explained: float
    """Share 0..1 of the features' variance that the division explains."""

    def signed(self, u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance in pixels, positive on the standing side."""
        d = u * math.cos(self.angle_rad) + v * math.sin(self.angle_rad) - self.offset_px
        return np.asarray(d)


def whiten(features: Features) -> Features:
    """(h, w, n) features to (h, w, n) with zero mean and unit covariance; directions in which they
    hardly vary are left small instead of being blown up."""
    h, w, n = features.shape
    flat = features.reshape(-1, n).astype(np.float64)
    flat = flat - flat.mean(0)
    scale = flat.std(0)
    flat = flat / np.where(scale > 1e-6, scale, 1.0)
    values, vectors = np.linalg.eigh(flat.T @ flat / len(flat))
    out = flat @ (vectors / np.sqrt(np.maximum(values, 0.02)))
    return np.ascontiguousarray(out.reshape(h, w, n), dtype=np.float32)


@functools.lru_cache(maxsize=64)
def fan(side: Side, half_deg: float, step_deg: float) -> NDArray[np.float32]:
    """Angles in radians around the side's own direction."""
    a = np.arange(-half_deg, half_deg + step_deg / 2, step_deg)
    return np.radians(TOWARDS_CROP[side] + a).astype(np.float32)


@numba.njit(cache=True, nogil=True)
def _explained(
    f: Features, angles: NDArray[np.float32], least: float, out: NDArray[np.float32]
) -> None:
    height, width, n = f.shape
    bins = out.shape[1]
    total = np.zeros(n)
    for v in range(height):
        for u in range(width):
            for k in range(n):
                total[k] += f[v, u, k]
    sums = np.zeros((bins, n))
    counts = np.zeros(bins)
    for a in range(angles.shape[0]):
        sums[:] = 0.0
        counts[:] = 0.0
        c, s = math.cos(angles[a]), math.sin(angles[a])
        middle = 0.5 * bins - c * 0.5 * (width - 1) - s * 0.5 * (height - 1)
        for v in range(height):
            for u in range(width):
                b = int(c * u + s * v + middle)
                counts[b] += 1.0
                for k in range(n):
                    sums[b, k] += f[v, u, k]
        all_ = float(height * width)
        before = 0.0
        part = np.zeros(n)
        for b in range(bins):
            before += counts[b]
            for k in range(n):
                part[k] += sums[b, k]
            after = all_ - before
            out[a, b] = 0.0
            if before < least * all_ or after < least * all_:
                continue
            j = 0.0
            for k in range(n):
                d = part[k] / before - (total[k] - part[k]) / after
                j += d * d
            out[a, b] = j * before * after / (all_ * all_)


def explained(
    features: Features, angles: NDArray[np.float32], least_share: float = 0.05
) -> tuple[NDArray[np.float32], float]:
    """R^2 (angle, offset bin) of every dividing line, 0 where a side would hold less than
    `least_share` of the picture; and the offset in grid cells, from the picture's middle, of bin
    0's upper border. Bins are one cell wide."""
    h, w, _ = features.shape
    bins = math.ceil(math.hypot(h, w)) + 2
    out = np.zeros((len(angles), bins), np.float32)
    _explained(features, angles, least_share, out)
    return out, 1.0 - 0.5 * bins


def best_line(
    features: Features,
    side: Side,
    cell_px: float,
    *,
    half_deg: float = 65.0,
    step_deg: float = 5.0,
    least_share: float = 0.05,
) -> Line:
    """The dividing line with the greatest R^2 over whitened (h, w, n) features on a grid of square
    cells of `cell_px`, refined below the grid's step by parabolas."""
    angles = fan(side, half_deg, step_deg)
    r2, first = explained(features, angles, least_share)
    a, b = (int(i) for i in np.unravel_index(int(r2.argmax()), r2.shape))
    fine = (angles[a] + np.radians(np.arange(-0.8, 0.81, 0.2) * step_deg)).astype(np.float32)
    r2, first = explained(features, fine, least_share)
    a, b = (int(i) for i in np.unravel_index(int(r2.argmax()), r2.shape))
    h, w, _ = features.shape
    angle = float(fine[a])
    offset = first + b + _vertex(r2[a], b)
    # cell (i, j) covers pixels [j, j + 1) * cell_px, so its middle is half a cell further
    middle = math.cos(angle) * 0.5 * w + math.sin(angle) * 0.5 * h
    return Line(angle, (offset + middle) * cell_px, float(r2[a, b]))


def _vertex(values: NDArray[np.float32], i: int) -> float:
    """Where the parabola through three neighbouring values peaks, relative to the middle one."""
    if not 0 < i < len(values) - 1:
        return 0.0
    lo, mid, hi = float(values[i - 1]), float(values[i]), float(values[i + 1])
    bend = lo - 2 * mid + hi
    return 0.0 if bend >= 0 else max(-0.5, min(0.5, 0.5 * (lo - hi) / bend))
