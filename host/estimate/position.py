"""Where the machine is in the field frame, and how surely: dead reckoning anchored to the plan.

A phone's position is good to some 2.5 m, slowly wandering: no use beside a gap of 2 m. But the
operator puts the blade on a known corner, every side lies along a known line, and every end of a
side is a known place: those anchor an extended Kalman filter over (x, y, yaw, the wheels' slip
while cutting, the lane's offset and direction against the plan's, the courses' direction against
the plan's).

A line is known only as well as it was cut: strip after strip may lie a little askew of the one
before. So each lane has an offset and a direction of its own, known from the lane whose cutting has
left its edge, and the receiver's Doppler courses, which no strip turns, tell them from the
machine's. A walked boundary is some degrees off: what the courses differ by along the outer edge is
the plan's, and stays.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import Vehicle
from host.estimate.kalman import Filter
from host.estimate.measurements import begin, course, end, line
from host.estimate.odometry import Motion
from host.estimate.place import Place
from host.estimate.states import LANE, LANE_YAW, SLIP, STATES, YAW, X, Y
from host.route.plan import Side

START_SIGMA = (0.1, 0.1, math.radians(2))
LANE_SIGMA = (0.06, math.radians(0.5))
"""Of the outer edge's line against the plan's, m and rad."""
RING_SIGMA = (0.02, math.radians(0.2))
RING_ENDS_M = 0.1
"""What a strip adds to that, m and rad; its direction the more, the shorter it is: both ends err by
so much."""
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


class _Lane(NamedTuple):
    """What was found of a side's lane: (2,) its offset at the side's beginning, m left of the
    plan's, and its direction, rad; (2, 2) their covariance."""

    side: Side
    x: NDArray[np.float64]
    p: NDArray[np.float64]


class Position(Filter):
    """Unknown until `place`."""

    def __init__(self, vehicle: Vehicle) -> None:
        super().__init__(np.zeros(STATES), np.full((STATES, STATES), math.inf))
        self._vehicle = vehicle
        self._past: Motion | None = None
        self._lanes: list[_Lane] = []
        self._lane_of: Side | None = None
        self.known = False

    @property
    def pose(self) -> tuple[float, float, float]:
        """(x, y, yaw) of the rear axle, m and rad."""
        return float(self._x[X]), float(self._x[Y]), float(self._x[YAW])

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(3, 3) of the pose, m and rad."""
        return self._p[: YAW + 1, : YAW + 1].copy()

    def covariance_of(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2, 2), m², of points (n, 2) of the machine, m in the field frame: its direction's
        uncertainty moves them the more, the farther from the rear axle they are."""
        x, y, _ = self.pose
        by_pose = np.zeros((len(points), 2, 3))
        by_pose[:, 0, X] = by_pose[:, 1, Y] = 1.0
        by_pose[:, 0, YAW], by_pose[:, 1, YAW] = y - points[:, 1], points[:, 0] - x
        pose = self._p[: YAW + 1, : YAW + 1]
        found: NDArray[np.float64] = by_pose @ pose @ by_pose.transpose(0, 2, 1)
        return found

    def place(self, side: Side, along_m: float, offset_m: float, heading_rad: float) -> None:
        """On a side's lane: the blade along_m past where vision sees the side's beginning, the rear
        axle offset_m left of the lane, the vehicle heading_rad left of its direction."""
        c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
        back = along_m + side.begin_seen_m - self._vehicle.blade_x_m
        inside = self._vehicle.inset_m - side.shift_m + offset_m
        self._x = np.array(
            [
                side.x_m + c * back - s * inside,
                side.y_m + s * back + c * inside,
                side.heading_rad + heading_rad,
                *np.zeros(STATES - SLIP),
            ]
        )
        sigmas = (*START_SIGMA, SLIP_SIGMA, *LANE_SIGMA, PLAN_SIGMA_RAD)
        self._p = np.diag([sigma**2 for sigma in sigmas])
        self.known = True
        self._lane_of = side

    def begin(self, side: Side) -> None:
        """From here on it is this side's lane: what is known of the last is kept for the one whose
        edge it has left."""
        past = self._lane_of
        if past is not None:
            done = _Lane(past, self._x[LANE].copy(), self._p[LANE, LANE].copy())
            kept = [lane for lane in self._lanes if not self._left_by(past, lane)]
            self._lanes = [*kept, done]
        self._lane_of = side
        beside = [known for known in self._lanes if self._left_by(side, known)]
        lane, covariance = np.zeros(2), np.diag(LANE_SIGMA) ** 2
        if beside:
            last = beside[-1]
            moved = np.array([[1.0, side.line[0] - last.side.line[0]], [0.0, 1.0]])
            askew = math.hypot(RING_SIGMA[1], RING_ENDS_M / max(1.0, last.side.length_m))
            grown = np.diag([RING_SIGMA[0] ** 2, askew**2])
            lane, covariance = moved @ last.x, moved @ last.p @ moved.T + grown
        self._x[LANE] = lane
        self._p[LANE, :] = self._p[:, LANE] = 0.0
        self._p[LANE, LANE] = covariance

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
        jacobian = np.eye(STATES)
        jacobian[:YAW, YAW] = -step * s, step * c
        jacobian[:YAW, SLIP] = -lost * c, -lost * s
        # Neighbouring steps err alike: their errors grow along a metre as one.
        run = abs(step)
        turned = np.array([[c, -s], [s, c]])
        noise = np.zeros((STATES, STATES))
        noise[:YAW, :YAW] = turned @ np.diag(np.square(STEP_SIGMA) * run) @ turned.T
        noise[YAW, YAW] = YAW_SIGMA_PER_M**2 * run + YAW_SIGMA_SHARE**2 * abs(turn)
        self._p = jacobian @ self._p @ jacobian.T + noise

    def at(self, side: Side) -> Place:
        """The place against a side."""
        return Place(self._x, side, self._vehicle.blade_x_m, self._vehicle.inset_m)

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
        across, turned = place.beside(along), np.zeros(STATES)
        turned[[YAW, LANE_YAW]] = 1.0, -1.0
        sigmas = (math.sqrt(across @ self._p @ across), math.sqrt(turned @ self._p @ turned))
        return offset, heading, *sigmas

    def _on_lane(self) -> Place:
        assert self._lane_of is not None
        return self.at(self._lane_of)

    def follow(self, blade_offset_m: float, sigma_m: float) -> None:
        """The lane filter's place of the blade's middle left of the present lane."""
        self.fuse(line.line(self._on_lane(), blade_offset_m, sigma_m))

    def course(self, left_rad: float, speed_mps: float) -> None:
        """The receiver's course lies left_rad left of the yaw, at that speed over ground."""
        self.fuse(course.course(self._x, left_rad, speed_mps))

    def at_begin(self, side: Side, ago_m: float) -> None:
        """The blade met the beginning of a side's crop, and has travelled ago_m since."""
        self.fuse(begin.begin(self.at(side), self._p, ago_m))

    def at_end(self, side: Side, ago_m: float, drift_m: float = 0.0, doubt_m: float = 0.0) -> None:
        """The blade met the end of a side, and has travelled ago_m since, give or take doubt_m;
        drift_m is what a wrong scale of the distances may have done along it."""
        along = np.zeros((1, STATES))
        along[0, :YAW] = math.cos(side.heading_rad), math.sin(side.heading_rad)
        self._p = self._p + along.T @ along * drift_m**2
        self.fuse(end.end(self.at(side), self._p, ago_m, doubt_m))
