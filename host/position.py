"""Where the machine is in the field frame, and how surely: dead reckoning anchored to the plan.

A phone's position is good to some 2.5 m, slowly wandering: no use beside a gap of 2 m. But the
operator puts the blade on a known corner, every side lies along a known line, and every end of a
side is a known place: those anchor an extended Kalman filter over (x, y, yaw, the
wheels' slip while cutting).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from host.odometry import Motion
from host.plan import Side
from host.vehicle import Vehicle

START_SIGMA = (0.1, 0.1, math.radians(2))
LANE_SIGMA_M = 0.06
RING_SIGMA_M = 0.02
"""Growth of the lane's uncertainty with every side cut beside it."""
LANE_SIGMA_RAD = math.radians(2)
BEGIN_SIGMA_M = 0.25
END_SIGMA_M = 0.15
END_EARLY_M = 0.1
"""The last crop before the blade is too shallow a strip to look like crop: vision loses it 0.14 m
before its end from the mast, at 0.05 m from the low camera (docs/vision.md)."""
SLANT_SHARE = 0.7
"""Standard deviation of where in a slanting border vision sees crop, as a share of how far in."""
SLOPE_MOST = 2.2
"""Of a slanting border, along the side for each metre across it: a corner of 155°."""
STEP_SIGMA = 0.02
"""Error of a step as a share of it, along and across."""
SLIP_SIGMA = 0.015
"""Of the share of their way that the driven wheels lose while they push the blade through crop,
before anything is learned of it."""
DOUBTED_SIGMAS = 2.0
"""An end or beginning that is seen farther from where it is expected counts the less, the farther:
weeds in the gap look like crop, and dust hides it."""
YAW_SIGMA_PER_M = math.radians(0.3)
YAW_SIGMA_SHARE = 0.05


class Position:
    """Unknown until `place`."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._x: NDArray[np.float64] = np.zeros(4)
        self._p: NDArray[np.float64] = np.full((4, 4), math.inf)
        self._past: Motion | None = None
        self.known = False

    @property
    def pose(self) -> tuple[float, float, float]:
        """(x, y, yaw) of the rear axle, m and rad."""
        return float(self._x[0]), float(self._x[1]), float(self._x[2])

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(2, 2) of the place, m²."""
        return self._p[:2, :2]

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
                0.0,
            ]
        )
        self._p = np.diag([sigma**2 for sigma in (*START_SIGMA, SLIP_SIGMA)])
        self.known = True

    def predict(self, motion: Motion, *, cutting: bool) -> None:
        """Moves with the vehicle."""
        past, self._past = self._past, motion
        if past is None or not self.known:
            return
        step = motion.distance_m - past.distance_m
        turn = motion.yaw_rad - past.yaw_rad
        if step == 0.0 and turn == 0.0:
            return
        middle = self._x[2] + turn / 2
        c, s = math.cos(middle), math.sin(middle)
        lost = step if cutting else 0.0
        step -= lost * float(self._x[3])
        self._x = self._x + np.array([step * c, step * s, turn, 0.0])
        jacobian = np.eye(4)
        jacobian[:2, 2] = -step * s, step * c
        jacobian[:2, 3] = -lost * c, -lost * s
        # Neighbouring steps err alike: their errors grow along a metre as one.
        run = abs(step)
        place = STEP_SIGMA**2 * run
        yaw = YAW_SIGMA_PER_M**2 * run + YAW_SIGMA_SHARE**2 * abs(turn)
        self._p = jacobian @ self._p @ jacobian.T + np.diag([place, place, yaw, 0.0])

    def along(self, side: Side) -> float:
        """How far the blade's line is past a side's beginning."""
        c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
        dx, dy = self._x[0] - side.x_m, self._x[1] - side.y_m
        return float(dx * c + dy * s) + self._vehicle.blade_x_m

    def across(self, side: Side) -> float:
        """How far the rear axle is left of a side's lane."""
        c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
        dx, dy = self._x[0] - side.x_m, self._x[1] - side.y_m
        return float(dy * c - dx * s) - self._vehicle.inset_m + side.shift_m

    def across_sigma_m(self, side: Side) -> float:
        """Standard deviation of the place across a side's lane."""
        across = np.array([-math.sin(side.heading_rad), math.cos(side.heading_rad)])
        return math.sqrt(across @ self.covariance @ across)

    def on_lane(
        self,
        side: Side,
        index: int,
        offset_m: float,
        heading_rad: float,
        offset_sigma_m: float = 0.0,
    ) -> None:
        """The lane filter's place, known to offset_sigma_m, against the lane of side number
        `index`. A lane that goes by dead reckoning alone is no measurement of its own."""
        s, c = math.sin(side.heading_rad), math.cos(side.heading_rad)
        across = self.across(side)
        turn = math.remainder(side.heading_rad + heading_rad - self._x[2], math.tau)
        sigma = math.hypot(LANE_SIGMA_M + RING_SIGMA_M * index / 4, offset_sigma_m)
        self._correct(np.array([[-s, c, 0.0, 0.0]]), offset_m - across, sigma)
        self._correct(np.array([[0.0, 0.0, 1.0, 0.0]]), turn, LANE_SIGMA_RAD)

    def at_begin(self, side: Side, ago_m: float) -> None:
        """The blade met the beginning of a side's crop, and has travelled ago_m since."""
        sigma = math.hypot(BEGIN_SIGMA_M, SLANT_SHARE * side.begin_seen_m)
        slope = min(SLOPE_MOST, side.edge_begin_m / side.width_m)
        self._along(side, side.begin_seen_m + ago_m, sigma, slope)

    def at_end(self, side: Side, ago_m: float, drift_m: float = 0.0) -> None:
        """The blade met the end of a side, and has travelled ago_m since; drift_m is what a wrong
        scale of the distances may have done along it."""
        along = np.array([[math.cos(side.heading_rad), math.sin(side.heading_rad), 0.0, 0.0]])
        self._p = self._p + along.T @ along * drift_m**2
        sigma = math.hypot(END_SIGMA_M, SLANT_SHARE * side.end_seen_m)
        seen = side.length_m - side.end_seen_m - END_EARLY_M
        slope = min(SLOPE_MOST, side.edge_end_m / side.width_m)
        self._along(side, seen + ago_m, sigma, -slope)

    def _along(self, side: Side, blade_m: float, sigma_m: float, slope: float) -> None:
        """The blade's line stands blade_m past the side's beginning, if it is on the lane. Of a
        border that slants a machine left of the lane meets the beginning earlier by `slope` of how
        far left it is."""
        c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
        h = np.array([[c - slope * s, s + slope * c, 0.0, 0.0]])
        innovation = blade_m - self.along(side) - slope * self.across(side)
        expected = math.sqrt((h @ self._p @ h.T).item() + sigma_m**2)
        doubt = max(1.0, abs(innovation) / (DOUBTED_SIGMAS * expected))
        self._correct(h, innovation, sigma_m * doubt**2)

    def _correct(self, h: NDArray[np.float64], innovation: float, sigma: float) -> None:
        variance = (h @ self._p @ h.T).item() + sigma**2
        gain = (self._p @ h.T) / variance
        self._x = self._x + gain[:, 0] * innovation
        keep = np.eye(4) - gain @ h
        self._p = keep @ self._p @ keep.T + gain @ gain.T * sigma**2
