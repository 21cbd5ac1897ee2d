"""Facts about a side that nobody has seen before: what leads the machine on, what ends it, and what
the lane and the turn make of how little is known of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from host.core.vehicle import Vehicle
from host.estimate.crop_ahead import CLEAR_M, END_SURE, Ahead, EndOfField
from host.estimate.cut_guard import PATCH_M, CutGuard
from host.estimate.odometry import Odometry
from host.estimate.position import WRONG_PLACE, Position
from host.pilot.behaviours.follow import Follow
from host.pilot.behaviours.follow import Why as Followed
from host.pilot.behaviours.look_at_edge import LookAtEdge
from host.pilot.behaviours.look_at_edge import Why as EdgeLook
from host.pilot.behaviours.look_at_end import LookAtEnd
from host.pilot.behaviours.look_at_end import Why as EndLook
from host.pilot.behaviours.turn import DriveTurn
from host.pilot.context import Context, Ended
from host.pilot.endings import Elsewhere, SideEnd, end_side, leave_side, outward, turn_on
from host.pilot.phase import Phase
from host.pilot.pilot import Pilot
from host.pilot.plan_side import BLIND_M, END_SIGMAS, OUTWARD_M, SIGMAS
from host.pilot.planned_strip import TURN_KNOWN_M, PlannedStrip
from host.pilot.stop_and_look import LONG_LOOK_S
from host.pilot.turn_progress import Turning
from host.route.plan import Plan, spiral
from host.route.turn_choice import next_turn
from host.route.turn_legs import Turn, lane_beside, shuttle, three_point
from host.vision.view import CropView
from tests.helpers.behaving import CUTTING, NOW, is_for, moved, on_side, seeing
from tests.helpers.eyes import Eyes
from tests.helpers.simple_world import SimpleWorld, drive

VEHICLE = Vehicle()
SQUARE = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
NEW = spiral(SQUARE, 1, VEHICLE, gap_m=2.0, sigma_m=0.5)
KNOWN = spiral(SQUARE, 1, VEHICLE, gap_m=2.0)
CLEAR = replace(CUTTING, confidence=0.0, crop_ahead_m=1.5)


def strip_of(context: Context) -> PlannedStrip:
    assert isinstance(context.strip, PlannedStrip)
    return context.strip


def along(cut_m: float, plan: Plan = NEW) -> Context:
    """On the first side, its crop met cut_m ago and none seen since."""
    return on_side(plan=plan, cut_m=cut_m)


# ---- what leads on, what ends --------------------------------------------------------------------


@pytest.mark.parametrize("believed_m", [4.0, 5.0, 6.0])
def test_dust_that_looks_like_crop_leads_nobody_through_a_gap(believed_m: float) -> None:
    """While the machine drives, the last metre and all beyond looks like crop at the blade, as
    pictures at a low camera do."""
    true = [(0.0, 0.0), (6.0, 0.0), (6.0, 5.0), (0.0, 5.0)]
    said = [(0.0, 0.0), (6.0, 0.0), (6.0, believed_m), (0.0, believed_m)]
    world = SimpleWorld(VEHICLE, width=6.0, height=5.0, polygon=true)
    world.stand_at(spiral(true, 1, VEHICLE).sides[0])

    def dusty(view: CropView) -> CropView:
        if abs(world.speed) < 0.02 or world.y + VEHICLE.blade_x_m < 4.0:
            return view
        return replace(view, confidence=0.0, crop_ahead_m=0.0, ahead_confidence=0.95)

    plan = spiral(said, 1, VEHICLE, gap_m=world.gap, sigma_m=0.5)
    pilot = Pilot(VEHICLE, Eyes(world, dusty), plan)
    drive(world, pilot, 90.0, until=lambda: pilot.phase in (Phase.TURN, Phase.FAULT))
    assert pilot.phase is Phase.TURN, pilot.reason
    assert world.neighbour_cut == 0
    assert world.y + VEHICLE.blade_x_m < 5.0 + 1.2


@pytest.mark.parametrize("believed_m", [7.0, 8.0])
def test_nor_does_it_where_the_boundary_is_said_to_be_known(believed_m: float) -> None:
    """It lies metres nearer than the plan has it."""
    true = [(0.0, 0.0), (6.0, 0.0), (6.0, 5.0), (0.0, 5.0)]
    said = [(0.0, 0.0), (6.0, 0.0), (6.0, believed_m), (0.0, believed_m)]
    world = SimpleWorld(VEHICLE, width=6.0, height=5.0, polygon=true)
    world.stand_at(spiral(true, 1, VEHICLE).sides[0])
    at_m = math.inf

    def dusty(view: CropView) -> CropView:
        """The end shows for a moment, before the dust is there."""
        nonlocal at_m
        blade_m = world.y + VEHICLE.blade_x_m
        if abs(world.speed) < 0.02 or blade_m < 4.0:
            return view
        if blade_m > 5.0 and view.crop_ahead_m > 0.8:
            at_m = min(at_m, blade_m)
        seen = at_m < blade_m < at_m + 0.03
        return view if seen else replace(view, confidence=0.0, crop_ahead_m=0.0)

    pilot = Pilot(VEHICLE, Eyes(world, dusty), spiral(said, 1, VEHICLE, gap_m=world.gap))
    drive(world, pilot, 120.0, until=lambda: pilot.phase in (Phase.TURN, Phase.FAULT))
    assert world.neighbour_cut == 0
    assert world.y + VEHICLE.blade_x_m < 5.0 + 1.2


def test_a_new_side_is_looked_at_where_it_may_have_ended_in_the_dust() -> None:
    context = along(9.0)
    assert is_for(Follow(context).step(NOW)[1], Followed.IN_DUST)
    strip_of(context).goes_on(context.motion)
    assert not is_for(Follow(context).step(NOW)[1], Followed.IN_DUST)
    moved(context, 9.0 + 0.9 * BLIND_M)
    assert not is_for(Follow(context).step(NOW)[1], Followed.IN_DUST)


def test_neither_a_known_side_nor_the_middle_of_a_new_one_is_looked_at() -> None:
    assert not strip_of(along(9.0, KNOWN)).blind()
    assert not strip_of(along(3.0)).blind()


def test_a_look_in_which_nothing_shows_ends_a_new_side() -> None:
    context = along(9.0)
    context.look.begin(NOW, 9.0, LONG_LOOK_S)
    assert is_for(LookAtEnd(context).step(NOW + 1.6)[1], None)
    go = LookAtEnd(context).step(NOW + LONG_LOOK_S + 0.1)[1]
    assert go is not None and go.reason is Elsewhere.AT_BOUNDARY


def test_a_look_that_shows_crop_at_the_blade_leads_on() -> None:
    context = along(9.0)
    context.look.begin(NOW, 9.0, LONG_LOOK_S)
    strip_of(context).goes_on(context.motion)
    assert is_for(LookAtEnd(context).step(NOW + 1.6)[1], EndLook.CROP_GOES_ON)


@pytest.mark.parametrize(
    ("cut_m", "view", "reason"),
    [
        (5.0, replace(CUTTING, confidence=0.0), EdgeLook.NO_CLEARER),
        (5.0, CLEAR, EdgeLook.STILL_TO_FIND),
        (5.0, replace(CLEAR, ahead_confidence=0.2), EdgeLook.STILL_TO_FIND),
        (9.5, CLEAR, SideEnd),
    ],
)
def test_after_a_look_at_the_edge_only_crop_at_the_blade_leads_on(
    cut_m: float, view: CropView, reason: object
) -> None:
    context = along(cut_m)
    context.sight.edge_at_m = 0.0
    context.look.begin(NOW, cut_m)
    seeing(context, view, stamp=NOW + 4.0)
    go = LookAtEdge(context).step(NOW + 4.0)[1]
    assert go is not None
    if reason is SideEnd:
        assert go.reason is Elsewhere.AT_BOUNDARY
    else:
        assert go.reason is reason


def test_on_a_known_side_dead_reckoning_leads_on_after_a_look() -> None:
    context = along(5.0, KNOWN)
    context.sight.edge_at_m = 0.0
    context.look.begin(NOW, 5.0)
    seeing(context, CLEAR, stamp=NOW + 4.0)
    assert is_for(LookAtEdge(context).step(NOW + 4.0)[1], EdgeLook.NO_CLEARER)


NO_EDGE = replace(CUTTING, confidence=0.0)


@pytest.mark.parametrize(
    ("view", "entered", "ends"),
    [
        (CLEAR, True, True),
        (replace(CLEAR, crop_ahead_m=CLEAR_M + 0.1), True, True),
        (NO_EDGE, True, False),
        (replace(CLEAR, ahead_confidence=0.2), True, False),
        (CLEAR, False, False),
    ],
)
def test_a_look_that_shows_clear_ground_where_a_known_side_may_end_ends_it(
    view: CropView, entered: bool, ends: bool
) -> None:
    """What stands across the way beyond it may be a neighbour's."""
    context = along(9.5, KNOWN)
    context.sight.edge_at_m = 0.0
    if not entered:
        context.sight.ahead.entered_at = None
    context.look.begin(NOW, 9.5)
    seeing(context, view, stamp=NOW + 4.0)
    go = LookAtEdge(context).step(NOW + 4.0)[1]
    assert is_for(go, Elsewhere.AT_BOUNDARY if ends else EdgeLook.NO_CLEARER)


def test_an_end_that_was_looked_at_is_no_longer_the_plans_alone() -> None:
    """Twice in a row an end by the plan is a fault; a look between them is none."""
    context = along(9.5)
    context.by_plan = True
    end_side(context, NOW, EndOfField(NOW, context.motion), looked=True)
    assert not context.by_plan


@pytest.mark.parametrize("dusty", [True, False])
def test_crop_in_the_dust_ends_no_clear_ground(dusty: bool) -> None:
    guard, stamp = CutGuard(VEHICLE), 0.0
    guard.begin()

    def picture(ahead_m: float) -> None:
        view = CropView(0.9, crop_ahead_m=ahead_m, ahead_confidence=0.9)
        guard.take_picture(stamp, view, dusty=dusty)

    context = on_side()
    assert context.telemetry is not None
    for k in range(60):
        stamp = 0.05 * k
        moving = replace(context.telemetry, stamp=stamp, speed_mps=0.5, drive_duty=120)
        guard.take_telemetry(moving)
        picture(1.5 if k == 20 else 0.0)
    assert (guard.clear_m > PATCH_M) is dusty


# ---- what is known of the lane, the end and the turn ---------------------------------------------


def test_an_end_is_no_nearer_than_the_crop_that_was_seen_and_gives_way_to_it() -> None:
    context = along(8.0)
    strip = strip_of(context)
    assert strip.sure_ahead_m() == pytest.approx(strip.side.length_m)
    strip.goes_on(context.motion)
    assert strip.sure_ahead_m() == pytest.approx(strip.left_m())
    moved(context, 12.6)
    strip.goes_on(context.motion)
    assert strip.side.length_m > max(strip.along_m(context.motion), 12.0)
    known = strip_of(along(8.0, KNOWN))
    assert known.sure_ahead_m() == pytest.approx(known.side.length_m)


@pytest.mark.parametrize(("index", "moves"), [(0, True), (3, False), (4, False)])
def test_a_border_that_a_side_before_has_met_does_not_move(index: int, moves: bool) -> None:
    """The fourth side ends at the edge that the first has run along, the fifth where the first has
    ended. Dust at their ends looked like crop, and moved such borders out (model field 10317)."""

    def doubted(cut_m: float) -> Context:
        context = on_side(index, plan=NEW, cut_m=cut_m)
        strip = strip_of(context)
        context.estimate.position.less_sure_along(strip.planned_piece, 0.5)
        strip.arrive(None)
        assert strip.new
        return context

    context = doubted(8.0)
    length_m = strip_of(context).side.length_m
    moved(context, length_m + 0.5)
    strip_of(context).goes_on(context.motion)
    assert (strip_of(context).side.length_m > length_m + 0.1) is moves

    context = doubted(length_m - 3.0)
    strip, position = strip_of(context), context.estimate.position
    strip.ends_at(length_m - 3.0)
    strip.met_end(EndOfField(NOW, context.motion), None, looked=True)
    assert (position.likely > 0.0) is not moves, "an end elsewhere tells of the machine"
    assert (abs(strip.side.length_m - length_m) > 1.0) is moves


@pytest.mark.parametrize("left_over", [False, True])
def test_where_crop_that_strips_have_left_ends_lies_no_border(left_over: bool) -> None:
    """In ten pictures its end took the boundary 7 m along (model field 11057)."""
    side = replace(NEW.sides[0], left_over=left_over)
    context = along(8.0, replace(NEW, sides=(side, *NEW.sides[1:])))
    strip, outline = strip_of(context), context.estimate.position.outline
    before = np.array(outline.corners)
    moved(context, side.length_m + 0.4)
    strip.goes_on(context.motion)
    on = np.abs(np.array(outline.corners) - before).max()
    strip.ends_at(side.length_m - 3.0)
    ended = np.abs(np.array(outline.corners) - before).max()
    assert bool(on == ended == 0.0) is left_over
    assert bool(on > 0.1) is not left_over


def test_crop_far_past_where_a_side_may_end_is_another_error_and_moves_no_end() -> None:
    """Dust after an end that nobody saw looked like crop for 2 m (random field 10053)."""
    context = along(8.0)
    strip = strip_of(context)
    length_m = strip.side.length_m
    moved(context, length_m + END_SIGMAS * context.estimate.position.end_sigma_m(strip.side) + 1.0)
    strip.goes_on(context.motion)
    assert strip.side.length_m == pytest.approx(length_m)


@pytest.mark.parametrize(
    ("cut_m", "past_m", "gives_way"), [(11.0, 0.3, True), (18.0, 0.3, False), (11.0, 8.0, False)]
)
def test_crop_leads_on_no_farther_than_the_wheels_say_though_the_place_gives_way_with_the_end(
    monkeypatch: pytest.MonkeyPatch, cut_m: float, past_m: float, gives_way: bool
) -> None:
    """Nor than the place says. Each end that gave way took the place along, by 5 m in all (random
    field 10053)."""
    context = along(8.0)
    strip = strip_of(context)
    length_m = strip.side.length_m
    moved(context, cut_m)
    monkeypatch.setattr(PlannedStrip, "along_m", lambda *_: length_m + past_m)
    strip.goes_on(context.motion)
    assert (strip.side.length_m > length_m + 0.1) is gives_way


def test_crop_that_goes_on_moves_an_end_once_however_many_pictures_show_it() -> None:
    """Where the side begins is not known better than where the machine is: it moves along with the
    end, and what was seen must not be counted from it."""
    context = along(8.0)
    strip = strip_of(context)
    position = context.estimate.position
    position.less_sure_along(strip.planned_piece, 1.0)
    moved(context, 11.5)
    strip.goes_on(context.motion)
    once = strip.side
    for _ in range(30):
        strip.goes_on(context.motion)
    assert strip.along_m(context.motion) <= strip.side.length_m
    assert math.dist((once.x_m, once.y_m), (strip.side.x_m, strip.side.y_m)) < 0.2


def test_a_turn_leads_outside_of_an_edge_that_nobody_has_seen() -> None:
    context = along(10.0)
    following = context.planned(1)
    assert isinstance(following, PlannedStrip)
    following.arrive(None)
    assert 0.0 < following.outward_m <= OUTWARD_M
    assert following.begin_doubt_m > 0.0
    plan = outward(NEW, following)
    assert plan.sides[1].shift_m == pytest.approx(NEW.sides[1].shift_m + following.outward_m)
    assert plan.gap_m == pytest.approx(2.0 - following.begin_doubt_m)
    known = on_side(plan=KNOWN, cut_m=10.0).planned(1)
    there = outward(KNOWN, known)
    assert there.sides == KNOWN.sides
    assert there.gap_m == pytest.approx(2.0 - known.begin_doubt_m)


def test_before_it_backs_to_a_beginning_a_machine_knows_what_it_will_doubt_of_it() -> None:
    strip = strip_of(along(0.0, KNOWN))
    strip.place(8.0)
    now_m = strip.estimate.position.end_sigma_m(strip.planned_piece, -1)
    assert strip.begin_doubt_m > 2.0 * now_m + 0.1


def test_a_corner_that_may_be_otherwise_teaches_the_steering_less() -> None:
    def learned(sigma_rad: float) -> float:
        odometry = Odometry(VEHICLE)
        odometry.turned(1.5, 1.6, sigma_rad)
        return odometry.yaw_gain - 1.0

    assert learned(0.0) > 4 * learned(0.2) > 0.0


def test_the_corners_angle_between_two_sides_is_as_unsure_as_the_corners() -> None:
    sure = on_side(plan=KNOWN).estimate.position
    unsure = on_side(plan=NEW).estimate.position
    first, second = NEW.sides[:2]
    assert sure.corner_sigma_rad(first, second) == 0.0
    # Each edge turns by the difference of its corners, and the middle corner turns both.
    expected = 0.5 * math.sqrt(2 + 2) / 10.0
    assert unsure.corner_sigma_rad(first, second) == pytest.approx(expected, rel=0.6)


def test_only_a_look_without_dust_makes_an_end_unsure() -> None:
    """In dust it lies somewhere between where clear ground first showed and the machine."""
    spreads = []
    for sure in (True, False):
        context = along(9.5)
        context.sight.ahead.sure.extend([sure] * END_SURE[1])
        end = EndOfField(NOW, context.motion)
        moved(context, 9.9, stamp=NOW + 1.0)
        context.strip.met_end(end, None, looked=True)
        spreads.append(context.estimate.position.end_sigma_m(NEW.sides[0]))
    assert np.diff(spreads)[0] > 0.02


@pytest.mark.parametrize("believed_m", [9.0, 10.0])
def test_a_glimpse_of_clear_ground_in_the_dust_is_not_forgotten(believed_m: float) -> None:
    """Long before the side may end, one picture in twenty shows that it has."""
    true = [(0.0, 0.0), (6.0, 0.0), (6.0, 5.0), (0.0, 5.0)]
    said = [(0.0, 0.0), (6.0, 0.0), (6.0, believed_m), (0.0, believed_m)]
    world = SimpleWorld(VEHICLE, width=6.0, height=5.0, polygon=true)
    world.stand_at(spiral(true, 1, VEHICLE).sides[0])
    pictures = 0

    def dusty(view: CropView) -> CropView:
        nonlocal pictures
        pictures += 1
        if abs(world.speed) < 0.02 or world.y + VEHICLE.blade_x_m < 4.0 or pictures % 20 == 0:
            return view
        return replace(view, confidence=0.0, crop_ahead_m=0.0, ahead_confidence=0.95)

    plan = spiral(said, 1, VEHICLE, gap_m=world.gap, sigma_m=0.3)
    pilot = Pilot(VEHICLE, Eyes(world, dusty), plan)
    drive(world, pilot, 60.0, until=lambda: pilot.done or pilot.turns == 1)
    assert world.y + VEHICLE.blade_x_m < 5.0 + 0.6 * world.gap
    drive(world, pilot, 40.0, until=lambda: pilot.done)
    assert world.neighbour_cut == 0


@pytest.mark.parametrize("cut_m", [7.5, 9.5])
def test_a_stop_at_clear_ground_ends_a_side_of_a_boundary_that_is_to_be_found(
    cut_m: float,
) -> None:
    """There its end is, wherever it was walked; where that is known, a person must see, unless it
    is hereabouts."""
    context = along(cut_m)
    context.estimate.cut.refused = True
    go = Follow(context).step(NOW)[1]
    assert go is not None and go.reason is Elsewhere.AT_BOUNDARY
    assert context.estimate.position.outline.found(NEW.sides[0]).length_m == pytest.approx(
        cut_m, abs=0.6
    )
    context = along(cut_m, KNOWN)
    context.estimate.cut.refused, context.regained = True, [0.0]
    known = Followed.CLEAR_GROUND if cut_m < 9.0 else Elsewhere.AT_BOUNDARY
    assert is_for(Follow(context).step(NOW)[1], known)


@pytest.mark.parametrize(("off_m", "doubted"), [(0.1, False), (1.5, True)])
def test_an_end_that_a_look_found_elsewhere_makes_the_place_doubted(
    off_m: float, doubted: bool
) -> None:
    """It may be none as well, so the place stays where it was, and the machine may also be at the
    end. A boundary that is known stays."""
    context = along(10.0 - off_m, KNOWN)
    strip = strip_of(context)
    position, piece = strip.estimate.position, strip.planned_piece
    before_m, length_m = position.end_sigma_m(piece), strip.side.length_m
    beside_m, at_m = position.beside_sigma_m(piece), position.along(piece)
    strip.ends_at(length_m - off_m)
    strip.met_end(EndOfField(NOW, context.motion), None, looked=True)
    assert position.beside_sigma_m(piece) == pytest.approx(beside_m, rel=0.01), "along it only"
    assert abs(position.along(piece) - at_m) < 0.15
    if not doubted:
        assert position.end_sigma_m(piece) < before_m, "that is what its place may err"
        assert position.likely == 0.0
        return
    here, there = position.all_borders
    assert math.dist(here.pose[:2], there.pose[:2]) == pytest.approx(off_m, abs=0.3)
    assert position.likely == WRONG_PLACE
    moved(context, length_m - off_m + 0.6)
    strip.goes_on(context.motion)
    assert position.likely < WRONG_PLACE, "crop at the blade is beyond that end"
    assert strip.side.length_m == length_m


def test_clear_ground_far_from_any_end_that_the_walk_may_mean_stops_the_machine() -> None:
    """What is wrong by so much is the place, and beyond may stand the neighbour's crop."""
    context = along(5.0)
    context.estimate.cut.refused, context.regained = True, [0.0]
    assert is_for(Follow(context).step(NOW)[1], Followed.CLEAR_GROUND)


def test_a_turn_sees_how_far_the_next_crop_is_and_what_was_driven_since() -> None:
    context = along(10.0)
    go = leave_side(context, NOW, Ended(EndOfField(NOW, context.motion), seen=True))
    assert go.reason in (SideEnd.SEEN, Elsewhere.FOUND)
    turn = DriveTurn(context)
    moved(context, 10.0, stamp=NOW)
    seeing(context, replace(CLEAR, crop_ahead_m=1.4), stamp=NOW)
    moved(context, 10.2, stamp=NOW + 0.2)
    assert turn.seen_free(NOW + 0.2).clear_m == pytest.approx(1.2)
    assert turn.seen_free(NOW + 2.0).clear_m == math.inf, "that was long ago"
    seeing(context, replace(CLEAR, ahead_confidence=0.2), stamp=NOW + 0.2)
    assert turn.seen_free(NOW + 0.2).clear_m == math.inf


def test_a_turn_to_the_strip_beside_the_last_leads_to_the_edge_that_the_blade_has_left() -> None:
    """However unsure the machine is of its place, that lies a swath aside: a machine that backed
    nearer to it drove over its crop."""
    first = NEW.sides[0]
    (along_m, inside_m), *_ = first.places_m
    inner = ((along_m, inside_m + VEHICLE.pass_m),)
    x_m, y_m, _ = first.pose(0.0, VEHICLE.pass_m)
    again = replace(first, x_m=x_m, y_m=y_m, places_m=inner)
    plan = replace(NEW, sides=(first, again, *NEW.sides[1:]))
    context = along(10.0, plan)
    following = context.planned(1)
    assert isinstance(following, PlannedStrip)
    following.arrive(None)
    assert following.new, "its end is not known"
    turn = next_turn(outward(plan, following), 0, VEHICLE, lambda _: 1.0)
    turning = Turning(NOW, turn, (0.0, 0.0, 0.0))
    assert turning.beside
    following.begin_leg(turning)
    assert context.estimate.lane.aim_m == pytest.approx(-VEHICLE.pass_m)


def test_the_last_leg_of_a_turn_leads_outside_too() -> None:
    context = along(10.0)
    following = context.planned(1)
    assert isinstance(following, PlannedStrip)
    following.arrive(None)
    outward_m = following.outward_m
    legs = three_point(VEHICLE, math.pi / 2, lane_beside(VEHICLE, math.pi / 2))
    following.begin_leg(Turning(NOW, legs, (0.0, 0.0, 0.0)))
    assert context.estimate.lane.aim_m == -outward_m < 0.0


def test_a_turn_must_find_room_where_the_end_may_lie_farther_on() -> None:
    sure, unsure = along(9.5, KNOWN), along(9.5)
    near, far = sure.strip.end_pose(shuttles=False), unsure.strip.end_pose(shuttles=False)
    mean = unsure.strip.end_pose(shuttles=True)
    assert near is not None and far is not None and mean is not None
    assert mean[1] == pytest.approx(near[1], abs=0.05), "what a shuttle backs away from"
    sigma = unsure.estimate.position.end_sigma_m(NEW.sides[0])
    assert far[1] - near[1] == pytest.approx(SIGMAS * sigma, abs=0.05)


def test_a_shuttle_must_find_room_where_the_next_strip_may_begin(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nearer to the border than the plan has it; where this strip ends says nothing of that."""
    ring = [(0.0, 0.0), (14.0, 0.0), (14.0, 5.0), (6.0, 5.0), (6.0, 14.0), (0.0, 14.0)]
    plan = spiral(ring, 0, VEHICLE, gap_m=2.0, sigma_m=0.3)
    index = next(k for k in range(len(plan.sides)) if plan.corner_rad(k) == 0.0)
    context = along(0.0, replace(plan, sides=plan.sides[index:]))
    pose = context.strip.end_pose(shuttles=True)
    found: list[tuple[float, float]] = []

    def chosen(_: Plan, __: int, ___: Vehicle, room_m: Callable[[Turn], float]) -> Turn:
        turn = shuttle(VEHICLE, -3.0, VEHICLE.pass_m, 1.0)
        found.append((room_m(turn), context.guard.room_m(turn, pose)))
        return turn

    monkeypatch.setattr("host.pilot.endings.next_turn", chosen)
    turn_on(context, NOW, Ended(EndOfField(NOW, context.motion), seen=True))
    [(room, as_planned)] = found
    doubt = context.strip.begin_doubt_m
    assert doubt > 0.1
    assert room == pytest.approx(as_planned - doubt, abs=0.02)


def test_a_turn_round_a_corner_of_unknown_angle_teaches_the_steering_little() -> None:
    """The boundary says 100 degrees where 90 are turned."""
    true = [(0.0, 0.0), (8.0, 0.0), (8.0, 7.0), (0.0, 7.0)]
    said = [(0.0, 0.0), (8.0, 0.0), (8.0, 7.0), (0.0, 5.6)]
    world = SimpleWorld(VEHICLE, width=8.0, height=7.0, polygon=true)
    world.stand_at(spiral(true, 1, VEHICLE).sides[0])
    pilot = Pilot(VEHICLE, world, spiral(said, 1, VEHICLE, gap_m=world.gap, sigma_m=1.0))
    drive(world, pilot, 120.0, until=lambda: pilot.turns == 1 and pilot.cut_m > TURN_KNOWN_M + 1.0)
    assert pilot.turns == 1, pilot.reason
    assert pilot.yaw_gain == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(("index", "again"), [(1, False), (3, False), (5, True), (7, True)])
def test_a_border_that_the_strip_before_it_has_met_tells_of_the_machine_alone(
    monkeypatch: pytest.MonkeyPatch, index: int, again: bool
) -> None:
    """What one strip after the other errs of it would move its corners by metres (outline 209)."""
    told = []
    for name in ("at_begin", "at_end"):
        monkeypatch.setattr(Position, name, lambda *_, again, **__: told.append(again))
    on_side(index, plan=NEW, cut_m=0.4).strip.met_begin(0.0)
    context = on_side(index, plan=NEW, cut_m=NEW.sides[index].length_m + 0.3)
    end = EndOfField(NOW, context.motion)
    context.strip.met_end(end, None, looked=True)
    strip_of(context).met_end_surely()
    context = on_side(index, plan=NEW, cut_m=None)
    monkeypatch.setattr(Ahead, "begins_at_m", 0.3)
    context.strip.saw_begin()
    assert told == [again] * 4
