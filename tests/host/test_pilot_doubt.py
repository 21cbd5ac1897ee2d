"""The pilot where the plan, the picture or the position does not tell the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from simple_world import SimpleWorld, drive, harvest

from host.pilot import (
    CREEP_MPS,
    END_PAST_M,
    RESUME_AFTER_S,
    Phase,
    Pilot,
)
from host.plan import Plan, Side, spiral
from host.types import Command, Request
from host.vehicle import Vehicle
from host.vision.view import CropView

VEHICLE = Vehicle()
SQUARE = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
PLAN = spiral(SQUARE, 1, VEHICLE, gap_m=2.0)
FIRST, SECOND = PLAN.sides[:2]


class Eyes:
    """The world's vision, with what a test does to its views and a list of its restarts."""

    def __init__(self, world: SimpleWorld, spoil: Callable[[CropView], CropView]) -> None:
        self.world = world
        self.spoil = spoil
        self.restarts: list[float] = []
        self.looks: list[float] = []

    def see(self, bgr: np.ndarray, *, stages: bool = False) -> CropView:
        self.looks.append(self.world.now)
        return self.spoil(self.world.see(bgr, stages=stages))

    def restart(self) -> None:
        self.restarts.append(self.world.now)


def endless(_view: CropView) -> CropView:
    """Crop for ever, straight ahead."""
    return CropView(
        0.9, edge_offset_m=0.0, edge_heading_rad=0.0, crop_ahead_m=0.0, ahead_confidence=1.0
    )


def only_the_first_strip(plan: Plan) -> tuple[SimpleWorld, Pilot]:
    """Nothing else of the field stands any more."""
    world = SimpleWorld(VEHICLE)
    columns = np.arange(world.crop.shape[1]) * 0.025 - world.margin
    world.crop[:, columns < 10 - VEHICLE.pass_m] = False
    return world, Pilot(VEHICLE, world, plan)


# ---- crop that is not where the plan has it ------------------------------------------------------


def strip(length_m: float, width_m: float) -> Side:
    return replace(SECOND, length_m=length_m, width_m=width_m)


def test_a_last_remnant_that_is_gone_ends_the_field() -> None:
    world, pilot = only_the_first_strip(replace(PLAN, sides=(FIRST, strip(3.5, 0.03))))
    harvest(world, pilot, 120.0)
    assert pilot.phase is Phase.FINISHED
    assert "no crop left" in pilot.reason


def test_a_last_remnant_that_shows_nothing_ends_the_field() -> None:
    world, pilot = only_the_first_strip(replace(PLAN, sides=(FIRST, strip(3.5, 0.03))))
    drive(world, pilot, 100.0, until=lambda: pilot.turns == 1)
    world.unusable = True
    harvest(world, pilot, 200.0)
    assert pilot.phase is Phase.FINISHED
    assert "remnant" in pilot.reason


def test_a_long_side_that_is_gone_needs_a_person() -> None:
    world, pilot = only_the_first_strip(replace(PLAN, sides=(FIRST, SECOND)))
    harvest(world, pilot, 120.0)
    assert pilot.phase is Phase.FAULT
    assert "not to be found" in pilot.reason
    assert world.x > 10 - VEHICLE.blade_x_m - 2.0, "it does not look for it along the whole side"


def test_a_short_side_that_is_gone_is_driven_along_to_the_next() -> None:
    short = strip(2.9, VEHICLE.pass_m)
    north = replace(SECOND, x_m=SECOND.x_m - short.length_m, y_m=SECOND.y_m - 3.0)
    world, pilot = only_the_first_strip(replace(PLAN, sides=(FIRST, short, north, north)))
    harvest(world, pilot, 200.0)
    assert pilot.turns >= 2


# ---- what vision shows ---------------------------------------------------------------------------


def test_beyond_the_plans_end_clear_ground_is_no_dust() -> None:
    """While a side is cut the detector keeps what it knows, for dust looks like clear ground; it
    starts over at every picture beyond the end."""
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, endless)
    pilot = Pilot(VEHICLE, eyes, PLAN)
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > 0.3)
    eyes.restarts.clear()
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > FIRST.length_m)
    assert eyes.restarts == []
    drive(world, pilot, 2.0, until=lambda: pilot.cut_m > FIRST.length_m + END_PAST_M + 0.05)
    eyes.restarts.clear()
    eyes.looks.clear()
    drive(world, pilot, 0.5)
    assert pilot.phase is Phase.FOLLOW
    assert eyes.restarts == eyes.looks != []


def test_while_it_hesitates_nothing_is_dust() -> None:
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, lambda view: view)
    pilot = Pilot(VEHICLE, eyes, PLAN)
    drive(world, pilot, 8.0)
    eyes.spoil = lambda _view: CropView(0.0, reason="nothing")
    drive(world, pilot, 5.0, until=lambda: pilot.phase is Phase.HESITATE)
    eyes.restarts.clear()
    eyes.looks.clear()
    drive(world, pilot, 2.0)
    assert pilot.phase is Phase.HESITATE
    assert eyes.restarts == eyes.looks != []


def test_the_same_view_again_from_the_same_place_proves_nothing_more() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, PLAN)
    drive(world, pilot, 8.0)
    pilot.paused = True
    drive(world, pilot, 3.0)
    before = pilot.lane.offset_sigma_m
    drive(world, pilot, 30.0)
    assert pilot.lane.offset_sigma_m == pytest.approx(before, rel=1e-6)


def beside(offset_m: float) -> Callable[[CropView], CropView]:
    return lambda view: replace(view, edge_offset_m=view.edge_offset_m + offset_m)


def test_an_edge_that_is_elsewhere_stops_it_and_is_believed_while_it_stands() -> None:
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, beside(0.0))
    pilot = Pilot(VEHICLE, eyes, PLAN)
    drive(world, pilot, 8.0)
    before = world.y
    eyes.spoil = beside(1.5)
    drive(world, pilot, 10.0, until=lambda: pilot.phase is Phase.HESITATE)
    assert pilot.phase is Phase.HESITATE
    assert world.y - before < 4.0
    drive(world, pilot, 30.0, until=lambda: pilot.phase is Phase.FOLLOW)
    assert pilot.phase is Phase.FOLLOW


def test_what_made_it_hesitate_has_to_be_gone_for_a_while() -> None:
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, beside(0.0))
    pilot = Pilot(VEHICLE, eyes, PLAN)
    drive(world, pilot, 8.0)
    eyes.spoil = beside(1.5)
    drive(world, pilot, 10.0, until=lambda: pilot.phase is Phase.HESITATE)
    began = world.now
    eyes.spoil = beside(0.0)
    drive(world, pilot, 10.0, until=lambda: pilot.phase is Phase.FOLLOW)
    assert RESUME_AFTER_S <= world.now - began < 3.0


def test_dead_reckoning_along_crop_without_an_edge_lasts_only_a_while() -> None:
    world = SimpleWorld(VEHICLE, width=10.0, height=40.0)
    eyes = Eyes(world, lambda view: view)
    long = spiral([(0.0, 0.0), (10.0, 0.0), (10.0, 40.0), (0.0, 40.0)], 1, VEHICLE, gap_m=2.0)
    pilot = Pilot(VEHICLE, eyes, long)
    drive(world, pilot, 8.0)
    before = world.y
    eyes.spoil = lambda view: replace(view, confidence=0.0)
    drive(world, pilot, 60.0)
    assert pilot.phase is Phase.HESITATE
    assert 1.0 < world.y - before < 12.0
    assert pilot.lane.offset_sigma_m < 0.35


# ---- what the plan says of a side ----------------------------------------------------------------


def test_a_lane_that_is_shifted_is_followed_as_far_to_the_right() -> None:
    shift_m = 0.2
    world = SimpleWorld(VEHICLE)
    usual = world.x
    shifted = replace(FIRST, shift_m=shift_m)
    pilot = Pilot(VEHICLE, world, replace(PLAN, sides=(shifted, *PLAN.sides[1:])))
    drive(world, pilot, 14.0)
    assert pilot.phase is Phase.FOLLOW
    assert world.x - usual == pytest.approx(shift_m, abs=0.03)
    assert pilot.position.pose[0] == pytest.approx(world.x, abs=0.05)


def test_a_side_that_ends_before_a_keep_out_ends_there_though_its_crop_goes_on() -> None:
    world = SimpleWorld(VEHICLE)
    blind = replace(FIRST, length_m=5.0, blind_end=True)
    pilot = Pilot(VEHICLE, world, replace(PLAN, sides=(blind, *PLAN.sides[1:])))
    drive(world, pilot, 60.0, until=lambda: pilot.phase is Phase.TURN)
    coast = world.speed * VEHICLE.drive_lag_s
    assert world.y + VEHICLE.blade_x_m + coast == pytest.approx(5.0, abs=0.05)
    assert "keep-out" in pilot.transitions[-1].reason


# ---- the geofence --------------------------------------------------------------------------------


def test_near_the_border_it_creeps_before_it_stops() -> None:
    world = SimpleWorld(VEHICLE)
    sides = tuple(replace(side, length_m=99.0, fence_m=99.0) for side in PLAN.sides)
    pilot = Pilot(VEHICLE, Eyes(world, endless), replace(PLAN, sides=sides))
    log: list[Command] = []
    drive(world, pilot, 10.0)
    drive(world, pilot, 60.0, log, until=lambda: pilot.done)
    assert "geofence" in pilot.reason
    moving = [c for c in log if c.request is Request.DRIVE and c.speed_mps > 0]
    slow = [c for c in moving if c.speed_mps <= CREEP_MPS]
    assert slow == moving[-len(slow) :], "it does not hurry up again"
    assert len(slow) > 25, "a second or more"
    assert all("geofence" in c.reason for c in slow)


def test_a_machine_that_stands_too_near_the_border_may_leave_it_slowly() -> None:
    world = SimpleWorld(VEHICLE, gap=1.3)
    pilot = Pilot(VEHICLE, world, spiral(SQUARE, 1, VEHICLE, gap_m=1.3))
    log: list[Command] = []
    drive(world, pilot, 15.0, log)
    assert pilot.phase is Phase.FOLLOW
    first = next(c for c in log if c.speed_mps > 0)
    assert first.speed_mps == CREEP_MPS
    assert world.y > 0.0


def test_a_border_behind_ends_the_way_back_instead_of_the_run() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, PLAN)
    drive(world, pilot, 120.0, until=lambda: pilot.turns == 2)
    assert pilot.turns == 2, pilot.reason
