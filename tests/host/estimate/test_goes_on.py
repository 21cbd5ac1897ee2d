"""Crop that goes on beyond where a side was taken to end: what the end is taken to be then."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import truncnorm

from host.estimate.measurements.goes_on import FARTHEST, LIKELY, goes_on

MEANS = st.floats(2.0, 40.0)
SIGMAS = st.floats(0.05, 3.0)


@given(MEANS, SIGMAS, st.floats(LIKELY, FARTHEST))
def test_what_is_left_has_the_moments_of_the_truncated_normal(
    mean: float, sigma: float, beyond: float
) -> None:
    known = goes_on(mean + beyond * sigma, mean, sigma)
    assert known is not None
    left = truncnorm(beyond, math.inf, loc=mean, scale=sigma)
    assert known[0] == pytest.approx(left.mean(), abs=1e-6 * sigma)
    assert known[1] == pytest.approx(left.var(), abs=1e-6 * sigma**2)


@given(MEANS, SIGMAS, st.floats(-30.0, 30.0))
def test_the_end_is_never_before_the_crop_that_was_seen_nor_surer_than_not_at_all(
    mean: float, sigma: float, beyond: float
) -> None:
    bound = mean + beyond * sigma
    known = goes_on(bound, mean, sigma)
    if known is None:
        assert beyond < LIKELY + 1e-6
        return
    assert known[0] >= max(bound, mean)
    assert 0.0 < known[1] <= sigma**2


@given(MEANS, SIGMAS, st.floats(LIKELY, FARTHEST), st.floats(0.0, 2.0))
def test_crop_seen_farther_moves_the_end_farther_and_leaves_less_doubt(
    mean: float, sigma: float, beyond: float, more: float
) -> None:
    near = goes_on(mean + beyond * sigma, mean, sigma)
    far = goes_on(mean + (beyond + more) * sigma, mean, sigma)
    assert near is not None
    assert far is not None
    assert far[0] >= near[0] - 1e-9
    assert far[1] <= near[1] + 1e-9


def test_what_is_far_before_the_expected_end_says_nothing_of_it() -> None:
    assert goes_on(5.0, 10.0, 1.0) is None
    assert goes_on(0.0, 10.0, 1.0) is None
    assert goes_on(8.1, 10.0, 1.0) is not None


def test_cut_off_again_and_again_the_distribution_would_lose_its_tail() -> None:
    """Why each time is told from what was taken first."""
    mean, variance = 10.0, 1.0
    for step in range(1, 101):
        bound = 10.0 + step / 100
        mean, variance = goes_on(bound, mean, math.sqrt(variance)) or (mean, variance)
    once = goes_on(11.0, 10.0, 1.0)
    assert once is not None
    assert once[1] > 2 * variance
