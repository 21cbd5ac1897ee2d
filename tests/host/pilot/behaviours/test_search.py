"""Search alone: what is made of the pictures after a turn."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from host.core.frames import Pose2
from host.estimate.crop_ahead import END_CLEAR_M
from host.pilot.behaviours.follow import Follow
from host.pilot.behaviours.search import MOST_PICTURES, PICTURES, Search
from host.pilot.behaviours.search import Why as Searched
from host.pilot.context import STAND_S, Context
from host.pilot.endings import SideEnd, Standing, end_side
from host.pilot.phase import Go, Reason
from host.pilot.plan_side import NO_CROP_M
from host.pilot.sight import LATELY_M
from host.pilot.turn_progress import LOOK_BACK_M
from host.vision.view import CropView
from tests.helpers.behaving import (
    AT_KEEP_OUT,
    CUTTING,
    NOW,
    PLAN,
    VEHICLE,
    clear_ahead,
    is_for,
    seeing,
    standing,
    turned,
    turned_to,
)


def searched(context: Context, view: CropView, pictures: int) -> list[Go]:
    """What a search makes of so many of the same picture."""
    search, out = Search(context), []
    search.enter(NOW)
    for k in range(1, pictures + 1):
        stamp = NOW + STAND_S + 0.1 * k
        seeing(context, view, stamp=stamp)
        go = search.step(stamp)[1]
        if go is not None:
            out.append(go)
    return out


def test_search_takes_crop_where_the_plan_has_it() -> None:
    context = turned()
    assert context.turning is not None
    expected = context.turning.crop_expected_m(context.motion, VEHICLE.blade_x_m)
    [go] = searched(context, replace(CUTTING, crop_ahead_m=expected), 1)
    assert is_for(go, Searched.CROP_AHEAD)
    assert context.turning is None


def test_search_gives_an_edge_that_the_lane_refuses_longer() -> None:
    context = turned()
    unsure = replace(CUTTING, confidence=0.1)
    assert searched(context, unsure, PICTURES - 1) == []
    assert len(searched(turned(), unsure, PICTURES)) == 1


def test_search_drives_along_a_long_side_without_crop_in_view() -> None:
    context = turned()
    [go] = searched(context, replace(CUTTING, crop_ahead_m=math.inf), PICTURES)
    assert is_for(go, Searched.NOT_IN_VIEW)
    assert math.isfinite(context.strip.search_m)


def test_stems_right_before_the_lens_begin_no_strip() -> None:
    """Whatever pictures between them seem to show (random field 10167: the neighbour's)."""
    context, search = turned(), []
    hidden = CropView(0.0, hidden=True)
    clear = replace(CUTTING, crop_ahead_m=math.inf)
    behaviour = Search(context)
    behaviour.enter(NOW)
    for k in range(1, MOST_PICTURES + 2):
        stamp = NOW + STAND_S + 0.1 * k
        seeing(context, hidden if k % PICTURES == 0 or k > MOST_PICTURES else clear, stamp=stamp)
        search.append(behaviour.step(stamp)[1])
    assert all(go is None for go in search[:-1])
    assert is_for(search[-1], Searched.FARTHER_BACK)


def test_stems_right_beside_what_it_has_cut_are_the_strips_own() -> None:
    context = turned()
    context.sight.seen_at_m = context.motion.distance_m
    here, vehicle = context.motion, context.vehicle
    blade = Pose2(here.x_m, here.y_m, here.yaw_rad).ahead(vehicle.blade_x_m)
    for k in range(40):
        at = blade.ahead(0.25 * k, -vehicle.pass_m)
        context.estimate.swaths.note(0.25 * k, at, at)
    context.estimate.swaths.end()
    goes = searched(context, CropView(0.0, hidden=True), MOST_PICTURES + 1)
    assert [go.reason for go in goes] == [Searched.OWN_CROP]


@pytest.mark.parametrize(
    ("cut_m", "inside_m", "rest_m", "clear_m", "reason"),
    [
        (100.0, 0.0, 0.2, 9.0, Searched.NO_CROP_LEFT),
        (100.0, 0.0, 0.2, 3.0, Searched.NOT_IN_VIEW),
        (100.0, 0.0, 9.0, 9.0, Searched.NOT_IN_VIEW),
        (12.0, VEHICLE.pass_m, 0.2, 9.0, Searched.NO_CROP_LEFT),
        (12.0, 0.0, 0.2, 9.0, Searched.NOT_IN_VIEW),
    ],
)
def test_a_last_long_side_that_is_seen_to_be_empty_has_gone(
    cut_m: float, inside_m: float, rest_m: float, clear_m: float, reason: Reason
) -> None:
    """Late in the field or inside of strips, and next to nothing after it (random field 10113)."""
    side = replace(PLAN.sides[1], places_m=((0.0, inside_m),))
    first = replace(PLAN.sides[0], length_m=cut_m)
    sides = (first, replace(side, length_m=8.0), replace(side, length_m=rest_m))
    context = turned(replace(PLAN, sides=sides))
    assert context.turning is not None
    expected_m = context.turning.crop_expected_m(context.motion, VEHICLE.blade_x_m)
    empty = replace(CUTTING, crop_ahead_m=expected_m + clear_m)
    [go] = searched(context, empty, PICTURES)
    assert is_for(go, reason)


def test_a_turn_that_ends_past_where_the_crop_begins_searches_as_far_on_from_there() -> None:
    context = turned()
    assert context.turning is not None
    begins_m = context.turning.turn.crop_begins_m
    context.turning.turn = replace(context.turning.turn, crop_begins_m=begins_m - 2.0)
    assert context.turning.crop_expected_m(context.motion, VEHICLE.blade_x_m) < -NO_CROP_M
    searched(context, replace(CUTTING, crop_ahead_m=math.inf), PICTURES)
    assert context.strip.search_m >= NO_CROP_M


def test_search_without_a_plan_ends_the_field_where_no_crop_stands() -> None:
    context = standing()
    context.begin_strip()
    context.sight.ahead.entered_at = context.motion
    end_side(context, NOW, clear_ahead(context))
    [go] = searched(context, replace(CUTTING, crop_ahead_m=END_CLEAR_M + 9.0), PICTURES)
    assert is_for(go, Searched.NO_CROP_LEFT)


def farther_back(view: CropView) -> Context:
    """A machine that has made nothing out after the turn, and has backed to look again."""
    context = turned()
    [go] = searched(context, view, MOST_PICTURES + 1)
    assert is_for(go, Searched.FARTHER_BACK)
    turning = context.turning
    assert turning is not None and turning.leg is not None and turning.leg.reverse
    assert turning.to_go(context.motion, 0.0) == pytest.approx(LOOK_BACK_M)
    turning.next(NOW)
    return context


def test_search_that_makes_nothing_out_looks_once_from_farther_back_and_then_needs_a_person() -> (
    None
):
    """Standing, pictures err alike."""
    hazy = replace(CUTTING, ahead_confidence=0.2)
    goes = searched(farther_back(hazy), hazy, MOST_PICTURES + 1)
    assert [go.reason for go in goes] == [Searched.NOTHING_TO_SEE]


@pytest.mark.parametrize("hidden", [True, False])
def test_where_stems_stand_right_before_the_lens_it_goes_elsewhere_first(hidden: bool) -> None:
    """The turn ended inside the strip (model field 11118)."""
    view = CropView(0.0, hidden=hidden)
    [go, *_] = searched(farther_back(view), view, MOST_PICTURES + 1)
    assert is_for(go, Standing.LEFT if hidden else Searched.NOTHING_TO_SEE)


@pytest.mark.parametrize("ago_m", [LATELY_M - 0.1, LATELY_M + 0.1])
def test_where_nothing_is_made_out_a_camera_that_was_good_a_turn_ago_looks_elsewhere(
    ago_m: float,
) -> None:
    """Picture field 10377 stopped with an eighth of the field to go."""
    hazy = replace(CUTTING, ahead_confidence=0.2)
    context = farther_back(hazy)
    context.sight.seen_at_m = context.motion.distance_m - ago_m
    [go, *_] = searched(context, hazy, MOST_PICTURES + 1)
    assert is_for(go, Standing.LEFT if ago_m < LATELY_M else Searched.NOTHING_TO_SEE)


def test_where_nothing_is_made_out_past_a_keep_out_the_rest_of_the_strip_stays() -> None:
    context = turned_to(7.0)
    Follow(context).blocked(NOW, AT_KEEP_OUT)
    while context.turning is not None and context.turning.leg is not None:
        context.turning.next(NOW)
    left_m2 = context.strip.left_m2
    goes = searched(context, CropView(0.0), MOST_PICTURES + 1)
    assert [go.reason for go in goes] == [SideEnd.KEEP_OUT]
    assert context.left_standing_m2 == pytest.approx(left_m2, rel=0.05)


def test_where_next_to_nothing_is_left_nobody_is_called_for_it() -> None:
    """Of the plan (model field 10354 had 0.9998 of its crop cut)."""
    sides = (PLAN.sides[0], replace(PLAN.sides[1], length_m=1.5))
    context = turned(replace(PLAN, sides=sides))
    goes = searched(context, CropView(0.0, hidden=True), MOST_PICTURES + 1)
    assert [go.reason for go in goes] == [Searched.REMNANT]
    assert context.left_standing_m2 > 1.0, "it is told of"
