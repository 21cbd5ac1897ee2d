"""Facts about the edge that the machine itself has left."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.vehicle import Vehicle
from host.estimate.last_round import Trails
from host.estimate.odometry import Motion
from host.route.side import Side

VEHICLE = Vehicle()
WIDTH = VEHICLE.pass_m


def side(ring: int, heading: float = 0.0, length: float = 20.0) -> Side:
    """Each ring's edge lies a pass farther left and begins a pass later."""
    c, s = math.cos(heading), math.sin(heading)
    inside = ring * WIDTH
    x, y = 3.0 + c * inside - s * inside, 2.0 + s * inside + c * inside
    return Side(x, y, heading, length - 2 * inside, WIDTH, length)


def driven(trails: Trails, on: Side, bend: float, wave_m: float, frame: float) -> None:
    """Along a side in a sine of that amplitude, by a dead reckoning that began anywhere; half a
    parabola of 0.1 m is the steering's own."""
    trails.begin(on)
    for along in np.arange(0.0, on.length_m, 0.02):
        left = bend * math.sin(math.tau * along / wave_m) + 0.1 * (along / on.length_m) ** 2
        slope = bend * math.tau / wave_m * math.cos(math.tau * along / wave_m)
        slope += 0.2 * along / on.length_m**2
        yaw = math.atan(slope)
        # the blade's left end is what follows the curve
        ahead, half = VEHICLE.blade_x_m, VEHICLE.blade_width_m / 2
        x = along - ahead * math.cos(yaw) + half * math.sin(yaw)
        y = left - ahead * math.sin(yaw) - half * math.cos(yaw)
        c, s = math.cos(frame), math.sin(frame)
        motion = Motion(0.0, 0.5, 0.0, along, yaw + frame, c * x - s * y, s * x + c * y)
        trails.note(float(along), motion)
    trails.end(on)


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_the_next_round_knows_the_bends_but_not_the_direction_of_the_last(
    heading: float, frame: float
) -> None:
    trails = Trails(VEHICLE)
    driven(trails, side(0, heading), 0.04, 5.0, frame)
    inner = side(1, heading)
    trails.begin(inner)
    for along in (1.0, 2.5, 4.0, 6.25, 12.0):
        true = 0.04 * math.sin(math.tau * (along + WIDTH) / 5.0)
        assert trails.bend_m(along, inner) == pytest.approx(true, abs=0.012)


def test_only_the_edge_beside_counts() -> None:
    trails = Trails(VEHICLE)
    driven(trails, side(0), 0.04, 5.0, 0.0)
    for other in (side(0), side(2), side(1, math.pi / 2), side(1, math.pi)):
        trails.begin(other)
        assert trails.bend_m(1.25, other) == 0.0
    inner = side(1)
    trails.begin(inner)
    assert trails.bend_m(1.25 + 5.0 - WIDTH, inner) == pytest.approx(0.04, abs=0.012)
    assert trails.bend_m(30.0, inner) == 0.0, "beyond its end nothing is known"


def test_a_way_too_short_has_no_shape() -> None:
    trails = Trails(VEHICLE)
    driven(trails, side(0, length=2.0), 0.04, 1.0, 0.0)
    trails.begin(side(1))
    assert trails.bend_m(0.25, side(1)) == 0.0


def test_a_newer_edge_takes_the_place_of_the_one_it_has_cut_away() -> None:
    trails = Trails(VEHICLE)
    for ring, bend in ((0, 0.04), (1, 0.0)):
        driven(trails, side(ring), bend, 5.0, 0.0)
    trails.begin(side(1))
    assert trails.bend_m(1.25, side(1)) == 0.0
    trails.begin(side(2))
    assert trails.bend_m(1.25, side(2)) == pytest.approx(0.0, abs=0.005)
