"""Whether the edge in a picture is the lane's, or of something else that stands near it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from host.core.messages import Frame
from host.pilot.behaviours.search import Search
from host.pilot.leaps import LEAP_PICTURES
from host.pilot.planned_strip import PlannedStrip
from tests.helpers.behaving import CUTTING, NOW, Shown, moved, on_side


@pytest.mark.parametrize("approached", [False, True])
@pytest.mark.parametrize(("begun_m", "outside_m"), [(0.1, 0.7), (0.1, 0.2), (1.5, 0.7)])
def test_beside_a_strip_that_was_begun_inside_a_tip_is_no_edge(
    begun_m: float, outside_m: float, *, approached: bool
) -> None:
    """The strip before has left one where it was begun inside as well. In such a place an edge of
    more confidence than the lane is believed after a few pictures."""
    eye = Shown(replace(CUTTING, edge_offset_m=-outside_m))
    context = on_side(cut_m=begun_m, eye=eye)
    context.estimate.lane.place(0.0, 0.0, 0.3, 0.02)
    context.sight.ahead.approached = approached
    moved(context, begun_m + 0.02, 0.3)
    for k in range(LEAP_PICTURES):
        frame = Frame(NOW + 0.1 * k, np.zeros((2, 2, 3), np.uint8))
        context.sight.take(frame, Search.gaze, context.strip, None, NOW, context.look.settled)
    taken = context.estimate.lane.blade_offset_m > 0.05
    assert taken is (approached or begun_m > 1.0 or outside_m < 0.3)


@pytest.mark.parametrize(
    ("before_m", "sigma_m", "taken"), [(0.8, 0.1, True), (2.5, 0.1, False), (2.5, 1.0, True)]
)
def test_an_edge_well_before_where_a_strip_can_begin_is_anothers(
    before_m: float, sigma_m: float, *, taken: bool
) -> None:
    """What a turn has passed stands at the blade; how surely the beginning is known counts."""
    eye = Shown(replace(CUTTING, edge_offset_m=0.3))
    context = on_side(cut_m=None, eye=eye)
    context.estimate.lane.place(0.0, 0.0, 0.3, 0.02)
    assert isinstance(context.strip, PlannedStrip)
    context.strip.place(-before_m, 0.3, sigma_m)
    moved(context, 0.02, 0.3)
    frame = Frame(NOW, np.zeros((2, 2, 3), np.uint8))
    context.sight.take(frame, Search.gaze, context.strip, None, NOW, context.look.settled)
    assert (context.estimate.lane.blade_offset_m < -0.05) is taken
