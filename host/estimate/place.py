"""The position against one side of the plan: what its measurements are made of."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from host.estimate.kalman import Array
from host.estimate.outline import Outline
from host.estimate.states import LANE_OFFSET, LANE_YAW, YAW, X, Y
from host.route.side import Side

NO_OUTLINE = Outline()


class Place(NamedTuple):
    """Of a position's state `x` beside `side`, where it is found to lie; inset_m: the rear axle's
    usual distance from the edge."""

    x: Array
    side: Side
    blade_x_m: float
    inset_m: float
    outline: Outline = NO_OUTLINE

    @property
    def direction(self) -> tuple[float, float]:
        """Cosine and sine of the side's."""
        heading = self.side.heading_rad
        return math.cos(heading), math.sin(heading)

    @property
    def blade_m(self) -> float:
        """How far the blade's line is past the side's beginning."""
        c, s = self.direction
        dx, dy = self.x.item(X) - self.side.x_m, self.x.item(Y) - self.side.y_m
        return dx * c + dy * s + self.blade_x_m

    @property
    def across_m(self) -> float:
        """How far the rear axle is left of the lane as the plan has it."""
        c, s = self.direction
        dx, dy = self.x.item(X) - self.side.x_m, self.x.item(Y) - self.side.y_m
        return dy * c - dx * s - self.inset_m + self.side.shift_m

    @property
    def turned_rad(self) -> float:
        """How far the vehicle is turned left of the side."""
        return math.remainder(self.x.item(YAW) - self.side.heading_rad, math.tau)

    def off_lane_m(self, ahead_m: float, left_m: float = 0.0) -> float:
        """How far a point of the machine, ahead_m before the rear axle, is left of the lane at the
        blade's line, less left_m. In one go: it is asked for several times a step."""
        x, side = self.x, self.side
        c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
        dx, dy = x.item(X) - side.x_m, x.item(Y) - side.y_m
        across = dy * c - dx * s - self.inset_m + side.shift_m
        turned = ahead_m * math.sin(math.remainder(x.item(YAW) - side.heading_rad, math.tau))
        along = dx * c + dy * s + self.blade_x_m
        bow, _ = self.outline.bow(side, along)
        return across + turned - (x.item(LANE_OFFSET) + x.item(LANE_YAW) * along) - bow - left_m

    def lane_at(self, along_m: float) -> float:
        """How far left of the plan's straight line the lane lies, along_m past its beginning."""
        bow, _ = self.outline.bow(self.side, along_m)
        return self.x.item(LANE_OFFSET) + self.x.item(LANE_YAW) * along_m + bow

    def lane_rad(self, along_m: float) -> float:
        """How far left of that line it runs there."""
        return self.x.item(LANE_YAW) + self.outline.bow(self.side, along_m)[1]

    def beside(self, along_m: float | None = None) -> Array:
        """(states,) the derivative of the rear axle's offset from the lane where it lies along_m
        past its beginning; at the blade's line."""
        c, s = self.direction
        h = np.zeros(len(self.x))
        along = self.blade_m if along_m is None else along_m
        slope = self.outline.bow(self.side, along)[1]
        x, y = -s - slope * c, c - slope * s
        h[X], h[Y], h[LANE_OFFSET], h[LANE_YAW] = x, y, -1.0, -along
        self.outline.along(self.side.edge, self.side.pose(along)[:2], (-x, -y), h[self.outline.at])
        return h

    def ahead(self, ahead_m: float, along_m: float) -> Array:
        """(states,) the derivative of how far left of the lane a point of the machine ahead_m
        before the rear axle lies, whose foot is along_m past the side's beginning. The line moves
        by what it moves there: that it turns with the corners is in that."""
        h = self.beside(along_m)
        h[YAW] += ahead_m * math.cos(self.turned_rad)
        return h

    def turned(self) -> Array:
        """(states,) the derivative of `turned_rad`."""
        h = np.zeros(len(self.x))
        h[YAW] = 1.0
        h[self.outline.at] = -self.outline.turning(self.side.edge)
        return h
