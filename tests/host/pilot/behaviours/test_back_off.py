"""BackOff alone: what a machine does that has lost the edge."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest

from host.pilot.behaviours.back_off import (
    BACK_AFTER_S,
    BACK_M,
    BACKS,
    BLIND_GOES,
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
from host.pilot.behaviours.follow import Follow
from host.pilot.behaviours.follow import Why as Followed
from host.pilot.context import BEGINNING_M, RESUME_AFTER_S, Context
from host.pilot.endings import SideEnd
from host.pilot.gaze import STOP_AFTER_S
from host.pilot.phase import Go
from host.vision.view import CropView
from tests.helpers.behaving import (
    CUTTING,
    NOW,
    PLAN,
    TOO_NEAR,
    VEHICLE,
    is_for,
    moved,
    on_side,
    seeing,
    stands,
)


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


@pytest.mark.parametrize(("on_m", "goes"), [(0.45, 5), (0.3, BLIND_GOES)])
def test_a_machine_that_gets_nowhere_goes_on_unseeing_a_few_times_only(
    on_m: float, goes: int
) -> None:
    """It had backed as far as it got on, for a quarter of an hour, and had gone into the
    neighbour's crop (model field 12411)."""
    context, gone = on_side(cut_m=0.0), 0
    context.backs = BACKS
    for k in range(5):
        moved(context, on_m * k, stamp=NOW + 0.01 * (k + 1))
        context.sight.seen_at_m = context.motion.distance_m
        context.sight.seen.broken = context.sight.usable.stamp = NOW
        behaviour, late = BackOff(context), NOW + LOOKED_S + 0.1
        context.sight.usable.stamp = late
        gone += is_for(behaviour.step(late)[1], BackedOff.OWN_CROP)
    assert gone == goes
    context.begin_strip()
    assert not context.blind_from_m, "another strip"


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


# ---- on by looks, without an edge ----------------------------------------------------------------


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
