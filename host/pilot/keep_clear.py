"""How far beside its lane the machine is driven where a keep-out stands beside it: as far away from
that as the place is known, over ground that is cut. The geofence would stop it there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from host.core.vehicle import Vehicle
from host.estimate.position import Position
from host.estimate.states import LANE_OFFSET, LANE_YAW
from host.field.areas import outline_of, placed

ROOM_M: Final = 0.1
"""More than the geofence asks for: the lane is not followed better than that."""
MOST_M: Final = 0.5
"""Half of the blade cuts still. Where a strip is cut to the right, it may be the blade's width."""
SLOPE: Final = 0.1
"""Of the way around: 6 degrees against the lane."""
FAR_M: Final = 1.5
"""Nothing so far away is in the way of a machine that still knows its place."""
PAST_SLOPE: Final = 0.3
"""The same where it takes more, up to the blade's width, over the swath of the strip before: 17
degrees, which the steering follows over 2 m."""
END_M: Final = 0.5
"""So near its end, what stands before the machine ends the strip."""
BESIDE: Final = 0.5
"""Of the blade's half width: what stands nearer to the lane stands before the machine."""


class KeepClear:
    """`keep_outs`: (x, y) corners of each with its margin, in the plan's frame; `sigmas`: of its
    place that the geofence counts."""

    def __init__(
        self,
        keep_outs: Sequence[Sequence[tuple[float, float]]],
        sigmas: float,
        vehicle: Vehicle,
        position: Position,
    ) -> None:
        self._keep_outs = keep_outs
        self._sigmas = sigmas
        self._vehicle = vehicle
        self._position = position
        self._outline = outline_of(vehicle)
        self.aside_m = 0.0
        """How far left of its lane the machine is to be driven here; negative: right."""
        self.near = False
        """Whether one stands so near that no picture may lead the machine elsewhere than it
        believes to be."""

    def look(self) -> None:
        """From the machine's present place."""
        self.aside_m, self.near = 0.0, False
        for keep_out in self._keep_outs:
            found = self._past(keep_out)
            self.aside_m = found if abs(found) > abs(self.aside_m) else self.aside_m

    def _past(self, keep_out: Sequence[tuple[float, float]]) -> float:
        """The same because of one."""
        position, vehicle = self._position, self._vehicle
        place = position.on_lane()
        (c, s), side = place.direction, place.side
        here = np.array([position.pose[:2]])
        blade, half = place.blade_m, vehicle.blade_width_m / 2
        offset, turned = float(place.x[LANE_OFFSET]), float(place.x[LANE_YAW])
        ((mx, my),) = (here - position.borders.as_planned(here)).tolist()
        along, left = [], []
        for x, y in keep_out:
            dx, dy = x - side.x_m + mx, y - side.y_m + my
            along.append(c * dx + s * dy)
            lane = place.inset_m - side.shift_m + offset + turned * along[-1]
            left.append(c * dy - s * dx - lane)
        low, high = min(left), max(left)
        gap = max(low, -high) - half
        rear = blade - vehicle.blade_x_m - vehicle.rear_overhang_m
        away = max(0.0, min(along) - blade, rear - max(along))
        self.near = self.near or max(gap, away) < FAR_M
        before = low < BESIDE * half and high > -BESIDE * half
        # inside of a strip that is cut the ground right of the machine is free
        wide = low + high > 0.0 and side.inside_m > half
        if before and (not wide or min(along) > side.length_m - END_M):
            return 0.0
        if gap + SLOPE * away > FAR_M:
            return 0.0
        points = placed(self._outline, *position.pose)
        covariance = position.borders.covariance_of(points)
        across = np.array([-s, c])
        sigma = math.sqrt(float((covariance @ across @ across).max()))
        short = self._sigmas * sigma + ROOM_M - gap
        if before and short > vehicle.blade_width_m:
            return 0.0
        most, slope = MOST_M, SLOPE
        if wide and short > MOST_M:
            most, slope = vehicle.blade_width_m, PAST_SLOPE
        return math.copysign(min(max(0.0, short - slope * away), most), -low - high)
