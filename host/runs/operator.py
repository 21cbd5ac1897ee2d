"""The person beside the machine: asked before anything moves, and by whom it is moved by hand."""

from __future__ import annotations

import contextlib
import math
import os
import select
import termios
import tty
from collections.abc import Callable, Iterator
from typing import Final, TextIO

from host.core.errors import FaultError, UserError
from host.core.messages import Command, Request, State
from host.link import protocol
from host.link.session import Link
from host.runs.drive import PERIOD_S, halt

Say = Callable[[str], None]

WORD: Final = "start"
JOG_WORD: Final = "jog"
COUNTDOWN_S: Final = 5
"""For the operator to step back."""
BELL: Final = "\a"

JOG_MPS: Final = 0.12
"""Creeping: 6 cm until the held key's pause stops it."""
JOG_STEP_RAD: Final = math.radians(5.0)
"""Of the wheel for each press of a key."""
HELD_S: Final = 0.5
"""A key that is held repeats within; what is let go of stops the machine after so long."""
ARM_EVERY_S: Final = 0.5
"""Between requests to arm."""
ARM_S: Final = 5.0
"""After which a board that does not arm is given up."""
JOG_HELP: Final = (
    "jog, blade off: hold w or s to creep forward or back, a and d steer left and right, space "
    "straightens, q ends"
)


class Operator:
    """Reads a terminal without ever waiting for it; without one nobody is there."""

    def __init__(self, terminal: TextIO, say: Say, bell: Say, clock: Callable[[], float]) -> None:
        """`bell` is given what makes the terminal sound."""
        self._file = terminal.fileno() if terminal.isatty() else None
        self._say = say
        self._bell = bell
        self._clock = clock
        self._typed = b""

    @property
    def present(self) -> bool:
        """Whether there is a terminal to answer at."""
        return self._file is not None

    def answer(self, question: str, link: Link) -> str:
        """The line that is typed; the link is kept alive meanwhile. UserError where the terminal
        goes away."""
        self._say(question)
        while True:
            line, found, rest = self._typed.partition(b"\n")
            if found:
                self._typed = rest
                return line.decode(errors="replace").strip()
            link.poll(PERIOD_S)
            self._typed += self._bytes()

    def countdown(self, seconds: int, link: Link) -> bool:
        """A bell a second; False where Enter breaks it off."""
        end = self._clock() + seconds
        for left in range(seconds, 0, -1):
            self._bell(BELL)
            self._say(f"starts in {left} s; Enter or Ctrl-C breaks off")
            while self._clock() < end - left + 1:
                link.poll(PERIOD_S)
                if self.present and b"\n" in self._bytes():
                    return False
        self._bell(BELL)
        return True

    def jog(self, link: Link) -> None:
        """Creeps under the operator's keys with the blade off, until q. FaultError where the
        firmware does not arm or gives up; whatever ends it, the last thing sent is STOP."""
        self._say(JOG_HELP)
        try:
            with self._each_key():
                self._armed(link)
                self._creep(link)
        finally:
            halt(link, self._clock)

    def _creep(self, link: Link) -> None:
        steer = speed = 0.0
        until = -math.inf
        while True:
            for key in self._bytes().decode(errors="replace"):
                if key in "wWsS":
                    speed = JOG_MPS if key in "wW" else -JOG_MPS
                    until = self._clock() + HELD_S
                elif key in "aAdD":
                    steer += JOG_STEP_RAD if key in "aA" else -JOG_STEP_RAD
                elif key == " ":
                    steer = 0.0
                elif key in "qQ\r\n":
                    return
            if self._clock() > until:
                speed = 0.0
            link.send(Command(Request.DRIVE, steer, speed, False, "jogged by the operator"))
            link.poll(PERIOD_S)
            telemetry = link.session.telemetry
            if telemetry is not None and telemetry.state in (State.SAFE, State.FAULT):
                raise FaultError(f"the firmware ended the jog: {_words(link)}")

    def _armed(self, link: Link) -> None:
        end, again = self._clock() + ARM_S, -math.inf
        while self._clock() < end:
            telemetry = link.session.telemetry
            state = telemetry.state if telemetry is not None else State.SAFE
            if state in (State.ARMED, State.RUNNING):
                return
            if self._clock() >= again:
                again = self._clock() + ARM_EVERY_S
                fault = state is State.FAULT
                if not fault:
                    # The board arms only where the last speed asked for was none.
                    link.send(Command(Request.DRIVE, reason="to be jogged"))
                link.send(Command(Request.CLEAR if fault else Request.ARM, reason="to be jogged"))
            link.poll(PERIOD_S)
        raise FaultError(f"the firmware does not arm: {_words(link)}")

    def _bytes(self) -> bytes:
        """What has been typed since."""
        if self._file is None or not select.select([self._file], [], [], 0)[0]:
            return b""
        try:
            found = os.read(self._file, 4096)
        except OSError:
            found = b""
        if not found:
            self._file = None
            raise UserError("the terminal is gone; nothing was started")
        return found

    @contextlib.contextmanager
    def _each_key(self) -> Iterator[None]:
        """Keys come one by one, without Enter."""
        if self._file is None:
            raise UserError("a jog needs a terminal")
        file = self._file
        before = termios.tcgetattr(file)
        try:
            tty.setcbreak(file)
            yield
        finally:
            termios.tcsetattr(file, termios.TCSADRAIN, before)


def _words(link: Link) -> str:
    telemetry = link.session.telemetry
    faults = protocol.fault_texts(protocol.Fault(telemetry.faults)) if telemetry else []
    return (
        "; ".join([*faults, link.session.refusal])
        if faults or link.session.refusal
        else "no reason given"
    )
