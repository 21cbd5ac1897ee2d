"""Facts about simulated walks around fields, and what the survey makes of them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hil.scenario.belief import walk_lines
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
