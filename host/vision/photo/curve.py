"""From a dividing line to the edge itself, at the picture's own sharpness.

A strip of the picture along the line is laid straight and looked at alone: colour and texture per
pixel across the edge, pooled along it. What tells crop from cut is learnt on both sides of the
line; the curve is where that changes sign. Once more, learning on both sides of the curve instead,
lets a bent or misplaced line do no harm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from host.vision.photo.fisher import Features, Kinds, Reach, learn
from host.vision.photo.split import NEAR_SHARE, Line
from host.vision.photo.texture import combine, measure
from host.vision.pictures import Picture, u8

DEAD_SHARES = (0.02, 0.01, 0.01)
"""Of the picture's shorter side, for each pass: so near to the edge nothing is learnt, pooled cells
there hold both kinds and the edge is not yet well known."""
AVERAGED = 2
"""Of the passes' curves, the last ones: they hover about the edge."""
BLOCK_PX = 4
"""Along the edge, pooled into one row."""
LEARNT = 2
"""Every so many rows are learnt from: neighbouring ones were pooled."""
STEPS = 3
"""Pixels that the curve may move sideways from one row to the next."""
BEND = 6.0
"""Cost of moving by one; the discriminant is clipped to +-CLIP."""
CLIP = 3.0
BAND_SHARE = 0.08
"""Of the picture's shorter side: how far the curve may leave the line."""
SIGMAS = (0.8, 2.0)
"""Px: the scales of grain."""
ALONG = np.array([1, 2, 1], np.float32) / 4
ACROSS = np.array([1, 4, 6, 4, 1], np.float32) / 16
"""Binomial weights by which neighbouring cells are averaged along and across."""


@dataclass(frozen=True, slots=True)
class Curve:
    """The edge found beside a line."""

    points: NDArray[np.float64]
    """(n, 2) pixels (u, v), from end to end of the strip; pixel (i, j) covers [j, j + 1)."""
    line: Line
    apart: float
    """By how many standard deviations the two kinds differ beside it; 0: nothing could be learnt,
    and the curve is the line."""
    strayed_px: float
    """Mean distance of the curve from the line."""
    passes_px: float = 0.0
    """Mean distance between the curves of the last passes."""

    def scaled(self, factor: float) -> Curve:
        """The same curve in a picture that is larger by `factor`."""
        line = self.line.scaled(factor)
        strayed, passes = self.strayed_px * factor, self.passes_px * factor
        return Curve(self.points * factor, line, self.apart, strayed, passes)

    def standing(self, size: tuple[int, int]) -> NDArray[np.bool_]:
        """Mask (height, width) of standing crop for a picture of size (width, height)."""
        width, height = size
        far = 2.0 * (width + height)
        towards = np.array([math.cos(self.line.angle_rad), math.sin(self.line.angle_rad)])
        along = np.array([-towards[1], towards[0]])
        ends = np.vstack([self.points[:1] - far * along, self.points[-1:] + far * along])
        border = np.vstack([ends[:1], self.points, ends[1:], ends[::-1] + far * towards])
        out = np.zeros((height, width), np.uint8)
        shift = 4
        corners = np.round((border - 0.5) * (1 << shift)).astype(np.int32)
        cv2.fillPoly(out, [corners], 1, shift=shift)
        return np.asarray(out > 0)


@numba.njit(cache=True, nogil=True)
def _path(
    value: NDArray[np.float32], inside: NDArray[np.bool_], bend: float, path: NDArray[np.int32]
) -> None:
    """Through the rows of `value` the borders between columns that best have the negative before
    them and the positive behind, at a cost of `bend` times the squared sideways step. What is not
    `inside` counts nothing."""
    rows, columns = value.shape
    total = np.zeros((rows, columns + 1))
    came = np.zeros((rows, columns + 1), np.int32)
    for t in range(rows):
        whole = 0.0
        for s in range(columns):
            if inside[t, s]:
                whole += min(CLIP, max(-CLIP, value[t, s]))
        before = 0.0
        for s in range(columns + 1):
            total[t, s] = 2.0 * before - whole
            if s < columns and inside[t, s]:
                before += min(CLIP, max(-CLIP, value[t, s]))
        if t == 0:
            continue
        for s in range(columns + 1):
            best, at = np.inf, s
            for d in range(-STEPS, STEPS + 1):
                if 0 <= s + d <= columns:
                    cost = total[t - 1, s + d] + bend * d * d
                    if cost < best:
                        best, at = cost, s + d
            total[t, s] += best
            came[t, s] = at
    path[rows - 1] = int(np.argmin(total[rows - 1]))
    for t in range(rows - 1, 0, -1):
        path[t - 1] = came[t, path[t]]


@dataclass(frozen=True, slots=True)
class _Strip:
    """A piece of the picture along a line, laid straight: rows along it, columns across it."""

    features: Features
    inside: NDArray[np.bool_]
    along: NDArray[np.float64]
    """Pixels of each row's middle from the line's foot."""
    half: int
    """Columns on either side of the line's own."""


def _straightened(bgr: Picture, line: Line, half: int) -> _Strip | None:
    """The strip of a picture, a pixel a column; None where the line hardly crosses the picture."""
    h, w = bgr.shape[:2]
    cos, sin = math.cos(line.angle_rad), math.sin(line.angle_rad)
    foot_u, foot_v = _foot(line, w, h)
    # where the strip, as wide as it is, runs inside the picture
    t = np.arange(-math.hypot(h, w) / 2, math.hypot(h, w) / 2)
    u, v = foot_u - t * sin, foot_v + t * cos
    over_u, over_v = half * abs(cos), half * abs(sin)
    t = t[(u >= -over_u) & (u <= w + over_u) & (v >= -over_v) & (v <= h + over_v)]
    blocks = len(t) // BLOCK_PX
    if blocks < 4:
        return None
    t = t[: blocks * BLOCK_PX]
    s = np.arange(-half, half + 1)
    # column and row of the strip to pixel of the picture
    turn = np.array([[cos, -sin], [sin, cos]])
    corner = np.array([foot_u, foot_v]) + turn @ (s[0], t[0]) - 0.5
    piece = cv2.warpAffine(
        bgr,
        np.column_stack([turn, corner]),
        (len(s), len(t)),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    sums = measure(u8(piece), (BLOCK_PX, 1), SIGMAS)
    means = cv2.sepFilter2D(sums, cv2.CV_32F, ACROSS, ALONG, borderType=cv2.BORDER_REPLICATE)
    middle = t[BLOCK_PX // 2 :: BLOCK_PX, None]
    a, b = foot_u + s * cos - middle * sin - 0.5, foot_v + s * sin + middle * cos - 0.5
    seen = (a >= 0) & (a <= w - 1) & (b >= 0) & (b <= h - 1)
    along = t.reshape(blocks, BLOCK_PX).mean(1)
    return _Strip(combine(np.asarray(means, np.float32)), seen, along, half)


def _foot(line: Line, w: int, h: int) -> tuple[float, float]:
    """The point of the line that is nearest to the picture's middle."""
    cos, sin = math.cos(line.angle_rad), math.sin(line.angle_rad)
    to_line = line.offset - 0.5 * (w * cos + h * sin)
    return 0.5 * w + to_line * cos, 0.5 * h + to_line * sin


def follow(bgr: Picture, line: Line) -> Curve:
    """The edge beside a line, both in the pixels of `bgr` (height, width, 3)."""
    h, w = bgr.shape[:2]
    shorter = min(h, w)
    near, band = NEAR_SHARE * shorter, max(2, int(BAND_SHARE * shorter))
    strip = _straightened(bgr, line, max(band + 1, math.ceil(near)))
    ends = math.hypot(h, w) / 2
    along = strip.along if strip else np.array([-ends, ends])
    found: list[NDArray[np.float64]] = [np.zeros(len(along))]
    kinds: Kinds | None = None
    if strip is not None:
        across = np.arange(-strip.half, strip.half + 1)
        columns = slice(strip.half - band, strip.half + band + 1)
        features = np.ascontiguousarray(strip.features[::LEARNT])
        known = strip.inside[::LEARNT]
        beside = np.ascontiguousarray(strip.features[:, columns])
        inside = np.ascontiguousarray(strip.inside[:, columns])
        cut = near if line.strip == 0 else max(12.0, min(near, line.strip))
        for dead in DEAD_SHARES:
            distances = np.where(known, across - found[-1][::LEARNT, None], np.nan)
            reach = Reach(near, cut, max(1.0, dead * shorter))
            learnt = learn(features, distances.astype(np.float32), reach)
            if learnt is None:
                break
            kinds = learnt
            # the line is too far off for more than the direction in which the kinds differ
            first = len(found) == 1
            value = kinds.discriminant().value(beside) if first else kinds.odds(beside)
            path = np.zeros(len(along), np.int32)
            _path(value, inside, BEND, path)
            found.append(path.astype(np.float64) - band - 0.5)
    aside = np.mean(found[-AVERAGED:], axis=0) if len(found) > AVERAGED else found[-1]
    cos, sin = math.cos(line.angle_rad), math.sin(line.angle_rad)
    foot_u, foot_v = _foot(line, w, h)
    points = np.column_stack(
        [foot_u + aside * cos - along * sin, foot_v + aside * sin + along * cos]
    )
    apart = kinds.discriminant().apart if kinds else 0.0
    passes = float(np.abs(found[-1] - found[-2]).mean()) if len(found) > 1 else 0.0
    return Curve(points, line, apart, float(np.abs(aside).mean()), passes)
