"""How far a long command is and how long it will still take: a bar on a terminal, a line now and
then where the output goes to a file."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from rich import progress
from rich.console import Console

LINE_EVERY_S = 30.0
"""Between lines of progress where no terminal shows a bar."""


def left(seconds: float) -> str:
    """A time in words, to two figures or so."""
    if not math.isfinite(seconds):
        return "unknown"
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


class Watch:
    """Counts steps of a work of `total`; the time left is by the pace of this call's own steps."""

    def __init__(self, what: str, total: int, console: Console | None = None) -> None:
        self._what = what
        self._total = total
        self._console = console or Console(stderr=True)
        self._done = 0
        self._start = self._said = time.monotonic()
        self._given: int | None = None
        """Steps that were done before the first was counted here."""
        self._bar: progress.Progress | None = None
        if self._console.is_terminal:
            self._bar = progress.Progress(
                progress.TextColumn("{task.description}"),
                progress.BarColumn(),
                progress.MofNCompleteColumn(),
                progress.TextColumn("{task.fields[left]}"),
                console=self._console,
            )

    def __enter__(self) -> Watch:
        if self._bar is not None:
            self._bar.start()
            self._task = self._bar.add_task(self._what, total=self._total, left="")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
        elif kind is None:
            self._line()

    def step(self) -> None:
        """One more is done."""
        self.reach(self._done + 1)

    def reach(self, done: int) -> None:
        """So many are done."""
        if self._given is None:
            self._given = done if done > 1 else 0
        self._done = done
        if self._bar is not None:
            self._bar.update(self._task, completed=done, left=f"{self._left()} left")
        elif time.monotonic() - self._said > LINE_EVERY_S:
            self._line()

    def _left(self) -> str:
        own = self._done - (self._given or 0)
        if own <= 0:
            return "unknown"
        spent = time.monotonic() - self._start
        return left(spent / own * (self._total - self._done))

    def _line(self) -> None:
        self._said = time.monotonic()
        spent = left(time.monotonic() - self._start)
        self._console.print(
            f"{self._what}: {self._done} of {self._total} done in {spent}, {self._left()} left",
            highlight=False,
        )


class Lines:
    """Of a work whose share done is known: a line now and then with the time left; nothing on a
    terminal, where the command draws a bar."""

    def __init__(
        self,
        console: Console,
        every_s: float = LINE_EVERY_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._console = console
        self._every_s = every_s
        self._clock = clock
        self._begun = self._told = clock()

    def tell(self, share: float, text: str) -> None:
        """`share` of the work that is done, 0..1."""
        now = self._clock()
        if self._console.is_terminal or now - self._told < self._every_s:
            return
        self._told = now
        seconds = (now - self._begun) * (1 - share) / share if share > 0 else math.inf
        self._console.print(
            f"{100 * share:.0f} %: {text}, {left(seconds)} left",
            markup=False,
            highlight=False,
            soft_wrap=True,
        )


def written_since(folder: Path, begun: float) -> list[str]:
    """Names of what was written into a folder since `begun` (seconds of the system's clock): what
    an earlier run has left is not announced as this one's."""
    slack_s = 1.0  # some file systems keep whole seconds
    return [each.name for each in folder.iterdir() if each.stat().st_mtime >= begun - slack_s]
