"""Whether the machine moves the way it believes: only the receiver's Doppler course knows.

A hall sensor counts pulses and not their direction, so with swapped motor wires everything on board
agrees and is wrong. The receiver's course settles it once the machine has gone one way for a
metre: phones smooth their speed over a second or two, which each change of direction blurs.

And a position that is anchored to edges turns with them: where strip after strip is cut a little
askew, plan, lane and dead reckoning agree and are wrong, and no geofence helps. Then all that lies
inside the first round may have turned with it (`host.estimate.turned_strips`).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection
from typing import Final

from host.core.messages import Fix
from host.estimate.mean import mean_and_error
from host.estimate.odometry import Motion

RUN_M: Final = 1.0
MOVING_MPS: Final = 0.2
"""A phone's course means little at less."""
SHARE: Final = 0.5
"""Of the reckoned speed that must be seen the other way."""
FIXES: Final = 2
"""In a row."""
STRAIGHT_1PM: Final = 0.1
AVERAGED: Final = 60
"""Fixes at most."""
ELSEWHERE_RAD: Final = math.radians(45.0)
"""No strip turns by so much, and no walk of a boundary: it was put down elsewhere."""
ASKEW: Final = ((30, math.radians(7.0)), (5, ELSEWHERE_RAD))
"""By how much the mean of so many fixes, at least, may lie askew."""
NEWEST: Final = 15
"""Fixes that must show it too: a machine that was put down askew along an arc finds its direction
while it drives, and what it believed before is over."""
SIGNIFICANT: Final = 4.0
"""Standard errors of the mean."""
TURNED_RAD: Final = math.radians(12.0)
"""Strips turn by degrees from round to round, and are found when they lie askew by a little more
than the least of `ASKEW`. What is more comes at once: the receiver's courses are wrong, or the
machine was put down askew. Larger: courses that are wrong turn the place with them."""


class DirectionCheck:
    """Fed with every motion and every fix of a run."""

    def __init__(self) -> None:
        self._sign = 0.0
        self._since_m = 0.0
        self._against = 0
        self._askew: deque[float] = deque(maxlen=AVERAGED)
        self._since_turned = AVERAGED
        """Courses since the strips were believed to have turned."""
        self.off_rad: float | None = None
        """How far left of the believed direction the last fix's course lay; None where it says
        nothing of it."""

    def forget(self) -> None:
        """The courses of late: from here on another direction is believed."""
        self._askew.clear()
        self._since_turned = 0

    @property
    def may_have_turned(self) -> bool:
        """Whether the courses lie askew by what strips may have turned; what follows soon upon such
        a turn, or is more, is something else."""
        return 0.0 < abs(self.askew_rad) <= TURNED_RAD and self._since_turned >= AVERAGED

    def move(self, motion: Motion) -> None:
        """Notes where the present direction was taken."""
        if motion.speed_mps * self._sign <= 0.0 and motion.speed_mps != 0.0:
            self._sign = math.copysign(1.0, motion.speed_mps)
            self._since_m = motion.distance_m
            self._against = 0

    def contradicted(self, fix: Fix, motion: Motion, heading_rad: float) -> bool:
        """Whether this fix and the ones before it show the machine going the other way. The heading
        is the vehicle's as the receiver should show it."""
        self.off_rad = None
        if fix.speed_mps is None or fix.course_rad is None or fix.quality == 0:
            return False
        speed = motion.speed_mps
        if abs(speed) < MOVING_MPS or abs(motion.distance_m - self._since_m) < RUN_M:
            self._against = 0
            return False
        if abs(motion.curvature_1pm) < STRAIGHT_1PM:
            backwards = math.pi if speed < 0 else 0.0
            self.off_rad = math.remainder(fix.course_rad + backwards - heading_rad, math.tau)
            self._askew.append(self.off_rad)
            self._since_turned += 1
        along = fix.speed_mps * math.cos(fix.course_rad - heading_rad)
        self._against = self._against + 1 if along * self._sign < -SHARE * abs(speed) else 0
        return self._against >= FIXES

    @property
    def askew_rad(self) -> float:
        """By how much the courses of late lie left of the believed direction, on average; 0 where
        that may be the courses' noise, or is over."""
        most = next((rad for count, rad in ASKEW if len(self._askew) >= count), math.inf)
        if math.isinf(most):
            return 0.0
        mean, error = _mean(self._askew)
        newest, _ = _mean(list(self._askew)[-NEWEST:])
        over = abs(newest) <= most
        return mean if abs(mean) > max(most, SIGNIFICANT * error) and not over else 0.0


def _mean(angles: Collection[float]) -> tuple[float, float]:
    """Of angles, and its standard error, rad. About the opposite direction they have two signs."""
    x, y = (sum(f(angle) for angle in angles) for f in (math.cos, math.sin))
    middle = math.atan2(y, x)
    aside, error = mean_and_error([math.remainder(a - middle, math.tau) for a in angles])
    return middle + aside, error
