"""The edge that the machine itself has left: where the blade's left end went, one round earlier.

A follower of an edge copies its bends and adds its own, round after round: turns leave it beside
its lane, and where the plan bends it takes some metres to be on it again. Dead reckoning knows the
shape of the way just driven, over some metres, far better than a picture shows it. Where that way
lay beside the lane, and how it ran and bent on the whole, the filter knows. Taken off what vision
sees, it leaves a straight edge to follow, and the new one is straight again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import Vehicle
from host.estimate.odometry import Motion
from host.route.side import Side

STEP_M = 0.05
"""Between two points of a trail."""
OUTWARD_M = 0.05
"""By which a strip may be wider than planned, where the one before it lay too far outside: beyond
that its edge is followed, or some of it would stay."""


@dataclass(frozen=True, slots=True)
class Trail:
    """`across_m[k]`: how far left of its lane's edge, a blade's width inside, the blade's left end
    was at `along_m[k]` (ascending) past the side's beginning."""

    side: Side
    along_m: NDArray[np.float64]
    across_m: NDArray[np.float64]


class Trails:
    """Remembers the last way along every direction."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._points: list[tuple[float, float, float, float]] = []
        self._left: list[Trail] = []
        self._beside: Trail | None = None

    def note(self, along_m: float, across_m: float, motion: Motion) -> None:
        """The blade is cutting, its left end along_m past its side's beginning and, by the filter,
        across_m left of where it is on the lane."""
        if self._points and along_m - self._points[-1][0] < STEP_M:
            return
        ahead, left = self._vehicle.blade_x_m, self._vehicle.blade_width_m / 2
        c, s = math.cos(motion.yaw_rad), math.sin(motion.yaw_rad)
        x, y = motion.x_m + ahead * c - left * s, motion.y_m + ahead * s + left * c
        self._points.append((along_m, across_m, x, y))

    def end(self, side: Side) -> None:
        """The side is cut: its trail is what the next round finds."""
        points, self._points = np.array(self._points), []
        if len(points) < 3:
            return
        along, across, places = points[:, 0], points[:, 1], points[:, 2:]
        chord = places[-1] - places[0]
        c, s = chord / max(STEP_M, float(np.hypot(*chord)))
        shape = (places - places[0]) @ (-s, c)
        # What an unknown steering bias adds to dead reckoning is a bend.
        shape += np.polyval(np.polyfit(along, across - shape, 2), along)
        self._left = [t for t in self._left if not self._beside_of(t, side)]
        self._left.append(Trail(side, along, shape))

    def begin(self, side: Side) -> None:
        """A new side: looks for the trail that left its edge."""
        self._points = []
        near = [t for t in self._left if self._beside_of(t, side)]
        self._beside = near[-1] if near else None

    def bend_m(self, along_m: float, side: Side) -> float:
        """How far left of its lane's the side's outer edge is at along_m; 0 where nothing is known
        of it."""
        trail = self._beside
        if trail is None:
            return 0.0
        at = side.begins_past(trail.side) + along_m
        if not trail.along_m[0] <= at <= trail.along_m[-1]:
            return 0.0
        return max(-OUTWARD_M, float(np.interp(at, trail.along_m, trail.across_m)))

    def _beside_of(self, trail: Trail, side: Side) -> bool:
        """Whether a trail is the edge of a side, which cuts it away."""
        return side.left_by(trail.side, self._vehicle.blade_width_m)
