"""The edge that the machine itself has left: where the blade's left end went, one round earlier.

A follower of an edge copies its bends and adds its own, round after round. But dead reckoning knows
the shape of the way just driven, over some metres, far better than a picture shows it: taken off
what vision sees, it leaves a straight edge to follow, and the new one is straight again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import Vehicle
from host.estimate.odometry import Motion
from host.route.side import Side

MIN_M = 3.0
"""A shorter way has no shape besides its direction and bend."""
STEP_M = 0.05
"""Between two points of a trail."""


@dataclass(frozen=True, slots=True)
class Trail:
    """`across_m[k]`: how far left of its own mean parabola the blade's left end was at `along_m[k]`
    (ascending) past the side's beginning."""

    side: Side
    along_m: NDArray[np.float64]
    across_m: NDArray[np.float64]


class Trails:
    """Remembers the last way along every direction."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._points: list[tuple[float, float, float]] = []
        self._left: list[Trail] = []
        self._beside: Trail | None = None

    def note(self, along_m: float, motion: Motion) -> None:
        """The blade is cutting, along_m past its side's beginning."""
        if self._points and along_m - self._points[-1][0] < STEP_M:
            return
        ahead, left = self._vehicle.blade_x_m, self._vehicle.blade_width_m / 2
        c, s = math.cos(motion.yaw_rad), math.sin(motion.yaw_rad)
        x, y = motion.x_m + ahead * c - left * s, motion.y_m + ahead * s + left * c
        self._points.append((along_m, x, y))

    def end(self, side: Side) -> None:
        """The side is cut: its trail is what the next round finds."""
        points, self._points = np.array(self._points), []
        if len(points) < 3 or points[-1, 0] - points[0, 0] < MIN_M:
            return
        chord = points[-1, 1:] - points[0, 1:]
        c, s = chord / np.hypot(*chord)
        run = (points[:, 1:] - points[0, 1:]) @ (c, s)
        across = (points[:, 1:] - points[0, 1:]) @ (-s, c)
        # Offset and direction are for vision to see; a bend is what an unknown steering bias adds.
        across -= np.polyval(np.polyfit(run, across, 2), run)
        trail = Trail(side, points[:, 0], across)
        self._left = [t for t in self._left if not self._beside_of(t, side)] + [trail]

    def begin(self, side: Side) -> None:
        """A new side: looks for the trail that left its edge."""
        self._points = []
        near = [t for t in self._left if self._beside_of(t, side)]
        self._beside = near[-1] if near else None

    def bend_m(self, along_m: float, side: Side) -> float:
        """How far left of straight the side's outer edge is at along_m; 0 where nothing is known of
        it."""
        trail = self._beside
        if trail is None:
            return 0.0
        at = side.begins_past(trail.side) + along_m
        if not trail.along_m[0] <= at <= trail.along_m[-1]:
            return 0.0
        return float(np.interp(at, trail.along_m, trail.across_m))

    def _beside_of(self, trail: Trail, side: Side) -> bool:
        """Whether a trail is the edge of a side, which cuts it away."""
        return side.left_by(trail.side, self._vehicle.blade_width_m)
