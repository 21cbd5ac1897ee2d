"""The pilot where the plan, the picture or the position does not tell the truth."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import shapely

from host.core.messages import Command, Fix, Frame, Request, State
from host.core.vehicle import Vehicle
from host.estimate.cut_guard import CutGuard
from host.estimate.odometry import HALL_SIGMA, Odometry
from host.estimate.position import Position
from host.field.areas import Geofence, areas_of
from host.pilot import steering_law
from host.pilot.context import BLIND_ON_M, RESUME_AFTER_S
from host.pilot.endings import GIVE_UP_S
from host.pilot.guard import CREEP_MPS
from host.pilot.phase import Doing, Phase
from host.pilot.pilot import Pilot
from host.pilot.plan_side import END_PAST_M
from host.route.cuts import SEEN_SHARE
from host.route.plan import Plan, spiral
from host.route.side import Side
from host.route.turn_choice import next_turn, room_along
from host.route.turn_legs import Turn
from host.vision.view import CropView
from tests.helpers.eyes import Eyes, ToldEnd, beside
from tests.helpers.places import wandered
from tests.helpers.simple_world import BLANK, CELL, SimpleWorld, drive, harvest

VEHICLE = Vehicle()
SQUARE = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
PLAN = spiral(SQUARE, 1, VEHICLE, gap_m=2.0)
FIRST, SECOND = PLAN.sides[:2]


def endless(_view: CropView) -> CropView:
    """Crop for ever, straight ahead."""
    return CropView(
        0.9, edge_offset_m=0.0, edge_heading_rad=0.0, crop_ahead_m=0.0, ahead_confidence=1.0
    )


def only_the_first_strip(plan: Plan) -> tuple[SimpleWorld, Pilot]:
    """Nothing else of the field stands any more: an earlier run has cut it."""
    world = SimpleWorld(VEHICLE)
    columns = np.arange(world.crop.shape[1]) * 0.025 - world.margin
    world.crop[:, columns < 10 - VEHICLE.pass_m] = False
    return world, Pilot(VEHICLE, world, replace(plan, done=1))


# ---- an edge that is lost inside the crop --------------------------------------------------------


@pytest.mark.parametrize(
    ("beside_m", "least_m", "most_m"), [(0.4, 0.15, 0.45), (math.nan, -0.1, 0.1)]
)
def test_a_machine_before_crop_that_goes_on_to_the_right_steers_right_to_where_that_ends(
    beside_m: float, least_m: float, most_m: float
) -> None:
    world = SimpleWorld(VEHICLE)
    begun_x = math.nan

    def spoil(view: CropView) -> CropView:
        if math.isnan(begun_x):
            return view
        most = world.pose()[0] - begun_x - beside_m
        return replace(view, confidence=0.0, edge_heading_rad=math.nan, edge_offset_most_m=most)

    pilot = Pilot(VEHICLE, Eyes(world, spoil), PLAN)
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > 2.0)
    begun_x = world.pose()[0]
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > 6.0)
    assert pilot.cut_m > 6.0
    assert least_m < world.pose()[0] - begun_x < most_m


def test_a_machine_with_crop_on_its_right_moves_aside_to_the_edge_without_stopping() -> None:
    """Picture field 10355: it cut 0.9 m inside of the edge, with crop on both sides, and gave up
    after eight looks that showed no edge. Aside by a tenth of the way."""
    world = SimpleWorld(VEHICLE)
    begun_x = math.nan

    def spoil(view: CropView) -> CropView:
        if math.isnan(begun_x):
            return view
        inside = world.pose()[0] - begun_x < 0.6
        return replace(
            view, confidence=0.0, edge_heading_rad=math.nan, edge_offset_most_m=math.nan,
            crop_right=inside,
        )  # fmt: skip

    pilot = Pilot(VEHICLE, Eyes(world, spoil), PLAN)
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > 2.0)
    begun_x, told = world.pose()[0], len(pilot.transitions)
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > 6.0)
    assert pilot.cut_m > 6.0
    assert 0.3 < world.pose()[0] - begun_x < 0.6
    assert len(pilot.transitions) == told


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


def test_a_long_side_that_begins_late_is_gone_for_as_far_as_its_edge_is_seen() -> None:
    """Its first metres have gone with the strips beside it, more than it is looked for blindly."""
    world = SimpleWorld(VEHICLE)
    columns = np.arange(world.crop.shape[1]) * CELL - world.margin
    world.crop[:, (columns > 5.6) & (columns < 10 - VEHICLE.pass_m)] = False
    pilot = Pilot(VEHICLE, world, PLAN)
    drive(world, pilot, 200.0, until=lambda: pilot.turns == 2 or pilot.done)
    assert pilot.turns == 2, pilot.reason
    assert any("looking for it" in t.reason for t in pilot.transitions)


def test_a_side_whose_first_crop_lies_flat_is_found_behind_it() -> None:
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, lambda view: view)
    pilot = Pilot(VEHICLE, eyes, PLAN)

    def lodged(view: CropView) -> CropView:
        """Nothing upright for three metres: what is seen, from near, is behind them."""
        blade = 10.0 - (world.x - VEHICLE.blade_x_m)
        if pilot.turns != 1 or blade > 3.0:
            return view
        behind = 3.0 - blade
        far = behind if behind < 1.0 else math.inf
        return CropView(0.0, crop_ahead_m=far, ahead_confidence=1.0, reason="no edge")

    eyes.spoil = lodged
    drive(world, pilot, 120.0, until=lambda: pilot.turns == 2 or pilot.done)
    assert pilot.turns == 2, pilot.reason


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
    eyes.turned.clear()
    drive(world, pilot, 0.5)
    assert pilot.phase is Phase.FOLLOW
    assert eyes.restarts == eyes.looks != []
    assert eyes.turned == [], "it is the same crop's end"


def test_a_side_whose_crop_seems_to_begin_early_is_not_too_long_for_that() -> None:
    """As where the tops of farther crop pass for crop at the blade (the low camera)."""
    world = SimpleWorld(VEHICLE)
    tight = replace(SECOND, fence_m=SECOND.length_m - 0.5)
    plan = replace(PLAN, sides=(FIRST, tight, *PLAN.sides[2:]))
    eyes = Eyes(world, lambda view: view)
    pilot = Pilot(VEHICLE, eyes, plan)

    def early(view: CropView) -> CropView:
        begins = pilot.turns == 1 and pilot.phase is Phase.FOLLOW and pilot.cut_m < 0.8
        return replace(view, crop_ahead_m=0.0) if begins else view

    eyes.spoil = early
    drive(world, pilot, 120.0, until=lambda: pilot.turns == 2 or pilot.done)
    assert pilot.turns == 2, pilot.reason


def test_crop_whose_foot_dust_hides_is_met_where_it_was_seen_before() -> None:
    """A side whose crop seems never to be met would be driven on to the geofence."""
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, lambda view: view)
    pilot = Pilot(VEHICLE, eyes, PLAN)

    def dusty(view: CropView) -> CropView:
        hidden = pilot.turns == 1 and pilot.phase is Phase.FOLLOW
        return replace(view, crop_ahead_m=max(view.crop_ahead_m, 0.6)) if hidden else view

    eyes.spoil = dusty
    drive(world, pilot, 120.0, until=lambda: pilot.cut_m > 0.0 and pilot.turns == 1)
    begun = 10.0 - VEHICLE.pass_m - (world.x - VEHICLE.blade_x_m)
    assert 0.0 < begun < 0.5
    drive(world, pilot, 120.0, until=lambda: pilot.turns == 2 or pilot.done)
    assert "no crop before the blade" in pilot.reason
    assert world.x - VEHICLE.blade_x_m == pytest.approx(0.0, abs=0.5)


def test_an_end_that_is_doubted_at_first_was_where_it_was_first_seen() -> None:
    """A detector waits for some pictures until it believes that clear ground is not dust: the
    machine rolls on meanwhile, a fifth of a metre at 0.5 m/s."""

    def believed(doubted: int) -> float:
        """How far along the side the position is at the turn, less where the machine is."""
        world = SimpleWorld(VEHICLE)
        clear = [0]

        def doubting(view: CropView) -> CropView:
            clear[0] = clear[0] + 1 if view.crop_ahead_m > 0.5 else 0
            return replace(view, ahead_confidence=0.4) if 0 < clear[0] <= doubted else view

        pilot = Pilot(VEHICLE, Eyes(world, doubting), PLAN)
        drive(world, pilot, 60.0, until=lambda: pilot.turns == 1)
        return pilot.position.along(FIRST) - world.y - VEHICLE.blade_x_m

    assert believed(5) == pytest.approx(believed(0), abs=0.02)


def test_eyes_that_see_a_slanting_end_to_its_tip_place_it_there() -> None:
    """The low camera sees stems over the tops of none: a twentieth of the blade's width will do."""

    def believed(tip_share: float) -> float:
        """How far along the position has the blade at the turn."""
        world = SimpleWorld(VEHICLE)
        eyes = Eyes(world, lambda view: replace(view, tip_share=tip_share))
        slanting = replace(FIRST, end_seen_m=0.44)
        pilot = Pilot(VEHICLE, eyes, replace(PLAN, sides=(slanting, *PLAN.sides[1:])))
        drive(world, pilot, 60.0, until=lambda: pilot.turns == 1)
        return pilot.position.along(FIRST)

    assert believed(math.nan) == believed(SEEN_SHARE)
    assert believed(0.0) > believed(SEEN_SHARE) + 0.02


def test_while_it_hesitates_nothing_is_dust() -> None:
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, lambda view: view)
    pilot = Pilot(VEHICLE, eyes, PLAN)
    drive(world, pilot, 8.0)
    eyes.spoil = lambda _view: CropView(0.0, reason="nothing")
    drive(world, pilot, 5.0, until=lambda: pilot.phase is Phase.HESITATE)
    eyes.restarts.clear()
    eyes.looks.clear()
    eyes.turned.clear()
    drive(world, pilot, 2.0)
    assert pilot.phase is Phase.HESITATE
    assert eyes.restarts == eyes.looks != []
    assert eyes.turned == [], "the crop before it is the one that it cuts"


def test_in_a_turn_nothing_is_measured_until_it_backs_along_the_next_side() -> None:
    """What is not believed costs nothing."""
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, lambda view: view)
    pilot = Pilot(VEHICLE, eyes, PLAN)
    drive(world, pilot, 120.0, until=lambda: pilot.phase is Phase.TURN)
    drive(world, pilot, 10.0, until=lambda: pilot.doing is Doing.TURN)
    assert eyes.glances == []
    eyes.looks.clear()
    drive(world, pilot, 60.0, until=lambda: pilot.backing)
    assert eyes.glances == eyes.looks != []
    eyes.looks.clear()
    eyes.glances.clear()
    drive(world, pilot, 60.0, until=lambda: pilot.phase is Phase.FOLLOW)
    assert eyes.looks != []
    assert eyes.glances == []


def test_it_says_beforehand_whether_it_reads_a_picture_or_glances_at_it() -> None:
    """Who renders pictures for it need not render those, but all that it reads: also of what stands
    beyond a side's end."""
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, lambda view: view)
    pilot = Pilot(VEHICLE, eyes, PLAN)
    said: list[tuple[bool, int, int, Doing]] = []

    def turned() -> bool:
        said.append((pilot.looks, len(eyes.looks), len(eyes.glances), pilot.doing))
        return pilot.turns == 1 and pilot.phase is Phase.FOLLOW

    drive(world, pilot, 240.0, until=turned)
    asked = [
        (before[0], after[2] > before[2], before[3])
        for before, after in itertools.pairwise(said)
        if after[1] > before[1]
    ]
    assert {doing for reads, _, doing in asked if reads} >= {Doing.FOLLOW, Doing.LOOK_BEYOND}
    assert any(glanced for _, glanced, _ in asked)
    assert all(reads is not glanced for reads, glanced, _ in asked)


def test_whatever_is_seen_in_a_turn_is_other_crop() -> None:
    """Also where it stands and hesitates in one."""
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, lambda view: view)
    pilot = Pilot(VEHICLE, eyes, PLAN)
    drive(world, pilot, 120.0, until=lambda: pilot.phase is Phase.TURN and pilot.turns == 1)
    eyes.looks.clear()
    eyes.turned.clear()
    drive(world, pilot, 3.0)
    assert pilot.phase is Phase.TURN
    eyes.spoil = lambda _view: CropView(0.0, usable=False, reason="covered")
    drive(world, pilot, 2.0)
    assert pilot.phase is Phase.HESITATE
    assert eyes.turned == eyes.looks != []


def test_the_same_view_again_from_the_same_place_proves_nothing_more() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, PLAN)
    drive(world, pilot, 8.0)
    pilot.paused = True
    drive(world, pilot, 3.0)
    before = pilot.lane.offset_sigma_m
    drive(world, pilot, 30.0)
    assert pilot.lane.offset_sigma_m == pytest.approx(before, rel=1e-6)


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


@pytest.mark.parametrize(("aside_m", "taken"), [(2.0, True), (3.0, False), (-3.0, False)])
def test_no_edge_is_the_lanes_while_that_lies_out_of_view(aside_m: float, taken: bool) -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, PLAN)
    drive(world, pilot, 8.0)
    along_m = world.y + VEHICLE.blade_x_m
    before = pilot.position.pose[0] - world.x
    pilot.position.place(FIRST, along_m, pilot.lane.offset_m + aside_m, 0.0, (0.4, 0.4, 0.02))
    put_m = pilot.position.pose[0] - world.x - before
    assert abs(put_m) == pytest.approx(abs(aside_m), abs=0.05)
    drive(world, pilot, 10.0)
    left_m = pilot.position.pose[0] - world.x - before
    assert left_m == pytest.approx(0.0 if taken else put_m, abs=0.3)


def test_a_place_that_a_measurement_moves_by_metres_stops_the_machine_and_a_given_one_not() -> None:
    """An end of another strip, taken for this one's by a machine that is unsure of its place."""
    for given in (True, False):
        world = SimpleWorld(VEHICLE)
        pilot = Pilot(VEHICLE, world, PLAN)
        drive(world, pilot, 8.0)
        along_m, position = pilot.position.along(FIRST), pilot.position
        if given:
            position.place(FIRST, along_m + 3.0, pilot.lane.offset_m, 0.0, (0.4, 0.4, 0.02))
        else:
            position.less_sure_along(FIRST, 5.0)
            position.at_end(FIRST, along_m + 3.0 - FIRST.length_m)
        drive(world, pilot, 0.2)
        assert (pilot.phase is Phase.FAULT) is not given
        assert ("has moved its place by" in pilot.reason) is not given


def test_where_the_border_slants_at_the_start_the_operators_alignment_counts() -> None:
    world = SimpleWorld(VEHICLE)
    seen = corner_of(world, 2.0)
    slanting = replace(FIRST, edge_begin_m=2.0)
    pilot = Pilot(VEHICLE, Eyes(world, seen), replace(PLAN, sides=(slanting, *PLAN.sides[1:])))
    drive(world, pilot, 10.0, until=lambda: pilot.phase is Phase.FOLLOW)
    assert abs(pilot.lane.offset_m) < 0.01
    assert abs(pilot.lane.heading_rad) < math.radians(0.2)
    assert pilot.position.pose[2] == pytest.approx(world.yaw, abs=math.radians(0.2))


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


@pytest.mark.parametrize("where", ["begin", "end"])
def test_what_is_seen_where_the_crops_border_slants_is_not_its_edge(where: str) -> None:
    world = SimpleWorld(VEHICLE)
    usual = world.x
    begin = where == "begin"
    slanting = replace(FIRST, edge_begin_m=2.0 * begin, edge_end_m=2.0 * (not begin))
    eyes = Eyes(world, lambda view: view)
    pilot = Pilot(VEHICLE, eyes, replace(PLAN, sides=(slanting, *PLAN.sides[1:])))

    def spoil(view: CropView) -> CropView:
        along = world.y + VEHICLE.blade_x_m
        slants = 0.0 < along < 1.9 if begin else along > 8.1
        return replace(view, edge_offset_m=view.edge_offset_m + 0.15 * slants)

    eyes.spoil = spoil
    drive(world, pilot, 60.0, until=lambda: world.y + VEHICLE.blade_x_m > (1.9 if begin else 9.9))
    assert pilot.phase is Phase.FOLLOW
    assert world.x == pytest.approx(usual, abs=0.03)


def corner_of(world: SimpleWorld, corner_y: float) -> Callable[[CropView], CropView]:
    """The crop's right end as a camera on the rear axle shows it while the border slants: in line
    with the corner at corner_y, wherever the nearest crop stands."""

    def see(_view: CropView) -> CropView:
        away, aside = corner_y - world.y, 10.0 - world.x
        c, s = math.cos(world.yaw), math.sin(world.yaw)
        forward, left = away * s + aside * c, away * c - aside * s
        at = left / forward * (VEHICLE.blade_x_m + 0.3)
        return CropView(
            0.9,
            edge_offset_m=at + VEHICLE.inset_m,
            edge_ahead_m=0.3,
            crop_ahead_m=0.0,
            ahead_confidence=1.0,
        )

    return see


@pytest.mark.parametrize("beside_m", [-0.2, 0.2])
def test_a_doubtful_lane_is_found_by_the_corner_behind_a_slanting_border(beside_m: float) -> None:
    """Short sides with slanting ends follow one another: dead reckoning alone goes farther astray
    on each."""
    world = SimpleWorld(VEHICLE)
    world.x += beside_m
    eyes = Eyes(world, corner_of(world, 3.0))
    slanting = replace(FIRST, edge_begin_m=3.0)
    pilot = Pilot(VEHICLE, eyes, replace(PLAN, sides=(slanting, *PLAN.sides[1:])))
    drive(world, pilot, 10.0, until=lambda: pilot.phase is Phase.FOLLOW)
    for _ in range(45):
        wandered(pilot.position, 1.0, pilot.motion)
    drive(world, pilot, 20.0, until=lambda: world.y + VEHICLE.blade_x_m > 2.5)
    assert pilot.phase is Phase.FOLLOW
    left_m = 10.0 - VEHICLE.inset_m - world.x
    assert pilot.lane.offset_m == pytest.approx(left_m, abs=0.5 * abs(beside_m))
    assert abs(left_m) < 0.6 * abs(beside_m)


@pytest.mark.parametrize("aside_m", [-0.7, 0.7])
def test_a_corner_far_beside_the_lane_is_another_strips(aside_m: float) -> None:
    """Not even many pictures of it turn the machine."""
    world = SimpleWorld(VEHICLE)
    beside_lane = world.x
    corner = corner_of(world, 3.0)

    def another(view: CropView) -> CropView:
        seen = corner(view)
        return replace(seen, edge_offset_m=seen.edge_offset_m + aside_m)

    eyes = Eyes(world, another)
    slanting = replace(FIRST, edge_begin_m=3.0)
    pilot = Pilot(VEHICLE, eyes, replace(PLAN, sides=(slanting, *PLAN.sides[1:])))
    drive(world, pilot, 10.0, until=lambda: pilot.phase is Phase.FOLLOW)
    for _ in range(30):
        wandered(pilot.position, 1.0, pilot.motion)
    drive(world, pilot, 20.0, until=lambda: world.y + VEHICLE.blade_x_m > 2.5)
    assert world.x == pytest.approx(beside_lane, abs=0.05)


def test_after_a_turn_the_lane_is_as_doubtful_as_the_position() -> None:
    def turned(wandered_m: float) -> float:
        """Uncertainty of the lane where no edge is seen, after so much way that nothing watched."""
        world = SimpleWorld(VEHICLE)
        eyes = Eyes(world, lambda view: view)
        pilot = Pilot(VEHICLE, eyes, PLAN)
        drive(world, pilot, 60.0, until=lambda: pilot.phase is Phase.TURN)
        eyes.spoil = lambda view: replace(view, confidence=0.0)
        wandered(pilot.position, wandered_m, pilot.motion)
        drive(world, pilot, 60.0, until=lambda: pilot.phase is Phase.SEARCH)
        return pilot.lane.offset_sigma_m

    assert turned(30.0) > 1.5 * turned(0.0)


def test_a_slanting_tip_that_is_not_seen_does_not_keep_a_side_from_ending() -> None:
    world = SimpleWorld(VEHICLE, height=8.0)
    tipped = replace(FIRST, end_seen_m=1.0)
    pilot = Pilot(VEHICLE, world, replace(PLAN, sides=(tipped, *PLAN.sides[1:])))
    drive(world, pilot, 60.0, until=lambda: pilot.turns == 1 or world.y > 9.0)
    assert pilot.turns == 1
    assert world.y + VEHICLE.blade_x_m < 9.0


# ---- the geofence --------------------------------------------------------------------------------


def test_near_the_border_it_creeps_before_it_stops() -> None:
    vehicle = VEHICLE.model_copy(update={"hall_left_m": 0.0})  # the speeds are the axle's
    world = SimpleWorld(vehicle)
    sides = tuple(replace(side, length_m=99.0, fence_m=99.0) for side in PLAN.sides)
    pilot = Pilot(vehicle, Eyes(world, endless), replace(PLAN, sides=sides))
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


# ---- turns ---------------------------------------------------------------------------------------


def driven_to_look(
    spoil: Callable[[SimpleWorld, Pilot, CropView], CropView] | None = None,
    turn: str = "three_point",
    pot_error_deg: float = 0.0,
    log: list[tuple[Command, float]] | None = None,
) -> tuple[float, float]:
    """(metres, radians) left of the second side's lane, after the first turn in a wide gap. `log`
    gets each command of the turn and the pilot's steering law in reverse at that moment."""
    world = SimpleWorld(VEHICLE, gap=3.0, pot_error=math.radians(pot_error_deg))
    eyes = Eyes(world, lambda view: view)
    pilot = Pilot(VEHICLE, eyes, replace(PLAN, turn=turn, gap_m=None))
    if spoil is not None:
        eyes.spoil = lambda view: spoil(world, pilot, view)

    def looking() -> bool:
        if log is not None and pilot.phase is Phase.TURN:
            law = steering_law.back(pilot.lane, VEHICLE)
            log.append((world.command, law - pilot.trim_rad))
        return pilot.phase is Phase.SEARCH

    drive(world, pilot, 100.0, until=looking)
    assert pilot.phase is Phase.SEARCH
    drive(world, pilot, 3.0, until=lambda: abs(world.speed) < 0.02)
    lane_y = SECOND.y_m - VEHICLE.inset_m
    return lane_y - world.y, math.remainder(world.yaw - SECOND.heading_rad, math.tau)


def test_what_is_seen_of_the_crops_flank_while_it_backs_out_is_not_its_edge() -> None:
    begins = SECOND.x_m

    def flank(world: SimpleWorld, pilot: Pilot, view: CropView) -> CropView:
        beside = world.x + VEHICLE.blade_x_m * math.cos(world.yaw) < begins
        return endless(view) if pilot.phase is Phase.TURN and beside else view

    def aside(world: SimpleWorld, pilot: Pilot, view: CropView) -> CropView:
        shown = flank(world, pilot, view)
        return view if shown is view else replace(shown, edge_offset_m=0.15)

    assert driven_to_look(aside) == pytest.approx(driven_to_look(), abs=0.005)


def test_an_end_that_is_seen_too_soon_hardly_moves_the_turn() -> None:
    """The position knows the plan's end as well; 0.5 m are what dust or a thin corner may do."""

    def soon(world: SimpleWorld, pilot: Pilot, view: CropView) -> CropView:
        gone = pilot.phase is Phase.FOLLOW and world.y + VEHICLE.blade_x_m > FIRST.length_m - 0.5
        return replace(view, crop_ahead_m=5.0) if gone else view

    (soon_m, _), (usual_m, _) = driven_to_look(soon), driven_to_look()
    assert abs(soon_m - usual_m) < 0.22


def test_the_room_of_a_turn_is_counted_from_the_end_of_the_sides_lane(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shift_m = 0.2
    world = SimpleWorld(VEHICLE)
    shifted = replace(FIRST, shift_m=shift_m)
    told: list[tuple[Turn, float]] = []

    def chosen(plan: Plan, index: int, vehicle: Vehicle, room_m: Callable[[Turn], float]) -> Turn:
        turn = next_turn(plan, index, vehicle, room_m)
        told.append((turn, room_m(turn)))
        return turn

    monkeypatch.setattr("host.pilot.endings.next_turn", chosen)
    pilot = Pilot(VEHICLE, world, replace(PLAN, sides=(shifted, *PLAN.sides[1:])))
    drive(world, pilot, 60.0, until=lambda: pilot.turns == 1)
    ((turn, room_m),) = told
    fence = Geofence(areas_of(shapely.Polygon(SQUARE), 2.0))
    at = (10.0 - VEHICLE.inset_m + shift_m, 10.0 - VEHICLE.blade_x_m, math.pi / 2)
    assert room_m == pytest.approx(room_along(turn, at, VEHICLE, fence), abs=1e-6)


def test_a_leg_is_ended_so_that_it_coasts_to_its_angle() -> None:
    _, heading = driven_to_look(turn="arc")
    assert abs(math.degrees(heading)) < 2.5


def test_what_the_pot_hides_is_taken_off_on_the_way_back_too() -> None:
    log: list[tuple[Command, float]] = []
    driven_to_look(pot_error_deg=2.0, log=log)
    backwards = [(c.steer_rad, law) for c, law in log if c.speed_mps < 0]
    steer, law = backwards[-1]
    assert steer == pytest.approx(law, abs=1e-3)


@pytest.mark.parametrize(("shift_m", "next_shift_m"), [(0.0, 0.0), (0.2, 0.0), (0.0, 0.2)])
def test_a_shuttle_ends_on_the_next_strips_lane_however_either_is_shifted(
    shift_m: float, next_shift_m: float
) -> None:
    world = SimpleWorld(VEHICLE, gap=5.0)
    world.x += shift_m
    width_m = VEHICLE.pass_m - shift_m
    this = replace(FIRST, shift_m=shift_m, width_m=width_m)
    again = replace(FIRST, x_m=FIRST.x_m - width_m, shift_m=next_shift_m, back_m=2.0)
    eyes = Eyes(world, lambda view: view)
    pilot = Pilot(VEHICLE, eyes, replace(PLAN, sides=(this, again), gap_m=None))
    drive(world, pilot, 120.0, until=lambda: pilot.phase is Phase.TURN)
    eyes.spoil = lambda view: replace(view, confidence=0.0)
    drive(world, pilot, 120.0, until=lambda: pilot.phase is Phase.SEARCH)
    assert pilot.phase is Phase.SEARCH, pilot.reason
    lane_x = again.x_m - VEHICLE.inset_m + next_shift_m
    assert world.x == pytest.approx(lane_x, abs=0.08)
    assert pilot.lane.offset_m == pytest.approx(lane_x - world.x, abs=0.05)


def test_how_unsure_the_distance_is_goes_into_what_an_end_proves(
    told_ends: list[ToldEnd], monkeypatch: pytest.MonkeyPatch
) -> None:
    for sigma in (HALL_SIGMA, 4 * HALL_SIGMA):
        monkeypatch.setattr(Odometry, "scale_sigma", sigma)
        world = SimpleWorld(VEHICLE)
        pilot = Pilot(VEHICLE, world, PLAN)
        drive(world, pilot, 60.0, until=lambda p=pilot: p.turns == 1)
    wheels, worse = (end.drift_m for end in told_ends)
    assert 0.05 < wheels < 0.15
    assert worse > 2 * wheels


class Jammed(SimpleWorld):
    """Its front wheel does not turn any more once it is `jammed`."""

    jammed = False

    def advance(self) -> None:
        angle = self.angle
        super().advance()
        if self.jammed:
            self.angle = angle


def test_steering_that_does_not_reach_its_angle_stops_it() -> None:
    world = Jammed(VEHICLE)
    pilot = Pilot(VEHICLE, world, PLAN)
    drive(world, pilot, 60.0, until=lambda: pilot.phase is Phase.TURN and pilot.turns == 1)
    world.jammed = True
    began = world.now
    harvest(world, pilot, 100.0)
    assert pilot.phase is Phase.FAULT
    assert "steering" in pilot.reason
    assert world.now - began < 12.0


# ---- sensors -------------------------------------------------------------------------------------


@pytest.mark.parametrize("error_deg", [2.0, -2.0])
def test_with_a_pot_that_is_off_it_still_follows_the_edge_itself(error_deg: float) -> None:
    world = SimpleWorld(VEHICLE, height=40.0, pot_error=math.radians(error_deg))
    usual = world.x
    field = [(0.0, 0.0), (10.0, 0.0), (10.0, 40.0), (0.0, 40.0)]
    pilot = Pilot(VEHICLE, world, spiral(field, 1, VEHICLE, gap_m=2.0))
    drive(world, pilot, 200.0, until=lambda: world.y > 28.0)
    assert world.x == pytest.approx(usual, abs=0.02)


def test_a_wheel_sensor_that_counts_the_impossible_stops_it() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, PLAN)
    drive(world, pilot, 8.0)
    for _ in range(20):
        world.advance()
        told = replace(world.telemetry(), speed_mps=3 * VEHICLE.full_duty_speed_mps)
        world.command = pilot.step(world.now, None, None, told)
    assert pilot.phase is Phase.FAULT
    assert "sensor" in pilot.reason


def test_where_the_blade_meets_crop_and_where_it_leaves_it_the_position_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = SimpleWorld(VEHICLE, width=6.0, height=6.0)
    plan = spiral([(0, 0), (6, 0), (6, 6), (0, 6)], 1, VEHICLE, gap_m=2.0)
    told: list[tuple[str, float]] = []

    def along(side: Side) -> float:
        """Of the blade, truly."""
        x = world.x + VEHICLE.blade_x_m * math.cos(world.yaw) - side.x_m
        y = world.y + VEHICLE.blade_x_m * math.sin(world.yaw) - side.y_m
        return x * math.cos(side.heading_rad) + y * math.sin(side.heading_rad)

    at_begin, at_end = Position.at_begin, Position.at_end

    def begin(position: Position, side: Side, ago_m: float, *more: float, again: bool) -> None:
        told.append(("begin", ago_m - along(side)))
        at_begin(position, side, ago_m, *more, again=again)

    def end(position: Position, side: Side, ago_m: float, *more: float, again: bool) -> None:
        told.append(("end", side.length_m + ago_m - along(side)))
        at_end(position, side, ago_m, *more, again=again)

    monkeypatch.setattr(Position, "at_begin", begin)
    monkeypatch.setattr(Position, "at_end", end)
    pilot = Pilot(VEHICLE, world, plan)
    drive(world, pilot, 200.0, until=lambda: pilot.turns == 3)
    assert [what for what, _ in told] == ["begin", "end"] * 3
    assert max(abs(error) for _, error in told) < 0.15


# ---- the beginning -------------------------------------------------------------------------------


def test_an_edge_that_stays_hidden_is_where_the_operator_put_the_blade() -> None:
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, lambda view: replace(view, confidence=0.2))
    for plan, phase in ((PLAN, Phase.FOLLOW), (Plan(), Phase.ALIGN)):
        pilot = Pilot(VEHICLE, eyes, plan)
        world.command = Command(Request.STOP)
        drive(world, pilot, 2.5)
        assert pilot.phase is Phase.ALIGN
        drive(world, pilot, 1.5)
        assert pilot.phase is phase, "without a plan it takes no place for granted"


def test_crop_without_an_end_to_the_right_is_no_field_to_begin() -> None:
    """So the neighbour's looks to a machine that was put the wrong way round."""
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, Eyes(world, lambda view: replace(view, confidence=0.0)), PLAN)
    drive(world, pilot, 2.0)
    assert "no end to the right" not in pilot.reason, "not for one picture's sake"
    drive(world, pilot, 28.0)
    assert pilot.phase is Phase.ALIGN
    assert "no end to the right" in pilot.reason
    assert world.speed == 0.0
    drive(world, pilot, GIVE_UP_S)
    assert pilot.phase is Phase.FAULT
    assert "no end to the right" in pilot.reason
    assert "not the direction" in pilot.reason, "which belief is wrong"
    assert world.speed == 0.0


def test_a_slanting_border_that_goes_on_a_little_is_still_no_edge() -> None:
    """Dead reckoning may be ahead of the corner."""
    world = SimpleWorld(VEHICLE)

    def slants(view: CropView) -> CropView:
        return beside(0.3 if world.y + VEHICLE.blade_x_m < 2.2 else 0.0)(view)

    slanting = replace(FIRST, edge_begin_m=2.0)
    pilot = Pilot(VEHICLE, Eyes(world, slants), replace(PLAN, sides=(slanting, SECOND)))
    before = world.x
    drive(world, pilot, 60.0, until=lambda: world.y + VEHICLE.blade_x_m > 3.0)
    assert world.x == pytest.approx(before, abs=0.02)


def test_a_fault_of_the_firmware_that_does_not_clear_ends_it() -> None:
    world = SimpleWorld(VEHICLE)
    world.state, world.command = State.FAULT, Command(Request.CLEAR)
    pilot = Pilot(VEHICLE, world, PLAN)
    log: list[Command] = []
    drive(world, pilot, 3.0, log)
    assert pilot.phase is Phase.FAULT
    assert "does not clear" in pilot.reason
    assert [c.request for c in log].count(Request.CLEAR) == 1


def test_a_machine_whose_camera_went_while_it_armed_does_not_set_out() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, PLAN)
    world.command = pilot.step(0.0, Frame(0.0, BLANK), None, world.telemetry())
    log: list[Command] = []
    while world.now < 8.0:
        world.advance()
        told = world.telemetry() if world.now > 4.0 else None
        world.command = pilot.step(world.now, None, None, told)
        log.append(world.command)
    assert pilot.phase is not Phase.CONNECT
    assert all(c.speed_mps == 0.0 for c in log)


# ---- gaps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("phase", [Phase.FOLLOW, Phase.TURN])
def test_after_a_gap_the_camera_has_to_show_the_world_for_a_while(phase: Phase) -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, PLAN)
    drive(world, pilot, 60.0, until=lambda: pilot.phase is phase and abs(world.speed) > 0.25)
    until = world.now + 5.0
    while world.now < until:
        world.advance()
        world.command = pilot.step(world.now, None, None, world.telemetry())
    assert pilot.phase is Phase.HESITATE
    began = world.now
    drive(world, pilot, 5.0, until=lambda: pilot.phase is phase)
    assert RESUME_AFTER_S <= world.now - began < 2 * RESUME_AFTER_S


def test_a_turn_whose_way_is_less_sure_leaves_it_less_sure_of_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sigmas = []
    for sigma in (HALL_SIGMA, 0.1):
        monkeypatch.setattr(Odometry, "scale_sigma", HALL_SIGMA)
        world = SimpleWorld(VEHICLE)
        eyes = Eyes(world, lambda view: view)
        pilot = Pilot(VEHICLE, eyes, replace(PLAN, gap_m=None))  # no look across a gap
        drive(world, pilot, 60.0, until=lambda p=pilot: p.phase is Phase.TURN)
        monkeypatch.setattr(Odometry, "scale_sigma", sigma)
        eyes.spoil = lambda view: replace(view, confidence=0.0)
        drive(world, pilot, 60.0, until=lambda p=pilot: p.phase is Phase.SEARCH)
        sigmas.append(pilot.lane.offset_sigma_m)
    assert sigmas[1] > 1.3 * sigmas[0]


def searching(view: CropView) -> tuple[SimpleWorld, Pilot]:
    """The first turn is over, and every picture shows that from here on."""
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, lambda seen: seen)
    pilot = Pilot(VEHICLE, eyes, PLAN)
    drive(world, pilot, 60.0, until=lambda: pilot.phase is Phase.SEARCH)
    eyes.spoil = lambda _view: view
    return world, pilot


@pytest.mark.parametrize(
    "view", [CropView(0.0, reason="nothing"), CropView(0.0, hidden=True, crop_ahead_m=0.5)]
)
def test_where_nothing_is_to_be_made_out_after_a_turn_it_ends(view: CropView) -> None:
    """Stems right before the lens may be the neighbour's. It has looked from two places."""
    world, pilot = searching(view)
    harvest(world, pilot, world.now + 60.0)
    assert pilot.phase is Phase.FAULT
    assert "made out" in pilot.reason


def test_where_something_stands_in_crop_that_is_surely_the_fields_it_goes_on_a_little() -> None:
    """Most of a side is ahead. It does not cut all of it unseeing."""
    world, pilot = searching(CropView(0.0, crop_ahead_m=1.0, ahead_confidence=0.4))
    before = world.x, world.y
    drive(world, pilot, 60.0, until=lambda: pilot.phase is Phase.FOLLOW)
    assert pilot.phase is Phase.FOLLOW
    harvest(world, pilot, world.now + 200.0)
    assert 0.5 < math.dist(before, (world.x, world.y)) < BLIND_ON_M + 0.2
    assert pilot.phase is Phase.FAULT


def test_a_finished_machine_may_be_pushed_anywhere() -> None:
    world, pilot = only_the_first_strip(replace(PLAN, sides=(FIRST,)))
    harvest(world, pilot, 60.0)
    assert pilot.phase is Phase.FINISHED
    for _ in range(500):
        world.advance()
        run = replace(world.telemetry(), speed_mps=0.5, distance_m=0.5 * world.now)
        back = Fix(world.now, 0.0, 0.0, 1, 1.0, 8, 0.5, -math.pi / 2)
        command = pilot.step(world.now, None, back, run)
    assert pilot.phase is Phase.FINISHED
    assert command.request is Request.STOP


def test_an_end_that_long_seemed_one_was_at_most_a_little_before(told_ends: list[ToldEnd]) -> None:
    """Unsure pictures of clear ground from a metre and a half before the end on are dust's."""
    world = SimpleWorld(VEHICLE)

    def hazy(view: CropView) -> CropView:
        if world.y + VEHICLE.blade_x_m < 8.2:
            return view
        sure = 0.3 if view.confidence > 0.0 else 0.9
        return replace(view, crop_ahead_m=math.inf, ahead_confidence=sure)

    pilot = Pilot(VEHICLE, Eyes(world, hazy), PLAN)
    drive(world, pilot, 60.0, until=lambda: pilot.turns == 1)
    [end] = told_ends
    assert end.ago_m < 0.7


def test_over_a_slanting_border_no_edge_is_missed() -> None:
    """None is to be seen there: it says nothing of dust, and a look is due no sooner than for an
    edge that has been hidden for a while."""
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, lambda view: view)
    slanting = replace(FIRST, edge_begin_m=3.0)
    pilot = Pilot(VEHICLE, eyes, replace(PLAN, sides=(slanting, *PLAN.sides[1:])))
    drive(world, pilot, 20.0, until=lambda: pilot.cut_m > 0.2)
    for _ in range(6):
        wandered(pilot.position, 1.0, pilot.motion)
    eyes.spoil = lambda view: replace(view, confidence=0.0)
    drive(world, pilot, 30.0, until=lambda: world.y + VEHICLE.blade_x_m > 2.4)
    drive(world, pilot, 30.0, until=lambda: pilot.phase is Phase.HESITATE)
    assert "dust" in pilot.reason
    assert world.y + VEHICLE.blade_x_m > 3.5


def test_a_short_side_does_not_end_before_it_begins() -> None:
    """Crop seemed near, and then farther off: it is still to come."""
    world = SimpleWorld(VEHICLE)
    rows = np.arange(world.crop.shape[0]) * CELL - world.margin
    world.crop[rows > 0.3] = False

    def flickering(view: CropView) -> CropView:
        blade = world.y + VEHICLE.blade_x_m
        if not -0.27 < blade < -0.05:
            return replace(view, confidence=max(0.2, view.confidence))
        return replace(view, crop_ahead_m=0.0 if blade < -0.22 else 0.9)

    short = replace(FIRST, length_m=0.3)
    plan = replace(PLAN, sides=(short, *PLAN.sides[1:]))
    pilot = Pilot(VEHICLE, Eyes(world, flickering), plan)
    drive(world, pilot, 60.0, until=lambda: pilot.turns == 1 or pilot.done)
    assert pilot.turns == 1, pilot.reason
    assert world.y + VEHICLE.blade_x_m > 0.3


def ask_always(monkeypatch: pytest.MonkeyPatch) -> None:
    """The blade's guard is told at each step and of each picture what the plan has there, and not
    only where that decides."""
    passes, limit = vars(CutGuard)["passes"].fget, CutGuard.limit

    def limited(guard: CutGuard, now: float, command: Command, **told: bool) -> Command:
        return command if passes(guard) else limit(guard, now, command, **told)

    monkeypatch.setattr(CutGuard, "passes", False)
    monkeypatch.setattr(CutGuard, "cuts_on", False)
    monkeypatch.setattr(CutGuard, "limit", limited)


def test_the_blades_guard_knows_the_gap_beside_a_side_and_allows_more_than_a_patch_at_ends_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ask_always(monkeypatch)
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, Eyes(world, lambda view: view), PLAN)
    beside: dict[int, set[bool]] = {}
    slack: dict[int, set[float]] = {}
    limit, allow = CutGuard.limit, CutGuard.allow

    def limited(guard: CutGuard, now: float, command: Command, **told: bool) -> Command:
        beside.setdefault(pilot.turns, set()).add(told["beside"])
        return limit(guard, now, command, **told)

    def allowed(guard: CutGuard, slack_m: float) -> None:
        if guard.clear_m == 0.0:
            slack.setdefault(pilot.turns, set()).add(slack_m)
        allow(guard, slack_m)

    monkeypatch.setattr(CutGuard, "limit", limited)
    monkeypatch.setattr(CutGuard, "allow", allowed)
    drive(world, pilot, 400.0, until=lambda: pilot.turns == 6)
    assert [beside[k] for k in range(6)] == [{True}] * 4 + [{False}] * 2
    assert slack[5] == {0.0}, "in the crop, though the field goes on behind its end"


def test_the_blades_guard_is_told_where_it_is_right_beside_what_was_cut(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In the second round that is the first round's swath, but near its ends."""
    ask_always(monkeypatch)
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, Eyes(world, lambda view: view), PLAN)
    told_of: dict[tuple[str, int], list[bool]] = {}
    limit, take_picture = CutGuard.limit, CutGuard.take_picture

    def limited(guard: CutGuard, now: float, command: Command, **told: bool) -> Command:
        told_of.setdefault(("limit", pilot.turns), []).append(told["swath"])
        return limit(guard, now, command, **told)

    def seen(guard: CutGuard, stamp: float, view: CropView, **told: bool) -> None:
        told_of.setdefault(("picture", pilot.turns), []).append(told["swath"])
        take_picture(guard, stamp, view, **told)

    monkeypatch.setattr(CutGuard, "limit", limited)
    monkeypatch.setattr(CutGuard, "take_picture", seen)
    drive(world, pilot, 400.0, until=lambda: pilot.turns == 6)
    for what in ("limit", "picture"):
        assert not any(any(told_of[what, k]) for k in range(4)), "in the first round nothing was"
        for k in (4, 5):
            shares = told_of[what, k]
            assert 0.5 < sum(shares) / len(shares) < 1.0
