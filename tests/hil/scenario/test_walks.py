"""Facts about simulated walks around fields, and what the survey makes of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from hil.scenario.belief import CORNER_PAUSE_S, WALK_MPS, walk_lines
from hil.scenario.random_fields import random_field
from host.field.survey import survey_track
from host.field.walk import find_loops, read_fixes, track_of
from host.sensors.nmea import Receiver
from sim_plant.gnss import GnssSpec


def test_a_walk_whose_loops_overlap_little_has_a_lap_all_the_same() -> None:
    """Two laps with a phone that says no speed: what closes soonest is no lap of the best loop."""
    phone = GnssSpec(cep_m=2.5, outages_per_hour=0.0)
    true = random_field(9004).world
    lines = walk_lines(true.corners, phone, 2, 3)
    fixes = read_fixes((f"{line}\r\n".encode() for line in lines), Receiver())
    track = track_of(replace(fix, speed_mps=None, course_rad=None) for fix in fixes)
    assert track is not None
    loops = find_loops(track, 6.0)
    assert loops is not None
    assert len(loops.laps) == 1
    assert survey_track(track).polygon.area == pytest.approx(true.field.boundary.area, rel=0.3)


def test_a_walker_stops_at_corners_and_walks_along_bends() -> None:
    """Half a disc of 12 m radius, recorded with a point each 0.6 m, at 1.3 m/s."""
    turns = np.linspace(-math.pi / 2, math.pi / 2, 64)
    half = [(12.0 * math.cos(t), 12.0 * math.sin(t)) for t in turns]
    lines = walk_lines(tuple(half), GnssSpec(cep_m=0.01, white_m=0.0, outages_per_hour=0.0), 1, 3)
    fixes = read_fixes((f"{line}\r\n".encode() for line in lines), Receiver())
    stands = [fix.speed_mps is not None and fix.speed_mps < 0.2 for fix in fixes]
    around_m = 12.0 * (math.pi + 2.0)
    assert len(fixes) == pytest.approx(around_m / WALK_MPS + 3 * CORNER_PAUSE_S, abs=4)
    assert 2 * CORNER_PAUSE_S <= sum(stands) <= 4 * CORNER_PAUSE_S
