"""Regain alone: a machine that has come off its crop goes back to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from host.core.messages import Frame
from host.estimate.cut_guard import CutGuard
from host.pilot.behaviours.look_at_edge import EDGE_KNOWN_M, LookAtEdge
from host.pilot.behaviours.look_at_edge import Why as Looked
from host.pilot.behaviours.regain import RUN_UP_M, Regain
from host.pilot.behaviours.regain import Why as Regained
from host.pilot.context import STAND_S
from host.pilot.endings import GAIN_M, Beside
from host.pilot.leaps import LEAP_PICTURES
from tests.helpers.behaving import (
    CUTTING,
    NOW,
    PLAN,
    TOO_NEAR,
    Shown,
    is_for,
    moved,
    on_side,
    refused,
)


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
    context.estimate.cut.blade_stamp = NOW
    if back:
        refused(context, beside=True)
        Regain(context).enter(NOW)
    for k in range(LEAP_PICTURES):
        moved(context, 0.52 + 0.02 * k, 0.3, stamp=NOW + 0.1 * k)
        frame = Frame(NOW + 0.1 * k, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, Regain.gaze, context.strip, None, context.look.settled)
    assert (context.estimate.lane.blade_offset_m > 0.05) is back


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


def test_the_edges_that_led_it_off_its_crop_do_not_speak_against_what_a_look_shows() -> None:
    """Over three metres they had agreed with a lane that ran 9 degrees askew, and the next look's
    sure edge, half a metre aside, passed for a patch's (picture field 10655)."""
    context = on_side(cut_m=5.0)
    context.sight.agreed_m = 2.0 * EDGE_KNOWN_M
    context.estimate.lane.contradicted = True
    context.sight.edge_at_m = context.motion.distance_m
    look = LookAtEdge(context)
    context.since = NOW - 2.0 * STAND_S
    context.look.begin(NOW - 1.0, context.motion.distance_m)
    go = look.step(NOW)[1]
    assert go is not None and is_for(go, Looked.SEEN), "a patch's"
    Regain(context).enter(NOW)
    assert look.step(NOW)[1] is None, "until it is believed"


def test_each_way_back_counts_from_where_the_blade_has_cut_to(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    context, cut_m = on_side(cut_m=5.0), 4.0
    goes = []
    for on_m in (0.0, 0.0, 0.0, 1.1 * GAIN_M):
        cut_m += on_m
        monkeypatch.setattr(CutGuard, "cut_m", cut_m)
        go = refused(context, beside=True)
        goes.append(is_for(go, Beside.REGAIN))
        if goes[-1]:
            Regain(context).enter(NOW)
    assert goes == [True, True, False, True]
