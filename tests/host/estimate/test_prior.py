"""What is known of a boundary's corners before anything is seen of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.estimate.prior import ALIKE_M, OWN_SHARE, corners

CIRCLE = np.column_stack([f(np.arange(30) * math.tau / 30) * 14.0 for f in (np.cos, np.sin)])


def direction_sigma_deg(covariance: np.ndarray, ring: np.ndarray, edge: int) -> float:
    """Of the direction of an edge, by small angles."""
    to = (edge + 1) % len(ring)
    way = ring[to] - ring[edge]
    across = np.array([-way[1], way[0]]) / (way @ way)
    h = np.zeros(2 * len(ring))
    h[2 * edge : 2 * edge + 2], h[2 * to : 2 * to + 2] = -across, across
    return math.degrees(math.sqrt(h @ covariance @ h))


@pytest.mark.parametrize("recorded", [False, True])
def test_each_corner_is_known_as_well_as_was_said(recorded: bool) -> None:
    assert np.diag(corners(CIRCLE, 0.3, recorded)) == pytest.approx(0.09)


def test_who_enters_corners_one_by_one_errs_at_each_anew() -> None:
    assert corners(CIRCLE, 0.3, False) == pytest.approx(0.09 * np.eye(60))


def test_points_of_one_recording_err_alike_the_more_the_nearer_they_lie() -> None:
    covariance = corners(CIRCLE, 0.3, True)
    piece_m = math.dist(CIRCLE[0], CIRCLE[1])
    for k in (1, 2, 5, 15):
        assert covariance[0, 2 * k] == pytest.approx(0.09 * math.exp(-k * piece_m / ALIKE_M))
        assert covariance[0, 2 * k] == pytest.approx(covariance[0, 2 * (30 - k)]), "round it too"
        assert covariance[0, 2 * k + 1] == 0.0, "along and across are two errors"


def test_a_short_piece_of_a_recording_knows_its_direction_to_some_degrees() -> None:
    """Entered one by one, its ends would tell it to 8."""
    assert direction_sigma_deg(corners(CIRCLE, 0.3, False), CIRCLE, 3) > 8.0
    assert direction_sigma_deg(corners(CIRCLE, 0.3, True), CIRCLE, 3) < 5.0


@given(st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=3, max_size=12))
def test_it_is_a_covariance_whatever_the_ring(ring: list[tuple[float, float]]) -> None:
    covariance = corners(np.array(ring), 0.5, True)
    assert covariance == pytest.approx(covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > -1e-9


def test_half_of_what_a_real_corner_errs_is_its_own() -> None:
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
    covariance = corners(square, 0.3, True)
    assert covariance[0, 0] == pytest.approx(0.09)
    assert covariance[0, 2] == pytest.approx(0.09 * (1.0 - OWN_SHARE) * math.exp(-4.0 / ALIKE_M))
