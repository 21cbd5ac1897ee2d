"""How both console scripts fail: one clear message on stderr, a non-zero exit, never a traceback.

| what happened                                                       | exit code |
|---------------------------------------------------------------------|-----------|
| it did what it was asked                                            | 0         |
| bad usage, bad input, a precondition that does not hold             | 2         |
| it ended before the work was done: a field not finished, pictures   | 3         |
| left out                                                            |           |
| a fault of the machine, or of a device that it needs, ended it      | 4         |
| Ctrl-C, SIGTERM, SIGHUP                                             | 130       |
| whoever read the output has gone                                    | 141       |
| anything else, that is a programming error                          | 70        |

(70 is EX_SOFTWARE of sysexits.h.) `DARANTI_DEBUG=1` in the environment shows the traceback as well.
"""

from __future__ import annotations

import errno
import io
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from types import FrameType
from typing import NoReturn

import click

from host.core.terminal import ReaderGoneError, echo

_OF_A_DISK = (errno.EIO, errno.EROFS, errno.EFBIG)
"""What a disk, besides being full, may answer to whoever has long forgotten the file's name."""
EXIT_USER = 2
EXIT_UNFINISHED = 3
EXIT_FAULT = 4
EXIT_SOFTWARE = 70
EXIT_INTERRUPTED = 130
EXIT_PIPE = 141
"""Exit codes: 128 and the signal's number for the last two, sysexits.h's for an internal error; the
others are explained in docs/use/drive.md."""


class UserError(Exception):
    """One message for the person at the keyboard: what is wrong, where, and what to do about it."""

    exit_code = EXIT_USER


class UnfinishedError(UserError):
    """It ended before the work was done; the message says what is left and how to go on."""

    exit_code = EXIT_UNFINISHED


class FaultError(UserError):
    """The machine, or a device that it cannot do without, failed while it worked."""

    exit_code = EXIT_FAULT


def _say(program: str, message: str) -> None:
    echo(f"{program}: {message}", err=True)
    if os.environ.get("DARANTI_DEBUG", "0") not in ("", "0"):
        traceback.print_exc()


class _Interrupts:
    """Ctrl-C, and what libraries written in C make of it. Where one has called back, as numba's
    does while it compiles, it cannot be raised: the library fails later, for a reason that says
    nothing. And what was half made complains as it is thrown away."""

    def __init__(self) -> None:
        self.lost = False
        """One could not be raised."""
        self._asked = False
        self._otherwise = sys.unraisablehook

    def signalled(self, _signal: int, _frame: FrameType | None) -> NoReturn:
        """A handler of signals."""
        self._asked = True
        raise KeyboardInterrupt

    def unraisable(self, what: sys.UnraisableHookArgs) -> None:
        """Python's hook for what cannot be raised."""
        if isinstance(what.exc_value, KeyboardInterrupt):
            self.lost = True
        elif not self._asked:
            self._otherwise(what)


def _internal(program: str, error: Exception) -> int:
    _say(
        program,
        f"internal error: {type(error).__name__}: {error} "
        "(DARANTI_DEBUG=1 shows where; please report it)",
    )
    return EXIT_SOFTWARE


def run(command: click.Command, program: str, args: Sequence[str] | None = None) -> NoReturn:
    """Runs a click command as the process's main function and exits. SIGTERM and a closed terminal
    unwind as Ctrl-C does, so that whoever holds the outputs gets to switch them off; and Ctrl-C
    does where a script's `&` had it ignored."""
    interrupts = _Interrupts()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, interrupts.signalled)
    sys.unraisablehook = interrupts.unraisable
    if isinstance(sys.stdout, io.TextIOWrapper):
        # a degree sign, or a field's Urdu name, is no reason to fail in an old locale
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        code = command.main(args, prog_name=program, standalone_mode=False)
    except UserError as error:
        _say(program, str(error))
        code = error.exit_code
    except click.ClickException as error:
        error.show()
        code = EXIT_USER
    except (click.Abort, KeyboardInterrupt):
        _say(program, "interrupted")
        code = EXIT_INTERRUPTED
    except ReaderGoneError:  # `daranti ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = EXIT_PIPE
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            where = f" ({error.filename})" if error.filename else ""
            _say(program, f"the disk is full; free some of it, or write elsewhere{where}")
            code = EXIT_USER
        elif error.filename is None and error.errno in _OF_A_DISK:
            _say(program, f"a file cannot be written: {error.strerror}; write elsewhere")
            code = EXIT_USER
        elif error.filename is None or error.strerror is None:
            code = _internal(program, error)
        else:
            _say(program, f"cannot use {error.filename}: {error.strerror}")
            code = EXIT_USER
    except Exception as error:
        if interrupts.lost:
            _say(program, "interrupted")
            code = EXIT_INTERRUPTED
        else:
            code = _internal(program, error)
    sys.exit(code if isinstance(code, int) else 0)
