"""Facts about driving around what stands beside a lane: as far as the place is uncertain, to the
side where the ground is cut, and no farther."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from host.core.vehicle import Vehicle
from host.estimate.odometry import Motion
from host.estimate.position import Position
from host.pilot.guard import Guard
from host.pilot.keep_clear import FAR_M, MOST_M, ROOM_M, SLOPE, KeepClear
from host.pilot.pilot import Pilot
from host.route.plan import spiral
from host.route.side import Side
from tests.helpers.eyes import Eyes
from tests.helpers.simple_world import SimpleWorld, drive

VEHICLE = Vehicle()
RING = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)]
SIDE = spiral(RING, 0, VEHICLE, gap_m=2.0).sides[0]
LEFT_END_M = VEHICLE.inset_m + VEHICLE.blade_width_m / 2
RIGHT_END_M = VEHICLE.inset_m - VEHICLE.blade_width_m / 2
SIGMAS = 2.0
AT_M = 8.0
"""Where the blade is, along the side."""


def placed(sigma_m: float, at_m: float = AT_M, side: Side = SIDE) -> Position:
    position = Position(VEHICLE)
    position.place(side, at_m, 0.0, 0.0, (0.01, sigma_m, 0.0))
    position.predict(Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), cutting=False)
    return position


def post(x_m: float, y_m: float, across_m: float = 0.4) -> list[tuple[float, float]]:
    half = across_m / 2
    corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    return [(x_m + dx, y_m + dy) for dx, dy in corners]


def aside(
    keep_out: list[tuple[float, float]],
    sigma_m: float = 0.2,
    at_m: float = AT_M,
    side: Side = SIDE,
) -> float:
    clear = KeepClear([keep_out], SIGMAS, VEHICLE, placed(sigma_m, at_m, side))
    clear.look()
    return clear.aside_m


def left_of_the_blade(gap_m: float, x_m: float = AT_M - 0.5) -> list[tuple[float, float]]:
    return post(x_m, LEFT_END_M + gap_m + 0.2)


@pytest.mark.parametrize("sigma_m", [0.1, 0.15, 0.2])
def test_it_is_passed_as_far_off_as_the_place_is_known(sigma_m: float) -> None:
    found = aside(left_of_the_blade(0.2), sigma_m)
    assert found == pytest.approx(0.2 - SIGMAS * sigma_m - ROOM_M, abs=0.01)


def test_a_place_that_is_known_needs_no_way_around() -> None:
    assert aside(left_of_the_blade(0.2), 0.02) == 0.0


def test_what_stands_on_the_right_is_passed_on_the_left() -> None:
    found = aside(post(AT_M - 0.5, RIGHT_END_M - 0.2 - 0.2))
    assert found == pytest.approx(SIGMAS * 0.2 + ROOM_M - 0.2, abs=0.01)


def test_half_of_the_blade_goes_on_cutting() -> None:
    assert aside(left_of_the_blade(0.2), 2.0) == -MOST_M


@pytest.mark.parametrize("away_m", [1.0, 2.0])
def test_the_way_around_begins_before_it_and_ends_behind_it(away_m: float) -> None:
    beside = aside(left_of_the_blade(0.1))
    ahead = aside(left_of_the_blade(0.1, AT_M + away_m + 0.2))
    rear = AT_M - VEHICLE.blade_x_m - VEHICLE.rear_overhang_m
    behind = aside(left_of_the_blade(0.1, rear - away_m - 0.2))
    assert ahead == pytest.approx(beside + SLOPE * away_m, abs=0.01)
    assert behind == pytest.approx(ahead, abs=0.01)


def test_nothing_far_off_is_in_the_way() -> None:
    assert aside(left_of_the_blade(FAR_M + 0.1), 2.0) == 0.0


def test_before_what_stands_ahead_it_does_not_turn_aside() -> None:
    assert aside(post(AT_M + 1.0, VEHICLE.inset_m)) == 0.0


INNER = replace(SIDE, places_m=((0.0, VEHICLE.pass_m),))


@pytest.mark.parametrize(
    ("side", "low_m", "away_m", "passed_m"),
    [
        (INNER, 0.05, 0.0, 0.95),
        (INNER, 0.05, 2.0, 0.35),
        (INNER, -0.05, 0.0, None),
        (SIDE, 0.05, 0.0, None),
        (replace(INNER, length_m=AT_M + 2.3), 0.05, 2.0, None),
    ],
    ids=["beside", "ahead", "too far right", "no strip beside is cut", "at the strip's end"],
)
def test_what_stands_before_a_part_of_the_blade_is_passed_over_the_swath_beside(
    side: Side, low_m: float, away_m: float, passed_m: float | None
) -> None:
    """It takes what of the blade stands before it, the place's doubt and room (random field
    10104)."""
    keep_out = post(AT_M + away_m + (0.2 if away_m else -0.5), VEHICLE.inset_m + low_m + 0.2)
    found = aside(keep_out, side=side)
    assert found == (0.0 if passed_m is None else pytest.approx(-passed_m, abs=0.01))


def test_what_stands_right_of_the_blade_s_middle_is_not_passed_on_the_right() -> None:
    """However well the place is known, and though the ground there is cut."""
    assert aside(post(AT_M - 0.5, VEHICLE.inset_m - 0.05), 0.05, side=INNER) == 0.0
    assert aside(post(AT_M - 0.5, VEHICLE.inset_m + 0.05), 0.05, side=INNER) < 0.0


def test_the_guard_knows_the_keep_outs_of_its_plan_with_their_margin() -> None:
    ring = left_of_the_blade(0.45)
    plan = replace(spiral(RING, 0, VEHICLE, gap_m=2.0), keep_outs=(tuple(ring),))
    assert Guard(plan, VEHICLE, placed(0.2)).keep_clear().aside_m == pytest.approx(
        0.45 - 0.3 - SIGMAS * 0.2 - ROOM_M, abs=0.01
    )
    assert Guard(plan, VEHICLE, Position(VEHICLE)).keep_clear().aside_m == 0.0


@pytest.mark.parametrize(("x_m", "y_m", "near"), [
    (AT_M, LEFT_END_M + 1.0, True),
    (AT_M + 1.0, VEHICLE.inset_m, True),
    (AT_M, LEFT_END_M + FAR_M + 0.3, False),
    (AT_M + FAR_M + 0.3, VEHICLE.inset_m, False),
])  # fmt: skip
def test_near_one_it_says_so(x_m: float, y_m: float, near: bool) -> None:
    clear = KeepClear([post(x_m, y_m)], SIGMAS, VEHICLE, placed(0.1))
    clear.look()
    assert clear.near is near


@pytest.mark.parametrize("stands", [True, False])
def test_a_machine_that_is_unsure_of_its_lane_drives_around_what_stands_beside_it(
    stands: bool,
) -> None:
    ring = [(0.0, 0.0), (12.0, 0.0), (12.0, 30.0), (0.0, 30.0)]
    beside = post(12.0 - LEFT_END_M - 0.3 - 0.15 - 0.2, 9.0)
    plan = spiral(ring, 1, VEHICLE, gap_m=2.0)
    plan = replace(plan, keep_outs=(tuple(beside),) if stands else ())
    world = SimpleWorld(VEHICLE, width=12.0, height=30.0)
    eyes = Eyes(world, lambda view: view)
    pilot = Pilot(VEHICLE, eyes, plan)
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > 4.0)
    lane_m = world.x
    eyes.spoil = lambda view: replace(view, confidence=0.0, edge_offset_m=math.nan)
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > 10.0 or pilot.done)
    assert (world.x - lane_m > 0.05) is stands
    eyes.spoil = lambda view: view
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > 17.0)
    assert world.x == pytest.approx(lane_m, abs=0.03), "and comes back behind it"
