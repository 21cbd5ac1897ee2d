"""What an edge must show to be believed that lies far from its lane."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from host.core.messages import Frame
from host.pilot.behaviours.search import Search
from tests.helpers.behaving import CUTTING, NOW, Shown, moved, on_side


@pytest.mark.parametrize(
    ("edges_m", "taken"),
    [
        ((-0.7, -0.7), False),
        ((-0.7, -0.7, -0.7), True),
        ((-0.7, -0.7, math.nan, -0.7), False),
        ((-0.7, -0.4, -0.7), False),
        ((-0.3,), True),
    ],
    ids=["a whim", "stays", "not sure between", "here and there", "near"],
)
def test_an_edge_far_from_a_lane_that_is_hardly_known_is_one_once_it_stays(
    edges_m: tuple[float, ...], taken: bool
) -> None:
    """One picture in a hundred had another strip's edge, and the lane moved there (random field
    10229)."""
    eye = Shown()
    context = on_side(cut_m=5.0, eye=eye)
    context.estimate.lane.place(0.0, 0.0, 0.35, 0.02)
    moved(context, 5.02, 0.3)
    for k, edge_m in enumerate(edges_m):
        sure = 0.0 if math.isnan(edge_m) else 0.9
        eye.view = replace(CUTTING, edge_offset_m=edge_m, confidence=sure)
        frame = Frame(NOW + 0.1 * k, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, Search.gaze, context.strip, None, context.look.settled)
    assert (context.estimate.lane.blade_offset_m > 0.05) is taken
