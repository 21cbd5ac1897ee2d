"""LookAtEnd alone: whether a side ends where no crop is seen."""

from __future__ import annotations

from dataclasses import replace

import pytest

from host.pilot.behaviours.look_at_end import BARE_LOOKS, LookAtEnd
from host.pilot.behaviours.look_at_end import Why as EndLook
from host.pilot.endings import REGAINS, Beside, Elsewhere
from host.pilot.phase import Reason
from tests.helpers.behaving import NOW, PLAN, clear_ahead, cut_beside, is_for, on_side


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


@pytest.mark.parametrize("vain", [False, True])
def test_bare_ground_with_its_crop_beside_it_sends_the_machine_back_unless_in_vain(
    vain: bool,
) -> None:
    context = on_side(cut_m=5.0)
    context.bare, context.regained = BARE_LOOKS, [0.0] * (REGAINS * vain)
    context.sight.beside_at_m = context.motion.distance_m
    context.look.begin(NOW, 5.0)
    clear_ahead(context)
    go = LookAtEnd(context).step(NOW + 1.0)[1]
    assert is_for(go, EndLook.CROP_GONE if vain else Beside.REGAIN)


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
