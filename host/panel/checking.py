"""The check from the panel: the machine's process is the hands, a page is the operator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from host.check.laptop import Laptop
from host.check.lines import Line, Question, Target, green
from host.check.walk import walk
from host.core.errors import UserError
from host.core.messages import Command, Request, Telemetry
from host.core.strict import Strict
from host.core.vehicle import Mount, Vehicle
from host.link import protocol
from host.link.session import Answer
from host.panel.machine import Machine, StoppedError
from host.panel.snapshot import Json
from host.vision.mounted.detector import Mode

PATIENCE_S: Final = 180.0
"""How long a question waits for its answer."""


class What(Strict):
    """Which field, from where; as the panel has it."""

    boundary: Path | None = None
    gap_m: float | None = None
    inset_m: float = 0.0
    corner: int = 0


class MachineHands(Laptop):
    """What the machine's process can touch, and the page that drives."""

    def __init__(self, machine: Machine) -> None:
        super().__init__(machine.camera, machine.gnss, machine.gyro, machine.settings.folder)
        self.vehicle: Vehicle = machine.vehicle
        self.mount: Mount = machine.mount
        self.mode: Mode = machine.settings.mode
        self.lines: list[Line] = []
        self.question: Json | None = None
        self._machine = machine
        self._asked = 0
        self._moves = False

    def clock(self) -> float:
        """Seconds."""
        return self._machine.clock()

    def pump(self, seconds: float) -> list[Telemetry]:
        """Lets time pass. STOP ends the check, and so does, while anything moves, a page that is
        gone; who goes to press a button on the machine may put the phone away."""
        if self._moves:
            self._machine.need_driver()
        return self._machine.pump(seconds)

    @property
    def telemetry(self) -> Telemetry | None:
        """The board's latest word."""
        return self._machine.telemetry

    @property
    def version(self) -> protocol.Version | None:
        """Who the board says it is."""
        link = self._machine.link
        return None if link is None else link.session.version

    @property
    def board_problem(self) -> str:
        """Why it does not answer."""
        return self._machine.board_problem

    def send(self, command: Command) -> None:
        """To the board."""
        asked = (command.speed_mps, command.steer_rad, command.blade)
        self._moves = command.request is Request.DRIVE and any(asked)
        self._machine.send(command)

    def ask_board(self, message: protocol.Message) -> Answer:
        """A request and its answer."""
        link = self._machine.link
        if link is None:
            raise UserError("the board is gone")
        answer = link.ask(message)
        self._machine.serve()
        return answer

    def operator(
        self, question: Question, until: Callable[[], bool] | None = None
    ) -> str | float | None:
        """Asks the page that drives."""
        machine = self._machine
        self._asked += 1
        self.question = asdict(question) | {"id": self._asked, "number": not question.choices}
        self.tell(done=False)
        end = machine.clock() + PATIENCE_S
        answer: Any = None
        machine.wishes.clear()
        while answer is None and machine.clock() < end and not (until is not None and until()):
            machine.pump(0.05)
            while machine.wishes:
                wish = machine.wishes.popleft()
                if wish.get("do") == "answer" and wish.get("id") == self._asked:
                    answer = wish.get("answer")
        self.question = None
        self.tell(done=False)
        fits = answer in question.choices if question.choices else isinstance(answer, int | float)
        return answer if fits else None

    def show(self, lines: Sequence[Line]) -> None:
        """Tells the pages."""
        self.lines = list(lines)
        self.tell(done=False)
        self._machine.serve()

    def tell(self, *, done: bool) -> None:
        """The list as it stands."""
        self._machine.post(
            {
                "kind": "check",
                "lines": [asdict(line) for line in self.lines],
                "question": self.question,
                "done": done,
                "green": done and green(self.lines),
            }
        )


def check(machine: Machine, wish: Json) -> None:
    """Walks the check."""
    try:
        what = What.model_validate(wish.get("order", {}))
    except ValueError as error:
        machine.post({"kind": "failed", "what": "check", "why": str(error)})
        return
    hands = MachineHands(machine)
    with machine.doing("check", dict):
        try:
            walk(hands, Target(what.boundary, what.gap_m, what.corner, what.inset_m))
        except (StoppedError, UserError):
            hands.lines.append(Line("check", "bad", "check.ended"))
            raise
        finally:
            hands.question = None
            hands.tell(done=True)
