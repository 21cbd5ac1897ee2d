"""Which manoeuvre leads from a side of a plan to the next: one choice for the pilot that drives it
and the preview that shows it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from host.core.frames import Pose2
from host.core.vehicle import Vehicle
from host.field.areas import Geofence, outline_of, placed
from host.route import turn_legs
from host.route.plan import Plan
from host.route.side import Side
from host.route.turn_legs import NewLane, Turn

SWINGS = (0.55, 0.65, 0.75, 0.45, 0.35, 0.25)
"""Shares of a turn that the forward arc of a three-point turn may take, best first."""
ROOM_M = 0.6
"""Clearance to the geofence's border that any turn may be driven with."""
SHUTTLE_ROOM_M = 0.15
"""The same of a shuttle's S, which is driven at a creep. What follows it, straight back, the
geofence may end sooner: then so much of the strip's beginning stays."""
ALIKE_M = 1e-3
"""Rooms that differ by less are the same."""
EARLY_M = (0.0, 0.2, 0.4, 0.6, 0.8, 1.2, 1.6, 2.0)
"""How much sooner than it should a shuttle's S may begin, best first: crop that is pressed down
before it is cut costs less than a strip that begins askew."""


def next_turn(plan: Plan, index: int, vehicle: Vehicle, room_m: Callable[[Turn], float]) -> Turn:
    """The turn from the end of side `index` to the next. `room_m` is the least clearance along a
    turn. Of the three-point turns it is the first that has ROOM_M, of the shuttles the first that
    has SHUTTLE_ROOM_M, else the one that has the most."""
    corner = plan.corner_rad(index)
    if index + 1 < len(plan.sides):
        this, following = plan.sides[index], plan.sides[index + 1]
        lane = _lane_of(this, following, corner, vehicle)
        if corner == 0.0:
            room = turn_legs.shuttle_room_m(vehicle, following.back_m, plan.gap_m)
            begins = lane.x_m - vehicle.blade_x_m
            shuttles = (
                turn_legs.shuttle(vehicle, begins, lane.y_m, room, early_m=early)
                for early in EARLY_M
            )
            return _first_with(
                SHUTTLE_ROOM_M, shuttles, lambda turn: room_m(replace(turn, legs=turn.legs[:-1]))
            )
    else:
        lane = turn_legs.lane_beside(vehicle, corner)
    if plan.turn == "arc":
        return turn_legs.arc(vehicle, corner, lane)
    turns = (turn_legs.three_point(vehicle, corner, lane, swing=swing) for swing in SWINGS)
    return _first_with(ROOM_M, turns, room_m)


def _first_with(wanted_m: float, turns: Iterable[Turn], room_m: Callable[[Turn], float]) -> Turn:
    """The first that has the room, else the one that has the most. Turns often have the same least
    room, where they begin: the last bit of it must not choose between them."""
    rooms: list[tuple[float, Turn]] = []
    for turn in turns:
        rooms.append((room_m(turn), turn))
        if rooms[-1][0] >= wanted_m:
            return turn
    return max(rooms, key=lambda pair: round(pair[0] / ALIKE_M))[1]


def turn_origin(this: Side, following: Side, vehicle: Vehicle) -> Pose2:
    """The turn's frame: the rear axle's pose (field frame) when the blade stands at the end of
    `this`. A shuttle goes back along the lane and turns at its beginning, so a bent side counts as
    if it ran straight on from there."""
    left = vehicle.inset_m - this.shift_m
    if following.takes_again(this):
        return Pose2(*this.pose(0.0, left)).ahead(this.length_m - vehicle.blade_x_m)
    return Pose2(*this.pose(this.length_m, left)).ahead(-vehicle.blade_x_m)


def _lane_of(this: Side, following: Side, corner_rad: float, vehicle: Vehicle) -> NewLane:
    """The lane beside a plan's following side, in the frame of the turn from this one's end."""
    edge = turn_origin(this, following, vehicle).seen_from(following.x_m, following.y_m)
    lane = Pose2(*edge, corner_rad).ahead(0.0, vehicle.inset_m - following.shift_m)
    return NewLane(lane.x_m, lane.y_m, 0.0)


def room_along(
    turn: Turn, at: tuple[float, float, float], vehicle: Vehicle, fence: Geofence
) -> float:
    """The least clearance to the geofence along a turn that begins with the rear axle at `at`
    (x, y, heading in the field frame)."""
    begin, outline = Pose2(*at), outline_of(vehicle)
    poses = turn_legs.path(vehicle, turn)
    places = [
        begin.ahead(*pose[:2])._replace(heading_rad=at[2] + pose.heading_rad) for pose in poses
    ]
    return min(fence.clearance(placed(outline, *place)) for place in places)
