"""Facts about the corners of a boundary that was walked as its edge runs."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hil.studies.outlines import outline
from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.vehicle import Vehicle
from host.field.areas import areas_of
from host.field.boundary_file import Boundary
from host.field.corners import sharpened, steerable, thinned
from host.field.rings import any_edge
from host.field.walk import Points
from host.route.field_plan import plan_of
from host.route.plan import spiral
from host.route.preview import preview

SIDE_M = 20.0


def rounded(corners: Points, radius_m: float) -> Points:
    """A closed ring of straight sides whose corners are arcs."""
    shape = shapely.Polygon(corners)
    round_ = shape.buffer(-radius_m, join_style="mitre").buffer(radius_m, quad_segs=4)
    return shapely.get_coordinates(round_.exterior)[:-1]


def quadrilateral(turn_rad: float) -> Points:
    """One that turns by this at its second and fourth corner."""
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    ring = np.array([[0, 0], [1, 0], [1 + c, s], [c, s]], float)
    return SIDE_M * ring


@given(st.floats(math.radians(72), math.radians(108)), st.floats(0.0, math.tau))
def test_a_corner_that_was_rounded_over_a_walkers_metre_is_a_corner_again(
    turn_rad: float, towards_rad: float
) -> None:
    c, s = math.cos(towards_rad), math.sin(towards_rad)
    true = quadrilateral(turn_rad) @ np.array([[c, s], [-s, c]])
    found = sharpened(rounded(true, 1.0))
    assert len(found) == 4
    off = np.hypot(*(found[:, None] - true[None]).transpose(2, 0, 1)).min(1)
    assert off == pytest.approx(np.zeros(4), abs=1e-6)


def test_an_inner_corner_is_sharpened_too() -> None:
    true = np.array([[0, 0], [30, 0], [30, 15], [15, 15], [15, 30], [0, 30]], float)
    shape = shapely.Polygon(rounded(true, 1.0)).buffer(1.0).buffer(-1.0, quad_segs=4)
    found = sharpened(shapely.get_coordinates(shape.exterior)[:-1])
    assert len(found) == 6
    assert shapely.Polygon(found).symmetric_difference(shapely.Polygon(true)).area < 0.01


def test_what_a_tractor_has_rounded_stays_round() -> None:
    ring = rounded(quadrilateral(math.pi / 2), 6.0)
    assert sharpened(ring) == pytest.approx(ring)


def test_an_edge_that_bends_all_along_has_no_corner() -> None:
    turns = np.arange(24) * math.tau / 24
    ring = 15.0 * np.column_stack([np.cos(turns), np.sin(turns)])
    assert sharpened(ring) == pytest.approx(ring)


@pytest.mark.parametrize(("cut_off_m", "corners"), [(1.0, 4), (3.0, 8)])
def test_what_is_cut_off_by_more_is_an_edge_of_its_own(cut_off_m: float, corners: int) -> None:
    """Of each corner of a square so much of both its edges."""
    square = quadrilateral(math.pi / 2)
    towards = (np.roll(square, -1, axis=0) - square) / SIDE_M
    ends = [square - cut_off_m * np.roll(towards, 1, axis=0), square + cut_off_m * towards]
    ring = np.stack(ends, axis=1).reshape(-1, 2)
    assert len(sharpened(ring)) == corners


def test_a_step_of_the_edge_is_no_corner() -> None:
    """It turns by 50 degrees to one side, and a metre on by 20 to the other."""
    headings = np.radians([0.0, 50.0, 30.0])
    way = np.column_stack([np.cos(headings), np.sin(headings)]) * [[20.0], [1.0], [20.0]]
    ring = np.vstack([[[0.0, 0.0]], np.cumsum(way, axis=0), [[0.0, 40.0]]])
    assert sharpened(ring) == pytest.approx(ring)


def test_a_corner_that_would_make_the_ring_cross_itself_stays_as_it_is() -> None:
    """Beyond the rounded corner, where its edges meet, the ring comes by once more."""
    ring = np.array(
        [[0, 0], [19, 0], [20, 1], [20, 30], [40, 30], [40, -10], [19.6, 0.1], [-10, -10]], float
    )
    assert shapely.LinearRing(ring).is_simple
    assert sharpened(ring) == pytest.approx(ring)


def test_a_walked_square_has_four_corners_whatever_smoothing_made_of_them() -> None:
    """Sampled each half metre, and strayed from by a decimetre."""
    square = shapely.LinearRing(quadrilateral(math.pi / 2))
    along = np.arange(0.0, square.length, 0.5)
    ring = shapely.get_coordinates(shapely.line_interpolate_point(square, along))
    strayed = ring + 0.1 * np.sin(along * math.tau / 9.0)[:, None]
    found = any_edge(strayed)
    assert len(found) == 4
    off = np.hypot(*(found[:, None] - quadrilateral(math.pi / 2)[None]).transpose(2, 0, 1)).min(1)
    assert off.max() < 0.4


@pytest.mark.parametrize("radius_m", [9.0, 12.0, 20.0])
def test_an_arc_stays_one_however_tight_it_is(radius_m: float) -> None:
    """Made corners, it lay up to 0.8 m outside of the edge, and a round field of 14 m was planned
    with eight turns a round; thinned like straight edges, of 17 m with seven."""
    turns = np.arange(0.0, math.tau, 0.5 / radius_m)
    found = thinned(radius_m * np.column_stack([np.cos(turns), np.sin(turns)]))
    assert np.hypot(*found.T) == pytest.approx(radius_m, abs=0.02)
    ways = np.roll(found, -1, axis=0) - found
    bends = np.diff(np.unwrap(np.arctan2(ways[:, 1], ways[:, 0])))
    assert np.degrees(bends).max() < (25.0 if radius_m < 10.0 else 13.0)


def test_points_of_an_arc_that_lie_near_each_other_are_no_rounded_corner() -> None:
    """By twos 3 and 5 m apart on a radius of 10 m."""
    steps = np.tile([3.0, 5.0], 8)
    turns = np.cumsum(steps) * math.tau / steps.sum()
    arc = 10.2 * np.column_stack([np.cos(turns), np.sin(turns)])
    assert sharpened(arc) == pytest.approx(arc)


def test_where_straight_sides_meet_a_shallow_corner_stays_one() -> None:
    c, s = math.cos(math.radians(35.0)), math.sin(math.radians(35.0))
    true = np.array(
        [[0, 0], [20, 0], [20 + 20 * c, 20 * s], [20 + 20 * c - 20 * s, 20 + 20 * s], [0, 25]]
    )
    found = thinned(rounded(true, 1.5))
    assert len(found) == 5
    assert np.hypot(*(found[:, None] - true[None]).transpose(2, 0, 1)).min(1).max() < 0.2


def recorded(radius_m: float = 30.0, points: int = 60) -> list[tuple[float, float]]:
    """A boundary whose edge wanders by a decimetre from point to point."""
    turns = np.arange(points) * math.tau / points
    radii = radius_m + 0.1 * np.cos(7.0 * np.arange(points))
    return list(
        zip((radii * np.cos(turns)).tolist(), (radii * np.sin(turns)).tolist(), strict=True)
    )


def test_of_what_was_recorded_those_corners_are_left_that_can_be_told_apart() -> None:
    ring = recorded()
    found, _ = steerable(ring, 0, 1.0)
    assert 8 < len(found) < 40
    apart = shapely.LinearRing(found).hausdorff_distance(shapely.LinearRing(ring))
    assert apart < 1.0
    closer, _ = steerable(ring, 0, 0.35)
    assert len(found) < len(closer) < len(ring)


def test_a_boundary_that_is_known_exactly_or_was_drawn_is_taken_as_it_is() -> None:
    ring = recorded()
    assert steerable(ring, 7, 0.0) == (ring, 7)
    straight = shapely.box(0, 0, 30, 20).exterior.segmentize(1.0).coords[:-1]
    assert steerable(straight, 7, 0.0) == (straight, 7), "though most of it is on four lines"
    drawn = [(x, y) for x, y in rounded(quadrilateral(math.pi / 2), 1.0).tolist()][:12]
    assert steerable(drawn, 3, 1.0) == (drawn, 3)
    assert steerable(ring, 7, 1.0, False) == (ring, 7), "so it was said to be, however long it is"


def test_a_short_boundary_that_is_said_to_be_recorded_keeps_no_corner_that_is_none() -> None:
    ring = [(0.0, 0.0), (10.0, 0.1), (20.0, 0.0), (20.0, 12.0), (0.0, 12.0)]
    assert steerable(ring, 0, 1.0, True) == ([ring[0], *ring[2:]], 0)
    assert steerable(ring, 0, 1.0) == (ring, 0)


def test_what_a_survey_has_thinned_is_not_thinned_again() -> None:
    """Thinned twice, an arc has corners where it has none."""
    ring = np.array(outline(28).ring)
    curved = shapely.LinearRing(ring * math.sqrt(600.0 / shapely.Polygon(ring).area))
    dense = shapely.get_coordinates(curved.segmentize(0.4))[:-1]
    once = [(x, y) for x, y in thinned(dense).tolist()]
    assert len(once) < len(dense) / 5
    assert steerable(once, 3, 0.38, True) == (once, 3)
    assert len(steerable([(x, y) for x, y in dense.tolist()], 0, 0.38, True)[0]) < len(dense) / 5


@given(st.integers(0, 59))
def test_where_the_machine_is_to_begin_a_corner_stays(start: int) -> None:
    """But where it was rounded: then it is a step away."""
    ring = recorded()
    found, at = steerable(ring, start, 1.0)
    assert math.dist(found[at], ring[start]) < 0.8


@pytest.mark.parametrize("start", [0, 9, 31, 58])
def test_a_plan_of_what_was_recorded_begins_where_it_is_told_or_says_where_it_can(
    start: int,
) -> None:
    """By the numbers of the file."""
    ring = outline(25).ring
    frame = LocalFrame(48.0, 11.0)
    field = Boundary(tuple(frame.to_wgs84(x, y) for x, y in ring))
    places = [field.frame.to_local(*corner) for corner in field.crop]
    try:
        _, plan = plan_of(field, start, Vehicle(), "three_point", 2.0)
    except UserError as error:
        start = int(str(error).rsplit("--corner ", 1)[1])
        _, plan = plan_of(field, start, Vehicle(), "three_point", 2.0)
    assert len(plan.boundary) < len(ring) / 2
    first = plan.sides[0]
    assert math.dist((first.x_m, first.y_m), places[start]) < 3.0


def test_the_preview_asks_the_geofence_that_the_pilot_will_have() -> None:
    """Around the recorded boundary the first turn seemed to lack 0.12 m of room."""
    ring = list(outline(25).ring)
    plan = spiral(ring, 0, Vehicle(), gap_m=2.0, sigma_m=1.0)
    shown = preview(plan, areas_of(shapely.Polygon(ring), 2.0), Vehicle())
    assert shown.warnings == []
    assert shown.coverage > 0.995
