"""The place against the borders, as the fence asks for it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.estimate.borders import Borders
from host.estimate.outline import STRAYS_M, Outline
from host.estimate.states import CORNERS, YAW, X, Y

RING = [(0.0, 0.0), (14.0, 0.0), (14.0, 10.0), (0.0, 10.0)]
POINTS = np.array([[5.0, 1.0], [6.5, 1.4], [4.6, -0.3]])
AXLE = (5.0, 2.0)


def state(rng: np.random.Generator, corners: int) -> tuple[np.ndarray, np.ndarray]:
    """A machine at AXLE, and a covariance in which everything goes with everything."""
    x = np.zeros(CORNERS + 2 * corners)
    x[[X, Y]] = AXLE
    root = rng.normal(0.0, 0.1, (len(x), len(x)))
    return x, root @ root.T


@given(st.integers(0, 2**31), st.floats(0.0, 1.0))
def test_against_a_border_a_point_is_as_sure_as_both_together(seed: int, share: float) -> None:
    """Of a place that lies so far along each edge: what moves it are the edge's two corners."""
    x, p = state(np.random.default_rng(seed), len(RING))
    ring = np.array(RING)
    places = ring + share * (np.roll(ring, -1, 0) - ring)
    found, shifts = Borders(x, p, Outline(RING)).against(POINTS, places)
    assert found.shape == (len(RING), len(POINTS), 2, 2)
    assert not shifts.any()
    for edge in range(len(RING)):
        for k, (px, py) in enumerate(POINTS):
            by = np.zeros((2, len(x)))
            by[0, X] = by[1, Y] = 1.0
            by[:, YAW] = AXLE[1] - py, px - AXLE[0]
            for corner, moves in ((edge, 1.0 - share), ((edge + 1) % len(RING), share)):
                at = CORNERS + 2 * corner
                by[0, at] -= moves
                by[1, at + 1] -= moves
            assert found[edge, k] == pytest.approx(by @ p @ by.T, abs=1e-6)


def test_where_no_corner_is_to_be_found_one_answer_holds_for_every_border() -> None:
    x, p = state(np.random.default_rng(3), 0)
    places = np.array([[0.0, 0.0], [3.0, 4.0]])
    found, shifts = Borders(x, p, Outline()).against(POINTS, places)
    assert found.shape == (1, len(POINTS), 2, 2)
    assert shifts.shape == places.shape
    for k, (px, py) in enumerate(POINTS):
        by = np.zeros((2, len(x)))
        by[0, X] = by[1, Y] = 1.0
        by[:, YAW] = AXLE[1] - py, px - AXLE[0]
        assert found[0, k] == pytest.approx(by @ p @ by.T, abs=1e-9)


def test_a_border_that_bends_lies_beside_its_straight_pieces() -> None:
    """Whatever is known of the machine and of the corners."""
    turns = np.arange(12) * math.tau / 12
    ring = [(float(x), float(y)) for x, y in 20.0 * np.column_stack([np.cos(turns), np.sin(turns)])]
    x, _ = state(np.random.default_rng(3), len(ring))
    borders = Borders(x, np.zeros((len(x), len(x))), Outline(ring, strays_m=STRAYS_M))
    beside = np.broadcast_to(STRAYS_M**2 * np.eye(2), (len(POINTS), 2, 2))
    assert borders.covariance_of(POINTS) == pytest.approx(beside)
    found, _ = borders.against(POINTS, np.array(ring))
    assert found == pytest.approx(np.broadcast_to(beside, (len(ring), *beside.shape)))
    straight = Borders(x, np.zeros((len(x), len(x))), Outline(RING))
    assert not straight.covariance_of(POINTS).any()
