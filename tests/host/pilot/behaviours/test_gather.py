"""Gather alone: what the plan has left standing is chosen, or nothing is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from host.core.frames import Pose2
from host.pilot.behaviours import turn as turn_module
from host.pilot.behaviours.gather import Why as Gathered
from host.pilot.behaviours.turn import DriveTurn
from host.pilot.behaviours.turn import Why as Turned
from host.pilot.endings import SideEnd, Standing, over
from tests.helpers.behaving import (
    LOOKS,
    NOW,
    PLAN,
    at_plans_end,
    chosen,
    gathering,
    is_for,
    row,
    with_swaths,
)


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


@pytest.mark.parametrize(("gap_m", "goes"), [(2.0, True), (0.9, False)])
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


def test_a_machine_that_gathers_keeps_half_a_metre_farther_off_the_next_crop() -> None:
    """It drives across the field by dead reckoning, and errs there by more than it says."""
    context = gathering()
    before = context.guard.permitted
    assert is_for(chosen(context), Gathered.STRIP)
    now = context.guard.permitted
    assert before is not None and now is not None
    (left, low, right, high), inner = before.bounds, now.bounds
    assert inner == pytest.approx((left + 0.5, low + 0.5, right - 0.5, high - 0.5))
    context.begin_strip()
    assert context.guard.permitted is not None
    assert context.guard.permitted.bounds == pytest.approx(inner)


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
