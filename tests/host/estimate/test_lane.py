"""Facts about the lane and the position: what moves them, and how much."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from host.core.vehicle import Vehicle
from host.estimate.kalman import Measurement
from host.estimate.lane import Lane
from host.estimate.lanes import CATCH_UP_M, STRAIGHTEN_M, Aside, caught_up, straightened
from host.estimate.motion_model import BESIDE, PRESSED, YAW_SIGMA_SHARE
from host.estimate.odometry import Motion
from host.estimate.position import Position
from host.estimate.prior import START_SIGMA
from host.estimate.states import GRADE_X, GRADE_Y, SCALE, SIGHT, WANDER, YAW
from host.route.side import Side
from tests.helpers.places import OnLane, driven, followed, spun, sure_of

VEHICLE = Vehicle()
STEP_M = 0.05
SURE = (1e-4, 1e-4, 1e-5)
"""Of a machine whose own place is known."""


def motion(run_m: float, yaw_rad: float = 0.0) -> Motion:
    return Motion(0.0, 0.5, 0.0, run_m, yaw_rad, run_m, 0.0)


def edge_at(offset_m: float, heading_rad: float) -> float:
    """What vision measures of the edge from there."""
    return -(offset_m + VEHICLE.blade_x_m * math.sin(heading_rad)) / math.cos(heading_rad)


def bend(machine: OnLane, curvature_1pm: float, steps: int, begin_m: float = 0.0) -> float:
    """Drives on a bend that the pot does not show; the curvature that is learned of it."""
    for k in range(steps):
        run = STEP_M * k
        machine.predict(motion(begin_m + run))
        offset, heading = curvature_1pm * run**2 / 2, curvature_1pm * run
        machine.lane.correct(edge_at(offset, heading), -heading, 1.0, (0.0, 0.0))
    return machine.position.take_curve()


def settled() -> OnLane:
    machine = OnLane(VEHICLE)
    for _ in range(20):
        machine.lane.correct(0.0, 0.0, 1.0, (0.0, 0.0))
    return machine


def test_what_is_known_of_the_steerings_bias_outlives_a_turn() -> None:
    fresh, known = OnLane(VEHICLE), OnLane(VEHICLE)
    bend(known, 0.0, 200)
    known.lane.place(0.0, 0.0, 0.1, math.radians(5))
    assert abs(bend(known, 0.01, 40, 10.0)) < 0.5 * abs(bend(fresh, 0.01, 40))


def test_a_contradiction_teaches_nothing_about_the_steerings_bias() -> None:
    machine = settled()
    for k in range(400):
        machine.predict(motion(0.01 * k))
        if machine.lane.correct(0.6, 0.0, 1.0, (0.0, 0.0)):
            break
    assert not machine.lane.contradicted
    assert abs(machine.position.take_curve()) < 0.003


@pytest.mark.parametrize("holds", [False, True])
def test_an_edge_that_contradicts_is_believed_in_the_end_but_for_a_lane_that_holds(
    holds: bool,
) -> None:
    machine = settled()
    machine.lane.holds = holds
    before = machine.lane.blade_offset_m
    for _ in range(120):
        machine.lane.correct(0.7, math.nan, 0.9, (0.0, 0.0), cutting=False)
    moved = abs(machine.lane.blade_offset_m - before) > 0.5
    assert moved is not holds


def test_the_less_sure_the_picture_the_less_it_moves_the_estimate() -> None:
    moved = []
    for confidence in (1.0, 0.75, 0.5):
        lane = settled().lane
        lane.correct(-0.05, 0.0, confidence, (0.0, 0.0))
        moved.append(lane.blade_offset_m)
    assert moved[0] > 1.5 * moved[1] > 0.0
    assert moved[1] > 1.2 * moved[2] > 0.0


def test_an_edge_seen_ahead_is_none_at_the_blade() -> None:
    """Askew by 10 degrees, the crop's corner 1.2 m ahead of the blade."""
    ahead_m, heading = 1.2, math.radians(10)
    lane = OnLane(VEHICLE).lane
    lane.place(0.05, heading, 0.1, math.radians(1))
    seen = -(0.05 + (VEHICLE.blade_x_m + ahead_m) * math.sin(heading)) / math.cos(heading)
    for _ in range(20):
        assert lane.correct(seen, math.nan, 1.0, (0.0, 0.0), ahead_m=ahead_m)
    assert lane.offset_m == pytest.approx(0.05, abs=1e-6)
    assert lane.heading_rad == pytest.approx(heading, abs=1e-6)


def test_a_late_picture_is_held_against_where_the_vehicle_was() -> None:
    """On a circle around the lane's origin, each picture half a metre late."""
    curvature, late = 0.1, 10
    poses = [
        ((1 - math.cos(yaw)) / curvature, yaw) for yaw in np.arange(0, 120) * STEP_M * curvature
    ]
    machine = OnLane(VEHICLE)
    lane = machine.lane
    for k, (_, yaw) in enumerate(poses[:80]):
        machine.predict(motion(STEP_M * k, yaw))
        if k < late:
            continue
        offset, heading = poses[k - late]
        since = (STEP_M * late, yaw - heading)
        assert lane.correct(edge_at(offset, heading), -heading, 1.0, since)
    offset, heading = poses[79]
    assert lane.heading_rad == pytest.approx(heading, abs=0.01)
    assert lane.offset_m == pytest.approx(offset, abs=0.02)


def sure_at(position: Position, side: Side, along_m: float) -> None:
    """The blade stands there, to a centimetre."""
    h = np.zeros((1, len(position.x)))
    h[0, 0] = math.cos(side.heading_rad)
    off = along_m - position.along(side)
    position.fuse(Measurement("there", h, np.array([off]), np.array([0.01**2])))


def ring(index: int, length_m: float = 10.0) -> Side:
    """Each lies a pass inside the one before."""
    return Side(0.0, index * VEHICLE.pass_m, 0.0, length_m, VEHICLE.pass_m, length_m)


def test_the_further_inside_the_less_a_sides_line_proves() -> None:
    """What the swaths before it were off adds up."""
    moved = []
    for inside in (0, 12, 40):
        position = Position(VEHICLE)
        position.place(ring(0), 0.0, 0.0, 0.0)
        for k in range(1, inside + 1):
            position.begin(ring(k))
        position.predict(motion(0.0), cutting=False)
        x, y, _ = position.pose
        driven(position, x, y + inside * VEHICLE.pass_m, 0.0, motion(0.0))
        sure_of(position, 0.05, 0.05, START_SIGMA[2])
        before = position.pose[1]
        followed(position, 0.1, 0.0)
        moved.append(position.pose[1] - before)
    assert 0.1 > moved[0] > 1.2 * moved[1] > 1.2 * moved[2] > 0.0


@pytest.mark.parametrize("askew_deg", [-8.0, -2.0, 2.0, 8.0])
def test_beside_an_edge_that_lies_askew_a_lane_lies_less_askew_and_leaves_nothing(
    askew_deg: float,
) -> None:
    """At one of its ends it lies over what is cut, at the other along the edge, at none inside."""
    askew, length_m = math.radians(askew_deg), 6.0
    aside = straightened(askew, 0.0, length_m)
    ends = (aside.begin_m, aside.begin_m + aside.slope * length_m)
    assert min(ends) == pytest.approx(0.0, abs=1e-9)
    assert max(ends) == pytest.approx(min(STRAIGHTEN_M, abs(math.tan(askew)) * length_m))
    assert abs(math.tan(askew) - aside.slope) < abs(math.tan(askew))
    assert straightened(askew, abs(askew), length_m) == (0.0, 0.0), "what may be nothing"


@pytest.mark.parametrize("askew_deg", [0.0, 2.0])
def test_the_next_round_knows_where_the_last_strip_lies(askew_deg: float) -> None:
    """0.1 m right of the plan's lane at its beginning, and askew; another edge's lane is not."""
    position, run_m = Position(VEHICLE), 0.0
    position.place(ring(0), 0.0, 0.0, 0.0)
    for _ in range(20):
        run_m += 0.5
        position.predict(motion(run_m), cutting=False)
        sure_of(position, *SURE)
        along = position.along(ring(0))
        followed(position, 0.1 - math.radians(askew_deg) * along, 0.0)
    inner = replace(ring(1), x_m=2.0)
    position.begin(inner, straight=False)
    there = driven(position, 2.0, VEHICLE.pass_m + VEHICLE.inset_m, 0.0, motion(run_m))
    offset, heading, _, _ = position.against_lane()
    assert offset == pytest.approx(0.1 - math.radians(askew_deg) * 2.0, abs=0.02)
    assert math.degrees(heading) == pytest.approx(-askew_deg, abs=0.3)
    across = replace(ring(1), heading_rad=math.pi / 2)
    position.begin(across)
    driven(position, -VEHICLE.inset_m + across.x_m, 1.0, math.pi / 2, there)
    assert position.against_lane()[:2] == pytest.approx((0.0, 0.0), abs=1e-9)


def beside_an_askew_lane(askew_deg: float, side: Side, *, straight: bool) -> Position:
    """On a side, after one along edge 3 whose lane was found to lie askew."""
    position, run_m = Position(VEHICLE), 0.0
    first = replace(ring(0), edges=(3,), places_m=((0.0, 0.0),))
    position.place(first, 0.0, 0.0, 0.0)
    for _ in range(20):
        run_m += 0.5
        position.predict(motion(run_m), cutting=False)
        sure_of(position, *SURE)
        followed(position, -math.radians(askew_deg) * position.along(first), 0.0)
    position.begin(side, straight=straight)
    driven(position, 2.0, side.y_m + VEHICLE.inset_m, 0.0, motion(run_m))
    return position


def test_an_edge_that_the_machine_has_left_may_wander_more_than_a_drilled_one() -> None:
    def may_wander_m(position: Position) -> float:
        return position.sigma(np.eye(len(position.x))[WANDER])

    position = Position(VEHICLE)
    position.place(ring(0), 1.0, 0.0, 0.0)
    drilled_m = may_wander_m(position)
    position.begin(ring(1))
    left_m = may_wander_m(position)
    assert left_m > 1.5 * drilled_m
    inside = replace(ring(0), edges=(0,), places_m=((0.0, 3 * VEHICLE.pass_m),))
    position.place(inside, 1.0, 0.0, 0.0)
    assert may_wander_m(position) == left_m, "whatever has cut beside it before"


@pytest.mark.parametrize(("edge", "deg"), [(3, -2.0), (1, 0.0)])
def test_a_lane_far_inside_is_turned_as_the_last_along_its_edge(edge: int, deg: float) -> None:
    """Strips that were laid out otherwise lie between; of another edge nothing is known."""
    far = replace(ring(3), edges=(edge,), places_m=((0.0, 3 * VEHICLE.pass_m),))
    position = beside_an_askew_lane(2.0, far, straight=False)
    assert math.degrees(position.against_lane()[1]) == pytest.approx(deg, abs=0.3)


def test_a_lane_that_was_straightened_is_known_to_lie_so() -> None:
    beside = replace(ring(1), edges=(3,), places_m=((0.0, VEHICLE.pass_m),))
    copied, laid = (beside_an_askew_lane(2.0, beside, straight=s) for s in (False, True))
    assert laid.aside.slope > 0.0
    straighter = laid.against_lane()[1] - copied.against_lane()[1]
    assert straighter == pytest.approx(laid.aside.slope, rel=0.01)


def turned_by_courses(
    askew_deg: float, rounds: int, noise_rad: float, seed: int = 4
) -> list[float]:
    """By how much the position's yaw is off, rad, after each round along a side of 5 m whose strips
    are each cut so much more askew, while lane and dead reckoning say that all is straight. Before
    the first the courses of an outer edge have come."""
    rng = np.random.default_rng(seed)
    position, run_m, off = Position(VEHICLE), 0.0, []
    position.place(ring(0, 5.0), 0.0, 0.0, 0.0)
    for _ in range(100):
        position.course(rng.normal(0.0, noise_rad), 0.5)
    for k in range(rounds):
        true = math.radians(askew_deg * k)
        for _ in range(10):
            run_m += 0.5
            position.predict(motion(run_m), cutting=False)
            followed(position, 0.0, 0.03)
            position.course(true + rng.normal(0.0, noise_rad) - position.pose[2], 0.5)
        off.append(math.remainder(position.pose[2] - true, math.tau))
        back_m = run_m - 5.0
        run_m = back_m + VEHICLE.pass_m
        for way_m, yaw in ((back_m, 0.0), (back_m, 1.571), (run_m, 1.571), (run_m, 0.0)):
            position.predict(motion(way_m, yaw), cutting=False)
        position.begin(ring(k + 1, 5.0), straight=False)
    return off


def test_strips_that_turn_do_not_turn_the_position_with_them() -> None:
    """1.5 deg a round, which neither lane nor dead reckoning shows: over three fifths of the 16.5
    deg are found, and no more is lost than in the rounds before. The courses' noise alone turns it
    by little: of a dozen runs, on average."""
    seeds = range(12)
    askew = np.degrees(np.abs([turned_by_courses(1.5, 12, 0.12, seed) for seed in seeds]))
    assert askew[:, -1].mean() < 0.4 * 16.5
    assert (askew[:, -1] - askew[:, -4]).mean() < 0.6 * 3 * 1.5
    straight = np.degrees(np.abs([turned_by_courses(0.0, 12, 0.12, seed) for seed in seeds]))
    assert straight.max(axis=1).mean() < 1.6


def shuttled(sight_m: float, strips: int) -> tuple[Position, float]:
    """Strips of 10 m, one beside the other, cut by a machine that sees every edge sight_m left of
    its true place; and where its rear axle then truly is, left of the field's border."""
    position, run_m = Position(VEHICLE), 0.0
    position.place(ring(0), 0.0, 0.0, 0.0)

    def moved(run_m: float, yaw_rad: float = 0.0) -> None:
        by_gyro = replace(motion(run_m, yaw_rad), gyro_noise=math.radians(0.08))
        position.predict(by_gyro, cutting=False)

    for k in range(strips):
        for _ in range(20):
            run_m += 0.5
            moved(run_m)
            followed(position, 0.0, 0.03)
        back_m = run_m - 10.0
        run_m = back_m + VEHICLE.pass_m + sight_m
        moved(back_m)
        moved(back_m, math.pi / 2)
        moved(run_m, math.pi / 2)
        moved(run_m)
        position.begin(ring(k + 1), straight=False)
    return position, VEHICLE.inset_m + sight_m + strips * (VEHICLE.pass_m + sight_m)


@pytest.mark.parametrize("sight_m", [0.08, -0.08])
def test_a_machine_whose_strips_are_all_as_much_too_wide_knows_its_place_across_them(
    sight_m: float,
) -> None:
    """Were each strip's error another's, it would believe to know it to half of this."""
    position, true_m = shuttled(sight_m, 8)
    off_m, sigma_m = position.pose[1] - true_m, position.beside_sigma_m(ring(8))
    assert abs(off_m) > 0.3, "neither turns nor edges show it"
    assert abs(off_m) < 2.0 * sigma_m
    assert sight_m * position.x[SIGHT] > 0.0


def test_what_all_strips_err_alike_adds_up_and_is_no_error_of_its_own() -> None:
    (one, _), (eight, _) = shuttled(0.0, 1), shuttled(0.0, 8)
    assert eight.beside_sigma_m(ring(8)) > one.beside_sigma_m(ring(1)) + 0.15
    assert abs(eight.pose[1] - VEHICLE.inset_m - 8 * VEHICLE.pass_m) < 0.02


def test_a_walked_boundary_that_is_off_does_not_turn_the_machine_in_it() -> None:
    """All courses differ by the same from a plan that is as much turned."""
    position, run_m = Position(VEHICLE), 0.0
    position.place(ring(0, 20.0), 0.0, 0.0, 0.0)
    for _ in range(40):
        run_m += 0.5
        position.predict(motion(run_m), cutting=False)
        followed(position, 0.0, 0.03)
        position.course(math.radians(4.0) - position.pose[2], 0.5)
    assert math.degrees(position.pose[2]) == pytest.approx(0.0, abs=0.4)
    settled_at = position.pose[2]
    spun(position, math.radians(3.0), YAW_SIGMA_SHARE, motion(run_m))
    position.course(math.radians(4.0) - position.pose[2], 0.5)
    assert abs(math.degrees(position.pose[2] - settled_at)) < 0.15, "nothing new"


def test_the_less_sure_the_distance_the_more_an_end_places_the_machine() -> None:
    side = Side(0.0, 0.0, 0.0, 10.0, VEHICLE.pass_m, 10.0)
    moved = []
    for drift_m in (0.0, 0.3, 1.0):
        position = Position(VEHICLE)
        position.place(side, 9.5, 0.0, 0.0)
        before = position.pose
        position.at_end(side, 0.0, drift_m)
        moved.append(position.pose[0] - before[0])
        assert position.pose[1] == pytest.approx(before[1]), "it says nothing about the lane"
    assert 0.0 < moved[0] < 0.8 * moved[1]
    assert moved[1] < 0.9 * moved[2] < 0.5


@pytest.mark.parametrize("uphill", [0.015, -0.015])
def test_what_the_wheels_always_lose_and_what_they_lose_uphill_are_told_apart(
    uphill: float,
) -> None:
    """To and fro along a side between ends that are known: a slope takes from the one way what it
    gives to the other."""
    lost, length_m = 0.02, 20.0
    side = Side(0.0, 0.0, 0.0, length_m, VEHICLE.pass_m, length_m)
    position, missed, run_m = Position(VEHICLE), [], 0.0
    position.place(side, 0.0, 0.0, 0.0)
    for _ in range(4):
        for way in (1, -1):
            before = run_m
            for _ in range(round(length_m / STEP_M)):
                run_m += way * STEP_M / (1 - lost - way * uphill)
                position.predict(motion(run_m), cutting=False)
            there_m = length_m if way > 0 else 0.0
            missed.append(position.along(side) - there_m)
            sure_at(position, side, there_m)
            assert abs(run_m - before) > 0.9 * length_m
    assert abs(missed[0]) > 0.05
    assert max(abs(off_m) for off_m in missed[-2:]) < 0.06
    slope = position.x[[GRADE_X, GRADE_Y]]
    assert slope[0] == pytest.approx(uphill, abs=0.004) and abs(slope[1]) < 0.001
    assert position.x[SCALE] == pytest.approx(lost, abs=0.006)


def test_a_machine_that_has_rolled_knows_its_place_along_less() -> None:
    def sigma_m(*, rolls: bool) -> float:
        position = Position(VEHICLE)
        position.place(ring(0), 0.0, 0.0, 0.0)
        position.predict(motion(0.0), cutting=False)
        position.predict(replace(motion(0.2), rolls=rolls), cutting=False)
        return position.end_sigma_m(ring(0))

    assert sigma_m(rolls=True) > sigma_m(rolls=False) + 0.1


@pytest.mark.parametrize("rolled_m", [0.02, 0.2])
def test_one_roll_errs_as_a_share_of_how_far_it_has_gone(rolled_m: float) -> None:
    """Which way it rolls is unknown once, not anew with each pulse of the wheels' sensor."""
    variances = []
    for rolls in (0.0, rolled_m):
        position = Position(VEHICLE)
        position.place(ring(0), 0.0, 0.0, 0.0)
        for k in range(11):
            share = k / 10
            moved = replace(motion(share * rolled_m), rolls=rolls > 0.0, roll_doubt_m=share * rolls)
            position.predict(moved, cutting=False)
        variances.append(position.end_sigma_m(ring(0)) ** 2)
    assert math.sqrt(variances[1] - variances[0]) == pytest.approx(rolled_m, rel=0.1)


def test_where_bends_follow_each_other_what_is_still_to_turn_adds_up() -> None:
    """And is over with the strip."""
    machine, bend_rad = OnLane(VEHICLE), math.radians(10.0)
    at = machine.position.on_lane().blade_m
    decay = math.exp(-max(0.0, at) / VEHICLE.blade_x_m)
    machine.lane.bends(bend_rad)
    first = machine.lane.rounding_rad
    assert first == pytest.approx(2.0 * math.atan(decay * math.tan(bend_rad / 2)))
    machine.lane.bends(bend_rad)
    both = 2.0 * math.atan(decay * math.tan((first + bend_rad) / 2))
    assert machine.lane.rounding_rad == pytest.approx(both)
    machine.lane.begin()
    assert machine.lane.rounding_rad == 0.0


def test_how_sure_a_machine_is_where_it_will_have_backed_to() -> None:
    """As sure as it then is."""
    position = Position(VEHICLE)
    position.place(ring(0), 1.0, 0.0, 0.0)
    position.predict(motion(0.0), cutting=False)
    position.predict(motion(8.0), cutting=False)
    sure_at(position, ring(0), 9.0)
    position.predict(motion(8.0), cutting=False)
    ahead_of_time = position.end_sigma_m(ring(0), -1, 8.0)
    assert ahead_of_time > position.end_sigma_m(ring(0), -1) + 0.05
    position.predict(motion(0.0), cutting=False)
    assert position.end_sigma_m(ring(0), -1) == pytest.approx(ahead_of_time, rel=0.02)


def test_edges_that_are_seen_from_beside_at_one_place_count_as_one_that_errs_by_12_cm() -> None:
    def place_m(*, beside: bool) -> float:
        machine = OnLane(VEHICLE)
        machine.position.look(machine.position.on_lane().side, BESIDE if beside else None)
        for _ in range(20):
            machine.lane.correct(0.1, math.nan, 1.0, (0.0, 0.0))
        return abs(machine.lane.blade_offset_m)

    known_m = OnLane(VEHICLE).lane.offset_sigma_m
    as_one = 0.1 * known_m**2 / (known_m**2 + 0.12**2)
    assert place_m(beside=False) > 0.08
    assert place_m(beside=True) == pytest.approx(as_one, rel=0.03)


def test_an_edge_that_wheels_have_pressed_down_moves_a_machine_little() -> None:
    machine = OnLane(VEHICLE)
    machine.position.look(machine.position.on_lane().side, PRESSED)
    for _ in range(20):
        machine.lane.correct(0.1, math.nan, 1.0, (0.0, 0.0))
    assert abs(machine.lane.blade_offset_m) < 0.03


def test_how_surely_a_lane_is_known_from_beside_is_the_machines_place() -> None:
    machine = OnLane(VEHICLE)
    known_m = machine.lane.offset_sigma_m
    machine.position.look(machine.position.on_lane().side, BESIDE)
    assert machine.lane.offset_sigma_m == pytest.approx(known_m, abs=0.01)


def test_a_side_beside_a_lane_that_fell_behind_takes_more() -> None:
    position = Position(VEHICLE)
    position.place(ring(0), 2.0, 0.0, 0.0)
    sure_of(position, 0.01, 0.01, 0.001)
    for _ in range(20):
        followed(position, 0.3, 0.0)  # the machine is left of its edge: that lies outside
    position.begin(ring(1))
    assert -CATCH_UP_M <= position.aside.begin_m < -0.01


@pytest.mark.parametrize(
    ("left_m", "taken_m"), [(-0.3, 0.05), (-0.08, 0.02), (-0.05, 0.0), (0.3, 0)]
)
def test_strips_that_fall_behind_their_plan_catch_up(left_m: float, taken_m: float) -> None:
    caught = caught_up(Aside(0.02, 0.001), left_m, 0.06)
    assert caught.begin_m == pytest.approx(0.02 - taken_m)
    assert caught.slope == 0.001


def test_what_the_wheels_lose_while_cutting_is_learned_from_the_ends_of_sides() -> None:
    slip, length_m = 0.03, 20.0
    side = Side(0.0, 0.0, 0.0, length_m, VEHICLE.pass_m, length_m)
    missed = []
    position = Position(VEHICLE)
    position.place(side, 0.0, 0.0, 0.0)
    run_m = 0.0
    for _ in range(4):
        for _ in range(round(length_m / STEP_M)):
            run_m += STEP_M / (1 - slip)
            position.predict(motion(run_m), cutting=True)
            followed(position, 0.0, 0.0)
        missed.append(position.along(side) - length_m)
        position.at_end(side, 0.1)
        run_m -= length_m
        position.predict(motion(run_m), cutting=False)
    assert missed[0] > 0.3
    assert abs(missed[-1]) < 0.3 * missed[0]
    backed = position.along(side)
    position.predict(motion(run_m - 1.0), cutting=False)
    always = float(position.x[SCALE] - position.x[GRADE_X])
    assert abs(always) < 0.01
    assert position.along(side) == pytest.approx(backed - 1.0 + always), "nothing by pushing"


def test_a_lane_known_by_dead_reckoning_alone_does_not_make_the_position_sure() -> None:
    side = Side(0.0, 0.0, 0.0, 10.0, VEHICLE.pass_m, 10.0)
    sigmas = []
    for lane_sigma_m in (0.0, 0.3):
        position = Position(VEHICLE)
        position.place(side, 0.0, 0.0, 0.0)
        for k in range(6):
            position.predict(motion(0.5 * k), cutting=True)
            followed(position, 0.0, lane_sigma_m)
        sigmas.append(position.against_lane()[2])
    assert sigmas[0] < 0.04
    assert sigmas[1] > 2.0 * sigmas[0]


def test_an_end_seen_far_from_where_it_is_expected_counts_less() -> None:
    side = Side(0.0, 0.0, 0.0, 10.0, VEHICLE.pass_m, 10.0)
    moved = []
    for late_m in (0.2, 1.0):
        position = Position(VEHICLE)
        position.place(side, 9.9 + late_m, 0.0, 0.0)
        position.at_end(side, 0.0)
        moved.append(9.9 + late_m - position.along(side))
    assert moved[0] > 0.05
    assert moved[1] < 1.5 * moved[0], "five times as far, not five times the correction"


@pytest.mark.parametrize("seen_m", [0.0, 0.8])
def test_a_slanting_end_counts_where_it_is_seen_and_the_less_the_more_it_slants(
    seen_m: float,
) -> None:
    side = Side(0.0, 0.0, 0.0, 10.0, VEHICLE.pass_m, 10.0, begin_seen_m=seen_m, end_seen_m=seen_m)
    early_m = 0.1  # vision loses the last crop before its end
    ends_m = side.length_m - seen_m - early_m
    for told, blade_m in (("at_begin", seen_m), ("at_end", ends_m)):
        position = Position(VEHICLE)
        position.place(side, blade_m - seen_m, 0.0, 0.0)
        assert position.along(side) == pytest.approx(blade_m)
        getattr(position, told)(side, 0.0)
        assert position.along(side) == pytest.approx(blade_m), "it is where it was thought to be"
        getattr(position, told)(side, 0.4)
        moved = position.along(side) - blade_m
        assert 0.01 < moved < (0.03 if seen_m else 0.2)


def test_the_end_of_a_slanting_border_tells_less_of_the_place_along() -> None:
    """At corners of 135° and 145°: much less than by the doubt alone where across it was met, which
    would leave three quarters and three fifths."""
    moved = []
    for slope in (0.0, 1.0, 1.4):
        width_m = VEHICLE.pass_m
        side = Side(0.0, 0.0, 0.0, 10.0, width_m, 10.0, edge_end_m=slope * width_m)
        position = Position(VEHICLE)
        position.place(side, 9.7, 0.0, 0.0)
        position.at_end(side, 0.0)
        moved.append(position.along(side) - 9.7)
    assert moved[0] > 0.05
    assert moved[1] < 0.4 * moved[0]
    assert moved[2] < 0.6 * moved[1]


@pytest.mark.parametrize("told", ["at_begin", "at_end"])
def test_a_slanting_border_met_late_or_early_tells_of_the_place_across_too(told: str) -> None:
    """At a corner of 135° a machine 0.3 m right of its lane meets the crop 0.3 m later, and loses
    it as much earlier."""
    width_m, right_m, early_m = VEHICLE.pass_m, 0.3, 0.1
    side = Side(0.0, 0.0, 0.0, 10.0, width_m, 10.0, edge_begin_m=width_m, edge_end_m=width_m)
    met_m = right_m if told == "at_begin" else side.length_m - early_m - right_m
    for wrong_m in (0.0, 0.2):
        position = Position(VEHICLE)
        position.place(side, met_m, -right_m + wrong_m, 0.0)
        getattr(position, told)(side, 0.0)
        moved = position.at(side).across_m - (-right_m + wrong_m)
        assert moved == pytest.approx(0.0, abs=1e-6) if wrong_m == 0.0 else moved < -0.01
        if wrong_m == 0.0:
            assert position.along(side) == pytest.approx(met_m, abs=1e-6)


def test_an_edge_seen_farther_ahead_counts_less() -> None:
    """Its direction is not seen, and the crop's first corner is not its edge."""
    moved = []
    for ahead_m in (0.0, 0.5, 1.0):
        lane = settled().lane
        lane.place(0.0, 0.0, 0.12, math.radians(0.1))
        lane.correct(-0.1, math.nan, 0.9, (0.0, 0.0), ahead_m=ahead_m)
        moved.append(lane.offset_m)
    assert 0.07 < moved[0] < 0.1
    assert moved[1] < 0.85 * moved[0]
    assert moved[2] < 0.7 * moved[1]


def pictures_until_believed(lane: Lane, offset_m: float, most: int = 200) -> int:
    for k in range(most):
        if lane.correct(edge_at(offset_m, 0.0), 0.0, 0.9, (0.0, 0.0)):
            return k
    return most


def test_a_lane_that_a_turn_left_askew_yields_soon_and_a_sure_one_outlasts_a_patch() -> None:
    """At 10 pictures a second and 0.5 m/s: half a metre are 10 pictures, 1.5 m 30."""
    askew = settled().lane
    askew.place(0.0, 0.0, 0.12, math.radians(2.5))
    assert pictures_until_believed(askew, 0.45) <= 10
    assert 30 < pictures_until_believed(settled().lane, 0.3) < 200


def test_a_direction_that_is_not_known_moves_what_lies_before_the_axle() -> None:
    position = Position(VEHICLE)
    position.place(Side(0.0, 0.0, 0.0, 10.0, VEHICLE.pass_m, 10.0), 2.0, 0.1, 0.3)
    for k in range(40):
        position.predict(motion(STEP_M * k, 0.02 * k), cutting=True)
    x, y, yaw = position.pose
    reach = np.array([[0.0, 0.0], [1.5, 0.5], [-0.3, -0.4]])
    c, s = math.cos(yaw), math.sin(yaw)
    points = reach @ np.array([[c, s], [-s, c]]) + (x, y)
    rng = np.random.default_rng(1)
    poses = rng.multivariate_normal([x, y, yaw], position.covariance, 40_000)
    stated = position.borders.covariance_of(points)
    for point, found in zip(reach, stated, strict=True):
        cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        drawn = [
            poses[:, 0] + cos * point[0] - sin * point[1],
            poses[:, 1] + sin * point[0] + cos * point[1],
        ]
        assert found == pytest.approx(np.cov(drawn), rel=0.05, abs=1e-4)
    assert stated[0] == pytest.approx(position.covariance[:2, :2])


@pytest.mark.parametrize("turn_deg", [-40.0, -5.0, 12.0, 22.0])
@pytest.mark.parametrize(("offset_m", "heading_deg"), [(0.0, 0.0), (0.2, -6.0), (-0.1, 4.0)])
def test_at_a_bend_the_machine_stands_where_it_stood_against_the_line_beyond(
    turn_deg: float, offset_m: float, heading_deg: float
) -> None:
    """The old line along x, the bend 1.4 m ahead of the axle at the origin's abscissa."""
    turn, heading = math.radians(turn_deg), math.radians(heading_deg)
    machine = OnLane(VEHICLE)
    lane, position = machine.lane, machine.position
    position.place(ring(0), VEHICLE.blade_x_m, offset_m, heading)
    beyond = Side(1.4, 0.0, turn, 10.0, VEHICLE.pass_m, 10.0)
    position.begin(beyond, straight=False)
    # How far the axle lies left of the edge through (1.4, 0) in direction `turn`, and of its lane.
    inside_m = VEHICLE.inset_m + offset_m
    left_m = 1.4 * math.sin(turn) + inside_m * math.cos(turn) - VEHICLE.inset_m
    assert lane.offset_m == pytest.approx(left_m)
    assert lane.heading_rad == pytest.approx(heading - turn)


@pytest.mark.parametrize(("inside_m", "another"), [(4.0, True), (0.0, False)])
def test_an_edge_of_another_strip_leads_the_machine_and_leaves_its_place_doubtful(
    inside_m: float, another: bool
) -> None:
    """Two metres beside where the lane was surely believed. Beside the boundary there is no other
    edge: there the place was wrong."""
    side = Side(0.0, 0.0, 0.0, 20.0, VEHICLE.pass_m, 20.0, places_m=((0.0, inside_m),))
    position = Position(VEHICLE)
    position.place(side, 5.0, 0.0, 0.0)
    sure_of(position, 0.1, 0.1, 0.02)
    position.begin(side)
    lane, y_m = Lane(position, VEHICLE.blade_x_m), position.pose[1]
    pictures = 0
    while not lane.correct(-2.0, 0.0, 0.9, (0.0, 0.0), cutting=False):
        pictures += 1
        assert pictures < 200
    for _ in range(10):
        lane.correct(-2.0, 0.0, 0.9, (0.0, 0.0), cutting=False)
    assert pictures > 5
    assert lane.blade_offset_m == pytest.approx(2.0, abs=0.2)
    assert (abs(position.pose[1] - y_m) < 0.3) is another
    assert (float(position.covariance[1, 1]) > 0.45**2) is another


def test_who_stands_farther_along_an_edge_that_bends_stands_turned() -> None:
    """A metre along an edge of 20 m radius: 0.05 rad."""
    position = Position(VEHICLE)
    position.place(ring(0), 0.0, 0.0, 0.0, (1.0, 0.1, 0.01), bend_1pm=0.05)
    c, s = math.cos(ring(0).heading_rad), math.sin(ring(0).heading_rad)
    along = np.zeros(len(position.x))
    along[:2] = c, s
    yaw = np.eye(len(position.x))[YAW]
    assert position.sigma(along) == pytest.approx(1.0, rel=0.01)
    assert position.sigma(yaw) == pytest.approx(math.hypot(0.05, 0.01), rel=0.01)
    assert position.sigma(yaw - 0.05 * along) == pytest.approx(0.01, rel=0.02), "against the edge"
