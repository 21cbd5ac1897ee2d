"""What is said of the gap, and what pictures show of it."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.estimate.gaps import RECKONED_M, SEEN_M, TELLS_M, Gaps, across, along


@pytest.mark.parametrize(
    ("way_m", "askew_deg", "wide_m", "gap_m"),
    [(1.5, 0.0, 1.0, 1.5), (1.5, 30.0, 0.0, 1.5 * math.cos(math.radians(30.0)))],
)
def test_the_gap_is_measured_across_the_edge(
    way_m: float, askew_deg: float, wide_m: float, gap_m: float
) -> None:
    for askew in (askew_deg, -askew_deg):
        assert across(way_m, math.radians(askew), wide_m) == pytest.approx(gap_m)


@given(st.floats(0.8, 3.0), st.floats(-0.5, 0.5))
def test_the_way_over_a_gap_is_the_gap_of_that_way(gap_m: float, askew_rad: float) -> None:
    assert across(along(gap_m, askew_rad, 1.0), askew_rad, 1.0) == pytest.approx(gap_m)


def test_over_a_wide_blade_a_slanting_gap_shows_narrower_than_it_is() -> None:
    """The last tip of the one crop stands at one end of the blade, the first of the other at the
    other end: a gap of 2 m at 30 degrees shows 1.73 m of clear ground over a blade of 1 m."""
    slant = math.radians(30.0)
    shows_m = 2.0 / math.cos(slant) - math.tan(slant)
    assert across(shows_m, slant, 1.0) == pytest.approx(2.0)


def test_what_is_seen_only_narrows_the_gap_and_only_where_it_surely_contradicts() -> None:
    gaps = Gaps(2.0)
    for seen_m in (3.0, 2.0, 2.0 - TELLS_M + 0.01):
        assert gaps.narrowed(seen_m) == 2.0
    assert gaps.narrowed(1.5) == pytest.approx(1.5 - SEEN_M)
    assert gaps.narrowed(0.1) == 0.0


def test_one_edge_narrows_the_turns_beside_it_and_is_named() -> None:
    gaps = Gaps(2.0)
    gaps.note(1, 0.9)
    assert gaps.beside((1, 0)) == pytest.approx(0.9 - SEEN_M)
    assert gaps.beside((0, 3)) == gaps.field_m == 2.0
    gaps.note(2, 2.1)
    gaps.note(3, 2.0)
    assert gaps.field_m == 2.0
    assert gaps.beside((1, 0)) == pytest.approx(0.9 - SEEN_M)
    assert gaps.wrong == "the gap was said to be 2.0 m, pictures show 0.9 m at one side"


def test_what_most_edges_show_holds_everywhere_and_is_named() -> None:
    gaps = Gaps(2.0)
    for edge, seen_m in enumerate((0.8, 2.1, 1.0)):
        gaps.note(edge, seen_m)
    assert gaps.field_m == pytest.approx(1.0 - SEEN_M)
    assert gaps.wrong == "the gap was said to be 2.0 m, pictures show 1.0 m"


def test_the_median_of_several_edges_holds_where_it_is_less_than_was_said() -> None:
    gaps = Gaps(2.0)
    gaps.note(0, 1.8)
    assert gaps.field_m == 2.0, "one of them errs too much"
    gaps.note(1, 1.9)
    gaps.note(2, 1.7 + 0.02)
    assert gaps.field_m == pytest.approx(1.8)
    assert gaps.beside((3,)) == pytest.approx(1.8)
    assert gaps.wrong == "", "a tape errs as much"


def test_a_machine_that_gathers_reckons_with_the_narrowest_of_all_gaps() -> None:
    """What was seen at the end that it leaves, too: there its way begins."""
    gaps = Gaps(2.0)
    assert gaps.gathering_m == pytest.approx(2.0 - RECKONED_M)
    gaps.note(0, 2.1)
    gaps.note(1, 1.4)
    gaps.note(2, 2.0)
    assert gaps.field_m == 2.0
    assert gaps.gathering_m == pytest.approx(1.4 - SEEN_M - RECKONED_M)
    gaps.room_m = 1.1
    assert gaps.gathering_m == pytest.approx(1.1 - SEEN_M - RECKONED_M)
    gaps.room_m = 0.3
    assert gaps.gathering_m == 0.0


def test_crop_close_beyond_an_end_is_named_as_long_as_the_turn_lasts() -> None:
    gaps = Gaps(2.0)
    assert gaps.wrong == ""
    gaps.room_m = 0.6
    assert (
        gaps.wrong == "the gap was said to be 2.0 m, something stands 0.6 m beyond the side's end"
    )
    assert gaps.field_m == 2.0


def test_what_stands_closer_than_an_end_is_no_gap_and_narrows_its_edge_alone() -> None:
    gaps = Gaps(2.0)
    assert gaps.at_end((3, 2), 0.6, sure=False) == 2.0
    assert gaps.nearer == {3: 0.6}
    assert "something stands 0.6 m beyond the side's end" in gaps.wrong
    assert gaps.gathering_m == pytest.approx(2.0 - RECKONED_M)
    gaps.gathers = True
    assert gaps.nearer == {3: pytest.approx(0.6 - RECKONED_M)}
    assert gaps.at_end((1, 0), -0.2, sure=False) == 2.0
    assert gaps.nearer == {1: 0.0}, "of the end that was left last"
    gaps.leave()
    assert (gaps.nearer, gaps.wrong) == ({}, "")


def test_a_gap_that_is_seen_narrows_all_edges_for_the_turn() -> None:
    gaps = Gaps(2.0)
    assert gaps.at_end((3, 2), 1.2, sure=True) == pytest.approx(1.2 - SEEN_M)
    assert gaps.nearer == {}
    assert gaps.field_m == 2.0, "along the next strip it is what it was"


def test_crop_is_the_sides_own_where_no_gap_is_so_narrow() -> None:
    assert Gaps(2.0).too_narrow(0.5, 0.1)
    assert not Gaps(2.0).too_narrow(0.5, 0.2), "it may stand beyond a narrow one"
    assert not Gaps(1.0).too_narrow(0.1, 0.01), "there a turn has no way to spare"
