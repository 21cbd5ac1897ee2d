"""What the position filter says: of the machine's place, against sides, lanes and borders, and how
surely."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import Vehicle
from host.estimate import prior, spread
from host.estimate.borders import Borders
from host.estimate.kalman import Filter
from host.estimate.lanes import kept_for
from host.estimate.measurements.goes_on import to_border
from host.estimate.motion_model import STEP_SIGMA, Wander
from host.estimate.outline import STRAYS_M, Outline
from host.estimate.place import Place
from host.estimate.states import (
    CRAB,
    GRADE_X,
    GRADE_Y,
    LANE,
    LANE_YAW,
    PLAN_YAW,
    SCALE,
    YAW,
    X,
    Y,
)
from host.route.side import Side

NO_SIDE: Final = Side(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""A lane of which no plan knows: along x from the origin."""


class Readings(Filter):
    """What the filter says. `host.estimate.position` moves it and measures."""

    def __init__(
        self,
        vehicle: Vehicle,
        boundary: Sequence[tuple[float, float]] = (),
        sigma_m: float = 0.0,
        recorded: bool = False,
    ) -> None:
        """`boundary`: its corners, counter-clockwise, each known to sigma_m; 0: they lie where it
        says. `recorded`: point by point, so that the edge bends between them."""
        found = sigma_m > 0.0
        strays_m = STRAYS_M if found and recorded else 0.0
        self.outline = Outline(boundary if found else (), strays_m=strays_m)
        self.sigma_m = sigma_m
        """Of a corner of the boundary before anything is seen of it, along x and along y."""
        states = self.outline.at.stop + 2 * kept_for(len(boundary))
        super().__init__(np.zeros(states), prior.covariance(states))
        if self.outline.strays_m > 0.0:
            self._p[PLAN_YAW, PLAN_YAW] = prior.RECORDED_SIGMA_RAD**2
        walked, point_by_point = self.outline.walked, self.outline.strays_m > 0.0
        self._corners_apart = prior.corners(walked, sigma_m, point_by_point)
        """(states, states) of the corners, before anything is seen of them, m2."""
        self._vehicle = vehicle
        self._blade_x_m, self._inset_m = vehicle.blade_x_m, vehicle.inset_m
        self._lane_of = NO_SIDE
        self._beside: Wander | None = None
        self.known = False
        """Whether it has a place in the plan,"""
        self.placed = 0
        """and how often it was given one."""

    @property
    def _corners(self) -> NDArray[np.int64]:
        """(n,) where the corners stand among the states."""
        return np.arange(self.outline.at.start, self.outline.at.stop)

    @property
    def x(self) -> NDArray[np.float64]:
        """(states,) the state. Not to be written to."""
        return self._x

    @property
    def pose(self) -> tuple[float, float, float]:
        """(x, y, yaw) of the rear axle, m and rad."""
        x = self._x
        return x.item(X), x.item(Y), x.item(YAW)

    @property
    def course_rad(self) -> float:
        """The course that the receiver should show, driving forward. Where the boundary is still to
        be found, it may lie some degrees askew of the courses; one that is known may not."""
        askew = self._x[PLAN_YAW] if self.outline.states else 0.0
        return float(self._x[YAW] + self._x[CRAB] + askew)

    @property
    def beside(self) -> bool:
        """Whether its lane's edge is seen from beside it, and not followed where it wanders."""
        return self._beside is not None

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(3, 3) of the pose, m and rad."""
        pose = slice(X, YAW + 1)
        if self.likely == 0.0:
            return self._p[pose, pose].copy()
        by, share = self._apart[pose], self.likely
        of_both = (1.0 - share) * self._p + share * self._other_p
        found: NDArray[np.float64] = of_both[pose, pose] + share * np.outer(by, by)
        return found

    @property
    def borders(self) -> Borders:
        """The place against the field's borders, as it is now."""
        return Borders(self._x, self._p, self.outline)

    @property
    def all_borders(self) -> tuple[Borders, ...]:
        """The same of every place at which the machine may be: that, and the alternative."""
        if self.likely == 0.0:
            return (self.borders,)
        more = self._apart[self.outline.at].reshape(-1, 2)
        return self.borders, Borders(self._x + self._apart, self._other_p, self.outline, more)

    @property
    def apart_m(self) -> float:
        """How far from there the alternative lies against any border, at most; 0: there is none."""
        if self.likely == 0.0:
            return 0.0
        corners = self._apart[self.outline.at].reshape(-1, 2)
        return math.hypot(*self._apart[:YAW]) + float(np.hypot(*corners.T).max(initial=0.0))

    def at(self, side: Side) -> Place:
        """The place against a side."""
        outline = self.outline
        return Place(self._x, outline.found(side), self._blade_x_m, self._inset_m, outline)

    def along(self, side: Side) -> float:
        """How far the blade's line is past a side's beginning."""
        found = self.outline.found(side)
        c, s = math.cos(found.heading_rad), math.sin(found.heading_rad)
        dx, dy = self._x.item(X) - found.x_m, self._x.item(Y) - found.y_m
        return dx * c + dy * s + self._blade_x_m

    def against_lane(self) -> tuple[float, float, float, float]:
        """The rear axle's place against the present lane as it lies, not as the plan has it: how
        far left (m) and how far turned left (rad), and their standard deviations."""
        place = self.on_lane()
        along = place.blade_m - self._vehicle.blade_x_m
        offset = place.across_m - place.lane_at(along)
        heading = math.remainder(place.turned_rad - place.lane_rad(along), math.tau)
        across, turned = place.beside(along), place.turned()
        turned[LANE_YAW] = -1.0
        return offset, heading, self.sigma(across), self.sigma(turned)

    def on_lane(self) -> Place:
        """The place against the present lane's side."""
        outline = self.outline
        found = outline.found(self._lane_of)
        return Place(self._x, found, self._blade_x_m, self._inset_m, outline)

    def beside_sigma_m(self, side: Side) -> float:
        """Standard deviation of how far the machine is beside a side's line, as the plan has it."""
        h = self.at(side).beside()
        h[LANE] = 0.0
        return self.sigma(h)

    def end_sigma_m(self, side: Side, way: int = 1, back_m: float = 0.0) -> float:
        """Standard deviation of how far the blade is before a side's end, or past its beginning
        (way -1), once the machine has backed so far along it."""
        if not self.known:
            return 0.0
        place = self.at(side)
        h = to_border(place, way)
        if back_m != 0.0:
            h[SCALE] -= back_m
            h[[GRADE_X, GRADE_Y]] += np.multiply(back_m, place.direction)
        strays_m = self.outline.end_strays_m(side, way)
        return math.sqrt(self.sigma(h) ** 2 + strays_m**2 + STEP_SIGMA[0] ** 2 * back_m)

    @property
    def corners_sigma_m(self) -> float:
        """Of the corner whose place is known least, the standard deviation along x or y against the
        machine, or before it has a place as it was given; 0 where the boundary is known."""
        if not self.outline.states:
            return 0.0
        if not self.known:
            return self.sigma_m
        return math.sqrt(spread.farthest(self._p, self.outline.at.start, self.outline.at.stop))

    def corner_sigma_rad(self, past: Side, side: Side) -> float:
        """Standard deviation of the boundary's angle between the edges of two sides."""
        h = np.zeros(len(self._x))
        h[self.outline.at] = self.outline.turning(side.edge) - self.outline.turning(past.edge)
        return self.sigma(h)
