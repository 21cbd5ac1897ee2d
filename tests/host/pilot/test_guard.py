"""The geofence where the boundary is to be found: what pictures of the way ahead change, and what
they never change."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.frames import Pose2
from host.core.messages import Command, Request, State
from host.core.vehicle import Vehicle
from host.estimate.estimator import Estimator
from host.estimate.odometry import Motion
from host.estimate.position import Position
from host.field.areas import Verdict
from host.link.protocol import Fault, fault_texts
from host.pilot.guard import CREEP_MPS, Guard, SeenFree, Watched, no_farther, watch
from host.pilot.phase import Doing
from host.route.plan import Plan, spiral
from tests.helpers.places import followed

VEHICLE = Vehicle()
TWENTY = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)]
RING = [(0.0, 0.0), (9.0, 0.0), (9.0, 7.0), (0.0, 7.0)]
GAP_M = 2.0
ON = Command(Request.DRIVE, 0.0, 0.5, True)
BACK = Command(Request.DRIVE, 0.0, -0.5, False)
FREE = SeenFree(crop_m=0.0, clear_m=2.5)


@cache
def plan() -> Plan:
    return spiral(RING, 0, VEHICLE, gap_m=GAP_M, sigma_m=1.0)


def driven(before_end_m: float, sigma_m: float) -> Position:
    """The blade so far before where the first side's end is taken to be, along which the machine
    has come."""
    side = plan().sides[0]
    position = Position(VEHICLE, plan().boundary, sigma_m)
    position.place(side, 0.0, 0.0, 0.0)
    for distance_m in np.linspace(0.0, side.length_m - before_end_m, 15):
        motion = Motion(0.0, 0.5, 0.0, float(distance_m), 0.0, 0.0, 0.0)
        position.predict(motion, cutting=False)
        followed(position, 0.0, 0.02)
    return position


def guard_at(before_end_m: float, sigma_m: float = 1.0) -> Guard:
    return Guard(plan(), VEHICLE, driven(before_end_m, sigma_m))


def passes(answer: Command | Verdict, command: Command = ON) -> bool:
    return isinstance(answer, Command) and answer.speed_mps == command.speed_mps


def test_where_the_end_may_be_anywhere_the_machine_does_not_drive_on_unseeing() -> None:
    answer = guard_at(0.3).limit(ON)
    assert not passes(answer)
    assert not (isinstance(answer, Verdict) and answer.elsewhere)
    assert passes(guard_at(0.3, 0.0).limit(ON)), "where the boundary is known it may"


def test_crop_that_was_seen_to_go_on_lets_it_cut_on() -> None:
    assert passes(guard_at(0.3).limit(ON, SeenFree(crop_m=0.0)))
    assert not passes(guard_at(0.3).limit(ON, SeenFree(crop_m=3.0)))


def test_ground_that_was_seen_clear_lets_it_turn() -> None:
    assert passes(guard_at(0.3).limit(ON, SeenFree(clear_m=2.5)))
    assert not passes(guard_at(0.3).limit(ON, SeenFree(clear_m=0.5)))


def test_clear_ground_ahead_says_nothing_of_what_lies_behind() -> None:
    """Of a machine that has turned round on the spot and backs to an end that nobody has seen."""
    position = driven(-0.8, 1.0)
    axle_m = plan().sides[0].length_m + 0.8
    position.predict(Motion(0.0, 0.0, 0.0, axle_m, math.pi, 0.0, 0.0), cutting=False)
    guard = Guard(plan(), VEHICLE, position)
    without = guard.limit(BACK)
    assert not passes(without, BACK)
    assert guard.limit(BACK, SeenFree(clear_m=2.5)) == without


def test_an_edge_that_was_found_farther_out_has_its_gap_there() -> None:
    position = driven(-0.8, 1.0)
    position.at_end(plan().sides[0], 0.0)
    assert passes(Guard(plan(), VEHICLE, position).limit(ON))
    assert not passes(guard_at(-0.8, 0.0).limit(ON)), "where it is known to lie nearer"


def test_of_two_places_at_which_it_may_be_neither_may_be_too_near() -> None:
    """An end is found 4 m before the plan's, and the machine goes on: from the end it would be
    beyond the gap."""
    position, side = driven(4.0, 0.0), plan().sides[0]
    slow = replace(ON, speed_mps=CREEP_MPS)
    on = Motion(0.0, 0.5, 0.0, side.length_m - 4.0 + 1.7, 0.0, 0.0, 0.0)
    at = Pose2(0.0, 0.0, 0.0)
    one = Guard(plan(), VEHICLE, position).room_around(at)
    position.at_end(side, 0.0, 0.0, 0.3, 4.0)
    assert passes(Guard(plan(), VEHICLE, position).limit(slow), slow)
    both = Guard(plan(), VEHICLE, position).room_around(at)
    assert one is not None and both is not None
    nearest, nearest_of_both = (float(r.sides[:, [0, 2]].min(axis=1).max()) for r in (one, both))
    assert len(both.sides) == 2 * len(one.sides) == both.margins.shape[1]
    assert nearest_of_both == pytest.approx(nearest, abs=0.4), "what main sees stays"
    ahead = np.sort(both.sides[:, [0, 2]].min(axis=1))[-2:]
    assert ahead[1] - ahead[0] == pytest.approx(4.0, abs=0.6)
    position.predict(on, cutting=False)
    guard = Guard(plan(), VEHICLE, position)
    answer = guard.limit(slow)
    assert isinstance(answer, Verdict) and answer.elsewhere
    position.forget()
    assert passes(guard.limit(slow), slow)


def test_what_an_edge_lies_off_along_itself_says_nothing_of_another_edge() -> None:
    """The first side's edge, and all else but the far corners, lies 1.5 m farther back along it:
    the border at its end is where it was, and near to the machine."""
    position = driven(0.3, 1.0)
    at = Pose2(0.0, 0.0, 0.0)
    before = Guard(plan(), VEHICLE, position).room_around(at)
    by_m = np.zeros((len(RING), 2))
    by_m[[0, 3]] = -1.5, 0.0
    position.outline.move(by_m.ravel())
    after = Guard(plan(), VEHICLE, position).room_around(at)
    assert before is not None and after is not None
    end = int(np.argmax(before.sides[:, [0, 2]].min(axis=1)))
    assert after.sides[end] == pytest.approx(before.sides[end], abs=1e-6)
    begin = int(np.argmin(before.sides[:, [0, 2]].max(axis=1)))
    assert after.sides[begin, [0, 2]] == pytest.approx(before.sides[begin, [0, 2]] - 1.5)


def test_of_a_border_that_was_found_the_room_is_known_and_of_others_it_is_not() -> None:
    position = driven(-0.2, 1.0)
    position.at_end(plan().sides[0], 0.0)
    room = Guard(plan(), VEHICLE, position).room_around(Pose2(0.0, 0.0, 0.0))
    assert room is not None
    ahead, left, behind, right = (
        float(room.margins[2, int(np.argmax(score))])
        for score in (
            room.sides[:, [0, 2]].min(axis=1),
            room.sides[:, [1, 3]].min(axis=1),
            -room.sides[:, [0, 2]].max(axis=1),
            -room.sides[:, [1, 3]].max(axis=1),
        )
    )
    assert right < 0.7, "it has come along it"
    assert ahead < 1.2, "it has met it"
    assert behind < 0.7, "it was put down there"
    assert left > 1.5


@pytest.mark.parametrize("sigma_m", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("seen", [SeenFree(), SeenFree(crop_m=0.0), SeenFree(clear_m=2.5), FREE])
def test_a_border_that_is_surely_crossed_stays_refused(sigma_m: float, seen: SeenFree) -> None:
    for beyond_m in (GAP_M - 0.1, GAP_M, 2 * GAP_M):
        assert isinstance(guard_at(-beyond_m, sigma_m).limit(ON, seen), Verdict)


@given(st.floats(-3.0, 2.0), st.floats(0.0, 3.0), st.floats(0.0, 3.0))
def test_a_machine_is_never_let_nearer_the_border_than_one_that_knows_its_place(
    before_end_m: float, crop_m: float, clear_m: float
) -> None:
    """What is seen makes the position surer, and the border no wider."""
    known = guard_at(before_end_m, 0.0).limit(ON, FREE)
    if isinstance(known, Verdict):
        answer = guard_at(before_end_m).limit(ON, SeenFree(crop_m, clear_m))
        assert isinstance(answer, Verdict)


def test_away_from_the_border_it_creeps_whatever_is_seen() -> None:
    answer = guard_at(-GAP_M).limit(BACK, FREE)
    assert isinstance(answer, Command)
    assert answer.speed_mps == -CREEP_MPS


# ---- no_farther ----------------------------------------------------------------------------------


@given(
    st.floats(0.01, 2.0), st.floats(0.01, 2.0), st.floats(-3.0, 3.0), st.floats(-3.2, 3.2),
    st.floats(0.0, 2.0),
)  # fmt: skip
def test_along_a_direction_no_more_is_left_than_is_said_and_across_nothing_grows(
    one_m: float, other_m: float, askew_rad: float, heading_rad: float, sigma_m: float
) -> None:
    c, s = math.cos(askew_rad), math.sin(askew_rad)
    turn = np.array([[c, -s], [s, c]])
    whole = (turn @ np.diag([one_m**2, other_m**2]) @ turn.T)[np.newaxis]
    [found] = no_farther(whole, heading_rad, sigma_m)
    way = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    across = np.array([-way[1], way[0]])
    before = math.sqrt(way @ whole[0] @ way)
    assert math.sqrt(max(0.0, way @ found @ way)) == pytest.approx(min(before, sigma_m), abs=1e-6)
    assert across @ found @ across == pytest.approx(across @ whole[0] @ across)
    assert np.linalg.eigvalsh(found).min() > -1e-9


def test_what_is_known_well_enough_stays_as_it_is() -> None:
    whole = np.array([[[0.04, 0.01], [0.01, 0.09]], [[0.0, 0.0], [0.0, 0.0]]])
    assert np.array_equal(no_farther(whole, 0.7, 5.0), whole)


def test_a_corner_that_is_found_farther_off_than_a_walk_errs_stops_the_machine() -> None:
    """The geofence moves with the corners that are found: one that runs away must not."""
    estimate = Estimator(VEHICLE, spiral(TWENTY, 0, VEHICLE, gap_m=2.0, sigma_m=1.0))
    moved = np.zeros(estimate.position.outline.states)
    moved[::2] = 9.0
    estimate.position.outline.move(moved)
    assert watch(State.RUNNING, estimate) is None, "all lie elsewhere: so the field was walked"
    moved[:] = 0.0
    moved[0] = 8.0
    estimate.position.outline.move(moved)
    go = watch(State.RUNNING, estimate)
    assert go is not None and "6 m" in go.text


@pytest.mark.parametrize(("steer_rad", "leaves"), [(0.0, True), (0.3, True), (-0.6, False)])
def test_who_stands_too_near_may_leave_but_not_swing_its_blade_out(
    steer_rad: float, leaves: bool
) -> None:
    """The border lies at its right. Its axle goes away from it; on the right lock its blade does
    not."""
    position = Position(VEHICLE, plan().boundary, 0.0)
    position.place(plan().sides[0], 3.0, -2.1, math.radians(4.0))
    guard = Guard(plan(), VEHICLE, position)
    answer = guard.limit(Command(Request.DRIVE, steer_rad, 0.3, False))
    assert isinstance(answer, Command) is leaves
    if isinstance(answer, Command):
        assert answer.speed_mps == CREEP_MPS


@pytest.mark.parametrize(
    ("deg", "why"), [(-10.0, Watched.ASKEW), (90.0, Watched.ELSEWHERE), (-180.0, Watched.ELSEWHERE)]
)
def test_courses_name_strips_that_have_turned_or_another_corner(deg: float, why: Watched) -> None:
    estimate = Estimator(VEHICLE, plan())
    estimate.askew_rad = math.radians(deg)
    found = watch(State.RUNNING, estimate)
    assert found is not None and found.reason is why
    assert f"{abs(deg):.0f} deg" in found.text


@pytest.mark.parametrize(("deg", "side"), [(5.0, "left"), (-5.0, "right")])
def test_a_pot_that_is_loose_is_named_with_how_much_and_to_which_side(
    deg: float, side: str
) -> None:
    estimate = Estimator(VEHICLE, plan())
    estimate.odometry.turn_trim(math.tan(math.radians(0.8 * deg)) / VEHICLE.wheelbase_m)
    assert watch(State.RUNNING, estimate) is None
    estimate.odometry.turn_trim(math.tan(math.radians(deg)) / VEHICLE.wheelbase_m)
    found = watch(State.RUNNING, estimate)
    assert found is not None and found.reason is Watched.POT_OFF
    assert f"5 deg farther to the {side}" in found.text


def test_pictures_that_do_not_move_as_the_machine_does_stop_it_in_their_watchs_words() -> None:
    estimate = Estimator(VEHICLE, plan())
    assert watch(State.RUNNING, estimate) is None
    estimate.pictures.wrong = "the camera's stream hangs"
    found = watch(State.RUNNING, estimate)
    assert found is not None and found.reason is Watched.PICTURES
    assert found.text.endswith("as the machine does: the camera's stream hangs")


def test_what_the_firmware_reports_is_said_in_its_words() -> None:
    found = watch(State.FAULT, Estimator(VEHICLE, plan()), int(Fault.ESTOP_OPEN))
    assert found is not None and found.reason is Watched.FIRMWARE_FAULT
    assert fault_texts(Fault.ESTOP_OPEN)[0] in found.text


def test_a_wheel_that_is_not_the_one_that_is_counted_stops_the_machine_and_is_named() -> None:
    estimate = Estimator(VEHICLE, plan())
    assert watch(State.RUNNING, estimate) is None
    for times in (0.45, 2.1):
        estimate.odometry.wheel_place.take(times, 1.0, ended=True)
    go = watch(State.RUNNING, estimate)
    assert go is not None and go.reason is Watched.WHEEL_PLACE
    assert go.reason.to is Doing.FAULT
    assert "2.1 times" in go.text and "hall_left_m" in go.text
