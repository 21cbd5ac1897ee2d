"""Files that are read: what only looks like one would make a command wait for ever."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from host.core.errors import UserError


def is_piped(path: Path) -> bool:
    """Whether it is the end of a pipe without a name: standard input, or a shell's `<(...)`.
    Somebody writes it, and it ends; it can be read once."""
    try:
        piped = stat.S_ISFIFO(path.stat().st_mode)
    except (OSError, ValueError):
        return False
    return piped and not Path(os.path.realpath(path)).exists()


def check_input(path: Path, what: str, *, once: bool = True) -> None:
    """UserError where reading a path may never end: a device, a socket, a pipe with a name that
    nobody need ever write to. A pipe without a name will do where it is read `once`. What is not
    there, and what is no path, is left to the reader."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return
    if stat.S_ISREG(mode) or stat.S_ISDIR(mode) or (once and is_piped(path)):
        return
    kind = "a pipe" if stat.S_ISFIFO(mode) else "a socket" if stat.S_ISSOCK(mode) else "a device"
    raise UserError(f"{what} {path} is {kind}, not a file; name a file")
