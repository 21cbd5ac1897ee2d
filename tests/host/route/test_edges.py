"""Facts about the edges of outlines whose corners are rounded, or that have none at all."""

from __future__ import annotations

import itertools
import math

import pytest
import shapely

from host.core.errors import UserError
from host.core.vehicle import Vehicle
from host.route.plan import spiral
from host.route.standing import TURN_RAD, edges_of, inner_corners

VEHICLE = Vehicle()


def rounded(radius_m: float, step_deg: float = 15.0) -> shapely.Polygon:
    """A rectangle of 40 m x 30 m with its corners rounded."""
    box = shapely.box(0, 0, 40, 30).buffer(-radius_m, join_style="mitre")
    return box.buffer(radius_m, quad_segs=round(90 / step_deg)).simplify(1e-3)


def circle(radius_m: float, count: int) -> shapely.Polygon:
    angles = [k * math.tau / count for k in range(count)]
    return shapely.Polygon([(radius_m * math.cos(a), radius_m * math.sin(a)) for a in angles])


def turn_of(points: tuple[tuple[float, float], ...]) -> float:
    """How far a chain turns left in all."""
    ways = [math.atan2(d - b, c - a) for (a, b), (c, d) in itertools.pairwise(points)]
    turns = (math.remainder(b - a, math.tau) for a, b in itertools.pairwise(ways))
    return sum(turns)


@pytest.mark.parametrize("radius_m", [0.5, 1.0, 3.0, 3.8])
def test_a_tightly_rounded_corner_is_one_corner_and_lies_off_the_edges(radius_m: float) -> None:
    """A machine does not follow it: it goes straight on along either edge."""
    edges = edges_of(rounded(radius_m))
    assert len(edges) == 4
    assert all(edge.open_ends and not edge.bent for edge in edges)
    lengths = sorted(edge.line.length for edge in edges)
    straight = [30 - 2 * radius_m] * 2 + [40 - 2 * radius_m] * 2
    assert lengths == pytest.approx(straight, abs=0.01)


@pytest.mark.parametrize("step_deg", [5.0, 10.0, 15.0, 18.0, 30.0])
def test_however_an_arc_was_recorded_it_is_followed_or_not_by_its_radius(step_deg: float) -> None:
    """Points 2.8 m apart on a radius of 9 m were taken to turn by 36 degrees within 3 m, and there
    a machine was to turn on the spot."""
    assert any(edge.bent for edge in edges_of(rounded(5.5, step_deg)))
    assert not any(edge.bent for edge in edges_of(rounded(3.8, step_deg)))


def test_two_corners_a_strip_apart_stay_two() -> None:
    """The end of one last strip, and the step that a shuttled strip leaves."""
    strip = edges_of(shapely.box(0, 0, 10, 1))
    assert sorted(round(edge.line.length) for edge in strip) == [1, 1, 10, 10]
    step = shapely.Polygon([(0, 0), (10, 0), (10, 5), (6, 5), (6, 6), (0, 6)])
    assert len(edges_of(step)) == 6
    assert inner_corners(step).tolist() == [[6.0, 5.0]]


def test_points_that_jitter_make_no_corner() -> None:
    """20 degrees to the left and back."""
    track = shapely.Polygon([(0, 0), (5, 0), (5.5, 0.18), (6, 0), (20, 0), (20, 15), (0, 15)])
    assert len(edges_of(track)) == 4


@pytest.mark.parametrize(
    "field", [circle(12.0, 40), circle(80.0, 160), rounded(12.0), rounded(13.0, 5.0)]
)
def test_no_edge_leads_all_around_a_field(field: shapely.Polygon) -> None:
    """Where a strip around it ended, the next would have to be entered through standing crop."""
    edges = edges_of(field)
    assert len(edges) >= math.tau / TURN_RAD > 1.0
    assert all(turn_of(edge.points) <= TURN_RAD + 1e-6 for edge in edges)
    whole = sum(edge.line.length for edge in edges)
    assert whole == pytest.approx(field.exterior.length)


def test_an_edge_begins_where_the_machine_stands() -> None:
    field = circle(80.0, 160)
    here = field.exterior.coords[37]
    begins = [edge.begin for edge in edges_of(field, here, 1.5)]
    assert min(math.dist(begin, here) for begin in begins) < 1e-9
    far = (200.0, 0.0)
    assert len(edges_of(field, far, 1.5)) == len(edges_of(field))


def test_a_field_that_is_narrower_than_a_sliver_is_told() -> None:
    with pytest.raises(UserError, match="boundary: along no side of it a strip can be cut"):
        spiral([(0.0, 0.0), (0.3, 0.0), (0.3, 0.04), (0.0, 0.04)], 0, VEHICLE, gap_m=2.0)


@pytest.mark.parametrize("free_m", [0.2, 0.74, 0.7501])
def test_a_keep_out_that_leaves_nothing_of_the_field_is_told(free_m: float) -> None:
    field = list(shapely.box(0, 0, 30, 20).exterior.coords)[:-1]
    out = list(shapely.box(free_m, free_m, 30 - free_m, 20 - free_m).exterior.coords)[:-1]
    with pytest.raises(UserError, match="around them too, leave nothing to cut"):
        spiral(field, 0, VEHICLE, gap_m=2.0, keep_outs=[out])
