"""Where the machine is in the field frame, and how surely: dead reckoning anchored to the plan.

A phone's position is good to some 2.5 m, slowly wandering: no use beside a gap of 2 m. But the
operator puts the blade on a known corner, every side lies along a known line, and every end of a
side is a known place: those anchor an extended Kalman filter over (x, y, yaw, the wheels' slip
while cutting, the lane's offset and direction against its edge, the courses' direction against the
plan's, the boundary's corners).

A line is known only as well as it was cut: strip after strip may lie a little askew of the one
before. So each lane has an offset and a direction of its own, known from the lane whose cutting has
left its edge, and the receiver's Doppler courses, which no strip turns, tell them from the
machine's.

A walked boundary is a metre off and some degrees. So its corners are landmarks: beside the first
strips, and at their ends, the machine finds where the edges lie (host.estimate.outline).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import Vehicle
from host.estimate.kalman import Filter
from host.estimate.measurements import begin, course, end, line
from host.estimate.measurements.goes_on import to_border
from host.estimate.odometry import Motion
from host.estimate.outline import Outline
from host.estimate.place import Place
from host.estimate.states import LANE, LANE_YAW, PLAN_YAW, SLIP, STATES, YAW, X, Y
from host.route.side import NO_EDGE, Side

START_SIGMA = (0.1, 0.1, math.radians(2))
LANE_SIGMA = (0.06, math.radians(0.5))
"""Of the outer edge's line against the plan's, m and rad."""
RING_SIGMA = (0.02, math.radians(0.2))
RING_ENDS_M = 0.1
"""What a strip adds to that, m and rad; its direction the more, the shorter it is: both ends err by
so much."""
STRAIGHTEN_M = 0.1
"""By which a lane overlaps what is cut at most, at one of its ends, to lie less askew than the edge
beside it."""
PLAN_SIGMA_RAD = math.radians(3)
"""Of a walked boundary's direction against the courses'."""
STEP_SIGMA = (0.03, 0.02)
"""Error of a step as a share of it, along (wheels slip, most where they start and stop) and
across."""
SLIP_SIGMA = 0.015
"""Of the share of their way that the driven wheels lose while they push the blade through crop,
before anything is learned of it."""
YAW_SIGMA_PER_M = math.radians(0.3)
YAW_SIGMA_SHARE = 0.03
"""Error of the yaw by dead reckoning: per square root of a metre, and as a share of what was turned
(the prior of the steering's gain, `odometry.YAW_GAIN_PRIOR`)."""
GYRO_SIGMA_PER_ROOT_S = math.radians(0.1)
GYRO_SIGMA_SHARE = 0.01
"""The same by the gyroscope: its offset, which lasts, as noise of some tens of seconds (0.02 deg/s
over 40 s), and its scale."""


class _Lane(NamedTuple):
    """What was found of a side's lane: (2,) its offset at the side's beginning, m left of the
    plan's, and its direction, rad; (2, 2) their covariance."""

    side: Side
    x: NDArray[np.float64]
    p: NDArray[np.float64]


class Aside(NamedTuple):
    """How far right of its usual place beside the edge a lane is laid, over ground that is cut."""

    begin_m: float = 0.0
    """At the side's beginning."""
    slope: float = 0.0
    """More with each metre, as a tangent."""


def straightened(askew_rad: float, sigma_rad: float, length_m: float) -> Aside:
    """Beside an edge that is turned left of the plan by askew_rad, give or take sigma_rad: what is
    surely askew of it is taken off, as far as STRAIGHTEN_M allows. The blade never leaves crop
    standing beside its edge, it overlaps at the one end or at the other."""
    sure = max(0.0, abs(askew_rad) - sigma_rad)
    turn = min(math.tan(sure), STRAIGHTEN_M / max(length_m, 1.0))
    return Aside(0.0, turn) if askew_rad > 0.0 else Aside(turn * length_m, -turn)


class Position(Filter):
    """Unknown until `place`. Sides are the plan's; where they are found to lie is known here."""

    def __init__(
        self,
        vehicle: Vehicle,
        boundary: Sequence[tuple[float, float]] = (),
        sigma_m: float = 0.0,
    ) -> None:
        """`boundary`: its corners, counter-clockwise, each known to sigma_m; 0: they lie where it
        says."""
        self.outline = Outline(boundary if sigma_m > 0.0 else ())
        self._sigma_m = sigma_m
        states = STATES + self.outline.states
        super().__init__(np.zeros(states), np.full((states, states), math.inf))
        self._vehicle = vehicle
        self._past: Motion | None = None
        self._lanes: list[_Lane] = []
        self._lane_of: Side | None = None
        self.aside = Aside()
        """Of the present lane."""
        self.known = False

    @property
    def pose(self) -> tuple[float, float, float]:
        """(x, y, yaw) of the rear axle, m and rad."""
        return float(self._x[X]), float(self._x[Y]), float(self._x[YAW])

    @property
    def course_rad(self) -> float:
        """The course that the receiver should show, driving forward. Where the boundary is still to
        be found, it may lie some degrees askew of the courses; one that is known may not."""
        return float(self._x[YAW] + (self._x[PLAN_YAW] if self.outline.states else 0.0))

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(3, 3) of the pose, m and rad."""
        return self._p[: YAW + 1, : YAW + 1].copy()

    def covariance_of(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2, 2), m², of points (n, 2) of the machine, m in the field frame, against the border
        nearest to each: the direction's uncertainty moves them the more, the farther from the rear
        axle they are."""
        x, y, _ = self.pose
        by_state = np.zeros((len(points), 2, len(self._x)))
        by_state[:, 0, X] = by_state[:, 1, Y] = 1.0
        by_state[:, 0, YAW], by_state[:, 1, YAW] = y - points[:, 1], points[:, 0] - x
        if self.outline.states:
            near = self.outline.nearest(points)
            by_state[:, 0, STATES::2] = by_state[:, 1, STATES + 1 :: 2] = -near
        found: NDArray[np.float64] = by_state @ self._p @ by_state.transpose(0, 2, 1)
        return found

    def as_planned(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2) points of the machine where they would lie if the border nearest to each lay as
        the plan has it."""
        if self.outline.as_planned:
            return points
        moved: NDArray[np.float64] = points - self.outline.nearest(points) @ self.outline.moved_m
        return moved

    def place(self, side: Side, along_m: float, offset_m: float, heading_rad: float) -> None:
        """On a side's lane: the blade along_m past where vision sees the side's beginning, the rear
        axle offset_m left of the lane, the vehicle heading_rad left of its direction."""
        c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
        back = along_m + side.begin_seen_m - self._vehicle.blade_x_m
        inside = self._vehicle.inset_m - side.shift_m + offset_m
        x, y = side.x_m + c * back - s * inside, side.y_m + s * back + c * inside
        corners = np.zeros(self.outline.states)
        self._x = np.array(
            [x, y, side.heading_rad + heading_rad, *np.zeros(STATES - SLIP), *corners]
        )
        sigmas = (*START_SIGMA, SLIP_SIGMA, *LANE_SIGMA, PLAN_SIGMA_RAD)
        own = np.diag([*np.square(sigmas), *(corners + self._sigma_m**2)])
        # Where the edge truly is, there the operator has put the machine: so far past its corner.
        with_corners = np.eye(len(own))
        ahead = self.outline.of_corner(side.edge, (c, s))
        left = self.outline.along(side.edge, (side.x_m, side.y_m), (-s, c))
        with_corners[X, STATES:] = c * ahead - s * left
        with_corners[Y, STATES:] = s * ahead + c * left
        with_corners[YAW, STATES:] = self.outline.turning(side.edge)
        self._p = with_corners @ own @ with_corners.T
        self.known = True
        self._lane_of = side

    def begin(self, side: Side, *, straight: bool = True) -> None:
        """From here on it is this side's lane: what is known of the last is kept for the one whose
        edge it has left. `straight`: it is the whole of a side, that may be straightened."""
        past = self._lane_of
        if past is not None:
            done = _Lane(past, self._x[LANE].copy(), self._p[LANE, LANE].copy())
            kept = [lane for lane in self._lanes if not self._left_by(past, lane)]
            self._lanes = [*kept, done]
        self._lane_of = side
        last = self._beside(side)
        lane, covariance = np.zeros(2), np.diag(LANE_SIGMA) ** 2
        if last is not None:
            moved = np.array([[1.0, side.begins_past(last.side)], [0.0, 1.0]])
            askew = math.hypot(RING_SIGMA[1], RING_ENDS_M / max(1.0, last.side.length_m))
            grown = np.diag([RING_SIGMA[0] ** 2, askew**2])
            lane, covariance = moved @ last.x, moved @ last.p @ moved.T + grown
        self.aside = Aside()
        if straight and last is not None:
            sigma = math.sqrt(covariance[1, 1])
            self.aside = straightened(float(lane[1]), sigma, self.outline.found(side).length_m)
            lane = lane - np.array(self.aside)
        self._x[LANE] = lane
        self._p[LANE, :] = self._p[:, LANE] = 0.0
        self._p[LANE, LANE] = covariance

    def _beside(self, side: Side) -> _Lane | None:
        """The lane whose cutting has left a side's edge. Where the strips between were laid out
        otherwise, the last along the same edge of the boundary: an inner strip is turned as that
        is, it does not lie along the boundary again."""
        left = [known for known in self._lanes if self._left_by(side, known)]
        if left:
            return left[-1]
        same = [k for k in self._lanes if side.edge != NO_EDGE and k.side.edge == side.edge]
        return same[-1] if same and side.inside_m > same[-1].side.inside_m else None

    def _left_by(self, side: Side, lane: _Lane) -> bool:
        return side.left_by(lane.side, self._vehicle.blade_width_m)

    def predict(self, motion: Motion, *, cutting: bool) -> None:
        """Moves with the vehicle."""
        past, self._past = self._past, motion
        if past is None or not self.known:
            return
        step = motion.distance_m - past.distance_m
        turn = motion.yaw_rad - past.yaw_rad
        if step == 0.0 and turn == 0.0:
            return
        middle = self._x[YAW] + turn / 2
        c, s = math.cos(middle), math.sin(middle)
        lost = step if cutting else 0.0
        step -= lost * float(self._x[SLIP])
        self._x[:SLIP] += step * c, step * s, turn
        moves = slice(0, SLIP + 1)
        jacobian = np.eye(SLIP + 1)
        jacobian[:YAW, YAW] = -step * s, step * c
        jacobian[:YAW, SLIP] = -lost * c, -lost * s
        # Neighbouring steps err alike: their errors grow along a metre as one.
        run = abs(step)
        turned = np.array([[c, -s], [s, c]])
        self._p[moves] = jacobian @ self._p[moves]
        self._p[:, moves] = self._p[:, moves] @ jacobian.T
        self._p[:YAW, :YAW] += turned @ np.diag(np.square(STEP_SIGMA) * run) @ turned.T
        if motion.by_gyro:
            lasted = motion.stamp - past.stamp
            grown = GYRO_SIGMA_PER_ROOT_S**2 * lasted + GYRO_SIGMA_SHARE**2 * abs(turn)
        else:
            grown = YAW_SIGMA_PER_M**2 * run + YAW_SIGMA_SHARE**2 * abs(turn)
        self._p[YAW, YAW] += grown

    def at(self, side: Side) -> Place:
        """The place against a side."""
        found, vehicle = self.outline.found(side), self._vehicle
        return Place(self._x, found, vehicle.blade_x_m, vehicle.inset_m, self.outline)

    def along(self, side: Side) -> float:
        """How far the blade's line is past a side's beginning."""
        return self.at(side).blade_m

    def against_lane(self) -> tuple[float, float, float, float]:
        """The rear axle's place against the present lane as it lies, not as the plan has it: how
        far left (m) and how far turned left (rad), and their standard deviations."""
        place = self._on_lane()
        along = place.blade_m - self._vehicle.blade_x_m
        offset = place.across_m - place.lane_at(along)
        heading = math.remainder(place.turned_rad - self._x[LANE_YAW], math.tau)
        across, turned = place.beside(along), place.turned()
        turned[LANE_YAW] = -1.0
        sigmas = (math.sqrt(across @ self._p @ across), math.sqrt(turned @ self._p @ turned))
        return offset, heading, *sigmas

    def _on_lane(self) -> Place:
        assert self._lane_of is not None
        return self.at(self._lane_of)

    def end_sigma_m(self, side: Side, way: int = 1) -> float:
        """Standard deviation of how far the blade is before a side's end, or past its beginning
        (way -1)."""
        if not self.known:
            return 0.0
        h = to_border(self.at(side), way)
        return math.sqrt(h @ self._p @ h)

    @property
    def corners_sigma_m(self) -> float:
        """Of the corner whose place is known least, the standard deviation along x or y against the
        machine, or before it has a place as it was given; 0 where the boundary is known."""
        if not self.outline.states:
            return 0.0
        if not self.known:
            return self._sigma_m
        worst = 0.0
        for k in range(STATES, len(self._x)):
            own = X if (k - STATES) % 2 == 0 else Y
            worst = max(worst, self._p[k, k] + self._p[own, own] - 2 * self._p[k, own])
        return math.sqrt(worst)

    def corner_sigma_rad(self, past: Side, side: Side) -> float:
        """Standard deviation of the boundary's angle between the edges of two sides."""
        h = np.zeros(len(self._x))
        h[STATES:] = self.outline.turning(side.edge) - self.outline.turning(past.edge)
        return math.sqrt(h @ self._p @ h)

    def follow(self, blade_offset_m: float, sigma_m: float) -> None:
        """The lane filter's place of the blade's middle left of the present lane."""
        self.fuse(line.line(self._on_lane(), blade_offset_m, sigma_m))
        self._learn()

    def course(self, left_rad: float, speed_mps: float) -> None:
        """The receiver's course lies left_rad left of `course_rad`, at that speed over ground."""
        self.fuse(course.course(self._x, left_rad + self.course_rad - self._x[YAW], speed_mps))
        self._learn()

    def at_begin(self, side: Side, ago_m: float) -> None:
        """The blade met the beginning of a side's crop, and has travelled ago_m since."""
        self.fuse(begin.begin(self.at(side), self._p, ago_m))
        self._learn()

    def at_end(self, side: Side, ago_m: float, drift_m: float = 0.0, doubt_m: float = 0.0) -> None:
        """The blade met the end of a side, and has travelled ago_m since, give or take doubt_m;
        drift_m is what a wrong scale of the distances may have done along it."""
        along = np.zeros((1, len(self._x)))
        along[0, :YAW] = math.cos(side.heading_rad), math.sin(side.heading_rad)
        self._p = self._p + along.T @ along * drift_m**2
        self.fuse(end.end(self.at(side), self._p, ago_m, doubt_m))
        self._learn()

    def ends_at(self, side: Side, along_m: float, variance_m2: float) -> None:
        """A side's end is now taken to lie along_m past its beginning, with that variance against
        the blade."""
        place = self.at(side)
        h = to_border(place, 1)
        ph = self._p @ h
        before = float(h @ ph)
        step = ph * ((along_m - place.side.length_m) / before)
        # Seen from the machine, whose place was not measured: with it stays what is tied to it, as
        # the side's beginning is.
        step[STATES:] -= np.tile(step[[X, Y]], self.outline.states // 2)
        step[:STATES] = 0.0
        self._x = self._x + step
        self._p = self._p + np.outer(ph, ph) * ((variance_m2 - before) / before**2)
        self._learn()

    def laid_anew(self, boundary: Sequence[tuple[float, float]], side: Side) -> None:
        """The plan has been laid out anew around the corners as they were found, and this is its
        side that the machine is at."""
        found = np.array(self.outline.corners)
        self.outline = Outline(boundary)
        self.outline.move((found - np.array(boundary)).ravel())
        self._lane_of = side

    def _learn(self) -> None:
        """What was found of the corners is theirs from now on. Where the edge turns with them, all
        that is known turns with it: that the machine goes where the edge goes was known in its old
        direction, and how long the edge is would pass for a place beside it in the new one."""
        if not self.outline.states:
            return
        edge = self._lane_of.edge if self._lane_of is not None else NO_EDGE
        before = self.outline.heading_rad(edge)
        self.outline.move(self._x[STATES:])
        self._x[STATES:] = 0.0
        turned = math.remainder(self.outline.heading_rad(edge) - before, math.tau)
        c, s = math.cos(turned), math.sin(turned)
        turn = np.eye(len(self._x))
        for k in (X, *range(STATES, len(self._x), 2)):
            turn[k : k + 2, k : k + 2] = (c, -s), (s, c)
        self._p = turn @ self._p @ turn.T
