"""Which manoeuvre leads from a side of a plan to the next: one choice for the pilot that drives it
and the preview that shows it."""

from __future__ import annotations

import math
from collections.abc import Callable

from host import manoeuvre
from host.areas import Geofence, outline_of, placed
from host.manoeuvre import Turn
from host.plan import Plan
from host.vehicle import Vehicle

SWINGS = (0.55, 0.65, 0.75, 0.45, 0.35, 0.25)
"""Shares of a turn that the forward arc of a three-point turn may take, best first."""
ROOM_M = 0.6
"""Clearance to the geofence's border that any turn may be driven with."""


def next_turn(
    plan: Plan, index: int, cut_m: float, vehicle: Vehicle, room_m: Callable[[Turn], float]
) -> Turn:
    """The turn from side `index`, whose crop the blade followed for cut_m. `room_m` is the least
    clearance along a turn; of the three-point turns it is the first that has ROOM_M, else the one
    that has the most."""
    corner = plan.corner_rad(index)
    following = plan.sides[index + 1] if index + 1 < len(plan.sides) else None
    shift = following.shift_m if following is not None else 0.0
    if corner == 0.0 and following is not None:
        this = plan.sides[index]
        c, s = math.cos(following.heading_rad), math.sin(following.heading_rad)
        dx, dy = following.x_m - this.x_m, following.y_m - this.y_m
        left = c * dy - s * dx - (shift - this.shift_m)
        room = manoeuvre.shuttle_room_m(vehicle, following.back_m, plan.gap_m)
        return manoeuvre.shuttle(vehicle, c * dx + s * dy - cut_m, left, room)
    if plan.turn == "arc":
        return manoeuvre.arc(vehicle, corner, shift)
    rooms: list[tuple[float, Turn]] = []
    for swing in SWINGS:
        turn = manoeuvre.three_point(vehicle, corner, shift, swing=swing)
        rooms.append((room_m(turn), turn))
        if rooms[-1][0] >= ROOM_M:
            return turn
    return max(rooms, key=lambda pair: pair[0])[1]


def room_along(
    turn: Turn, at: tuple[float, float, float], vehicle: Vehicle, fence: Geofence
) -> float:
    """The least clearance to the geofence along a turn that begins with the rear axle at `at`
    (x, y, heading in the field frame)."""
    x, y, yaw = at
    c, s = math.cos(yaw), math.sin(yaw)
    outline = outline_of(vehicle)
    return min(
        fence.clearance(placed(outline, x + c * px - s * py, y + s * px + c * py, yaw + turned))
        for px, py, turned in manoeuvre.path(vehicle, turn)
    )
