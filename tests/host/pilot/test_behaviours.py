"""Every behaviour alone: a context that a test sets, one step after the other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from host.core.frames import Pose2
from host.core.messages import Command, Frame, Request, State, Telemetry
from host.core.vehicle import Vehicle
from host.estimate.crop_ahead import END_CLEAR_M, END_PICTURES, Ahead, EndOfField
from host.estimate.cut_guard import CutGuard
from host.estimate.gaps import SEEN_M
from host.estimate.lane import Lane
from host.estimate.measurements.begin import EARLY_M
from host.estimate.position import Aside
from host.estimate.states import CORNERS
from host.field.areas import Level, Verdict
from host.pilot.behaviours import BEHAVIOURS
from host.pilot.behaviours import turn as turn_module
from host.pilot.behaviours.align import TRUST_AFTER_S, Align
from host.pilot.behaviours.align import Why as Aligned
from host.pilot.behaviours.back_off import (
    BACK_AFTER_S,
    BACK_M,
    BACKS,
    CREEP_M,
    CREEP_SIGMA_M,
    CREEPS,
    FROM_BEHIND_PICTURES,
    LEAST_ON_M,
    LOOKED_S,
    SETTLE_S,
    STANDS_M,
    BackOff,
)
from host.pilot.behaviours.back_off import END_REST_M as BACKED_REST_M
from host.pilot.behaviours.back_off import Why as BackedOff
from host.pilot.behaviours.connect import ARM_RETRY_S, Connect
from host.pilot.behaviours.connect import Why as Connected
from host.pilot.behaviours.fault import Fault
from host.pilot.behaviours.finish import Finish
from host.pilot.behaviours.follow import (
    END_REST_M,
    SPIN_S,
    Follow,
)
from host.pilot.behaviours.follow import Why as Followed
from host.pilot.behaviours.gather import Gather
from host.pilot.behaviours.gather import Why as Gathered
from host.pilot.behaviours.look_at_edge import LookAtEdge
from host.pilot.behaviours.look_at_edge import Why as EdgeLook
from host.pilot.behaviours.look_at_end import BARE_LOOKS, LookAtEnd
from host.pilot.behaviours.look_at_end import Why as EndLook
from host.pilot.behaviours.regain import RUN_UP_M, Regain
from host.pilot.behaviours.regain import Why as Regained
from host.pilot.behaviours.retrace import Retrace
from host.pilot.behaviours.search import MOST_PICTURES, PICTURES, Search
from host.pilot.behaviours.search import Why as Searched
from host.pilot.behaviours.turn import ARRIVES_M, ROOMS, SEARCHES, STEER_TIMEOUT_S, DriveTurn
from host.pilot.behaviours.turn import Why as Turned
from host.pilot.behaviours.wait_for_camera import WaitForCamera
from host.pilot.behaviours.wait_for_camera import Why as Waited
from host.pilot.context import (
    BEGINNING_M,
    BLIND_ON_M,
    PAST_LEFT_M,
    REGAINS,
    RESUME_AFTER_S,
    SLOW_AFTER_S,
    STAND_S,
    Context,
    Ended,
)
from host.pilot.endings import (
    GIVE_UP_S,
    LEFT_M2,
    LEFT_SHARE,
    Beside,
    Blind,
    Elsewhere,
    Over,
    Patience,
    SideEnd,
    Standing,
    end_side,
    leave_side,
    over,
)
from host.pilot.gaze import STOP_AFTER_S, Gaze
from host.pilot.guard import Guard, Watched
from host.pilot.leaps import LEAP_PICTURES
from host.pilot.phase import Doing, Go, Phase, Reason
from host.pilot.plan_side import NO_CROP_M
from host.pilot.planned_strip import PlannedStrip
from host.pilot.remains import GETS_ON_M
from host.pilot.sight import ASIDE_M, LATELY_M, LOST_M, UNSEEN_M
from host.pilot.stop_and_look import LOOK_S
from host.pilot.turn_progress import LOOK_BACK_M, PAST_M, Turning
from host.pilot.whose_edge import WhoseEdge
from host.route.manoeuvre import RUN_IN_M, SHORT_M
from host.route.manoeuvre import Lane as LaneTo
from host.route.plan import Plan, spiral
from host.route.side import Side
from host.route.turn_legs import Follow as Along
from host.route.turn_legs import Goal, Leg, Turn, driven, shuttle
from host.vision.view import CropView
from tests.helpers.places import wandered

VEHICLE = Vehicle()
PLAN = spiral([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)], 1, VEHICLE, gap_m=2.0)
CUTTING = CropView(
    0.9, edge_offset_m=0.0, edge_heading_rad=0.0, crop_ahead_m=0.0, ahead_confidence=1.0
)
NOW = 100.0
TOO_NEAR = Verdict(Level.STOP, "too near", 0.1)


LOOKS = ROOMS * len(SHORT_M)
"""For another way, from one place."""


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
    ahead.clear_since = EndOfField(NOW, context.motion, context.strip.index)
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
    return (command.request, command.speed_mps, command.blade) == (Request.DRIVE, 0.0, False)


def is_for(go: Go | None, reason: Reason | None) -> bool:
    return (go.reason if go is not None else None) is reason


# ---- connect, align ------------------------------------------------------------------------------


def test_connect_asks_to_arm_and_asks_again() -> None:
    context = standing()
    connect = Connect(context)
    context.telemetry = told(state=State.SAFE)
    assert connect.step(NOW)[0].request is Request.ARM
    assert connect.step(NOW + ARM_RETRY_S / 2)[0].request is Request.DRIVE
    assert connect.step(NOW + 1.1 * ARM_RETRY_S)[0].request is Request.ARM
    context.telemetry = told(state=State.ARMED)
    assert is_for(connect.step(NOW + 2.0)[1], Connected.ARMED)


def test_connect_says_why_the_firmware_does_not_arm() -> None:
    context = standing()
    refusal = "Arm refused: this machine is not set up"
    context.telemetry = replace(told(state=State.SAFE), refusal=refusal)
    Connect(context).step(NOW)
    assert context.reason == refusal


def test_connect_clears_a_fault_once() -> None:
    context = standing()
    connect = Connect(context)
    context.telemetry = told(state=State.FAULT)
    assert connect.step(NOW)[0].request is Request.CLEAR
    command, go = connect.step(NOW + 1.0)
    assert command.request is Request.STOP
    assert is_for(go, Connected.FAULT_STAYS)


def test_align_waits_for_an_edge_and_places_the_machine_in_the_plan() -> None:
    context = standing(PLAN)
    context.sight.view = replace(CUTTING, ahead_confidence=0.1)
    assert Align(context).step(NOW) == (context.hold(), None)
    seeing(context, replace(CUTTING, crop_ahead_m=0.4))
    assert is_for(Align(context).step(NOW)[1], Aligned.SEEN)
    assert context.estimate.position.known
    assert context.strip.along_m(context.motion) == pytest.approx(-0.4, abs=0.01)


@pytest.mark.parametrize(
    ("confidences", "goes"),
    [
        ((0.9,), True),
        ((0.6, 0.6), False),
        ((0.6, 0.6, 0.6), True),
        ((0.6, 0.0, 0.6, 0.0, 0.6, 0.0, 0.6), False),
        ((0.0, 0.0, 0.3, 0.0, 0.6), False),
        ((0.0, 0.0, 0.3, 0.0, 0.95), True),
    ],
)
def test_one_picture_that_is_hardly_sure_sets_no_machine_off(
    confidences: tuple[float, ...], goes: bool
) -> None:
    """Facing the neighbour's crop, one picture of thirty is (belief "the wrong way round")."""
    context = standing(PLAN)
    align = Align(context)
    for k, confidence in enumerate(confidences):
        seeing(context, replace(CUTTING, confidence=confidence), stamp=NOW + 0.1 * k)
        command, go = align.step(NOW + 0.1 * k)
        assert stands(command)
    assert is_for(go, Aligned.SEEN if goes else None)


@pytest.mark.parametrize("edge_m", [0.6, -0.6])
def test_align_does_not_set_off_while_most_sure_pictures_show_the_edge_beside_the_blade(
    edge_m: float,
) -> None:
    """Not on the operator's word either, however long that takes: one of both is wrong."""
    context = standing(PLAN)
    align = Align(context)
    aside = replace(CUTTING, edge_offset_m=edge_m, edge_heading_rad=math.nan)
    unsure = replace(aside, confidence=0.3)
    views = [aside, aside, *[unsure] * 40, CUTTING, CUTTING, CUTTING]
    for k, view in enumerate(views):
        seeing(context, view, stamp=NOW + 0.1 * k)
        command, go = align.step(NOW + 0.1 * k)
        assert stands(command)
        assert is_for(go, Aligned.SEEN if k == len(views) - 2 else None)
        assert k > 1 or "0.6 m beside" in context.reason
        if go is not None:
            return


def test_align_does_not_set_off_while_most_pictures_show_the_machine_askew() -> None:
    """No operator puts it down so: the pictures are mirrored or upside down, or it is elsewhere."""
    context = standing(PLAN)
    align = Align(context)
    askew = replace(CUTTING, edge_offset_m=0.75, edge_heading_rad=math.nan)
    for k, (view, reason) in enumerate(
        [(askew, None), (askew, None), (CUTTING, None), (CUTTING, Aligned.SEEN)]
    ):
        seeing(context, view, stamp=NOW + 0.1 * k)
        command, go = align.step(NOW + 0.1 * k)
        assert stands(command)
        assert is_for(go, reason)
        assert reason is not None or "mirrored or upside down" in context.reason or k == 2


@pytest.mark.parametrize(("plan", "trusts"), [(PLAN, True), (Plan(), False)])
def test_align_trusts_the_operator_where_a_plan_says_what_is_there(
    plan: Plan, trusts: bool
) -> None:
    context = standing(plan)
    seeing(context, replace(CUTTING, confidence=0.2))
    assert is_for(Align(context).step(NOW + TRUST_AFTER_S - 0.1)[1], None)
    go = Align(context).step(NOW + TRUST_AFTER_S)[1]
    assert is_for(go, Aligned.TRUSTED if trusts else None)


@pytest.mark.parametrize(("endless", "trusts"), [(4, False), (1, True)])
def test_align_trusts_nobody_where_most_pictures_show_crop_without_an_end(
    endless: int, trusts: bool
) -> None:
    """So a machine sees the neighbour's that was put down the wrong way round: one faint picture of
    an end had sent it off."""
    context = standing(PLAN)
    align, shown = Align(context), [0.0] * endless + [0.2] * 2
    for k, confidence in enumerate(shown):
        stamp = NOW + 0.1 * k + (TRUST_AFTER_S if k + 1 == len(shown) else 0.0)
        seeing(context, replace(CUTTING, confidence=confidence), stamp=stamp)
        go = align.step(stamp)[1]
        assert go is None or k + 1 == len(shown)
    assert is_for(go, Aligned.TRUSTED if trusts else None)


@pytest.mark.parametrize(("edge_m", "trusts"), [(0.0, True), (-0.5, False)])
def test_faint_pictures_of_an_end_elsewhere_outweigh_none_without_one(
    edge_m: float, trusts: bool
) -> None:
    """Facing the neighbour's crop, half of them were faint (belief "the wrong way round")."""
    context = standing(PLAN)
    align = Align(context)
    faint, none = (
        replace(CUTTING, confidence=0.3, edge_offset_m=edge_m),
        replace(CUTTING, confidence=0.0),
    )
    views = [none, none] + [faint] * 8
    for k, view in enumerate(views):
        stamp = NOW + 0.1 * k + (TRUST_AFTER_S if k + 1 == len(views) else 0.0)
        seeing(context, view, stamp=stamp)
        go = align.step(stamp)[1]
    assert is_for(go, Aligned.TRUSTED if trusts else None)


def test_a_sure_picture_of_an_end_outweighs_some_without_one() -> None:
    """A mirrored camera shows it now and then; once the machine drives, its pictures are told."""
    context = standing(PLAN)
    align = Align(context)
    askew = replace(CUTTING, edge_offset_m=0.75, edge_heading_rad=math.nan)
    faint, none = replace(CUTTING, confidence=0.2), replace(CUTTING, confidence=0.0)
    views = [none] * 4 + [askew, none, none, faint]
    for k, view in enumerate(views):
        stamp = NOW + 0.1 * k + (TRUST_AFTER_S if k + 1 == len(views) else 0.0)
        seeing(context, view, stamp=stamp)
        go = align.step(stamp)[1]
        assert go is None or k + 1 == len(views)
    assert is_for(go, Aligned.TRUSTED)


# ---- follow --------------------------------------------------------------------------------------


def test_follow_cuts_at_full_speed_once_the_blade_has_spun_up() -> None:
    context = on_side()
    follow = Follow(context)
    seeing(context, CUTTING)
    command, _ = follow.step(NOW + SPIN_S / 2)
    assert (command.speed_mps, command.blade) == (0.0, True)
    seeing(context, CUTTING, stamp=NOW + SPIN_S)
    command, go = follow.step(NOW + SPIN_S + 0.01)
    assert go is None
    assert (command.speed_mps, command.blade) == (VEHICLE.cutting_speed_mps, True)


def test_follow_slows_down_before_it_stops_without_an_edge() -> None:
    context = on_side()
    context.since = NOW - 10.0
    command, go = Follow(context).step(NOW + SLOW_AFTER_S + 0.05)
    assert go is None
    assert command.speed_mps == VEHICLE.manoeuvre_speed_mps
    command, go = Follow(context).step(NOW + STOP_AFTER_S + 0.05)
    assert stands(command)
    assert is_for(go, Followed.EDGE_LOST)


@pytest.mark.parametrize(
    ("along_m", "dusty", "reason"),
    [
        (10.0, False, Elsewhere.AT_BOUNDARY),
        (10.0, True, Followed.SEEMS_TO_END),
        (5.0, False, None),
    ],
)
def test_follow_ends_a_side_where_plan_and_pictures_do(
    along_m: float, dusty: bool, reason: Reason | None
) -> None:
    """In dust it looks first; where the plan has crop it creeps on."""
    context = on_side(cut_m=along_m)
    context.since = NOW - 10.0
    clear_ahead(context)
    context.sight.ahead.sure.extend([not dusty] * 30)
    command, go = Follow(context).step(NOW)
    assert is_for(go, reason)
    ends = reason is Elsewhere.AT_BOUNDARY
    assert command.blade is not ends, "it cuts until it stands or ends"
    if reason is None:
        assert command.speed_mps == VEHICLE.manoeuvre_speed_mps
    assert (context.ended is not None) is ends


def test_follow_looks_at_bare_ground_that_lasts() -> None:
    context = on_side(cut_m=4.0)
    clear_ahead(context)
    moved(context, 5.2)
    assert is_for(Follow(context).step(NOW)[1], Followed.SEEMS_TO_END)


def test_follow_looks_once_for_an_edge_that_dust_hides() -> None:
    context = on_side()
    context.since = NOW - 10.0
    context.estimate.lane.place(0.0, 0.0, 0.2, 0.02)
    assert is_for(Follow(context).step(NOW)[1], None), "it was seen just now"
    context.sight.edge_at_m = 5.0 - UNSEEN_M - 0.01
    command, go = Follow(context).step(NOW)
    assert is_for(go, Followed.EDGE_UNSURE)
    assert (command.speed_mps, command.blade) == (0.0, True), "it cuts until it stands"
    assert is_for(Follow(context).step(NOW)[1], None), "not again at the same place"


def test_follow_takes_the_boundary_for_the_end_once_and_then_for_a_fault() -> None:
    past = PLAN.sides[0].fence_m + 2.5
    context = on_side(cut_m=past)
    assert is_for(Follow(context).step(NOW)[1], SideEnd.BY_PLAN)
    again = on_side(cut_m=past)
    again.by_plan = True
    command, go = Follow(again).step(NOW)
    assert is_for(go, Followed.TOO_LONG)
    assert command.request is Request.STOP


@pytest.mark.parametrize("inside", [True, False])
def test_a_strip_that_is_too_long_is_left_for_later_where_no_gap_lies_beside_it(
    inside: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two strips of an L ran on into its other arm, whose corner nobody had seen, and half of the
    field stood (picture field 10431)."""
    context = on_side(5 if inside else 0)
    context.by_plan = True
    monkeypatch.setattr(type(context.strip), "overrun", lambda _: True)
    go = Follow(context).step(NOW)[1]
    assert is_for(go, Standing.LEFT if inside else Followed.TOO_LONG)


LEFT_MOST_M2 = LEFT_SHARE * PLAN.area_m2
LEFT_MOST_M = LEFT_MOST_M2 / PLAN.sides[0].width_m


@pytest.mark.parametrize(
    ("at_keep_out", "clear_m", "left_m", "reason"),
    [
        (True, 0.1, LEFT_MOST_M - 0.1, SideEnd.KEEP_OUT),
        (True, 0.1, LEFT_MOST_M + 0.1, SideEnd.KEEP_OUT),
        (True, -0.1, LEFT_MOST_M - 0.1, Watched.GEOFENCE),
        (False, 0.1, LEFT_MOST_M - 0.1, Watched.GEOFENCE),
    ],
)
def test_a_side_at_a_keep_out_ends_where_the_geofence_stops_the_machine(
    at_keep_out: bool, clear_m: float, left_m: float, reason: Reason
) -> None:
    """One that may be in it already needs a person."""
    context = on_side(cut_m=PLAN.sides[0].length_m - left_m)
    verdict = replace(TOO_NEAR, at_keep_out=at_keep_out, clearance_m=clear_m)
    along_m = context.strip.along_m(context.motion)
    before = context.strip
    assert is_for(Follow(context).blocked(NOW, verdict), reason)
    assert context.strip.index == (1 if reason is SideEnd.KEEP_OUT else 0)
    assert before.along_m(context.motion) == along_m, "no end was seen that tells of the place"
    assert context.ends == []


def test_what_is_left_beside_keep_outs_is_counted_together_and_told_at_the_end() -> None:
    verdict = replace(TOO_NEAR, at_keep_out=True, clearance_m=0.1)
    context = on_side(cut_m=PLAN.sides[0].length_m - LEFT_MOST_M + 0.1)
    assert is_for(Follow(context).blocked(NOW, verdict), SideEnd.KEEP_OUT)
    assert context.left_m2 == pytest.approx(LEFT_MOST_M2 - 0.1 * PLAN.sides[0].width_m)
    for left_m2, told in (
        (LEFT_M2 - 0.1, SideEnd.LAST),
        (LEFT_M2 + 0.1, Over.SOME_LEFT),
        (LEFT_MOST_M2 + 0.1, Over.MUCH_LEFT),
    ):
        context.remains.over, context.left_standing_m2 = True, left_m2
        go = over(context, SideEnd.LAST.go())
        assert is_for(go, told)
        assert go.text.startswith(SideEnd.LAST.text)
        assert (f"{left_m2:.0f} m2" in go.text) is (told is not SideEnd.LAST)
    going_on = SideEnd.KEEP_OUT.go(side="side 1")
    assert over(context, going_on) == going_on


AT_KEEP_OUT = replace(TOO_NEAR, at_keep_out=True, clearance_m=0.1)


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


@pytest.mark.parametrize(
    ("left_m", "reason"),
    [(PAST_LEFT_M + 0.2, Beside.PAST), (PAST_LEFT_M - 0.2, SideEnd.KEEP_OUT)],
)
def test_past_a_keep_out_beside_a_strip_it_turns_to_where_that_goes_on(
    left_m: float, reason: Reason
) -> None:
    context = turned_to(left_m)
    assert is_for(Follow(context).blocked(NOW, AT_KEEP_OUT), reason)
    assert context.strip.index == (1 if reason is Beside.PAST else 2)


def test_a_turn_past_a_keep_out_leads_to_its_lane_farther_on_and_counts_what_it_leaves() -> None:
    context = turned_to(7.0)
    Follow(context).blocked(NOW, AT_KEEP_OUT)
    turn = DriveTurn(context)
    turning = turn.turning
    here = turning.beside_lane(context.motion)
    for _ in range(LOOKS):
        assert stands(turn.step(NOW)[0])
        if turning.leg is not None:
            break
    legs = turning.turn.legs
    assert legs and all(leg.follow is Along.NOTHING for leg in legs), "nothing leads back"
    of_lane = [
        replace(leg, value=leg.value - turning.turn.lane_rad) if leg.goal is Goal.HEADING else leg
        for leg in legs
    ]
    *_, last = driven(VEHICLE, Turn(tuple(of_lane), 0.0, 0.0, 0.0, 0.0), at=here)
    end = last.poses[-1]
    assert end.x_m > here.x_m + PAST_M - 0.05
    assert end.y_m == pytest.approx(0.0, abs=0.03)
    moved(context, context.motion.distance_m + 2.0, stamp=NOW + 4.0)
    context.begin_strip()
    assert context.left_standing_m2 == pytest.approx(2.0 * PLAN.sides[1].width_m, rel=0.1)


def test_past_a_keep_out_it_turns_once_on_a_strip() -> None:
    context = turned_to(7.0)
    assert is_for(Follow(context).blocked(NOW, AT_KEEP_OUT), Beside.PAST)
    context.begin_strip()
    assert is_for(Follow(context).blocked(NOW, AT_KEEP_OUT), SideEnd.KEEP_OUT)


def test_where_nothing_is_made_out_past_a_keep_out_the_rest_of_the_strip_stays() -> None:
    context = turned_to(7.0)
    Follow(context).blocked(NOW, AT_KEEP_OUT)
    while context.turning is not None and context.turning.leg is not None:
        context.turning.next(NOW)
    left_m2 = context.strip.left_m2
    goes = searched(context, CropView(0.0), MOST_PICTURES + 1)
    assert [go.reason for go in goes] == [SideEnd.KEEP_OUT]
    assert context.left_standing_m2 == pytest.approx(left_m2, rel=0.05)


@pytest.mark.parametrize(("inside_m", "told"), [(0.5, False), (2.5, True)])
def test_what_a_turn_leaves_behind_the_machine_is_told(inside_m: float, told: bool) -> None:
    """One that found no room behind the crop's beginning."""
    context = turned()
    assert context.turning is not None
    expected_m = context.turning.crop_expected_m(context.motion, VEHICLE.blade_x_m)
    turn = context.turning.turn
    begins_m = turn.crop_begins_m - expected_m - inside_m
    context.turning.turn = replace(turn, crop_begins_m=begins_m)
    context.begin_strip()
    left_m2 = inside_m * PLAN.sides[1].width_m if told else 0.0
    assert context.left_standing_m2 == pytest.approx(left_m2)


@pytest.mark.parametrize("clear_m", [0.1, -0.1])
def test_the_harvest_is_over_where_all_that_is_left_stands_at_a_keep_out(clear_m: float) -> None:
    last = len(PLAN.sides) - 1
    context = on_side(last, cut_m=PLAN.sides[last].length_m - 1.0)
    verdict = replace(TOO_NEAR, at_keep_out=True, clearance_m=clear_m)
    left_m2 = context.strip.left_m2
    assert left_m2 > 0.5
    assert is_for(Follow(context).blocked(NOW, verdict), Followed.LEFT_AT_KEEP_OUT)
    assert context.left_m2 == pytest.approx(left_m2), "and it is told"


def test_where_only_another_place_is_too_near_crop_at_the_blade_decides_once() -> None:
    """A machine that believes to be elsewhere, and had stood for good (model field 10317)."""
    context = on_side()
    context.begin_strip()
    verdict = replace(TOO_NEAR, elsewhere=True)
    assert is_for(Follow(context).blocked(NOW, verdict), Followed.IN_DUST)
    assert is_for(Follow(context).blocked(NOW + 5.0, verdict), Watched.GEOFENCE)
    assert is_for(Follow(on_side()).blocked(NOW, TOO_NEAR), Watched.GEOFENCE)


def test_a_side_that_is_about_to_end_ends_where_the_geofence_stops_the_machine_once() -> None:
    """Twice in a row it is no end, and well before it none at all."""
    verdict = replace(TOO_NEAR, at_keep_out=False, clearance_m=0.1)
    context = on_side(cut_m=PLAN.sides[0].length_m - END_REST_M + 0.1)
    assert is_for(Follow(context).blocked(NOW, verdict), SideEnd.BY_PLAN)
    assert context.strip.index == 1 and context.ends == []
    again = on_side(cut_m=PLAN.sides[0].length_m - END_REST_M + 0.1)
    again.by_plan = True
    assert is_for(Follow(again).blocked(NOW, verdict), Watched.GEOFENCE)
    before = on_side(cut_m=PLAN.sides[0].length_m - END_REST_M - 0.1)
    assert is_for(Follow(before).blocked(NOW, verdict), Watched.GEOFENCE)
    slanting = (replace(PLAN.sides[0], edge_end_m=1.5), *PLAN.sides[1:])
    tip = on_side(plan=replace(PLAN, sides=slanting), cut_m=PLAN.sides[0].length_m - 2.0)
    assert is_for(Follow(tip).blocked(NOW, verdict), SideEnd.BY_PLAN)


def backing(context: Context, early_m: float) -> Turning:
    """A shuttle's last leg, back along the strip to before its crop."""
    turn = shuttle(VEHICLE, 0.0, VEHICLE.pass_m, 3.0, early_m=early_m)
    turning = Turning(NOW, turn, (0.0, 0.0, 0.0))
    while not turning.backing:
        turning.next(NOW)
    context.strip.begin_leg(turning)
    return turning


@pytest.mark.parametrize(
    ("early_m", "from_m", "seen"), [(0.0, -0.1, True), (0.4, -0.1, False), (0.0, 1.5, False)]
)
def test_where_a_strip_begins_shows_while_the_machine_backs_away_from_it(
    early_m: float, from_m: float, seen: bool
) -> None:
    """Not over what its wheels have pressed down, nor with the blade inside the strip."""
    context = on_side(cut_m=None, eye=Shown(replace(CUTTING, crop_ahead_m=0.5)))
    turning = backing(context, early_m)
    for k in range(10):
        stamp = NOW + 0.1 * k
        moved(context, from_m - 0.03 * k, -0.3, stamp=stamp)
        frame = Frame(stamp, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, DriveTurn.gaze, context.strip, turning, NOW, context.look.settled)
    assert math.isfinite(context.sight.ahead.begins_at_m) is seen


@pytest.mark.parametrize("turns", [True, False])
def test_what_a_turning_machine_sees_against_its_lane_makes_that_no_more_doubtful(
    turns: bool,
) -> None:
    """Crop that stands elsewhere passes before it; what lasts beside a machine on its lane does."""
    elsewhere = replace(CUTTING, edge_offset_m=1.2, crop_ahead_m=0.5, edge_ahead_m=0.5)
    context = on_side(cut_m=None, eye=Shown(elsewhere))
    turning = backing(context, 0.0) if turns else None
    lane = context.estimate.lane
    context.estimate.position.place(context.strip.planned_piece, 0.0, 0.0, 0.0)
    before = lane.offset_sigma_m
    for k in range(10):
        stamp = NOW + 0.1 * k
        moved(context, -1.0 - 0.06 * k, -0.6, stamp=stamp)
        frame = Frame(stamp, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, DriveTurn.gaze, context.strip, turning, NOW, context.look.settled)
        if k == LEAP_PICTURES - 1:
            assert lane.contradicted
    assert (lane.offset_sigma_m < 1.1 * before) is turns


def test_crop_that_is_met_driving_up_to_it_stands_a_little_farther_on() -> None:
    """The detector takes it for met so long before."""
    context = on_side(1, cut_m=None)
    moved(context, -EARLY_M)
    before = context.strip.along_m(context.motion)
    context.strip.met_begin(0.0)
    assert context.strip.along_m(context.motion) == pytest.approx(before, abs=0.01)


def test_a_shuttle_that_is_broken_off_beside_its_strip_looks_at_it_from_there_no_more() -> None:
    context = on_side(cut_m=None)
    turn = shuttle(VEHICLE, -8.0, VEHICLE.pass_m, 3.0)
    context.strip.begin_leg(Turning(NOW, turn, (0.0, 0.0, 0.0)))
    assert context.estimate.position.beside
    context.begin_strip()
    assert not context.estimate.position.beside


@pytest.mark.parametrize(("early_m", "tells"), [(0.0, True), (0.8, False)])
def test_crop_whose_beginning_a_shuttle_has_pressed_down_tells_no_place(
    early_m: float, tells: bool
) -> None:
    context = on_side(1, cut_m=None)
    turn = shuttle(VEHICLE, 0.0, VEHICLE.pass_m, 3.0, early_m=early_m)
    context.strip.begin_leg(Turning(NOW, turn, (0.0, 0.0, 0.0)))
    moved(context, 1.0)
    before = context.estimate.position.pose
    context.strip.met_begin(0.0)
    assert (context.estimate.position.pose != before) is tells


@pytest.mark.parametrize(("early_m", "most_m"), [(0.0, 0.4), (1.0, 0.15)])
def test_an_edge_that_a_shuttle_has_pressed_down_counts_less(early_m: float, most_m: float) -> None:
    context = on_side(cut_m=None)
    backing(context, early_m)
    position, lane = context.estimate.position, context.estimate.lane
    position.less_sure(0.12, 0.0)
    before = lane.blade_offset_m
    for _ in range(20):
        lane.correct(0.3, math.nan, 1.0, (0.0, 0.0))
    moved_m = abs(lane.blade_offset_m - before)
    assert 0.0 < moved_m < most_m
    assert (moved_m > 0.25) is (early_m == 0.0)


def test_along_what_a_shuttle_has_pressed_down_no_edge_is_followed() -> None:
    context = on_side(cut_m=0.2)
    strip, position = context.strip, context.estimate.position
    backing(context, 1.0)
    strip.cut()
    assert position.beside
    moved(context, 1.5)
    strip.cut()
    assert not position.beside


def test_a_side_does_not_run_on_over_ground_that_is_cut_but_for_what_it_may_have_left() -> None:
    inner = replace(PLAN.sides[0], fence_m=PLAN.sides[0].length_m + 9.0)
    plan = replace(PLAN, sides=(inner, *PLAN.sides[1:]))
    for past_m, ends in ((0.5, False), (5.0, True)):
        strip = on_side(plan=plan, cut_m=inner.length_m + past_m).strip
        assert strip.overrun() is ends


def cut_beside(context: Context, long_m: float = 10.0) -> None:
    """So much of the strip right of the one that the machine is on has been cut just before."""
    swaths, vehicle = context.estimate.swaths, context.vehicle
    for k in range(round(long_m / 0.25) + 1):
        x, y = 0.25 * k + vehicle.blade_x_m, -vehicle.pass_m
        swaths.note(x, Pose2(x, y, 0.0), Pose2(90.0, 90.0, 0.0))
    swaths.end()


@pytest.mark.parametrize("hidden", [True, False])
def test_what_is_cut_among_stems_that_hide_it_is_a_swath(hidden: bool) -> None:
    """A turn had ended in the strip, right beside the last one. What stands beside that is the
    field's, though no picture has shown the blade in crop yet (picture field 10373)."""
    view = CropView(0.0, hidden=True) if hidden else CropView(0.0, ahead_confidence=0.2)
    context = on_side(cut_m=None, eye=Shown(view))
    cut_beside(context, 12.0)
    for k in range(1, 9):
        moved(context, 0.25 * k, stamp=NOW + k)
        context.sight.seen_at_m = context.motion.distance_m
        seeing(context, view, stamp=NOW + k)
        Follow(context).step(NOW + k)
    context.estimate.swaths.end()
    at = Pose2(0.5 + VEHICLE.blade_x_m, VEHICLE.pass_m, 0.0)
    assert context.estimate.swaths.beside(at, []) is hidden


def test_the_way_of_a_blade_over_clear_ground_is_no_swath(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    context = on_side(cut_m=0.5)
    for k in range(1, 40):
        monkeypatch.setattr(CutGuard, "clear_m", property(lambda _, k=k: 0.3 if k > 20 else 0.0))
        moved(context, 0.5 + 0.25 * k, stamp=NOW + k)
        context.strip.cut()
    context.estimate.swaths.end()
    left_m = VEHICLE.pass_m
    for along_m, beside in ((3.0, True), (7.5, False)):
        at = Pose2(along_m + VEHICLE.blade_x_m, left_m, 0.0)
        assert context.estimate.swaths.beside(at, []) is beside


@pytest.mark.parametrize(("driven_m", "beside"), [(5.0, True), (9.5, False)])
def test_wheels_that_lose_pulses_lead_past_no_swaths_end(
    driven_m: float, beside: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The blade's guard counts the way by the drive's duty, too."""
    context = on_side(cut_m=5.0)
    cut_beside(context)
    monkeypatch.setattr(CutGuard, "driven_m", property(lambda _: driven_m))
    assert context.strip.beside_swath is beside


@pytest.mark.parametrize(
    ("along_m", "beside_m", "reason"),
    [
        (1.1, 8.0, None),
        (6.9, 7.0, SideEnd.SEEN),
        (5.0, 5.0, Followed.CROP_GONE),
        (1.1, 0.0, Followed.CROP_GONE),
    ],
)
def test_right_beside_what_it_has_cut_it_drives_to_the_end_of_a_strip_that_is_not_to_be_found(
    along_m: float, beside_m: float, reason: Reason | None
) -> None:
    """It has gone with its neighbours (random field 10697), or stands farther on."""
    sides = (PLAN.sides[0], replace(PLAN.sides[1], length_m=8.0), PLAN.sides[2])
    context = on_side(1, replace(PLAN, sides=sides), cut_m=None)
    context.strip.search_m = 1.0
    cut_beside(context, beside_m)
    moved(context, along_m)
    assert is_for(Follow(context).step(NOW)[1], reason)


@pytest.mark.parametrize(
    ("length_m", "reason"), [(8.0, Followed.CROP_GONE), (2.5, SideEnd.SEEN), (0.01, None)]
)
def test_follow_gives_up_crop_that_is_not_to_be_found(
    length_m: float, reason: Reason | None
) -> None:
    """A long side needs a person, a short one is driven along, a remnant ends the field."""
    sides = (PLAN.sides[0], replace(PLAN.sides[1], length_m=length_m), PLAN.sides[2])
    sides = sides if reason is not None else sides[:2]
    context = on_side(1, replace(PLAN, sides=sides), cut_m=None)
    context.strip.search_m = 1.0
    moved(context, 1.1)
    go = Follow(context).step(NOW)[1]
    assert is_for(go, reason or Followed.REMNANT_GONE)


@pytest.mark.parametrize("inside", [True, False])
def test_where_no_gap_lies_beside_crop_that_is_not_there_the_rest_is_gone_to(inside: bool) -> None:
    context = on_side(5 if inside else 1, cut_m=None)
    assert context.strip.outermost is not inside
    context.strip.search_m = 1.0
    moved(context, 1.1)
    go = Follow(context).step(NOW)[1]
    assert is_for(go, Standing.LEFT if inside else Followed.CROP_GONE)


def test_a_longer_strip_is_driven_along_where_it_is_next_to_nothing_of_a_large_field() -> None:
    large = replace(PLAN.sides[2], length_m=300.0)
    context = on_side(
        1,
        replace(
            PLAN,
            sides=(PLAN.sides[0], replace(PLAN.sides[1], length_m=5.0), large),
            boundary=((0.0, 0.0), (10.0, 0.0), (10.0, 300.0), (0.0, 300.0)),
        ),
        cut_m=None,
    )  # fmt: skip
    context.strip.search_m = 1.0
    moved(context, 1.1)
    assert is_for(Follow(context).step(NOW)[1], SideEnd.SEEN)


@pytest.mark.parametrize(
    ("left_m", "reason"), [(2.0, Followed.REMNANT_GONE), (4.0, Followed.CLEAR_GROUND)]
)
def test_clear_ground_where_next_to_nothing_is_left_ends_the_field(
    left_m: float, reason: Reason
) -> None:
    side = PLAN.sides[0]
    plan = replace(PLAN, sides=(replace(side, length_m=150.0), side, replace(side, length_m=0.01)))
    context = on_side(1, plan, cut_m=side.length_m - left_m)
    assert is_for(refused(context, beside=False, again=True), reason)


@pytest.mark.parametrize(
    ("left_m", "again", "reason"),
    [
        (END_REST_M - 0.1, False, SideEnd.BY_PLAN),
        (END_REST_M - 0.1, True, Followed.CLEAR_GROUND),
        (END_REST_M + 0.1, False, Followed.CLEAR_GROUND),
    ],
)
def test_clear_ground_on_a_side_that_is_all_but_driven_ends_it_once(
    monkeypatch: pytest.MonkeyPatch, left_m: float, again: bool, reason: Reason
) -> None:
    """It has crossed long clear ground, beside crop that it could not get at."""
    monkeypatch.setattr(CutGuard, "clear_m", 5.0)
    context = on_side(cut_m=PLAN.sides[0].length_m - left_m)
    context.by_plan = again
    assert is_for(refused(context, beside=False, again=True), reason)


@pytest.mark.parametrize(
    ("length_m", "reason"), [(2.5, SideEnd.BY_PLAN), (6.0, Followed.CLEAR_GROUND)]
)
def test_clear_ground_on_a_short_side_leads_on_to_the_next(
    monkeypatch: pytest.MonkeyPatch, length_m: float, reason: Reason
) -> None:
    """It may have gone with its neighbours, as one whose crop was never met."""
    monkeypatch.setattr(CutGuard, "clear_m", 5.0)
    sides = PLAN.sides[0], replace(PLAN.sides[1], length_m=length_m), PLAN.sides[2]
    context = on_side(1, replace(PLAN, sides=sides), cut_m=0.5)
    assert is_for(refused(context, beside=False, again=True), reason)


# ---- the looks, the doubt ------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [LookAtEdge, LookAtEnd])
def test_a_look_lets_the_blade_turn_until_the_machine_stands(
    kind: type[LookAtEdge] | type[LookAtEnd],
) -> None:
    context = on_side()
    context.look.begin(NOW, 5.0)
    clear_ahead(context)
    moved(context, 5.1, 0.3)
    assert kind(context).step(NOW)[0] == context.hold(blade=True)
    assert kind(context).step(NOW + STAND_S + 0.01)[0] == context.hold(blade=False), "on a slope"


def test_a_look_at_the_edge_ends_with_a_sight_or_with_its_time() -> None:
    context = on_side()
    context.look.begin(NOW, 5.0)
    context.sight.edge_at_m = 4.0
    assert is_for(LookAtEdge(context).step(NOW + LOOK_S - 0.1)[1], None)
    assert is_for(LookAtEdge(context).step(NOW + LOOK_S + 0.1)[1], EdgeLook.NO_CLEARER)
    context.sight.edge_at_m = 5.0
    assert is_for(LookAtEdge(context).step(NOW + 0.5)[1], EdgeLook.SEEN)


@pytest.mark.parametrize(
    ("index", "past_m", "again", "ends"),
    [(0, 0.3, False, True), (0, -0.3, False, False), (0, 0.3, True, False), (5, 0.3, False, False)],
)
def test_past_the_plans_end_at_the_boundary_a_look_without_an_edge_ends_the_side_once(
    index: int, past_m: float, again: bool, ends: bool
) -> None:
    """Behind a gap that was said wider, that the blade had crossed in its dust, the neighbour's
    crop stood at it without an edge (`daranti-hil beliefs --seeds 23 "gap 1.2, said 2"`)."""
    cut_m = PLAN.sides[index].length_m + past_m
    context = on_side(index, cut_m=cut_m)
    context.by_plan = again
    context.look.begin(NOW, cut_m)
    context.sight.edge_at_m = cut_m - 1.0
    go = LookAtEdge(context).step(NOW + LOOK_S + 0.1)[1]
    assert is_for(go, SideEnd.BY_PLAN if ends else EdgeLook.NO_CLEARER)


@pytest.mark.parametrize(
    ("refused", "agreed_m", "tip_m", "believes"),
    [
        (True, 0.5, 0.0, True),
        (True, 3.0, 0.0, False),
        (False, 0.5, 0.0, False),
        (True, 3.0, 6.0, True),
        (True, 3.0, 7.5, False),
    ],
)
def test_an_edge_that_is_hardly_known_is_looked_at_until_the_lane_believes_what_is_seen(
    refused: bool, agreed_m: float, tip_m: float, believes: bool
) -> None:
    """5 m along a side, behind whose inner corner another border is the edge, from tip_m before its
    end on."""
    side = replace(PLAN.sides[0], edge_end_m=tip_m)
    context = on_side(plan=replace(PLAN, sides=(side, *PLAN.sides[1:])))
    context.look.begin(NOW, 5.0)
    context.sight.edge_at_m, context.sight.agreed_m = 5.0, agreed_m
    context.estimate.lane.contradicted = refused
    look = LookAtEdge(context)
    assert is_for(look.step(NOW + LOOK_S - 0.1)[1], None if believes else EdgeLook.SEEN)
    assert is_for(look.step(NOW + LOOK_S + 0.1)[1], EdgeLook.SEEN)


@pytest.mark.parametrize(("tip_m", "shows"), [(0.0, True), (3.0, False), (6.0, True)])
def test_a_border_that_hardly_slants_is_an_edge(tip_m: float, shows: bool) -> None:
    """By 17 degrees it is none, by 9 it is followed."""
    side = replace(PLAN.sides[0], edge_begin_m=tip_m, edge_end_m=tip_m)
    for along_m in (1.0, side.length_m - 1.0):
        strip = on_side(plan=replace(PLAN, sides=(side, *PLAN.sides[1:]))).strip
        assert strip.shows_edge(along_m) is shows


def test_a_look_at_the_end_turns_into_one_at_the_edge_where_crop_goes_on() -> None:
    context = on_side(cut_m=10.0)
    context.look.begin(NOW, 10.0)
    context.bare = 1
    assert is_for(LookAtEnd(context).step(NOW)[1], EndLook.CROP_GOES_ON)
    assert context.bare == 0


@pytest.mark.parametrize(
    ("cut_m", "reason"), [(10.0, Elsewhere.AT_BOUNDARY), (5.0, EndLook.BARE_GROUND)]
)
def test_a_look_at_the_end_ends_the_side_where_the_plan_does(cut_m: float, reason: Reason) -> None:
    context = on_side(cut_m=cut_m)
    context.look.begin(NOW, cut_m)
    clear_ahead(context)
    assert is_for(LookAtEnd(context).step(NOW + 1.0)[1], reason)
    assert context.sight.ahead.end is None or reason is Elsewhere.AT_BOUNDARY


def test_looks_at_bare_ground_again_and_again_need_a_person() -> None:
    context = on_side(cut_m=5.0)
    for k in range(BARE_LOOKS + 1):
        context.look.begin(NOW, 5.0)
        clear_ahead(context)
        go = LookAtEnd(context).step(NOW + 1.0)[1]
        assert is_for(go, EndLook.BARE_GROUND if k < BARE_LOOKS else EndLook.CROP_GONE)


def test_right_beside_what_it_has_cut_bare_ground_is_driven_over() -> None:
    context = on_side(cut_m=5.0)
    cut_beside(context)
    context.bare = BARE_LOOKS
    context.look.begin(NOW, 5.0)
    clear_ahead(context)
    assert is_for(LookAtEnd(context).step(NOW + 1.0)[1], EndLook.BARE_GROUND)


def test_bare_ground_on_the_last_side_ends_the_field() -> None:
    last = len(PLAN.sides) - 1
    context = on_side(last, replace(PLAN, sides=PLAN.sides), cut_m=0.1)
    context.bare = BARE_LOOKS
    context.look.begin(NOW, 0.1)
    clear_ahead(context)
    assert is_for(LookAtEnd(context).step(NOW + 1.0)[1], EndLook.NO_CROP_LEFT)


@pytest.mark.parametrize(
    ("begins_m", "cut_m", "sigma_m", "drives"),
    [
        (2.0, 0.5, 0.45, True),
        (2.0, 0.5, 0.65, False),
        (2.0, 3.5, 0.45, False),
        (0.0, 0.5, 0.45, False),
        (0.0, 0.5, 0.2, True),
    ],
)
def test_before_a_slanting_borders_edge_begins_a_machine_goes_on_less_surely(
    begins_m: float, cut_m: float, sigma_m: float, drives: bool
) -> None:
    """Standing there it sees no more of the edge than its corner, however long: four of 160
    random fields had ended so, in their first round."""
    slanting = replace(PLAN.sides[0], edge_begin_m=begins_m)
    context = on_side(plan=replace(PLAN, sides=(slanting, *PLAN.sides[1:])), cut_m=cut_m)
    context.look.begin(NOW, context.motion.distance_m)
    context.estimate.position.less_sure(sigma_m, 0.0)
    seeing(context, CUTTING)
    assert is_for(Follow(context).step(NOW)[1], None if drives else Followed.EDGE_LOST)
    assert is_for(BackOff(context).step(NOW)[1], BackedOff.SEEN if drives else None)


def test_before_the_end_of_a_slanting_border_it_does_not() -> None:
    slanting = replace(PLAN.sides[0], length_m=4.0, edge_begin_m=1.0, edge_end_m=1.0)
    plan = replace(PLAN, sides=(slanting, *PLAN.sides[1:]))
    for before_m, drives in ((slanting.length_m - 0.5, True), (0.5, False)):
        context = on_side(plan=plan, cut_m=slanting.length_m - before_m)
        position = context.estimate.position
        position.less_sure(math.sqrt(0.45**2 - context.estimate.lane.offset_sigma_m**2), 0.0)
        seeing(context, CUTTING)
        assert context.estimate.lane.offset_sigma_m == pytest.approx(0.45, abs=0.02)
        assert is_for(BackOff(context).step(NOW)[1], BackedOff.SEEN if drives else None)


def test_back_off_goes_on_with_an_edge_that_has_stayed_in_view() -> None:
    context = on_side()
    assert is_for(BackOff(context).step(NOW)[1], BackedOff.SEEN)
    context.sight.seen.broken = NOW - RESUME_AFTER_S / 2
    assert is_for(BackOff(context).step(NOW)[1], None)


def test_back_off_backs_once_and_so_far() -> None:
    context = on_side()
    context.sight.seen.broken = NOW
    behaviour = BackOff(context)
    assert stands(behaviour.step(NOW + BACK_AFTER_S - 0.1)[0])
    late = NOW + BACK_AFTER_S + 0.1
    context.sight.usable.stamp = late
    assert stands(behaviour.step(late)[0])
    backing = behaviour.step(late)[0]
    assert (backing.speed_mps, backing.blade) == (-VEHICLE.manoeuvre_speed_mps, False)
    moved(context, 5.0 - BACK_M - 0.01)
    assert stands(behaviour.step(late)[0])
    assert stands(behaviour.step(late + 0.1)[0])
    assert context.backs == 1


def backing_off(context: Context) -> tuple[BackOff, float]:
    """A machine that has lost the edge and backs, and since when."""
    context.sight.seen.broken = NOW
    behaviour = BackOff(context)
    late = NOW + BACK_AFTER_S + 0.1
    context.sight.usable.stamp = late
    behaviour.step(late)
    assert behaviour.step(late)[0].speed_mps < 0.0
    return behaviour, late


@pytest.mark.parametrize("hidden", [True, False])
def test_back_off_backs_on_while_stems_stand_right_before_the_lens(hidden: bool) -> None:
    """What the blade has left lay just before the lens of a machine that backed once, and hid all
    for a minute (model field 11057)."""
    context = on_side()
    behaviour, late = backing_off(context)
    moved(context, 5.0 - BACK_M - 0.01)
    context.sight.view = CropView(0.0, hidden=hidden)
    assert stands(behaviour.step(late)[0])
    for waited_s, backs in ((BACK_AFTER_S - 0.1, False), (BACK_AFTER_S + 0.1, hidden)):
        context.sight.usable.stamp = late + waited_s
        behaviour.step(late + waited_s)
        assert (behaviour.step(late + waited_s)[0].speed_mps < 0.0) is backs


def test_back_off_stands_where_the_geofence_is_and_where_it_has_backed_often() -> None:
    context = on_side()
    behaviour, late = backing_off(context)
    assert behaviour.blocked(late, TOO_NEAR) is None
    assert stands(behaviour.step(late)[0])
    context.backs = BACKS
    again = BackOff(context)
    again.step(late)
    assert stands(again.step(late)[0])


@pytest.mark.parametrize(("met", "goes_on"), [(True, True), (False, False)])
def test_among_stems_that_hide_all_else_it_goes_on_only_in_a_strip_that_it_has_met(
    met: bool, goes_on: bool
) -> None:
    context = on_side(cut_m=BEGINNING_M - 0.1)
    if not met:
        context.sight.ahead.entered_at = None
    seeing(context, CropView(0.0, hidden=True))
    context.sight.seen_at_m = context.motion.distance_m
    assert context.goes_unseeing(NOW) is goes_on


@pytest.mark.parametrize("hidden", [True, False])
@pytest.mark.parametrize(("blind_m", "goes_on"), [(1.4, True), (1.6, False)])
def test_right_beside_what_it_has_cut_it_goes_on_anywhere_as_far_as_stems_can_stand(
    hidden: bool, blind_m: float, goes_on: bool
) -> None:
    """Where the plan is not sure enough, and among stems that nobody has met."""
    context = on_side(cut_m=BEGINNING_M + 1.0)
    context.sight.ahead.entered_at = None
    seeing(context, CropView(0.0, hidden=hidden))
    context.sight.seen_at_m = context.motion.distance_m - blind_m
    assert not context.goes_unseeing(NOW)
    cut_beside(context)
    assert context.goes_unseeing(NOW) is goes_on


@pytest.mark.parametrize("cut_m", [BEGINNING_M - 0.1, BEGINNING_M + 0.1])
@pytest.mark.parametrize("sees", [True, False])
def test_having_backed_it_goes_on_at_a_strips_beginning(cut_m: float, sees: bool) -> None:
    context = on_side(cut_m=cut_m)
    context.sight.seen_at_m = cut_m
    context.sight.seen.broken = NOW
    context.backs = BACKS
    behaviour = BackOff(context)
    early, late = NOW + LOOKED_S - 0.1, NOW + LOOKED_S + 0.1
    context.sight.usable.stamp = early
    assert is_for(behaviour.step(early)[1], None)
    context.sight.usable.stamp = late if sees else NOW
    own = sees and cut_m < BEGINNING_M
    assert is_for(behaviour.step(late)[1], BackedOff.OWN_CROP if own else None)


@pytest.mark.parametrize(
    ("left_m", "again", "ends"),
    [
        (BACKED_REST_M - 0.1, False, True),
        (-0.2, False, True),
        (BACKED_REST_M - 0.1, True, False),
        (BACKED_REST_M + 0.1, False, False),
    ],
)
def test_having_backed_in_vain_it_leaves_a_side_that_is_all_but_cut_once(
    left_m: float, again: bool, ends: bool
) -> None:
    context = on_side(cut_m=PLAN.sides[0].length_m - left_m)
    context.sight.seen.broken = NOW
    context.backs, context.by_plan = BACKS, again
    late = NOW + LOOKED_S + 0.1
    context.sight.usable.stamp = late
    left_m2 = context.strip.left_m2 if ends else 0.0
    assert is_for(BackOff(context).step(late)[1], SideEnd.BY_PLAN if ends else None)
    assert context.left_m2 == pytest.approx(left_m2)
    assert context.strip.index == int(ends)
    assert context.ends == [], "no picture showed it"


@pytest.mark.parametrize(("tip_m", "left_m"), [(0.0, 0.8), (1.0, 0.8), (1.0, 1.8)])
def test_before_a_slanting_end_it_leaves_what_the_tip_holds_from_where_the_edge_was_lost(
    tip_m: float, left_m: float
) -> None:
    side = replace(PLAN.sides[0], edge_end_m=tip_m)
    plan = replace(PLAN, sides=(side, *PLAN.sides[1:]))
    context = on_side(plan=plan, cut_m=side.length_m - left_m)
    context.sight.seen.broken = NOW
    back_off = BackOff(context)
    moved(context, side.length_m - left_m - BACK_M)
    late = NOW + LOOKED_S + 0.1
    context.sight.usable.stamp, context.backs = late, BACKS
    leaves = left_m < BACKED_REST_M + tip_m
    assert is_for(back_off.step(late)[1], SideEnd.BY_PLAN if leaves else None)


AT_BLADE, JUST_BEFORE, CLEAR = (
    replace(CUTTING, confidence=0.1, crop_ahead_m=ahead_m) for ahead_m in (0.0, 0.31, 1.2)
)
"""Without an edge."""


def looked(context: Context, views: Sequence[CropView], *, from_s: float = 2.1) -> Go | None:
    """What the machine does that has lost the edge and has backed often, after such pictures."""
    context.sight.seen.broken, context.backs = NOW, BACKS
    behaviour = BackOff(context)
    for k, view in enumerate(views):
        stamp = NOW + from_s + 0.1 * k
        context.sight.view, context.sight.stamp = view, stamp
        assert is_for(behaviour.step(stamp)[1], None)
    late = NOW + LOOKED_S + 0.1
    context.sight.usable.stamp = late
    return behaviour.step(late)[1]


def inside() -> Context:
    """Past the beginning of a strip, where the plan's word alone leads on."""
    return on_side(cut_m=BEGINNING_M + 0.5)


@pytest.mark.parametrize(
    ("views", "goes_on"),
    [
        ([AT_BLADE] * 20, True),
        ([AT_BLADE, JUST_BEFORE, JUST_BEFORE] * 7, True),
        ([AT_BLADE, *[JUST_BEFORE] * 4] * 5, False),
        ([*[AT_BLADE] * 7, *[CLEAR] * 3] * 2, False),
        ([AT_BLADE] * 9, False),
        ([replace(AT_BLADE, ahead_confidence=0.2)] * 20, False),
        ([CropView(0.0, hidden=True)] * 20, False),
    ],
)
def test_crop_that_stands_at_the_blade_in_a_look_is_cut_on_for_half_a_metre(
    views: Sequence[CropView], goes_on: bool
) -> None:
    context = inside()
    assert is_for(looked(context, views), BackedOff.GOES_ON if goes_on else None)
    lost_at_m = context.motion.distance_m
    context.sight.seen.stamp = NOW - STOP_AFTER_S - 0.1
    for on_m, goes in ((CREEP_M - 0.05, goes_on), (CREEP_M + 0.05, False)):
        moved(context, lost_at_m + on_m, stamp=NOW + on_m)
        assert is_for(Follow(context).step(NOW)[1], None if goes else Followed.EDGE_LOST)


def test_pictures_in_the_blades_dust_are_no_such_look() -> None:
    assert is_for(looked(inside(), [AT_BLADE] * 15, from_s=0.1), None)


def test_pictures_from_where_it_has_backed_to_are_no_such_look() -> None:
    """What they show at the blade was cut before."""
    context = inside()
    behaviour, late = backing_off(context)
    moved(context, context.motion.distance_m - BACK_M - 0.01, stamp=late)
    for k in range(20):
        stamp = late + 0.1 * (k + 1)
        context.sight.view, context.sight.stamp = AT_BLADE, stamp
        behaviour.step(stamp)
    later = NOW + LOOKED_S + 0.1
    context.sight.usable.stamp = later
    assert is_for(behaviour.step(later)[1], None)


def test_after_a_pause_a_look_counts_anew() -> None:
    context = inside()
    context.sight.seen.broken, context.backs = NOW, BACKS
    behaviour = BackOff(context)
    for k in range(20):
        context.sight.view, context.sight.stamp = AT_BLADE, NOW + 2.1 + 0.1 * k
        behaviour.step(context.sight.stamp)
    behaviour.paused(NOW + 5.0)
    late = NOW + 5.0 + LOOKED_S + 0.1
    context.sight.usable.stamp = late
    assert is_for(behaviour.step(late)[1], None)


@pytest.mark.parametrize(
    ("pictures", "face_m", "hidden", "goes_on"),
    [
        (FROM_BEHIND_PICTURES, 0.0, True, True),
        (FROM_BEHIND_PICTURES, STANDS_M - 0.05, True, True),
        (FROM_BEHIND_PICTURES, STANDS_M + 0.05, True, False),
        (FROM_BEHIND_PICTURES, LEAST_ON_M - CREEP_M - 0.05, True, False),
        (FROM_BEHIND_PICTURES - 1, 0.0, True, False),
        (FROM_BEHIND_PICTURES, 0.0, False, False),
    ],
)
def test_among_stems_it_goes_on_where_a_look_from_farther_back_has_shown_crop(
    pictures: int, face_m: float, hidden: bool, goes_on: bool
) -> None:
    """`face_m`: where that stood, from where the edge was lost (picture field 10423)."""
    context = inside()
    lost_m = context.motion.distance_m
    behaviour, late = backing_off(context)
    moved(context, lost_m - BACK_M - 0.01, stamp=late)
    behaviour.step(late)
    ahead_m = lost_m + face_m - context.motion.distance_m
    for k in range(pictures):
        context.sight.view = replace(AT_BLADE, crop_ahead_m=ahead_m)
        context.sight.stamp = late + 0.1 * (k + 1)
        behaviour.step(context.sight.stamp)
    moved(context, lost_m, stamp=late + 2.0)
    context.since = late + 2.0
    again, stood = BackOff(context), late + 2.0 + SETTLE_S + 0.1
    context.sight.view, context.sight.stamp = CropView(0.0, hidden=hidden), stood
    context.sight.usable.stamp = stood
    assert is_for(again.step(stood - 0.2)[1], None), "it may still settle"
    assert is_for(again.step(stood)[1], BackedOff.GOES_ON if goes_on else None)
    if goes_on:
        for on_m, goes in ((CREEP_M - 0.05, True), (CREEP_M + 0.05, False)):
            moved(context, lost_m + face_m + on_m, stamp=stood + 1.0 + on_m)
            assert context.creeps(stood) is goes


def test_each_time_that_it_goes_on_unseeing_it_may_back_once_more() -> None:
    context = inside()
    context.backs, context.crept = BACKS, 1
    backing_off(context)
    assert context.backs == BACKS + 1


def test_what_a_look_from_farther_back_has_shown_is_forgotten_on_another_side() -> None:
    context = inside()
    context.stands_at_m = context.motion.distance_m
    context.begin_strip()
    assert context.stands_at_m == -math.inf


def test_it_creeps_only_in_crop_that_it_has_met() -> None:
    context = inside()
    context.sight.ahead.entered_at = None
    assert is_for(looked(context, [AT_BLADE] * 20), None)


def test_it_creeps_so_often_on_a_side_and_with_a_lane_known_so_well() -> None:
    context = inside()
    context.crept = CREEPS
    assert is_for(looked(context, [AT_BLADE] * 20), None)
    context.begin_strip()
    assert context.crept == 0
    context = inside()
    context.estimate.position.less_sure(CREEP_SIGMA_M + 0.1, 0.0)
    assert is_for(looked(context, [AT_BLADE] * 20), None)


def test_it_creeps_with_eyes_open_only() -> None:
    context = inside()
    assert is_for(looked(context, [AT_BLADE] * 20), BackedOff.GOES_ON)
    moved(context, context.motion.distance_m + 0.1, stamp=NOW)
    late = context.sight.usable.stamp + STOP_AFTER_S + 0.1
    assert is_for(Follow(context).step(late)[1], Followed.EDGE_LOST)


@pytest.mark.parametrize(
    ("backs", "blind_m", "cut_m", "lost"),
    [
        (1, BLIND_ON_M - 0.1, 2.0, False),
        (1, BLIND_ON_M + 0.1, 2.0, True),
        (0, BLIND_ON_M - 0.1, 2.0, True),
        (1, BLIND_ON_M - 0.1, BEGINNING_M + 0.1, True),
    ],
)
def test_only_there_and_having_backed_it_drives_on_unseeing(
    backs: int, blind_m: float, cut_m: float, lost: bool
) -> None:
    context = on_side(cut_m=cut_m)
    context.backs = backs
    context.sight.seen.stamp = NOW - STOP_AFTER_S - 0.1
    context.sight.seen_at_m = context.motion.distance_m - blind_m
    assert is_for(Follow(context).step(NOW)[1], Followed.EDGE_LOST if lost else None)


@pytest.mark.parametrize("kind", [BackOff, WaitForCamera])
def test_a_hesitation_ends_with_a_person_or_with_the_last_remnant(
    kind: type[BackOff] | type[WaitForCamera],
) -> None:
    context = on_side()
    context.reason = "the edge is lost: dust"
    command, go = kind(context).step(NOW + GIVE_UP_S + 0.1)
    assert command.request is Request.STOP
    assert is_for(go, Patience.GAVE_UP)
    assert go is not None and "dust" in go.text
    remnant = replace(PLAN, sides=(*PLAN.sides, replace(PLAN.sides[-1], length_m=0.1)))
    context = on_side(len(PLAN.sides), remnant)
    assert is_for(kind(context).step(NOW + GIVE_UP_S + 0.1)[1], Patience.REMNANT)


@pytest.mark.parametrize("seen", [True, False])
def test_only_a_lane_that_pictures_tell_of_tells_of_the_place(seen: bool) -> None:
    """Else dead reckoning would confirm itself, every half metre anew."""
    eye = Shown(replace(CUTTING, confidence=0.95 if seen else 0.0))
    context = on_side(cut_m=5.0, eye=eye)
    follow = Follow(context)
    before = context.estimate.position.against_lane()[2]
    for k in range(1, 9):
        now = NOW + 0.2 * k
        moved(context, 5.0 + 0.1 * k, 0.5, stamp=now)
        frame = Frame(now, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, Follow.gaze, context.strip, None, now, context.look.settled)
        follow.step(now)
    after = context.estimate.position.against_lane()[2]
    assert (after < before) is seen


# ---- turns ---------------------------------------------------------------------------------------


def test_a_turn_waits_for_its_steering_and_then_drives() -> None:
    context = turning()
    turn = DriveTurn(context)
    assert context.turning is not None and context.turning.leg is not None
    while context.turning.leg.steer_rad == 0.0:
        context.turning.next(NOW)
    turn.enter(NOW)
    wanted = context.turning.leg.steer_rad
    command, go = turn.step(NOW)
    assert (command.speed_mps, command.steer_rad, go) == (0.0, wanted, None)
    context.sight.usable.stamp = NOW + STEER_TIMEOUT_S
    assert is_for(turn.step(NOW + STEER_TIMEOUT_S + 0.1)[1], Turned.STEERING_STUCK)
    assert context.telemetry is not None
    context.telemetry = replace(context.telemetry, angle_rad=wanted)
    assert abs(turn.step(NOW + 0.1)[0].speed_mps) == VEHICLE.manoeuvre_speed_mps


@pytest.mark.parametrize(("speed_mps", "goes"), [(0.15, True), (0.3, False)])
def test_a_machine_that_creeps_on_its_brake_turns_and_one_that_rolls_away_is_named(
    speed_mps: float, goes: bool
) -> None:
    context = turning()
    turn = DriveTurn(context)
    turn.enter(NOW)
    assert context.turning is not None and context.turning.leg is not None
    later = NOW + STEER_TIMEOUT_S + 0.1
    moved(context, 0.5, speed_mps, stamp=later)
    assert context.telemetry is not None
    steer = context.turning.leg.steer_rad
    context.telemetry = replace(context.telemetry, angle_rad=steer)
    context.sight.usable.stamp = later
    command, go = turn.step(later)
    if goes:
        assert go is None
        assert command.speed_mps != 0.0
    else:
        assert is_for(go, Turned.ROLLS)


def test_a_turn_that_sees_nothing_waits_for_the_camera_and_goes_on() -> None:
    context = turning()
    turn = DriveTurn(context)
    command, go = turn.step(NOW + STOP_AFTER_S + 0.1)
    assert stands(command)
    assert is_for(go, Blind.NOTHING_SEEN)
    assert go is not None and "no pictures" in go.text
    waiting = WaitForCamera(context)
    assert is_for(waiting.step(NOW + STOP_AFTER_S + 0.1)[1], None)
    seeing(context, CUTTING, stamp=NOW + 2.0)
    assert is_for(waiting.step(NOW + 2.0)[1], Waited.SEES_AGAIN)


@pytest.mark.parametrize(
    ("begins_m", "along_m", "own"),
    [(4.0, 0.5, True), (4.0, 1.5, False), (8.0, 0.5, False), (5.5, 0.5, True), (6.5, 0.5, False)],
)
def test_crop_is_the_fields_own_as_long_as_the_field_goes_on_and_the_strip_does_not_end(
    begins_m: float, along_m: float, own: bool
) -> None:
    """Of a strip of 2 m inside a field of 10 m: no belief errs by more than 3 m."""
    strip = Side(5.0, begins_m, math.pi / 2, 2.0, 0.9, fence_m=10.0 - begins_m)
    context = on_side(0, replace(PLAN, sides=(strip, strip)), cut_m=along_m)
    assert context.strip.along_m(context.motion) == pytest.approx(along_m, abs=0.01)
    assert context.strip.surely_own is own
    assert not context.strip.surely_crop
    position = context.estimate.position
    position.keep_apart(np.zeros(len(position.x)), 1e-6 * np.eye(len(position.x)), 0.3)
    assert not context.strip.surely_own, "where it may be at two places nothing beyond the strip is"


@pytest.mark.parametrize(
    ("x_m", "sigma_m", "own"), [(5.0, 0.2, True), (2.5, 0.2, False), (5.0, 0.6, False)]
)
def test_deep_inside_a_boundary_that_was_found_what_stands_is_the_fields(
    x_m: float, sigma_m: float, own: bool
) -> None:
    """On a short strip whose end is near, by more than the place errs."""
    strip = Side(x_m, 4.0, math.pi / 2, 2.0, 0.9, fence_m=2.0)
    plan = replace(PLAN, sides=(strip, strip), sigma_m=sigma_m)
    context = on_side(0, plan, cut_m=1.0)
    assert context.strip.surely_own is own
    position = context.estimate.position
    position.keep_apart(np.zeros(len(position.x)), 1e-6 * np.eye(len(position.x)), 0.3)
    assert not context.strip.surely_own


@pytest.mark.parametrize(("apart_m", "own"), [((0.4, 0.6), True), ((3.0, 0.0), False)])
@pytest.mark.parametrize("corner", [False, True])
def test_crop_is_the_fields_own_wherever_it_is_of_two_places_if_the_strip_goes_on_from_both(
    apart_m: tuple[float, float], own: bool, corner: bool
) -> None:
    """At the beginning of a strip of 10 m a machine stood for a minute, and gave up, as it might
    have been 0.8 m from there (model fields 11361 and 11362): the place or a corner."""
    context = on_side(0, replace(PLAN, sigma_m=0.1), cut_m=4.0)
    assert context.strip.surely_own and context.strip.surely_crop
    position = context.estimate.position
    apart = np.zeros(len(position.x))
    apart[CORNERS : CORNERS + 2] = apart_m
    if not corner:
        apart = np.roll(apart, -CORNERS)
    position.keep_apart(apart, 1e-6 * np.eye(len(apart)), 0.3)
    assert context.strip.surely_own is own and context.strip.surely_crop is own


@pytest.mark.parametrize(("past_bend_m", "goes"), [(-0.5, False), (1.0, True)])
def test_behind_a_bend_the_machine_may_drive_on_unseeing_as_at_a_strips_beginning(
    past_bend_m: float, goes: bool
) -> None:
    """An edge that bends leaves the picture."""
    plan = bent_plan()
    along_m = plan.sides[0].bends[0][0] + past_bend_m
    context = on_side(plan=plan, cut_m=0.0)
    assert isinstance(context.strip, PlannedStrip)
    context.strip.place(along_m)
    context.sight.seen_at_m = context.motion.distance_m
    assert context.strip.surely_own
    assert context.goes_unseeing(NOW) is goes


def after_search(turn: DriveTurn) -> None:
    """The geofence has stopped a leg; the machine stands until another way is found, or none."""
    assert turn.blocked(NOW, TOO_NEAR) is None
    for _ in range(LOOKS):
        before = turn.turning.turn
        command, go = turn.step(NOW)
        assert stands(command)
        assert go is None
        if turn.turning.turn is not before:
            return


def test_a_turn_whose_leg_the_geofence_stops_goes_another_way_to_the_same_lane() -> None:
    context = turning()
    turn = DriveTurn(context)
    before = turn.turning.turn
    after_search(turn)
    anew = turn.turning.turn
    assert anew.legs != before.legs
    assert turn.turning.leg == anew.legs[0]
    start = turn.turning.beside_lane(context.motion)
    of_lane = [
        replace(leg, value=leg.value - anew.lane_rad) if leg.goal is Goal.HEADING else leg
        for leg in anew.legs
    ]
    *_, last = driven(VEHICLE, Turn(tuple(of_lane), 0.0, 0.0, 0.0, 0.0), at=start)
    end = last.poses[-1]
    assert end.y_m == pytest.approx(0.0, abs=0.03)
    assert math.remainder(end.heading_rad, math.tau) == pytest.approx(0.0, abs=0.03)
    assert end.x_m + VEHICLE.blade_x_m < anew.crop_begins_m


def test_beside_a_lane_another_way_begins_where_pictures_have_shown_the_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    context = turning()
    context.turning = Turning(NOW, shuttle(VEHICLE, -8.0, VEHICLE.pass_m, 3.0), (0.0, 0.0, 0.0))
    assert context.turning.beside
    monkeypatch.setattr(Lane, "backwards", property(lambda _: (0.4, 0.1)))
    starts: list[Pose2] = []
    monkeypatch.setattr(turn_module, "way", lambda _, start, *__: starts.append(start))
    after_search(DriveTurn(context))
    assert len(starts) == LOOKS
    for start in starts:
        assert (start.y_m, start.heading_rad) == pytest.approx((0.4, 0.1))


def test_where_no_way_is_left_the_turn_takes_its_next_leg(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Guard, "room_around", lambda *_: None)
    context = turning()
    turn = DriveTurn(context)
    first = turn.turning.leg
    after_search(turn)
    assert turn.turning.leg is not first
    assert turn.turning.searches == 1, "and may find one from elsewhere"


@pytest.mark.parametrize(
    ("aside_m", "askew_deg", "anew"),
    [
        (0.0, 0.0, False),
        (0.25, 15.0, False),
        (0.5, 0.0, True),
        (-0.5, 0.0, True),
        (0.0, 30.0, True),
    ],
)
def test_a_turn_that_ends_off_its_lane_goes_on(
    aside_m: float, askew_deg: float, anew: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = turned()
    turn = DriveTurn(context)
    against = (aside_m, math.radians(askew_deg))
    monkeypatch.setattr(turn.turning, "against_lane", lambda _: against)
    go = turn.step(NOW)[1]
    assert is_for(go, None if anew else Turned.TURNED)
    for _ in range(LOOKS if anew else 0):
        turn.step(NOW)
    assert (turn.turning.leg is not None) is anew


def test_another_way_is_looked_for_so_often_and_then_a_person_is_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whatever edge it sees across its way is not the new lane's."""
    turn = DriveTurn(turning())
    monkeypatch.setattr(turn.turning, "against_lane", lambda _: (0.0, math.radians(80.0)))
    for _ in range(SEARCHES):
        before = turn.turning.searches
        after_search(turn)
        assert turn.turning.searches == before + 1
    while turn.turning.leg is not None:
        turn.blocked(NOW, TOO_NEAR)
    go = turn.step(NOW)[1]
    assert is_for(go, Turned.NO_ROOM)
    assert go is not None and "80 deg" in go.text


@pytest.mark.parametrize(("length_m", "over"), [(1.0, True), (9.0, False)])
def test_without_room_to_turn_to_the_last_rest_the_harvest_is_over(
    length_m: float, over: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a field of 100 m2, 0.9 m2 or 8."""
    last = replace(PLAN.sides[1], length_m=length_m)
    context = turning(replace(PLAN, sides=(PLAN.sides[0], last)))
    turn = DriveTurn(context)
    turn.turning.broken_off = True
    turn.turning.searches = SEARCHES
    while turn.turning.leg is not None:
        turn.turning.next(NOW)
    monkeypatch.setattr(turn.turning, "against_lane", lambda _: (0.0, math.radians(80.0)))
    go = turn.step(NOW)[1]
    assert is_for(go, Turned.LEFT_NO_ROOM if over else Turned.NO_ROOM)
    assert (context.left_m2 > 0.5) is over


def test_backing_along_its_lane_a_turn_is_over_where_the_geofence_ends_it() -> None:
    context = turning()
    turn = DriveTurn(context)
    while not turn.turning.backing:
        turn.turning.next(NOW)
    assert turn.turning.leg is not None
    turn.turning.against_lane = lambda _: (0.1, 0.1)  # type: ignore[method-assign]
    turn.blocked(NOW, TOO_NEAR)
    assert turn.turning.leg is None
    assert turn.turning.searches == 0


@pytest.mark.parametrize(("askew_deg", "taken"), [(0.0, True), (50.0, True), (75.0, False)])
@pytest.mark.parametrize("gaze", [DriveTurn.gaze, Search.gaze])
def test_standing_across_the_next_lane_no_edge_is_its(
    monkeypatch: pytest.MonkeyPatch, gaze: Gaze, askew_deg: float, taken: bool
) -> None:
    """Between two legs of a turn that the geofence has broken off."""
    monkeypatch.setattr(WhoseEdge, "is_lanes", lambda *_: True)
    context = turned()
    assert context.turning is not None
    against = (0.0, math.radians(askew_deg))
    monkeypatch.setattr(context.turning, "against_lane", lambda _: against)
    context.sight.edge_at_m = 0.0
    frame = Frame(NOW + 0.1, np.zeros((2, 2, 3), np.uint8))
    context.sight.take(frame, gaze, context.strip, context.turning, NOW, lambda _: True)
    assert (context.sight.edge_at_m > 0.0) is taken


def test_after_its_last_leg_a_turn_looks_for_the_crop(monkeypatch: pytest.MonkeyPatch) -> None:
    context = turned()
    assert context.turning is not None
    monkeypatch.setattr(context.turning, "against_lane", lambda _: (0.0, 0.0))
    assert is_for(DriveTurn(context).step(NOW)[1], Turned.TURNED)


@pytest.mark.parametrize(
    ("before_crop_m", "new", "approached"),
    [(0.2, False, True), (-0.3, False, False), (-0.3, True, True)],
)
def test_a_turn_that_lacked_room_is_known_to_end_inside_the_crop(
    before_crop_m: float, new: bool, approached: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a side that is still to be found nobody knows where inside is."""
    context = turned()
    monkeypatch.setattr(PlannedStrip, "new", new)
    assert context.turning is not None
    monkeypatch.setattr(context.turning, "against_lane", lambda _: (0.0, 0.0))
    monkeypatch.setattr(context.turning, "crop_expected_m", lambda *_: before_crop_m)
    DriveTurn(context).step(NOW)
    assert context.sight.ahead.approached is approached


def test_a_side_is_begun_in_line_or_from_as_far_back_as_there_is_room(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Half a metre into the gap; a metre over what has been cut."""

    def done(back_m: float, beyond_m: float, offset_m: float = 0.0, askew_deg: float = 0.0) -> bool:
        sides = (PLAN.sides[0], replace(PLAN.sides[1], back_m=back_m), *PLAN.sides[2:])
        context = turning(replace(PLAN, sides=sides))
        turning_ = context.turning
        assert turning_ is not None
        while not turning_.backing:
            turning_.next(NOW)
        heading = math.radians(askew_deg)
        offset_m -= VEHICLE.blade_x_m * math.sin(heading)
        context.estimate.lane.place(offset_m, heading, 0.1, 0.1)
        monkeypatch.setattr(turning_, "to_go", lambda *_: -beyond_m)
        return DriveTurn(context).leg_done(NOW)

    assert not done(0.0, -0.1)
    assert done(0.0, 0.1)
    assert not done(0.0, 0.1, offset_m=0.1)
    assert not done(0.0, 0.1, askew_deg=8.0)
    assert done(0.0, 0.6, offset_m=0.1)
    assert not done(2.0, 0.9, offset_m=0.1)
    assert done(2.0, 1.1, offset_m=0.1)


def test_a_machine_with_crop_at_its_blade_backs_as_far_as_its_side_may_begin(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(PlannedStrip, "begin_doubt_m", 0.8)
    at_blade = replace(CUTTING, crop_ahead_m=0.0)

    def done(view: CropView, beyond_m: float) -> bool:
        context = turning()
        turning_ = context.turning
        assert turning_ is not None
        while not turning_.backing:
            turning_.next(NOW)
        context.estimate.lane.place(0.0, 0.0, 0.1, 0.1)
        seeing(context, view)
        monkeypatch.setattr(turning_, "to_go", lambda *_: -beyond_m)
        return DriveTurn(context).leg_done(NOW)

    assert not done(at_blade, 0.7)
    assert done(at_blade, 0.9)
    assert done(replace(CUTTING, crop_ahead_m=0.3), 0.1)
    assert done(replace(at_blade, ahead_confidence=0.2), 0.1)


@pytest.mark.parametrize(
    ("before_m", "offset_m", "enough"),
    [(0.9, 0.0, True), (0.7, 0.0, False), (0.9, 0.1, False), (1.3, 0.1, True)],
)
def test_a_machine_that_sees_its_side_begin_farther_ahead_backs_no_more(
    before_m: float, offset_m: float, enough: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever is left of the way back by dead reckoning (random field 10137)."""
    context = turning()
    turning_ = context.turning
    assert turning_ is not None
    while not turning_.backing:
        turning_.next(NOW)
    context.estimate.lane.place(offset_m, 0.0, 0.1, 0.1)
    begins_at_m = context.motion.distance_m + before_m
    monkeypatch.setattr(Ahead, "begins_at_m", begins_at_m)
    monkeypatch.setattr(turning_, "to_go", lambda *_: 0.5)
    assert DriveTurn(context).leg_done(NOW) is enough


def searched(context: Context, view: CropView, pictures: int) -> list[Go]:
    """What a search makes of so many of the same picture."""
    search, out = Search(context), []
    search.enter(NOW)
    for k in range(1, pictures + 1):
        stamp = NOW + STAND_S + 0.1 * k
        seeing(context, view, stamp=stamp)
        go = search.step(stamp)[1]
        if go is not None:
            out.append(go)
    return out


def test_search_takes_crop_where_the_plan_has_it() -> None:
    context = turned()
    assert context.turning is not None
    expected = context.turning.crop_expected_m(context.motion, VEHICLE.blade_x_m)
    [go] = searched(context, replace(CUTTING, crop_ahead_m=expected), 1)
    assert is_for(go, Searched.CROP_AHEAD)
    assert context.turning is None


@pytest.mark.parametrize(("stood_s", "told"), [(3.0, True), (0.5, False)])
def test_where_its_beginning_slants_a_standing_machine_takes_the_corner_for_its_edge(
    stood_s: float, told: bool
) -> None:
    """At the blade, once its dust has settled, where the lane is doubtful (random field 10133)."""
    slanting = replace(PLAN.sides[0], edge_begin_m=1.5)
    plan = replace(PLAN, sides=(slanting, *PLAN.sides[1:]))
    at_blade = replace(CUTTING, confidence=0.9, edge_offset_m=0.1, crop_ahead_m=0.0)
    context = on_side(plan=plan, cut_m=0.3, eye=Shown(at_blade))
    for _ in range(45):
        wandered(context.estimate.position, 1.0, context.motion)
    moved(context, 0.2, stamp=NOW)
    lane = context.estimate.lane
    before_m = lane.offset_sigma_m
    frame = Frame(NOW, np.zeros((2, 2, 3), np.uint8))
    settled = context.look.settled
    context.sight.take(frame, BackOff.gaze, context.strip, None, NOW - stood_s, settled)
    assert (lane.offset_sigma_m < 0.8 * before_m) is told


def test_search_gives_an_edge_that_the_lane_refuses_longer() -> None:
    context = turned()
    unsure = replace(CUTTING, confidence=0.1)
    assert searched(context, unsure, PICTURES - 1) == []
    assert len(searched(turned(), unsure, PICTURES)) == 1


def test_search_drives_along_a_long_side_without_crop_in_view() -> None:
    context = turned()
    [go] = searched(context, replace(CUTTING, crop_ahead_m=math.inf), PICTURES)
    assert is_for(go, Searched.NOT_IN_VIEW)
    assert math.isfinite(context.strip.search_m)


def test_stems_right_before_the_lens_begin_no_strip() -> None:
    """Whatever pictures between them seem to show (random field 10167: the neighbour's)."""
    context, search = turned(), []
    hidden = CropView(0.0, hidden=True)
    clear = replace(CUTTING, crop_ahead_m=math.inf)
    behaviour = Search(context)
    behaviour.enter(NOW)
    for k in range(1, MOST_PICTURES + 2):
        stamp = NOW + STAND_S + 0.1 * k
        seeing(context, hidden if k % PICTURES == 0 or k > MOST_PICTURES else clear, stamp=stamp)
        search.append(behaviour.step(stamp)[1])
    assert all(go is None for go in search[:-1])
    assert is_for(search[-1], Searched.FARTHER_BACK)


def test_stems_right_beside_what_it_has_cut_are_the_strips_own() -> None:
    context = turned()
    context.sight.seen_at_m = context.motion.distance_m
    here, vehicle = context.motion, context.vehicle
    blade = Pose2(here.x_m, here.y_m, here.yaw_rad).ahead(vehicle.blade_x_m)
    for k in range(40):
        at = blade.ahead(0.25 * k, -vehicle.pass_m)
        context.estimate.swaths.note(0.25 * k, at, at)
    context.estimate.swaths.end()
    goes = searched(context, CropView(0.0, hidden=True), MOST_PICTURES + 1)
    assert [go.reason for go in goes] == [Searched.OWN_CROP]


@pytest.mark.parametrize(
    ("cut_m", "inside_m", "rest_m", "clear_m", "reason"),
    [
        (100.0, 0.0, 0.2, 9.0, Searched.NO_CROP_LEFT),
        (100.0, 0.0, 0.2, 3.0, Searched.NOT_IN_VIEW),
        (100.0, 0.0, 9.0, 9.0, Searched.NOT_IN_VIEW),
        (12.0, VEHICLE.pass_m, 0.2, 9.0, Searched.NO_CROP_LEFT),
        (12.0, 0.0, 0.2, 9.0, Searched.NOT_IN_VIEW),
    ],
)
def test_a_last_long_side_that_is_seen_to_be_empty_has_gone(
    cut_m: float, inside_m: float, rest_m: float, clear_m: float, reason: Reason
) -> None:
    """Late in the field or inside of strips, and next to nothing after it (random field 10113)."""
    side = replace(PLAN.sides[1], places_m=((0.0, inside_m),))
    first = replace(PLAN.sides[0], length_m=cut_m)
    sides = (first, replace(side, length_m=8.0), replace(side, length_m=rest_m))
    context = turned(replace(PLAN, sides=sides))
    assert context.turning is not None
    expected_m = context.turning.crop_expected_m(context.motion, VEHICLE.blade_x_m)
    empty = replace(CUTTING, crop_ahead_m=expected_m + clear_m)
    [go] = searched(context, empty, PICTURES)
    assert is_for(go, reason)


def test_a_turn_that_ends_past_where_the_crop_begins_searches_as_far_on_from_there() -> None:
    context = turned()
    assert context.turning is not None
    begins_m = context.turning.turn.crop_begins_m
    context.turning.turn = replace(context.turning.turn, crop_begins_m=begins_m - 2.0)
    assert context.turning.crop_expected_m(context.motion, VEHICLE.blade_x_m) < -NO_CROP_M
    searched(context, replace(CUTTING, crop_ahead_m=math.inf), PICTURES)
    assert context.strip.search_m >= NO_CROP_M


def test_search_without_a_plan_ends_the_field_where_no_crop_stands() -> None:
    context = standing()
    context.begin_strip()
    context.sight.ahead.entered_at = context.motion
    end_side(context, NOW, clear_ahead(context))
    [go] = searched(context, replace(CUTTING, crop_ahead_m=END_CLEAR_M + 9.0), PICTURES)
    assert is_for(go, Searched.NO_CROP_LEFT)


def farther_back(view: CropView) -> Context:
    """A machine that has made nothing out after the turn, and has backed to look again."""
    context = turned()
    [go] = searched(context, view, MOST_PICTURES + 1)
    assert is_for(go, Searched.FARTHER_BACK)
    turning = context.turning
    assert turning is not None and turning.leg is not None and turning.leg.reverse
    assert turning.to_go(context.motion, 0.0) == pytest.approx(LOOK_BACK_M)
    turning.next(NOW)
    return context


def test_search_that_makes_nothing_out_looks_once_from_farther_back_and_then_needs_a_person() -> (
    None
):
    """Standing, pictures err alike."""
    hazy = replace(CUTTING, ahead_confidence=0.2)
    goes = searched(farther_back(hazy), hazy, MOST_PICTURES + 1)
    assert [go.reason for go in goes] == [Searched.NOTHING_TO_SEE]


@pytest.mark.parametrize("hidden", [True, False])
def test_where_stems_stand_right_before_the_lens_it_goes_elsewhere_first(hidden: bool) -> None:
    """The turn ended inside the strip (model field 11118)."""
    view = CropView(0.0, hidden=hidden)
    [go, *_] = searched(farther_back(view), view, MOST_PICTURES + 1)
    assert is_for(go, Standing.LEFT if hidden else Searched.NOTHING_TO_SEE)


@pytest.mark.parametrize("ago_m", [LATELY_M - 0.1, LATELY_M + 0.1])
def test_where_nothing_is_made_out_a_camera_that_was_good_a_turn_ago_looks_elsewhere(
    ago_m: float,
) -> None:
    """Picture field 10377 stopped with an eighth of the field to go."""
    hazy = replace(CUTTING, ahead_confidence=0.2)
    context = farther_back(hazy)
    context.sight.seen_at_m = context.motion.distance_m - ago_m
    [go, *_] = searched(context, hazy, MOST_PICTURES + 1)
    assert is_for(go, Standing.LEFT if ago_m < LATELY_M else Searched.NOTHING_TO_SEE)


def test_where_next_to_nothing_is_left_nobody_is_called_for_it() -> None:
    """Of the plan (model field 10354 had 0.9998 of its crop cut)."""
    sides = (PLAN.sides[0], replace(PLAN.sides[1], length_m=1.5))
    context = turned(replace(PLAN, sides=sides))
    goes = searched(context, CropView(0.0, hidden=True), MOST_PICTURES + 1)
    assert [go.reason for go in goes] == [Searched.REMNANT]
    assert context.left_standing_m2 > 1.0, "it is told of"


# ---- the end -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [Finish, Fault])
def test_the_end_stays_stopped(kind: type[Finish] | type[Fault]) -> None:
    context = on_side()
    assert kind(context).step(NOW) == (Command(Request.STOP), None)
    assert not kind.gaze.looks


def test_a_plans_last_side_ends_the_field() -> None:
    context = on_side(len(PLAN.sides) - 1)
    assert is_for(end_side(context, NOW, clear_ahead(context)), SideEnd.LAST)


@pytest.mark.parametrize(
    ("shown_m2", "left_m2", "part", "told"),
    [(0.0, 0.9, False, None), (0.0, 4.0, False, Over.SOME_LEFT), (0.0, 0.0, True, Over.MUCH_LEFT),
     (5.0, 5.0, False, None)],
)  # fmt: skip
def test_what_a_plan_searches_does_not_reach_is_told_at_its_end(
    shown_m2: float, left_m2: float, part: bool, told: Over | None
) -> None:
    """Of a field of 100 m2, next to nothing is not, nor what the first plan had shown."""
    context = on_side(plan=replace(PLAN, leftover_m2=shown_m2))
    parts = (((0.0, 0.0), (5.0, 0.0), (5.0, 5.0), (0.0, 5.0)),) if part else ()
    context.plan = replace(PLAN, leftover_m2=left_m2, parts=parts)
    context.remains.over = True
    go = over(context, SideEnd.LAST.go())
    assert is_for(go, told or SideEnd.LAST)


# ---- what the plan has left standing -------------------------------------------------------------


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
    return on_side(len(plan.sides) - 1, plan)


def test_at_the_plans_end_what_stands_by_the_blades_way_is_looked_for() -> None:
    go = over(at_plans_end(), SideEnd.LAST.go())
    assert is_for(go, Standing.LEFT)
    assert go.text.startswith(SideEnd.LAST.text)
    for plan in (replace(PLAN, done=1), replace(PLAN, gap_m=None)):
        assert is_for(over(at_plans_end(plan), SideEnd.LAST.go()), SideEnd.LAST)


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


def test_gather_goes_to_what_stands() -> None:
    context = gathering()
    before = context.plan
    assert is_for(chosen(context), Gathered.STRIP)
    side = context.strip.plan.sides[context.strip.index]
    assert side.left_over and context.strip.last
    assert 3.5 < side.y_m < 6.5
    assert context.plan.sides[:-1] == before.sides
    assert context.plan.gathered == 1
    assert context.turning is not None and context.turning.elsewhere


@pytest.mark.parametrize("left_m2", [15.0, 30.0])
def test_more_than_the_plan_has_left_stands_where_the_machine_has_lost_its_place(
    left_m2: float,
) -> None:
    """27 m2 do, by the blade's way."""
    go = chosen(gathering(left_m2))
    assert is_for(go, Gathered.STRIP if left_m2 > 20.0 else Gathered.NOTHING)


def test_gather_ends_where_nothing_stands() -> None:
    context = gathering(but_y_m=(20.0, 21.0))
    go = chosen(context)
    assert is_for(go, Gathered.NOTHING)
    assert go.text == SideEnd.LAST.text
    assert is_for(over(context, go), Gathered.NOTHING)


def test_gather_goes_nowhere_before_it_is_known_where_the_field_lies() -> None:
    context = with_swaths(at_plans_end(replace(PLAN, sigma_m=1.5)))
    assert is_for(over(context, SideEnd.LAST.go()), Standing.LEFT)
    context.left_standing_m2 = 3.0
    assert is_for(chosen(context), Gathered.NOTHING)
    assert context.plan.gathered == 0
    assert context.left_m2 == 3.0, "as the plan has it"


def test_what_pictures_do_not_show_of_it_counts_as_cut() -> None:
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    context.remains.nothing_stands()
    context.end_gathering()
    before_m2 = context.left_m2
    other = gathering()
    assert is_for(chosen(other), Gathered.STRIP)
    other.end_gathering()
    assert other.left_m2 > before_m2 + 3.0


@pytest.mark.parametrize("left_over", [False, True])
def test_where_strips_happened_to_end_tells_no_place(left_over: bool) -> None:
    """Its crop is met 0.4 m late and ends 0.4 m early."""
    plan = replace(PLAN, sides=(replace(PLAN.sides[0], left_over=left_over), *PLAN.sides[1:]))
    context = on_side(plan=plan, cut_m=None)
    strip = context.strip
    met = []
    for at_m, tell in (
        (0.4, lambda: strip.met_begin(0.0)),
        (9.6, lambda: strip.met_end(clear_ahead(context), CUTTING, looked=False)),
    ):
        moved(context, at_m)
        context.sight.ahead.entered_at = context.motion
        before = context.estimate.position.pose
        tell()
        met.append(math.dist(before[:2], context.estimate.position.pose[:2]))
    assert (max(met) == 0.0) is left_over
    assert (min(met) > 0.01) is not left_over


def test_the_way_to_it_is_found_from_where_the_machine_stands() -> None:
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    turn = DriveTurn(context)
    turn.enter(NOW)
    for _ in range(LOOKS):
        command, go = turn.step(NOW)
        assert stands(command) and go is None
        if context.turning is not None and context.turning.leg is not None:
            break
    assert context.turning is not None and context.turning.leg is not None
    start = context.turning.beside_lane(context.motion)
    *way, back = driven(VEHICLE, context.turning.turn, at=start)
    assert back.leg.follow is Along.NEW_LANE
    begins_m = -VEHICLE.blade_x_m - RUN_IN_M
    assert math.hypot(start.x_m - begins_m, start.y_m) > 4.0, "it comes from far away"
    assert begins_m - ARRIVES_M - 0.01 < way[-1].poses[-1].x_m


@pytest.mark.parametrize(("gap_m", "goes"), [(2.0, True), (0.4, False)])
def test_gather_drives_along_no_border_where_the_gap_has_no_room_for_the_machine(
    gap_m: float, goes: bool
) -> None:
    """A band stands along the border that all the strips began at."""
    context = at_plans_end(replace(PLAN, gap_m=gap_m))
    for y_m in np.arange(0.45, 10.4, 0.9):
        for x, y in [at for at in row(y_m) if at[0] > 1.0]:
            context.estimate.swaths.note(100.0 * y_m + x, Pose2(x, y, 0.0), Pose2(x, y, 0.0))
        context.estimate.swaths.end()
    context.left_standing_m2 = 8.0
    assert is_for(over(context, SideEnd.LAST.go()), Standing.LEFT)
    chosen(context)
    along = [side for side in context.plan.sides if side.left_over and side.length_m > 5.0]
    assert bool(along) is goes


def test_where_no_way_leads_there_something_else_is_gathered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    asked: list[LaneTo] = []
    monkeypatch.setattr(turn_module, "way", lambda *args: asked.append(args[2]))
    turn = DriveTurn(context)
    turn.enter(NOW)
    steps = [turn.step(NOW)[1] for _ in range(LOOKS + 2)]
    assert is_for(next(go for go in steps if go is not None), Turned.NO_WAY)
    begins_m = -VEHICLE.blade_x_m - RUN_IN_M
    assert {lane.from_m for lane in asked} == {begins_m - ARRIVES_M}, "not far before the crop"
    assert len(asked) == LOOKS, "once in each room"


@pytest.mark.parametrize(
    ("view", "reverse", "y_m", "stops"),
    [
        (CUTTING, False, 9.0, True),
        (CUTTING, True, 9.0, False),
        (CUTTING, False, 5.0, False),
        (replace(CUTTING, crop_ahead_m=0.5), False, 9.0, False),
        (replace(CUTTING, ahead_confidence=0.2), False, 9.0, False),
    ],
)
def test_a_machine_that_finds_crop_where_it_has_cut_it_has_lost_its_place(
    view: CropView, reverse: bool, y_m: float, stops: bool
) -> None:
    """Six metres from where it believed to be, a machine that went to what was left drove into the
    neighbour's crop (model field 11057). Crop still stands from 4 m to 6 m."""
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    assert context.turning is not None
    turn = DriveTurn(context)
    turn.enter(NOW)
    while context.turning.leg is None:
        turn.step(NOW)
    context.turning.lay_anew((Leg(0.0, reverse, Goal.WAY, 9.0),), NOW)
    begun_m = context.motion.distance_m
    goes = []
    for k in range(30):
        stamp = NOW + 0.1 * k
        moved(context, begun_m + 0.03 * k, 0.3, stamp=stamp)
        context.estimate.position.place(Side(2.0, y_m, 0.0, 6.0, 0.9, 6.0), 0.0, 0.0, 0.0)
        seeing(context, view, stamp=stamp)
        goes.append(turn.step(stamp)[1])
    found = [(k, go) for k, go in enumerate(goes) if go is not None]
    assert bool(found) is stops
    if found:
        assert is_for(found[0][1], Turned.IN_THE_WAY)
        assert 0.03 * found[0][0] < 0.6


def test_vision_is_told_how_wide_the_gap_is() -> None:
    """Else it takes the next crop behind a gap of a metre for what dust hides at the blade."""
    shown = Shown()
    context = Context(VEHICLE, shown, replace(PLAN, gap_m=1.2))
    assert shown.gap_m == 1.2, "before it sets off"
    context.gaps.note(2, 0.8)
    context.begin_strip()
    assert shown.gap_m == pytest.approx(0.8 - SEEN_M), "as it was found"


@pytest.mark.parametrize(
    ("lost_m", "aside"),
    [(LOST_M - 0.2, False), (LOST_M + 0.5, True), (LOST_M + ASIDE_M + 0.2, False)],
)
@pytest.mark.parametrize("shown", [CropView(0.0, crop_right=True), CropView(0.0)])
def test_crop_on_the_right_leads_aside_for_as_far_as_an_edge_may_lie(
    lost_m: float, aside: bool, shown: CropView
) -> None:
    """Without a look before that; and no farther without one."""
    context = on_side(cut_m=0.5, eye=Shown(shown))
    edge_at_m = context.sight.edge_at_m
    for k in range(12):
        now = NOW + 0.1 * k
        moved(context, edge_at_m + lost_m - 0.01 * (11 - k), 0.5, stamp=now)
        frame = Frame(now, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, Follow.gaze, context.strip, None, now, context.look.settled)
    assert context.moves_aside(now) is (aside and shown.crop_right)
    assert not context.moves_aside(now + 10.0), "without eyes"


def test_a_strip_that_is_given_up_is_left_for_others_once() -> None:
    context = on_side()
    seeing(context, CUTTING, stamp=NOW + GIVE_UP_S)
    assert is_for(BackOff(context).step(NOW + GIVE_UP_S + 0.1)[1], Standing.LEFT)
    go = BackOff(context).step(NOW + GIVE_UP_S + 0.1)[1]
    assert is_for(go, Patience.GAVE_UP)


def test_stems_before_the_lens_hide_this_place_and_no_other() -> None:
    context = on_side()
    context.sight.view = CropView(0.0, hidden=True)
    assert is_for(BackOff(context).step(NOW + GIVE_UP_S + 0.1)[1], Standing.LEFT)


def test_a_strip_that_is_given_up_by_a_machine_that_has_lost_its_place_is_a_fault() -> None:
    """All the rest of the plan stands, and most of what was cut is believed to."""
    context = on_side(1)
    seeing(context, CUTTING, stamp=NOW + GIVE_UP_S)
    assert is_for(BackOff(context).step(NOW + GIVE_UP_S + 0.1)[1], Standing.LEFT)
    context.remains.planned_m2 = 0.0
    go = over(context, chosen(context))
    assert is_for(go, Over.MUCH_LEFT)
    assert "gave up" in go.text


@pytest.mark.parametrize("plan", [PLAN, replace(PLAN, sigma_m=1.5)])
def test_it_is_left_for_none_without_a_sight_or_a_place(plan: Plan) -> None:
    context = on_side(plan=plan)
    if plan is not PLAN:
        seeing(context, CUTTING, stamp=NOW + GIVE_UP_S)
    command, go = BackOff(context).step(NOW + GIVE_UP_S + 0.1)
    assert is_for(go, Patience.GAVE_UP)
    assert command.request is Request.STOP


def test_what_breaks_gathering_off_ends_the_harvest_but_for_a_fault_of_the_machine() -> None:
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    disarmed = Watched.DISARMED.go()
    assert over(context, disarmed) == disarmed
    go = over(context, Searched.NOTHING_TO_SEE.go())
    assert is_for(go, Over.MUCH_LEFT), "20 m2 of 100 stand"
    assert SideEnd.LAST.text in go.text and Searched.NOTHING_TO_SEE.text in go.text
    little = gathering(but_y_m=(20.0, 21.0))
    little.plan = replace(little.plan, gathered=1)
    assert is_for(over(little, Searched.NOTHING_TO_SEE.go()), Over.BROKEN_OFF)


def cut_elsewhere(context: Context, length_m: float) -> None:
    """The blade has cut so far on, along a row of its own."""
    begun_m = 1e4 + context.estimate.swaths.cut_m
    for x in np.arange(0.0, length_m, 0.25):
        at = Pose2(1.0 + 0.001 * x, 4.5, 0.0)
        context.estimate.swaths.note(begun_m + x, at, at)
    context.estimate.swaths.end()


def given_up(context: Context) -> Go | None:
    """A minute in doubt, and something is seen."""
    seeing(context, CUTTING, stamp=NOW + GIVE_UP_S)
    return BackOff(context).step(NOW + GIVE_UP_S + 0.1)[1]


def test_what_it_cannot_do_at_one_place_does_not_end_gathering_while_that_gets_on() -> None:
    """A strip among stems before its lens ended it with 53 m2 standing (model field 11320)."""
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    cut_elsewhere(context, GETS_ON_M - 0.5)
    assert is_for(given_up(context), Patience.GAVE_UP)
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    for gained_m, goes in ((GETS_ON_M + 0.5, True), (GETS_ON_M + 0.5, True), (0.0, False)):
        cut_elsewhere(context, gained_m)
        go = given_up(context)
        assert is_for(go, Standing.ANOTHER if goes else Patience.GAVE_UP)
        assert go is not None and "gave up" in go.text


@pytest.mark.parametrize(
    "why", [Turned.STEERING_STUCK, Turned.ROLLS, Turned.IN_THE_WAY, Searched.NOTHING_TO_SEE]
)
def test_what_no_other_place_mends_ends_gathering_however_it_got_on(why: Reason) -> None:
    """A machine whose steering sticks, whose brake does not hold, that has lost its place, or whose
    camera shows nothing wherever it is."""
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    cut_elsewhere(context, 3.0 * GETS_ON_M)
    assert is_for(over(context, why.go()), Over.MUCH_LEFT)


@pytest.mark.parametrize("long", [True, False])
def test_a_machine_that_does_not_find_what_it_gathers_has_lost_its_place_and_goes_nowhere(
    long: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It had cut around that, 5 m from where it believed to be, and went on to the neighbour's crop
    (model field 11364). So it has where the strip does not end either."""
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    cut_elsewhere(context, 3.0 * GETS_ON_M)
    context.begin_strip()
    context.sight.ahead.entered_at = context.motion
    context.regained = REGAINS
    context.by_plan = True
    monkeypatch.setattr(type(context.strip), "left_m", lambda _: 5.0)
    monkeypatch.setattr(type(context.strip), "overrun", lambda _: long)
    go = Follow(context).step(NOW)[1] if long else refused(context, beside=False)
    assert is_for(go, Followed.TOO_LONG if long else Followed.CLEAR_GROUND)
    assert go is not None and is_for(over(context, go), Over.MUCH_LEFT)


@pytest.mark.parametrize("inside", [True, False])
def test_of_a_strip_without_a_gap_beside_it_a_border_that_is_too_near_leaves_the_rest_for_later(
    inside: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And so does a turn without room. Two thirds of a field stood when the geofence stopped the
    machine between a keep-out and what it had cut (picture field 10384)."""
    context = on_side(5 if inside else 0)
    verdict = replace(TOO_NEAR, at_keep_out=False)
    stopped = Follow(context).blocked(NOW, verdict)
    assert is_for(stopped, Standing.LEFT if inside else Watched.GEOFENCE)
    assert stopped is not None and TOO_NEAR.reason in stopped.text
    turn = DriveTurn(turning())
    turn.context.strip = turn.context.planned(6 if inside else 1)
    turn.context.strip.place(0.0)
    monkeypatch.setattr(turn.turning, "against_lane", lambda _: (0.0, math.radians(80.0)))
    turn.turning.broken_off, turn.turning.searches = True, SEARCHES
    while turn.turning.leg is not None:
        turn.turning.next(NOW)
    assert is_for(turn.step(NOW)[1], Standing.LEFT if inside else Turned.NO_ROOM)


def test_a_border_too_near_to_a_strip_that_others_have_left_does_not_end_gathering() -> None:
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    cut_elsewhere(context, GETS_ON_M + 0.5)
    verdict = replace(TOO_NEAR, at_keep_out=False)
    assert is_for(Gather(context).blocked(NOW, verdict), Standing.ANOTHER)


def test_a_strip_to_which_no_way_leads_is_gone_to_from_elsewhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Three of 10 m2 each were given up within a second, from one place (model field 11320)."""
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    first = context.plan.sides[-1]
    with monkeypatch.context() as nowhere:
        nowhere.setattr(turn_module, "way", lambda *_: None)
        turn = DriveTurn(context)
        turn.enter(NOW)
        steps = [turn.step(NOW)[1] for _ in range(LOOKS + 2)]
    assert is_for(next(go for go in steps if go is not None), Turned.NO_WAY)
    assert is_for(chosen(context), Gathered.STRIP)
    assert context.plan.sides[-1] != first, "not from here"
    assert is_for(chosen(context), Gathered.STRIP)
    assert context.plan.sides[-1] == first


# ---- what pictures tell --------------------------------------------------------------------------


@pytest.mark.parametrize("doing", Doing)
def test_only_pictures_of_the_cut_itself_say_how_dusty_it_is(doing: Doing) -> None:
    context = on_side()
    moved(context, 5.1, 0.4)
    kind = BEHAVIOURS[doing]
    frame = Frame(NOW, np.zeros((2, 2, 3), np.uint8))
    context.sight.take(frame, kind.gaze, context.strip, None, NOW, context.look.settled)
    assert list(context.sight.ahead.sure) == ([True] if kind is Follow else [])


def test_over_a_slanting_border_no_edge_is_missed() -> None:
    """None is to be seen there: that says nothing of dust."""
    slanting = replace(PLAN.sides[0], edge_begin_m=3.0)
    plan = replace(PLAN, sides=(slanting, *PLAN.sides[1:]))
    for along_m, sure in ((2.0, []), (4.0, [True])):
        context = on_side(plan=plan, cut_m=along_m)
        moved(context, along_m, 0.4)
        frame = Frame(NOW, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, Follow.gaze, context.strip, None, NOW, context.look.settled)
        assert list(context.sight.ahead.sure) == sure


def test_a_lane_that_is_laid_aside_of_its_edge_has_the_edge_aside() -> None:
    context = on_side(cut_m=2.0)
    strip = context.strip
    context.estimate.position.aside = Aside(0.1, -0.02)
    edge_m = 0.1 - 0.02 * (strip.along_m(context.motion) + CUTTING.crop_ahead_m)
    view = replace(CUTTING, edge_offset_m=edge_m, edge_heading_rad=-0.02, edge_ahead_m=0.0)
    assert strip.edge_m(view, context.motion) == pytest.approx(strip.side.shift_m * -1.0)
    assert strip.edge_heading_rad(view) == pytest.approx(0.0)


@pytest.mark.parametrize("approached", [False, True])
@pytest.mark.parametrize(("begun_m", "outside_m"), [(0.1, 0.7), (0.1, 0.2), (1.5, 0.7)])
def test_beside_a_strip_that_was_begun_inside_a_tip_is_no_edge(
    begun_m: float, outside_m: float, *, approached: bool
) -> None:
    """The strip before has left one where it was begun inside as well. In such a place an edge of
    more confidence than the lane is believed after a few pictures."""
    eye = Shown(replace(CUTTING, edge_offset_m=-outside_m))
    context = on_side(cut_m=begun_m, eye=eye)
    context.estimate.lane.place(0.0, 0.0, 0.3, 0.02)
    context.sight.ahead.approached = approached
    moved(context, begun_m + 0.02, 0.3)
    for k in range(LEAP_PICTURES):
        frame = Frame(NOW + 0.1 * k, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, Search.gaze, context.strip, None, NOW, context.look.settled)
    taken = context.estimate.lane.blade_offset_m > 0.05
    assert taken is (approached or begun_m > 1.0 or outside_m < 0.3)


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("slants", [False, True])
def test_a_machine_that_went_back_for_its_crop_takes_whatever_edge_it_sees(
    slants: bool, back: bool
) -> None:
    """It was 1.2 m inside, its strip's border slanted, and for a minute all its pictures showed it
    the edge, which none believed (model field 11086)."""
    side = replace(PLAN.sides[0], edge_begin_m=2.0 if slants else 0.0)
    eye = Shown(replace(CUTTING, edge_offset_m=-0.7))
    context = on_side(plan=replace(PLAN, sides=(side, *PLAN.sides[1:])), cut_m=0.5, eye=eye)
    context.estimate.lane.place(0.0, 0.0, 0.3, 0.02)
    context.sight.ahead.approached = False
    if back:
        refused(context, beside=True)
        Regain(context).enter(NOW)
    for k in range(LEAP_PICTURES):
        moved(context, 0.52 + 0.02 * k, 0.3, stamp=NOW + 0.1 * k)
        frame = Frame(NOW + 0.1 * k, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, Regain.gaze, context.strip, None, NOW, context.look.settled)
    assert (context.estimate.lane.blade_offset_m > 0.05) is back


@pytest.mark.parametrize(
    ("before_m", "sigma_m", "taken"), [(0.8, 0.1, True), (2.5, 0.1, False), (2.5, 1.0, True)]
)
def test_an_edge_well_before_where_a_strip_can_begin_is_anothers(
    before_m: float, sigma_m: float, *, taken: bool
) -> None:
    """What a turn has passed stands at the blade; how surely the beginning is known counts."""
    eye = Shown(replace(CUTTING, edge_offset_m=0.3))
    context = on_side(cut_m=None, eye=eye)
    context.estimate.lane.place(0.0, 0.0, 0.3, 0.02)
    assert isinstance(context.strip, PlannedStrip)
    context.strip.place(-before_m, 0.3, sigma_m)
    moved(context, 0.02, 0.3)
    frame = Frame(NOW, np.zeros((2, 2, 3), np.uint8))
    context.sight.take(frame, Search.gaze, context.strip, None, NOW, context.look.settled)
    assert (context.estimate.lane.blade_offset_m < -0.05) is taken


@pytest.mark.parametrize(
    ("edges_m", "taken"),
    [
        ((-0.7, -0.7), False),
        ((-0.7, -0.7, -0.7), True),
        ((-0.7, -0.7, math.nan, -0.7), False),
        ((-0.7, -0.4, -0.7), False),
        ((-0.3,), True),
    ],
    ids=["a whim", "stays", "not sure between", "here and there", "near"],
)
def test_an_edge_far_from_a_lane_that_is_hardly_known_is_one_once_it_stays(
    edges_m: tuple[float, ...], taken: bool
) -> None:
    """One picture in a hundred had another strip's edge, and the lane moved there (random field
    10229)."""
    eye = Shown()
    context = on_side(cut_m=5.0, eye=eye)
    context.estimate.lane.place(0.0, 0.0, 0.35, 0.02)
    moved(context, 5.02, 0.3)
    for k, edge_m in enumerate(edges_m):
        sure = 0.0 if math.isnan(edge_m) else 0.9
        eye.view = replace(CUTTING, edge_offset_m=edge_m, confidence=sure)
        frame = Frame(NOW + 0.1 * k, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, Search.gaze, context.strip, None, NOW, context.look.settled)
    assert (context.estimate.lane.blade_offset_m > 0.05) is taken


# ---- all of them ---------------------------------------------------------------------------------


def test_every_behaviour_is_in_the_table_and_can_be_reached() -> None:
    assert set(BEHAVIOURS) == set(Doing)
    reached = {r.to for kind in BEHAVIOURS.values() for reasons in kind.reasons for r in reasons}
    assert reached == set(Doing) - {Doing.CONNECT}


@pytest.mark.parametrize("kind", BEHAVIOURS.values())
def test_a_pause_lets_nothing_run_out(kind: type) -> None:
    context = turning()
    behaviour = kind(context)
    behaviour.paused(NOW + 500.0)
    assert context.since == context.sight.seen.stamp == NOW + 500.0


def test_a_phase_is_what_the_operator_knows() -> None:
    hesitates = {doing for doing, kind in BEHAVIOURS.items() if kind.phase is Phase.HESITATE}
    assert hesitates == {
        Doing.WAIT_FOR_CAMERA,
        Doing.LOOK_AT_EDGE,
        Doing.LOOK_AT_END,
        Doing.BACK_OFF,
        Doing.REGAIN,
    }


# ---- retrace -------------------------------------------------------------------------------------


def bent_plan() -> Plan:
    """Two strips along one edge, which bends to the left halfway."""
    ring = [(0.0, 0.0), (7.0, 0.0), (13.0, 2.0), (13.0, 12.0), (0.0, 12.0)]
    first = spiral(ring, 0, VEHICLE, gap_m=2.0).sides[0]
    assert len(first.bends) == 1
    x, y, _ = first.pose(0.0, first.width_m)
    second = replace(first, x_m=x, y_m=y, bends=((7.0 - 0.1, first.bends[0][1]),))
    return replace(PLAN, sides=(first, second), boundary=tuple(ring))


def test_along_a_strip_that_bends_the_machine_goes_back_before_it_shuttles() -> None:
    plan = bent_plan()
    bend_m = plan.sides[0].bends[0][0]
    context = on_side(plan=plan, cut_m=plan.sides[0].length_m)
    ended = Ended(EndOfField(NOW, context.motion, 0), seen=True)
    assert is_for(leave_side(context, NOW, ended), SideEnd.BENT)
    strip = context.strip
    assert isinstance(strip, PlannedStrip)
    strip.place(bend_m + 3.0)
    retrace = Retrace(context)
    command, go = retrace.step(NOW)
    assert go is None
    assert command.speed_mps < 0.0
    assert not command.blade
    assert command.steer_rad == pytest.approx(0.0, abs=0.02), "it is on the second piece"
    strip.place(bend_m - 0.3)
    command, go = retrace.step(NOW)
    assert is_for(go, SideEnd.SEEN)
    assert command.speed_mps == 0.0
    assert context.turning is not None and context.turning.beside
    assert context.strip.index == 1


@pytest.mark.parametrize("left_m", [-0.2, 0.2])
def test_going_back_it_steers_towards_its_swath(left_m: float) -> None:
    plan = bent_plan()
    context = on_side(plan=plan, cut_m=plan.sides[0].length_m)
    end_side(context, NOW, EndOfField(NOW, context.motion, 0))
    assert isinstance(context.strip, PlannedStrip)
    context.estimate.lane.place(left_m, 0.0, 0.05, 0.02)
    context.strip.place(plan.sides[0].bends[0][0] + 3.0)
    command, _ = Retrace(context).step(NOW)
    assert command.steer_rad * left_m < 0.0


@pytest.mark.parametrize(
    ("aside_m", "turned_deg", "lost"),
    [
        (2.4, 100.0, False),
        (-2.4, -100.0, False),
        (2.7, -100.0, True),
        (-4.0, 100.0, True),
        (-4.0, 80.0, False),
    ],
)
def test_a_lane_too_far_beside_the_machine_to_be_reached_is_not_followed_in_circles(
    aside_m: float, turned_deg: float, lost: bool
) -> None:
    """It was 12 m away, and the machine drove in circles for five minutes (outline 178)."""
    context = on_side()
    context.estimate.lane.place(aside_m, math.radians(turned_deg), 0.1, 0.02)
    command, go = Follow(context).step(NOW)
    assert is_for(go, Followed.FAR) is lost
    if lost:
        assert (command.speed_mps, command.blade) == (0.0, False)
        assert go is not None and f"{abs(aside_m):.0f} m beside it" in go.text


# ---- crop beside the machine ---------------------------------------------------------------------

BESIDE = replace(
    CUTTING, confidence=0.0, edge_offset_m=math.nan, crop_ahead_m=math.inf, edge_beside_m=0.6
)
"""Nothing stands ahead, and crop beside the way."""


@pytest.mark.parametrize(("cut_m", "is_lane"), [(5.0, True), (9.5, False)])
def test_where_nothing_stands_ahead_the_edge_beside_the_way_is_the_lanes(
    cut_m: float, is_lane: bool
) -> None:
    """But where the side is about to end, what stands there is another's."""
    eye = Shown(BESIDE)
    context = on_side(cut_m=cut_m, eye=eye)
    context.estimate.position.less_sure(0.3, 0.0)
    before = context.estimate.lane.blade_offset_m
    context.sight.edge_at_m = cut_m - 0.5
    since = NOW - 10.0  # it stands, and looks
    for k in range(LEAP_PICTURES):
        frame = Frame(context.motion.stamp + 0.1 * k, np.zeros((1, 1, 3), np.uint8))
        context.sight.take(frame, LookAtEnd.gaze, context.strip, None, since, lambda _: True)
    moved_m = context.estimate.lane.blade_offset_m - before
    assert (moved_m < -0.3) is is_lane, "the lane lies left of the machine"
    assert context.sight.beside(context.motion) is is_lane


@pytest.mark.parametrize(("backed_m", "is_lane"), [(0.0, True), (0.9, True), (2.1, False)])
def test_beside_what_the_machine_has_cut_the_next_strip_stands(
    backed_m: float, is_lane: bool
) -> None:
    """It went back over that to look again, took the edge of what stood beside it for its lane's,
    and left its strip half standing (picture field 10458)."""
    context = on_side(cut_m=5.0, eye=Shown(BESIDE))
    cut, stamp = context.estimate.cut, NOW
    for k in range(1, 11):
        cut.take_picture(NOW - 0.5 + 0.01 * k, CUTTING)
    assert cut.over_cut_m == 0.0
    for k in range(1, round(backed_m / 0.03) + 1):
        stamp = NOW + 0.1 * k
        back = replace(told(-0.3, 5.0 - 0.03 * k), stamp=stamp, drive_duty=-60)
        context.estimate.take_telemetry(back)
    assert cut.over_cut_m == pytest.approx(backed_m, abs=0.3)
    context.estimate.position.less_sure(0.3, 0.0)
    before = context.estimate.lane.blade_offset_m
    context.sight.edge_at_m = 4.5 - backed_m
    for k in range(LEAP_PICTURES):
        frame = Frame(stamp + 0.1 * k, np.zeros((1, 1, 3), np.uint8))
        context.sight.take(frame, LookAtEnd.gaze, context.strip, None, NOW - 10.0, lambda _: True)
    assert (context.estimate.lane.blade_offset_m - before < -0.3) is is_lane
    assert context.sight.beside(context.motion) is is_lane


@pytest.mark.parametrize(("beside_m", "taken_m"), [(0.2, 0.2), (math.nan, 0.0)])
def test_beside_the_next_strip_the_edge_beside_the_way_counts_alone(
    beside_m: float, taken_m: float
) -> None:
    """What a picture that shows no more than that strip's flank takes for the right end of what
    stands before the blade is the border of what it shows."""
    next_m = VEHICLE.pass_m
    flank = replace(CUTTING, edge_offset_m=next_m - 0.3, edge_beside_m=next_m + beside_m)
    context = on_side(cut_m=5.0, eye=Shown(flank))
    assert isinstance(context.strip, PlannedStrip)
    context.estimate.lane.place(-next_m, 0.0, 0.05, 0.02)
    context.strip.place(5.0)
    turn = shuttle(VEHICLE, -8.0, VEHICLE.pass_m, 3.0)
    turning = Turning(NOW, turn, (0.0, 0.0, 0.0))
    assert turning.beside
    context.strip.begin_leg(turning)
    context.estimate.position.less_sure(0.5, 0.0)
    before = context.estimate.lane.blade_offset_m
    for k in range(10):
        stamp = NOW + 0.1 * k
        moved(context, 5.0 - 0.03 * k, -0.3, stamp=stamp)
        frame = Frame(stamp, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, DriveTurn.gaze, context.strip, turning, NOW, context.look.settled)
    left_m = before - context.estimate.lane.blade_offset_m
    assert left_m == pytest.approx(taken_m, abs=0.05)


@pytest.mark.parametrize(("cut_m", "ahead_m"), [(4.0, 0.0), (7.5, math.inf), (9.7, math.inf)])
def test_what_seems_to_lie_is_crop_only_where_the_plan_has_crop_beyond_doubt(
    cut_m: float, ahead_m: float
) -> None:
    """Elsewhere it may be swath, and a gap behind it."""
    view = replace(BESIDE, ahead_confidence=1.0, edge_beside_m=math.nan, lies_confidence=0.8)
    context = on_side(cut_m=cut_m, eye=Shown(view))
    frame = Frame(context.motion.stamp, np.zeros((1, 1, 3), np.uint8))
    context.sight.take(frame, Follow.gaze, context.strip, None, NOW - 10.0, lambda _: True)
    assert context.sight.view is not None
    assert context.sight.view.crop_ahead_m == ahead_m


def refused(context: Context, *, beside: bool, again: bool = False) -> Go | None:
    """What following makes of clear ground that a look has confirmed; `again`: that the machine
    came back to."""
    context.regained += again
    context.estimate.cut.refused = True
    context.sight.beside_at_m = context.motion.distance_m if beside else -math.inf
    return Follow(context).step(NOW)[1]


@pytest.mark.parametrize("beside", [True, False])
def test_clear_ground_sends_the_machine_back_twice_with_crop_beside_it_and_once_without(
    beside: bool,
) -> None:
    context = on_side(cut_m=3.0)
    assert is_for(refused(context, beside=beside), Beside.REGAIN if beside else Beside.AGAIN)
    wanted = Beside.REGAIN if beside else Followed.CLEAR_GROUND
    assert is_for(refused(context, beside=beside, again=True), wanted)
    context.regained = REGAINS
    assert is_for(refused(context, beside=beside), Followed.CLEAR_GROUND)
    context.begin_strip()
    assert context.regained == 0, "another strip"


@pytest.mark.parametrize("seen", [True, False])
@pytest.mark.parametrize("inside", [True, False])
def test_of_a_strip_without_a_gap_beside_it_the_rest_is_gone_to_before_a_person_must_see(
    inside: bool, seen: bool
) -> None:
    """Half of a field stood when clear ground ended the harvest on one of its inner strips (model
    field 11081)."""
    context = on_side(5 if inside else 0, cut_m=1.0)
    assert context.strip.outermost is not inside
    if not seen:
        seeing(context, replace(CUTTING, confidence=0.0, ahead_confidence=0.0))
    go = refused(context, beside=False, again=True)
    person = Followed.CLEAR_GROUND if seen else Followed.NOTHING_SEEN
    assert is_for(go, Standing.LEFT if inside else person)
    if inside:
        assert is_for(refused(context, beside=False), person), "once"


def test_crop_at_the_blade_with_its_edge_elsewhere_sends_the_machine_back_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(CutGuard, "beside", True)
    assert is_for(refused(on_side(cut_m=3.0), beside=False), Beside.REGAIN)


def test_a_look_that_shows_nothing_is_not_told_as_clear_ground() -> None:
    """Stems stood right before the lens (random field 10251)."""
    context = on_side(cut_m=3.0)
    stems = replace(CUTTING, confidence=0.0, ahead_confidence=0.0, reason="stems before the lens")
    seeing(context, stems)
    go = refused(context, beside=False, again=True)
    assert is_for(go, Followed.NOTHING_SEEN)
    assert go is not None
    assert "stems before the lens" in go.text


def test_it_goes_back_the_way_it_came_with_its_blade_off() -> None:
    context = on_side(cut_m=5.0)
    refused(context, beside=True)
    regain = Regain(context)
    regain.enter(NOW)
    from_m = context.motion.distance_m
    for back_m in np.arange(0.0, RUN_UP_M, 0.2).tolist():
        moved(context, from_m - back_m, stamp=NOW + 5.0 + back_m)
        command, go = regain.step(NOW + 5.0 + back_m)
        assert go is None
        assert (command.speed_mps < 0.0, command.blade, command.steer_rad) == (True, False, 0.0)
    moved(context, from_m - RUN_UP_M - 0.05, stamp=NOW + 9.0)
    command, go = regain.step(NOW + 9.0)
    assert is_for(go, Regained.BACK)
    assert command.speed_mps == 0.0
    assert not context.estimate.cut.refused


def test_it_goes_back_no_farther_than_the_geofence_lets_it() -> None:
    context = on_side(cut_m=5.0)
    refused(context, beside=True)
    regain = Regain(context)
    regain.enter(NOW)
    assert is_for(regain.blocked(NOW, TOO_NEAR), Regained.BACK)
    assert not context.estimate.cut.refused
