"""Facts about the edge that a strip has left beside its lane's straight line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.estimate.profile import SMOOTH_M, STRAIGHT, profile_of


def bow(length_m: float, high_m: float) -> list[tuple[float, float]]:
    """A parabola that leaves its chord by that in the middle."""
    along = np.arange(0.0, length_m, 0.13)
    return [(s, 4.0 * high_m * s / length_m * (1.0 - s / length_m)) for s in along.tolist()]


def test_where_nothing_was_cut_the_edge_is_the_line() -> None:
    found = profile_of([], 0.0)
    assert not found.known
    assert (found.at(3.0), found.slope(3.0)) == (0.0, 0.0)


def test_it_lies_where_the_blade_went_and_runs_as_it_went() -> None:
    found = profile_of(bow(8.0, 0.25), 0.0)
    assert found.known
    assert found.at(4.0) == pytest.approx(0.25, abs=0.01)
    assert found.slope(4.0) == pytest.approx(0.0, abs=0.01)
    assert found.slope(2.0) == pytest.approx(0.25 / 4.0, abs=0.01)
    assert found.slope(6.0) == pytest.approx(-0.25 / 4.0, abs=0.01)


def test_before_and_behind_it_goes_on_as_it_begins_and_ends() -> None:
    found = profile_of([(2.0 + 0.1 * k, 0.3) for k in range(30)], 0.0)
    assert found.at(-5.0) == found.at(2.0) == pytest.approx(0.3)
    assert found.at(50.0) == pytest.approx(0.3)
    assert found.slope(50.0) == pytest.approx(0.0)


def test_of_what_is_shorter_than_half_a_metre_little_stays() -> None:
    """The machine's own way about an edge: strip after strip would copy it and add to it."""
    along = np.arange(0.0, 12.0, 0.05)
    way = list(
        zip(along.tolist(), (0.1 * np.sin(math.tau * along / SMOOTH_M)).tolist(), strict=True)
    )
    found = profile_of(way, 0.0)
    assert max(abs(found.at(s)) for s in along) < 0.02


@given(st.floats(-1.0, 1.0), st.floats(-3.0, 12.0))
def test_against_another_line_it_is_the_same_edge(left_m: float, at_m: float) -> None:
    there, here = profile_of(bow(9.0, 0.2), left_m), profile_of(bow(9.0, 0.2), 0.0)
    assert left_m + there.at(at_m) == pytest.approx(here.at(at_m))
    assert there.slope(at_m) == pytest.approx(here.slope(at_m))


@given(st.floats(-5.0, 5.0), st.floats(0.0, 8.0))
def test_a_lane_that_begins_later_has_the_same_edge(later_m: float, at_m: float) -> None:
    found = profile_of(bow(8.0, 0.25), 0.0)
    assert found.begun(later_m).at(at_m - later_m) == pytest.approx(found.at(at_m))


def test_one_point_is_an_edge_too_and_no_point_is_none() -> None:
    found = profile_of([(1.0, 0.2)], 0.0)
    assert (found.at(7.0), found.slope(7.0)) == (pytest.approx(0.2), 0.0)
    assert not STRAIGHT.known
