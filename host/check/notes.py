"""What every part of the check does: note a line, ask the operator, command the machine and wait.

What was seen stands in a line; what it means and what to do stand in the texts of each language
under the finding's name.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from host.check.lines import Hands, Line, Question, Values, Verdict
from host.core.messages import Command, Request, State, Telemetry
from host.link import protocol


class Notes:
    """The lines so far, and the machine that they are about."""

    def __init__(self, hands: Hands) -> None:
        self.hands = hands
        self.lines: list[Line] = []

    # ---- saying ----------------------------------------------------------------------------------

    def note(self, name: str, verdict: Verdict, finding: str, **values: object) -> bool:
        """Adds a line; whether it lets the check go on."""
        tidy: Values = {
            key: round(value, 2) if isinstance(value, float) else value
            for key, value in values.items()
        }
        self.lines.append(Line(name, verdict, finding, tidy))
        self.hands.show(self.lines)
        return verdict != "bad"

    def judge(self, name: str, fine: bool, otherwise: str, **values: object) -> bool:
        """Notes NAME.ok, or the finding `otherwise` as wrong."""
        return self.note(
            name, "ok" if fine else "bad", f"{name}.ok" if fine else otherwise, **values
        )

    def skip(self, *names: str) -> None:
        """Notes as not looked at what has no line yet."""
        known = {line.name for line in self.lines}
        for name in names:
            if name not in known:
                self.note(name, "skipped", "")

    def ask(
        self, key: str, *choices: str, until: Callable[[], bool] | None = None, **values: object
    ) -> str | float | None:
        """The operator's answer; None once `until` holds, or where nobody answers."""
        return self.hands.operator(Question(key, choices, dict(values)), until)

    # ---- the machine -----------------------------------------------------------------------------

    def until(self, seconds: float, holds: Callable[[], bool]) -> bool:
        """Lets time pass until something holds; whether it does."""
        end = self.hands.clock() + seconds
        while not holds():
            if self.hands.clock() > end:
                return False
            self.hands.pump(0.05)
        return True

    @property
    def state(self) -> State | None:
        """Of the board."""
        last = self.hands.telemetry
        return None if last is None else last.state

    @property
    def faults(self) -> list[str]:
        """Names of the board's fault bits."""
        last = self.hands.telemetry
        faults = protocol.Fault(0 if last is None else last.faults)
        return [str(bit.name) for bit in protocol.Fault if bit in faults]

    @property
    def fault_texts(self) -> list[str]:
        """Names of the texts of the board's faults."""
        return [f"fault.{name}" for name in self.faults]

    def arm(self) -> bool:
        """Whether the board let itself be armed."""
        hands = self.hands
        end = hands.clock() + 2.0
        # The board arms only where the last speed asked for was none.
        hands.send(Command(Request.DRIVE, reason="check"))
        while self.state is not State.ARMED:
            if hands.clock() > end or self.state is State.FAULT:
                return False
            hands.send(Command(Request.ARM, reason="check"))
            hands.pump(0.1)
        return True

    def drive(
        self, seconds: float, *, steer_deg: float = 0.0, speed_mps: float = 0.0, blade: bool = False
    ) -> list[Telemetry]:
        """The same command for a time; ends early where the board gives up."""
        hands = self.hands
        end = hands.clock() + seconds
        seen: list[Telemetry] = []
        while hands.clock() < end:
            hands.send(Command(Request.DRIVE, math.radians(steer_deg), speed_mps, blade, "check"))
            seen += hands.pump(0.05)
            if seen and seen[-1].state in (State.FAULT, State.SAFE):
                break
        return seen

    def halt(self) -> None:
        """STOP, until the board says that it stands."""
        hands = self.hands
        for _ in range(20):
            hands.send(Command(Request.STOP, reason="check"))
            hands.pump(0.05)
            if self.state in (State.SAFE, State.FAULT):
                return
