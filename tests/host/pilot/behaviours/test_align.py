"""Align alone: what sets a machine off that the operator has put down, and what does not."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from host.core.messages import Turned
from host.pilot.behaviours.align import CREPT_M, SETTLE_S, SETTLED, TRUST_AFTER_S, Align
from host.pilot.behaviours.align import Why as Aligned
from host.pilot.context import Context
from host.pilot.phase import Go
from host.route.plan import Plan
from host.vision.view import CropView
from tests.helpers.behaving import CUTTING, NOW, PLAN, is_for, moved, seeing, standing, stands


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


def unsettled(*, known_to_radps: float) -> Context:
    """With a sure picture, and a gyroscope that has spoken, its offset as well known as that."""
    context = standing(PLAN)
    gyroscope = context.estimate.odometry.gyroscope
    gyroscope.take(Turned(NOW, 0.0, NOW), None, None)
    gyroscope.offset_sigma = known_to_radps
    return context


def test_align_stands_until_the_gyroscopes_offset_is_known() -> None:
    context = unsettled(known_to_radps=1.1 * SETTLED)
    align = Align(context)
    command, go = align.step(NOW)
    assert stands(command)
    assert go is None
    context.estimate.odometry.gyroscope.offset_sigma = 0.9 * SETTLED
    assert is_for(align.step(NOW + 0.1)[1], Aligned.SEEN)


def test_align_does_not_stand_for_ever_for_a_gyroscope_that_is_shaken() -> None:
    context = unsettled(known_to_radps=math.inf)
    align = Align(context)
    assert align.step(NOW)[1] is None
    seeing(context, CUTTING, stamp=NOW + 0.9 * SETTLE_S)
    assert align.step(NOW + 0.9 * SETTLE_S)[1] is None
    seeing(context, CUTTING, stamp=NOW + 1.1 * SETTLE_S)
    assert is_for(align.step(NOW + 1.1 * SETTLE_S)[1], Aligned.SEEN)


def test_align_does_not_stand_where_a_slope_lets_the_machine_creep() -> None:
    context = unsettled(known_to_radps=math.inf)
    align = Align(context)
    for come_m, goes in ((0.0, False), (0.9 * CREPT_M, False), (1.1 * CREPT_M, True)):
        moved(context, come_m, stamp=NOW + come_m)
        go = align.step(NOW + come_m)[1]
        assert is_for(go, Aligned.SEEN if goes else None)


def test_align_asks_no_more_of_a_gyroscope_that_says_nothing() -> None:
    context = standing(PLAN)
    assert not math.isfinite(context.estimate.odometry.gyroscope.stamp)
    assert is_for(Align(context).step(NOW)[1], Aligned.SEEN)


@pytest.mark.parametrize("last_m", [0.4, 0.8])
def test_where_the_crop_begins_the_middle_of_the_pictures_says(last_m: float) -> None:
    """Not the one with which the machine happens to set off."""
    context = unsettled(known_to_radps=math.inf)
    align = Align(context)
    for k, ahead_m in enumerate((0.4, 0.4, 0.0, 0.8, last_m)):
        seeing(context, replace(CUTTING, crop_ahead_m=ahead_m), stamp=NOW + 0.1 * k)
        if k == 4:
            context.estimate.odometry.gyroscope.offset_sigma = 0.0
        go = align.step(NOW + 0.1 * k)[1]
        assert is_for(go, Aligned.SEEN if k == 4 else None)
    assert context.strip.along_m(context.motion) == pytest.approx(-0.4, abs=0.01)


def test_sure_pictures_count_though_the_last_one_shows_no_end() -> None:
    """The machine has stood all the time."""
    context = unsettled(known_to_radps=math.inf)
    align = Align(context)
    views = [CUTTING, CUTTING, replace(CUTTING, confidence=0.0)]
    for k, view in enumerate(views):
        seeing(context, view, stamp=NOW + 0.1 * k)
        if k == 2:
            context.estimate.odometry.gyroscope.offset_sigma = 0.0
        go = align.step(NOW + 0.1 * k)[1]
    assert is_for(go, Aligned.SEEN)


LINED_UP = replace(CUTTING, crop_ahead_m=0.4)


def settled_after(context: Context, views: list[CropView]) -> Go | None:
    """Shown these pictures, the gyroscope's offset known with the last one: where it goes then. It
    goes nowhere before."""
    align = Align(context)
    for k, view in enumerate(views):
        seeing(context, view, stamp=NOW + 0.1 * k)
        if k + 1 == len(views):
            context.estimate.odometry.gyroscope.offset_sigma = 0.0
        command, go = align.step(NOW + 0.1 * k)
        assert stands(command)
        assert go is None or k + 1 == len(views)
    return go


@pytest.mark.parametrize(
    "views",
    [
        [LINED_UP] * 3 + [replace(CUTTING, confidence=0.3, crop_ahead_m=0.0)] * 6,
        [replace(CUTTING, edge_offset_m=0.6, crop_ahead_m=0.9)] * 3 + [LINED_UP] * 3,
    ],
    ids=["faint", "aside"],
)
def test_only_sure_pictures_with_the_edge_at_the_blade_tell_where_the_crop_begins(
    views: list[CropView],
) -> None:
    context = unsettled(known_to_radps=math.inf)
    assert is_for(settled_after(context, views), Aligned.SEEN)
    assert context.strip.along_m(context.motion) == pytest.approx(-0.4, abs=0.01)


def test_pictures_without_an_end_do_not_tell_where_the_crop_begins() -> None:
    """Where the operator is trusted, either."""
    context = standing(PLAN)
    align = Align(context)
    none = replace(CUTTING, confidence=0.0, crop_ahead_m=0.9)
    faint = replace(CUTTING, confidence=0.3, crop_ahead_m=0.4)
    views = [none, none, faint, faint]
    for k, view in enumerate(views):
        stamp = NOW + 0.1 * k + (TRUST_AFTER_S if k + 1 == len(views) else 0.0)
        seeing(context, view, stamp=stamp)
        go = align.step(stamp)[1]
    assert is_for(go, Aligned.TRUSTED)
    assert context.strip.along_m(context.motion) == pytest.approx(-0.4, abs=0.01)


def test_the_same_picture_places_the_machine_beside_its_edge() -> None:
    """The middle one, not the last."""
    near = replace(CUTTING, edge_offset_m=-0.2, crop_ahead_m=0.0)
    middle = replace(CUTTING, edge_offset_m=0.1, crop_ahead_m=0.4)
    offsets = []
    for views in ([middle], [middle, middle, near]):
        context = unsettled(known_to_radps=math.inf)
        assert is_for(settled_after(context, views), Aligned.SEEN)
        offsets.append(context.estimate.lane.blade_offset_m)
    assert offsets[0] < -0.03
    assert offsets[1] == pytest.approx(offsets[0], abs=0.001)


def test_an_unsure_picture_sends_no_machine_off_that_a_sure_one_has_shown_askew() -> None:
    context = standing(PLAN)
    align = Align(context)
    askew = replace(CUTTING, edge_offset_m=0.75, edge_heading_rad=math.nan)
    for k, view in enumerate([askew, replace(CUTTING, confidence=0.3)]):
        seeing(context, view, stamp=NOW + 0.1 * k)
        assert align.step(NOW + 0.1 * k)[1] is None


def test_one_picture_that_is_looked_at_again_counts_once() -> None:
    context = standing(PLAN)
    align = Align(context)
    seeing(context, replace(CUTTING, confidence=0.6))
    for k in range(5):
        assert align.step(NOW + 0.05 * k)[1] is None


def test_align_does_not_stand_for_a_gyroscope_that_the_steering_angle_contradicts() -> None:
    context = unsettled(known_to_radps=math.inf)
    gyroscope = context.estimate.odometry.gyroscope
    for k in range(1, 40):
        gyroscope.take(Turned(NOW + 0.1 * k, 0.01 * k, NOW), 0.0, None)
    assert gyroscope.contradicted
    assert is_for(Align(context).step(NOW)[1], Aligned.SEEN)
