"""What still stands by the way of the blade, and the strips that gather it."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from host.core.frames import Pose2
from host.core.vehicle import Vehicle
from host.route.left_over import GATHER_M2, HALF_SLIVER_M, LeftOver

VEHICLE = Vehicle()
WIDTH_M = VEHICLE.blade_width_m
FIELD = [(0.0, 0.0), (12.0, 0.0), (12.0, 10.0), (0.0, 10.0)]
AROUND = shapely.Polygon(FIELD).buffer(1.8, join_style="mitre")
HERE = Pose2(6.0, 5.0, 0.0)


def swath(*points: tuple[float, float]) -> NDArray[np.float64]:
    """The blade's way through crop, a point every quarter of a metre."""
    line = shapely.LineString(points)
    count = max(1, round(line.length / 0.25))
    places = [line.interpolate(k / count, normalized=True) for k in range(count + 1)]
    return np.array([(place.x, place.y) for place in places])


def cut(but: shapely.Polygon, *, askew_m: float = 0.0) -> LeftOver:
    """A field that was cut in strips to the right, all but what lies in that polygon; every other
    one begun and ended askew_m from where it should."""
    left = LeftOver(VEHICLE)
    for k in range(math.ceil(10.0 / VEHICLE.pass_m)):
        y = (k + 0.5) * VEHICLE.pass_m
        row = shapely.LineString([(0.0, y), (12.0, y)]).difference(but)
        for piece in getattr(row, "geoms", [row]):
            (x0, _), (x1, _) = piece.coords
            off = askew_m * (k % 2)
            left.take(swath((x0 + 0.2 + off, y), (x1 - 0.2 + off, y)))
    return left


def test_of_a_field_that_is_cut_nothing_is_left() -> None:
    left = cut(shapely.Polygon())
    assert left.parts(FIELD, []) == []
    assert left.strips(FIELD, [], HERE, AROUND) == []


def test_what_no_swath_has_crossed_is_left() -> None:
    band = shapely.box(0.0, 0.0, 0.7, 10.0)
    (part,) = cut(band).parts(FIELD, [])
    assert part.symmetric_difference(band).area < 0.6


@pytest.mark.parametrize("apart_m", [0.3, 0.6])
def test_what_is_narrower_than_places_err_was_cut(apart_m: float) -> None:
    left = LeftOver(VEHICLE)
    field = [(0.0, 0.0), (12.0, 0.0), (12.0, 2 * WIDTH_M + apart_m), (0.0, 2 * WIDTH_M + apart_m)]
    left.take(swath((0.0, WIDTH_M / 2), (12.0, WIDTH_M / 2)))
    left.take(swath((0.0, 1.5 * WIDTH_M + apart_m), (12.0, 1.5 * WIDTH_M + apart_m)))
    assert bool(left.parts(field, [])) is (apart_m > 2 * HALF_SLIVER_M)


@pytest.mark.parametrize("area_m2", [0.6 * GATHER_M2[0], 1.6 * GATHER_M2[0]])
def test_what_is_too_small_to_be_worth_a_way_stays(area_m2: float) -> None:
    wide = math.sqrt(area_m2)
    left = cut(shapely.box(5.0, 5.0, 5.0 + wide, 5.0 + wide))
    assert bool(left.parts(FIELD, [])) is (area_m2 > GATHER_M2[0])


def test_what_strips_have_left_beside_the_border_is_gathered_by_one_along_it() -> None:
    left = cut(shapely.box(0.0, 0.0, 0.8, 10.0), askew_m=0.15)
    best = left.strips(FIELD, [], HERE, AROUND)[0]
    side = best.side
    assert side.left_over
    assert abs(math.sin(side.heading_rad)) > math.sin(math.radians(85))
    assert side.length_m == pytest.approx(10.0, abs=0.5)
    assert best.area.area > 0.9 * sum(part.area for part in left.parts(FIELD, []))


def test_a_strip_has_what_stands_on_its_left() -> None:
    stands = shapely.box(3.0, 3.0, 8.0, 6.0)
    for strip in cut(stands).strips(FIELD, [], HERE, AROUND):
        middle = shapely.Point(
            strip.side.pose(strip.side.length_m / 2, 0.5 * strip.side.width_m)[:2]
        )
        outside = shapely.Point(strip.side.pose(strip.side.length_m / 2, -0.6)[:2])
        assert stands.contains(middle)
        assert not stands.contains(outside)


def test_of_two_strips_that_gather_as_much_the_nearer_is_the_better() -> None:
    stands = shapely.union_all([shapely.box(1.0, 4.0, 2.0, 7.0), shapely.box(9.0, 4.0, 10.0, 7.0)])
    left = cut(stands)
    for x in (0.0, 12.0):
        best = left.strips(FIELD, [], Pose2(x, 5.0, 0.0), AROUND)[0]
        assert abs(best.area.centroid.x - x) < 3.0


def test_what_was_tried_is_not_offered_again_and_is_still_left() -> None:
    left = cut(shapely.box(5.0, 5.0, 7.0, 8.0))
    before = sum(part.area for part in left.parts(FIELD, []))
    count = 0
    while strips := left.strips(FIELD, [], HERE, AROUND):
        left.tried(strips[0].area)
        count += 1
    assert 1 <= count <= 6
    assert sum(part.area for part in left.parts(FIELD, [])) == pytest.approx(before)
    assert left.parts(FIELD, [], tried=False) == []


def test_what_was_set_aside_is_offered_again_once_another_was_tried() -> None:
    """No way led there from where the machine stood."""
    stands = shapely.union_all([shapely.box(1.0, 4.0, 2.0, 7.0), shapely.box(9.0, 4.0, 10.0, 7.0)])
    left = cut(stands)
    first = left.strips(FIELD, [], Pose2(0.0, 5.0, 0.0), AROUND)[0].area
    before_m2 = sum(part.area for part in left.parts(FIELD, []))
    left.set_aside(first)
    others = left.strips(FIELD, [], Pose2(0.0, 5.0, 0.0), AROUND)
    assert others and not any(s.area.intersects(first) for s in others)
    assert sum(part.area for part in left.parts(FIELD, [])) == pytest.approx(before_m2)
    left.tried(others[0].area)
    again = left.strips(FIELD, [], Pose2(0.0, 5.0, 0.0), AROUND)
    assert any(s.area.intersects(first) for s in again)


def test_a_strip_for_which_the_machine_has_no_room_is_none() -> None:
    left = cut(shapely.box(0.0, 0.0, 0.8, 10.0))
    assert left.strips(FIELD, [], HERE, AROUND)
    assert left.strips(FIELD, [], HERE, shapely.box(0.4, 0.4, 11.6, 9.6)) == []
    tree = [(0.0, 4.9), (0.2, 4.9), (0.2, 5.1), (0.0, 5.1)]
    assert all(s.side.length_m < 5.0 for s in left.strips(FIELD, [tree], HERE, AROUND))


def test_what_no_plan_cuts_around_a_keep_out_is_not_left() -> None:
    tree = [(5.9, 4.9), (6.1, 4.9), (6.1, 5.1), (5.9, 5.1)]
    left = cut(shapely.box(5.2, 4.2, 6.8, 5.8))
    assert left.parts(FIELD, [])
    assert left.parts(FIELD, [tree]) == []


def test_where_too_little_room_is_behind_it_a_strip_is_begun_later() -> None:
    stands = shapely.box(0.0, 4.0, 10.0, 5.0)
    left = cut(stands)
    heads_east = [
        s
        for s in left.strips(FIELD, [], HERE, shapely.box(-1.4, -2.0, 14.0, 12.0))
        if abs(s.side.heading_rad) < 0.1
    ]
    assert heads_east
    length_m = VEHICLE.blade_x_m + VEHICLE.rear_overhang_m
    none = shapely.box(1.0 - length_m, -2.0, 14.0, 12.0)
    assert not [s for s in left.strips(FIELD, [], HERE, none) if abs(s.side.heading_rad) < 0.1]


@settings(deadline=None, max_examples=30)
@given(
    ways=st.lists(
        st.tuples(
            st.floats(0.0, 12.0), st.floats(0.0, 10.0), st.floats(0.0, 12.0), st.floats(0.0, 10.0)
        ).filter(lambda w: math.hypot(w[2] - w[0], w[3] - w[1]) > 0.5),
        max_size=12,
    ),
    x=st.floats(0.0, 12.0),
    heading=st.floats(-math.pi, math.pi),
)
def test_whatever_was_cut_strips_lead_through_what_was_not(
    ways: list[tuple[float, float, float, float]], x: float, heading: float
) -> None:
    left = LeftOver(VEHICLE)
    swaths = [swath(way[:2], way[2:]) for way in ways]
    for each in swaths:
        left.take(each)
    parts = left.parts(FIELD, [])
    field = shapely.Polygon(FIELD)
    for part in parts:
        assert part.within(field.buffer(1e-6))
        inner = part.buffer(-0.01)
        assert not any(shapely.LineString(each).intersects(inner) for each in swaths)
    for strip in left.strips(FIELD, [], Pose2(x, 5.0, heading), AROUND):
        assert any(strip.area.intersection(part).area > 0.9 * strip.area.area for part in parts)


@pytest.mark.parametrize(("later_m", "fits"), [(0.45, True), (0.75, False)])
def test_a_strip_keeps_clear_of_keep_outs_by_the_geofences_margin(
    later_m: float, fits: bool
) -> None:
    """Behind where it begins; the strip would have to begin so much later to touch none."""
    left = cut(shapely.box(4.0, 5.0, 10.0, 5.9))
    tail_m = 4.0 - 0.3 - VEHICLE.blade_x_m - VEHICLE.rear_overhang_m
    x = tail_m + later_m
    post = [(x - 0.2, 5.3), (x, 5.3), (x, 5.6), (x - 0.2, 5.6)]
    strips = left.strips(FIELD, [post], HERE, AROUND)
    assert any(abs(s.side.heading_rad) < 0.1 for s in strips) is fits
