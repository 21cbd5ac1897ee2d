"""Facts about how the console script fails: one message, a non-zero exit, never a traceback."""

from __future__ import annotations

import ctypes
import errno
import io
import os
import signal
import sys
import time

import click
import pytest

from host.commands.cli import daranti
from host.core.errors import (
    EXIT_INTERRUPTED,
    EXIT_PIPE,
    EXIT_SOFTWARE,
    EXIT_USER,
    UserError,
    run,
)
from host.core.terminal import PlainConsole, echo
from tests.helpers.console import Cli


def failing(error: BaseException) -> click.Command:
    @click.command()
    def command() -> None:
        raise error

    return command


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (UserError("the port is missing"), EXIT_USER, "daranti: the port is missing\n"),
        (KeyboardInterrupt(), EXIT_INTERRUPTED, "daranti: interrupted\n"),
        (OSError(errno.ENOSPC, "No space left"), EXIT_USER, "daranti: the disk is full; free"),
        (ValueError("x"), EXIT_SOFTWARE, "daranti: internal error: ValueError: x"),
        (click.UsageError("no such thing"), EXIT_USER, "Error: no such thing\n"),
    ],
)
def test_every_failure_has_one_message_and_its_code(
    error: BaseException,
    code: int,
    message: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("DARANTI_DEBUG", raising=False)
    with pytest.raises(SystemExit) as exit_:
        run(failing(error), "daranti", [])
    assert exit_.value.code == code
    text = capsys.readouterr().err
    assert message in text
    assert "Traceback" not in text


def test_debug_shows_the_traceback(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DARANTI_DEBUG", "1")
    with pytest.raises(SystemExit):
        run(failing(UserError("x")), "daranti", [])
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_what_ends_a_program_unwinds_it_even_where_it_was_ignored(
    number: signal.Signals,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A script's `&` leaves Ctrl-C ignored."""
    before = signal.signal(number, signal.SIG_IGN)
    unwound = []

    @click.command()
    def command() -> None:
        try:
            os.kill(os.getpid(), number)
            time.sleep(1.0)
        finally:
            unwound.append(True)

    try:
        with pytest.raises(SystemExit) as exit_:
            run(command, "daranti", [])
    finally:
        signal.signal(number, before)
    assert exit_.value.code == EXIT_INTERRUPTED
    assert unwound
    capsys.readouterr()


def test_an_interrupt_in_a_librarys_callback_is_one_message(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C while numba compiles: ctypes cannot raise it, and numba fails of what is missing."""

    @click.command()
    def command() -> None:
        ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))()
        raise RuntimeError("no compiled object yet")

    monkeypatch.setattr("sys.unraisablehook", sys.__unraisablehook__)
    with pytest.raises(SystemExit) as exit_:
        run(command, "daranti", [])
    assert exit_.value.code == EXIT_INTERRUPTED
    assert capsys.readouterr().err == "daranti: interrupted\n"


@pytest.mark.parametrize("rich", [False, True])
def test_a_reader_who_has_gone_is_its_own_code(rich: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """`daranti ... | head -1`, whichever way the command prints."""

    @click.command()
    def command() -> None:
        while True:
            PlainConsole().print("a line") if rich else echo("a line")

    read, write = os.pipe()
    os.close(read)
    with (
        open(write, "w", buffering=1, encoding="utf-8") as gone,  # noqa: PTH123
        pytest.raises(SystemExit) as exit_,
    ):
        monkeypatch.setattr("sys.stdout", gone)
        run(command, "daranti", [])
    assert exit_.value.code == EXIT_PIPE


@pytest.mark.parametrize(
    ("text", "encoding", "shown"),
    [
        ("phase margin 68°", "utf-8", "phase margin 68°"),
        ("گندم", "latin-1", "\\u06af\\u0646\\u062f\\u0645"),
        ("field-\udcff", "utf-8", "field-\\xdcff"),
    ],
)
def test_what_an_encoding_does_not_have_is_written_out(
    text: str, encoding: str, shown: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    @click.command()
    def command() -> None:
        echo(text)
        PlainConsole().print(text)

    out = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(out, encoding=encoding))
    with pytest.raises(SystemExit) as exit_:
        run(command, "daranti", [])
    assert exit_.value.code == 0
    sys.stdout.flush()
    once, again = out.getvalue().decode(encoding).splitlines()
    assert once == again == shown


@pytest.mark.parametrize("corners", ["³", "④", "2", "-4", "4.5", "١٠٠"])
def test_a_number_of_corners_that_is_none_is_bad_usage(corners: str, cli: Cli) -> None:
    code, _, err = cli("survey", "walk.nmea", "--out", "field.geojson", "--corners", corners)
    assert code == EXIT_USER
    assert "give auto or a number from 3 to" in err


def test_success_is_zero() -> None:
    with pytest.raises(SystemExit) as exit_:
        run(click.Command("nothing", callback=lambda: None), "daranti", [])
    assert exit_.value.code == 0


def test_help_lists_every_command_without_importing_any(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as exit_:
        run(daranti, "daranti", ["--help"])
    assert exit_.value.code == 0
    out = capsys.readouterr().out
    for name in ("drive", "see", "monitor", "params", "flash", "tune", "calibrate", "bench"):
        assert f"  {name} " in out


def test_an_unknown_command_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_:
        run(daranti, "daranti", ["fly"])
    assert exit_.value.code == EXIT_USER
    assert "No such command 'fly'" in capsys.readouterr().err


ALIKE = ("boundary", "gap", "inset", "field", "vehicle", "mount", "mode", "camera", "gnss", "port")


def options(name: str) -> dict[str, click.Option]:
    command = daranti.get_command(click.Context(daranti), name)
    assert command is not None
    made = [each for each in command.params if isinstance(each, click.Option)]
    return {opt.removeprefix("--"): each for each in made for opt in each.opts}


@pytest.mark.parametrize("name", ["plan", "drive", "panel", "check"])
def test_what_is_called_alike_takes_the_same(name: str) -> None:
    """Of the commands that work on a field: each takes what is asked of it elsewhere."""
    of_all = options("drive")
    own = options(name)
    for option in ALIKE:
        if option in own:
            assert own[option].type.to_info_dict() == of_all[option].type.to_info_dict(), option
    assert own.keys() >= {"gap", "inset", "field", "vehicle"}
    assert "boundary" in own or name == "plan"


def test_a_port_of_the_web_is_called_alike_wherever_a_page_is_served() -> None:
    panel, page = options("panel")["web-port"], every("tune")["vision"]
    mine = next(each for each in page.params if "--web-port" in each.opts)
    assert mine.type.to_info_dict() == panel.type.to_info_dict()
    assert not any("--port" in each.opts for each in page.params)


def every(name: str) -> dict[str, click.Command]:
    """The commands of a group of `daranti`."""
    group = daranti.get_command(click.Context(daranti), name)
    assert isinstance(group, click.Group)
    context = click.Context(group)
    found = {each: group.get_command(context, each) for each in group.list_commands(context)}
    return {each: command for each, command in found.items() if command is not None}


def numbers(group: click.Group, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """The options that take a number of a range."""
    found: list[tuple[str, ...]] = []
    for name in group.list_commands(click.Context(group)):
        command = group.get_command(click.Context(group), name)
        if isinstance(command, click.Group):
            found += numbers(command, (*path, name))
        elif command is not None:
            ranges = (p for p in command.params if isinstance(p.type, click.FloatRange))
            found += [(*path, name, option.opts[0]) for option in ranges]
    return found


@pytest.mark.parametrize("words", numbers(daranti), ids=" ".join)
@pytest.mark.parametrize("value", ["inf", "-inf", "1e999"])
def test_what_is_infinite_lies_in_no_range(
    words: tuple[str, ...], value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as exit_:
        run(daranti, "daranti", [*words, value])
    assert exit_.value.code == EXIT_USER
    err = capsys.readouterr().err
    assert "is infinite; give a number" in err or "is not in the range" in err


@pytest.mark.parametrize("words", numbers(daranti), ids=" ".join)
def test_what_is_no_number_lies_in_no_range(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as exit_:
        run(daranti, "daranti", [*words, "nan"])
    assert exit_.value.code == EXIT_USER
    assert "nan is no number" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        run(daranti, "daranti", [*words, "2m"])
    assert "'2m' is not a valid number." in capsys.readouterr().err
