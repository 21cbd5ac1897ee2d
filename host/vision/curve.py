"""From a dividing line to the edge itself: a curve beside the line, where a discriminant that is
learnt on both sides of it changes sign."""

from __future__ import annotations

import math

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from host.vision.split import Features, Line

STEPS = 3
"""Cells that the curve may move sideways from one cell to the next."""
BEND = 16.0
"""Cost of moving by one cell; the discriminant is clipped to +-CLIP."""
CLIP = 3.0
RIDGE = 0.05
BAND_SHARE = 0.08
"""Of the picture's shorter side: how far the curve may leave the line."""
NEAR_SHARE = 0.20
"""How far from the line the discriminant learns."""
DEAD_CELLS = 1.0
"""So near to the line it does not: cells there hold both."""


def discriminant(
    features: Features, signed: NDArray[np.float64], near: float, strip: float
) -> tuple[NDArray[np.float32], float] | None:
    """Fisher's discriminant of the cells beside a line (`signed`: distances in cells), (h, w),
    positive for standing crop; and by how many standard deviations the two kinds' means differ.
    None where one side holds too little."""
    n = features.shape[2]
    before = near if strip == 0 else max(3.0, min(near, strip))
    crop = features[(signed > DEAD_CELLS) & (signed < near)]
    cut = features[(signed < -DEAD_CELLS) & (signed > -before)]
    if min(len(crop), len(cut)) < 4 * n:
        return None
    a, b = crop.mean(0), cut.mean(0)
    within = 0.5 * (np.cov(crop.T) + np.cov(cut.T)).reshape(n, n)
    within += RIDGE * np.trace(within) / n * np.eye(n)
    weights = np.linalg.solve(within, (a - b).astype(np.float64))
    apart = math.sqrt(max(0.0, float((a - b) @ weights)))
    value = (features - 0.5 * (a + b)) @ weights.astype(np.float32)
    return np.clip(value, -CLIP, CLIP).astype(np.float32), apart


@numba.njit(cache=True, nogil=True)
def _path(cost: NDArray[np.float64], bend: float, path: NDArray[np.int32]) -> None:
    """The cheapest way through the rows of `cost`, with `bend` times the squared sideways step."""
    rows, columns = cost.shape
    total = cost.copy()
    came = np.zeros((rows, columns), np.int32)
    for t in range(1, rows):
        for s in range(columns):
            best, at = np.inf, s
            for d in range(-STEPS, STEPS + 1):
                if 0 <= s + d < columns:
                    value = total[t - 1, s + d] + bend * d * d
                    if value < best:
                        best, at = value, s + d
            total[t, s] += best
            came[t, s] = at
    path[rows - 1] = int(np.argmin(total[rows - 1]))
    for t in range(rows - 1, 0, -1):
        path[t - 1] = came[t, path[t]]


def follow(features: Features, line: Line) -> tuple[NDArray[np.float32], float]:
    """Signed distances (h, w) in cells to the edge, positive on standing crop, and how far apart
    the two kinds are beside it; the line itself, 0 apart, where nothing can be learnt there."""
    h, w, _ = features.shape
    shorter = min(h, w)
    cos, sin = math.cos(line.angle_rad), math.sin(line.angle_rad)
    u, v = np.meshgrid(np.arange(w) + 0.5, np.arange(h) + 0.5)
    signed = line.signed(u, v)
    learnt = discriminant(features, signed, NEAR_SHARE * shorter, line.strip)
    if learnt is None:
        return signed.astype(np.float32), 0.0
    value, apart = learnt
    # the line's own frame: t along it, s across it, towards the crop
    band = max(1, int(BAND_SHARE * shorter))
    length = int(math.hypot(h, w)) + 1
    t, s = np.arange(length) - 0.5 * length, np.arange(2 * band + 1) - band
    to_line = line.offset - 0.5 * (w * cos + h * sin)
    foot_u, foot_v = 0.5 * w + to_line * cos, 0.5 * h + to_line * sin
    map_u = (foot_u + s[None] * cos - t[:, None] * sin - 0.5).astype(np.float32)
    map_v = (foot_v + s[None] * sin + t[:, None] * cos - 0.5).astype(np.float32)
    across = cv2.remap(value, map_u, map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    inside = (map_u >= -0.5) & (map_u < w - 0.5) & (map_v >= -0.5) & (map_v < h - 0.5)
    below = np.zeros((length, 2 * band + 2))
    np.cumsum(across * inside, axis=1, out=below[:, 1:])
    path = np.zeros(length, np.int32)
    _path(2.0 * below - below[:, -1:], BEND, path)
    along = (v - foot_v) * cos - (u - foot_u) * sin
    index = np.clip(np.round(along + 0.5 * length).astype(int), 0, length - 1)
    return (signed - (path - band - 0.5)[index]).astype(np.float32), apart
