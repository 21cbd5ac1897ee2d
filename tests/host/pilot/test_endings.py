"""How sides, hesitations and the harvest end: transitions that several behaviours share."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from host.core.messages import Request
from host.pilot.behaviours.back_off import BackOff
from host.pilot.behaviours.follow import Follow
from host.pilot.behaviours.gather import Gather
from host.pilot.behaviours.gather import Why as Gathered
from host.pilot.behaviours.search import Why as Searched
from host.pilot.behaviours.turn import SEARCHES, DriveTurn
from host.pilot.behaviours.turn import Why as Turned
from host.pilot.behaviours.wait_for_camera import WaitForCamera
from host.pilot.endings import GIVE_UP_S, LEFT_M2, Over, Patience, SideEnd, Standing, end_side, over
from host.pilot.guard import Watched
from host.pilot.phase import Reason
from host.pilot.remains import GETS_ON_M
from host.route.plan import Plan
from host.vision.view import CropView
from tests.helpers.behaving import (
    CUTTING,
    LEFT_MOST_M,
    LEFT_MOST_M2,
    NOW,
    PLAN,
    TOO_NEAR,
    at_plans_end,
    chosen,
    clear_ahead,
    cut_elsewhere,
    gathering,
    is_for,
    on_side,
    seeing,
    turning,
)


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


def test_at_the_plans_end_what_stands_by_the_blades_way_is_looked_for() -> None:
    go = over(at_plans_end(), SideEnd.LAST.go())
    assert is_for(go, Standing.LEFT)
    assert go.text.startswith(SideEnd.LAST.text)
    for plan in (replace(PLAN, done=1), replace(PLAN, gap_m=None)):
        assert is_for(over(at_plans_end(plan), SideEnd.LAST.go()), SideEnd.LAST)


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
