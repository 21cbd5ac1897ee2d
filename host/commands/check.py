"""`daranti check`: walks the check in the terminal; the same list as on the panel."""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

import click

from host.check.laptop import Laptop
from host.check.lines import Line, Question, Target, green
from host.check.walk import walk
from host.commands.options import (
    camera_option,
    field_option,
    gap_option,
    gnss_option,
    gyro_option,
    inset_option,
    mode_option,
    mount_option,
    port_option,
    vehicle_option,
)
from host.core.errors import UserError
from host.core.messages import Command, Fix, Telemetry, Turned
from host.core.number_range import WholeRange
from host.core.terminal import echo
from host.core.vehicle import Mount, Vehicle
from host.core.vehicle_file import load_vehicle
from host.field.boundary_file import load_field
from host.link import protocol
from host.link.port import check_port
from host.link.session import Answer, Link
from host.panel.texts import LANGUAGES, text, texts
from host.runs.errand import chosen_corner
from host.runs.ready import make_ready_visibly
from host.sensors.camera_stream import Picture, camera_feed
from host.sensors.gyro import gyro_of
from host.sensors.newest import Feed
from host.sensors.nmea import gnss_feed
from host.tune.follow_margins import check_steady
from host.vision.mounted.detector import Mode
from host.vision.mounted.in_view import seeing_mount

MARKS: Final = {"ok": "✓", "bad": "✗", "warn": "!", "skipped": "–"}


class TerminalHands(Laptop):
    """Devices of this process, the operator at the keyboard."""

    def __init__(
        self,
        link: Link,
        vehicle: Vehicle,
        mount: Mount,
        mode: Mode,
        camera: Feed[Picture] | None,
        gnss: Feed[Fix] | None,
        gyro: Feed[Turned] | None,
        language: str,
        clock: Callable[[], float],
    ) -> None:
        super().__init__(camera, gnss, gyro, Path())
        self.vehicle, self.mount, self.mode = vehicle, mount, mode
        self._link = link
        self._language = language
        self._clock = clock
        self._said = 0
        self._problem = ""

    def clock(self) -> float:
        """Seconds."""
        return self._clock()

    def pump(self, seconds: float) -> list[Telemetry]:
        """Lets time pass."""
        end = self._clock() + seconds
        arrived: list[Telemetry] = []
        while True:
            try:
                if self._link.session.version is None:
                    self._link.forward(self._link.session.hello(self._clock()))
                arrived += self._link.poll(max(0.0, min(0.02, end - self._clock())))
            except UserError as error:
                self._problem = str(error)
                time.sleep(0.02)
            if self._clock() >= end:
                return arrived

    @property
    def telemetry(self) -> Telemetry | None:
        """The board's latest word."""
        return self._link.session.telemetry

    @property
    def version(self) -> protocol.Version | None:
        """Who the board says it is."""
        return self._link.session.version

    @property
    def board_problem(self) -> str:
        """Why it does not answer."""
        return self._problem or ("" if self.telemetry is not None else "silent")

    def send(self, command: Command) -> None:
        """To the board."""
        self._link.send(command)

    def ask_board(self, message: protocol.Message) -> Answer:
        """A request and its answer."""
        return self._link.ask(message)

    def operator(
        self, question: Question, until: Callable[[], bool] | None = None
    ) -> str | float | None:
        """Asks at the terminal; the board is listened to meanwhile."""
        say = self._text
        echo("\n" + say(f"ask.{question.key}", **question.values))
        for at, choice in enumerate(question.choices, start=1):
            echo(f"  {at}  {say(f'answer.{choice}')}")
        typed: deque[str] = deque()
        threading.Thread(
            target=lambda: typed.append(sys.stdin.readline()), daemon=True, name="answer"
        ).start()
        while not typed:
            self.pump(0.05)
            if until is not None and until():
                return None
        answer = typed.popleft().strip().replace(",", ".")
        try:
            number = float(answer)
        except ValueError:
            return None
        if not question.choices:
            return number
        index = int(number) - 1
        return question.choices[index] if 0 <= index < len(question.choices) else None

    def _text(self, key: str, **values: Any) -> str:
        return text(self._language, key, **values)

    def show(self, lines: Sequence[Line]) -> None:
        """Prints what is new."""
        known = texts(self._language)
        for line in lines[self._said :]:
            values = {key: self._words(value, known) for key, value in line.values.items()}
            echo(f"{MARKS[line.verdict]} {self._text(f'line.{line.name}')}", nl=False)
            seen = self._text(f"found.{line.finding}", **values) if line.finding else ""
            echo(f": {seen}" if seen else "")
            if line.verdict in ("bad", "warn"):
                expected = self._text(f"expected.{line.name}", **values)
                todo = self._text(f"todo.{line.finding}", **values)
                echo(f"    {self._text('check.expected')} {expected}")
                echo(f"    {self._text('check.todo')} {todo}")
        self._said = len(lines)

    def _words(self, value: Any, known: dict[str, str]) -> Any:
        if isinstance(value, list):
            return "; ".join(str(self._words(one, known)) for one in value)
        return known.get(str(value), value)


@click.command()
@port_option
@camera_option
@gnss_option
@gyro_option
@vehicle_option
@mount_option
@mode_option
@click.option("--boundary", type=click.Path(path_type=Path), help="The field's file.")
@field_option
@gap_option
@inset_option
@click.option("--corner", type=WholeRange(0), default=0, show_default=True)
@click.option("--language", type=click.Choice(LANGUAGES), default="en", show_default=True)
def check(
    port: str,
    camera: str | None,
    gnss: str | None,
    gyro: str | None,
    vehicle: Path | None,
    mount: str,
    mode: Mode,
    boundary: Path | None,
    chosen: str,
    gap: float | None,
    inset: float,
    corner: int,
    language: str,
) -> None:
    """Checks the machine before a harvest: it moves by itself, with the blade's supply off.

    Exits with 0 when every line is well."""
    machine = load_vehicle(vehicle)
    check_steady(machine)
    mounted = seeing_mount(machine, mount)
    check_port(port)
    field = load_field(boundary, chosen) if boundary is not None else None
    chosen_corner(field, boundary, corner or None, gap, inset, None)
    begun = time.monotonic()

    def clock() -> float:
        return time.monotonic() - begun

    events: deque[str] = deque(maxlen=50)
    pictures = camera_feed(camera, clock, events.append) if camera else None
    fixes = gnss_feed(gnss, clock, events.append)[0] if gnss else None
    turns = gyro_of(gyro, camera or "", clock, events.append)
    make_ready_visibly()
    with ExitStack() as stack:
        link = stack.enter_context(Link(port, clock))
        for feed in (pictures, fixes, turns):
            if feed is not None:
                stack.callback(feed.close)
                feed.start()
        hands = TerminalHands(link, machine, mounted, mode, pictures, fixes, turns, language, clock)
        lines = walk(hands, Target(boundary, gap, corner, inset, chosen))
    bad = sum(line.verdict == "bad" for line in lines)
    if not green(lines):
        raise UserError(text(language, "check.red", count=bad))
    echo(text(language, "check.green"))
