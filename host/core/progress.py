"""How far a long work is and how long it will still take: a bar on a terminal, a line now and then
where the output goes to a file."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from types import TracebackType

from rich import progress
from rich.console import Console
from rich.markup import escape

from host.core.terminal import PlainConsole, plain

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
    """Counts a work of `total` steps, or of a share from 0 to 1 where `total` is 1.0; without a
    total it says how long the work has lasted. The time left is by the pace of this call's own
    steps. Without a terminal it speaks every `every_s`, whether steps are done or not."""

    def __init__(
        self,
        what: str,
        total: float | None = None,
        console: Console | None = None,
        *,
        every_s: float = LINE_EVERY_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._what = plain(what)
        self._total = total
        self._console = console or PlainConsole(stderr=True, soft_wrap=True)
        self._every_s = every_s
        self._clock = clock
        self._done = 0.0
        self._text = ""
        self._start = self._said = clock()
        self._given: float | None = None
        """What was done before the first step was counted here."""
        self._spoken = False
        self._end = threading.Event()
        self._bar: progress.Progress | None = None
        if self._console.is_terminal:
            self._bar = progress.Progress(
                progress.TextColumn("{task.description}"),
                progress.BarColumn(),
                progress.TextColumn("{task.fields[state]}"),
                progress.TimeElapsedColumn(),
                console=self._console,
            )

    def __enter__(self) -> Watch:
        if self._bar is not None:
            self._bar.start()
            self._task = self._bar.add_task(escape(self._what), total=self._total, state="")
        else:
            self._ticker = threading.Thread(target=self._tick, name="progress", daemon=True)
            self._ticker.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
            return
        self._end.set()
        self._ticker.join()
        if kind is None and self._spoken:
            self._line()

    def step(self, text: str = "") -> None:
        """One more is done."""
        self.reach(self._done + 1, text)

    def reach(self, done: float, text: str = "") -> None:
        """So much is done; `text`: what it is at."""
        if self._given is None:
            self._given = done if done > 1 else 0.0
        self._done = done
        self._text = plain(text)
        if self._bar is not None:
            state = f"{self._how_far()}  {self._rest()}".strip()
            self._bar.update(self._task, completed=done, state=escape(state))
        else:
            self.tell()

    def tell(self) -> None:
        """A line, where it is time for one."""
        if self._clock() - self._said >= self._every_s:
            self._line()

    def _how_far(self) -> str:
        if self._total is None:
            return self._text
        share = isinstance(self._total, float)
        at = f"{100 * self._done:.0f} %" if share else f"{self._done:g} of {self._total:g}"
        return f"{at}, {self._text}" if self._text else at

    def _rest(self) -> str:
        if self._total is None or self._done >= self._total:
            return ""
        own = self._done - (self._given or 0.0)
        spent = self._clock() - self._start
        seconds = spent / own * (self._total - self._done) if own > 0 else math.inf
        return f"{left(seconds)} left"

    def _line(self) -> None:
        self._said = self._clock()
        self._spoken = True
        parts = (self._how_far(), f"{left(self._clock() - self._start)} so far", self._rest())
        self._console.print(f"{self._what}: {', '.join(part for part in parts if part)}")

    def _tick(self) -> None:
        while not self._end.wait(self._every_s):
            self.tell()
