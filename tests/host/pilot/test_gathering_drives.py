"""What the plan has left standing is gone to, strip by strip, in the plane world."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from host.core.vehicle import Vehicle
from host.pilot.phase import Doing, Phase
from host.pilot.pilot import Pilot
from host.route.left_over import GATHER_M2
from host.route.plan import Plan, spiral
from tests.helpers.behaving import standing
from tests.helpers.simple_world import CELL, SimpleWorld, drive, harvest

VEHICLE = Vehicle()
SQUARE = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
PLAN = spiral(SQUARE, 1, VEHICLE, gap_m=2.0)


def without(fewer: int) -> Plan:
    """The plan less its last sides, which it has left, as it knows."""
    left_m2 = sum(side.length_m * side.width_m for side in PLAN.sides[-fewer:])
    return replace(PLAN, sides=PLAN.sides[:-fewer], leftover_m2=left_m2)


def ahead(world: SimpleWorld) -> tuple[float, float]:
    """The machine's direction."""
    return math.cos(world.yaw), math.sin(world.yaw)


def stands_m2(world: SimpleWorld, x0: float, y0: float, x1: float, y1: float) -> float:
    """Of that rectangle."""
    rows = np.arange(world.crop.shape[0]) * CELL - world.margin
    columns = np.arange(world.crop.shape[1]) * CELL - world.margin
    inside = np.ix_((rows > y0) & (rows < y1), (columns > x0) & (columns < x1))
    return float(world.crop[inside].sum()) * CELL**2


@pytest.mark.parametrize("fewer", [2, 5])
def test_strips_that_the_plan_does_not_have_are_gathered(fewer: int) -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, without(fewer))
    harvest(world, pilot, 900.0)
    assert pilot.phase is Phase.FINISHED, pilot.reason
    assert pilot.plan.gathered >= 1
    assert stands_m2(world, 0.0, 0.0, 10.0, 10.0) < GATHER_M2[0] + 0.3
    assert world.neighbour_cut == 0


def test_what_an_earlier_run_has_cut_is_not_looked_for() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, replace(PLAN, sides=PLAN.sides[:1], done=3))
    harvest(world, pilot, 200.0)
    assert pilot.phase is Phase.FINISHED
    assert pilot.plan.gathered == 0


def test_where_nobody_has_said_how_wide_the_gap_is_it_goes_nowhere_across_the_field() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, replace(PLAN, sides=PLAN.sides[:-3], gap_m=None))
    harvest(world, pilot, 900.0)
    assert pilot.phase is Phase.FINISHED
    assert pilot.plan.gathered == 0


@pytest.mark.parametrize(
    ("gap_m", "sigma_m", "known"),
    [
        (1.0, 0.45, True),
        (1.0, 0.55, False),
        (2.0, 0.9, True),
        (2.0, 1.1, False),
        (6.0, 1.1, False),
    ],
)
def test_how_well_it_must_know_its_place_for_that_hangs_on_the_gap(
    gap_m: float, sigma_m: float, known: bool
) -> None:
    plan = spiral(SQUARE, 1, VEHICLE, gap_m=gap_m, sigma_m=sigma_m)
    assert standing(plan, None).place_known is known


def test_one_gap_that_is_seen_to_be_narrow_asks_for_as_much_as_if_it_had_been_said() -> None:
    context = standing(spiral(SQUARE, 1, VEHICLE, gap_m=2.0, sigma_m=0.6), None)
    assert context.place_known
    context.gaps.note(2, 1.2)
    assert not context.place_known


def test_on_its_way_across_the_field_it_drives_through_no_crop_and_turns_no_blade() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, without(len(PLAN.sides) - 8))
    drive(world, pilot, 600.0, until=lambda: pilot.doing is Doing.GATHER)
    before = world.coverage
    drive(world, pilot, 60.0, until=lambda: pilot.doing is Doing.TURN)
    blades: list[bool] = []
    middles: list[float] = []

    def arrived() -> bool:
        blades.append(world.command.blade)
        x, y = (at + 0.5 * part for at, part in zip(world.pose()[:2], ahead(world), strict=True))
        middles.append(stands_m2(world, x - 0.1, y - 0.1, x + 0.1, y + 0.1))
        return pilot.doing is not Doing.TURN

    drive(world, pilot, 200.0, until=arrived)
    assert pilot.doing is Doing.SEARCH
    assert not any(blades)
    assert world.coverage == before
    assert sum(middles) == 0.0


def test_without_pictures_it_goes_nowhere_and_says_what_stands() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, replace(PLAN, sides=PLAN.sides[:-3]))
    drive(world, pilot, 900.0, until=lambda: pilot.doing is Doing.GATHER)
    world.unusable = True
    before = world.pose()[:2]
    harvest(world, pilot, world.now + 200.0)
    assert pilot.phase is Phase.FINISHED
    assert math.dist(before, world.pose()[:2]) < 0.2
    assert f"{stands_m2(world, 0.0, 0.0, 10.0, 10.0):.0f} m2 stand" in pilot.reason


def test_a_plan_without_sides_gathers_nothing() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, Plan(boundary=tuple(SQUARE), gap_m=2.0))
    harvest(world, pilot, 900.0)
    assert pilot.plan.gathered == 0
