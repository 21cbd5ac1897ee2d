"""The pilot in a plane world: whole harvests, and what it does when things go wrong."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from host.core.messages import Command, Fix, Frame, Request, State
from host.core.vehicle import Vehicle
from host.estimate.motion_model import YAW_SIGMA_SHARE
from host.pilot.context import Context
from host.pilot.phase import Phase
from host.pilot.pilot import Pilot
from host.route.plan import spiral
from host.vision.view import CropView
from tests.helpers.places import spun, sure_of
from tests.helpers.simple_world import BLANK, SimpleWorld, drive, harvest

VEHICLE = Vehicle()
SQUARE = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
SMALL_M = 7.0
SMALL = [(0.0, 0.0), (SMALL_M, 0.0), (SMALL_M, SMALL_M), (0.0, SMALL_M)]
"""Half of the square's work."""


def pilot_for(world: SimpleWorld) -> Pilot:
    return Pilot(VEHICLE, world, spiral(SQUARE, 1, VEHICLE))


def in_a_small_field(turn: str = "three_point", **more: float) -> tuple[SimpleWorld, Pilot]:
    world = SimpleWorld(VEHICLE, SMALL_M, SMALL_M, **more)  # type: ignore[arg-type]
    return world, Pilot(VEHICLE, world, spiral(SMALL, 1, VEHICLE, turn))


def test_without_a_wheel_sensor_it_begins_no_field_that_has_a_boundary() -> None:
    """By its duty alone a machine on a slope drove six metres beyond, and cut there."""
    world, pilot = in_a_small_field(hall=False)
    harvest(world, pilot)
    assert pilot.phase is Phase.FAULT
    assert "no wheel sensor" in pilot.reason
    assert world.state is State.SAFE, "not even armed"


def test_without_a_wheel_sensor_it_follows_an_edge_that_is_in_no_plan() -> None:
    world = SimpleWorld(VEHICLE, SMALL_M, SMALL_M, hall=False)
    begun = world.y
    pilot = Pilot(VEHICLE, world)
    drive(world, pilot, 15.0)
    assert world.y > begun + 3.0


@pytest.mark.parametrize(
    ("left_m2", "phase"), [(0.0, Phase.FINISHED), (2.0, Phase.FINISHED), (10.0, Phase.FAULT)]
)
def test_what_stands_at_its_end_is_told_and_much_of_it_is_no_finish(
    monkeypatch: pytest.MonkeyPatch, left_m2: float, phase: Phase
) -> None:
    world = SimpleWorld(VEHICLE, SMALL_M, SMALL_M)
    plan = spiral(SMALL, 1, VEHICLE)
    pilot = Pilot(VEHICLE, world, replace(plan, sides=plan.sides[:1]))
    monkeypatch.setattr(Context, "left_m2", left_m2)
    harvest(world, pilot)
    assert pilot.phase is phase
    assert (f"{left_m2:.0f} m2 stand" in pilot.reason) is (left_m2 > 0.0)


@pytest.mark.parametrize("error_deg", [-2.0, 1.0])
def test_a_steering_pot_whose_zero_is_off_is_learned_on_the_way(error_deg: float) -> None:
    world, pilot = in_a_small_field(pot_error=math.radians(error_deg))
    harvest(world, pilot)
    assert pilot.phase is Phase.FINISHED
    assert math.degrees(pilot.trim_rad) == pytest.approx(error_deg, abs=0.3)
    assert world.coverage > 0.995
    assert world.neighbour_cut == 0


@pytest.mark.parametrize("speed_error", [0.85, 1.0, 1.15])
def test_cuts_the_whole_field_and_nothing_else(speed_error: float) -> None:
    world, pilot = in_a_small_field(speed_error=speed_error)
    harvest(world, pilot)
    assert pilot.phase is Phase.FINISHED
    assert pilot.turns == len(spiral(SMALL, 1, VEHICLE).sides) - 1
    assert world.coverage > 0.995
    assert world.neighbour_cut == 0


def test_the_papers_arc_leaves_more_standing_than_the_three_point_turn() -> None:
    (arc, by_arc), (square, by_square) = (in_a_small_field(turn) for turn in ("arc", "three_point"))
    harvest(arc, by_arc)
    harvest(square, by_square)
    assert square.coverage > 0.995
    assert arc.coverage < 0.8


def test_never_reverses_with_the_blade_on() -> None:
    world = SimpleWorld(VEHICLE)
    log: list[Command] = []
    drive(world, pilot_for(world), 60.0, log)
    assert any(c.speed_mps < 0 for c in log)
    assert not any(c.blade and c.speed_mps < 0 for c in log)


def test_arms_before_it_moves() -> None:
    world = SimpleWorld(VEHICLE)
    log: list[Command] = []
    drive(world, pilot_for(world), 2.0, log)
    first_motion = next(k for k, c in enumerate(log) if c.speed_mps != 0)
    assert any(c.request is Request.ARM for c in log[:first_motion])
    assert all(not c.blade for c in log[:first_motion])


def test_blind_it_stops_within_half_a_metre_blade_off_and_goes_on_when_sight_returns() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = pilot_for(world)
    drive(world, pilot, 10.0)
    assert pilot.phase is Phase.FOLLOW
    before = world.y
    world.blind = True
    drive(world, pilot, 5.0)
    assert pilot.phase is Phase.HESITATE
    assert "dust" in pilot.reason
    assert world.y - before < 0.5
    assert abs(world.speed) < 0.01
    assert not world.command.blade
    world.blind = False
    drive(world, pilot, 5.0)
    assert pilot.phase is Phase.FOLLOW
    assert world.y - before > 1.0


def test_without_pictures_it_stops_too() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = pilot_for(world)
    drive(world, pilot, 10.0)
    before = world.y
    for _ in range(200):
        world.advance()
        world.command = pilot.step(world.now, None, None, world.telemetry())
    assert pilot.phase is Phase.HESITATE
    assert world.y - before < 0.6
    assert not world.command.blade


@pytest.mark.parametrize("spoilt", [False, True], ids=["no pictures", "unusable pictures"])
def test_blind_in_a_turn_it_stops_and_finishes_the_turn_when_it_sees_again(spoilt: bool) -> None:
    world = SimpleWorld(VEHICLE)
    pilot = pilot_for(world)
    while not (pilot.phase is Phase.TURN and world.speed < -0.2):
        drive(world, pilot, 0.2)
    before, began = world.distance, world.now
    world.unusable = spoilt
    while world.now < began + 5.0:
        world.advance()
        frame = Frame(world.now, BLANK) if spoilt else None
        world.command = pilot.step(world.now, frame, None, world.telemetry())
    assert pilot.phase is Phase.HESITATE
    assert pilot.transitions[-1].stamp - began < 1.0
    assert abs(world.distance - before) < 0.5
    assert world.speed == pytest.approx(0.0, abs=0.01)
    world.unusable = False
    drive(world, pilot, 30.0)
    phases = [t.phase for t in pilot.transitions]
    after = phases.index(Phase.HESITATE)
    assert phases[after : after + 4] == [Phase.HESITATE, Phase.TURN, Phase.SEARCH, Phase.FOLLOW]


def test_positions_that_show_it_going_backwards_stop_it() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = pilot_for(world)
    drive(world, pilot, 8.0)
    assert pilot.phase is Phase.FOLLOW
    for tick in range(150):
        world.advance()
        frame = Frame(world.now, BLANK) if tick % 5 == 0 else None
        south = Fix(world.now, 0.0, 0.0, 1, 1.0, 8, 0.5, -math.pi / 2) if tick % 50 == 0 else None
        world.command = pilot.step(world.now, frame, south, world.telemetry())
    assert pilot.phase is Phase.FAULT
    assert "other way" in pilot.reason
    assert world.command.request is Request.STOP


def test_strips_that_have_turned_against_the_plan_stop_it() -> None:
    """Plan, lane and dead reckoning agree and are wrong; only the receiver's courses tell."""
    world = SimpleWorld(VEHICLE, height=40.0)
    long = [(0.0, 0.0), (10.0, 0.0), (10.0, 40.0), (0.0, 40.0)]
    pilot = Pilot(VEHICLE, world, spiral(long, 1, VEHICLE))
    for tick in range(1, 5000):
        world.advance()
        frame = Frame(world.now, BLANK) if tick % 5 == 0 else None
        course = world.yaw + math.radians(10)
        askew = Fix(world.now, 0.0, 0.0, 1, 1.0, 8, abs(world.speed), course)
        fix = askew if tick % 50 == 0 else None
        world.command = pilot.step(world.now, frame, fix, world.telemetry())
        if pilot.done:
            break
    assert pilot.phase is Phase.FAULT
    assert "10 deg askew" in pilot.reason
    assert world.command.request is Request.STOP
    assert world.y < 30.0


def test_a_hesitation_that_lasts_ends_in_a_stop() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = pilot_for(world)
    drive(world, pilot, 10.0)
    world.blind = True
    drive(world, pilot, 70.0)
    assert pilot.phase is Phase.FAULT
    assert "gave up" in pilot.reason
    assert world.command.request is Request.STOP


@pytest.mark.parametrize(
    ("state", "word"), [(State.FAULT, "reports a fault"), (State.SAFE, "disarmed")]
)
def test_a_firmware_that_faults_or_restarts_is_answered_with_stop_and_never_armed_again(
    state: State, word: str
) -> None:
    world = SimpleWorld(VEHICLE)
    pilot = pilot_for(world)
    drive(world, pilot, 10.0)
    world.state = state
    log: list[Command] = []
    drive(world, pilot, 5.0, log)
    assert pilot.phase is Phase.FAULT
    assert word in pilot.reason
    assert {c.request for c in log} == {Request.STOP}


class AlwaysCrop:
    """Vision that never sees an end: what a neighbour's crop without a gap would look like."""

    def see(self, bgr: np.ndarray, *, stages: bool = False) -> CropView:
        del bgr, stages
        return CropView(
            0.9, edge_offset_m=0.0, edge_heading_rad=0.0, crop_ahead_m=0.0, ahead_confidence=1.0
        )

    def glance(self, bgr: np.ndarray) -> CropView:
        return self.see(bgr)

    def next_crop(self, gap_m: float) -> None: ...

    def restart(self, *, turned: bool = True) -> None: ...


def test_the_boundary_stops_it_where_vision_does_not() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, AlwaysCrop(), spiral(SQUARE, 1, VEHICLE))
    drive(world, pilot, 60.0)
    assert pilot.phase is Phase.FAULT
    assert "boundary" in pilot.reason
    assert world.neighbour_cut == 0
    assert world.y + VEHICLE.blade_x_m < 12.0


def over_clear_ground(length_m: float, at_m: float = 4.0) -> tuple[SimpleWorld, Pilot]:
    """A drive along a side on which nothing stands from at_m on."""
    world = SimpleWorld(VEHICLE)
    pilot = pilot_for(world)
    row = round((at_m + world.margin) / 0.025)
    world.crop[row : row + round(length_m / 0.025), :] = False
    drive(world, pilot, 18.0 + 2 * (at_m - 4.0))
    return world, pilot


def test_a_bare_patch_does_not_end_a_side() -> None:
    world, pilot = over_clear_ground(0.5)
    assert pilot.turns == 0
    assert world.y + VEHICLE.blade_x_m > 6.0


def test_crop_behind_clear_ground_as_wide_as_a_gap_is_left_to_a_person() -> None:
    """As far from the plan's end as a boundary may err: there it may be the neighbour's."""
    world, pilot = over_clear_ground(1.5, at_m=7.0)
    assert pilot.phase is Phase.HESITATE, "it goes back once, to look from there"
    drive(world, pilot, 40.0)
    assert pilot.phase is Phase.FAULT
    assert pilot.reason.startswith("clear ground for")
    assert world.y + VEHICLE.blade_x_m < 8.3


def test_steering_in_the_papers_literal_sense_diverges() -> None:
    """Paper, II, case 1: E_outer left of O_map, "vehicle moves towards right"."""

    def final_offset(sense: float) -> float:
        offset, heading = 0.1, 0.0
        for _ in range(200):
            blade = offset + VEHICLE.blade_x_m * math.sin(heading)
            curvature = -sense * 1.6 * blade
            offset += 0.02 * math.sin(heading)
            heading += 0.02 * max(-1.1, min(1.1, curvature))
        return abs(offset)

    assert final_offset(+1.0) < 0.03
    assert final_offset(-1.0) > 1.0


def test_an_end_that_vision_does_not_see_is_the_plans_once_but_not_twice() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, AlwaysCrop(), spiral(SQUARE, 1, VEHICLE, gap_m=world.gap))
    drive(world, pilot, 60.0, until=lambda: pilot.phase is Phase.TURN)
    assert "vision has not seen" in pilot.reason
    assert not pilot.ends, "nobody has seen one"
    drive(world, pilot, 120.0, until=lambda: pilot.done)
    assert (pilot.phase, pilot.turns) == (Phase.FAULT, 1)
    assert world.neighbour_cut == 0


def test_the_geofence_stops_it_before_the_permitted_area_ends_whatever_vision_says() -> None:
    world = SimpleWorld(VEHICLE)
    plan = spiral(SQUARE, 1, VEHICLE, "three_point", world.gap)
    endless = tuple(replace(side, length_m=99.0, fence_m=99.0) for side in plan.sides)
    pilot = Pilot(VEHICLE, AlwaysCrop(), replace(plan, sides=endless))
    drive(world, pilot, 60.0)
    assert pilot.phase is Phase.FAULT
    assert "geofence" in pilot.reason
    assert world.y + VEHICLE.blade_x_m < 10 + world.gap - 0.2


def test_the_geofence_counts_how_far_an_uncertain_direction_moves_the_blade() -> None:
    """Along the outer edge of a narrow gap, the axle known to a centimetre."""
    world = SimpleWorld(VEHICLE, gap=1.0)
    pilot = Pilot(VEHICLE, world, spiral(SQUARE, 1, VEHICLE, "three_point", world.gap))
    drive(world, pilot, 10.0)
    for yaw_sigma_deg, slowed in ((1.0, False), (30.0, True)):
        spun(pilot.position, math.radians(yaw_sigma_deg), YAW_SIGMA_SHARE, pilot.motion)
        sure_of(pilot.position, 0.01, 0.01, math.radians(yaw_sigma_deg))
        log: list[Command] = []
        drive(world, pilot, 0.04, log)
        assert ("geofence" in log[-1].reason) == slowed, log[-1]


@pytest.mark.parametrize("gap_m", [1.2, 1.6])
def test_a_turn_that_the_geofence_cuts_short_goes_on_the_other_way(gap_m: float) -> None:
    world = SimpleWorld(VEHICLE, width=6.0, height=6.0, gap=gap_m)
    plan = spiral([(0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (0.0, 6.0)], 1, VEHICLE, gap_m=gap_m)
    world.stand_at(plan.sides[0])
    pilot = Pilot(VEHICLE, world, plan)
    harvest(world, pilot, 900.0)
    assert pilot.phase is Phase.FINISHED, pilot.reason
    assert world.coverage > 0.96, "what any finished field has at least"
    assert world.neighbour_cut == 0


def test_the_stated_uncertainty_of_the_position_holds() -> None:
    world = SimpleWorld(VEHICLE, speed_error=1.1)
    pilot = Pilot(VEHICLE, world, spiral(SQUARE, 1, VEHICLE, "three_point", world.gap))
    beyond = looks = 0
    for _ in range(200):
        drive(world, pilot, 2.0)
        if not pilot.position.known:
            continue
        x, y, _ = pilot.position.pose
        error = np.array([x - world.x, y - world.y])
        distance = error @ np.linalg.solve(
            pilot.position.borders.covariance_of(np.array([[x, y]]))[0], error
        )
        looks += 1
        beyond += distance > 9.0
    assert looks > 150
    assert beyond < 0.02 * looks
    assert world.coverage > 0.5


@pytest.mark.parametrize(
    "corners",
    [
        [(0.0, 0.0), (9.0, 0.0), (7.0, 6.0), (1.5, 6.0)],
        [(0.0, 0.8), (5.6, 0.0), (9.6, 3.2), (8.8, 7.2), (4.0, 8.8), (0.8, 5.6)],
        [(0.0, 0.0), (8.0, 0.0), (8.0, 4.0), (4.0, 4.0), (4.0, 8.0), (0.0, 8.0)],
    ],
)
def test_fields_with_other_corners_than_right_angles(corners: list[tuple[float, float]]) -> None:
    world = SimpleWorld(VEHICLE, width=9.6, height=8.8, polygon=corners)
    plan = spiral(corners, 0, VEHICLE, "three_point", world.gap)
    world.stand_at(plan.sides[0])
    pilot = Pilot(VEHICLE, world, plan)
    harvest(world, pilot, 2000.0)
    assert pilot.done
    assert world.coverage > 0.99
    assert world.neighbour_cut == 0
