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
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

_CONTROL = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""Surrogates too: no encoding has them, and a file's name that is no UTF-8 is full of them."""
KEPT_WRITES = 2000
"""What a terminal that is not read may owe before the rest is left out."""
LAST_WORDS_S = 1.0
"""For a terminal that takes no more lines, before they are given up."""
WIDEST = 100_000
"""Columns of a file."""


class ReaderGoneError(Exception):
    """Nobody reads any more what is printed. No OSError: of a broken pipe click and rich would each
    end the process, with a code of their own."""


def plain(text: str) -> str:
    """The text with its control characters, and halves of characters, written out; tabs and line
    ends stay."""
    return _CONTROL.sub(lambda found: f"\\x{ord(found[0]):02x}", text)


def echo(text: object, *, err: bool = False, nl: bool = True) -> None:
    """One line on stdout, or on stderr; without `nl` the next text goes on in it."""
    try:
        click.echo(plain(str(text)), err=err, nl=nl)
    except BrokenPipeError as error:
        raise ReaderGoneError from error


class PlainConsole(Console):
    """A console on which text is only text."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"highlight": False, "markup": False, "emoji": False} | options)

    def render_str(self, text: str, **options: Any) -> Text:
        """As Console's, control characters written out."""
        return super().render_str(plain(text), **options)

    def on_broken_pipe(self) -> None:
        """As echo."""
        raise ReaderGoneError

    def print_table(self, table: Table) -> None:
        """A table with every figure whole: as wide as it is into a file or a pipe; on a terminal
        that is too narrow for it, row by row."""
        options = self.options.update(width=WIDEST, max_width=WIDEST)
        need = Measurement.get(self, options, table)
        if not self.is_terminal:
            usual, self.width = self.width, max(need.maximum, 1)
            self.print(table)
            self.width = usual
        elif need.minimum <= self.width:
            self.print(table)
        else:
            self.print(_upright(table), soft_wrap=True)


def _upright(table: Table) -> Text:
    """A table's rows as blocks, a line a column."""
    heads = [str(column.header) for column in table.columns]
    wide = max(map(len, heads), default=0)
    out = Text()
    if table.title:
        out.append(f"{plain(str(table.title))}\n", "italic")
    for cells in zip(*(column.cells for column in table.columns), strict=True):
        out.append("\n")
        for head, cell in zip(heads, map(str, cells), strict=True):
            out.append(f"{plain(head):{wide}}  {plain(cell)}\n")
    return out


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
