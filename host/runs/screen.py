"""What the operator sees of a run, and the keys that reach it."""

from __future__ import annotations

import math
import os
import select
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TextIO, cast

from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from host.core.messages import State
from host.core.terminal import Outlet, PlainConsole, plain
from host.link import protocol
from host.pilot.phase import Phase
from host.pilot.pilot import PAUSED
from host.runs.drive import Drive
from host.sensors.nmea import Receiver

SHOW_S = 0.2
"""Between drawings of the live screen."""

_STYLES = {Phase.FOLLOW: "bold green", Phase.FINISHED: "bold green", Phase.FAULT: "bold red"}


def status(drive: Drive, receiver: Receiver | None) -> Table:
    """The run at a glance."""
    pilot, view, telemetry = drive.pilot, drive.pilot.view, drive.telemetry
    table = Table.grid(padding=(0, 2))
    reason = f"{PAUSED}; Enter goes on" if pilot.paused else pilot.reason
    table.add_row("pilot", Text(pilot.phase.value, _STYLES.get(pilot.phase, "bold")), reason)
    if view is not None:
        table.add_row(
            "edge",
            f"{view.edge_offset_m:+.2f} m" if math.isfinite(view.edge_offset_m) else "not seen",
            f"confidence {view.confidence:.2f} {view.reason}".rstrip(),
        )
    command = drive.command
    table.add_row(
        "command",
        command.request.value,
        f"{command.speed_mps:+.2f} m/s, steer {_degrees(command.steer_rad)}, blade "
        f"{'on' if command.blade else 'off'}",
    )
    if telemetry is not None:
        table.add_row(
            "machine",
            Text(telemetry.state.name, "bold red" if telemetry.state is State.FAULT else ""),
            f"steer {_degrees(telemetry.angle_rad)}, battery {telemetry.battery_v:.1f} V"
            + (f", {drive.link.session.refusal}" if drive.link.session.refusal else ""),
        )
        for text in protocol.fault_texts(protocol.Fault(telemetry.faults)):
            table.add_row("fault", "", Text(text, "red"))
    table.add_row(
        "camera",
        plain(drive.camera.problem or "ok"),
        f"{drive.pictures} pictures, {drive.pictures_bad} bad, "
        f"{drive.pictures_repeated} repeated; longest step "
        f"{drive.step_s * 1e3:.0f} ms, {drive.late} late",
    )
    if drive.gnss is not None and receiver is not None:
        fix = drive.fix
        where = f"{fix.lat_deg:.6f} {fix.lon_deg:.6f}, quality {fix.quality}" if fix else "no fix"
        bad = sum(receiver.bad.values())
        table.add_row("GNSS", drive.gnss.problem or "ok", f"{where}; {bad} bad sentences")
    if drive.gyro is not None:
        by_gyro = drive.pilot.motion.by_gyro
        used = "tells what the machine turns" if by_gyro else "not used: the steering angle does"
        table.add_row("gyroscope", plain(drive.gyro.problem or "ok"), used)
    return table


def _degrees(rad: float) -> str:
    return f"{rad * 57.29578:+.1f}°"


class Keyboard:
    """Enter pauses, Enter again goes on. Without a terminal nothing ever does."""

    def __init__(self, terminal: TextIO) -> None:
        self._file = terminal.fileno() if terminal.isatty() else None
        self._paused = False

    def __call__(self) -> bool:
        """Whether the machine is to stand still; returns at once."""
        while self._file is not None and select.select([self._file], [], [], 0)[0]:
            try:
                line = os.read(self._file, 4096)
            except OSError:  # the terminal is gone; its hang-up ends the run
                self._file = None
                break
            if not line:
                break
            self._paused ^= line.endswith(b"\n")
        return self._paused


class Screen:
    """Live status on a terminal; elsewhere one line at each change of what the pilot does."""

    def __init__(
        self, clock: Callable[[], float], events: deque[str], receiver: Receiver | None
    ) -> None:
        """`events`: lines from other threads, to be shown at the next step."""
        self._events = events
        self._outlet = Outlet(sys.stdout)
        self._console = PlainConsole(file=cast(TextIO, self._outlet))
        self._clock = clock
        self._receiver = receiver
        self._live: Live | None = None
        self._shown = -SHOW_S
        self._last = ""

    @contextmanager
    def open(self) -> Iterator[None]:
        """Shows until left."""
        if not self._console.is_terminal:
            yield
            return
        with Live(console=self._console, auto_refresh=False) as self._live:
            yield
        self._live = None

    def say(self, line: str) -> None:
        """One line that stays."""
        self._console.print(f"{self._clock():7.1f} s  {line}", soft_wrap=True)

    def bell(self, sound: str) -> None:
        """Makes the terminal sound."""
        self._outlet.write(sound)

    def last(self, drive: Drive) -> None:
        """What is left when a run has ended."""
        if self._live is not None:
            self._live.update(Group(status(drive, self._receiver)), refresh=True)

    def close(self) -> None:
        """Waits a moment for the last lines."""
        self._outlet.drain()

    def show(self, drive: Drive) -> None:
        """Called at every step; draws five times a second."""
        now = self._clock()
        while self._events:
            self.say(self._events.popleft())
        reason = PAUSED if drive.pilot.paused else drive.pilot.reason
        line = f"{drive.pilot.phase.value}: {reason}"
        if line != self._last:
            self._last = line
            self.say(line)
        if self._live is not None and now - self._shown >= SHOW_S:
            self._shown = now
            self._live.update(Group(status(drive, self._receiver)), refresh=True)
            drive.step_s = 0.0
