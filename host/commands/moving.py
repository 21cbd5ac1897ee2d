"""What commands have alike that move the machine: nothing moves without consent, and whatever ends
them, the machine is stopped and that is said."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import click

from host.core.errors import UserError
from host.core.number_range import WholeRange
from host.core.terminal import PlainConsole, echo
from host.link.session import Link
from host.runs.drive import halt
from host.runs.operator import COUNTDOWN_S, WORD, Operator

yes_option = click.option(
    "--yes", is_flag=True, help="Start without asking, after the countdown; for scripts."
)
countdown_option = click.option(
    "--countdown",
    "countdown_s",
    type=WholeRange(0, 60),
    default=COUNTDOWN_S,
    show_default=True,
    help="Seconds with a bell before the first motion.",
)


def asked(*, yes: bool) -> Operator:
    """Who is asked at the terminal. UserError where nobody can be, and `yes` does not make up for
    it."""
    console = PlainConsole()

    def bell(_: str) -> None:
        if console.is_terminal:
            console.bell()

    operator = Operator(sys.stdin, echo, bell, time.monotonic)
    if not (operator.present or yes):
        raise UserError("there is no terminal to ask at: give --yes to start without being asked")
    return operator


def consent(operator: Operator, link: Link, countdown_s: int, *, yes: bool) -> None:
    """Waits for the word, or not where `yes`, and counts down. UserError where it is refused."""
    if not yes and operator.answer(f"type {WORD} and Enter (Ctrl-C ends)", link) != WORD:
        raise UserError("not started; nothing has moved")
    count_down(operator, link, countdown_s, "broken off before the start; nothing has moved")


def count_down(operator: Operator, link: Link, countdown_s: int, broken_off: str) -> None:
    """Before each motion. UserError, saying `broken_off`, where Enter ends it."""
    if not operator.countdown(countdown_s, link):
        raise UserError(broken_off)


@contextmanager
def stopped_after(link: Link) -> Iterator[None]:
    """However what is done in it ends, the machine is told to stop until its firmware confirms it,
    and whether it does is said."""
    try:
        yield
    finally:
        held = False
        with suppress(UserError):
            held = halt(link, time.monotonic)
        if held:
            echo("stopped: the firmware confirms")
        else:
            echo("STOP is not confirmed: press the emergency stop", err=True)
