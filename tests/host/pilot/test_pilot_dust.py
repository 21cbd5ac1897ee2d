"""What the pilot does where dust, weeds or thin crop hide the edge, in the plane world."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from host.core.messages import Command
from host.core.vehicle import Vehicle
from host.pilot.phase import Phase
from host.pilot.pilot import Pilot
from host.pilot.planned_strip import DUSTY_END_SIGMA_M
from host.route.plan import Plan, spiral
from host.vision.view import CropView
from tests.helpers.eyes import Eyes, ToldEnd, beside
from tests.helpers.simple_world import CELL, SimpleWorld, drive, harvest

VEHICLE = Vehicle()
PLAN = spiral([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)], 1, VEHICLE, gap_m=2.0)

LONG = spiral([(0.0, 0.0), (10.0, 0.0), (10.0, 40.0), (0.0, 40.0)], 1, VEHICLE, gap_m=2.0)


def cutting(plan: Plan = PLAN, metres: float = 2.5) -> tuple[SimpleWorld, Eyes, Pilot]:
    """A machine that has come so far along its first side with clear eyes."""
    world = SimpleWorld(VEHICLE, height=10.0 if plan is PLAN else 40.0)
    eyes = Eyes(world, beside(0.0))
    pilot = Pilot(VEHICLE, eyes, plan)
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > metres)
    return world, eyes, pilot


def bare(world: SimpleWorld, begin_m: float, end_m: float = math.inf) -> None:
    """No crop stands any more between so far north and so far."""
    rows = np.arange(world.crop.shape[0]) * CELL - world.margin
    world.crop[(rows > begin_m) & (rows < end_m)] = False


def standing(world: SimpleWorld, begin_m: float, end_m: float) -> bool:
    """Whether any of the first side's strip stands between so far north and so far."""
    rows = np.arange(world.crop.shape[0]) * CELL - world.margin
    columns = np.arange(world.crop.shape[1]) * CELL - world.margin
    strip = world.crop[:, (columns > 9.3) & (columns < 9.9)]
    return bool(strip[(rows > begin_m) & (rows < end_m)].any())


def test_what_seems_to_stand_at_the_blade_before_a_short_side_begins_ends_no_side() -> None:
    """Where the turn saw it begin half a metre farther on. The blade's guard would count clear
    ground from there (model field 10334)."""
    plan = spiral([(0.0, 0.0), (3.6, 0.0), (3.6, 10.0), (0.0, 10.0)], 1, VEHICLE, gap_m=2.0)
    world = SimpleWorld(VEHICLE, 3.6, 10.0)
    eyes = Eyes(world, beside(0.0))
    pilot = Pilot(VEHICLE, eyes, plan)
    drive(world, pilot, 120.0, until=lambda: pilot.phase is Phase.TURN)
    rows, columns = (np.arange(n) * CELL - world.margin for n in world.crop.shape)
    world.crop[np.ix_(rows > 8.9, columns > 2.1)] = False
    shown: list[CropView] = []

    def swath(view: CropView) -> CropView:
        if pilot.phase is not Phase.FOLLOW or len(shown) > 2:
            return view
        shown.append(view)
        return replace(view, crop_ahead_m=0.0, ahead_confidence=0.95)

    eyes.spoil = swath

    def through() -> bool:
        return pilot.strip.index > 1 or (pilot.phase is Phase.FOLLOW and pilot.cut_m > 1.5)

    drive(world, pilot, 120.0, until=through)
    assert len(shown) == 3 and shown[0].crop_ahead_m > 1.0
    assert pilot.strip.index == 1


def test_a_patch_of_weeds_in_the_face_does_not_move_the_lane() -> None:
    world, eyes, pilot = cutting()
    before = (world.x, world.y)
    eyes.spoil = beside(0.6)
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > 6.5)
    assert pilot.phase is Phase.FOLLOW
    assert world.y - before[1] > 3.5
    assert world.x == pytest.approx(before[0], abs=0.05)


def test_an_edge_that_leaps_in_the_blades_dust_is_looked_at_again_without_it() -> None:
    """The border of the dust seems to be the crop's, half a blade's width inside; what the machine
    knows of the lane wears out, then it stands and sees."""
    world, eyes, pilot = cutting(LONG)
    before = world.x

    def dusty(view: CropView) -> CropView:
        return beside(0.6 * world.command.blade)(view)

    eyes.spoil = dusty
    worst = 0.0
    while world.now < 160.0 and pilot.turns == 0:
        drive(world, pilot, 0.5)
        worst = max(worst, abs(world.x - before))
    assert pilot.turns == 1, pilot.reason
    assert Phase.HESITATE in [t.phase for t in pilot.transitions]
    assert worst < 0.1


def test_where_nothing_is_to_be_seen_it_backs_off_and_looks_again() -> None:
    """As where crop fills the picture of a low camera."""
    world, eyes, pilot = cutting(metres=4.0)
    eyes.spoil = lambda _view: CropView(0.0, reason="crop fills the picture")
    drive(world, pilot, 20.0, until=lambda: pilot.phase is Phase.HESITATE)
    drive(world, pilot, 3.0)
    stood = world.y

    def too_near(view: CropView) -> CropView:
        near = world.y > stood - 0.4
        return CropView(0.0, reason="crop fills the picture") if near else view

    eyes.spoil = too_near
    log: list[Command] = []
    drive(world, pilot, 30.0, log, until=lambda: pilot.phase is Phase.FOLLOW)
    assert pilot.phase is Phase.FOLLOW
    assert world.y > stood - 0.7
    assert not any(c.blade for c in log[:-1])
    assert {"backing off" in c.reason for c in log if c.speed_mps < 0} == {True}
    eyes.spoil = beside(0.0)
    drive(world, pilot, 60.0, until=lambda: pilot.turns == 1)
    assert world.y + VEHICLE.blade_x_m == pytest.approx(10.0, abs=0.4)


def test_it_backs_off_in_vain_a_few_times_at_most_and_never_without_pictures() -> None:
    for unusable in (False, True):
        world = SimpleWorld(VEHICLE)
        pilot = Pilot(VEHICLE, world, PLAN)
        drive(world, pilot, 60.0, until=lambda p=pilot: p.cut_m > 4.0)
        world.blind, world.unusable = True, unusable
        drive(world, pilot, 20.0, until=lambda p=pilot: p.phase is Phase.HESITATE)
        drive(world, pilot, 3.0)
        stood = world.y
        harvest(world, pilot, world.now + 120.0)
        assert pilot.phase is Phase.FAULT
        assert "gave up" in pilot.reason
        assert stood - world.y == pytest.approx(0.0 if unusable else 0.6, abs=0.08)


def test_dust_from_the_first_metre_of_a_side_does_not_move_its_lane() -> None:
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, beside(0.0))
    pilot = Pilot(VEHICLE, eyes, PLAN)
    drive(world, pilot, 120.0, until=lambda: pilot.turns == 1 and pilot.phase is Phase.FOLLOW)

    def dusty(view: CropView) -> CropView:
        return beside(0.5 * world.command.blade)(view)

    eyes.spoil = dusty
    worst = 0.0
    while pilot.turns == 1 and pilot.cut_m < 6.0 and not pilot.done:
        drive(world, pilot, 0.5)
        worst = max(worst, abs(pilot.lane.offset_m))
    assert pilot.cut_m >= 6.0, pilot.reason
    assert worst < 0.1
    assert world.y == pytest.approx(10.0 - VEHICLE.inset_m, abs=0.1)


def test_a_lane_that_the_turn_missed_is_learned_before_the_blade_turns() -> None:
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, beside(0.0))
    pilot = Pilot(VEHICLE, eyes, PLAN)
    drive(world, pilot, 120.0, until=lambda: pilot.turns == 1)
    eyes.spoil = lambda view: replace(view, confidence=0.0)  # nor is the next edge seen in the turn
    drive(world, pilot, 60.0, until=lambda: pilot.phase is Phase.SEARCH)
    eyes.spoil = beside(0.0)
    world.y += 0.5
    drive(world, pilot, 30.0, until=lambda: pilot.phase is Phase.FOLLOW)
    left_m = 10.0 - VEHICLE.inset_m - world.y
    assert pilot.lane.offset_m == pytest.approx(left_m, abs=0.2)


def test_where_the_blades_dust_hides_the_edge_it_stops_to_look_and_goes_on() -> None:
    world = SimpleWorld(VEHICLE, yaw_gain=0.97, pot_error=math.radians(0.5))
    eyes = Eyes(world, lambda view: replace(view, confidence=0.0) if world.command.blade else view)
    pilot = Pilot(VEHICLE, eyes, PLAN)
    beside = []

    def on_first_side() -> bool:
        if pilot.cut_m > 0.5:
            beside.append(world.x - (10.0 - VEHICLE.inset_m))
        return pilot.turns == 1

    drive(world, pilot, 120.0, until=on_first_side)
    stops = [t for t in pilot.transitions if "without the blade's dust" in t.reason]
    assert len(stops) >= 2
    assert np.abs(beside).max() < 0.1, "0.16 m without the looks"
    assert pilot.phase is Phase.TURN


def test_a_stop_to_look_leaves_nothing_standing() -> None:
    """The blade stops last and starts first."""
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, lambda view: replace(view, confidence=0.0) if world.command.blade else view)
    pilot = Pilot(VEHICLE, eyes, PLAN)
    drive(world, pilot, 120.0, until=lambda: pilot.turns == 1)
    assert any("without the blade's dust" in t.reason for t in pilot.transitions)
    assert not standing(world, 0.2, 9.0)


def test_a_look_that_shows_no_more_does_not_hold_it_up() -> None:
    world, eyes, pilot = cutting(metres=1.0)
    eyes.spoil = lambda view: replace(view, confidence=0.0)
    log: list[Command] = []
    drive(world, pilot, 60.0, log, until=lambda: pilot.cut_m > 7.0)
    assert pilot.cut_m > 7.0
    stood = [c for c in log if "without the blade's dust" in c.reason]
    assert all(c.speed_mps == 0.0 for c in stood)
    share = sum(c.blade for c in stood) / len(stood)
    assert 0 < share < 0.35, "off as soon as it stands"


def along_a_long_side() -> tuple[SimpleWorld, Eyes, Pilot]:
    """Of 40 m, its first metres cut."""
    world = SimpleWorld(VEHICLE, width=10.0, height=40.0)
    eyes = Eyes(world, lambda view: view)
    ring = [(0.0, 0.0), (10.0, 0.0), (10.0, 40.0), (0.0, 40.0)]
    pilot = Pilot(VEHICLE, eyes, spiral(ring, 1, VEHICLE, gap_m=2.0))
    drive(world, pilot, 8.0)
    return world, eyes, pilot


def test_dead_reckoning_along_crop_without_an_edge_lasts_only_a_while() -> None:
    world, eyes, pilot = along_a_long_side()
    before = world.y
    eyes.spoil = lambda view: replace(view, confidence=0.0, edge_offset_m=math.nan)
    drive(world, pilot, 60.0)
    assert pilot.phase is Phase.HESITATE
    assert 1.0 < world.y - before < 12.0
    assert pilot.lane.offset_sigma_m < 0.35


def test_an_edge_of_which_no_look_is_sure_is_followed_where_it_stays_in_one_line() -> None:
    world, eyes, pilot = along_a_long_side()
    before = world.y
    eyes.spoil = lambda view: replace(view, confidence=0.0)
    drive(world, pilot, 90.0, until=lambda: pilot.done)
    assert world.y - before > 15.0
    assert abs(pilot.lane.blade_offset_m) < 0.1
    assert any("this and the last agree" in t.reason for t in pilot.transitions)


def test_no_leap_of_the_edge_counts_from_the_beginning_of_a_side_on() -> None:
    world, eyes, pilot = cutting(metres=0.3)
    eyes.spoil = beside(0.6)
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > 1.5)
    assert pilot.lane.blade_offset_m == pytest.approx(0.0, abs=0.02)


def test_edges_none_of_which_is_sure_keep_it_on_its_lane_together() -> None:
    """Dust: of the edges some are right, and the others lie inside."""
    world = SimpleWorld(VEHICLE, height=40.0, yaw_gain=0.97, pot_error=math.radians(0.5))
    eyes = Eyes(world, beside(0.0))
    pilot = Pilot(VEHICLE, eyes, LONG)
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > 2.5)
    rng = np.random.default_rng(5)

    def dusty(view: CropView) -> CropView:
        inside = 0.3 * float(rng.random() < 0.3)
        return replace(beside(inside)(view), confidence=0.2) if world.command.blade else view

    eyes.spoil = dusty
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > 22.0 or pilot.done)
    assert pilot.cut_m > 22.0, pilot.reason
    assert len([t for t in pilot.transitions if t.phase is Phase.HESITATE]) < 8
    assert world.x == pytest.approx(10.0 - VEHICLE.inset_m, abs=0.1)


def hidden_ahead(_view: CropView) -> CropView:
    """Dust that looks like clear ground."""
    return CropView(0.0, crop_ahead_m=math.inf, ahead_confidence=0.9, reason="no edge")


@pytest.mark.parametrize(
    ("before_end_m", "why"), [(0.1, "the crop seems to end"), (4.0, "the edge is unsure")]
)
def test_clear_ground_that_is_dust_is_no_end(before_end_m: float, why: str) -> None:
    """Where the plan may have the end, and where it has crop. Only a look without dust ends it."""
    world, eyes, pilot = cutting(metres=1.0)

    def dusty(view: CropView) -> CropView:
        blade = world.y + VEHICLE.blade_x_m
        puff = world.command.blade and 10.0 - before_end_m - 0.5 < blade < 10.0 - before_end_m
        return hidden_ahead(view) if puff else replace(view, confidence=0.3)

    eyes.spoil = dusty
    drive(world, pilot, 90.0, until=lambda: pilot.turns == 1 or pilot.done)
    assert pilot.turns == 1, pilot.reason
    assert any(why in t.reason for t in pilot.transitions)
    assert pilot.transitions[-2].code.startswith("look at the "), "the end is a look's to tell"
    assert world.y + VEHICLE.blade_x_m == pytest.approx(10.2, abs=0.25)


def test_every_strip_of_a_shuttle_has_its_look_at_the_end() -> None:
    """It backs along the whole strip and comes to the next one's end having gone no farther."""
    world = SimpleWorld(VEHICLE, gap=5.0)
    first = PLAN.sides[0]
    shift_m = VEHICLE.pass_m
    strips = [replace(first, x_m=first.x_m - k * shift_m, back_m=2.0) for k in range(4)]
    dusty = Eyes(world, lambda view: replace(view, confidence=0.3) if world.command.blade else view)
    pilot = Pilot(VEHICLE, dusty, replace(PLAN, sides=tuple(strips), gap_m=None))
    for strip in range(1, 4):
        drive(world, pilot, 120.0, until=lambda n=strip: pilot.turns == n or pilot.done)
        assert "seems to end" in pilot.transitions[-2].reason
        assert world.y + VEHICLE.blade_x_m == pytest.approx(10.1, abs=0.1)


def test_where_the_crop_of_the_plan_is_gone_it_stops() -> None:
    """As when it has left its lane: what is farther on may be the neighbour's. Over clear ground
    that is longer than any patch the blade is off, and stays off."""
    world, _, pilot = cutting(metres=1.0)
    bare(world, 3.5)
    blades: list[bool] = []

    def done() -> bool:
        if world.y + VEHICLE.blade_x_m > 3.5 + 1.0:
            blades.append(world.command.blade and world.speed > 0.05)
        return pilot.done

    drive(world, pilot, 90.0, until=done)
    assert pilot.phase is Phase.FAULT
    assert "clear ground for" in pilot.reason
    assert not any(blades)
    assert world.y + VEHICLE.blade_x_m < 7.5


def test_an_end_in_clear_air_needs_no_look() -> None:
    world, _, pilot = cutting()
    drive(world, pilot, 60.0, until=lambda: pilot.turns == 1)
    assert not [t for t in pilot.transitions if t.phase is Phase.HESITATE]


def test_a_bare_patch_where_the_plan_surely_has_crop_is_crossed() -> None:
    """And cut on behind it, where the edge goes on in line."""
    world, _, pilot = cutting(metres=1.0)
    bare(world, 4.0, 6.0)
    drive(world, pilot, 90.0, until=lambda: pilot.turns == 1 or pilot.done)
    assert pilot.turns == 1, pilot.reason
    assert world.y + VEHICLE.blade_x_m == pytest.approx(10.0, abs=0.45)
    assert not standing(world, 0.2, 9.8)


@pytest.mark.parametrize(("begin_m", "end_m"), [(3.0, 7.0), (7.0, 9.0)])
def test_clear_ground_that_reaches_near_the_plans_end_is_not_crossed(
    begin_m: float, end_m: float
) -> None:
    """It may be the gap of a field that is shorter than believed."""
    world, _, pilot = cutting(metres=1.0)
    bare(world, begin_m, end_m)
    drive(world, pilot, 90.0, until=lambda: pilot.turns == 1 or pilot.done)
    assert pilot.phase is Phase.FAULT
    assert "clear ground for" in pilot.reason
    assert world.y + VEHICLE.blade_x_m < end_m


def test_the_blade_raises_no_dust_on_the_way_to_a_sides_crop() -> None:
    """It turns before it meets the crop all the same. Not quite in line after the turn, the machine
    has backed farther than that."""
    world = SimpleWorld(VEHICLE, gap=4.0)
    pilot = Pilot(VEHICLE, world, replace(PLAN, gap_m=4.0))
    drive(world, pilot, 120.0, until=lambda: pilot.turns == 1 and world.speed < -0.2)
    drive(world, pilot, 60.0, until=lambda: abs(world.yaw - math.pi) < 0.05)
    world.y -= 0.2
    log: list[tuple[float, bool]] = []

    def on_the_way() -> bool:
        to_crop = world.x - VEHICLE.blade_x_m - (10.0 - VEHICLE.pass_m)
        if pilot.phase is Phase.FOLLOW and world.command.speed_mps > 0:
            log.append((to_crop, world.command.blade))
        return pilot.turns == 1 and pilot.cut_m > 0.3

    drive(world, pilot, 60.0, until=on_the_way)
    assert {blade for to_crop, blade in log if to_crop > 0.75} == {False}
    assert {blade for to_crop, blade in log if to_crop < 0.4} == {True}
    assert min(to_crop for to_crop, _ in log) < 0.0


def test_a_machine_that_has_left_its_lane_finds_the_edge_beside_it() -> None:
    """Nothing but stubble before the blade, and 0.5 m to the left, farther on, the crop."""
    world, eyes, pilot = cutting(metres=0.5)
    world.x += 0.55
    on_lane = 10.0 - VEHICLE.inset_m

    def aside(view: CropView) -> CropView:
        beside = world.x - on_lane
        if beside < 0.3:
            return view
        return CropView(
            0.9,
            edge_offset_m=beside - (VEHICLE.blade_x_m + 1.2) * math.sin(world.yaw - math.pi / 2),
            edge_ahead_m=1.2,
            crop_ahead_m=1.2,
            ahead_confidence=0.9,
        )

    eyes.spoil = aside
    drive(world, pilot, 90.0, until=lambda: pilot.turns == 1 or pilot.done)
    assert pilot.turns == 1, pilot.reason
    assert world.x == pytest.approx(on_lane, abs=0.1)


def test_where_the_crop_of_the_last_side_is_gone_a_person_must_see() -> None:
    world = SimpleWorld(VEHICLE)
    pilot = Pilot(VEHICLE, world, replace(PLAN, sides=PLAN.sides[:1]))
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > 1.0)
    bare(world, 3.5)
    drive(world, pilot, 90.0, until=lambda: pilot.done)
    assert pilot.phase is Phase.FAULT
    assert "clear ground for" in pilot.reason
    assert world.y + VEHICLE.blade_x_m < 7.5


@pytest.mark.parametrize(("lies", "crossed_m"), [(0.0, 1.2), (0.9, 1.7)])
def test_ground_on_which_crop_seems_to_lie_leads_the_blade_half_a_metre_farther_at_most(
    lies: float, crossed_m: float
) -> None:
    """Near a side's end: for longer it led it through a gap of 2 m, into the neighbour's crop."""
    world = SimpleWorld(VEHICLE)

    def lying(view: CropView) -> CropView:
        return replace(view, lies_confidence=lies) if view.crop_ahead_m > 0.5 else view

    pilot = Pilot(VEHICLE, Eyes(world, lying), PLAN)
    drive(world, pilot, 60.0, until=lambda: pilot.cut_m > 1.0)
    bare(world, 7.2)
    drive(world, pilot, 90.0, until=lambda: pilot.done)
    assert pilot.phase is Phase.FAULT
    assert "clear ground for" in pilot.reason
    assert world.y + VEHICLE.blade_x_m < 7.2 + crossed_m
    if lies:
        assert world.y + VEHICLE.blade_x_m > 7.2 + 0.9


def test_the_last_side_is_cut_to_its_end_though_it_seems_to_end_before() -> None:
    """Elsewhere an end may come 0.8 m before the plan's; here nothing follows."""
    world = SimpleWorld(VEHICLE)
    eyes = Eyes(world, lambda view: hidden_ahead(view) if world.y > 7.7 else view)
    pilot = Pilot(VEHICLE, eyes, replace(PLAN, sides=PLAN.sides[:1], done=1))
    drive(world, pilot, 120.0, until=lambda: pilot.done)
    assert pilot.phase is Phase.FINISHED, pilot.reason
    assert not standing(world, 0.2, 9.6)


@pytest.mark.parametrize("dusty", [False, True])
def test_behind_dust_an_end_lies_somewhere_on_the_way_since_it_was_seen(
    dusty: bool, told_ends: list[ToldEnd]
) -> None:
    world, eyes, pilot = cutting()

    def hidden(view: CropView) -> CropView:
        if not (dusty and world.command.blade):
            return view
        near = world.y + VEHICLE.blade_x_m > 9.6
        return hidden_ahead(view) if near else replace(view, confidence=0.3)

    eyes.spoil = hidden
    drive(world, pilot, 90.0, until=lambda: pilot.turns == 1 or pilot.done)
    [end] = told_ends
    if dusty:
        assert end.doubt_m >= DUSTY_END_SIGMA_M
        ended_m = world.y + VEHICLE.blade_x_m - end.ago_m
        assert abs(ended_m - 10.0) < 2 * end.doubt_m
    else:
        assert end.doubt_m == 0.0


def test_what_a_look_shows_before_the_dust_has_settled_is_not_believed() -> None:
    world, eyes, pilot = cutting(LONG)
    before = world.x

    def settling(view: CropView) -> CropView:
        if world.command.blade or pilot.phase is not Phase.HESITATE:
            return replace(view, confidence=0.0)
        looked_s = world.now - pilot.transitions[-1].stamp
        return beside(-0.2)(view) if looked_s < 0.9 else view

    eyes.spoil = settling
    drive(world, pilot, 90.0, until=lambda: pilot.cut_m > 12.0 or pilot.done)
    assert pilot.cut_m > 12.0, pilot.reason
    assert any("without the blade's dust" in t.reason for t in pilot.transitions)
    assert world.x == pytest.approx(before, abs=0.05)


def test_crop_that_is_met_with_the_blade_off_is_no_dust() -> None:
    """Where it had crossed clear ground, a machine that had been in dust before drove through its
    crop with its blade off, and what stayed hid all from its lens (model field 11057)."""
    world, eyes, pilot = cutting(LONG, metres=8.0)
    bare(world, 10.0, 11.5)

    def unsure(view: CropView) -> CropView:
        """Every third picture shows its edge."""
        seen = round(10 * world.now) % 3 == 0
        return beside(0.0)(view) if seen else replace(view, confidence=0.2)

    eyes.spoil = unsure
    drive(world, pilot, 120.0, until=lambda: world.y + VEHICLE.blade_x_m > 14.0 or pilot.done)
    assert not pilot.done, pilot.reason
    assert not standing(world, 12.3, 13.5)
