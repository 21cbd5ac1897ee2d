"""Facts about what a pilot learns of the machine and of its own way, in the plane world."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from host.core.vehicle import Vehicle
from host.pilot.phase import Doing, Phase
from host.pilot.pilot import Pilot
from host.route.plan import Plan, spiral
from tests.helpers.simple_world import SimpleWorld, drive

VEHICLE = Vehicle()
LONG = [(0.0, 0.0), (24.0, 0.0), (24.0, 8.0), (0.0, 8.0)]


def ways(world: SimpleWorld, plan: Plan, sides: int) -> dict[int, np.ndarray]:
    """(n, 3) true poses while each of the first sides was cut."""
    pilot = Pilot(VEHICLE, world, plan)
    found: dict[int, list[tuple[float, float, float]]] = {}

    def over() -> bool:
        if pilot.phase is Phase.FOLLOW and pilot.cut_m > 0:
            found.setdefault(pilot.turns, []).append(world.pose())
        return pilot.turns >= sides or pilot.done

    drive(world, pilot, 1500.0, until=over)
    assert pilot.turns == sides, pilot.reason
    return {turn: np.array(poses) for turn, poses in found.items()}


def test_how_much_the_machine_turns_is_learned_from_its_turns() -> None:
    world = SimpleWorld(VEHICLE, yaw_gain=0.96)
    square = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
    plan = spiral(square, 1, VEHICLE)
    world.stand_at(plan.sides[0])
    askew = [
        abs(math.remainder(way[0, 2] - plan.sides[k].heading_rad, math.tau))
        for k, way in ways(world, plan, 9).items()
    ]
    assert math.degrees(askew[1]) > 1.0, "by its own reckoning it turned 90 deg"
    assert math.degrees(max(askew[2:])) < 0.6


def test_the_short_strips_of_a_shuttle_teach_nothing_of_the_steerings_bias() -> None:
    """Each is begun as the turn before it has left the machine, and is over before it is in
    line."""
    world = SimpleWorld(VEHICLE, height=5.5, gap=5.0)
    first = spiral([(0.0, 0.0), (10.0, 0.0), (10.0, 5.5), (0.0, 5.5)], 1, VEHICLE).sides[0]
    strips = [replace(first, x_m=first.x_m - k * VEHICLE.pass_m, back_m=2.0) for k in range(5)]
    pilot = Pilot(VEHICLE, world, Plan(sides=tuple(strips)))
    drive(world, pilot, 60.0, until=lambda: pilot.turns == 1)
    world.pot_error = math.radians(1.0)
    known = pilot.trim_rad
    drive(world, pilot, 600.0, until=lambda: pilot.turns == 4 or pilot.done)
    assert pilot.turns == 4, pilot.reason
    assert pilot.trim_rad == pytest.approx(known, abs=1e-5)


def test_short_sides_round_a_corner_do_teach_the_steerings_bias() -> None:
    """The turn to each is not the one before it."""
    world = SimpleWorld(VEHICLE, width=5.5, height=5.5, pot_error=math.radians(-2.0))
    plan = spiral([(0.0, 0.0), (5.5, 0.0), (5.5, 5.5), (0.0, 5.5)], 1, VEHICLE)
    world.stand_at(plan.sides[0])
    pilot = Pilot(VEHICLE, world, plan)
    drive(world, pilot, 90.0, until=lambda: pilot.turns == 1)
    early = pilot.trim_rad
    drive(world, pilot, 300.0, until=lambda: pilot.turns == 5 or pilot.done)
    assert pilot.turns == 5, pilot.reason
    assert math.degrees(pilot.trim_rad) == pytest.approx(-2.0, abs=0.3)
    assert abs(math.degrees(early) + 2.0) > 0.3, "one side does not tell all of it"


def test_bends_are_not_copied_from_round_to_round() -> None:
    wavy = [(float(x), 0.05 * math.sin(math.tau * x / 6.0)) for x in np.arange(0.0, 24.01, 0.1)]
    world = SimpleWorld(VEHICLE, width=24.0, height=8.0, polygon=[*wavy, (24.0, 8.0), (0.0, 8.0)])
    plan = spiral(LONG, 0, VEHICLE)
    world.stand_at(plan.sides[0])
    found = ways(world, plan, 9)

    def beside(way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of the blade's way against the line that it follows: its first 2 m, where it is as the
        turn before has left it, and the rest."""
        left = way[:, 1] + VEHICLE.blade_x_m * np.sin(way[:, 2])
        rest = way[:, 0] > way[0, 0] + 2.0
        off = left - np.polyval(np.polyfit(way[rest, 0], left[rest], 2), way[:, 0])
        return off[~rest], off[rest]

    def bends(way: np.ndarray) -> float:
        return float(beside(way)[1].std())

    assert bends(found[0]) == pytest.approx(0.035, abs=0.005), "the border's own"
    assert bends(found[4]) < 0.46 * bends(found[0])
    assert bends(found[8]) < 0.16 * bends(found[0])
    assert all(abs(beside(found[k])[0]).max() < 0.06 for k in (4, 8))


def test_an_edge_that_is_seen_farther_ahead_is_taken_there() -> None:
    """Before crop that is not being cut yet, askew to it."""
    world = SimpleWorld(VEHICLE, width=24.0, height=8.0)
    plan = spiral(LONG, 0, VEHICLE)
    world.stand_at(plan.sides[0])
    world.x -= 0.9
    world.yaw += math.radians(4)
    pilot = Pilot(VEHICLE, world, plan)
    drive(world, pilot, 20.0, until=lambda: pilot.phase is Phase.FOLLOW)
    blade_y = world.y + VEHICLE.blade_x_m * math.sin(world.yaw)
    assert pilot.lane.blade_offset_m == pytest.approx(blade_y - VEHICLE.inset_m, abs=0.02)


@pytest.mark.parametrize("left_m", [0.35, -0.35])
def test_the_way_and_the_speed_of_turns_are_the_axle_s_whichever_wheel_is_counted(
    left_m: float,
) -> None:
    vehicle = VEHICLE.model_copy(update={"hall_left_m": left_m})
    world = SimpleWorld(vehicle)
    plan = spiral([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)], 1, vehicle)
    world.stand_at(plan.sides[0])
    pilot = Pilot(vehicle, world, plan)
    off_m: list[float] = []
    turning_mps: list[float] = []

    def over() -> bool:
        off_m.append(abs(world.distance - pilot.motion.distance_m))
        if pilot.doing is Doing.TURN:
            turning_mps.append(abs(world.speed))
        return pilot.turns >= 3 or pilot.done

    drive(world, pilot, 300.0, until=over)
    assert pilot.turns == 3, pilot.reason
    assert max(off_m) < 0.03
    fast = np.quantile(turning_mps, 0.98)  # but for running out from the side before
    assert fast == pytest.approx(vehicle.manoeuvre_speed_mps, abs=0.01)
