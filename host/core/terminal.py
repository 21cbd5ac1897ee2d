"""The terminal as a place that strangers write to: names in files, a server's words, a device's.

Whatever is printed goes through here. Control characters are shown, not obeyed, and nothing is
markup.
"""

from __future__ import annotations

import re
import sys
import threading
import time
from collections import deque
from typing import Any, TextIO

import click
from rich.console import Console
from rich.text import Text

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")
KEPT_WRITES = 2000
"""What a terminal that is not read may owe before the rest is left out."""
LAST_WORDS_S = 1.0
"""For a terminal that takes no more lines, before they are given up."""


def plain(text: str) -> str:
    """The text with its control characters written out; tabs and line ends stay."""
    return _CONTROL.sub(lambda found: f"\\x{ord(found[0]):02x}", text)


def echo(text: str, *, err: bool = False) -> None:
    """One line on stdout, or on stderr."""
    click.echo(plain(text), err=err)


class PlainConsole(Console):
    """A console on which text is only text."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"highlight": False, "markup": False, "emoji": False} | options)

    def render_str(self, text: str, **options: Any) -> Text:
        """As Console's, control characters written out."""
        return super().render_str(plain(text), **options)


class Outlet:
    """A text stream that never waits: a thread writes, and what a stalled terminal does not take is
    left out. A loop that has to answer a machine prints to it."""

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stdout
        self._texts: deque[str] = deque(maxlen=KEPT_WRITES)
        self._there = threading.Condition()
        self._busy = False
        threading.Thread(target=self._run, name="outlet", daemon=True).start()

    @property
    def encoding(self) -> str:
        """The stream's."""
        return self._stream.encoding

    def isatty(self) -> bool:
        """Whether the stream is a terminal."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """The stream's."""
        return self._stream.fileno()

    def write(self, text: str) -> int:
        """Returns at once."""
        with self._there:
            self._texts.append(text)
            self._there.notify()
        return len(text)

    def flush(self) -> None:
        """Nothing: it would wait."""

    def drain(self, timeout_s: float = LAST_WORDS_S) -> bool:
        """Waits for what has been written, not for ever; False where something is left."""
        deadline = time.monotonic() + timeout_s
        with self._there:
            while self._texts or self._busy:
                if not self._there.wait(max(0.0, deadline - time.monotonic())):
                    return False
        return True

    def _run(self) -> None:
        while True:
            with self._there:
                while not self._texts:
                    self._there.wait()
                text = "".join(self._texts)
                self._texts.clear()
                self._busy = True
            try:
                self._stream.write(text)
                self._stream.flush()
            except (OSError, ValueError):  # the terminal is gone; its hang-up ends the run
                pass
            with self._there:
                self._busy = False
                self._there.notify_all()
