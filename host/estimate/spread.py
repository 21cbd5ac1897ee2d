"""Large products of the covariance that are due at each step or picture, compiled: of most of
its states they take nothing, or one and the same. Where the corners stand among the states is an
argument: compiled code that is cached would not see another number of states."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from host.core.compiled import compiled
from host.estimate.kalman import Array
from host.estimate.states import YAW, X, Y


@compiled("(f8[:, ::1], i8, f8, f8, f8[:, ::1], f8[:, ::1], f8[:, :, ::1])")
def of_points(
    p: Array, first: int, x: float, y: float, points: Array, near: Array, found: Array
) -> None:
    """Into `found`, (n, 2, 2), m²: of points (n, 2) of a machine whose rear axle is at x, y,
    against a border that moves by `near`, (n, corners), of each corner; their states begin at
    `first`."""
    count = 2 + near.shape[1]
    states, by = np.empty((2, count), np.int64), np.empty((2, count))
    for m in range(len(points)):
        _of_point(p, first, points[m, 0] - x, points[m, 1] - y, near[m], states, by, found[m])


@compiled("(f8[:, ::1], i8, f8, f8, f8[:, ::1], f8[:, ::1], f8[:, :, :, ::1])")
def of_points_against(
    p: Array, first: int, x: float, y: float, points: Array, near: Array, found: Array
) -> None:
    """Into `found`, (m, n, 2, 2), m²: `of_points` of all n points against each of m borders, which
    move by `near`, (m, corners)."""
    count = 2 + near.shape[1]
    states, by = np.empty((2, count), np.int64), np.empty((2, count))
    for k in range(len(near)):
        for m in range(len(points)):
            off_x, off_y = points[m, 0] - x, points[m, 1] - y
            _of_point(p, first, off_x, off_y, near[k], states, by, found[k, m])


@njit(cache=True, nogil=True)
def _of_point(
    p: Array, first: int, off_x: float, off_y: float, near: Array, states: Array, by: Array,
    found: Array,
) -> None:  # fmt: skip
    """Into `found`, (2, 2), of a point that lies so far from the rear axle, field frame; `states`
    and `by` are room to work in: by which states it moves along x, and by which along y."""
    states[0, 0], states[1, 0] = X, Y
    states[0, 1] = states[1, 1] = YAW
    by[0, 0] = by[1, 0] = 1.0
    by[0, 1], by[1, 1] = -off_y, off_x
    used = 2
    for k in range(len(near)):
        if near[k] != 0.0:
            states[0, used], states[1, used] = first + 2 * k, first + 2 * k + 1
            by[0, used] = by[1, used] = -near[k]
            used += 1
    for r in range(2):
        for c in range(r + 1):
            total = 0.0
            for i in range(used):
                if by[r, i] != 0.0:
                    for j in range(used):
                        total += by[r, i] * p[states[r, i], states[c, j]] * by[c, j]
            found[r, c] = found[c, r] = total


@compiled("(f8[:, ::1], i8, i8)")
def farthest(p: Array, first: int, behind: int) -> float:
    """Of corners whose states go from `first` to before `behind`, x and y by turns: the largest
    variance along x or y against the machine, m²."""
    most = -math.inf
    for k in range(first, behind):
        own = X if (k - first) % 2 == 0 else Y
        most = max(most, p[k, k] + p[own, own] - 2.0 * p[k, own])
    return most


@compiled("(f8[:, ::1], i8[::1], f8, f8)")
def turn(p: Array, pairs: NDArray[np.int64], c: float, s: float) -> None:
    """Turns pairs of states, whose x and y in the field stand one after the other from each of
    `pairs` on, by an angle with that cosine and sine, in place."""
    n = len(p)
    for k in range(n):
        for a in pairs:
            p[a, k], p[a + 1, k] = c * p[a, k] - s * p[a + 1, k], s * p[a, k] + c * p[a + 1, k]
    for k in range(n):
        for a in pairs:
            p[k, a], p[k, a + 1] = c * p[k, a] - s * p[k, a + 1], s * p[k, a] + c * p[k, a + 1]


@compiled("(f8[::1], i8[::1], f8, f8)")
def turn_by(x: Array, pairs: NDArray[np.int64], c: float, s: float) -> None:
    """The same of (states,), of a state or of what comes to one."""
    for a in pairs:
        x[a], x[a + 1] = c * x[a] - s * x[a + 1], s * x[a] + c * x[a + 1]
