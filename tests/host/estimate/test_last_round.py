"""Facts about the edge that the machine itself has left."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.vehicle import Vehicle
from host.estimate.last_round import OUTWARD_M, Trails
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


def wave(along_m: float, bend_m: float) -> float:
    """How far left of the lane's edge the blade's left end was: it waved, and ran askew."""
    return bend_m * math.sin(math.tau * along_m / 5.0) + askew(along_m)


def askew(along_m: float) -> float:
    """All that the filter knows of it, which takes waves for the edge's."""
    return 0.1 + 0.005 * along_m


def driven(trails: Trails, on: Side, bend_m: float, frame: float = 0.0) -> None:
    """Along a side, by a dead reckoning that began anywhere; half a parabola of 0.1 m is the
    steering's own."""
    trails.begin(on)
    for along in np.arange(0.0, on.length_m, 0.02).tolist():
        left = wave(along, bend_m) - askew(along) + 0.1 * (along / on.length_m) ** 2
        slope = bend_m * math.tau / 5.0 * math.cos(math.tau * along / 5.0)
        yaw = math.atan(slope + 0.2 * along / on.length_m**2)
        # the blade's left end is what follows the curve
        ahead, half = VEHICLE.blade_x_m, VEHICLE.blade_width_m / 2
        x = along - ahead * math.cos(yaw) + half * math.sin(yaw)
        y = left - ahead * math.sin(yaw) - half * math.cos(yaw)
        c, s = math.cos(frame), math.sin(frame)
        motion = Motion(0.0, 0.5, 0.0, along, yaw + frame, c * x - s * y, s * x + c * y)
        trails.note(along, askew(along), motion)
    trails.end(on)


@given(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_the_next_round_knows_where_the_blade_has_been_beside_its_lane(
    heading: float, frame: float
) -> None:
    trails = Trails(VEHICLE)
    driven(trails, side(0, heading), 0.04, frame)
    inner = side(1, heading)
    trails.begin(inner)
    for along in (1.0, 2.5, 4.0, 6.25, 12.0):
        assert trails.bend_m(along, inner) == pytest.approx(wave(along + WIDTH, 0.04), abs=0.012)


def test_what_was_left_too_far_outside_is_followed() -> None:
    trails = Trails(VEHICLE)
    trails.begin(side(0))
    for along in np.arange(0.0, 20.0, 0.1).tolist():
        trails.note(along, -0.4, Motion(0.0, 0.5, 0.0, along, 0.0, along, 0.0))
    trails.end(side(0))
    trails.begin(side(1))
    assert trails.bend_m(5.0, side(1)) == -OUTWARD_M


def test_only_the_edge_beside_counts() -> None:
    trails = Trails(VEHICLE)
    driven(trails, side(0), 0.04)
    for other in (side(0), side(2), side(1, math.pi / 2), side(1, math.pi)):
        trails.begin(other)
        assert trails.bend_m(1.25, other) == 0.0
    inner = side(1)
    trails.begin(inner)
    assert trails.bend_m(1.25, inner) > 0.1
    assert trails.bend_m(30.0, inner) == 0.0, "beyond its end nothing is known"


def test_a_newer_edge_takes_the_place_of_the_one_it_has_cut_away() -> None:
    trails = Trails(VEHICLE)
    for ring, bend_m in ((0, 0.04), (1, 0.0)):
        driven(trails, side(ring), bend_m)
    trails.begin(side(1))
    assert trails.bend_m(1.25, side(1)) == 0.0
    trails.begin(side(2))
    assert trails.bend_m(1.25, side(2)) == pytest.approx(wave(1.25 + WIDTH, 0.0), abs=0.006)
