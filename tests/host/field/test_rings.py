"""Facts about what several laps and the smoothing make of an edge."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from host.field.rings import any_edge, closing, mean_ring, resampled, sharp_corners
from host.field.walk import Points

SHARP: Points = np.array([[0, 0], [24, -4], [30, 10], [14, 16], [10, 34], [-4, 16]], float)
"""Turns by 90 to 124 degrees to the left, once by 57 to the right."""


def walked(corners: Points) -> Points:
    """A ring with a place each half metre."""
    return resampled(corners, round(2 * shapely.LinearRing(corners).length))


def off_m(ring: Points, places: Points) -> Points:
    """(n,) how far places (n, 2) are from a ring's nearest point."""
    off = places[:, None] - ring[None]
    return np.asarray(np.hypot(off[..., 0], off[..., 1]).min(1))


def circle(radius_m: float) -> Points:
    """A ring with a place each half metre."""
    turns = np.arange(round(2 * math.tau * radius_m)) / (2 * radius_m)
    return radius_m * np.column_stack([np.cos(turns), np.sin(turns)])


# ---- several laps --------------------------------------------------------------------------------


@given(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), st.integers(0, 5), st.floats(0.97, 1.03))
def test_laps_that_lie_aside_keep_their_corners(
    dx: float, dy: float, begun: int, size: float
) -> None:
    """The mean of the nearest places of two laps cut a corner of 124 degrees off by two metres."""
    apart = np.array([dx, dy])
    middle = SHARP.mean(0)
    other = np.roll(SHARP, begun, axis=0) - middle
    mean, _ = mean_ring([walked(SHARP), walked(size * other + middle + apart)], 300)
    true = (1 + size) / 2 * (SHARP - middle) + middle + apart / 2
    assert off_m(mean, true).max() < 0.6
    assert shapely.LinearRing(mean).hausdorff_distance(shapely.LinearRing(true)) < 0.6


@pytest.mark.parametrize("apart", [(-1.0, 1.0), (0.3, -1.4), (-1.4, 0.2)])
def test_the_way_to_a_corner_is_not_taken_for_the_way_from_it(apart: tuple[float, float]) -> None:
    mean, _ = mean_ring([walked(SHARP), walked(SHARP + np.array(apart))], 300)
    assert off_m(mean, SHARP + np.array(apart) / 2).max() < 0.33


def test_a_lap_that_was_longer_on_one_side_is_none_the_shorter_on_the_others() -> None:
    """It swings by 0.4 m to and fro along a quarter of the way, which makes that longer by half."""
    ring = walked(SHARP)
    swung = ring.copy()
    swung[60:110:2, 0] += 0.4
    mean, _ = mean_ring([ring, swung], 300)
    assert off_m(mean, SHARP).max() < 0.45


def test_each_lap_counts_alike() -> None:
    laps = [circle(10.0), circle(11.0), circle(15.0)]
    mean, apart = mean_ring(laps, 200)
    assert np.hypot(*mean.T) == pytest.approx(np.full(200, 12.0), abs=0.1)
    assert apart == pytest.approx(math.sqrt((2.0**2 + 1.0**2 + 3.0**2) / 3), abs=0.1)


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_the_mean_of_rings_lies_between_them(dx: float, dy: float) -> None:
    mean, apart = mean_ring([circle(10.0), circle(10.0) + np.array([dx, dy])], 100)
    centre = shapely.Polygon(mean).centroid
    assert (centre.x, centre.y) == pytest.approx((dx / 2, dy / 2), abs=0.05)
    assert apart == pytest.approx(math.hypot(dx, dy) / 2 / math.sqrt(2), abs=0.05)


# ---- one ring ------------------------------------------------------------------------------------


def test_corners_stay_where_they_are_however_sharp() -> None:
    """Smoothed as arcs, three of them became two points each. The last one is strayed from by a
    decimetre."""
    ring = walked(SHARP)
    assert off_m(any_edge(ring), SHARP).max() < 0.12
    strayed = ring + 0.1 * np.sin(np.arange(len(ring)) * math.tau / 17.0)[:, None]
    found = any_edge(strayed)
    turning = found[turns_deg(found) > 30.0]
    assert len(turning) == len(SHARP)
    assert off_m(turning, SHARP).max() < 0.35


@pytest.mark.parametrize("radius_m", [4.0, 6.0, 9.0, 20.0])
def test_an_arc_has_no_corner(radius_m: float) -> None:
    assert not sharp_corners(circle(radius_m))


def test_a_corner_beside_an_arc_is_found_where_it_is() -> None:
    """Half a disc of 9 m radius."""
    turns = np.linspace(-math.pi / 2, math.pi / 2, 60)
    half = 9.0 * np.column_stack([np.cos(turns), np.sin(turns)])
    ring = walked(half)
    corners = np.array(list(sharp_corners(ring).values()))
    assert len(corners) == 2
    assert off_m(corners, half[[0, -1]]).max() < 0.3
    between = any_edge(ring)
    assert shapely.LinearRing(between).hausdorff_distance(shapely.LinearRing(half)) < 0.3


def test_a_corner_that_a_tractor_has_rounded_widely_is_none() -> None:
    square = shapely.box(0.0, 0.0, 30.0, 30.0)
    round_ = square.buffer(-5.0, join_style="mitre").buffer(5.0, quad_segs=16)
    assert not sharp_corners(walked(shapely.get_coordinates(round_.exterior)[:-1]))


def test_smoothing_draws_no_bend_inwards() -> None:
    """The mean of as many points of this circle lies 15 cm inside it."""
    angles = np.linspace(0, math.tau, 160, endpoint=False)
    edge = any_edge(8.0 * np.column_stack([np.cos(angles), np.sin(angles)]))
    assert np.hypot(*edge.T) == pytest.approx(8.0, abs=0.02)


def test_where_a_lap_closes_beside_its_beginning_the_edge_has_no_step() -> None:
    """What the phone drifts during a lap was a corner of 30 to 45 degrees where the walk began: it
    is where the machine is put down. 0.8 m on a circle of 20 m, whose end lies 1.3 m before its
    beginning."""
    angles = np.linspace(0, math.tau - 1.3 / 20, 400)
    lap = (20.0 + np.linspace(0.0, 0.8, 400))[:, None] * np.column_stack(
        [np.cos(angles), np.sin(angles)]
    )
    closed = closing(lap)
    radii = np.hypot(*closed.T)
    assert radii[[0, -1]] == pytest.approx([20.4, 20.4], abs=0.12)
    assert closed[50:-50] == pytest.approx(lap[50:-50]), "far from there nothing moves"
    assert math.dist(closed[0], closed[-1]) == pytest.approx(1.25, abs=0.1), "what was not walked"
    assert turns_deg(any_edge(closed)).max() < 16.0
    assert turns_deg(any_edge(lap)).max() > 20.0


def turns_deg(ring: Points) -> Points:
    """(n,) how far a closed ring turns at each of its points, to either side."""
    headings = np.arctan2(*(np.roll(ring, -1, axis=0) - ring).T[::-1])
    turns = np.remainder(headings - np.roll(headings, 1) + math.pi, math.tau) - math.pi
    return np.asarray(np.degrees(np.abs(turns)))
