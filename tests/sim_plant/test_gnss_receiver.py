"""The receiver speaks like the real phone, and its errors have the size that was asked for."""

from __future__ import annotations

import numpy as np
import pynmea2
import pytest

from sim_plant.gnss import Gnss, GnssSpec, sentence
from tests.helpers.real_data import real

CALM = {"jumps_per_hour": 0.0, "outages_per_hour": 0.0}


def _metres(gnss: Gnss, lines: list[str]) -> tuple[float, float]:
    fix = pynmea2.parse(lines[-1], check=True)
    zero, one = gnss.to_wgs84(0, 0), gnss.to_wgs84(1, 1)
    return (
        (fix.longitude - zero[1]) / (one[1] - zero[1]),
        (fix.latitude - zero[0]) / (one[0] - zero[0]),
    )


def test_every_sentence_has_a_good_checksum_and_parses() -> None:
    gnss = Gnss(GnssSpec(first_fix_s=3), seed=1)
    for t in range(10):
        for line in gnss.epoch(float(t), 1.0, 2.0, 0.5, 0.0):
            pynmea2.parse(line, check=True)


def test_metres_become_degrees_on_the_ellipsoid() -> None:
    pyproj = pytest.importorskip("pyproj")
    gnss = Gnss(GnssSpec())
    lat, lon = gnss.to_wgs84(300.0, 400.0)
    _, _, distance = pyproj.Geod(ellps="WGS84").inv(74.3, 31.5, lon, lat)
    assert distance == pytest.approx(500.0, abs=0.05)


def test_without_error_the_fix_is_the_truth_to_the_format_s_resolution() -> None:
    gnss = Gnss(GnssSpec(cep_m=0, white_m=0, **CALM))
    for x, y in ((0, 0), (12.34, -5.6), (-40.0, 70.0)):
        assert _metres(gnss, gnss.epoch(0, x, y, 0, 0)) == pytest.approx((x, y), abs=0.003)


def test_a_receiver_that_lags_says_where_it_was() -> None:
    gnss = Gnss(GnssSpec(cep_m=0, white_m=0, lag_s=2.0, **CALM))
    assert _metres(gnss, gnss.epoch(0, 10.0, 4.0, 1.0, -0.5)) == pytest.approx(
        (8.0, 5.0), abs=0.003
    )


@pytest.mark.parametrize("cep", [0.5, 2.5])
def test_half_the_fixes_lie_within_the_cep(cep: float) -> None:
    distances = []
    for seed in range(40):
        gnss = Gnss(GnssSpec(cep_m=cep, correlation_s=60, **CALM), seed)
        for t in range(0, 1200, 20):
            x, y = _metres(gnss, gnss.epoch(float(t), 0, 0, 0, 0))
            distances.append(np.hypot(x, y))
    assert np.median(distances) == pytest.approx(cep, rel=0.1)


def test_the_error_is_slow() -> None:
    gnss = Gnss(GnssSpec(**CALM), seed=2)
    track = np.array([_metres(gnss, gnss.epoch(float(t), 0, 0, 0, 0)) for t in range(300)])
    assert np.median(np.hypot(*np.diff(track, axis=0).T)) < 0.4
    assert np.hypot(*np.ptp(track, axis=0)) > 1.0


def test_jumps_and_outages_come_at_their_rates() -> None:
    spec = GnssSpec(jumps_per_hour=60, jump_m=20, outages_per_hour=60, outage_s=5, cep_m=0.5)
    gnss = Gnss(spec, seed=3)
    track = []
    lost = 0
    for t in range(7200):
        lines = gnss.epoch(float(t), 0, 0, 0, 0)
        lost += ",V," in lines[-2]
        if ",V," not in lines[-2]:
            track.append(_metres(gnss, lines))
    steps = np.hypot(*np.diff(track, axis=0).T)
    assert np.count_nonzero(steps > 5) == pytest.approx(120, abs=35)
    assert lost / 7200 == pytest.approx(5 / 60, abs=0.025)


@pytest.mark.parametrize(
    ("vx", "vy", "course"), [(0.0, 0.5, 0.0), (0.5, 0.0, 90.0), (-0.5, 0.0, 270.0)]
)
def test_speed_is_in_knots_and_course_clockwise_from_north(
    vx: float, vy: float, course: float
) -> None:
    gnss = Gnss(GnssSpec(speed_noise_mps=0.0, **CALM))
    rmc = pynmea2.parse(gnss.epoch(0.0, 0, 0, vx, vy)[-2])
    assert rmc.spd_over_grnd == pytest.approx(0.5 / 0.5144, abs=0.06)
    assert rmc.true_course == pytest.approx(course)


def test_canopy_takes_fixes_only_under_trees() -> None:
    gnss = Gnss(GnssSpec(canopy_loss=0.5, **CALM), seed=4)
    lost = {
        trees: sum(
            ",V," in gnss.epoch(float(t), 0, 0, 0, 0, under_trees=trees)[-2] for t in range(400)
        )
        for trees in (False, True)
    }
    assert lost[False] == 0
    assert lost[True] == pytest.approx(200, abs=40)


def test_the_track_repeats_and_differs_by_seed() -> None:
    def track(seed: int) -> list[list[str]]:
        gnss = Gnss(GnssSpec(), seed)
        return [gnss.epoch(float(t), 0.5 * t, 0, 0.5, 0) for t in range(20)]

    assert track(1) == track(1)
    assert track(1) != track(2)


def test_the_sentences_have_the_fields_of_a_real_phone_s() -> None:
    sentences = real("gps/phone-walk.nmea").read_text().splitlines()
    fields: dict[str, set[int]] = {}
    for line in sentences:
        fields.setdefault(line[:6], set()).add(line.count(","))
    gnss = Gnss(GnssSpec(first_fix_s=1), seed=1)
    for t in range(3):
        for line in gnss.epoch(float(t), 0, 0, 0.5, 0):
            assert line.count(",") in fields[line[:6]], line
    without = {
        line for line in sentences if line.startswith(("$GPGGA,,", "$GPRMC,,V", "$GPGSA,A,1"))
    }
    lost = Gnss(GnssSpec(first_fix_s=9)).epoch(0.0, 0, 0, 0, 0)
    assert {lost[-1], lost[-2], lost[-4]} == without


def test_the_checksum_is_the_exclusive_or_of_the_body() -> None:
    assert sentence("GPGGA,,,,,,0,,,,,,,,") == "$GPGGA,,,,,,0,,,,,,,,*66"
