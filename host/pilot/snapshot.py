"""What the pilot is doing and where it believes to be, at one moment: for the record and the
operator."""

from __future__ import annotations

from dataclasses import dataclass

from host.pilot.pilot import Pilot


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Metres and radians; offset and heading of the lane, the others of dead reckoning."""

    phase: str
    reason: str
    turns: int
    offset_m: float
    heading_rad: float
    distance_m: float
    x_m: float
    y_m: float
    yaw_rad: float


def snapshot(pilot: Pilot) -> Snapshot:
    """Of a pilot now."""
    lane, motion = pilot.lane, pilot.motion
    return Snapshot(
        phase=pilot.phase.value,
        reason=pilot.reason,
        turns=pilot.turns,
        offset_m=lane.offset_m,
        heading_rad=lane.heading_rad,
        distance_m=motion.distance_m,
        x_m=motion.x_m,
        y_m=motion.y_m,
        yaw_rad=motion.yaw_rad,
    )
