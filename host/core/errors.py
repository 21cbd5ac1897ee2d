"""How both console scripts fail: one clear message on stderr, a non-zero exit, never a traceback.

| what happened                         | exit code |
|---------------------------------------|-----------|
| UserError, bad usage                  | 2         |
| Ctrl-C, SIGTERM, SIGHUP               | 130       |
| anything else, that is a programming error | 70 (EX_SOFTWARE of sysexits.h) |

`DARANTI_DEBUG=1` in the environment shows the traceback as well.
"""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Sequence
from types import FrameType
from typing import NoReturn

import click

EXIT_USER = 2
EXIT_SOFTWARE = 70
EXIT_INTERRUPTED = 130


class UserError(Exception):
    """One message for the person at the keyboard: what is wrong, where, and what to do about it."""


def _say(program: str, message: str) -> None:
    click.echo(f"{program}: {message}", err=True)
    if os.environ.get("DARANTI_DEBUG", "0") not in ("", "0"):
        traceback.print_exc()


def _interrupt(_signal: int, _frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def run(command: click.Command, program: str, args: Sequence[str] | None = None) -> NoReturn:
    """Runs a click command as the process's main function and exits. SIGTERM and a closed terminal
    unwind as Ctrl-C does, so that whoever holds the outputs gets to switch them off; and Ctrl-C
    does where a script's `&` had it ignored."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _interrupt)
    try:
        code = command.main(args, prog_name=program, standalone_mode=False)
    except UserError as error:
        _say(program, str(error))
        code = EXIT_USER
    except click.ClickException as error:
        error.show()
        code = EXIT_USER
    except (click.Abort, KeyboardInterrupt):
        _say(program, "interrupted")
        code = EXIT_INTERRUPTED
    except Exception as error:
        _say(
            program,
            f"internal error: {type(error).__name__}: {error} "
            "(DARANTI_DEBUG=1 shows where; please report it)",
        )
        code = EXIT_SOFTWARE
    sys.exit(code if isinstance(code, int) else 0)
