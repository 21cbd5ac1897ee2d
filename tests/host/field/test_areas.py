"""Facts about the three areas and the geofence."""

from __future__ import annotations

import math
import timeit

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from host.core.errors import UserError
from host.core.vehicle import Vehicle
from host.field import sweep
from host.field.areas import GAP_MARGIN_M, Geofence, Level, areas_of, outline_of, placed

GAP_M = 2.0
WELL = shapely.box(12, 12, 13, 13)
FIELD = shapely.Polygon(shapely.box(0, 0, 20, 20).exterior.coords, [WELL.exterior.coords])
AREAS = areas_of(FIELD, GAP_M)
FENCE = Geofence(AREAS)
OUTLINE = outline_of(Vehicle())
CERTAIN = np.zeros((2, 2))


def test_wheels_may_go_up_to_the_neighbours_crop_less_a_margin() -> None:
    reach = GAP_M - GAP_MARGIN_M
    assert AREAS.permitted.equals(shapely.box(-reach, -reach, 20 + reach, 20 + reach))


L_SHAPE = ((0.0, 0.0), (20.0, 0.0), (20.0, 8.0), (9.0, 8.0), (9.0, 15.0), (0.0, 15.0))


def test_at_a_corner_what_stands_nearer_beyond_one_edge_counts_past_its_end() -> None:
    permitted = areas_of(shapely.Polygon(L_SHAPE), GAP_M, nearer={1: 0.5}).permitted
    assert permitted is not None
    room_m = 0.5 - GAP_MARGIN_M
    for x, may in ((20.0 + room_m - 0.01, True), (20.0 + room_m + 0.01, False)):
        assert permitted.contains(shapely.Point(x, -1.0)) is may


def test_past_an_edge_that_ends_at_an_inner_corner_lies_the_field() -> None:
    permitted = areas_of(shapely.Polygon(L_SHAPE), GAP_M, nearer={2: 0.5}).permitted
    assert permitted is not None
    assert permitted.contains(shapely.Polygon(L_SHAPE))


@pytest.mark.parametrize("turned", [1, -1])
@given(
    edge=st.integers(0, 5), nearer_m=st.floats(0.0, 1.5), x=st.floats(-4, 24), y=st.floats(-4, 19)
)
def test_beyond_one_edge_the_machine_may_go_no_farther_than_to_what_stands_nearer(
    turned: int, edge: int, nearer_m: float, x: float, y: float
) -> None:
    field, at = shapely.Polygon(L_SHAPE[::turned]), shapely.Point(x, y)
    ring = shapely.get_coordinates(field.exterior)
    areas, as_said = (areas_of(field, GAP_M, nearer=n) for n in ({edge: nearer_m}, {}))
    assert areas.permitted is not None and as_said.permitted is not None
    assert areas.permitted.is_valid
    may, could = areas.permitted.contains(at), as_said.permitted.contains(at)
    assert could or not may
    assert may or not field.contains(at), "wherever the field is"
    off = [shapely.LineString(ring[k : k + 2]).distance(at) for k in range(6)]
    others = [off[(edge + k) % 6] for k in (2, 3, 4)]
    beside = min(off[(edge + k) % 6] for k in (-1, 1))
    if could and not field.contains(at) and off[edge] < min(beside, *others):
        assert may is (off[edge] < nearer_m - GAP_MARGIN_M)
    if could and min(others) < min(off[edge], beside):
        assert may, "the other edges keep their room"


def test_the_price_is_the_share_that_stays_standing() -> None:
    plain = shapely.box(0, 0, 20, 10)
    assert areas_of(plain, GAP_M).price == 0.0
    inset = areas_of(plain, GAP_M, inset_m=0.5)
    assert inset.price == pytest.approx(1 - 19 * 9 / 200)
    assert AREAS.price == pytest.approx((1.6**2 - 1) / (400 - 1)), "the margin of the well"


def test_an_inset_changes_what_is_cut_and_not_where_wheels_may_go() -> None:
    assert areas_of(FIELD, GAP_M, inset_m=1.0).permitted.equals(AREAS.permitted)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"inset_m": 10.0}, "nothing is left to cut"),
        ({"inset_m": -1.0}, "inset is -1 m"),
        ({"inset_m": math.nan}, "inset is nan m"),
        ({"gap_m": 0.1}, "no room for the machine's wheels"),
    ],
)
def test_areas_that_cannot_be_are_one_message(change: dict[str, float], message: str) -> None:
    with pytest.raises(UserError, match=message):
        areas_of(FIELD, **{"gap_m": GAP_M, **change})


def test_an_inset_that_parts_the_crop_is_refused() -> None:
    waisted = shapely.union_all(
        [shapely.box(0, 0, 10, 10), shapely.box(10, 4.5, 20, 5.5), shapely.box(20, 0, 30, 10)]
    )
    with pytest.raises(UserError, match="part the crop into 2 pieces"):
        areas_of(waisted, GAP_M, inset_m=0.6)


def test_keep_outs_are_named_where_no_inset_was_asked_for() -> None:
    field = shapely.box(0, 0, 20, 10)
    most = field.difference(shapely.box(0.2, 0.2, 19.8, 9.8))
    with pytest.raises(UserError, match=r"^with the keep-outs .* nothing is left to cut; correct"):
        areas_of(most, GAP_M)
    middle = field.difference(shapely.box(9, 0.1, 11, 9.9))
    with pytest.raises(UserError, match=r"^the keep-outs .* part the crop into 2 pieces; survey"):
        areas_of(middle, GAP_M)


def test_the_outline_holds_the_blade_and_the_body() -> None:
    vehicle = Vehicle()
    assert OUTLINE.max(0) == pytest.approx([vehicle.blade_x_m + 0.05, vehicle.blade_width_m / 2])
    assert OUTLINE.min(0) == pytest.approx([-vehicle.rear_overhang_m, -vehicle.blade_width_m / 2])
    assert shapely.LinearRing(OUTLINE).is_ccw


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-7, 7))
def test_placing_turns_then_shifts(x: float, y: float, heading: float) -> None:
    tip = placed(np.array([[2.0, 0.0], [0.0, 1.0]]), x, y, heading)
    assert tip[0] == pytest.approx([x + 2 * math.cos(heading), y + 2 * math.sin(heading)])
    assert tip[1] == pytest.approx([x - math.sin(heading), y + math.cos(heading)])


# ---- the geofence --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("x", "speed", "level"),
    [
        (10.0, 0.5, Level.CLEAR),
        (20.0, 0.0, Level.CLEAR),
        (20.2, 0.0, Level.SLOW),
        (19.5, 0.5, Level.SLOW),
        (20.1, 0.5, Level.STOP),
        (19.5, 5.0, Level.STOP),
        (20.3, 0.0, Level.STOP),
        (25.0, 0.0, Level.STOP),
    ],
)
def test_the_border_slows_and_then_stops(x: float, speed: float, level: Level) -> None:
    """The blade's front is 1.55 m ahead of the rear axle, the border at 21.8 m."""
    verdict = FENCE.check(placed(OUTLINE, x, 3.0, 0.0), CERTAIN, (speed, 0.0))
    assert verdict.level is level
    if level is not Level.CLEAR:
        assert verdict.clearance_m == pytest.approx(21.8 - 1.55 - x)
        assert "the permitted area's border" in verdict.reason


def test_travel_counts_in_every_direction() -> None:
    outline = placed(OUTLINE, 3.0, 20.1, math.pi / 2)
    assert FENCE.check(outline, CERTAIN, (0.0, 0.5)).level is Level.STOP
    assert FENCE.check(outline, CERTAIN, (0.5, 0.0)).level is Level.SLOW


@pytest.mark.parametrize(
    ("steer", "level"), [(0.0, Level.CLEAR), (0.6, Level.STOP), (-0.6, Level.CLEAR)]
)
def test_a_blade_that_swings_out_on_the_lock_counts(steer: float, level: Level) -> None:
    """Beside the border, along it: the axle stays away from it, the blade's end does not."""
    outline = placed(OUTLINE, 10.0, 20.8, 0.0)
    verdict = FENCE.check(outline, CERTAIN, (0.8, 0.0), 0.8 * math.tan(steer), (10.0, 20.8))
    assert verdict.level is level


@pytest.mark.parametrize("way_deg", [0.0, 22.5, 67.5])
def test_two_standard_deviations_count_in_every_direction(way_deg: float) -> None:
    way = math.radians(way_deg)
    field = shapely.affinity.rotate(shapely.box(-10, -10, 10, 10), way_deg, (0, 0))
    fence = Geofence(areas_of(field, GAP_M))
    speck = np.array([(0.0, 0.0), (1e-3, 0.0), (0.0, 1e-3)])
    reach = 10 + GAP_M - GAP_MARGIN_M - 0.39
    spread = 0.2**2 * np.eye(2)
    at = (reach * math.cos(way), reach * math.sin(way))
    assert fence.check(speck + np.array(at), spread).level is Level.STOP


def test_a_keep_out_stops_and_is_named() -> None:
    verdict = FENCE.check(placed(OUTLINE, 11.0, 12.5, 0.0), CERTAIN)
    assert verdict.level is Level.STOP
    assert verdict.clearance_m < 0
    assert "beyond keep-out 1" in verdict.reason
    assert verdict.at_keep_out
    border = FENCE.check(placed(OUTLINE, 50.0, 12.5, 0.0), CERTAIN)
    assert (border.level, border.at_keep_out) == (Level.STOP, False)
    before = FENCE.check(placed(OUTLINE, 10.0, 12.5, 0.0), CERTAIN)
    assert before.level is Level.SLOW
    assert before.clearance_m == pytest.approx(12 - 0.3 - 11.55)


@pytest.mark.parametrize("heading_deg", [0, 90, 180, 270])
def test_what_it_would_drive_into_slows_it_from_every_side(heading_deg: float) -> None:
    heading = math.radians(heading_deg)
    c, s = math.cos(heading), math.sin(heading)
    away = 0.5 + 0.5 + 0.3 + 1.55  # free way, half the well, its margin, the blade before the axle
    outline = placed(OUTLINE, 12.5 - away * c, 12.5 - away * s, heading)
    levels = [FENCE.check(outline, CERTAIN, (v * c, v * s)).level for v in (0.5, 0.0, -0.5)]
    assert levels == [Level.SLOW, Level.CLEAR, Level.CLEAR]


def test_without_a_position_it_stops() -> None:
    for bad in (math.nan, math.inf):
        verdict = FENCE.check(placed(OUTLINE, 5, 5, 0), np.diag([bad, 1.0]))
        assert verdict.level is Level.STOP
        assert verdict.reason == "the position is unknown"


def covariance(along: float, across: float, way: float) -> NDArray[np.float64]:
    axes = np.array([[math.cos(way), -math.sin(way)], [math.sin(way), math.cos(way)]])
    found: NDArray[np.float64] = axes @ np.diag([along**2, across**2]) @ axes.T
    return found


def test_a_corner_counts_with_its_own_uncertainty() -> None:
    """The blade's, before the machine, and not the tail's."""
    outline = placed(OUTLINE, 10.0, 19.9, math.pi / 2)
    clearance = FENCE.clearance(outline)
    assert 0.2 < clearance < 0.5
    before = outline[:, 1] > 21.0

    def level(unsure: NDArray[np.bool_]) -> Level:
        variance = np.where(unsure, (clearance / 1.9) ** 2, 0.0)
        return FENCE.check(outline, variance[:, None, None] * np.eye(2)).level

    assert level(before) is Level.STOP
    assert level(~before) is FENCE.check(outline, CERTAIN).level < Level.STOP


places = st.tuples(st.floats(-4, 24), st.floats(-4, 24), st.floats(-4, 4))
spreads = st.tuples(st.floats(0, 1.5), st.floats(0, 1.5), st.floats(-4, 4))
velocities = st.tuples(st.floats(-1, 1), st.floats(-1, 1))


@given(
    places, spreads, st.floats(-1, 1), st.floats(-0.7, 0.7), st.floats(0, math.tau), st.floats(0, 1)
)
def test_not_stopped_means_inside_wherever_the_machine_may_really_be(
    place: tuple[float, float, float],
    spread: tuple[float, float, float],
    speed: float,
    steer: float,
    way: float,
    share: float,
) -> None:
    """Within two standard deviations in any direction, now and until it would stand, also on the
    lock, where the blade swings out: to 3 cm, by which the blade's arc is higher than its chord."""
    along, across, axis = spread
    x, y, yaw = place
    outline = placed(OUTLINE, *place)
    velocity, rate = (speed * math.cos(yaw), speed * math.sin(yaw)), speed * math.tan(steer)
    verdict = FENCE.check(outline, covariance(*spread), velocity, rate, (x, y))
    if verdict.level is Level.STOP:
        return
    u, v = 2 * along * math.cos(way), 2 * across * math.sin(way)
    error = (
        u * math.cos(axis) - v * math.sin(axis),
        u * math.sin(axis) + v * math.cos(axis),
    )
    turned = rate * 0.6 * share
    chord = speed * 0.6 * share * (math.sin(turned / 2) / (turned / 2) if turned else 1.0)
    x, y = x + chord * math.cos(yaw + turned / 2), y + chord * math.sin(yaw + turned / 2)
    there = placed(OUTLINE, x, y, yaw + turned) + np.array(error) * (1 - 1e-6)
    truth = shapely.Polygon(there).buffer(-0.03)
    assert AREAS.permitted.contains(truth)
    assert not AREAS.keep_outs[0].intersects(truth)


@given(places, spreads, velocities, st.floats(1, 3))
def test_knowing_less_never_permits_more(
    place: tuple[float, float, float],
    spread: tuple[float, float, float],
    velocity: tuple[float, float],
    factor: float,
) -> None:
    outline, known = placed(OUTLINE, *place), covariance(*spread)
    less = FENCE.check(outline, known * factor**2 + 1e-9 * np.eye(2), velocity).level
    assert less >= FENCE.check(outline, known, velocity).level


def test_it_says_what_shapely_says_of_the_same_shapes() -> None:
    """About the border and a well, by polygons of many corners
    instead of octagons: the sweep holds them, and is but a little larger."""
    rng = np.random.default_rng(3)
    permitted = AREAS.permitted
    assert permitted is not None
    circle = np.array([(math.cos(a), math.sin(a)) for a in np.linspace(0, math.tau, 65)[:-1]])
    levels = []
    for _ in range(1500):
        ring = (permitted.exterior, AREAS.keep_outs[0].exterior)[int(rng.integers(2))]
        at = ring.interpolate(rng.uniform(0, ring.length))
        place = (at.x + rng.normal(0, 1.8), at.y + rng.normal(0, 1.8), rng.uniform(-4, 4))
        outline, known = placed(OUTLINE, *place), covariance(*rng.uniform(0.0, 0.4, 3))
        velocity = rng.normal(0, 0.4, 2)
        verdict = FENCE.check(outline, known, (velocity[0], velocity[1]))
        values, vectors = np.linalg.eigh(known)
        ellipse = circle @ (vectors * np.sqrt(np.maximum(values, 0.0)) * 2.0 @ vectors.T)
        free = []
        for grown, more_m, ahead_s in ((1.0, 0.15, 2.0), (1.1, 0.17, 2.0), (1.0, 0.0, 0.6),
                                       (1.1, 0.0, 0.6)):  # fmt: skip
            around = grown * ellipse + more_m * circle
            swept = (outline[:, None] + around).reshape(-1, 2)
            swept = np.concatenate([swept, swept + velocity * ahead_s])
            hull = shapely.MultiPoint(swept).convex_hull
            free.append(
                permitted.contains_properly(hull) and not AREAS.keep_outs[0].intersects(hull)
            )
        at_most = Level.CLEAR if free[0] else Level.SLOW if free[2] else Level.STOP
        at_least = Level.CLEAR if free[1] else Level.SLOW if free[3] else Level.STOP
        assert at_most <= verdict.level <= at_least
        hull = shapely.MultiPoint(outline).convex_hull
        gap_m = min(permitted.exterior.distance(hull), AREAS.keep_outs[0].distance(hull))
        if gap_m > 0 and permitted.contains(hull) and verdict.level is not Level.CLEAR:
            assert verdict.clearance_m == pytest.approx(gap_m)
            assert verdict.at_keep_out == (AREAS.keep_outs[0].distance(hull) == gap_m)
        levels.append(verdict.level)
    assert all(levels.count(level) > 100 for level in Level)


@given(places, velocities)
def test_speed_never_permits_more(
    place: tuple[float, float, float], velocity: tuple[float, float]
) -> None:
    outline = placed(OUTLINE, *place)
    standing = FENCE.check(outline, CERTAIN).level
    assert FENCE.check(outline, CERTAIN, velocity).level >= standing


def test_it_can_be_asked_at_every_step() -> None:
    """Far below the pilot's 50 ms on any machine, whatever else runs."""
    outline, known = placed(OUTLINE, 17.0, 0.45, 0.0), covariance(0.3, 0.1, 0.0)
    took = min(timeit.repeat(lambda: FENCE.check(outline, known, (0.5, 0.0)), number=100)) / 100
    assert took < 1e-3


@given(st.floats(-6.0, 26.0), st.floats(-6.0, 26.0))
def test_the_nearest_place_on_each_side_is_shapelys(x: float, y: float) -> None:
    here = shapely.Point(x, y)
    for side, found in zip(FENCE.sides, FENCE.nearest(np.array([x, y])), strict=True):
        line = shapely.LineString(side.reshape(2, 2))
        there = line.interpolate(line.project(here))
        assert found == pytest.approx([there.x, there.y], abs=1e-9)


@given(
    st.lists(st.tuples(st.floats(0.5, 9.0), st.floats(0.05, 0.9)), min_size=3, max_size=9),
    st.floats(-9.0, 9.0),
    st.floats(-9.0, 9.0),
)
def test_the_depth_inside_a_ring_is_shapelys(
    corners: list[tuple[float, float]], x: float, y: float
) -> None:
    """A star of corners: each so far from the middle, and turned on by a share of a whole turn."""
    turns = np.cumsum([share for _, share in corners])
    angles = 2 * math.pi * turns / (turns[-1] + 0.3)
    radii = np.array([r for r, _ in corners])
    ring = np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])
    field, here = shapely.Polygon(ring), shapely.Point(x, y)
    deep_m = float(field.exterior.distance(here)) if field.contains(here) else 0.0
    assert sweep.depth(ring, x, y) == pytest.approx(deep_m, abs=1e-6)


def test_nothing_is_inside_no_ring() -> None:
    assert sweep.depth(np.zeros((0, 2)), 0.0, 0.0) == 0.0
