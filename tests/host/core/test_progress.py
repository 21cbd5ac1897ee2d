"""Facts about how far a long work says that it is."""

from __future__ import annotations

import io
import threading

import pytest
from rich.console import Console

from host.core.progress import Watch
from host.core.terminal import PlainConsole


class Paper(io.StringIO):
    """Where lines go; tells when one has come."""

    def __init__(self) -> None:
        super().__init__()
        self.written = threading.Event()

    def write(self, text: str) -> int:
        count = super().write(text)
        self.written.set()
        return count


def test_without_a_terminal_a_long_work_says_how_long_still() -> None:
    now, out = [0.0], io.StringIO()
    console = PlainConsole(file=out, width=20, soft_wrap=True)
    with Watch("harvest", 1.0, console, every_s=10, clock=lambda: now[0]) as watch:
        for k in range(11):
            now[0] = 10.0 * k
            watch.reach(k / 40, "follow")
    assert out.getvalue().splitlines()[-2:] == 2 * [
        "harvest: 25 %, follow, 2 min so far, 5 min left"
    ]


def test_a_work_that_finishes_no_step_for_long_is_not_silent() -> None:
    out = Paper()
    with Watch("replay", None, PlainConsole(file=out), every_s=0.01):
        assert out.written.wait(10)
    assert out.getvalue().startswith("replay: 0 s so far\n")


def test_a_short_work_says_nothing() -> None:
    out = io.StringIO()
    with Watch("runs", 3, PlainConsole(file=out)) as watch:
        for _ in range(3):
            watch.step()
    assert not out.getvalue()


@pytest.mark.parametrize("terminal", [True, False])
def test_what_is_worked_at_is_only_text(terminal: bool) -> None:
    now, out = [0.0], io.StringIO()
    console: Console = PlainConsole(file=out, force_terminal=terminal, width=200)
    what = "[/nope] of \x1b]0;x\x07"
    with Watch(what, 2, console, every_s=1, clock=lambda: now[0]) as watch:
        now[0] = 5.0
        watch.step(what)
    assert "[/nope] of" in out.getvalue()
    assert "\x1b]0;" not in out.getvalue()


def test_what_was_done_before_does_not_count_for_the_pace() -> None:
    now, out = [0.0], io.StringIO()
    console = PlainConsole(file=out, width=200)
    with Watch("runs", 100, console, every_s=10, clock=lambda: now[0]) as watch:
        watch.reach(90)
        now[0] = 10.0
        watch.reach(95)
    assert out.getvalue().splitlines()[0] == "runs: 95 of 100, 10 s so far, 10 s left"
