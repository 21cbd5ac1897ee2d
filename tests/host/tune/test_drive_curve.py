"""Facts about the drive's curve: what legs there and back, and starts, tell of it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.errors import UserError
from host.core.vehicle import Vehicle
from host.tune.drive_curve import DriveCurve, Leg, Start, drive_curve, drive_lag_s

FULL = st.floats(0.5, 2.5)
DEAD = st.floats(0.0, 0.3)


def leg(full: float, dead: float, speed: float, slope: float = 0.0) -> Leg:
    """At a speed; `slope`: the share of the duty that the ground takes."""
    return Leg(dead + slope + speed / full * (1.0 - dead), speed, 0.002)


@given(FULL, DEAD, st.floats(-0.08, 0.08))
def test_ways_there_and_back_tell_the_curve_on_any_slope(
    full: float, dead: float, slope: float
) -> None:
    both = [
        [leg(full, dead, speed, slope), leg(full, dead, speed, -slope)]
        for speed in (0.16 * full, 0.4 * full)
    ]
    found = drive_curve(*both)
    assert found.full_mps == pytest.approx(full, rel=1e-6)
    assert found.dead == pytest.approx(dead, abs=1e-6)
    told = found.told(Vehicle())
    assert told.duty_speed(255, told.nominal_battery_v) == pytest.approx(full, abs=1e-3)
    assert told.duty_speed(round(255 * dead), told.nominal_battery_v) <= 0.006 * full


@given(FULL, DEAD)
def test_firmware_and_vehicle_file_are_told_the_same(full: float, dead: float) -> None:
    curve = DriveCurve(full, 0.0, dead, 0.0)
    told, params = curve.told(Vehicle()), curve.params()
    assert params["speed_full"] == told.full_duty_speed_mps
    assert params["drive_min_duty"] == pytest.approx(255 * told.dead_duty, abs=0.7)
    assert "drive_lag" not in params, "nobody has measured it"
    assert told.drive_lag_s == Vehicle().drive_lag_s
    lags = curve.with_lag(0.42)
    assert lags.params()["drive_lag"] == lags.told(Vehicle()).drive_lag_s == 0.42


def test_it_is_as_sure_as_its_legs() -> None:
    rough = [[Leg(0.3, 0.2, 0.02)] * 2, [Leg(0.55, 0.5, 0.02)] * 2]
    fine = [[Leg(0.3, 0.2, 0.002)] * 2, [Leg(0.55, 0.5, 0.002)] * 2]
    assert drive_curve(*rough).full_sigma > 2 * drive_curve(*fine).full_sigma
    assert drive_curve(*rough).dead_sigma > 2 * drive_curve(*fine).dead_sigma
    # by hand: d(dead)/d(slow duty) = fast speed / (fast less slow), of a 255th, two legs
    least = 0.5 / 0.3 / 255 / np.sqrt(2)
    assert drive_curve(*fine).dead_sigma >= least


@pytest.mark.parametrize(
    ("slow", "fast"),
    [
        (Leg(0.3, 0.2, 0.01), Leg(0.35, 0.25, 0.01)),
        (Leg(0.5, 0.2, 0.01), Leg(0.4, 0.5, 0.01)),
    ],
)
def test_ways_that_make_no_line_are_refused(slow: Leg, fast: Leg) -> None:
    with pytest.raises(UserError, match="do not tell"):
        drive_curve([slow, slow], [fast, fast])


def test_a_drive_that_drags_is_named_and_not_taken_for_a_better_one() -> None:
    with pytest.raises(UserError, match="needs 50 % of the full duty only to move"):
        drive_curve([leg(1.5, 0.5, 0.2)], [leg(1.5, 0.5, 0.5)])


@pytest.mark.parametrize("lag", [0.1, 0.3, 0.7])
def test_starts_on_bumps_of_their_own_tell_the_lag(lag: float) -> None:
    curve = DriveCurve(1.2, 0.0, 0.1, 0.0)
    stamps = np.arange(0.0, 4.0, 0.02)
    starts = []
    for bump in (-0.03, 0.0, 0.04):
        duties = np.minimum(0.5, 0.15 + 0.4 * stamps)
        target = 1.2 / 0.9 * np.maximum(0.0, duties - 0.1 - bump)
        speed = np.zeros(len(stamps))
        for k in range(len(stamps) - 1):
            speed[k + 1] = speed[k] + (target[k] - speed[k]) * (1 - np.exp(-0.02 / lag))
        way = np.cumsum(speed) * 0.02
        starts.append(Start(stamps, duties, np.floor(way * 50) / 50))
    assert drive_lag_s(starts, curve) == pytest.approx(lag, rel=0.15, abs=0.02)
