"""What the check says of the receiver of positions."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import cast

import pytest

from host.check.lines import Hands, Line
from host.check.notes import Notes
from host.check.receiver import receiver
from host.core.messages import Fix


class Phone:
    """The part of the hands that a receiver is asked through; it speaks once a second."""

    gnss_problem = ""

    def __init__(self, quality: int, hdop: float, satellites: int) -> None:
        self.now = 0.0
        self._told = 0
        self._fix = quality, hdop, satellites

    def clock(self) -> float:
        return self.now

    def pump(self, seconds: float) -> list[object]:
        self.now += seconds
        return []

    def fix(self) -> Fix | None:
        if self.now < self._told + 1:
            return None
        self._told += 1
        return Fix(self.now, 31.5, 74.3, *self._fix)

    def show(self, lines: Sequence[Line]) -> None:
        json.dumps([line.values for line in lines], allow_nan=False)  # as the panel's page has it


@pytest.mark.parametrize(
    ("quality", "hdop", "satellites", "verdict", "finding"),
    [
        (1, 0.9, 8, "ok", "receiver.ok"),
        (1, 0.9, 4, "bad", "receiver.poor"),
        (1, 6.0, 8, "bad", "receiver.poor"),
        pytest.param(1, math.nan, 4, "bad", "receiver.poor", id="no HDOP said"),
        pytest.param(1, math.nan, 0, "warn", "receiver.unrated", id="RMC alone"),
        (0, math.nan, 0, "bad", "receiver.no_fix"),
    ],
)
def test_what_a_receiver_says_of_itself_is_judged(
    quality: int, hdop: float, satellites: int, verdict: str, finding: str
) -> None:
    notes = Notes(cast(Hands, Phone(quality, hdop, satellites)))
    receiver(notes, None, 0)
    line = notes.lines[0]
    assert (line.verdict, line.finding) == (verdict, finding)
