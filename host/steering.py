"""Steering laws: from the vehicle's place against the lane to a steering angle.

All take the lateral offset and heading error of host.lane.Lane (left positive) and return radians,
left positive, within the limit.
"""

from __future__ import annotations

import math

from host.vehicle import Vehicle

PROPORTIONAL_GAIN_1PM = 1.6
REVERSE_GAINS = (3.0, 3.5)
"""Curvature per metre of offset and per radian of heading."""


def _limit(curvature: float, vehicle: Vehicle) -> float:
    limit = math.radians(vehicle.steer_limit_deg)
    return max(-limit, min(limit, math.atan(vehicle.wheelbase_m * curvature)))


def proportional(blade_offset_m: float, vehicle: Vehicle) -> float:
    """The paper's law: the turn is proportional to the deviation of the edge at the blade's line.

    With the measuring point a = blade_x ahead of the rear axle the loop has
    w^2 = v^2 k / L and damping a/2 sqrt(k / L): no heading is needed for stability."""
    return _limit(-PROPORTIONAL_GAIN_1PM * blade_offset_m, vehicle)


def forward(offset_m: float, heading_rad: float, vehicle: Vehicle) -> float:
    """State feedback on the offset at the rear axle and the heading, driving forward, with the
    vehicle's frequency and damping.

    In the distance s: offset' = heading, heading' = curvature."""
    k_offset = vehicle.follow_frequency_1pm**2
    k_heading = 2 * vehicle.follow_damping * vehicle.follow_frequency_1pm
    return _limit(-k_offset * offset_m - k_heading * heading_rad, vehicle)


def reverse(offset_m: float, heading_rad: float, vehicle: Vehicle) -> float:
    """The same in reverse, where s counts travelled metres: offset' = -heading,
    heading' = -curvature."""
    k_offset, k_heading = REVERSE_GAINS
    return _limit(-k_offset * offset_m + k_heading * heading_rad, vehicle)
