"""Steering laws: from the vehicle's place against the lane to a steering angle.

Offset and heading are those of host.estimate.lane.Lane (left positive); angles are radians, left
positive, within the limit. Gains and margins: docs/understand/navigation.md.
"""

from __future__ import annotations

import math

from host.core.vehicle import Vehicle
from host.estimate.lane import Lane
from host.estimate.odometry import Motion

PROPORTIONAL_GAIN_1PM = 1.6
REVERSE_GAINS = (3.0, 3.5)
"""Curvature per metre of offset and per radian of heading."""
ASIDE_M = 0.2
"""Of an offset, the most that is steered for backward: 10 degrees against the lane."""


def _limit(curvature: float, vehicle: Vehicle) -> float:
    limit = math.radians(vehicle.steer_limit_deg)
    return max(-limit, min(limit, math.atan(vehicle.wheelbase_m * curvature)))


def proportional(blade_offset_m: float, vehicle: Vehicle) -> float:
    """The paper's law: the turn is proportional to the deviation of the edge at the blade's line.

    With the measuring point a = blade_x ahead of the rear axle the loop has
    w^2 = v^2 k / L and damping a/2 sqrt(k / L): no heading is needed for stability."""
    return _limit(-PROPORTIONAL_GAIN_1PM * blade_offset_m, vehicle)


def state_gains(speed_mps: float, vehicle: Vehicle) -> tuple[float, float, float]:
    """Curvature per metre of offset, per radian of heading and per unit of curvature.

    offset' = v heading, heading' = v curvature, curvature' = (command - curvature) / T with the
    steering's lag T. The gains put two poles at v times the frequency l with damping z, the third
    at -1/T, where the steering's own is: nothing is asked of the motor that it does not do anyway.
    """
    frequency, damping = vehicle.follow_frequency_1pm, vehicle.follow_damping
    lag_m = abs(speed_mps) * vehicle.steer_lag_s
    return (
        frequency**2,
        2 * damping * frequency + frequency**2 * lag_m,
        2 * damping * frequency * lag_m,
    )


def reach_m(vehicle: Vehicle) -> float:
    """How far beside a lane, at most, a machine may be that the law leads to it. From farther away
    what is asked for the offset outweighs the heading even square to the lane: it turns on, in
    circles."""
    k_offset, k_heading, _ = state_gains(0.0, vehicle)
    return k_heading * math.pi / 2 / k_offset


def state(
    offset_m: float, heading_rad: float, curvature_1pm: float, speed_mps: float, vehicle: Vehicle
) -> float:
    """State feedback on the offset at the rear axle, the heading and the curvature that is being
    driven, for the speed that is being driven."""
    k_offset, k_heading, k_curvature = state_gains(speed_mps, vehicle)
    feedback = k_offset * offset_m + k_heading * heading_rad + k_curvature * curvature_1pm
    return _limit(-feedback, vehicle)


def follow(lane: Lane, motion: Motion, vehicle: Vehicle) -> float:
    """The law that the vehicle's file names, driving forward. Past a bend the blade is to go on
    along the lane at once: the rear axle is drawn after it."""
    if vehicle.steering_law == "proportional":
        return proportional(lane.off_m, vehicle)
    to_turn, blade_m = lane.rounding_rad, vehicle.blade_x_m
    aside_m, bend_1pm = blade_m * math.sin(to_turn), math.sin(to_turn) / blade_m
    offset, heading = lane.driven_off_m - aside_m, lane.heading_rad + to_turn
    feedback = state(offset, heading, motion.curvature_1pm - bend_1pm, motion.speed_mps, vehicle)
    return _limit(bend_1pm + math.tan(feedback) / vehicle.wheelbase_m, vehicle)


def back(lane: Lane, vehicle: Vehicle) -> float:
    """Driving backward along the lane, no more askew than a camera sees the edge from."""
    offset, heading = lane.backwards
    aside = max(-ASIDE_M, min(ASIDE_M, offset - lane.aim_m - lane.clear_m))
    return reverse(aside, heading, vehicle)


def reverse(offset_m: float, heading_rad: float, vehicle: Vehicle) -> float:
    """State feedback in reverse, where s counts travelled metres: offset' = -heading,
    heading' = -curvature."""
    k_offset, k_heading = REVERSE_GAINS
    return _limit(-k_offset * offset_m + k_heading * heading_rad, vehicle)
