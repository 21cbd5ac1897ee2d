"""Facts about the edge that pictures in dust show together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.estimate.edges_together import PICTURES, WINDOW_S, EdgesTogether


def told(edges: list[float], every_s: float = 0.1) -> list[float]:
    """What it says while these edges are seen one after the other."""
    dusty, out = EdgesTogether(), []
    for k, edge in enumerate(edges):
        dusty.note(k * every_s, edge)
        line = dusty.take()
        if line is not None:
            out.append(line)
    return out


@given(st.floats(-0.5, 0.5), st.integers(0, 2**32 - 1))
def test_edges_of_which_a_few_lie_inside_tell_the_outer_place(true: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    inside = rng.permutation(PICTURES) < 0.3 * PICTURES
    edges = true + rng.uniform(-0.02, 0.02, PICTURES) + inside * rng.uniform(0.1, 0.6, PICTURES)
    (line,) = told(edges.tolist())
    assert line == pytest.approx(true, abs=0.03)


def test_each_picture_tells_once() -> None:
    assert told([0.1] * PICTURES + [0.3] * PICTURES) == pytest.approx([0.1, 0.3])
    assert told([0.1] * (PICTURES - 1)) == []


def test_what_was_seen_long_ago_tells_nothing() -> None:
    assert told([0.1] * PICTURES, every_s=1.1 * WINDOW_S / PICTURES) == []


def test_another_line_begins_anew() -> None:
    dusty = EdgesTogether()
    for k in range(PICTURES - 1):
        dusty.note(0.1 * k, 0.1)
    dusty.clear()
    dusty.note(0.1 * PICTURES, 0.1)
    assert dusty.take() is None
