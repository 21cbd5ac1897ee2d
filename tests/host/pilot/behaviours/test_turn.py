"""DriveTurn alone: a turn as it is driven, stopped, led another way and ended."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from host.core.frames import Pose2
from host.estimate.crop_ahead import Ahead
from host.estimate.lane import Lane
from host.pilot.behaviours import turn as turn_module
from host.pilot.behaviours.follow import Follow
from host.pilot.behaviours.gather import Why as Gathered
from host.pilot.behaviours.turn import ARRIVES_M, SEARCHES, STEER_TIMEOUT_S, DriveTurn
from host.pilot.behaviours.turn import Why as Turned
from host.pilot.guard import Guard
from host.pilot.planned_strip import PlannedStrip
from host.pilot.turn_progress import PAST_M, Turning
from host.route.manoeuvre import RUN_IN_M
from host.route.manoeuvre import Lane as LaneTo
from host.route.side import Side
from host.route.turn_legs import Follow as Along
from host.route.turn_legs import Goal, Leg, Turn, driven, shuttle
from host.vision.view import CropView
from tests.helpers.behaving import (
    AT_KEEP_OUT,
    CUTTING,
    LOOKS,
    NOW,
    PLAN,
    TOO_NEAR,
    VEHICLE,
    chosen,
    gathering,
    is_for,
    moved,
    seeing,
    stands,
    turned,
    turned_to,
    turning,
)

SLOWEST_DEGPS = 20.0
"""Of the steering motors that docs/build/README.md allows."""


def test_a_turn_waits_for_its_steering_and_then_drives() -> None:
    context = turning()
    turn = DriveTurn(context)
    assert context.turning is not None and context.turning.leg is not None
    while context.turning.leg.steer_rad == 0.0:
        context.turning.next(NOW)
    turn.enter(NOW)
    wanted = context.turning.leg.steer_rad
    command, go = turn.step(NOW)
    assert (command.speed_mps, command.steer_rad, go) == (0.0, wanted, None)
    arrived = NOW + 2 * VEHICLE.steer_limit_deg / SLOWEST_DEGPS + 1.0
    context.sight.usable.stamp = arrived
    assert turn.step(arrived)[1] is None
    context.sight.usable.stamp = NOW + STEER_TIMEOUT_S
    assert is_for(turn.step(NOW + STEER_TIMEOUT_S + 0.1)[1], Turned.STEERING_STUCK)
    assert context.telemetry is not None
    context.telemetry = replace(context.telemetry, angle_rad=wanted)
    assert abs(turn.step(NOW + 0.1)[0].speed_mps) == VEHICLE.manoeuvre_speed_mps


@pytest.mark.parametrize(("speed_mps", "goes"), [(0.15, True), (0.3, False)])
def test_a_machine_that_creeps_on_its_brake_turns_and_one_that_rolls_away_is_named(
    speed_mps: float, goes: bool
) -> None:
    context = turning()
    turn = DriveTurn(context)
    turn.enter(NOW)
    assert context.turning is not None and context.turning.leg is not None
    later = NOW + STEER_TIMEOUT_S + 0.1
    moved(context, 0.5, speed_mps, stamp=later)
    assert context.telemetry is not None
    steer = context.turning.leg.steer_rad
    context.telemetry = replace(context.telemetry, angle_rad=steer)
    context.sight.usable.stamp = later
    command, go = turn.step(later)
    if goes:
        assert go is None
        assert command.speed_mps != 0.0
    else:
        assert is_for(go, Turned.ROLLS)


# ---- another way ---------------------------------------------------------------------------------


def after_search(turn: DriveTurn) -> None:
    """The geofence has stopped a leg; the machine stands until another way is found, or none."""
    assert turn.blocked(NOW, TOO_NEAR) is None
    for _ in range(LOOKS):
        before = turn.turning.turn
        command, go = turn.step(NOW)
        assert stands(command)
        assert go is None
        if turn.turning.turn is not before:
            return


def test_a_turn_whose_leg_the_geofence_stops_goes_another_way_to_the_same_lane() -> None:
    context = turning()
    turn = DriveTurn(context)
    before = turn.turning.turn
    after_search(turn)
    anew = turn.turning.turn
    assert anew.legs != before.legs
    assert turn.turning.leg == anew.legs[0]
    start = turn.turning.beside_lane(context.motion)
    of_lane = [
        replace(leg, value=leg.value - anew.lane_rad) if leg.goal is Goal.HEADING else leg
        for leg in anew.legs
    ]
    *_, last = driven(VEHICLE, Turn(tuple(of_lane), 0.0, 0.0, 0.0, 0.0), at=start)
    end = last.poses[-1]
    assert end.y_m == pytest.approx(0.0, abs=0.03)
    assert math.remainder(end.heading_rad, math.tau) == pytest.approx(0.0, abs=0.03)
    assert end.x_m + VEHICLE.blade_x_m < anew.crop_begins_m


def test_beside_a_lane_another_way_begins_where_pictures_have_shown_the_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    context = turning()
    context.turning = Turning(NOW, shuttle(VEHICLE, -8.0, VEHICLE.pass_m, 3.0), (0.0, 0.0, 0.0))
    assert context.turning.beside
    monkeypatch.setattr(Lane, "backwards", property(lambda _: (0.4, 0.1)))
    starts: list[Pose2] = []
    monkeypatch.setattr(turn_module, "way", lambda _, start, *__: starts.append(start))
    after_search(DriveTurn(context))
    assert len(starts) == LOOKS
    for start in starts:
        assert (start.y_m, start.heading_rad) == pytest.approx((0.4, 0.1))


def test_where_no_way_is_left_the_turn_takes_its_next_leg(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Guard, "room_around", lambda *_: None)
    context = turning()
    turn = DriveTurn(context)
    first = turn.turning.leg
    after_search(turn)
    assert turn.turning.leg is not first
    assert turn.turning.searches == 1, "and may find one from elsewhere"


@pytest.mark.parametrize(
    ("aside_m", "askew_deg", "anew"),
    [
        (0.0, 0.0, False),
        (0.25, 15.0, False),
        (0.5, 0.0, True),
        (-0.5, 0.0, True),
        (0.0, 30.0, True),
    ],
)
def test_a_turn_that_ends_off_its_lane_goes_on(
    aside_m: float, askew_deg: float, anew: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = turned()
    turn = DriveTurn(context)
    against = (aside_m, math.radians(askew_deg))
    monkeypatch.setattr(turn.turning, "against_lane", lambda _: against)
    go = turn.step(NOW)[1]
    assert is_for(go, None if anew else Turned.TURNED)
    for _ in range(LOOKS if anew else 0):
        turn.step(NOW)
    assert (turn.turning.leg is not None) is anew


def test_another_way_is_looked_for_so_often_and_then_a_person_is_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whatever edge it sees across its way is not the new lane's."""
    turn = DriveTurn(turning())
    monkeypatch.setattr(turn.turning, "against_lane", lambda _: (0.0, math.radians(80.0)))
    for _ in range(SEARCHES):
        before = turn.turning.searches
        after_search(turn)
        assert turn.turning.searches == before + 1
    while turn.turning.leg is not None:
        turn.blocked(NOW, TOO_NEAR)
    go = turn.step(NOW)[1]
    assert is_for(go, Turned.NO_ROOM)
    assert go is not None and "80 deg" in go.text


@pytest.mark.parametrize(
    ("broken_off", "aside_m", "behind_m", "missed"),
    [
        (True, 0.9, 9.0, True),
        (True, 0.9, 3.0, False),
        (True, 0.1, 9.0, False),
        (False, 0.9, 9.0, False),
    ],
)
def test_a_turn_that_stays_beside_the_far_end_of_its_strip_begins_none(
    broken_off: bool, aside_m: float, behind_m: float, missed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One after the other the strips beside it would seem to end there (random field 10638)."""
    turn = DriveTurn(turning())
    turn.turning.broken_off = broken_off
    turn.turning.searches = SEARCHES
    while turn.turning.leg is not None:
        turn.turning.next(NOW)
    monkeypatch.setattr(turn.turning, "against_lane", lambda _: (aside_m, 0.0))
    monkeypatch.setattr(turn.turning, "crop_expected_m", lambda *_: -behind_m)
    go = turn.step(NOW)[1]
    assert is_for(go, Turned.NO_ROOM_BACK if missed else Turned.TURNED)
    assert go is not None and ("9 m behind" in go.text) is missed


@pytest.mark.parametrize(("length_m", "over"), [(1.0, True), (9.0, False)])
def test_without_room_to_turn_to_the_last_rest_the_harvest_is_over(
    length_m: float, over: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a field of 100 m2, 0.9 m2 or 8."""
    last = replace(PLAN.sides[1], length_m=length_m)
    context = turning(replace(PLAN, sides=(PLAN.sides[0], last)))
    turn = DriveTurn(context)
    turn.turning.broken_off = True
    turn.turning.searches = SEARCHES
    while turn.turning.leg is not None:
        turn.turning.next(NOW)
    monkeypatch.setattr(turn.turning, "against_lane", lambda _: (0.0, math.radians(80.0)))
    go = turn.step(NOW)[1]
    assert is_for(go, Turned.LEFT_NO_ROOM if over else Turned.NO_ROOM)
    assert (context.left_m2 > 0.5) is over


def test_a_turn_past_a_keep_out_leads_to_its_lane_farther_on_and_counts_what_it_leaves() -> None:
    context = turned_to(7.0)
    Follow(context).blocked(NOW, AT_KEEP_OUT)
    turn = DriveTurn(context)
    turning = turn.turning
    here = turning.beside_lane(context.motion)
    for _ in range(LOOKS):
        assert stands(turn.step(NOW)[0])
        if turning.leg is not None:
            break
    legs = turning.turn.legs
    assert legs and all(leg.follow is Along.NOTHING for leg in legs), "nothing leads back"
    of_lane = [
        replace(leg, value=leg.value - turning.turn.lane_rad) if leg.goal is Goal.HEADING else leg
        for leg in legs
    ]
    *_, last = driven(VEHICLE, Turn(tuple(of_lane), 0.0, 0.0, 0.0, 0.0), at=here)
    end = last.poses[-1]
    assert end.x_m > here.x_m + PAST_M - 0.05
    assert end.y_m == pytest.approx(0.0, abs=0.03)
    moved(context, context.motion.distance_m + 2.0, stamp=NOW + 4.0)
    context.begin_strip()
    assert context.left_standing_m2 == pytest.approx(2.0 * PLAN.sides[1].width_m, rel=0.1)


def test_backing_along_its_lane_a_turn_is_over_where_the_geofence_ends_it() -> None:
    context = turning()
    turn = DriveTurn(context)
    while not turn.turning.backing:
        turn.turning.next(NOW)
    assert turn.turning.leg is not None
    turn.turning.against_lane = lambda _: (0.1, 0.1)  # type: ignore[method-assign]
    turn.blocked(NOW, TOO_NEAR)
    assert turn.turning.leg is None
    assert turn.turning.searches == 0


# ---- the end of a turn ---------------------------------------------------------------------------


def test_after_its_last_leg_a_turn_looks_for_the_crop(monkeypatch: pytest.MonkeyPatch) -> None:
    context = turned()
    assert context.turning is not None
    monkeypatch.setattr(context.turning, "against_lane", lambda _: (0.0, 0.0))
    assert is_for(DriveTurn(context).step(NOW)[1], Turned.TURNED)


@pytest.mark.parametrize(
    ("before_crop_m", "new", "approached"),
    [(0.2, False, True), (-0.3, False, False), (-0.3, True, True)],
)
def test_a_turn_that_lacked_room_is_known_to_end_inside_the_crop(
    before_crop_m: float, new: bool, approached: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a side that is still to be found nobody knows where inside is."""
    context = turned()
    monkeypatch.setattr(PlannedStrip, "new", new)
    assert context.turning is not None
    monkeypatch.setattr(context.turning, "against_lane", lambda _: (0.0, 0.0))
    monkeypatch.setattr(context.turning, "crop_expected_m", lambda *_: before_crop_m)
    DriveTurn(context).step(NOW)
    assert context.sight.ahead.approached is approached


def test_a_side_is_begun_in_line_or_from_as_far_back_as_there_is_room(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Half a metre into the gap; a metre over what has been cut."""

    def done(back_m: float, beyond_m: float, offset_m: float = 0.0, askew_deg: float = 0.0) -> bool:
        sides = (PLAN.sides[0], replace(PLAN.sides[1], back_m=back_m), *PLAN.sides[2:])
        context = turning(replace(PLAN, sides=sides))
        turning_ = context.turning
        assert turning_ is not None
        while not turning_.backing:
            turning_.next(NOW)
        heading = math.radians(askew_deg)
        offset_m -= VEHICLE.blade_x_m * math.sin(heading)
        context.estimate.lane.place(offset_m, heading, 0.1, 0.1)
        monkeypatch.setattr(turning_, "to_go", lambda *_: -beyond_m)
        return DriveTurn(context).leg_done(NOW)

    assert not done(0.0, -0.1)
    assert done(0.0, 0.1)
    assert not done(0.0, 0.1, offset_m=0.1)
    assert not done(0.0, 0.1, askew_deg=8.0)
    assert done(0.0, 0.6, offset_m=0.1)
    assert not done(2.0, 0.9, offset_m=0.1)
    assert done(2.0, 1.1, offset_m=0.1)


def test_a_machine_with_crop_at_its_blade_backs_as_far_as_its_side_may_begin(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(PlannedStrip, "begin_doubt_m", 0.8)
    at_blade = replace(CUTTING, crop_ahead_m=0.0)

    def done(view: CropView, beyond_m: float) -> bool:
        context = turning()
        turning_ = context.turning
        assert turning_ is not None
        while not turning_.backing:
            turning_.next(NOW)
        context.estimate.lane.place(0.0, 0.0, 0.1, 0.1)
        seeing(context, view)
        monkeypatch.setattr(turning_, "to_go", lambda *_: -beyond_m)
        return DriveTurn(context).leg_done(NOW)

    assert not done(at_blade, 0.7)
    assert done(at_blade, 0.9)
    assert done(replace(CUTTING, crop_ahead_m=0.3), 0.1)
    assert done(replace(at_blade, ahead_confidence=0.2), 0.1)


@pytest.mark.parametrize(
    ("before_m", "offset_m", "enough"),
    [(0.9, 0.0, True), (0.7, 0.0, False), (0.9, 0.1, False), (1.3, 0.1, True)],
)
def test_a_machine_that_sees_its_side_begin_farther_ahead_backs_no_more(
    before_m: float, offset_m: float, enough: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever is left of the way back by dead reckoning (random field 10137)."""
    context = turning()
    turning_ = context.turning
    assert turning_ is not None
    while not turning_.backing:
        turning_.next(NOW)
    context.estimate.lane.place(offset_m, 0.0, 0.1, 0.1)
    begins_at_m = context.motion.distance_m + before_m
    monkeypatch.setattr(Ahead, "begins_at_m", begins_at_m)
    monkeypatch.setattr(turning_, "to_go", lambda *_: 0.5)
    assert DriveTurn(context).leg_done(NOW) is enough


# ---- to what the plan has left standing ----------------------------------------------------------


def test_the_way_to_it_is_found_from_where_the_machine_stands() -> None:
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    turn = DriveTurn(context)
    turn.enter(NOW)
    for _ in range(LOOKS):
        command, go = turn.step(NOW)
        assert stands(command) and go is None
        if context.turning is not None and context.turning.leg is not None:
            break
    assert context.turning is not None and context.turning.leg is not None
    start = context.turning.beside_lane(context.motion)
    *way, back = driven(VEHICLE, context.turning.turn, at=start)
    assert back.leg.follow is Along.NEW_LANE
    begins_m = -VEHICLE.blade_x_m - RUN_IN_M
    assert math.hypot(start.x_m - begins_m, start.y_m) > 4.0, "it comes from far away"
    assert begins_m - ARRIVES_M - 0.01 < way[-1].poses[-1].x_m


def test_where_no_way_leads_there_something_else_is_gathered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    asked: list[LaneTo] = []
    monkeypatch.setattr(turn_module, "way", lambda *args: asked.append(args[2]))
    turn = DriveTurn(context)
    turn.enter(NOW)
    steps = [turn.step(NOW)[1] for _ in range(LOOKS + 2)]
    assert is_for(next(go for go in steps if go is not None), Turned.NO_WAY)
    begins_m = -VEHICLE.blade_x_m - RUN_IN_M
    assert {lane.from_m for lane in asked} == {begins_m - ARRIVES_M}, "not far before the crop"
    assert len(asked) == LOOKS, "once in each room"


@pytest.mark.parametrize(
    ("view", "reverse", "y_m", "stops"),
    [
        (CUTTING, False, 9.0, True),
        (CUTTING, True, 9.0, False),
        (CUTTING, False, 5.0, False),
        (replace(CUTTING, crop_ahead_m=0.5), False, 9.0, False),
        (replace(CUTTING, ahead_confidence=0.2), False, 9.0, False),
    ],
)
def test_a_machine_that_finds_crop_where_it_has_cut_it_has_lost_its_place(
    view: CropView, reverse: bool, y_m: float, stops: bool
) -> None:
    """Six metres from where it believed to be, a machine that went to what was left drove into the
    neighbour's crop (model field 11057). Crop still stands from 4 m to 6 m."""
    context = gathering()
    assert is_for(chosen(context), Gathered.STRIP)
    assert context.turning is not None
    turn = DriveTurn(context)
    turn.enter(NOW)
    while context.turning.leg is None:
        turn.step(NOW)
    context.turning.lay_anew((Leg(0.0, reverse, Goal.WAY, 9.0),), NOW)
    begun_m = context.motion.distance_m
    goes = []
    for k in range(30):
        stamp = NOW + 0.1 * k
        moved(context, begun_m + 0.03 * k, 0.3, stamp=stamp)
        context.estimate.position.place(Side(2.0, y_m, 0.0, 6.0, 0.9, 6.0), 0.0, 0.0, 0.0)
        seeing(context, view, stamp=stamp)
        goes.append(turn.step(stamp)[1])
    found = [(k, go) for k, go in enumerate(goes) if go is not None]
    assert bool(found) is stops
    if found:
        assert is_for(found[0][1], Turned.IN_THE_WAY)
        assert 0.03 * found[0][0] < 0.6
