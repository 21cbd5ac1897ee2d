"""Which lane is the present one, and what stays of those before: part of the one filter
(`host.estimate.position`)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from host.core.vehicle import Vehicle
from host.estimate import wander
from host.estimate.lanes import Aside, Known, Lanes, caught_up, straightened
from host.estimate.profile import STEP_M, STRAIGHT, Profile, profile_of
from host.estimate.readings import Readings
from host.estimate.states import LANE, WANDER
from host.estimate.wander import BENT, CUT, DRILLED, TRIMMED, Wander
from host.route.side import Side


class OnLanes(Readings):
    """Lane after lane, each beside the one that has left its edge."""

    def __init__(
        self, vehicle: Vehicle, boundary: Sequence[tuple[float, float]] = (), sigma_m: float = 0.0
    ) -> None:
        """As `Readings`."""
        super().__init__(vehicle, boundary, sigma_m)
        self._lanes = Lanes(vehicle.blade_width_m, range(self.outline.at.stop, len(self._x), 2))
        self._wander, self._trimmed = DRILLED, False
        self._undoubted = math.inf
        """Standard deviation of where the present lane's edge is seen, before what contradicted it
        made it doubtful, m; inf: nothing has."""
        self.aside = Aside()
        """Of the present lane."""
        self._way: list[tuple[float, float]] = []
        """That was cut along it (`profile_of`)."""

    def begin(self, side: Side, *, straight: bool = True, goes_on: bool = False) -> None:
        """From here on it is this side's lane: what is known of the last is kept for the one whose
        edge it has left. `straight`: it is the whole of a side, that may be straightened. It
        `goes_on` in the same strip, past a bend."""
        kept = self._lanes.keep(self._lane_of, self._x, self._p, self._left())
        now = np.eye(len(self._x))[LANE]
        self._let(slice(kept, kept + 2), Known(np.zeros(2), now, np.zeros((2, 2))))
        self._onto(side, straight=straight, goes_on=goes_on)

    def back_to(self, side: Side) -> None:
        """From here on it is this side's lane, which has not been cut either."""
        self._onto(side, straight=False, beside=self._beside)

    def _onto(
        self, side: Side, *, straight: bool, goes_on: bool = False, beside: Wander | None = None
    ) -> None:
        self._lane_of, self._trimmed = side, straight
        self._profile, self._way = self._lanes.profile(side), []
        known = self._lanes.beside(side, len(self._x))
        sigmas = np.sqrt(np.diag(known.covariance(self._p)))
        self._let(LANE, known)
        self.aside = Aside()
        if straight and self._lanes.knows(side):
            lane, length_m = self._x[LANE], self.outline.found(side).length_m
            aside = straightened(lane.item(1), sigmas.item(1), length_m)
            self.aside = caught_up(aside, lane.item(0), sigmas.item(0))
            self._x[LANE] -= self.aside
        self._other_edge(side, beside, goes_on=goes_on)

    def _let(self, at: slice, lane: Known) -> None:
        """From here on these two states are that lane."""
        self._x[at], self._apart[at] = lane.at + lane.by @ self._x, lane.by @ self._apart
        for p in self._covariances:
            with_others, own = lane.by @ p, lane.covariance(p)
            p[at, :], p[:, at] = with_others, with_others.T
            p[at, at] = own

    def look(self, side: Side, beside: Wander | None) -> None:
        """The edge of the present lane, this side's, is seen from beside it from here on, and that
        errs so; or from where it is to be cut."""
        if beside is not self._beside:
            self._other_edge(side, beside)

    def cut(self) -> None:
        """The blade cuts along the lane: so lies the edge that it leaves, where edges bend."""
        if not self.bends:
            return
        place = self.on_lane()
        if not self._way or place.blade_m > self._way[-1][0] + STEP_M / 2:
            left = place.off_lane_m(self._blade_x_m) + place.profile.at(place.blade_m)
            self._way.append((place.blade_m, left))

    def _left(self) -> Profile:
        """The edge that the present lane leaves; the lane goes through it at the blade then."""
        if not self._way:
            return STRAIGHT
        place, offset_m = self.on_lane(), self._x.item(WANDER)
        states = self._x, self._apart
        wander.into_lane(states, self._covariances, place.blade_m, place.turned())
        return profile_of(self._way, offset_m)

    def _other_edge(
        self, side: Side, beside: Wander | None = None, *, goes_on: bool = False
    ) -> None:
        """Nothing is known yet of how this one wanders, as it is seen; where it `goes_on`, only of
        how it does so from here on."""
        self._lane_of, self._beside = side, beside
        left = self._inside or self._lanes.knows(side)
        self._undoubted = math.inf
        surveyed = self.bends and not self._profile.known
        self._wander = beside or (BENT if surveyed else CUT if left else DRILLED)
        states = self._x, self._apart
        wander.begin(states, self._covariances, self._wanders, goes_on=goes_on)

    @property
    def _wanders(self) -> Wander:
        """How the edge that is seen wanders from here on."""
        trimmed = self._trimmed and self._inside and self.known and not self.beside
        before = trimmed and self.along(self._lane_of) < self._lane_of.begin_seen_m
        return TRIMMED if before else self._wander

    @property
    def _inside(self) -> bool:
        """Whether the lane's edge is one that strips have left, and not the boundary."""
        return self._lane_of.inside_m > self._vehicle.blade_width_m / 2
