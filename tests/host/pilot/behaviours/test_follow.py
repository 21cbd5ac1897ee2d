"""Follow alone: how a side is cut and where it ends, and what makes the machine stop on it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from host.core.frames import Pose2
from host.core.messages import Frame, Request
from host.estimate.cut_guard import CutGuard
from host.pilot.behaviours.follow import END_REST_M, SPIN_S, STARTS_M, STARTS_S, Follow
from host.pilot.behaviours.follow import Why as Followed
from host.pilot.behaviours.gather import Why as Gathered
from host.pilot.context import BEGINNING_M, BLIND_ON_M, PAST_LEFT_M, SLOW_AFTER_S
from host.pilot.endings import (
    GAIN_M,
    REGAINS,
    Beside,
    Elsewhere,
    Over,
    SideEnd,
    Standing,
    over,
)
from host.pilot.gaze import STOP_AFTER_S
from host.pilot.guard import Watched
from host.pilot.phase import Reason
from host.pilot.remains import GETS_ON_M
from host.pilot.sight import UNSEEN_M
from host.route.plan import spiral
from host.route.side import Side
from host.vision.view import CropView
from tests.helpers.behaving import (
    AT_KEEP_OUT,
    CUTTING,
    LEFT_MOST_M,
    NOW,
    PLAN,
    TOO_NEAR,
    VEHICLE,
    Shown,
    chosen,
    clear_ahead,
    cut_beside,
    cut_elsewhere,
    gathering,
    is_for,
    moved,
    on_side,
    refused,
    seeing,
    stands,
    turned_to,
)


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


@pytest.mark.parametrize(
    ("come_m", "unseen_s", "lost"),
    [
        (0.05, STOP_AFTER_S + 0.1, False),
        (-0.05, STARTS_S - 0.1, False),
        (0.05, STARTS_S + 0.1, True),
        (STARTS_M + 0.05, STOP_AFTER_S + 0.1, True),
        (-STARTS_M - 0.05, STOP_AFTER_S + 0.1, True),
    ],
)
def test_a_machine_that_has_not_begun_to_move_has_time_to_break_away_before_its_edge_is_lost(
    come_m: float, unseen_s: float, lost: bool
) -> None:
    context = on_side()
    context.sight.seen.stamp = NOW - unseen_s
    context.sight.seen_at_m = context.motion.distance_m - come_m
    assert is_for(Follow(context).step(NOW)[1], Followed.EDGE_LOST if lost else None)


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


# ---- keep-outs, the geofence ---------------------------------------------------------------------


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


def test_past_a_keep_out_it_turns_once_on_a_strip() -> None:
    context = turned_to(7.0)
    assert is_for(Follow(context).blocked(NOW, AT_KEEP_OUT), Beside.PAST)
    context.begin_strip()
    assert is_for(Follow(context).blocked(NOW, AT_KEEP_OUT), SideEnd.KEEP_OUT)


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


# ---- crop that is not to be found, clear ground --------------------------------------------------


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


@pytest.mark.parametrize("beside", [True, False])
def test_clear_ground_sends_the_machine_back_twice_with_crop_beside_it_and_once_without(
    beside: bool,
) -> None:
    context = on_side(cut_m=3.0)
    assert is_for(refused(context, beside=beside), Beside.REGAIN if beside else Beside.AGAIN)
    wanted = Beside.REGAIN if beside else Followed.CLEAR_GROUND
    assert is_for(refused(context, beside=beside, again=True), wanted)
    context.regained = [0.0] * REGAINS
    assert is_for(refused(context, beside=beside), Followed.CLEAR_GROUND)
    context.begin_strip()
    assert not context.regained, "another strip"


@pytest.mark.parametrize(
    ("beside", "off_m", "waits"), [(False, 0.4, True), (True, 0.4, False), (True, 0.7, True)]
)
def test_a_machine_beside_its_crop_drives_to_where_it_sees_its_edge(
    beside: bool, off_m: float, waits: bool
) -> None:
    """It stood 0.9 m beside the next strip, and a minute's looks made it no surer (model field
    12325). What is not known by so much is looked for all the same."""
    context = on_side(cut_m=3.0)
    context.estimate.lane.place(0.0, 0.0, off_m, 0.02)
    context.sight.beside_at_m = context.motion.distance_m if beside else -math.inf
    assert is_for(Follow(context).step(NOW)[1], Followed.EDGE_LOST if waits else None)


@pytest.mark.parametrize(("on_m", "may"), [(0.9 * GAIN_M, False), (1.1 * GAIN_M, True)])
def test_a_machine_that_has_cut_on_may_go_back_to_its_crop_again(
    on_m: float, may: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It had come off its first slanting edge twice, cut three metres on, came off once more and
    stopped for good (picture field 10655)."""
    context = on_side(cut_m=3.0)
    context.regained = [3.0] * REGAINS
    monkeypatch.setattr(CutGuard, "cut_m", 3.0 + on_m)
    goes_back = refused(context, beside=True), refused(context, beside=False)
    for go, why in zip(goes_back, (Beside.REGAIN, Beside.AGAIN), strict=True):
        assert is_for(go, why if may else Followed.CLEAR_GROUND)


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
    context.regained = [0.0] * REGAINS
    context.by_plan = True
    monkeypatch.setattr(type(context.strip), "left_m", lambda _: 5.0)
    monkeypatch.setattr(type(context.strip), "overrun", lambda _: long)
    go = Follow(context).step(NOW)[1] if long else refused(context, beside=False)
    assert is_for(go, Followed.TOO_LONG if long else Followed.CLEAR_GROUND)
    assert go is not None and is_for(over(context, go), Over.MUCH_LEFT)


# ---- little or nothing seen of the edge ----------------------------------------------------------


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
        context.sight.take(frame, Follow.gaze, context.strip, None, context.look.settled)
        follow.step(now)
    after = context.estimate.position.against_lane()[2]
    assert (after < before) is seen


@pytest.mark.parametrize(
    ("turned_deg", "cut_m", "for_m", "astray"),
    [
        (25.0, 5.0, 2.0, False),
        (35.0, 5.0, 1.1, True),
        (-35.0, 5.0, 1.1, True),
        pytest.param(35.0, 5.0, 0.8, False, id="its edge may lie aside"),
        pytest.param(50.0, 5.0, 0.0, True, id="but not so far"),
        pytest.param(50.0, 2.0, 0.0, False, id="as a turn may have left it"),
    ],
)
def test_an_edge_that_leads_away_from_the_strip_is_not_its_own(
    turned_deg: float, cut_m: float, for_m: float, astray: bool
) -> None:
    """By 40 and 60 degrees the neighbour's have led machines that had lost their place."""
    context = on_side(cut_m=cut_m)
    follow = Follow(context)
    follow.step(NOW)
    moved(context, cut_m + for_m, 0.3)
    context.estimate.lane.place(0.0, math.radians(turned_deg), 0.1, 0.02)
    command, go = follow.step(NOW)
    assert is_for(go, Followed.ASTRAY) is astray
    if astray:
        assert (command.speed_mps, command.blade) == (0.0, False)
        assert go is not None and f"turned {turned_deg:.0f} deg" in go.text


def test_a_machine_that_has_turned_to_its_edge_and_back_is_not_astray() -> None:
    context = on_side(cut_m=5.0)
    follow = Follow(context)
    for way_m, turned_deg in ((0.0, 0.0), (0.8, 35.0), (1.0, 20.0), (1.6, 35.0)):
        moved(context, 5.0 + way_m, 0.3)
        context.estimate.lane.place(0.0, math.radians(turned_deg), 0.1, 0.02)
        assert not is_for(follow.step(NOW)[1], Followed.ASTRAY)
    assert is_for(Follow(context).step(NOW)[1], Followed.ASTRAY), "a doubt is no fresh start"


@pytest.mark.parametrize(("x_m", "astray"), [(5.0, False), (2.5, True)])
def test_deep_inside_the_field_a_machine_may_turn_after_a_remnant(x_m: float, astray: bool) -> None:
    """In a square of 10 m."""
    strip = Side(x_m, 2.0, math.pi / 2, 6.0, 0.9, fence_m=8.0)
    plan = replace(PLAN, sides=(strip, strip), sigma_m=0.2)
    context = on_side(plan=plan, cut_m=3.2)
    context.estimate.position.place(strip, 3.2, 0.0, math.radians(46.0))
    assert is_for(Follow(context).step(NOW)[1], Followed.ASTRAY) is astray


def test_where_the_strip_itself_bends_so_far_it_may_turn() -> None:
    bent = [(0.0, 0.0), (20.0, 0.0), (26.0, -2.18), (30.0, 10.0), (0.0, 10.0)]
    plan = spiral(bent, 0, VEHICLE, gap_m=2.0)
    assert plan.sides[0].bends
    context = on_side(plan=plan)
    context.estimate.lane.place(0.0, math.radians(35.0), 0.1, 0.02)
    assert not is_for(Follow(context).step(NOW)[1], Followed.ASTRAY)


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
