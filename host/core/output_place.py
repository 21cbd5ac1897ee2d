"""Where results go: asked before the work whether they can be written there."""

from __future__ import annotations

import tempfile
from pathlib import Path

from host.core.errors import UserError


def _is_there(path: Path) -> bool:
    """Whatever it is, a link to nowhere, too. OSError where no such name can be."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


def check_folder(folder: Path) -> None:
    """UserError where files cannot be written into this folder, nor it be made: better before the
    work. It is tried, for permissions do not bind everybody, nor tell of a disk that is mounted to
    be read only. Nothing is left behind."""
    try:
        there = next(filter(_is_there, (folder, *folder.absolute().parents)))
        if not there.is_dir():
            raise UserError(f"cannot write into {folder}: {there} is no folder; write elsewhere")
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise UserError(f"cannot write into {folder}: {error.strerror}; write elsewhere") from error


def check_file(path: Path) -> None:
    """The same of a file that will be written whole, beside what may be there. Its folder must be
    there."""
    if path.is_dir():
        raise UserError(f"cannot write {path}: there is a folder of that name")
    if not path.parent.is_dir():
        raise UserError(f"cannot write {path}: there is no folder {path.parent}")
    if path.is_file() or not path.exists():  # and no device or pipe
        check_folder(path.parent)
