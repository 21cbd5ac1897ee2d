"""The one filter: where the machine is in the field frame, where its lane runs, what its sensors
and its wheels err, and how surely: dead reckoning anchored to the plan and to the crop's edge.

A phone's position is good to some 2.5 m, slowly wandering: no use beside a gap of 2 m. But the
operator puts the blade on a known corner, every side lies along a known line, and every end of a
side is a known place: those anchor an extended Kalman filter (`host.estimate.states`).

A line is known only as well as it was cut: strip after strip may lie a little askew of the one
before. So each lane has an offset and a direction of its own, known from the lane whose cutting has
left its edge, and the receiver's Doppler courses, which no strip turns, tell them from the
machine's. Beside that straight line the edge wanders, and the machine with it.

A walked boundary is a metre off and some degrees. So its corners are landmarks: beside the first
strips, and at their ends, the machine finds where the edges lie (host.estimate.outline).

What seems to be an end may be none. Where that makes more than half a metre, the machine may be at
two places, until what it sees next has decided (`host.estimate.kalman.Filter`). It drives by the
likelier. The geofence asks both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.special import log_ndtr

from host.core.vehicle import Vehicle
from host.estimate import doubt, leading_lane, other_edge, prior, spread, turned_strips
from host.estimate.kalman import Measurement
from host.estimate.lanes import LANE_SIGMA, Aside, Known, Lanes, caught_up, straightened
from host.estimate.measurements import begin, course, end
from host.estimate.measurements.begin import MET_SIGMA_M
from host.estimate.measurements.goes_on import to_border
from host.estimate.motion_model import BENT, CUT, DRILLED, TRIMMED, Wander, move
from host.estimate.odometry import Motion
from host.estimate.outline import Outline
from host.estimate.readings import NO_SIDE, Readings
from host.estimate.states import (
    CURVE,
    GRADE_X,
    GRADE_Y,
    GYRO,
    GYRO_SCALE,
    LANE,
    LANE_OFFSET,
    LANE_YAW,
    RATES,
    WANDER,
    YAW,
    X,
    Y,
)
from host.route.side import Side

BOUND_SIGMA_M = 0.2
"""Of crop that goes on beside the blade: weeds stand on from it too, for a step or two."""
WRONG_PLACE = 0.3
"""Probability that an end that a look finds where none is believed is one, and the place wrong: of
five in drives with pictures and model eyes none or one was (low camera). Smaller: a boundary that
is surely longer than the field is believed for longer."""
SURELY: Final = 20.0
"""Logarithm of a likelihood ratio that decides."""


class Position(Readings):
    """Unknown until `place`. Sides are the plan's; where they are found to lie is known here."""

    def __init__(
        self,
        vehicle: Vehicle,
        boundary: Sequence[tuple[float, float]] = (),
        sigma_m: float = 0.0,
        recorded: bool = False,
    ) -> None:
        """As `Readings`."""
        super().__init__(vehicle, boundary, sigma_m, recorded)
        self._past: Motion | None = None
        self._lanes = Lanes(vehicle.blade_width_m, range(self.outline.at.stop, len(self._x), 2))
        self._wander, self._trimmed, self._doubt = DRILLED, False, doubt.Doubt()
        self._undoubted = math.inf
        """Standard deviation of where the present lane's edge is seen, before what contradicted it
        made it doubtful, m; inf: nothing has."""
        self.aside = Aside()
        """Of the present lane."""
        self.open(0.0, 0.0, *prior.OPEN_SIGMA)

    def place(
        self,
        side: Side,
        along_m: float,
        offset_m: float,
        heading_rad: float,
        sigmas: tuple[float, float, float] = prior.START_SIGMA,
        bend_1pm: float = 0.0,
    ) -> None:
        """On a side's lane: the blade along_m past where vision sees the side's beginning, the rear
        axle offset_m left of the lane, the vehicle heading_rad left of its direction. `sigmas`: of
        the axle along and beside the side, m, and of the direction, rad; that turns with the edge,
        or along one that bends by `bend_1pm`."""
        c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
        back = along_m + side.begin_seen_m - self._vehicle.blade_x_m
        inside = self._vehicle.inset_m - side.shift_m + offset_m
        x, y = side.x_m + c * back - s * inside, side.y_m + s * back + c * inside
        self._anew((x, y, side.heading_rad + heading_rad), sigmas, LANE_SIGMA)
        turned = np.array([[c, -s, 0.0], [s, c, 0.0], [bend_1pm, 0.0, 1.0]])
        self._p[: YAW + 1, : YAW + 1] = turned @ self._p[: YAW + 1, : YAW + 1] @ turned.T
        # Where the edge truly is, there the operator has put the machine: so far past its corner.
        with_corners, corners = np.eye(len(self._x)), self.outline.at
        ahead = self.outline.of_corner(side.edge, (c, s))
        left = self.outline.along(side.edge, side.pose(back)[:2], (-s, c))
        with_corners[X, corners] = c * ahead - s * left
        with_corners[Y, corners] = s * ahead + c * left
        with_corners[YAW, corners] = self.outline.turning(side.edge) * (bend_1pm == 0.0)
        self._p = with_corners @ self._p @ with_corners.T
        self.known, self.placed = True, self.placed + 1
        self._other_edge(side)

    def open(
        self, offset_m: float, heading_rad: float, offset_sd: float, heading_sd: float
    ) -> None:
        """On a lane that is in no plan: the rear axle offset_m left of it, the vehicle heading_rad
        left of its direction, with their standard deviations."""
        self.known = False
        pose = (0.0, self._vehicle.inset_m + offset_m, heading_rad)
        self._anew(pose, (offset_sd, offset_sd, heading_sd), (0.0, 0.0))
        self._other_edge(NO_SIDE)

    def _anew(
        self,
        pose: tuple[float, float, float],
        pose_sd: tuple[float, float, float],
        lane_sd: tuple[float, float],
    ) -> None:
        """Another place. What is known of the sensors and of the slip stays."""
        self._x[: YAW + 1] = pose
        lost, at = [X, Y, YAW, LANE_OFFSET, LANE_YAW], self.outline.at
        self._x[LANE] = self._x[at] = 0.0
        self.forget()
        self._p[[*lost, *self._corners], :] = self._p[:, [*lost, *self._corners]] = 0.0
        self._p[lost, lost] = np.square([*pose_sd, *lane_sd])
        self._p[at, at] = self._corners_apart
        self.aside = Aside()

    def _other_edge(self, side: Side, beside: Wander | None = None) -> None:
        """Nothing is known yet of how this one wanders, as it is seen."""
        self._lane_of, self._beside, self._undoubted = side, beside, math.inf
        edge = CUT if self._inside or self._lanes.knows(side) else DRILLED
        self._wander = beside or (BENT if self.outline.bends(side) else edge)
        self._x[WANDER] = self._apart[WANDER] = 0.0
        for p in self._covariances:
            p[WANDER, :] = p[:, WANDER] = 0.0
            p[WANDER, WANDER] = self._wanders.sigma_m**2

    @property
    def _wanders(self) -> Wander:
        """How the edge that is seen wanders from here on."""
        side = self._lane_of
        trimmed = self._trimmed and self._inside and self.known and not self.beside
        return TRIMMED if trimmed and self.along(side) < side.begin_seen_m else self._wander

    def begin(self, side: Side, *, straight: bool = True) -> None:
        """From here on it is this side's lane: what is known of the last is kept for the one whose
        edge it has left. `straight`: it is the whole of a side, that may be straightened."""
        kept, now = self._lanes.keep(self._lane_of, self._x, self._p), np.eye(len(self._x))[LANE]
        self._let(slice(kept, kept + 2), Known(np.zeros(2), now, np.zeros((2, 2))))
        self._lane_of, self._trimmed = side, straight
        known = self._lanes.beside(side, len(self._x))
        sigmas = np.sqrt(np.diag(known.covariance(self._p)))
        self._let(LANE, known)
        self.aside = Aside()
        if straight and self._lanes.knows(side):
            lane, length_m = self._x[LANE], self.outline.found(side).length_m
            aside = straightened(lane.item(1), sigmas.item(1), length_m)
            self.aside = caught_up(aside, lane.item(0), sigmas.item(0))
            self._x[LANE] -= self.aside
        self._other_edge(side)

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

    def predict(self, motion: Motion, *, cutting: bool) -> None:
        """Moves with the vehicle."""
        past, self._past = self._past, motion
        if past is not None:
            other, wander = self._x + self._apart, self._wanders
            move(self._x, self._p, past, motion, wander, cutting=cutting)
            if self.likely > 0.0:
                move(other, self._other_p, past, motion, wander, cutting=cutting)
                self._apart = other - self._x

    def less_sure(self, place_m: float, yaw_rad: float) -> None:
        """Of its place, m in every direction, and of its direction."""
        for p in self._covariances:
            p[[X, Y, YAW], [X, Y, YAW]] += np.square([place_m, place_m, yaw_rad])

    def may_be_turned(self, by_rad: float) -> bool:
        """The strips inside the field may all have turned by that standard deviation, and the place
        with them. False along the boundary: it turns with none."""
        if not (self._inside or self._lane_of.left_over):
            return False
        lanes = [*self._lanes.inside(), (self._lane_of, LANE_OFFSET)]
        self.may_err(by_rad * turned_strips.as_one(self._x, self.outline, lanes))
        return True

    def less_sure_along(self, side: Side, along_m: float) -> None:
        """Of its place along a side."""
        for p in self._covariances:
            p[:YAW, :YAW] += np.outer(d := np.array(self.at(side).direction), d) * along_m**2

    def see_edge(
        self, seen: Measurement, *, learn: bool, cutting: bool = True, doubts: bool = True
    ) -> bool:
        """A picture's edge of the lane; `learn`: the curvature that the pot does not show, too.
        False where it contradicts what is believed beyond its gate; then that is doubted."""
        bends = self.outline.bends(self._lane_of)
        frozen: Sequence[int] = RATES if bends else () if learn else (CURVE,)
        if self._lane_of.left_over:
            for p in self._covariances:
                leading_lane.tie(p, self.on_lane())
            frozen = leading_lane.others(len(self._x))
        self._heed_other_edge(seen)
        taken = self.take(seen, frozen=frozen)
        if taken:
            self._undoubted = math.inf
        elif self._undoubted == math.inf:
            self._undoubted = self.sigma(seen.h[0])
        if not taken and doubts:
            past = self._past
            here_m, by_gyro = (past.distance_m, past.by_gyro) if past else (math.nan, False)
            growth = self._doubt.growth(here_m, cutting=cutting)
            self.doubt(seen, doubt.states(float(self._p[YAW, YAW]), by_gyro=by_gyro), growth)
        return taken

    @property
    def _inside(self) -> bool:
        """Whether the lane's edge is one that strips have left, and not the boundary."""
        return self._lane_of.inside_m > self._vehicle.blade_width_m / 2

    def _heed_other_edge(self, seen: Measurement) -> None:
        """Before an edge is taken that had contradicted the lane until that was doubted enough."""
        doubted = self._inside and math.isfinite(self._undoubted)
        if doubted and other_edge.is_one(seen, self.sigma(seen.h[0]), self._undoubted):
            for p in self._covariances:
                other_edge.expect(p, self.at(self._lane_of).direction, float(seen.innovation[0]))

    def lies_right(self, seen: Measurement) -> None:
        """Crop goes on beside the blade, so the edge lies no further left than was seen. Inside the
        field that may be what others have left there: then it tells of the lane alone. Along the
        boundary the machine is farther left of it, and not turned otherwise."""
        alone = LANE_OFFSET if self._inside or self._lane_of.left_over else None
        wide = seen.variances[:1] + BOUND_SIGMA_M**2
        bound = Measurement("bound", seen.h[:1], seen.innovation[:1], wide)
        self.yield_to(bound, moves=(X, Y, LANE_OFFSET), alone=alone)

    def take(self, measurement: Measurement, frozen: Sequence[int] = (CURVE,)) -> bool:
        """As `fuse`. Only an edge along which the machine drives shows what the pot does not."""
        taken = self.fuse(measurement, frozen=frozen)
        self._settle()
        return taken

    def _settle(self) -> None:
        """What was measured is learnt from, and two places that have come together are one."""
        self.settle([X, Y, *self._corners])
        self._learn()

    def take_curve(self) -> float:
        """Curvature that the pot does not show, 1/m; whoever reckons the motion takes it over."""
        curve, self._x[CURVE] = float(self._x[CURVE]), 0.0
        return curve

    def take_gyro(self) -> tuple[float, float, float]:
        """The same of what the gyroscope shows at rest, rad/s, and its standard deviation; and the
        share that it shows too much."""
        off, self._x[GYRO] = float(self._x[GYRO]), 0.0
        too_much, self._x[GYRO_SCALE] = float(self._x[GYRO_SCALE]), 0.0
        return off, math.sqrt(self._p[GYRO, GYRO]), too_much

    def course(self, left_rad: float, speed_mps: float) -> None:
        """The receiver's course lies left_rad left of `course_rad`, at that speed over ground."""
        left = left_rad + self.course_rad - self._x.item(YAW)
        self.take(course.course(self._x, left, speed_mps))

    def at_begin(
        self, side: Side, ago_m: float, sigma_m: float = MET_SIGMA_M, *, again: bool = False
    ) -> None:
        """The blade met the beginning of a side's crop, and has travelled ago_m since (negative: is
        to travel), with that standard deviation (`again`: `Outline.held`)."""
        across = self._lanes.across(self.outline, side, -1)
        held = (CURVE, *self.outline.held(again=again))
        self.take(begin.begin(self.at(side), ago_m, sigma_m, across), held)

    def at_end(
        self,
        side: Side,
        ago_m: float,
        drift_m: float = 0.0,
        doubt_m: float = 0.0,
        elsewhere_m: float = 0.0,
        *,
        again: bool = False,
    ) -> None:
        """The blade met the end of a side, and has travelled ago_m since, give or take doubt_m;
        drift_m is what a wrong scale of the distances may have done along it. `elsewhere_m`: by
        more than is believed of it, the place is wrong by so much or the end is none: then the
        machine may be at either place."""
        self.less_sure_along(side, drift_m)
        across = self._lanes.across(self.outline, side, 1)
        seen = end.end(self.at(side), ago_m, doubt_m, across)
        along = np.zeros(len(self._x))
        along[:YAW] = np.multiply(elsewhere_m, self.at(side).direction)
        held = (CURVE, *self.outline.held(again=again))
        x, p = self.taken_if(along, seen, frozen=held)
        self.fuse(seen, frozen=held)
        if elsewhere_m > 0.0:
            self.keep_apart(x - self._x, p, WRONG_PLACE)
        self._settle()

    def crop_at(self, side: Side, ago_m: float) -> None:
        """What is being cut went on at the blade ago_m ago: where the machine may be at two places,
        it is rather at the one from which the side's end lies beyond."""
        if self.likely == 0.0:
            return
        place = self.at(side)
        h = to_border(place, 1)
        left_m = place.side.length_m - place.blade_m + ago_m
        lefts = np.array([left_m, left_m + float(h @ self._apart)])
        sigmas = [math.hypot(math.sqrt(h @ p @ h), end.SIGMA_M) for p in self._covariances]
        self.heed(np.diff(log_ndtr(lefts / sigmas)).item())
        self._settle()

    def ended(self, side: Side, ago_m: float) -> None:
        """The blade surely met the end of a side ago_m ago: of two places the machine is at the one
        from which that end lies there."""
        if self.likely == 0.0:
            return
        place = self.at(side)
        past_m = place.blade_m - ago_m - place.side.length_m
        other_m = past_m - float(to_border(place, 1) @ self._apart)
        self.heed(SURELY if abs(other_m) < abs(past_m) else -SURELY, SURELY)

    def ends_at(self, side: Side, along_m: float, variance_m2: float) -> None:
        """A side's end is now taken to lie along_m past its beginning, with that variance against
        the blade."""
        place = self.at(side)
        h = to_border(place, 1)
        ph = self._p @ h
        step = ph / float(h @ ph)
        # Seen from the machine, whose place was not measured: with it stays what is tied to it, as
        # the side's beginning is.
        moves = step[self.outline.at] - np.tile(step[[X, Y]], self.outline.states // 2)
        step[:] = 0.0
        step[self.outline.at] = moves
        self._x = self._x + step * (along_m - place.side.length_m)
        self._apart = self._apart - step * float(h @ self._apart)
        for p in self._covariances:
            ph = p @ h
            before = float(h @ ph)
            p[:] += np.outer(ph, ph) * ((variance_m2 - before) / before**2)
        self._learn()

    def laid_anew(self, boundary: Sequence[tuple[float, float]], side: Side) -> None:
        """The plan has been laid out anew around the corners as they were found, and this is its
        side that the machine is at."""
        found = np.array(self.outline.corners)
        self.outline = Outline(boundary, self.outline.walked, self.outline.strays_m)
        self.outline.move((found - np.array(boundary)).ravel())
        self._lane_of = side

    def _learn(self) -> None:
        """What was found of the corners is theirs from now on. Where the edge turns with them, all
        that is known turns with it: that the machine goes where the edge goes was known in its old
        direction, and how long the edge is would pass for a place beside it in the new one."""
        if not self.outline.states:
            return
        edge = self._lane_of.edge
        before = self.outline.heading_rad(edge)
        self.outline.move(self._x[self.outline.at])
        self._x[self.outline.at] = 0.0
        turned = math.remainder(self.outline.heading_rad(edge) - before, math.tau)
        c, s = math.cos(turned), math.sin(turned)
        x, y = self._x.item(GRADE_X), self._x.item(GRADE_Y)
        self._x[[GRADE_X, GRADE_Y]] = c * x - s * y, s * x + c * y
        xs = self.outline.turning_with
        for p in self._covariances:
            spread.turn(p, xs, c, s)
        spread.turn_by(self._apart, xs, c, s)
