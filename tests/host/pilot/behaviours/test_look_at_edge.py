"""LookAtEdge alone: how a look for the edge ends."""

from __future__ import annotations

from dataclasses import replace

import pytest

from host.pilot.behaviours.look_at_edge import LookAtEdge
from host.pilot.behaviours.look_at_edge import Why as EdgeLook
from host.pilot.behaviours.look_at_end import LookAtEnd
from host.pilot.context import STAND_S
from host.pilot.endings import SideEnd
from host.pilot.stop_and_look import LOOK_S
from tests.helpers.behaving import NOW, PLAN, clear_ahead, is_for, moved, on_side


@pytest.mark.parametrize("kind", [LookAtEdge, LookAtEnd])
def test_a_look_lets_the_blade_turn_until_the_machine_stands(
    kind: type[LookAtEdge] | type[LookAtEnd],
) -> None:
    context = on_side()
    context.look.begin(NOW, 5.0)
    clear_ahead(context)
    moved(context, 5.1, 0.3)
    assert kind(context).step(NOW)[0] == context.hold(blade=True)
    assert kind(context).step(NOW + STAND_S + 0.01)[0] == context.hold(blade=False), "on a slope"


def test_a_look_at_the_edge_ends_with_a_sight_or_with_its_time() -> None:
    context = on_side()
    context.look.begin(NOW, 5.0)
    context.sight.edge_at_m = 4.0
    assert is_for(LookAtEdge(context).step(NOW + LOOK_S - 0.1)[1], None)
    assert is_for(LookAtEdge(context).step(NOW + LOOK_S + 0.1)[1], EdgeLook.NO_CLEARER)
    context.sight.edge_at_m = 5.0
    assert is_for(LookAtEdge(context).step(NOW + 0.5)[1], EdgeLook.SEEN)


@pytest.mark.parametrize(
    ("index", "past_m", "again", "ends"),
    [(0, 0.3, False, True), (0, -0.3, False, False), (0, 0.3, True, False), (5, 0.3, False, False)],
)
def test_past_the_plans_end_at_the_boundary_a_look_without_an_edge_ends_the_side_once(
    index: int, past_m: float, again: bool, ends: bool
) -> None:
    """Behind a gap that was said wider, that the blade had crossed in its dust, the neighbour's
    crop stood at it without an edge (`daranti-hil beliefs --seeds 23 "gap 1.2, said 2"`)."""
    cut_m = PLAN.sides[index].length_m + past_m
    context = on_side(index, cut_m=cut_m)
    context.by_plan = again
    context.look.begin(NOW, cut_m)
    context.sight.edge_at_m = cut_m - 1.0
    go = LookAtEdge(context).step(NOW + LOOK_S + 0.1)[1]
    assert is_for(go, SideEnd.BY_PLAN if ends else EdgeLook.NO_CLEARER)


@pytest.mark.parametrize(
    ("refused", "agreed_m", "tip_m", "believes"),
    [
        (True, 0.5, 0.0, True),
        (True, 3.0, 0.0, False),
        (False, 0.5, 0.0, False),
        (True, 3.0, 6.0, True),
        (True, 3.0, 7.5, False),
    ],
)
def test_an_edge_that_is_hardly_known_is_looked_at_until_the_lane_believes_what_is_seen(
    refused: bool, agreed_m: float, tip_m: float, believes: bool
) -> None:
    """5 m along a side, behind whose inner corner another border is the edge, from tip_m before its
    end on."""
    side = replace(PLAN.sides[0], edge_end_m=tip_m)
    context = on_side(plan=replace(PLAN, sides=(side, *PLAN.sides[1:])))
    context.look.begin(NOW, 5.0)
    context.sight.edge_at_m, context.sight.agreed_m = 5.0, agreed_m
    context.estimate.lane.contradicted = refused
    look = LookAtEdge(context)
    assert is_for(look.step(NOW + LOOK_S - 0.1)[1], None if believes else EdgeLook.SEEN)
    assert is_for(look.step(NOW + LOOK_S + 0.1)[1], EdgeLook.SEEN)
