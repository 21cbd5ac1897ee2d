"""Retrace alone: back along a strip that bends."""

from __future__ import annotations

import math

import pytest

from host.core.frames import Pose2
from host.estimate.crop_ahead import EndOfField
from host.estimate.swaths import Swaths
from host.pilot.behaviours.retrace import Retrace
from host.pilot.context import Ended
from host.pilot.endings import SideEnd, end_side, leave_side
from host.pilot.planned_strip import PlannedStrip
from tests.helpers.behaving import NOW, VEHICLE, bent_plan, is_for, on_side


def test_along_a_strip_that_bends_the_machine_goes_back_before_it_shuttles() -> None:
    plan = bent_plan()
    bend_m = plan.sides[0].bends[0][0]
    context = on_side(plan=plan, cut_m=plan.sides[0].length_m)
    ended = Ended(EndOfField(NOW, context.motion), seen=True)
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
@pytest.mark.parametrize("planned_left_m", [-1.0, 1.0])
def test_going_back_it_steers_towards_the_way_on_which_it_has_cut(
    left_m: float, planned_left_m: float
) -> None:
    """Not towards the strip as it was planned, beside which that may lie by a metre."""
    plan = bent_plan()
    context = on_side(plan=plan, cut_m=plan.sides[0].length_m)
    end_side(context, NOW, EndOfField(NOW, context.motion))
    assert isinstance(context.strip, PlannedStrip)
    context.estimate.lane.place(planned_left_m, 0.0, 0.05, 0.02)
    context.strip.place(plan.sides[0].bends[0][0] + 3.0)
    here = context.motion
    blade = Pose2(here.x_m, here.y_m, here.yaw_rad).ahead(VEHICLE.blade_x_m)
    for k in range(20):
        came = blade.ahead(-0.3 * (19 - k), -left_m)
        context.estimate.swaths.note(100.0 + 0.3 * k, came, came)
    command, _ = Retrace(context).step(NOW)
    assert command.steer_rad * left_m < 0.0


def test_round_a_bend_it_goes_back_as_it_came() -> None:
    """The rear axle does not go where the blade went before it."""
    axle_m, radius_m = 1.4, 6.0
    swaths = Swaths()
    turned = [0.05 * k for k in range(20)]
    axles = [Pose2(radius_m * math.sin(t), radius_m * (1.0 - math.cos(t)), t) for t in turned]
    for k, axle in enumerate(axles):
        blade = axle.ahead(axle_m)
        swaths.note(0.3 * k, blade, blade)
    for axle in axles:
        left_m, turned_rad = swaths.back(axle.ahead(axle_m, 0.0), axle_m) or (1.0, 1.0)
        assert left_m == pytest.approx(0.0, abs=0.01)
        assert turned_rad == pytest.approx(0.0, abs=0.01)
    left_m, turned_rad = swaths.back(axles[10].ahead(0.0, 0.2).ahead(axle_m), axle_m) or (0.0, 0.0)
    assert left_m == pytest.approx(0.2, abs=0.02)
    assert Swaths().back(axles[0], axle_m) is None
