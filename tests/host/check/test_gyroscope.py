"""What the check says of the phone's gyroscope."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import pytest

from host.check.gyroscope import REST_S, gyroscope
from host.check.lines import Hands, Line
from host.check.notes import Notes
from host.core.messages import Turned

PERIOD_S = 0.1


class Phone:
    """The part of the hands that a gyroscope is asked through; it speaks every 0.1 s."""

    def __init__(self, dps: float | None, *, breaks_s: float = math.inf, problem: str = "") -> None:
        self.now = 0.0
        self.gyro_problem = problem
        self._dps, self._breaks_s = dps, breaks_s

    def clock(self) -> float:
        return self.now

    def pump(self, seconds: float) -> list[object]:
        self.now += seconds
        return []

    def turned(self) -> Turned | None:
        if self._dps is None:
            return None
        since = self.now - self.now % self._breaks_s if math.isfinite(self._breaks_s) else 0.0
        return Turned(self.now, math.radians(self._dps) * (self.now - since), since)

    def show(self, lines: Sequence[Line]) -> None:
        del lines


def said(phone: Phone) -> Line:
    notes = Notes(cast(Hands, phone))
    gyroscope(notes)
    (line,) = notes.lines
    return line


def test_a_quiet_one_is_well() -> None:
    line = said(Phone(0.4))
    assert (line.verdict, line.finding) == ("ok", "gyroscope.ok")
    assert line.values["dps"] == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("phone", "finding"),
    [
        (Phone(None, problem="the app gives no sensors"), "gyroscope.none"),
        (Phone(None), "gyroscope.none"),
        (Phone(-8.0), "gyroscope.restless"),
        (Phone(0.1, breaks_s=REST_S / 2), "gyroscope.slow"),
    ],
)
def test_what_is_wrong_with_it_is_named_and_keeps_nothing_from_starting(
    phone: Phone, finding: str
) -> None:
    line = said(phone)
    assert (line.verdict, line.finding) == ("warn", finding)
    assert phone.now < 8.0
