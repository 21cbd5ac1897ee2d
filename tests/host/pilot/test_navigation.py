"""Plan, manoeuvre, odometry and lane as facts."""

from __future__ import annotations

import itertools
import math

import hypothesis.strategies as st
import pytest
import shapely
from hypothesis import given, settings

from host.core.errors import UserError
from host.core.messages import Fix, State, Telemetry
from host.core.vehicle import Vehicle
from host.estimate.odometry import Motion, Odometry
from host.route import turn_legs
from host.route.plan import KEEP_OUT_M, Plan, spiral
from host.route.side import Side
from host.route.turn_legs import Follow, Goal
from tests.helpers.places import OnLane

VEHICLE = Vehicle(overlap_m=0.05)
"""A pass takes 0.95 m."""


def telemetry(t: float, *, angle: float = 0.0, duty: int = 0, speed: float | None = None,
              distance: float = 0.0) -> Telemetry:  # fmt: skip
    return Telemetry(t, State.RUNNING, 0, angle, angle, 0, duty, False, speed, distance, 12.0, 0, 0)


# ---- plan ----------------------------------------------------------------------------------------


@st.composite
def convex_fields(draw: st.DrawFn) -> list[tuple[float, float]]:
    count = draw(st.integers(3, 8))
    angles = sorted(draw(st.lists(st.floats(0, 6.28), min_size=count, max_size=count, unique=True)))
    a, b = draw(st.floats(4, 15)), draw(st.floats(4, 15))
    hull = shapely.MultiPoint([(a * math.cos(t), b * math.sin(t)) for t in angles]).convex_hull
    if hull.geom_type != "Polygon" or hull.area < 10:
        return [(0.0, 0.0), (a, 0.0), (a, b), (0.0, b)]
    return list(shapely.geometry.polygon.orient(hull).exterior.coords)[:-1]


@settings(max_examples=40)
@given(convex_fields(), st.integers(0, 7))
def test_the_strips_cover_the_field_and_every_corner_is_a_left_turn_of_less_than_half_a_circle(
    field: list[tuple[float, float]], start: int
) -> None:
    width = VEHICLE.pass_m
    plan = spiral(field, start, VEHICLE)
    whole = left = shapely.Polygon(field)
    for side in plan.sides:
        edge = shapely.LineString(side.edge_line())
        strip = edge.buffer(width, single_sided=True, join_style="mitre")
        left = left.difference(strip.buffer(1e-6))
    # Slivers below what a side is planned for, and outlines simplified by a centimetre.
    assert left.area < 0.02 * len(field) + 0.01 * whole.length
    turns = [plan.corner_rad(k) for k in range(len(plan.sides) - 1)]
    assert all(0 <= turn < math.pi + 1e-6 for turn in turns)


@pytest.mark.parametrize("rounding", [0.0, 3e-16, -3e-16, 1e-9, -1e-9])
def test_the_same_edge_again_is_no_corner_however_it_was_rounded(rounding: float) -> None:
    for heading in (0.0, 1.0, math.pi / 2, -3.0):
        first = Side(0.0, 0.0, heading, 9.0, 0.9, 9.0)
        second = Side(0.0, 0.9, heading + rounding, 9.0, 0.9, 9.0)
        assert Plan((first, second)).corner_rad(0) == 0.0


def test_a_square_of_ten_metres_takes_21_sides() -> None:
    plan = spiral([(0, 0), (10, 0), (10, 10), (0, 10)], 1, VEHICLE)
    assert len(plan.sides) == 21
    assert plan.sides[0].length_m == pytest.approx(10.0, abs=1e-3)
    assert plan.sides[4].length_m == pytest.approx(8.1, abs=1e-3)


def test_every_side_knows_how_far_the_boundary_is() -> None:
    plan = spiral([(0, 0), (10, 0), (10, 10), (0, 10)], 1, VEHICLE)
    assert plan.sides[0].fence_m == pytest.approx(10.0, abs=1e-3)
    assert plan.sides[3].fence_m == pytest.approx(9.05, abs=1e-3)
    assert plan.sides[4].fence_m == pytest.approx(9.05, abs=1e-3)
    assert plan.sides[5].length_m == pytest.approx(7.15, abs=1e-3)
    assert plan.sides[5].fence_m == pytest.approx(8.1, abs=1e-3)


def test_orientation_of_the_boundary_does_not_matter() -> None:
    corners = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
    assert len(spiral(corners, 0, VEHICLE).sides) == len(spiral(corners[::-1], 0, VEHICLE).sides)


@pytest.mark.parametrize(
    ("corners", "word"),
    [
        ([(0, 0), (10, 10), (10, 0), (0, 10)], "cross"),
        ([(0, 0), (10, 0), (10, 0), (0, 0)], "cross"),
    ],
)
def test_a_boundary_that_cannot_be_planned_is_refused(
    corners: list[tuple[float, float]], word: str
) -> None:
    with pytest.raises(UserError, match=word):
        spiral(corners, 0, VEHICLE)


# ---- manoeuvre -----------------------------------------------------------------------------------


def drive_legs(turn: turn_legs.Turn) -> tuple[float, float, float]:
    """Ideal execution of a turn's legs from the plan's origin."""
    x = y = heading = 0.0
    ds = 0.0005
    for leg in turn.legs:
        sign = -1.0 if leg.reverse else 1.0
        held = leg.follow is Follow.NOTHING
        curvature = 0.0 if not held else math.tan(leg.steer_rad) / VEHICLE.wheelbase_m
        for _ in range(40000):
            reached = {Goal.X: x, Goal.HEADING: heading, Goal.ALONG: turn.along(x, y)}[leg.goal]
            growing = leg.goal is Goal.HEADING or not leg.reverse
            if (reached >= leg.value) if growing else (reached <= leg.value):
                break
            x += sign * ds * math.cos(heading)
            y += sign * ds * math.sin(heading)
            heading += sign * ds * curvature
    return x, y, heading


@given(st.floats(math.radians(60), math.radians(120)))
def test_both_turns_end_on_the_new_lane(corner: float) -> None:
    for plan in (turn_legs.arc, turn_legs.three_point):
        turn = plan(VEHICLE, corner, turn_legs.lane_beside(VEHICLE, corner))
        x, y, heading = drive_legs(turn)
        assert heading == pytest.approx(corner, abs=2e-3)
        assert turn.offset(x, y) == pytest.approx(0.0, abs=5e-3)


def test_the_three_point_turn_ends_before_the_crop_the_arc_beyond_its_beginning() -> None:
    lane = turn_legs.lane_beside(VEHICLE, math.pi / 2)
    square = turn_legs.three_point(VEHICLE, math.pi / 2, lane)
    x, y, _ = drive_legs(square)
    assert square.along(x, y) + VEHICLE.blade_x_m < square.crop_begins_m - 0.3
    arc = turn_legs.arc(VEHICLE, math.pi / 2, lane)
    x, y, _ = drive_legs(arc)
    assert arc.along(x, y) + VEHICLE.blade_x_m > arc.crop_begins_m + 1.0


# ---- odometry ------------------------------------------------------------------------------------


def test_a_hall_sensors_distance_is_believed_over_the_duty() -> None:
    odometry = Odometry(VEHICLE)
    for k in range(51):
        odometry.update(telemetry(k * 0.02, duty=255, speed=0.25, distance=0.25 * k * 0.02))
    assert odometry.now.distance_m == pytest.approx(0.25, abs=0.01)


def test_without_one_what_the_duty_gives_is_learned_from_the_doppler_speed() -> None:
    odometry = Odometry(VEHICLE)
    duty = round(0.5 * 255)
    model = VEHICLE.duty_speed(duty, 12.0)
    for k in range(1, 60 * 50):
        odometry.update(telemetry(k * 0.02, duty=duty))
        if k % 50 == 0:
            fix = Fix(k * 0.02, 31.5, 74.3, 1, 1.0, 8, 0.9 * model)
            odometry.learn(fix, telemetry(k * 0.02, duty=duty), 1.0)
    assert odometry.now.speed_mps == pytest.approx(0.9 * model, rel=0.01)


def test_the_circle_closes() -> None:
    odometry = Odometry(VEHICLE)
    angle = math.radians(30)
    lap = 2 * math.pi * VEHICLE.wheelbase_m / math.tan(angle)
    steps = 2000
    for k in range(steps + 1):
        odometry.update(
            telemetry(k * 0.02, angle=angle, speed=lap / steps / 0.02, distance=lap * k / steps)
        )
    motion = odometry.now
    assert motion.yaw_rad == pytest.approx(2 * math.pi, rel=1e-6)
    assert math.hypot(motion.x_m, motion.y_m) < 0.01


def test_telemetry_that_repeats_or_goes_back_moves_nothing() -> None:
    odometry = Odometry(VEHICLE)
    odometry.update(telemetry(0.0, duty=255))
    odometry.update(telemetry(1.0, duty=255))
    before = odometry.now
    odometry.update(telemetry(1.0, duty=255))
    odometry.update(telemetry(0.5, duty=255))
    assert odometry.now == before


# ---- lane ----------------------------------------------------------------------------------------


@given(st.floats(-0.15, 0.15), st.floats(-0.12, 0.12))
def test_the_lane_filter_finds_where_the_vehicle_stands(offset: float, heading: float) -> None:
    lane = OnLane(VEHICLE).lane
    edge = -(offset + VEHICLE.blade_x_m * math.sin(heading)) / math.cos(heading)
    for _ in range(40):
        assert lane.correct(edge, -heading, 1.0, (0.0, 0.0))
    assert lane.offset_m == pytest.approx(offset, abs=0.01)
    assert lane.heading_rad == pytest.approx(heading, abs=0.01)


def test_one_wild_measurement_is_refused() -> None:
    lane = OnLane(VEHICLE).lane
    for _ in range(20):
        lane.correct(0.0, 0.0, 1.0, (0.0, 0.0))
    assert not lane.correct(0.8, 0.5, 1.0, (0.0, 0.0))
    assert abs(lane.offset_m) < 0.01


def test_contradiction_that_lasts_raises_the_uncertainty_before_it_is_believed() -> None:
    lane = OnLane(VEHICLE).lane
    for _ in range(20):
        lane.correct(0.0, 0.0, 1.0, (0.0, 0.0))
    worst = 0.0
    for _ in range(100):
        if lane.correct(0.6, 0.0, 1.0, (0.0, 0.0)):
            break
        worst = max(worst, lane.offset_sigma_m)
    assert worst > 0.15
    assert lane.blade_offset_m < -0.3


def test_however_long_pictures_contradict_the_lane_they_turn_no_machine_round() -> None:
    """Edges of other strips, now here and now there, had turned one by 40 degrees against its
    gyroscope (model field 10215)."""
    machine = OnLane(VEHICLE)
    for _ in range(20):
        machine.lane.correct(0.0, 0.0, 1.0, (0.0, 0.0))
    for k in range(400):
        assert not machine.lane.correct((4.0, -4.0)[k % 2] * 1.05**k, math.nan, 1.0, (0.0, 0.0))
    assert math.sqrt(machine.position.covariance[2, 2]) < math.radians(8.0)
    assert math.sqrt(machine.position.covariance[1, 1]) > 1.0, "of its place it knows no more"


L_SHAPE = [(0.0, 0.0), (10.0, 0.0), (10.0, 5.0), (5.0, 5.0), (5.0, 10.0), (0.0, 10.0)]


def test_every_side_of_an_l_shape_begins_where_the_last_one_can_reach() -> None:
    plan = spiral(L_SHAPE, 0, VEHICLE)
    assert plan.leftover_m2 < 0.1
    for k, (this, then) in enumerate(itertools.pairwise(plan.sides)):
        if plan.corner_rad(k) == 0.0:
            continue
        end_x = this.x_m + this.length_m * math.cos(this.heading_rad)
        end_y = this.y_m + this.length_m * math.sin(this.heading_rad)
        assert math.hypot(then.x_m - end_x, then.y_m - end_y) < 3.0


@pytest.mark.parametrize("start", range(len(L_SHAPE)))
def test_of_two_ways_to_cut_an_l_shape_the_plan_takes_the_one_with_room_to_shuttle(
    start: int,
) -> None:
    plan = spiral(L_SHAPE, start, VEHICLE, gap_m=2.0)
    again = [plan.sides[k + 1] for k in range(len(plan.sides) - 1) if plan.corner_rad(k) == 0.0]
    assert again
    least = turn_legs.shuttle_length(VEHICLE, VEHICLE.pass_m, 0.0)
    for side in again:
        assert turn_legs.shuttle_room_m(VEHICLE, side.back_m, plan.gap_m) >= least


def test_strips_end_where_a_reflex_corner_begins() -> None:
    plan = spiral(L_SHAPE, 1, VEHICLE, gap_m=2.0)
    north = [s for s in plan.sides if s.heading_rad == pytest.approx(math.pi / 2)]
    assert any(side.x_m - side.width_m == pytest.approx(5.0, abs=0.02) for side in north)


def test_strips_stay_off_a_keep_out() -> None:
    hole = [(4.0, 4.0), (5.0, 4.0), (5.0, 5.0), (4.0, 5.0)]
    plan = spiral([(0, 0), (10, 0), (10, 10), (0, 10)], 1, VEHICLE, keep_outs=[hole])
    for side in plan.sides:
        c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
        w = side.width_m
        corners = [(0, 0), (side.length_m, 0), (side.length_m, w), (0, w)]
        strip = [(side.x_m + c * u - s * v, side.y_m + s * u + c * v) for u, v in corners]
        assert shapely.Polygon(strip).distance(shapely.Polygon(hole)) > 0.6


@pytest.mark.parametrize(("x", "y"), [(3.6, 7.0), (9.0, 4.2), (11.4, 9.5), (7.1, 6.6)])
def test_a_keep_out_anywhere_leaves_little_standing(x: float, y: float) -> None:
    """Far edges give more strips a round, so that all reach the keep-out together."""
    field = [(0.0, 0.0), (15.0, 0.0), (15.0, 13.0), (0.0, 13.0)]
    hole = [(x, y), (x + 0.8, y), (x + 0.8, y + 0.8), (x, y + 0.8)]
    plan = spiral(field, 0, Vehicle(), gap_m=2.0, keep_outs=[hole])
    standing = shapely.Polygon(field).difference(shapely.Polygon(hole))
    for side in plan.sides:
        c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
        w = side.width_m
        corners = [(0, 0), (side.length_m, 0), (side.length_m, w), (0, w)]
        strip = [(side.x_m + c * u - s * v, side.y_m + s * u + c * v) for u, v in corners]
        standing = standing.difference(shapely.Polygon(strip))
    around = shapely.Polygon(hole).buffer(KEEP_OUT_M, join_style="mitre").area - 0.64
    assert standing.area < around + 1.0
    assert plan.leftover_m2 == pytest.approx(standing.area - around, abs=0.1)


@pytest.mark.parametrize("learn", [False, True])
def test_the_bias_is_learned_only_where_it_may_be(learn: bool) -> None:
    """The vehicle bends to the left by 0.01 a metre, which the pot does not show."""
    machine = OnLane(VEHICLE)
    lane = machine.lane
    lane.place(0.0, 0.0, 0.01, 0.01)
    bend = 0.01
    for k in range(200):
        run = 0.05 * k
        machine.predict(Motion(0.0, 0.5, 0.0, run, 0.0, run, 0.0))
        offset, heading = bend * run**2 / 2, bend * run
        edge = -(offset + VEHICLE.blade_x_m * math.sin(heading)) / math.cos(heading)
        assert lane.correct(edge, -heading, 1.0, (0.0, 0.0), learn=learn)
    bias = machine.position.take_curve()
    assert bias == (pytest.approx(bend, abs=0.003) if learn else 0.0)
    assert machine.position.take_curve() == 0.0
