"""Small fields in the plane world whose boundary was walked a metre wrong: the first round finds
where it lies."""

from __future__ import annotations

import pytest

from host.core.vehicle import Vehicle
from host.pilot.phase import Phase
from host.pilot.pilot import Pilot
from host.route.plan import spiral
from tests.helpers.simple_world import SimpleWorld, harvest

VEHICLE = Vehicle()
TRUE = [(0.0, 0.0), (6.0, 0.0), (6.0, 5.0), (0.0, 5.0)]
WALKED = {
    "longer": [(0.0, 0.0), (7.0, 0.0), (7.0, 6.0), (0.0, 6.0)],
    "shorter": [(0.0, 0.0), (5.0, 0.0), (5.0, 4.0), (0.0, 4.0)],
    "rotated and skew": [(0.0, 0.0), (5.9, 0.9), (5.6, 6.0), (-1.0, 4.9)],
}


@pytest.mark.parametrize("wrong", WALKED)
def test_a_field_whose_boundary_is_a_metre_off_is_cut_and_nothing_else(wrong: str) -> None:
    world = SimpleWorld(VEHICLE, width=6.0, height=5.0, polygon=TRUE)
    world.stand_at(spiral(TRUE, 0, VEHICLE).sides[0])
    plan = spiral(WALKED[wrong], 0, VEHICLE, gap_m=world.gap, sigma_m=1.0)
    pilot = Pilot(VEHICLE, world, plan)
    harvest(world, pilot, 700.0)
    assert pilot.phase is Phase.FINISHED
    assert world.coverage >= 0.98
    assert world.neighbour_cut == 0
