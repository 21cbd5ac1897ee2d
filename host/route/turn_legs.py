"""The turn at a field's end as a list of legs that dead reckoning can drive.

Frames: the vehicle's own at the moment the blade's line met the end of the crop (origin below the
rear axle, x along the old side, y left). A forward arc alone (paper, II) leaves the corner uncut,
ring after ring; the three-point turn swings left forward, then reverses on the right lock, and
ends behind the new side's beginning (docs/understand/navigation.md, "How does it turn?").
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from host.core.frames import Pose2
from host.core.vehicle import Vehicle
from host.field.areas import GAP_MARGIN_M

LOCK_MARGIN_DEG = 2.0
"""Arcs are driven this far inside the steering limit, so that the PID has room."""
ORIGIN = Pose2(0.0, 0.0, 0.0)
STEP_M = 0.1
"""Between poses of a turn that is driven on paper."""
GENTLE_SHUTTLE = 1.35
"""A shuttle's S, where there is room, over its shortest length."""
SHUTTLE_CLEAR_M = 0.7
"""Room left behind the machine when it backs out to shift to the next strip."""
RUN_IN_M = 0.1
"""From the blade to the crop of the strip that a shuttle leads to."""
LEAST_SINE = 0.05
"""Of a turn: 3 degrees from straight on, or from straight back."""
SIDESTEP_M = 0.15
"""A shift that following the new lane in reverse makes of itself."""


class Goal(enum.Enum):
    """Which coordinate of the turn's frame ends a leg."""

    X = "x"
    """Along the old side, rear axle."""
    HEADING = "heading"
    """Radians from the old side's direction."""
    ALONG = "along"
    """Along the new lane, rear axle."""
    WAY = "way"
    """Driven since the leg began."""


class Follow(enum.Enum):
    """What a leg steers by instead of a held angle."""

    NOTHING = "nothing"
    OLD_LANE = "old lane"
    NEW_LANE = "new lane"
    """Corrected by vision as soon as the new side begins ahead of the blade."""


@dataclass(frozen=True, slots=True)
class Leg:
    """Steering held at steer_rad and driven until the goal's coordinate reaches `value`."""

    steer_rad: float
    reverse: bool
    goal: Goal
    value: float
    follow: Follow = Follow.NOTHING

    @property
    def rises(self) -> bool:
        """Whether the goal's coordinate grows on the way."""
        if self.goal is Goal.HEADING:
            return (self.steer_rad > 0) is not self.reverse
        return self.goal is Goal.WAY or not self.reverse


@dataclass(frozen=True, slots=True)
class Turn:
    """A planned turn: legs, then the new lane in the frame of the plan.

    The lane passes through (lane_x_m, lane_y_m) in direction lane_rad; crop begins at along_m
    along it, measured for the blade's line."""

    legs: tuple[Leg, ...]
    lane_x_m: float
    lane_y_m: float
    lane_rad: float
    crop_begins_m: float
    pressed_m: float = 0.0
    """How much of the new side's beginning wheels press down."""

    def offset(self, x: float, y: float) -> float:
        """Signed distance of a point left of the lane."""
        return self._lane.seen_from(x, y)[1]

    def along(self, x: float, y: float) -> float:
        """Distance of a point along the lane from its origin."""
        return self._lane.seen_from(x, y)[0]

    @property
    def _lane(self) -> Pose2:
        return Pose2(self.lane_x_m, self.lane_y_m, self.lane_rad)


def turning_radius(vehicle: Vehicle) -> tuple[float, float]:
    """(radius of the rear axle's middle in m, steering angle in rad) used for arcs."""
    angle = math.radians(vehicle.steer_limit_deg - LOCK_MARGIN_DEG)
    return vehicle.wheelbase_m / math.tan(angle), angle


class NewLane(NamedTuple):
    """The lane that a turn leads to, in its frame: the point beside the crop's beginning, and from
    there along the lane to the crop."""

    x_m: float
    y_m: float
    begins_m: float


def lane_beside(vehicle: Vehicle, turn_rad: float) -> NewLane:
    """Without a plan: the lane that follows the crop's end line, which crosses the old side's
    centre at the blade, at angle turn_rad. It lies half a blade less the overlap inside. Crop
    begins where the blade's first end leaves the swath just cut, whose left border is y = half a
    blade."""
    half = vehicle.blade_width_m / 2
    x = vehicle.blade_x_m - vehicle.inset_m * math.sin(turn_rad)
    y = vehicle.inset_m * math.cos(turn_rad)
    ends = [
        (half - y - lateral * math.cos(turn_rad)) / math.sin(turn_rad) for lateral in (-half, half)
    ]
    return NewLane(x, y, min(ends))


def arc(vehicle: Vehicle, turn_rad: float, lane: NewLane) -> Turn:
    """The paper's turn: one forward arc on the left lock, ending on the lane."""
    radius, lock = turning_radius(vehicle)
    x, y, begins = lane
    # The arc's end (start + R sin t, R - R cos t) must lie on the lane.
    end_y = radius - radius * math.cos(turn_rad)
    start = x + (end_y - y) * _cot(turn_rad) - radius * math.sin(turn_rad)
    legs = (Leg(0.0, start < 0, Goal.X, start), Leg(lock, False, Goal.HEADING, turn_rad))
    return Turn(legs, x, y, turn_rad, begins)


def _cot(turn_rad: float) -> float:
    """Cotangent, of a lane that crosses the old one: of one that hardly does, the geofence ends the
    way to where they meet."""
    sine = math.sin(turn_rad)
    return math.cos(turn_rad) / math.copysign(max(abs(sine), LEAST_SINE), sine)


def three_point(
    vehicle: Vehicle,
    turn_rad: float,
    lane: NewLane,
    *,
    swing: float = 0.55,
    run_in_m: float = 0.45,
) -> Turn:
    """Forward on the left lock for `swing` of the turn, back on the right lock for the rest, then
    straight back until the blade stands run_in_m before the crop."""
    radius, lock = turning_radius(vehicle)
    first = swing * turn_rad
    x, y, begins = lane
    end_x = 2 * radius * math.sin(first) - radius * math.sin(turn_rad)
    end_y = radius - 2 * radius * math.cos(first) + radius * math.cos(turn_rad)
    start = x + (end_y - y) * _cot(turn_rad) - end_x
    legs = (
        Leg(0.0, start < 0, Goal.X, start),
        Leg(lock, False, Goal.HEADING, first),
        Leg(-lock, True, Goal.HEADING, turn_rad),
        Leg(0.0, True, Goal.ALONG, begins - run_in_m - vehicle.blade_x_m, Follow.NEW_LANE),
    )
    return Turn(legs, x, y, turn_rad, begins)


def shuttle_length(vehicle: Vehicle, shift_m: float, room_m: float) -> float:
    """The way back that a shift to the left takes, two arcs: as gentle as the room allows."""
    radius, _ = turning_radius(vehicle)
    least = math.sqrt(max(0.0, 4 * radius * shift_m - shift_m**2))
    return max(least, min(room_m, GENTLE_SHUTTLE * least))


def shuttle_room_m(vehicle: Vehicle, back_m: float, gap_m: float | None) -> float:
    """What the rear axle may take behind the crop's beginning for a shuttle's S: back_m to the
    boundary and the gap beyond it, where one is known."""
    behind = vehicle.rear_overhang_m + GAP_MARGIN_M + SHUTTLE_CLEAR_M
    return back_m + (gap_m or 0.0) - behind


def shuttle(
    vehicle: Vehicle,
    begins_m: float,
    shift_m: float,
    room_m: float,
    *,
    early_m: float = 0.0,
) -> Turn:
    """Back along the swath and shift_m to the left, to take the next strip of the same edge, whose
    crop begins begins_m ahead of where the blade stands (so negative). Wheels stay off the crop:
    the shift, an S of two arcs, begins when the rear axle has left it, and should end within room_m
    behind it. Where it finds less, it begins early_m sooner, and the wheels press down the corner
    of the strip that comes next."""
    begins = vehicle.blade_x_m + begins_m
    straight = Leg(0.0, True, Goal.ALONG, begins + early_m, Follow.OLD_LANE)
    line_up = Leg(0.0, True, Goal.ALONG, begins - RUN_IN_M - vehicle.blade_x_m, Follow.NEW_LANE)
    if shift_m <= SIDESTEP_M:
        return Turn((straight, line_up), 0.0, shift_m, 0.0, begins)
    length = shuttle_length(vehicle, shift_m, room_m)
    radius = (length**2 + shift_m**2) / (4 * shift_m)
    bend = math.acos(max(-1.0, 1 - shift_m / (2 * radius)))
    steer = math.atan(vehicle.wheelbase_m / radius)
    legs = (
        straight,
        Leg(steer, True, Goal.HEADING, -bend),
        Leg(-steer, True, Goal.HEADING, 0.0),
        line_up,
    )
    return Turn(legs, 0.0, shift_m, 0.0, begins, early_m)


class Driven(NamedTuple):
    """A leg driven without error: its way, and poses along it in the turn's frame, the last at its
    end."""

    leg: Leg
    length_m: float
    poses: list[Pose2]


def driven(
    vehicle: Vehicle, turn: Turn, step_m: float = STEP_M, at: Pose2 = ORIGIN
) -> Iterator[Driven]:
    """The legs one after the other, from `at` on, poses at most step_m apart. What a leg that
    follows the new lane still has to shift sideways is spread over its length; one whose goal is
    reached already is not driven."""
    for leg in turn.legs:
        here = {
            Goal.X: at.x_m,
            Goal.HEADING: at.heading_rad,
            Goal.ALONG: turn.along(at.x_m, at.y_m),
            Goal.WAY: 0.0,
        }[leg.goal]
        left = leg.value - here
        if left == 0.0 or (left > 0.0) is not leg.rises:
            continue
        if leg.goal is Goal.HEADING:
            radius = vehicle.wheelbase_m / math.tan(leg.steer_rad)
            length = abs(left * radius)
            poses = [_on_arc(at, radius, left * part) for part in _parts(length, step_m)]
        else:
            aside = -turn.offset(at.x_m, at.y_m) if leg.follow is Follow.NEW_LANE else 0.0
            length = abs(left)
            way = -length if leg.reverse else length
            poses = [at.ahead(way * part, aside * part) for part in _parts(length, step_m)]
        at = poses[-1]
        yield Driven(leg, length, poses)


def path(vehicle: Vehicle, turn: Turn, step_m: float = STEP_M) -> list[Pose2]:
    """Poses of the rear axle along a turn driven without error, in its frame, from its origin."""
    legs = driven(vehicle, turn, step_m)
    return [ORIGIN, *(pose for leg in legs for pose in leg.poses)]


def _on_arc(at: Pose2, radius_m: float, turned_rad: float) -> Pose2:
    """Further along a circle, to the left where its radius is positive."""
    heading = at.heading_rad + turned_rad
    return Pose2(
        at.x_m + radius_m * (math.sin(heading) - math.sin(at.heading_rad)),
        at.y_m - radius_m * (math.cos(heading) - math.cos(at.heading_rad)),
        heading,
    )


def _parts(length_m: float, step_m: float) -> list[float]:
    count = max(1, math.ceil(length_m / step_m))
    return [k / count for k in range(1, count + 1)]
