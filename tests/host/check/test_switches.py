"""Facts about the check's steering step, on a board whose wheel goes where the test says."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, cast

import pytest

from host.check.lines import Hands, Line, Question
from host.check.notes import Notes
from host.check.switches import steering
from host.core.messages import Command, Request, State, Telemetry

STILL = Telemetry(
    stamp=0.0, state=State.SAFE, faults=0, setpoint_rad=0.0, angle_rad=0.0, steer_duty=0,
    drive_duty=0, blade=False, speed_mps=0.0, distance_m=0.0, battery_v=12.6, last_seq=0,
    frames_bad=0, firmware_s=0.0,
)  # fmt: skip


class Wheel:
    """The hands of a check. `off_deg` says how far the wheel is from where it was sent, so many
    seconds after."""

    def __init__(self, off_deg: Callable[[float], float]) -> None:
        self._off_deg = off_deg
        self._now = self._sent_at = 0.0
        self._asked = Command(Request.STOP)
        self.telemetry = STILL

    def clock(self) -> float:
        return self._now

    def send(self, command: Command) -> None:
        if command.steer_rad != self._asked.steer_rad:
            self._sent_at = self._now
        self._asked = command

    def pump(self, seconds: float) -> list[Telemetry]:
        self._now += seconds
        off = math.radians(self._off_deg(self._now - self._sent_at))
        way = math.copysign(1.0, self._asked.steer_rad)
        stands = self._asked.request is Request.STOP
        self.telemetry = Telemetry(
            **{n: getattr(STILL, n) for n in STILL.__dataclass_fields__}
            | {
                "state": State.SAFE if stands else State.ARMED,
                "angle_rad": self._asked.steer_rad + way * off,
            }
        )
        return [self.telemetry]

    def operator(self, _question: Question, _until: object = None) -> str:
        return "left"

    def show(self, _lines: Sequence[Line]) -> None: ...


def settles(after_s: float) -> float:
    """Swings more than half of a step past it, then rests."""
    return 30.0 * math.exp(-3.0 * after_s)


def restless(after_s: float) -> float:
    """Never rests but when the first step is read, and hardly swings past."""
    return 0.0 if 1.7 < after_s < 1.95 else 2.5 * math.sin(40.0 * after_s)


@pytest.mark.parametrize(
    ("off_deg", "finding"),
    [
        (lambda _: 0.0, "gains.ok"),
        (settles, "gains.swing"),
        (restless, "gains.swing"),
        (lambda _: 4.0, "steering.short"),
    ],
    ids=["tuned", "swings", "restless", "short"],
)
def test_how_the_wheel_settles_is_judged(off_deg: Callable[[float], float], finding: str) -> None:
    notes = Notes(cast(Hands, Wheel(off_deg)))
    steering(notes)
    assert notes.lines[-1].finding == finding


def values_of(notes: Notes, name: str) -> dict[str, Any]:
    return next(line.values for line in notes.lines if line.name == name)


def test_what_was_seen_stands_in_the_line() -> None:
    notes = Notes(cast(Hands, Wheel(lambda _: 1.0)))
    steering(notes)
    assert values_of(notes, "steering") == {"asked": 25.0, "reached": 26.0}
