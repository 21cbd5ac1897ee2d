"""How far measurements have moved the place of late, against what wheels and turns say.

A place that is known moves by centimetres with each picture, and by decimetres at an end. One that
moves by metres within a few metres of way has taken something for what it is not: an end of one
strip for another's, or the neighbour's edge for its own. Which of its places was right, nobody
knows, and the geofence stands on both."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from host.estimate.odometry import Motion

WAY_M: Final = 5.0
"""Driven, over which measurements may move the place;"""
MOST_M: Final = 2.0
"""and by how much. In ten random fields that the model drove to their ends it was 0.9 m at most,
and 3.4 m in one that then went 2.9 m out of its field (12442); with this bound that stops 0.5 m
out. Of 106 other drives it stopped none (fields 12466 to 12505, outlines 412 to 427, picture fields
10656 to 10661, the wrong beliefs by the model). Smaller: a boundary that is found elsewhere stops
the machine; larger: one that has lost its place drives farther."""

Pose = tuple[float, float, float]
"""x and y, m, and yaw, rad, of the rear axle, field frame."""


class MovedPlace:
    """Fed with the place at each step."""

    def __init__(self) -> None:
        self._last: tuple[Pose, Motion] | None = None
        self._placed = 0
        self._moves: deque[tuple[float, float, float]] = deque()
        """Way driven, m, and how far measurements moved the place along x and y, m: of each step on
        which the machine drove, with those before it on which it stood."""
        self._forget()

    def _forget(self) -> None:
        self._moves.clear()
        self._way_m = self._x_m = self._y_m = 0.0
        """Of all of these, with the steps on which it stands now;"""
        self._stood_m = 0.0, 0.0
        """and of those alone, along x and y."""

    def take(self, pose: Pose | None, motion: Motion, placed: int = 0) -> None:
        """The place now, None where it is not known, and dead reckoning's motion until now.
        `placed`: how often a place was given, which is no move."""
        given, self._placed = placed != self._placed, placed
        last, self._last = self._last, None if pose is None else (pose, motion)
        if last is None or pose is None or given:
            self._forget()
            return
        (x, y, yaw), before = last
        driven_m = motion.distance_m - before.distance_m
        heading = yaw + (motion.yaw_rad - before.yaw_rad) / 2
        x_m = pose[0] - x - driven_m * math.cos(heading)
        y_m = pose[1] - y - driven_m * math.sin(heading)
        self._x_m, self._y_m = self._x_m + x_m, self._y_m + y_m
        self._stood_m = self._stood_m[0] + x_m, self._stood_m[1] + y_m
        if driven_m == 0.0:
            return
        self._moves.append((abs(driven_m), *self._stood_m))
        self._way_m, self._stood_m = self._way_m + abs(driven_m), (0.0, 0.0)
        while self._way_m > WAY_M:
            gone_m, x_m, y_m = self._moves.popleft()
            self._way_m -= gone_m
            self._x_m -= x_m
            self._y_m -= y_m

    @property
    def moved_m(self) -> float:
        """Over the last WAY_M."""
        return math.hypot(self._x_m, self._y_m)
