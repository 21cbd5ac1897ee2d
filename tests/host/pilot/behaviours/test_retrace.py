"""Retrace alone: back along a strip that bends."""

from __future__ import annotations

import pytest

from host.estimate.crop_ahead import EndOfField
from host.pilot.behaviours.retrace import Retrace
from host.pilot.context import Ended
from host.pilot.endings import SideEnd, end_side, leave_side
from host.pilot.planned_strip import PlannedStrip
from tests.helpers.behaving import NOW, bent_plan, is_for, on_side


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
