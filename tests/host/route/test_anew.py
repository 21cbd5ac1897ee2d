"""When a plan that is laid out anew takes the place of the old one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from host.core.vehicle import Vehicle
from host.route.anew import around
from host.route.plan import spiral
from host.runs.resume import remaining

VEHICLE = Vehicle()
CORNERS = [(0.0, 0.0), (12.0, 0.0), (12.0, 10.0), (0.0, 10.0)]
FOUND = [(0.0, 0.0), (12.5, 0.0), (12.5, 10.0), (0.0, 10.0)]
PLAN = spiral(CORNERS, 0, VEHICLE, "three_point", 2.0, sigma_m=0.5)


@pytest.mark.parametrize("cut", [1, 4])
def test_a_field_that_was_found_to_be_longer_is_laid_out_longer(cut: int) -> None:
    anew = around(PLAN, FOUND, PLAN.cut_along(cut), VEHICLE)
    assert anew is not None
    assert anew.boundary == tuple(FOUND)
    assert anew.sides[0].length_m == pytest.approx(PLAN.sides[0].length_m + 0.5, abs=0.05)


@pytest.mark.parametrize(("more", "taken"), [(1.0, True), (1.2, False)])
def test_one_that_leaves_what_the_old_one_cuts_is_not_taken(more: float, taken: bool) -> None:
    """What is left of the old one, each strip wider by that share."""
    wider = [replace(side, width_m=more * side.width_m) for side in PLAN.sides[4:]]
    old = replace(PLAN, sides=(*PLAN.sides[:4], *wider))
    assert (around(old, FOUND, old.cut_along(4), VEHICLE) is not None) is taken


@pytest.mark.parametrize("seed", [0, 1, 3, 4])
def test_sides_that_were_cut_along_an_arc_end_where_they_have_ended(seed: int) -> None:
    """Where an arc is divided is the planner's choice: here corners that move by a decimetre make
    it choose other points. A machine had then backed over 11 m of the field to begin its turn.
    (Of seed 2 no plan around what was found has the first side: there the old one stays.)"""
    rng = np.random.default_rng(seed)
    angles = np.arange(28) * math.tau / 28
    ring = 14.0 * np.column_stack([1.2 * np.cos(angles), np.sin(angles)])
    walked, found = (list(map(tuple, ring + rng.normal(0.0, 0.1, ring.shape))) for _ in range(2))
    plan = spiral(walked, 0, VEHICLE, gap_m=2.0, sigma_m=0.3, recorded=True)
    for cut in (1, 2, 4):
        anew = around(plan, found, plan.cut_along(cut), VEHICLE)
        assert anew is not None
        for one, other in zip(plan.sides[:cut], anew.sides, strict=False):
            if one.inside_m > VEHICLE.pass_m / 2:
                break  # what the first round has left may be divided elsewhere
            ends = (side.pose(side.length_m - side.edge_end_m)[:2] for side in (one, other))
            assert math.dist(*ends) < 1.0


def test_where_the_sides_of_an_earlier_run_have_ended_is_not_known_and_changes_nothing() -> None:
    """Of these only the edges that they were cut along are kept."""
    whole = spiral(CORNERS, 2, VEHICLE, "three_point", 2.0, sigma_m=0.5)
    rest = remaining(whole, 2, 0.0)
    at_once = around(whole, FOUND, whole.cut_along(4), VEHICLE)
    after = around(rest, FOUND, rest.cut_along(2), VEHICLE)
    assert at_once is not None
    assert after is not None
    assert after.sides == at_once.sides[2:]


@pytest.mark.parametrize(
    ("longer_m", "recorded", "taken"), [(3.0, True, True), (4.0, True, False), (4.0, False, True)]
)
def test_one_whose_cut_side_ends_metres_away_is_not_taken_where_edges_bend(
    longer_m: float, recorded: bool, taken: bool
) -> None:
    """The field was found half a metre longer."""
    first = replace(PLAN.sides[0], length_m=PLAN.sides[0].length_m + longer_m)
    old = replace(PLAN, recorded=recorded, sides=(first, *PLAN.sides[1:]))
    assert (around(old, FOUND, old.cut_along(1), VEHICLE) is not None) is taken
