"""The pilot's behaviours without a world: a context that a test sets, and what a step makes of
it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from host.core.frames import Pose2
from host.core.messages import Command, Request, State, Telemetry
from host.core.vehicle import Vehicle
from host.estimate.crop_ahead import END_PICTURES, EndOfField
from host.field.areas import Level, Verdict
from host.pilot.behaviours.follow import Follow
from host.pilot.behaviours.gather import Gather
from host.pilot.behaviours.turn import ROOMS
from host.pilot.context import STAND_S, Context
from host.pilot.endings import LEFT_SHARE, SideEnd, Standing, end_side, leave_side, over
from host.pilot.phase import Go, Reason
from host.pilot.planned_strip import PlannedStrip
from host.pilot.turn_progress import Turning
from host.route.manoeuvre import SHORT_M
from host.route.plan import Plan, spiral
from host.route.turn_legs import shuttle
from host.vision.view import CropView

VEHICLE = Vehicle()
PLAN = spiral([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)], 1, VEHICLE, gap_m=2.0)
CUTTING = CropView(
    0.9, edge_offset_m=0.0, edge_heading_rad=0.0, crop_ahead_m=0.0, ahead_confidence=1.0
)
"""A picture of a machine that cuts in line, sure of the edge and of the crop at the blade."""
NOW = 100.0
TOO_NEAR = Verdict(Level.STOP, "too near", 0.1)
"""What the geofence says where it stops the machine."""
AT_KEEP_OUT = replace(TOO_NEAR, at_keep_out=True, clearance_m=0.1)
LOOKS = ROOMS * len(SHORT_M)
"""For another way, from one place."""
LEFT_MOST_M2 = LEFT_SHARE * PLAN.area_m2
"""Of the plan: with more left standing the field is not harvested."""
LEFT_MOST_M = LEFT_MOST_M2 / PLAN.sides[0].width_m
"""The same of its first side's length."""


class Shown:
    """A detector that is asked for nothing, or shows what a test says."""

    def __init__(self, view: CropView = CUTTING) -> None:
        self.view = view

    def see(self, *_: object, **__: object) -> CropView:
        return self.view

    glance = see

    def next_crop(self, gap_m: float) -> None:
        self.gap_m = gap_m

    def restart(self, **_: object) -> None:
        pass


def told(speed_mps: float = 0.0, at_m: float = 0.0, state: State = State.RUNNING) -> Telemetry:
    """What the firmware says, of a machine so fast, so far along its wheels."""
    return Telemetry(
        NOW, state, 0, 0.0, 0.0, 0, 0, False, speed_mps, at_m, battery_v=12.0, last_seq=0,
        frames_bad=0,
    )  # fmt: skip


def moved(context: Context, to_m: float, speed_mps: float = 0.0, *, stamp: float = NOW) -> None:
    """The machine has come so far along its wheels, driven."""
    context.telemetry = replace(told(speed_mps, to_m), stamp=stamp)
    context.estimate.take_telemetry(replace(context.telemetry, drive_duty=120))


def seeing(context: Context, view: CropView, *, stamp: float = NOW) -> None:
    """The last picture shows that, and pictures have been good for a second."""
    context.sight.view, context.sight.stamp = view, stamp
    for steady in (context.sight.seen, context.sight.usable):
        steady.stamp, steady.broken = stamp, stamp - 1.0


def standing(plan: Plan | None = None, eye: Shown | None = None) -> Context:
    """A machine that stands armed, its pictures good."""
    context = Context(VEHICLE, eye or Shown(), plan or Plan())
    context.since = NOW
    moved(context, 0.0, stamp=NOW - 1.0)
    seeing(context, CUTTING)
    return context


def on_side(
    index: int = 0, plan: Plan = PLAN, *, cut_m: float | None = 5.0, eye: Shown | None = None
) -> Context:
    """On a side of a plan, in line, its crop met cut_m ago."""
    context = standing(plan, eye)
    strip = context.planned(index)
    assert isinstance(strip, PlannedStrip)
    context.estimate.lane.place(0.0, 0.0, 0.05, 0.02)
    strip.place(0.0)
    context.strip = strip
    context.begin_strip()
    context.sight.edge_at_m = 0.0
    if cut_m is not None:
        context.sight.ahead.entered_at = context.motion
        moved(context, cut_m, stamp=NOW - 0.5)
        context.sight.edge_at_m = cut_m
    return context


def clear_ahead(context: Context) -> EndOfField:
    """The latest pictures surely show no crop before the blade."""
    ahead = context.sight.ahead
    ahead.clear_since = EndOfField(NOW, context.motion)
    ahead.clear_count = END_PICTURES
    return ahead.clear_since


def turning(plan: Plan = PLAN, eye: Shown | None = None) -> Context:
    """At the end of the first side, the turn laid out."""
    context = on_side(plan=plan, cut_m=10.0, eye=eye)
    end_side(context, NOW, clear_ahead(context))
    assert context.ended is not None
    leave_side(context, NOW, context.ended)
    return context


def turned(plan: Plan = PLAN, eye: Shown | None = None) -> Context:
    """After the turn's last leg."""
    context = turning(plan, eye)
    assert context.turning is not None
    while context.turning.leg is not None:
        context.turning.next(NOW)
    return context


def stands(command: Command) -> bool:
    """Whether that is a command to stand, the blade off."""
    return (command.request, command.speed_mps, command.blade) == (Request.DRIVE, 0.0, False)


def is_for(go: Go | None, reason: Reason | None) -> bool:
    """Whether it gives way for that reason, or goes on where that is None."""
    return (go.reason if go is not None else None) is reason


def turned_to(left_m: float) -> Context:
    """On the second side, to which a turn has led, with so much of it left."""
    context = turned()
    assert context.turning is not None
    context.begin_strip()
    length_m = context.strip.left_m() + context.strip.along_m(context.motion)
    moved(context, context.motion.distance_m + length_m - left_m)
    place = context.estimate.position
    place.place(PLAN.sides[1], length_m - left_m, 0.0, 0.0)
    assert context.strip.left_m() == pytest.approx(left_m, abs=0.05)
    context.left_standing_m2 = 0.0  # of a turn that no wheel has driven
    return context


def backing(context: Context, early_m: float) -> Turning:
    """A shuttle's last leg, back along the strip to before its crop."""
    turn = shuttle(VEHICLE, 0.0, VEHICLE.pass_m, 3.0, early_m=early_m)
    turning = Turning(NOW, turn, (0.0, 0.0, 0.0))
    while not turning.backing:
        turning.next(NOW)
    context.strip.begin_leg(turning)
    return turning


def cut_beside(context: Context, long_m: float = 10.0) -> None:
    """So much of the strip right of the one that the machine is on has been cut just before."""
    swaths, vehicle = context.estimate.swaths, context.vehicle
    for k in range(round(long_m / 0.25) + 1):
        x, y = 0.25 * k + vehicle.blade_x_m, -vehicle.pass_m
        swaths.note(x, Pose2(x, y, 0.0), Pose2(90.0, 90.0, 0.0))
    swaths.end()


def row(y_m: float) -> list[tuple[float, float]]:
    """Of a blade's middle through the square field, eastward."""
    return [(x, y_m) for x in np.arange(0.2, 9.9, 0.25)]


def with_swaths(context: Context, *, but_y_m: tuple[float, float] = (4.0, 6.0)) -> Context:
    """All of the field was cut in rows, but what lies between two of them."""
    for y_m in np.arange(0.45, 10.4, 0.9):
        if not but_y_m[0] < y_m < but_y_m[1]:
            for x, y in row(y_m):
                context.estimate.swaths.note(100.0 * y_m + x, Pose2(x, y, 0.0), Pose2(x, y, 0.0))
            context.estimate.swaths.end()
    return context


def at_plans_end(plan: Plan = PLAN) -> Context:
    """On the last side of a plan."""
    return on_side(len(plan.sides) - 1, plan)


def gathering(left_m2: float = 30.0, **where: tuple[float, float]) -> Context:
    """At the end of a plan that has left so much of 100 m2 itself."""
    context = with_swaths(at_plans_end(), **where)
    context.left_standing_m2 = left_m2
    assert is_for(over(context, SideEnd.LAST.go()), Standing.LEFT)
    return context


def chosen(context: Context) -> Go:
    """What gathering comes to."""
    behaviour = Gather(context)
    behaviour.enter(NOW)
    for _ in range(30):
        command, go = behaviour.step(NOW + STAND_S)
        assert stands(command)
        if go is not None:
            return go
    raise AssertionError("it stands for ever")


def cut_elsewhere(context: Context, length_m: float) -> None:
    """The blade has cut so far on, along a row of its own."""
    begun_m = 1e4 + context.estimate.swaths.cut_m
    for x in np.arange(0.0, length_m, 0.25):
        at = Pose2(1.0 + 0.001 * x, 4.5, 0.0)
        context.estimate.swaths.note(begun_m + x, at, at)
    context.estimate.swaths.end()


def bent_plan() -> Plan:
    """Two strips along one edge, which bends to the left halfway."""
    ring = [(0.0, 0.0), (7.0, 0.0), (13.0, 2.0), (13.0, 12.0), (0.0, 12.0)]
    first = spiral(ring, 0, VEHICLE, gap_m=2.0).sides[0]
    assert len(first.bends) == 1
    x, y, _ = first.pose(0.0, first.width_m)
    second = replace(first, x_m=x, y_m=y, bends=((7.0 - 0.1, first.bends[0][1]),))
    return replace(PLAN, sides=(first, second), boundary=tuple(ring))


def refused(context: Context, *, beside: bool, again: bool = False) -> Go | None:
    """What following makes of clear ground that a look has confirmed; `again`: that the machine
    came back to."""
    context.regained += [context.estimate.cut.cut_m] * again
    context.estimate.cut.refused = True
    context.sight.beside_at_m = context.motion.distance_m if beside else -math.inf
    return Follow(context).step(NOW)[1]
