"""Whether the edge in a picture is the lane's, or of something else that stands near it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from host.core.messages import Frame
from host.estimate.crop_ahead import AT_BLADE_PICTURES
from host.pilot.behaviours.search import Search
from host.pilot.leaps import LEAP_PICTURES
from host.pilot.planned_strip import PlannedStrip
from tests.helpers.behaving import CUTTING, NOW, Shown, moved, on_side, told


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
        context.sight.take(frame, Search.gaze, context.strip, None, context.look.settled)
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
    context.sight.take(frame, Search.gaze, context.strip, None, context.look.settled)
    assert (context.estimate.lane.blade_offset_m < -0.05) is taken


@pytest.mark.parametrize(
    ("back_m", "ahead_m", "taken"), [(0.0, 0.0, True), (1.0, 0.0, False), (1.0, 0.9, True)]
)
def test_beside_its_own_swath_a_machine_that_has_backed_sees_no_edge_of_its_lane(
    back_m: float, ahead_m: float, *, taken: bool
) -> None:
    """What stands there is the next strip's. Taken for the lane's, it moved the place by 0.9 m
    (model field 13). At the swath's end its own crop stands again."""
    eye = Shown(replace(CUTTING, edge_offset_m=0.3, edge_ahead_m=ahead_m))
    context = on_side(eye=eye)
    cut = context.estimate.cut
    cut.take_telemetry(told())
    for _ in range(AT_BLADE_PICTURES):
        cut.take_picture(NOW, CUTTING)
    backing = replace(told(-0.5), drive_duty=-120)
    for k in range(round(back_m / 0.05)):
        cut.take_telemetry(replace(backing, stamp=NOW + 0.1 * (k + 1)))
    assert cut.over_cut_m == pytest.approx(back_m, abs=0.1)
    context.estimate.lane.place(0.0, 0.0, 0.3, 0.02)
    moved(context, 5.1, 0.3)
    frame = Frame(NOW, np.zeros((2, 2, 3), np.uint8))
    context.sight.take(frame, Search.gaze, context.strip, None, context.look.settled)
    assert (context.estimate.lane.blade_offset_m < -0.05) is taken
