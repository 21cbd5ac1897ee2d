"""Files that are written whole or not at all, and one message where they cannot be."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from host.core.errors import UserError


@contextmanager
def whole(path: Path, *, sync: bool = True) -> Iterator[Path]:
    """A path to write to, which takes the place of `path` once it is whole and on the disk: what
    stood there stands until then, also when the power fails in between. It ends as `path` does, for
    writers that go by the suffix. `sync=False`: one of many that a power failure may cost. OSError
    where it cannot be written."""
    path = Path(os.path.realpath(path))  # a link stays one
    if path.exists() and not stat.S_ISREG(path.stat().st_mode):
        yield path  # a device or a pipe is written to, not replaced
        return
    fresh = path.with_name(f".{os.getpid()}.{path.name}")
    try:
        yield fresh
        if sync:
            with fresh.open("rb+") as file:
                os.fsync(file.fileno())
        fresh.replace(path)
    except BaseException:
        with suppress(OSError):
            fresh.unlink()
        raise
    if not sync:
        return
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # the new name, too, is on the disk
    finally:
        os.close(folder)


def write_whole(path: Path, text: str) -> None:
    """UTF-8, whole or not at all. OSError where it cannot be written."""
    with whole(path) as fresh:
        fresh.write_text(text, encoding="utf-8")


@contextmanager
def saved(path: Path, *, sync: bool = True) -> Iterator[Path]:
    """As `whole`; UserError where it cannot be written. Some libraries name no file, and no cause
    but their own."""
    try:
        with whole(path, sync=sync) as fresh:
            yield fresh
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        why = "the disk is full; free some of it, or write elsewhere" if full else ""
        raise UserError(f"cannot write {path}: {why or error.strerror or error}") from error


def save_text(path: Path, text: str) -> None:
    """UTF-8, whole or not at all. UserError where it cannot be written."""
    with saved(path) as fresh:
        fresh.write_text(text, encoding="utf-8")
