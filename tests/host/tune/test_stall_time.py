"""Facts about the time after which a steering that shows no movement is a fault."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from host.link import protocol
from host.tune import stall_time
from host.tune.stall_time import share_at_least_duty, stall_time_ms

CORE = Path(__file__).parents[3] / "firmware" / "src" / "core"
SUPERVISOR = CORE / "supervisor.h", CORE / "supervisor.cpp"


@pytest.mark.parametrize(
    ("slew_degps", "backlash_deg", "ms"),
    [
        (20.0, 2.0, 288.0),
        (45.0, 1.0, 183.0),  # a new one's play counts as a worn one's
        (45.0, 3.0, 211.0),
        (60.0, 0.5, 162.0),
    ],
)
def test_it_is_the_lag_and_the_play_and_a_degree_at_four_fifths_of_the_speed(
    slew_degps: float, backlash_deg: float, ms: float
) -> None:
    assert stall_time_ms(slew_degps, backlash_deg) == ms


def test_it_stays_within_the_parameters_range() -> None:
    spec = protocol.PARAMS["stall_time"]
    assert stall_time_ms(0.1, 2.0) == spec.from_raw(spec.max_raw)
    assert stall_time_ms(1e6, 2.0) == stall_time_ms(1e9, 2.0) == 100.0


@pytest.mark.parametrize(
    ("least", "friction", "breakaway", "share"),
    [
        (38.0, 34.0, 45.0, 1.0),  # the default motor's friction is compensated well
        (45.0, 62.0, 82.0, 0.626),  # (85 - 62) / 193 of full speed, where 40 / 210 is expected
        (20.0, 75.0, 100.0, 0.5),  # (100 - 75) / 180, where 80 / 235 is expected
    ],
)
def test_a_stiff_motor_is_waited_for_as_its_friction_takes_more_of_a_small_duty(
    least: float, friction: float, breakaway: float, share: float
) -> None:
    assert share_at_least_duty(least, friction, breakaway) == pytest.approx(share, abs=1e-3)
    waited = stall_time_ms(40.0, 2.0, share) - 100.0
    assert waited == pytest.approx((stall_time_ms(40.0, 2.0) - 100.0) / share, abs=1.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [("kDrivenHard", stall_time.JUDGED_DUTY), ("kLagMs", stall_time.LAG_MS),
     ("kFullDuty", stall_time.FULL_DUTY)],
)  # fmt: skip
def test_it_reckons_with_what_the_firmware_does(name: str, value: float) -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in SUPERVISOR)
    found = re.search(rf"{name} = (\d+);", text)
    assert found is not None
    assert float(found[1]) == value
