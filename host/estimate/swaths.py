"""What the machine has cut itself. Crop right beside it is the same field's, whatever is believed
of the boundary: between two fields lies a gap."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np
from numba import types
from numpy.typing import NDArray

from host.core.compiled import compiled
from host.core.frames import Pose2

STEP_M: Final = 0.25
"""Between two points of a swath."""
ASIDE_M: Final = (0.2, 1.2)
"""From its middle to the blade's middle, to the left: a strip's width is between. With more the
blade's left end would reach over the narrowest gap that is harvested beside."""
ALONG_RAD: Final = math.radians(30.0)
"""Of a swath's direction, to be beside it."""
BEFORE_END_M: Final = 1.0
"""Before its end: a strip beside it is shorter where the border slants, by as much as the narrowest
gap is wide where it slants by 60 degrees, and this is left for what a place errs."""
BEFORE_BEGIN_M: Final = 0.5
"""Before its beginning: less than half of that gap."""

Line = NDArray[np.float64]

_LINE: Final = types.float64[:, ::1]
_AT: Final = types.NamedUniTuple(types.float64, 3, Pose2)  # type: ignore[no-untyped-call]


class Swaths:
    """The ways of the blade's middle through crop, m, in the field; the latest by dead reckoning,
    too, whatever has been found of the place since then."""

    def __init__(self) -> None:
        self._reckoned: list[Pose2] = []
        self._placed: list[tuple[float, float]] = []
        self._travelled_m = -math.inf
        self._latest: Line = np.empty((0, 2))
        """By dead reckoning."""
        self._past: list[Line] = []
        """In the field."""
        self._all: Line = np.empty((0, 2))
        """One after the other."""
        self._ends = np.empty(0, np.int64)
        """Of each of them, where it ends there."""

    def note(self, travelled_m: float, reckoned: Pose2, placed: Pose2) -> None:
        """The blade cuts there. Going over the same ground again adds nothing."""
        if travelled_m < self._travelled_m + STEP_M:
            return
        self._travelled_m = travelled_m
        self._reckoned.append(reckoned)
        self._placed.append(placed[:2])

    @property
    def past(self) -> list[Line]:
        """(n, 2) of each strip that was cut, in the field."""
        return self._past

    @property
    def cut_m(self) -> float:
        """How far the blade has cut."""
        return STEP_M * (len(self._all) + len(self._reckoned))

    def end(self) -> None:
        """The strip is cut."""
        if len(self._reckoned) > 1:
            self._latest = np.array([pose[:2] for pose in self._reckoned])
            self._past.append(np.array(self._placed))
            self._all = np.concatenate([self._all, self._past[-1]])
            self._ends = np.append(self._ends, len(self._all))
        self._reckoned, self._placed, self._travelled_m = [], [], -math.inf

    def back(self, reckoned: Pose2, axle_m: float) -> tuple[float, float] | None:
        """How far left of the way on which it has cut this strip the rear axle is, m, axle_m behind
        the blade's middle, and how far turned left of that way, rad. None: it has cut nothing."""
        if not self._reckoned:
            return None
        came = np.array([pose.ahead(-axle_m) for pose in self._reckoned])
        here = reckoned.ahead(-axle_m)
        then = Pose2(*came[np.argmin(np.hypot(*(came[:, :2] - here[:2]).T))])
        turned_rad = math.remainder(here.heading_rad - then.heading_rad, math.tau)
        return then.seen_from(*here[:2])[1], turned_rad

    def beside(self, reckoned: Pose2, placed: Iterable[Pose2], farther_m: float = 0.0) -> bool:
        """Whether what stands before the blade stands right beside a swath, on its left: beside the
        latest by dead reckoning, or beside one at every place where the machine may be. It may have
        come `farther_m` than its wheels say."""
        if _beside(self._latest, reckoned, farther_m):
            return True
        places = [_beside_any(self._all, self._ends, at, farther_m) for at in placed]
        return bool(places) and all(places)


@compiled((_LINE, _AT, types.float64))
def _beside(line: Line, at: Pose2, farther_m: float) -> bool:
    """The same of one. Compiled: it is asked of every swath, twenty times a second."""
    if len(line) < 2:
        return False
    x, y, heading = at
    k, best = 0, math.inf
    for n in range(len(line)):
        off = math.hypot(line[n, 0] - x, line[n, 1] - y)
        if off < best:
            k, best = n, off
    k = min(k, len(line) - 2)
    dx, dy = line[k + 1, 0] - line[k, 0], line[k + 1, 1] - line[k, 1]
    swath_rad = math.atan2(dy, dx)
    c, s = math.cos(swath_rad), math.sin(swath_rad)
    along_m = c * (x - line[k, 0]) + s * (y - line[k, 1])
    left_m = c * (y - line[k, 1]) - s * (x - line[k, 0])
    after_m = (len(line) - 1 - k) * STEP_M - along_m
    return (
        math.cos(heading - swath_rad) > math.cos(ALONG_RAD)
        and ASIDE_M[0] < left_m < ASIDE_M[1]
        and (k > 0 or along_m > -BEFORE_BEGIN_M)
        and after_m - farther_m > BEFORE_END_M
    )


@compiled((_LINE, types.int64[::1], _AT, types.float64))
def _beside_any(lines: Line, ends: NDArray[np.int64], at: Pose2, farther_m: float) -> bool:
    """The same of lines one after the other, of which each ends before its index of `ends`."""
    begin = 0
    for end in ends:
        if _beside(lines[begin:end], at, farther_m):
            return True
        begin = end
    return False
