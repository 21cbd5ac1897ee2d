"""An edge of any form from the laps that were walked around it: averaged, smoothed between its
corners, thinned.

Laps lie beside each other by what a receiver wanders, so at a corner the nearest places of two laps
do not belong together: their average would cut the corner off. Which places do belong together is
found for all of the way at once, by where they are and which way the walker went there.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import correlate1d

from host.core.compiled import compiled
from host.field.corners import thinned
from host.field.walk import Points

Indices = NDArray[np.int64]
"""(n,)."""

DIRECTION_M: Final = 3.0
"""Places whose directions differ by a radian are as unlike as places so far apart. Nought: at a
corner, the way towards it is taken for the way from it."""
DIRECTED: Final = 2
"""Points of an even ring before and behind, which tell its direction: a metre of a walk to either
side, over which a walker's and a receiver's jitter is small."""
ASIDE: Final = (20, 0.1)
"""Places that belong together are so many points of an even ring along at most, or such a share of
them, from what the laps' lengths say."""
SMOOTH_M: Final = 5.0
"""Window over which a ring is smoothed: twice the CEP of a phone."""
BESIDE_M: Final = 3.0
"""Of the edges beside a corner, which tell it and meet there. With 2.5 and 4.5 m corners came out
as right, and as many of them as one point (100 simulated walks)."""
CORNER_RAD: Final = math.radians(40.0)
"""What turns by less is smoothed as an arc is; with 30 and 52 deg nothing changed."""
CORNER_SHARE: Final = 0.5
"""Of the variance that an arc through such a place leaves, what two straight edges leave at most;
with 0.35 and 0.7 nothing changed."""
CLOSING_M: Final = 10.0
"""Way before and after the place where a lap closes, over which it is bent until its ends meet: two
of SMOOTH_M. Over less, what a receiver has drifted during the lap is a corner there, which the
machine is then put down at and begins with."""
CLOSES_ALONG_M: Final = 5.0
"""The last of a lap's way, which says in which direction it closes."""


def resampled(xy: Points, count: int) -> Points:
    """A closed ring at `count` equal steps along it."""
    closed = np.vstack([xy, xy[:1]])
    path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    at = np.linspace(0.0, path[-1], count, endpoint=False)
    return np.column_stack([np.interp(at, path, closed[:, k]) for k in (0, 1)])


# ---- several laps --------------------------------------------------------------------------------


def mean_ring(rings: list[Points], count: int) -> tuple[Points, float]:
    """The average of rings that run alongside each other, the same way around, at `count` equal
    steps, and the rms distance of the rings from it in metres (0 for one ring)."""
    mean = resampled(rings[0], count)
    if len(rings) == 1:
        return mean, 0.0
    for done, ring in enumerate(rings[1:], 1):
        mean, other = _begun_alike(mean, resampled(ring, count))
        one, two = _matched(mean, other)
        mean = resampled((done * mean[one] + other[two])[:-1] / (done + 1), count)
    points = shapely.points(mean)
    away = [shapely.distance(shapely.LinearRing(ring), points) for ring in rings]
    return mean, float(np.sqrt(np.square(away).mean()))


def _directed(ring: Points) -> Points:
    """(n, 4) of an even ring: places and, in metres, directions."""
    ways = np.roll(ring, -DIRECTED, axis=0) - np.roll(ring, DIRECTED, axis=0)
    lengths = np.maximum(np.hypot(*ways.T), 1e-9)
    return np.hstack([ring, DIRECTION_M * ways / lengths[:, None]])


def _begun_alike(one: Points, other: Points) -> tuple[Points, Points]:
    """Two even rings of as many points: the other begun so that the two lie as near to each other
    as they can, then both where they are most alike."""
    along = np.fft.ifft((np.fft.fft(one, axis=0).conj() * np.fft.fft(other, axis=0)).sum(1)).real
    other = np.roll(other, -int(along.argmax()), axis=0)
    alike = int(((_directed(one) - _directed(other)) ** 2).sum(1).argmin())
    return np.roll(one, -alike, axis=0), np.roll(other, -alike, axis=0)


def _matched(one: Points, other: Points) -> tuple[Indices, Indices]:
    """Which places of two even rings of as many points belong together, in order, from the first
    of both around to it again: dynamic time warping (Sakoe and Chiba, Dynamic programming algorithm
    optimization for spoken word recognition, 1978)."""
    count = len(one)
    a, b = (np.vstack([each, each[:1]]) for each in (_directed(one), _directed(other)))
    ones, others = _warped(a, b, max(ASIDE[0], round(ASIDE[1] * count)))
    return ones % count, others % count


@compiled("(f8[:, ::1], f8[:, ::1], i8)")
def _warped(a: Points, b: Points, aside: int) -> tuple[Indices, Indices]:
    """Indices of a (n, 4) and b (n, 4) that belong together, from both first to both last; they
    differ by `aside` at most."""
    n, wide = len(a), 2 * aside + 1
    came = np.zeros((n, wide), np.uint8)
    cost = np.full(wide, np.inf)
    for i in range(n):
        past = cost.copy()
        for d in range(wide):
            j = i + d - aside
            if j < 0 or j >= n:
                cost[d] = np.inf
                continue
            here = 0.0
            for k in range(4):
                here += (a[i, k] - b[j, k]) ** 2
            least, way = (0.0, 0) if i == 0 and j == 0 else (np.inf, 0)
            if i > 0 and past[d] < least:
                least, way = past[d], 1
            if i > 0 and d + 1 < wide and past[d + 1] < least:
                least, way = past[d + 1], 2
            if d > 0 and j > 0 and cost[d - 1] < least:
                least, way = cost[d - 1], 3
            cost[d] = least + here
            came[i, d] = way
    i, j = n - 1, n - 1
    ones, others = [i], [j]
    while i > 0 or j > 0:
        way = came[i, j - i + aside]
        if way != 3:
            i -= 1
        if way != 2:
            j -= 1
        ones.append(i)
        others.append(j)
    return np.array(ones[::-1]), np.array(others[::-1])


# ---- one ring ------------------------------------------------------------------------------------


def closing(lap: Points) -> Points:
    """(n, 2) of a lap (not closed) whose end lies beside its beginning: both are moved by half of
    that, what is near them by less. How far it ends before its beginning is way that was not
    walked, and stays."""
    ways = np.hypot(*np.diff(lap, axis=0).T)
    done = np.concatenate([[0.0], np.cumsum(ways)])
    left = done[-1] - done
    way = lap[-1] - lap[int(np.argmax(left <= CLOSES_ALONG_M))]
    length_m = float(np.hypot(*way))
    if length_m == 0.0:
        return lap
    across = np.array([-way[1], way[0]]) / length_m
    apart_m = float((lap[0] - lap[-1]) @ across)
    over_m = min(CLOSING_M, float(done[-1]) / 3)
    share = np.clip(1 - left / over_m, 0.0, 1.0) - np.clip(1 - done / over_m, 0.0, 1.0)
    moved: Points = lap + (apart_m / 2 * share)[:, None] * across
    return moved


def any_edge(ring: Points) -> Points:
    """A closed, evenly sampled ring smoothed over SMOOTH_M between its corners, then thinned, and
    what rounds a corner sharpened."""
    step = shapely.LinearRing(ring).length / len(ring)
    window = 2 * round(SMOOTH_M / step / 2) + 1
    if 3 < window < len(ring):
        ring = _smoothed(ring, sharp_corners(ring), window)
    shape = shapely.Polygon(ring).buffer(0)
    if isinstance(shape, shapely.MultiPolygon):
        shape = max(shape.geoms, key=lambda part: float(part.area))
    return thinned(shapely.get_coordinates(shape.exterior)[:-1])


def sharp_corners(ring: Points) -> dict[int, Points]:
    """The corners of an evenly sampled ring: at which of its points, and (2,) where the edges
    beside meet. There two straight edges are nearer to the ring than one arc is."""
    step = shapely.LinearRing(ring).length / len(ring)
    beside, count = max(4, round(BESIDE_M / step)), len(ring)
    if count < 4 * beside:
        return {}
    off = np.arange(-beside, beside + 1)
    around = ring[(np.arange(count)[:, None] + off) % count]
    arc = np.vander(off, 3)
    arc_left = ((around - arc @ (np.linalg.pinv(arc) @ around)) ** 2).sum((1, 2))
    straight = np.vander(off[:beside], 2)
    halves = np.stack([around[:, :beside], around[:, :beside:-1]])
    lines = np.linalg.pinv(straight) @ halves
    lines_left = ((halves - straight @ lines) ** 2).sum((0, 2, 3))
    # Each by its degrees of freedom: three and four unknowns along x, and as many along y.
    arc_left /= 2 * (len(off) - 3)
    lines_left /= 2 * (2 * beside - 4)
    to, back = lines[:, :, 0]
    sines, cosines = back[:, 0] * to[:, 1] - back[:, 1] * to[:, 0], -(to * back).sum(1)
    corner = np.abs(np.arctan2(sines, cosines)) > CORNER_RAD
    corner &= lines_left < CORNER_SHARE * arc_left
    gain = np.where(corner, arc_left - lines_left, -math.inf)
    found = {}
    for k in np.flatnonzero(corner):
        if gain[k] < gain[(k + off) % count].max():
            continue
        one, other = lines[:, k, 1]
        apart = other - one
        along = (apart[1] * back[k, 0] - apart[0] * back[k, 1]) / sines[k]
        found[int(k)] = one + along * to[k]
    return found


def _smoothed(ring: Points, corners: dict[int, Points], window: int) -> Points:
    """An evenly sampled ring smoothed over `window` points, from each corner to the next."""
    weights, half = _parabola_at_middle(window), window // 2
    at = sorted(corners)
    if not at:
        return np.asarray(correlate1d(ring, weights, axis=0, mode="wrap"))
    pieces = []
    for first, last in zip(at, [*at[1:], at[0]], strict=True):
        between = (first + 1 + np.arange((last - first - 1) % len(ring))) % len(ring)
        piece = np.vstack([corners[first], ring[between], corners[last]])
        # Turned about its ends it goes on, so these stay where they are.
        on = np.pad(piece, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
        pieces.append(np.asarray(correlate1d(on, weights, axis=0))[half : -half - 1])
    return np.vstack(pieces)


def _parabola_at_middle(window: int) -> NDArray[np.float64]:
    """Weights of the Savitzky-Golay filter of second order: what the parabola of least squares
    through `window` points is at their middle. scipy.signal has it too, and takes half a second to
    import."""
    k = np.arange(window) - window // 2
    return np.asarray(np.linalg.pinv(np.vander(k, 3))[-1])
