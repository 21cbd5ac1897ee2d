"""The lane: a straight line that the rear axle's middle should follow, beside the crop's edge.

An extended Kalman filter over (lateral offset, heading, steering's bias) joins dead reckoning with
what vision sees of the edge, so that a missed picture, a turn or a mount that cannot see the
heading (the paper's low camera) all are the same case: prediction with fewer corrections.
"""

from __future__ import annotations

import math

import numpy as np

from host.estimate.kalman import Filter, Measurement
from host.estimate.measurements import edge, heading
from host.estimate.odometry import Motion
from host.estimate.states import BIAS, HEADING, LANE_STATES, OFFSET

SLIP_PER_M = 0.02
"""Lateral drift per metre travelled, standard deviation."""
YAW_PER_RAD = 0.08
"""Yaw error per radian turned (speed and pot errors), standard deviation."""
YAW_PER_M = math.radians(0.5)
GYRO_PER_ROOT_S = math.radians(0.15)
GYRO_PER_RAD = 0.01
"""Yaw error by the gyroscope: its offset, and its scale."""
BOUND_SIGMA_M = 0.15
"""Of crop that goes on beside the blade: weeds stand on from it too, for a step or two."""
BIAS_SIGMA_1PM = 0.006
"""Of the curvature that the pot does not show (its calibration, a side slope), at the start."""
BIAS_PER_M = 0.0005
"""Its growth per square root of a metre."""
DOUBTED = np.array([1.03, 1.03, 1.0])
"""Growth of the standard deviations with each contradiction (the bias has no part in
it). A lane that a turn has left askew yields within half a metre; one that many pictures agreed on
outlasts a patch of weeds or thin crop, whose border looks like the edge."""


class Lane(Filter):
    """Vehicle pose against the lane. offset_m: rear axle left of the lane, positive; heading_rad:
    vehicle heading minus lane direction. `blade_x_m` is where vision measures the edge."""

    def __init__(self, blade_x_m: float) -> None:
        sigmas = (0.1, math.radians(5), BIAS_SIGMA_1PM)
        super().__init__(np.zeros(LANE_STATES), np.diag(np.square(sigmas)))
        self._blade_x = blade_x_m
        self._past: Motion | None = None
        self.contradicted = False
        """Whether the last measurement was refused."""

    @property
    def offset_m(self) -> float:
        """Rear axle left of the lane."""
        return float(self._x[OFFSET])

    @property
    def heading_rad(self) -> float:
        """Vehicle heading minus lane direction."""
        return float(self._x[HEADING])

    @property
    def offset_sigma_m(self) -> float:
        """Standard deviation of the offset at the blade's line: the filter's, and what pictures
        one after the other err alike, which no number of them takes away."""
        h = np.array([1.0, self._blade_x, 0.0])
        return math.hypot(math.sqrt(h @ self._p @ h), edge.LASTING_SIGMA_M)

    @property
    def blade_offset_m(self) -> float:
        """The blade's middle left of the lane, positive: minus the edge offset that vision sees."""
        return self.offset_m + self._blade_x * math.sin(self.heading_rad)

    def place(
        self, offset_m: float, heading_rad: float, offset_sd: float, heading_sd: float
    ) -> None:
        """Starts over from a pose that is known by other means; the bias stays as it is known."""
        self.contradicted = False
        self._x = np.array([offset_m, heading_rad, self._x[BIAS]])
        self._p = np.diag([offset_sd**2, heading_sd**2, self._p[BIAS, BIAS]])

    def bend(self, turn_rad: float, behind_m: float) -> None:
        """The lane bends turn_rad to the left, behind_m before the rear axle: from here on the
        filter speaks of the line beyond."""
        offset, heading = self.offset_m, self.heading_rad
        c, s = math.cos(turn_rad), math.sin(turn_rad)
        self._x[OFFSET], self._x[HEADING] = behind_m * s + offset * c, heading - turn_rad

    def take_bias(self) -> float:
        """What is known of the bias since the last call, 1/m; whoever reckons the motion corrects
        it from here on."""
        bias, self._x[BIAS] = float(self._x[BIAS]), 0.0
        return bias

    def predict(self, motion: Motion) -> None:
        """Moves with the vehicle."""
        past, self._past = self._past, motion
        if past is None:
            return
        step = motion.distance_m - past.distance_m
        turn = motion.yaw_rad - past.yaw_rad
        if not motion.by_gyro:
            turn += float(self._x[BIAS]) * step
        middle = self._x[HEADING] + turn / 2
        self._x = self._x + np.array([step * math.sin(middle), turn, 0.0])
        along = step * math.cos(middle)
        jacobian = np.array([[1.0, along, along * step / 2], [0.0, 1.0, step], [0.0, 0.0, 1.0]])
        run = abs(step)
        yaw = YAW_PER_M**2 * run + (YAW_PER_RAD * turn) ** 2
        if motion.by_gyro:
            jacobian[:2, BIAS] = 0.0
            yaw = GYRO_PER_ROOT_S**2 * (motion.stamp - past.stamp) + (GYRO_PER_RAD * turn) ** 2
        noise = np.diag([SLIP_PER_M**2 * run, yaw, BIAS_PER_M**2 * run])
        self._p = jacobian @ self._p @ jacobian.T + noise

    def correct_heading(self, heading_rad: float, sigma_rad: float, *, learn: bool = True) -> None:
        """What dead reckoning in the field frame says of the heading. `learn` as in `correct`."""
        seen = heading.heading(self._x, heading_rad, sigma_rad)
        self.fuse(seen, frozen=None if learn else BIAS)

    def lies_right(self, edge_offset_most_m: float, since: tuple[float, float]) -> bool:
        """Crop was seen to go on beside the blade: the edge lies no further left than this, m. A
        lane that has it there moves aside, and does not turn: how the edge runs is seen once the
        machine is beside it. Returns whether it did. `since` as in `correct`."""
        seen = edge.edge(self._x, self._blade_x, edge_offset_most_m, math.nan, 1.0, since, 0.0)
        if seen.innovation[0] <= 0.0:
            return False
        wide = seen.variances + BOUND_SIGMA_M**2
        bound = Measurement("bound", seen.h, seen.innovation, wide)
        self.yield_to(bound, frozen=slice(HEADING, BIAS + 1))
        return True

    def correct(
        self,
        edge_offset_m: float,
        edge_heading_rad: float,
        confidence: float,
        since: tuple[float, float],
        *,
        ahead_m: float = 0.0,
        learn: bool = True,
    ) -> bool:
        """Takes vision's measurement of the edge (NaN heading: not seen), made ahead_m before the
        blade's line.

        `since` is (distance travelled, yaw turned) from the shutter to now. With `learn` the bias
        is estimated too; not after a turn, whose errors it would take upon itself. Returns False
        where the measurement contradicts the prediction beyond the gate; it is then not used.
        """
        seen = edge.edge(
            self._x, self._blade_x, edge_offset_m, edge_heading_rad, confidence, since, ahead_m
        )
        self.contradicted = not self.fuse(seen, frozen=None if learn else BIAS)
        if self.contradicted:
            self._p *= np.outer(DOUBTED, DOUBTED)
        return not self.contradicted
