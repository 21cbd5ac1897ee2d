"""A strip of the plan as the machine drives along it: what its edge, ends and way tell."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from host.core.frames import Pose2
from host.estimate.cut_guard import CutGuard
from host.estimate.measurements.begin import EARLY_M
from host.estimate.position import Aside
from host.pilot.turn_progress import Turning
from host.route.plan import Plan, spiral
from host.route.turn_legs import shuttle
from host.vision.view import CropView
from tests.helpers.behaving import (
    CUTTING,
    NOW,
    PLAN,
    VEHICLE,
    backing,
    clear_ahead,
    cut_beside,
    moved,
    on_side,
)


def test_crop_that_is_met_driving_up_to_it_stands_a_little_farther_on() -> None:
    """The detector takes it for met so long before."""
    context = on_side(1, cut_m=None)
    moved(context, -EARLY_M)
    before = context.strip.along_m(context.motion)
    context.strip.met_begin(0.0)
    assert context.strip.along_m(context.motion) == pytest.approx(before, abs=0.01)


def test_a_shuttle_that_is_broken_off_beside_its_strip_looks_at_it_from_there_no_more() -> None:
    context = on_side(cut_m=None)
    turn = shuttle(VEHICLE, -8.0, VEHICLE.pass_m, 3.0)
    context.strip.begin_leg(Turning(NOW, turn, (0.0, 0.0, 0.0)))
    assert context.estimate.position.beside
    context.begin_strip()
    assert not context.estimate.position.beside


@pytest.mark.parametrize(("early_m", "tells"), [(0.0, True), (0.8, False)])
def test_crop_whose_beginning_a_shuttle_has_pressed_down_tells_no_place(
    early_m: float, tells: bool
) -> None:
    context = on_side(1, cut_m=None)
    turn = shuttle(VEHICLE, 0.0, VEHICLE.pass_m, 3.0, early_m=early_m)
    context.strip.begin_leg(Turning(NOW, turn, (0.0, 0.0, 0.0)))
    moved(context, 1.0)
    before = context.estimate.position.pose
    context.strip.met_begin(0.0)
    assert (context.estimate.position.pose != before) is tells


@pytest.mark.parametrize(
    ("pictures_m", "turns"),
    [((), True), ((3.0, 3.0), True), ((3.0, 3.0, 3.0), False), ((0.5, 3.0, 3.0, 3.0), True)],
)
def test_where_pictures_show_clear_ground_the_blade_does_not_turn_by_the_plan_alone(
    pictures_m: tuple[float, ...], turns: bool
) -> None:
    """Beyond its field's end the machine would cut the neighbour's crop with it."""
    context = on_side(1, cut_m=None)
    assert abs(context.strip.along_m(context.motion)) < 0.1, "the plan has its crop at the blade"
    for ahead_m in pictures_m:
        view = CropView(0.9, crop_ahead_m=ahead_m, ahead_confidence=0.9)
        context.sight.ahead.sight(view, context.motion)
    assert context.strip.blade_due() is turns


@pytest.mark.parametrize(("early_m", "most_m"), [(0.0, 0.4), (1.0, 0.15)])
def test_an_edge_that_a_shuttle_has_pressed_down_counts_less(early_m: float, most_m: float) -> None:
    context = on_side(cut_m=None)
    backing(context, early_m)
    position, lane = context.estimate.position, context.estimate.lane
    position.less_sure(0.12, 0.0)
    before = lane.blade_offset_m
    for _ in range(20):
        lane.correct(0.3, math.nan, 1.0, (0.0, 0.0))
    moved_m = abs(lane.blade_offset_m - before)
    assert 0.0 < moved_m < most_m
    assert (moved_m > 0.25) is (early_m == 0.0)


def test_along_what_a_shuttle_has_pressed_down_no_edge_is_followed() -> None:
    context = on_side(cut_m=0.2)
    strip, position = context.strip, context.estimate.position
    backing(context, 1.0)
    strip.cut()
    assert position.beside
    moved(context, 1.5)
    strip.cut()
    assert not position.beside


def test_the_way_of_a_blade_over_clear_ground_is_no_swath(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    context = on_side(cut_m=0.5)
    for k in range(1, 40):
        monkeypatch.setattr(CutGuard, "clear_m", property(lambda _, k=k: 0.3 if k > 20 else 0.0))
        moved(context, 0.5 + 0.25 * k, stamp=NOW + k)
        context.strip.cut()
    context.estimate.swaths.end()
    left_m = VEHICLE.pass_m
    for along_m, beside in ((3.0, True), (7.5, False)):
        at = Pose2(along_m + VEHICLE.blade_x_m, left_m, 0.0)
        assert context.estimate.swaths.beside(at, []) is beside


@pytest.mark.parametrize(("driven_m", "beside"), [(5.0, True), (9.5, False)])
def test_wheels_that_lose_pulses_lead_past_no_swaths_end(
    driven_m: float, beside: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The blade's guard counts the way by the drive's duty, too."""
    context = on_side(cut_m=5.0)
    cut_beside(context)
    monkeypatch.setattr(CutGuard, "driven_m", property(lambda _: driven_m))
    assert context.strip.beside_swath is beside


@pytest.mark.parametrize("left_over", [False, True])
def test_where_strips_happened_to_end_tells_no_place(left_over: bool) -> None:
    """Its crop is met 0.4 m late and ends 0.4 m early."""
    plan = replace(PLAN, sides=(replace(PLAN.sides[0], left_over=left_over), *PLAN.sides[1:]))
    context = on_side(plan=plan, cut_m=None)
    strip = context.strip
    met = []
    for at_m, tell in (
        (0.4, lambda: strip.met_begin(0.0)),
        (9.6, lambda: strip.met_end(clear_ahead(context), CUTTING, looked=False)),
    ):
        moved(context, at_m)
        context.sight.ahead.entered_at = context.motion
        before = context.estimate.position.pose
        tell()
        met.append(math.dist(before[:2], context.estimate.position.pose[:2]))
    assert (max(met) == 0.0) is left_over
    assert (min(met) > 0.01) is not left_over


def round_field() -> Plan:
    """A round field as its owner has walked it, from a point of its arc on."""
    angles = np.arange(30) * math.tau / 30
    ring = [(17.0 * math.cos(a), 17.0 * math.sin(a)) for a in angles]
    return spiral(ring, 0, VEHICLE, gap_m=2.0, sigma_m=0.3, recorded=True)


def test_where_the_machine_was_put_into_its_crop_nothing_begins() -> None:
    """It had backed by a metre, and took what it then met for the side's beginning."""
    for plan, tells in ((replace(PLAN, sigma_m=1.0), True), (round_field(), False)):
        context = on_side(plan=plan, cut_m=None)
        moved(context, -1.0)
        before = context.estimate.position.pose
        context.strip.met_begin(0.0)
        assert (context.estimate.position.pose != before) is tells


@pytest.mark.parametrize("back", [0, 1])
def test_a_round_that_closes_where_it_was_begun_ends_where_that_was_to_a_metre(back: int) -> None:
    """However surely its corners are known, other than the sides before it."""
    plan = replace(round_field(), sigma_m=0.05)
    closing = max(k for k, side in enumerate(plan.sides) if side.edges and side.inside_m < 0.1)
    strip = on_side(closing - back, plan=plan, cut_m=2.0).strip
    assert strip.may_end_at(strip.left_m() + 2.0 - 4.0) is (back == 0)
    assert math.isfinite(strip.to_blind_end_m()) is (back == 0), "crop goes on there"


def test_up_to_there_it_follows_its_edge() -> None:
    plan = round_field()
    closing = max(k for k, side in enumerate(plan.sides) if side.edges and side.inside_m < 0.1)
    strip = on_side(closing, plan=plan, cut_m=2.0).strip
    end_m = strip.left_m() + strip.along_m(strip.estimate.motion)
    assert strip.shows_edge(end_m - 2.5)
    assert not strip.shows_edge(end_m - 1.5)


def test_such_an_end_tells_the_place_of_the_machine_no_better() -> None:
    """Here it is met a metre early by a machine that knows its place to a metre."""
    plan = replace(round_field(), sigma_m=0.05)
    closing = max(k for k, side in enumerate(plan.sides) if side.edges and side.inside_m < 0.1)
    context = on_side(closing, plan=plan)
    strip = context.strip
    strip.place(strip.along_m(context.motion) + strip.left_m() - 1.0, along_sigma_m=1.0)
    assert strip.left_m() == pytest.approx(1.0)
    strip.met_end(clear_ahead(context), CUTTING, looked=False)
    assert 0.4 < strip.left_m() < 0.8


def test_a_lane_that_is_laid_aside_of_its_edge_has_the_edge_aside() -> None:
    context = on_side(cut_m=2.0)
    strip = context.strip
    context.estimate.position.aside = Aside(0.1, -0.02)
    edge_m = 0.1 - 0.02 * (strip.along_m(context.motion) + CUTTING.crop_ahead_m)
    view = replace(CUTTING, edge_offset_m=edge_m, edge_heading_rad=-0.02, edge_ahead_m=0.0)
    assert strip.edge_m(view, context.motion) == pytest.approx(strip.side.shift_m * -1.0)
    assert strip.edge_heading_rad(view) == pytest.approx(0.0)
