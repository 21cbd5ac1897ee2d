"""The filter's place (`host.estimate.position`) against the borders: what the fence asks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from host.estimate import spread
from host.estimate.kalman import Array
from host.estimate.outline import Outline
from host.estimate.states import CORNERS, YAW, X, Y


@dataclass(frozen=True, slots=True)
class Borders:
    """A state (states,) with its covariance (states, states), and where the corners were found."""

    x: Array
    p: Array
    outline: Outline
    more_m: Array | None = None
    """(n, 2), m, what comes to that where the state is an alternative; None: it is none."""

    @property
    def pose(self) -> tuple[float, float, float]:
        """(x, y, yaw) of the rear axle, m and rad."""
        return self.x.item(X), self.x.item(Y), self.x.item(YAW)

    @property
    def _moved_m(self) -> Array:
        """(n, 2) how far each corner lies from where the plan has it."""
        moved = self.outline.moved_m
        return moved if self.more_m is None else moved + self.more_m

    def covariance_of(self, points: Array) -> Array:
        """(n, 2, 2), m², of points (n, 2) of the machine, m in the field frame, against the border
        nearest to each: the direction's uncertainty moves them the more, the farther from the rear
        axle they are."""
        found = np.empty((len(points), 2, 2))
        spread.of_points(self.p, CORNERS, *self._axle, points, self.outline.nearest(points), found)
        return self._strayed(found)

    def against(self, points: Array, places: Array) -> tuple[Array, Array]:
        """Of points (n, 2) of the machine against the borders nearest to (m, 2) places, as they
        were planned: (m, n, 2, 2), m²; and (m, 2), m, how far those borders lie from there. Of a
        border that lies as planned (1, n, 2, 2) is all."""
        anywhere = not self.outline.states
        near = np.zeros((1, 0)) if anywhere else self.outline.weights(places)
        found = np.empty((len(near), len(points), 2, 2))
        spread.of_points_against(self.p, CORNERS, *self._axle, points, near, found)
        found = self._strayed(found)
        return found, np.zeros_like(places) if anywhere else near.dot(self._moved_m)

    def _strayed(self, found: Array) -> Array:
        """(…, 2, 2), m²: against what bends beside the border's straight piece."""
        strays_m = self.outline.strays_m
        return found + strays_m**2 * np.eye(2) if strays_m > 0.0 else found

    def as_planned(self, points: Array) -> Array:
        """(n, 2) points of the machine where they would lie if the border nearest to each lay as
        the plan has it."""
        if self.outline.as_planned and self.more_m is None:
            return points
        moved: Array = points - self.outline.nearest(points).dot(self._moved_m)
        return moved

    @property
    def _axle(self) -> tuple[float, float]:
        return self.x.item(X), self.x.item(Y)
