"""What a check reports: one line a thing that was looked at, in names of texts and figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, Protocol

from host.core.messages import Command, Fix, Telemetry, Turned
from host.core.vehicle import Mount, Vehicle
from host.link import protocol
from host.link.session import Answer
from host.sensors.camera_stream import Picture
from host.vision.mounted.detector import Mode

Verdict = Literal["ok", "bad", "warn", "skipped"]
Values = dict[str, Any]

NAMES: Final = (
    "vehicle",
    "field",
    "disk",
    "power",
    "port",
    "firmware",
    "faults",
    "parameters",
    "bridge",
    "pot",
    "battery",
    "camera",
    "picture",
    "laptop",
    "receiver",
    "place",
    "gyroscope",
    "estop",
    "steering",
    "gains",
    "stops",
    "drive",
    "hall",
    "load",
    "course",
    "delay",
    "mount",
    "blade",
)
"""All lines, in their order."""


@dataclass(frozen=True, slots=True)
class Target:
    """Which field, from which corner."""

    boundary: Path | None
    gap_m: float | None
    corner: int
    inset_m: float = 0.0
    field: str = ""
    """Which of the boundary's fields."""


@dataclass(frozen=True, slots=True)
class Line:
    """`finding` names the texts of what was seen and what to do; `values` fill them in."""

    name: str
    verdict: Verdict
    finding: str = ""
    values: Values = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Question:
    """What only the operator can see or do. An empty `choices` asks for a number."""

    key: str
    choices: tuple[str, ...] = ()
    values: Values = field(default_factory=dict)


class Hands(Protocol):
    """All that a check can touch: board, camera, receiver, laptop and the operator."""

    vehicle: Vehicle
    mount: Mount
    mode: Mode

    def clock(self) -> float:
        """Seconds."""
        ...

    def pump(self, seconds: float) -> list[Telemetry]:
        """Lets time pass; the telemetry that came."""
        ...

    @property
    def telemetry(self) -> Telemetry | None:
        """The board's latest word."""
        ...

    @property
    def version(self) -> protocol.Version | None:
        """Who the board says it is; None until it does."""
        ...

    @property
    def board_problem(self) -> str:
        """Why the board does not answer, in words; empty where it does."""
        ...

    def send(self, command: Command) -> None:
        """To the board."""
        ...

    def ask_board(self, message: protocol.Message) -> Answer:
        """A request and its answer. Raises UserError where there is none."""
        ...

    def picture(self) -> Picture | None:
        """The camera's newest, once."""
        ...

    @property
    def camera_problem(self) -> str:
        """Why no picture comes."""
        ...

    def fix(self) -> Fix | None:
        """The receiver's newest, once."""
        ...

    @property
    def gnss_problem(self) -> str:
        """Why no position comes."""
        ...

    def turned(self) -> Turned | None:
        """The gyroscope's newest, once."""
        ...

    @property
    def gyro_problem(self) -> str:
        """Why it says nothing."""
        ...

    def free_bytes(self) -> int:
        """Room on the disk that records go to."""
        ...

    def power(self) -> tuple[int, bool] | None:
        """The laptop's battery in percent, and whether it is being charged; None without one."""
        ...

    def busy_s(self) -> float:
        """Processor time of this thread: how long a step takes on this laptop."""
        ...

    def operator(
        self, question: Question, until: Callable[[], bool] | None = None
    ) -> str | float | None:
        """The operator's answer; None once `until` holds, or where nobody answers."""
        ...

    def show(self, lines: Sequence[Line]) -> None:
        """What is known so far."""
        ...


def green(lines: Sequence[Line]) -> bool:
    """Whether every line was looked at and none is wrong."""
    names = {line.name for line in lines if line.verdict in ("ok", "warn")}
    return names >= set(NAMES)
