"""What a machine's outline sweeps, whose place is uncertain, against the sides of areas: compiled,
since it is asked at each step."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from host.core.compiled import compiled

Array = NDArray[np.float64]
_CORNERS: Final = 8
"""Of the polygon that stands for a circle: it reaches 8 % beyond it."""
_OCTAGON: Final = np.array(
    [
        (math.cos(a) / math.cos(math.pi / _CORNERS), math.sin(a) / math.cos(math.pi / _CORNERS))
        for a in np.arange(_CORNERS) * math.tau / _CORNERS
    ]
)
"""Around the unit circle, so that what it sweeps holds what the circle sweeps."""
NEAR_M: Final = 1e-9
"""Rounding."""


@njit(cache=True, nogil=True)
def spread(outline: Array, covariance: Array, sigmas: float, more_m: float, out: Array) -> None:
    """Around each corner of an outline (n, 2) the octagon that holds its ellipse of `sigmas`
    standard deviations and a circle of `more_m`, into `out`, (8 n, 2). `covariance`: of each
    corner, (n, 2, 2), or of all, (1, 2, 2); finite."""
    for k in range(outline.shape[0]):
        of = min(k, covariance.shape[0] - 1)
        xx, xy, yy = covariance[of, 0, 0], covariance[of, 0, 1], covariance[of, 1, 1]
        root = xx * yy - xy * xy
        # The symmetric square root of a 2x2 matrix in closed form.
        root = math.sqrt(max(0.0, root))
        whole = math.sqrt(max(0.0, xx + yy + 2.0 * root))
        scale = sigmas / whole if whole > 0.0 else 0.0
        xx, xy, yy = scale * (xx + root), scale * xy, scale * (yy + root)
        for q in range(_CORNERS):
            ox, oy = _OCTAGON[q, 0], _OCTAGON[q, 1]
            out[k * _CORNERS + q, 0] = outline[k, 0] + ox * xx + oy * xy + more_m * ox
            out[k * _CORNERS + q, 1] = outline[k, 1] + ox * xy + oy * yy + more_m * oy


@compiled("(f8[:, ::1], UniTuple(f8, 2), UniTuple(f8, 2), f8, f8, f8[:, ::1])")
def moved(
    points: Array, at: tuple[float, float], velocity: tuple[float, float], yaw_rate: float,
    lasts_s: float, out: Array,
) -> None:  # fmt: skip
    """Where points (n, 2) of a machine are in so long, into `out`: its rear axle `at` goes at a
    velocity, m/s, that turns with it at yaw_rate, rad/s."""
    turn = yaw_rate * lasts_s
    c, s = math.cos(turn), math.sin(turn)
    along, aside = lasts_s, 0.0
    if abs(turn) > 1e-6:
        along, aside = s / yaw_rate, (1.0 - c) / yaw_rate
    to_x = at[0] + velocity[0] * along - velocity[1] * aside
    to_y = at[1] + velocity[0] * aside + velocity[1] * along
    for k in range(len(points)):
        x, y = points[k, 0] - at[0], points[k, 1] - at[1]
        out[k, 0], out[k, 1] = to_x + c * x - s * y, to_y + s * x + c * y


@njit(cache=True, nogil=True)
def _farthest(along: Array, beside: Array, sense: float) -> float:
    """How far along the line beside = 0 the hull of points on both sides of it reaches, in the
    direction `sense`. From pair to pair: the line through a point on either side that leaves all
    others behind it is an edge of the hull."""
    left, right = -1, -1
    for k in range(len(along)):
        if beside[k] >= 0.0 and (left < 0 or sense * along[k] > sense * along[left]):
            left = k
        if beside[k] <= 0.0 and (right < 0 or sense * along[k] > sense * along[right]):
            right = k
    best = -math.inf
    for _ in range(len(along)):
        before = best
        for side in (1.0, -1.0):
            for k in range(len(along)):
                if side * beside[k] < 0.0:
                    continue
                a, b = (k, right) if side > 0.0 else (left, k)
                apart = beside[a] - beside[b]
                if apart > 0.0:
                    at = along[a] + (along[b] - along[a]) * beside[a] / apart
                else:
                    at = along[a] if sense * along[a] > sense * along[b] else along[b]
                if sense * at > best:
                    best = sense * at
                    left, right = a, b
        if best <= before:
            break
    return best


@njit(cache=True, nogil=True)
def _meets(points: Array, later: Array, side: Array) -> bool:
    """Whether a side (4,) touches the hull of points (n, 2) and of where they are later."""
    ax, ay, bx, by = side
    length = math.hypot(bx - ax, by - ay)
    if length == 0.0:
        return False
    c, s = (bx - ax) / length, (by - ay) / length
    n = len(points)
    along, beside = np.empty(2 * n), np.empty(2 * n)
    most, least = -math.inf, math.inf
    for k in range(n):
        x, y = points[k, 0] - ax, points[k, 1] - ay
        along[k], beside[k] = x * c + y * s, y * c - x * s
        x, y = later[k, 0] - ax, later[k, 1] - ay
        along[n + k], beside[n + k] = x * c + y * s, y * c - x * s
        most, least = max(most, beside[k], beside[n + k]), min(least, beside[k], beside[n + k])
    if least > 0.0 or most < 0.0:
        return False
    return _farthest(along, beside, 1.0) >= 0.0 and -_farthest(along, beside, -1.0) <= length


@compiled("(f8[:, ::1], f8, f8)")
def is_inside(sides: Array, x: float, y: float) -> bool:
    """Whether a point lies in an area, but in no keep-out, of which these are the sides (m, 4)."""
    inside = False
    for k in range(len(sides)):
        ax, ay, bx, by = sides[k]
        if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
            inside = not inside
    return inside


@njit(cache=True, nogil=True)
def _touches(side: Array, points: Array, later: Array) -> bool:
    """Whether the hull of points (n, 2), and of where they are later, touches a side (4,)."""
    low_x, low_y, high_x, high_y = math.inf, math.inf, -math.inf, -math.inf
    for k in range(len(points)):
        (x, y), (to_x, to_y) = points[k], later[k]
        low_x, high_x = min(low_x, x, to_x), max(high_x, x, to_x)
        low_y, high_y = min(low_y, y, to_y), max(high_y, y, to_y)
    ax, ay, bx, by = side
    if max(ax, bx) < low_x or min(ax, bx) > high_x or max(ay, by) < low_y or min(ay, by) > high_y:
        return False
    # All corners of the box on one side of the line: it passes by.
    nx, ny = by - ay, ax - bx
    middle = nx * (0.5 * (low_x + high_x) - ax) + ny * (0.5 * (low_y + high_y) - ay)
    reach = 0.5 * (abs(nx) * (high_x - low_x) + abs(ny) * (high_y - low_y))
    return abs(middle) <= reach + NEAR_M and _meets(points, later, side)


@compiled("(f8[:, ::1], f8[:, ::1])")
def is_free(sides: Array, outline: Array) -> bool:
    """Whether the hull of an outline (n, 2) touches none of the sides (m, 4) of any area, and lies
    in the permitted area, but in no keep-out."""
    for k in range(len(sides)):
        if _touches(sides[k], outline, outline):
            return False
    return is_inside(sides, outline[0, 0], outline[0, 1])


@compiled(
    "(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, :, :, ::1], f8, f8, "
    "UniTuple(f8, 2), UniTuple(f8, 2), f8, f8)"
)
def is_clear(
    sides: Array, shifts: Array, outline: Array, covariance: Array, sigmas: float, more_m: float,
    axle: tuple[float, float], velocity: tuple[float, float], yaw_rate: float, lasts_s: float,
) -> bool:  # fmt: skip
    """Whether a machine whose outline is (n, 2) touches none of the sides (m, 4) within lasts_s.
    Against each side it is spread by `sigmas` standard deviations of its corners' places against
    that one (m or 1, n or 1, 2, 2), and by more_m; and each side lies `shifts` (m, 2) off."""
    swept = np.empty((_CORNERS * len(outline), 2))
    later = np.empty_like(swept)
    side = np.empty(4)
    for k in range(len(sides)):
        if k == 0 or len(covariance) > 1:
            spread(outline, covariance[k], sigmas, more_m, swept)
            moved(swept, axle, velocity, yaw_rate, lasts_s, later)
        side[0], side[1] = sides[k, 0] + shifts[k, 0], sides[k, 1] + shifts[k, 1]
        side[2], side[3] = sides[k, 2] + shifts[k, 0], sides[k, 3] + shifts[k, 1]
        if _touches(side, swept, later):
            return False
    return True


@compiled("(f8[:, :, :, ::1], f8)")
def known_to(covariance: Array, sigmas: float) -> float:
    """The longest half axis, m, of the ellipses of so many standard deviations, (m, n, 2, 2); NaN
    where one is not finite."""
    longest = 0.0
    for m in range(covariance.shape[0]):
        for n in range(covariance.shape[1]):
            xx, xy, yy = covariance[m, n, 0, 0], covariance[m, n, 0, 1], covariance[m, n, 1, 1]
            if not math.isfinite(xx + xy + yy):
                return math.nan
            most = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)
            longest = max(longest, sigmas * math.sqrt(max(0.0, most)))
    return longest


@compiled(
    "(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, :, :, ::1], f8, f8, "
    "UniTuple(f8, 2), UniTuple(f8, 2), f8, UniTuple(f8, 2))"
)
def judged(
    sides: Array, shifts: Array, planned: Array, outline: Array, covariance: Array, sigmas: float,
    slow_m: float, axle: tuple[float, float], velocity: tuple[float, float], yaw_rate: float,
    slow_and_stop_s: tuple[float, float],
) -> tuple[float, bool, bool]:  # fmt: skip
    """In one call, as it is asked at each step: `known_to`; whether the machine, that lies inside
    as `planned`, is clear of the sides, wider by slow_m, as long as it goes straight on; and
    whether it is while it turns. With a place that is not known neither."""
    known_m = known_to(covariance, sigmas)
    # Sides that lie off one by one are no closed border.
    if math.isnan(known_m) or not is_inside(sides, planned[0, 0], planned[0, 1]):
        return known_m, False, False
    slow_s, stop_s = slow_and_stop_s
    on = is_clear(sides, shifts, outline, covariance, sigmas, slow_m, axle, velocity, 0.0, slow_s)
    if on and yaw_rate == 0.0:
        return known_m, True, True
    turning = is_clear(
        sides, shifts, outline, covariance, sigmas, 0.0, axle, velocity, yaw_rate, stop_s
    )
    return known_m, on, turning


@njit(cache=True, nogil=True)
def apart(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
    """From a point to a straight piece, m."""
    ux, uy = bx - ax, by - ay
    long2 = ux * ux + uy * uy
    share = 0.0
    if long2 > 0.0:
        share = min(1.0, max(0.0, ((x - ax) * ux + (y - ay) * uy) / long2))
    return math.hypot(x - ax - share * ux, y - ay - share * uy)


@compiled("(f8[:, ::1], f8, f8)")
def depth(ring: Array, x: float, y: float) -> float:
    """How far inside a ring (n, 2) of corners, in order, a place is, m; 0 outside, or without
    one."""
    count = len(ring)
    sides = np.empty((count, 4))
    nearest = math.inf
    for k in range(count):
        sides[k, :2], sides[k, 2:] = ring[k], ring[(k + 1) % count]
        ax, ay, bx, by = sides[k]
        nearest = min(nearest, apart(x, y, ax, ay, bx, by))
    return nearest if is_inside(sides, x, y) else 0.0


@compiled("(f8[:, ::1], i8[::1], f8[:, ::1], f8[::1])")
def gaps(sides: Array, rings: NDArray[np.int64], outline: Array, out: Array) -> None:
    """From the hull of an outline (n, 2) that touches no side to each ring, m, into `out`: its
    corners to the sides, and the sides' corners to whatever runs from corner to corner of it, of
    which the hull's own edges are nearest. `rings`: (m,) which each side is of."""
    out[:] = math.inf
    for k in range(len(sides)):
        ax, ay, bx, by = sides[k]
        nearest = out[rings[k]]
        for i in range(len(outline)):
            nearest = min(nearest, apart(outline[i, 0], outline[i, 1], ax, ay, bx, by))
            for j in range(i):
                x, y, to_x, to_y = outline[i, 0], outline[i, 1], outline[j, 0], outline[j, 1]
                nearest = min(nearest, apart(ax, ay, x, y, to_x, to_y))
        out[rings[k]] = nearest
