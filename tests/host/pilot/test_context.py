"""What the behaviours share: what a strip begins with, and where the machine goes on unseeing."""

from __future__ import annotations

from dataclasses import replace

import pytest

from host.estimate.gaps import SEEN_M
from host.pilot.context import BEGINNING_M, Context
from host.pilot.planned_strip import PlannedStrip
from host.vision.view import CropView
from tests.helpers.behaving import (
    NOW,
    PLAN,
    VEHICLE,
    Shown,
    bent_plan,
    cut_beside,
    on_side,
    seeing,
    turned,
)


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


def test_vision_is_told_how_wide_the_gap_is() -> None:
    """Else it takes the next crop behind a gap of a metre for what dust hides at the blade."""
    shown = Shown()
    context = Context(VEHICLE, shown, replace(PLAN, gap_m=1.2))
    assert shown.gap_m == 1.2, "before it sets off"
    context.gaps.note(2, 0.8)
    context.begin_strip()
    assert shown.gap_m == pytest.approx(0.8 - SEEN_M), "as it was found"
