"""The builder's table of bridges against the makers' data sheets."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).parents[2]
PAGE: Final = (ROOT / "docs" / "build" / "README.md").read_text(encoding="utf-8")
STANDS_A: Final = {"L298N": (2 * 2.0, 2 * 2.5), "BTS7960": (33.0, 33.0), "VNH5019": (12.0, 30.0)}
"""Mean and for 50 ms, which is how long the firmware lets a peak last. L298 (2000), absolute
maximum ratings: 2 A DC and 2.5 A repetitive (8 of 10 ms) a channel. BTS7960B Rev 1.1, 4.3.8: its
low side limits itself from 33 A on when hot. Pololu 1451 for the carrier."""
SENSED_MAX_MV: Final = 4.0 * 1000.0
"""BTS7960B 4.4.7: at least 4 mA, and that into 1 kOhm."""


@pytest.mark.parametrize("bridge", STANDS_A)
def test_a_bridge_is_never_told_to_give_more_than_it_stands(bridge: str) -> None:
    (row,) = re.findall(rf"^\| ({bridge}.*)$", PAGE, re.MULTILINE)
    mean_a, peak_a = STANDS_A[bridge]
    _, continuous, peak, _, told = (cell.strip() for cell in row.strip("|").split("|"))
    said = dict(re.findall(r"current_(cont|max) ([\d.]+)", told))
    assert float(said["cont"]) <= float(re.findall(r"[\d.]+(?= A)", continuous)[0]) <= mean_a
    assert float(said["max"]) <= float(re.findall(r"[\d.]+(?= A)", peak)[0]) <= peak_a


def test_a_bts7960_s_sense_shows_the_limit_that_it_is_told() -> None:
    scale = re.findall(r"steer_current_scale (\d+)", PAGE)[0]
    (limit,) = re.findall(r"^\| BTS7960.*current_max ([\d.]+)", PAGE, re.MULTILINE)
    assert float(limit) * float(scale) <= SENSED_MAX_MV
