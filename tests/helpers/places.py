"""What a machine may do or be told that changes where it believes to stand, and how surely."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from host.core.vehicle import Vehicle
from host.estimate.kalman import Measurement
from host.estimate.lane import Lane
from host.estimate.measurements import edge
from host.estimate.odometry import Motion
from host.estimate.position import Position


def sure_of(position: Position, *sigmas: float) -> None:
    """That it stands where it believes, with these standard deviations of x, y and yaw (m and rad)
    at most."""
    h = np.eye(3, len(position.x))
    position.fuse(Measurement("sure of", h, np.zeros(3), np.square(sigmas)))


def driven(position: Position, x: float, y: float, yaw: float, begun: Motion) -> Motion:
    """Dead reckoning from `begun` on: turned on the spot, straight there, turned on the spot."""
    from_x, from_y, from_yaw = position.pose
    way, way_rad = math.hypot(x - from_x, y - from_y), math.atan2(y - from_y, x - from_x)
    there = begun.yaw_rad + way_rad - from_yaw
    motion = begun
    for run, turned in ((0.0, there), (way, there), (way, begun.yaw_rad + yaw - from_yaw)):
        motion = replace(motion, distance_m=begun.distance_m + run, yaw_rad=turned)
        position.predict(motion, cutting=False)
    return motion


def spun(position: Position, sigma_rad: float, share: float, begun: Motion) -> None:
    """On the spot, to one side and back, until its direction is so much less sure. share: of a turn
    by which dead reckoning errs."""
    position.predict(
        replace(begun, yaw_rad=begun.yaw_rad + sigma_rad / share / math.sqrt(2)), cutting=False
    )
    position.predict(begun, cutting=False)


def wandered(position: Position, run_m: float, begun: Motion) -> None:
    """Straight on and back."""
    position.predict(replace(begun, distance_m=begun.distance_m + run_m), cutting=False)
    position.predict(begun, cutting=False)


def followed(position: Position, blade_offset_m: float, sigma_m: float) -> None:
    """The blade's middle is seen so far left of the present lane, give or take sigma_m, whatever
    was expected."""
    at = edge.edge(position.on_lane(), -blade_offset_m, math.nan, 1.0, (0.0, 0.0), 0.0)
    variances = np.array([0.03**2 + sigma_m**2])
    position.see_edge(replace(at, variances=variances, gate=math.inf), learn=False)


class OnLane:
    """A machine beside an edge of no plan."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.position = Position(vehicle)
        self.lane = Lane(self.position, vehicle.blade_x_m)

    def predict(self, motion: Motion) -> None:
        """It moves on, cutting nothing."""
        self.position.predict(motion, cutting=False)
