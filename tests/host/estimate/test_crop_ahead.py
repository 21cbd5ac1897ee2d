"""What pictures tell of a side's beginning and end, picture by picture."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.estimate.crop_ahead import (
    BEGIN_PICTURES,
    BEGUN_EARLY_M,
    END_CLEAR_M,
    END_PICTURES,
    FAR_PICTURES,
    NEAR_CROP_M,
    Ahead,
    EndOfField,
)
from host.estimate.odometry import Motion
from host.vision.view import CropView


def at(distance_m: float) -> Motion:
    return Motion(distance_m, 0.5, 0.0, distance_m, 0.0, distance_m, 0.0)


def crop(ahead_m: float) -> CropView:
    return CropView(0.9, crop_ahead_m=ahead_m, ahead_confidence=0.9)


def shown(ahead: Ahead, distance_m: float, crop_ahead_m: float) -> bool:
    view = crop(crop_ahead_m)
    ahead.note(view, at(distance_m))
    ahead.sight(view, at(distance_m))
    return ahead.follow(view, EndOfField(distance_m, at(distance_m)))


def test_the_side_begins_at_the_first_picture_with_crop_at_the_blade_and_once() -> None:
    ahead = Ahead()
    assert not shown(ahead, 0.0, NEAR_CROP_M)
    assert not ahead.entered
    assert shown(ahead, 0.1, NEAR_CROP_M - 0.01)
    assert ahead.entered_at == at(0.1)
    assert not shown(ahead, 0.2, 0.0)
    assert ahead.entered_at == at(0.1)


def test_a_machine_that_backs_away_sees_where_the_crop_begins() -> None:
    """Neither what is seen too near or too far, nor one strange picture among many counts."""
    ahead = Ahead()
    for k, ahead_m in enumerate((0.02, 0.1, 0.2, 0.3, 0.9, 0.5)):
        ahead.back_away(crop(ahead_m), at(5.0 - 0.1 * k))
        assert math.isnan(ahead.begins_at_m) is (k < BEGIN_PICTURES), k
    ahead.back_away(crop(1.5), at(4.3))
    assert ahead.begins_at_m == pytest.approx(5.0)
    ahead.turn()
    assert math.isnan(ahead.begins_at_m)


def test_crop_at_the_blade_well_before_the_side_was_seen_to_begin_is_not_its_own() -> None:
    """A last swath, or stalks of the strip before; and where dust hides the foot, the way to it
    begins nothing either."""
    ahead = Ahead()
    for k in range(BEGIN_PICTURES):
        ahead.back_away(crop(0.1 * (k + 2)), at(5.0 - 0.1 * (k + 2)))
    early_m = 5.0 - BEGUN_EARLY_M
    assert not ahead.begun(at(early_m - 0.01)) and ahead.begun(at(early_m + 0.01))
    assert not shown(ahead, early_m - 0.3, 0.0)
    assert not shown(ahead, early_m - 0.05, 0.5)
    assert not ahead.entered
    assert shown(ahead, early_m + 0.1, 0.0)
    ahead.turn()
    assert ahead.begun(at(0.0)), "where nobody saw it begin, it begins anywhere"


def test_crop_that_dust_hides_is_met_where_it_was_seen_and_that_is_no_sight_of_its_beginning() -> (
    None
):
    ahead = Ahead()
    shown(ahead, 0.0, 0.5)
    for travelled in (0.3, 0.5, 0.69):
        assert not shown(ahead, travelled, 1.5)
        assert not ahead.entered
    assert not shown(ahead, 0.5 + NEAR_CROP_M + 0.01, 1.5)
    assert ahead.entered


@pytest.mark.parametrize("approached", [False, True])
def test_a_turn_that_ends_inside_the_crop_shows_nothing_of_where_it_begins(
    approached: bool,
) -> None:
    ahead = Ahead()
    ahead.approached = approached
    assert shown(ahead, 0.1, 0.0) is approached
    assert ahead.entered_at == at(0.1)
    ahead.turn()
    assert ahead.approached, "of the next side nothing is known yet"


@pytest.mark.parametrize("stood_off", [False, True])
def test_after_a_turn_crop_that_no_picture_showed_some_way_ahead_is_not_met_at_its_beginning(
    stood_off: bool,
) -> None:
    """A machine that is wrong about its place may turn into the middle of the crop."""
    ahead = Ahead()
    ahead.turn()
    if stood_off:
        shown(ahead, 0.0, NEAR_CROP_M + 0.1)
    assert shown(ahead, 0.3, 0.0) is stood_off
    assert ahead.entered_at == at(0.3)


@given(st.lists(st.sampled_from([0.0, END_CLEAR_M - 0.01, END_CLEAR_M, math.inf]), max_size=20))
def test_a_side_ends_where_the_latest_pictures_in_a_row_show_no_crop(seen: list[float]) -> None:
    """And its end is where the first of them was taken."""
    ahead = Ahead()
    shown(ahead, 0.0, 0.0)
    for k, distance in enumerate(seen, 1):
        shown(ahead, float(k), distance)
    clear = 0
    while clear < len(seen) and seen[-1 - clear] >= END_CLEAR_M:
        clear += 1
    assert ahead.clear_count == clear
    first = EndOfField(len(seen) - clear + 1, at(len(seen) - clear + 1.0)) if clear else None
    assert ahead.clear_since == first
    assert ahead.end == (first if clear >= END_PICTURES else None)
    assert ahead.seems_clear_since == (first.motion if first else None)


def test_clear_ground_before_the_crop_is_no_end() -> None:
    ahead = Ahead()
    for k in range(2 * END_PICTURES):
        shown(ahead, 0.1 * k, math.inf)
    assert ahead.end is None


def test_the_way_ahead_is_surely_clear_as_far_as_the_latest_pictures_agree() -> None:
    ahead = Ahead()
    for k in range(FAR_PICTURES - 1):
        shown(ahead, 0.1 * k, 3.0)
    assert ahead.surely_clear_m(at(0.0)) == 0.0, "of too few pictures"
    shown(ahead, 0.5, 2.0)
    assert ahead.surely_clear_m(at(0.5)) == pytest.approx(2.0)
    assert ahead.surely_clear_m(at(1.5)) == pytest.approx(1.0), "the machine has come nearer"
    for k in range(FAR_PICTURES):
        shown(ahead, 1.5 + 0.1 * k, math.inf)
    assert ahead.surely_clear_m(at(1.7)) == math.inf, "what one picture has shown before is gone"
    shown(ahead, 1.8, 0.3)
    assert ahead.surely_clear_m(at(1.8)) == pytest.approx(0.3), "one shows it again"
    ahead.turn()
    assert ahead.surely_clear_m(at(1.8)) == 0.0


def test_the_next_side_knows_nothing_of_the_last_but_the_dust() -> None:
    ahead = Ahead()
    ahead.sure.extend([False] * 10)
    for k in range(4):
        shown(ahead, float(k), 0.0 if k == 0 else math.inf)
    ahead.turn()
    assert ahead.crop_at_m == math.inf
    ahead.sight(crop(1.0), at(5.0))
    ahead.begin(at(5.0))
    assert (ahead.entered, ahead.end, ahead.seems_clear_since) == (False, None, None)
    assert ahead.crop_at_m == 6.0, "seen while it turned"
    assert ahead.in_dust(0.5, 30)


def test_it_has_cut_from_where_the_blade_met_the_crop() -> None:
    ahead = Ahead()
    assert ahead.cut_m(at(1.0)) == 0.0
    ahead.begin(at(1.0))
    assert ahead.cut_m(at(1.5)) == 0.5, "before that, from where the side was begun"
    shown(ahead, 2.0, 0.0)
    assert ahead.cut_m(at(2.25)) == 0.25


def test_it_is_dusty_where_fewer_than_the_share_of_the_latest_pictures_are_sure() -> None:
    ahead = Ahead()
    assert not ahead.in_dust(0.5, 10), "nothing is known"
    ahead.sure.extend([False] * 10 + [True] * 5)
    assert not ahead.in_dust(0.5, 10)
    assert ahead.in_dust(0.51, 10)
    assert ahead.in_dust(0.5, 11)
