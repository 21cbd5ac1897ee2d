"""Faults that a person makes while the rig runs, a line each.

pot off                     until the end
phone off for=3             for 3 s
gnss wrong value=5 how=jump
list                        what is broken now
end                         all of it is whole again
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Final, TextIO

from pydantic import ValidationError

from hil.bench.injector import Injector
from hil.scenario.faults import PAIRS, Fault
from host.core.errors import UserError

WORDS: Final = {"for": "for_s", "value": "value", "how": "how"}
USAGE: Final = "COMPONENT FAILURE [for=S] [value=X] [how=HOW], list or end"


def fault_of(line: str, now: float) -> Fault:
    """The fault that a line asks for, beginning now. UserError where there is none such."""
    component, *rest = line.split()
    if component not in {name for name, _ in PAIRS}:
        known = ", ".join(dict.fromkeys(name for name, _ in PAIRS))
        raise UserError(f"{component}: no such component; there are {known}. Say {USAGE}")
    if component == "host":
        raise UserError("host: the rig does not hold it; stop `daranti drive` itself (Ctrl-Z)")
    about: dict[str, object] = {"component": component, "at": {"time_s": now}}
    about["failure"] = rest[0] if rest else ""
    for word in rest[1:]:
        name, _, value = word.partition("=")
        if name not in WORDS or not value:
            raise UserError(f"{word}: say {USAGE}")
        about[WORDS[name]] = value if name == "how" else _number(word, value)
    try:
        return Fault.model_validate(about)
    except ValidationError as error:
        first = error.errors()[0]
        known = ", ".join(failure for name, failure in PAIRS if name == component)
        text = str(first["msg"]).removeprefix("Value error, ")
        raise UserError(f"{line}: {text} ({component} can be: {known})") from error


def _number(word: str, value: str) -> float:
    try:
        return float(value)
    except ValueError as error:
        raise UserError(f"{word}: not a number") from error


class TypedFaults:
    """Takes lines in a thread of its own and obeys them when it is polled."""

    def __init__(self, stream: TextIO, say: Callable[[str], None]) -> None:
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._say = say
        self._stream = stream
        threading.Thread(target=self._read, name="typed faults", daemon=True).start()

    def _read(self) -> None:
        for line in self._stream:
            self._lines.put(line.strip())

    def poll(self, now: float, faults: Injector, real_board: bool = False) -> None:
        """Does what has been typed; returns at once."""
        while not self._lines.empty():
            line = self._lines.get()
            try:
                self._obey(line, now, faults, real_board)
            except UserError as error:
                self._say(str(error))

    def _obey(self, line: str, now: float, faults: Injector, real_board: bool) -> None:
        match line:
            case "":
                return
            case "list":
                self._say(", ".join(fault.name for fault in faults.active) or "nothing is broken")
            case "end":
                faults.end_all(now)
                self._say(f"{now:.1f} s: all is whole again")
            case _:
                fault = fault_of(line, now)
                if real_board and fault.component in ("battery", "firmware"):
                    raise UserError(f"{fault.name}: cannot be made on a real board; do it by hand")
                faults.add(fault)
                self._say(f"{now:.1f} s: {fault.name}")
