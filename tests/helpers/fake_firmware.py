"""A stand-in for the firmware at the far end of a pseudo-terminal: answers, and remembers.

Only for the host's own tests of its serial side; the real firmware is proven elsewhere.
"""

from __future__ import annotations

import contextlib
import os
import pty
import select
import threading
import time
import tty
from dataclasses import replace

from host.core.vehicle import Vehicle
from host.link import protocol

RESTING = protocol.Telemetry(
    time=0.0,
    state=protocol.State.SAFE,
    faults=protocol.Fault(0),
    setpoint=0.0,
    angle=0.0,
    steer_duty=0,
    drive_duty=0,
    blade=0,
    speed=0.0,
    distance=0.0,
    battery=12.0,
    last_seq=0,
    frames_bad=0,
)
PERIOD_S = 0.02


class FakeFirmware:
    """Serves one pseudo-terminal in a thread; `port` is what the host opens."""

    def __init__(
        self, *, version: int = protocol.VERSION, silent: bool = False, babble: bytes = b""
    ) -> None:
        """`silent`: hears and never answers; `babble`: somebody else's device, which answers so."""
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self.received: list[protocol.Message] = []
        self.changed = threading.Condition()
        self.telemetry = RESTING
        self.readings: protocol.Readings | None = None
        self.refuse: dict[type[protocol.Message], protocol.Result] = {}
        self.stale: protocol.Result | None = None
        """When set, late answers to the request before, with this result, surround each Ack."""
        self.deaf_to: dict[type[protocol.Message], int] = {}
        """How many messages of a kind are lost before one is heard."""
        self.params = {spec.id: spec.default_raw for spec in protocol.PARAMS.values()}
        hall = protocol.PARAMS["hall_per_metre"]
        self.params[hall.id] = hall.to_raw(Vehicle().hall_pulses_per_m)  # as the workshop set it
        self.log: list[protocol.LogEntry] = []
        """The fault log, newest first."""
        self.minor = 1
        """Of the firmware's version 2."""
        self._version = version
        self._silent = silent or bool(babble)
        self._babble = babble
        self._parser = protocol.Parser()
        self._seq = 0
        self.mute = threading.Event()
        """When set, nothing is sent any more."""
        self.echo = threading.Event()
        """When set, telemetry names the last command taken, as the firmware's does."""
        self._begun = time.monotonic()
        self._pulled = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def wait_for(self, kind: type[protocol.Message], timeout_s: float = 10.0) -> bool:
        """Whether a message of this kind came, waiting for it."""
        with self.changed:
            return self.changed.wait_for(
                lambda: any(isinstance(message, kind) for message in self.received), timeout_s
            )

    @property
    def moved(self) -> bool:
        """Whether it was told to arm, to drive or to cut."""
        return any(
            isinstance(each, protocol.Arm)
            or (isinstance(each, protocol.Drive) and (each.speed != 0 or each.blade))
            for each in self.received
        )

    def unplug(self) -> None:
        """The cable is pulled: the port's other end is gone."""
        if not self._pulled.is_set():
            self._pulled.set()
            self._thread.join()
            os.close(self._master)
            os.close(self._slave)

    def reset(self) -> None:
        """The controller restarts: its clock begins again."""
        self._begun = time.monotonic()

    def write(self, data: bytes) -> None:
        """Raw bytes to the host."""
        with contextlib.suppress(BlockingIOError):  # nobody reads: what does not fit is lost
            os.write(self._master, data)

    def _send(self, message: protocol.Message) -> None:
        self.write(protocol.encode(message, self._seq))
        self._seq = (self._seq + 1) % 256

    def _serve(self) -> None:
        due = self._begun
        while not self._pulled.is_set():
            wait_s = max(0.0, due - time.monotonic())
            ready, _, _ = select.select([self._master], [], [], wait_s)
            if ready:
                if self._babble:
                    self.write(self._babble)
                for seq, message in self._parser.feed(os.read(self._master, 4096)):
                    self._take(seq, message)
            if time.monotonic() >= due:
                due += PERIOD_S
                if not self._silent and not self.mute.is_set():
                    if self.readings is not None:
                        self._send(self.readings)
                    self._send(replace(self.telemetry, time=due - self._begun))

    def _take(self, seq: int, message: protocol.Message) -> None:
        if self.deaf_to.get(type(message), 0) > 0:
            self.deaf_to[type(message)] -= 1
            return
        if self.echo.is_set():
            self.telemetry = replace(self.telemetry, last_seq=seq)
        with self.changed:
            self.received.append(message)
            self.changed.notify_all()
        if self._silent:
            return
        result = self.refuse.get(type(message), protocol.Result.OK)
        match message:
            case protocol.Hello():
                self._send(protocol.Version(self._version, 2, self.minor, 1, 1, 0, 0))
            case protocol.ParamGet(param):
                if param in self.params:
                    self._send(protocol.ParamValue(param, self.params[param]))
                else:
                    self._send(protocol.Ack(message.ID, seq, protocol.Result.UNKNOWN))
            case protocol.LogGet(index):
                none = protocol.LogEntry(
                    index, 0, protocol.Fault(0), 0, protocol.ResetCause(0), protocol.State.SAFE
                )
                self._send(self.log[index] if index < len(self.log) else none)
            case protocol.Drive():
                pass
            case _:
                if isinstance(message, protocol.ParamSet) and result is protocol.Result.OK:
                    self.params[message.param] = message.value
                if isinstance(message, protocol.ParamDefaults) and result is protocol.Result.OK:
                    for spec in protocol.PARAMS.values():
                        self.params[spec.id] = spec.default_raw
                if isinstance(message, protocol.LogClear) and result is protocol.Result.OK:
                    self.log.clear()
                late = self.stale
                for asked, answer in ((seq - 1, late), (seq, result), (seq - 1, late)):
                    if answer is not None:
                        self._send(protocol.Ack(message.ID, asked % 256, answer))
