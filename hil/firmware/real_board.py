"""A real board on a serial port, in the place of the simulated microcontroller.

It runs the `uno_hil` build: the plant's sensors reach it as HilSensors frames on the same line that
carries the host's, and what its outputs would be comes back as HilOutputs; its own outputs stay
off. It keeps its own time, so only the wall-clock rig can use it.

The host's frames pass through as they are; between them, once every slice, goes one of the
plant's, and of what the board says the host gets everything but the answers to those. Sequence
numbers in telemetry are those of both speakers.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Final, Protocol

import numpy as np

from hil.firmware import coupling
from hil.firmware.targets import ResetCause
from host.core.errors import UserError
from host.link import protocol
from host.link.session import Direction, Link
from sim_plant import machine

PREFIX: Final = "serial:"
BUILD: Final = 2
"""Of `uno_hil` in Version."""
SILENCE_US: Final = 1_000_000
"""Of the simulated time, after which a board that does not answer is lost."""


class Controller(Protocol):
    """What a bench asks of the thing that runs the firmware, besides running it."""

    def write(self, data: bytes) -> int: ...

    def read(self) -> bytes: ...

    def reset(self, cause: ResetCause = ...) -> None: ...

    def hang(self) -> None: ...

    def close(self) -> None: ...


class Frames:
    """Cuts a stream of bytes into whole frames, their zeros included."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        """The frames that these bytes complete."""
        *whole, self._rest = (self._rest + data).split(b"\0")
        return [frame + b"\0" for frame in whole]


class Board:
    """The board, met and given its parameters (they are not stored)."""

    def __init__(
        self, port: str, parameters: Mapping[str, float] | None = None, *, wait_s: float = 0.0
    ) -> None:
        """`port` as for Link. `wait_s`: how long the machine stands still for the board's answer in
        every slice, for one whose clock the sensors' frames are. Raises UserError where nobody or
        another build answers."""
        self._link = Link(port, time.monotonic)
        try:
            if self._link.meet().build != BUILD:
                raise UserError(
                    f"{port}: this board's firmware drives real motors; for the bench write the "
                    "other build with `pio run -e uno_hil -t upload`"
                )
            for name, value in (parameters or {}).items():
                spec = protocol.PARAMS[name]
                self._link.ask(protocol.ParamSet(spec.id, spec.to_raw(value)))
        except BaseException:
            self._link.close()
            raise
        self._link.tap = self._heard
        self.wait_s = wait_s
        """How long an answer is waited for."""
        self._from_host, self._from_board = Frames(), Frames()
        self._to_host = bytearray()
        self._outputs = np.zeros(3)
        self._sensors = np.zeros(coupling.SENSORS, np.int64)
        self._answered_us = 0
        self.answers = 0
        """HilOutputs so far."""

    def bind(
        self,
        state: machine.Record,
        params: machine.Record,
        given: machine.Record,
        wires: machine.Record,
        layout: machine.Record,
    ) -> Callable[[int, int], int]:
        """`run(begin_us, end_us)`: the machine moves at what the board last said, then the board
        hears what the sensors give. Returns 0. Raises UserError where the board falls silent."""
        move = coupling.bind_apart(
            self._outputs, self._sensors, state, params, given, wires, layout
        )

        def run(begin_us: int, end_us: int) -> int:
            move(begin_us, end_us)
            self._link.request(self._report())
            before = self.answers
            patience = time.monotonic() + self.wait_s
            self._link.poll()
            while self.answers == before and (left := patience - time.monotonic()) > 0:
                self._link.poll(left)
            if self.answers > before:
                self._answered_us = end_us
            elif end_us - self._answered_us > SILENCE_US:
                raise UserError(
                    f"{self._link.port}: the board does not answer for {SILENCE_US / 1e6:g} s; "
                    "reset it and start again"
                )
            return 0

        return run

    def _report(self) -> protocol.HilSensors:
        pot, battery, steer, drive, estop, hall, _, way, turns, _ = (int(x) for x in self._sensors)
        return protocol.HilSensors(
            pot / 1000,
            battery / 1000,
            steer / 1000,
            drive / 1000,
            estop / 1000,
            hall % 65536,
            way % 65536,
            turns % 65536,
        )

    def _heard(self, direction: Direction, stamp: float, data: bytes) -> None:
        del stamp
        if direction != "to_host":
            return
        for frame in self._from_board.feed(data):
            answers = [m for _, m in protocol.Parser().feed(frame)]
            if answers and isinstance(answers[0], protocol.HilOutputs):
                self.answers += 1
                steer, drive = answers[0].steer_duty / 255, answers[0].drive_duty / 255
                self._outputs[:] = (steer, drive, float(answers[0].blade != 0))
            else:
                self._to_host += frame

    def write(self, data: bytes) -> int:
        """The host's bytes, passed on in whole frames."""
        self._link.forward(b"".join(self._from_host.feed(data)))
        return len(data)

    def read(self) -> bytes:
        """What the board has said to the host."""
        out = bytes(self._to_host)
        self._to_host.clear()
        return out

    def reset(self, cause: ResetCause = ResetCause.EXTERNAL) -> None:
        """Raises UserError: the bench cannot."""
        del cause
        raise UserError(
            f"{self._link.port}: the bench cannot take a real board's power or reset it"
        )

    def hang(self) -> None:
        """Raises UserError: the bench cannot."""
        raise UserError(f"{self._link.port}: the bench cannot hang a real board's firmware")

    def close(self) -> None:
        """Asks for STOP and leaves the port."""
        self._link.close()
