"""Files inside a .zip (or .kmz) from outside: named, bounded, and never unpacked where they say."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from host.core.errors import UserError

MAX_BYTES = 64 * 1024 * 1024
"""Of one file in it: a farm's fields take one."""
MAC_NOTE = "._"
"""How the names of files begin in which a Mac keeps notes on another file: each has its own
suffix, and nothing of a field."""


class Archive:
    """An open .zip file."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        self._members = {
            PurePosixPath(each.filename): each
            for each in archive.infolist()
            if not each.is_dir() and not PurePosixPath(each.filename).name.startswith(MAC_NOTE)
        }

    @property
    def names(self) -> list[PurePosixPath]:
        """Of its files, the nearest to its root first."""
        return sorted(self._members, key=lambda name: (len(name.parts), name))

    def content(self, name: PurePosixPath) -> bytes:
        """UserError where it is larger than it may be."""
        member = self._members[name]
        if member.file_size > MAX_BYTES:
            raise UserError(f"{name.name} in it would take {member.file_size / 1e6:.0f} MB")
        with self._archive.open(member) as file:
            return file.read(MAX_BYTES)

    def beside(self, name: PurePosixPath) -> dict[str, PurePosixPath]:
        """The files of a file's folder, by their names in capitals."""
        return {each.name.upper(): each for each in self._members if each.parent == name.parent}


@contextmanager
def opened(path: Path) -> Iterator[Archive]:
    """UserError where it is damaged, encrypted or no .zip at all."""
    try:
        with zipfile.ZipFile(path) as archive:
            yield Archive(archive)
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError) as error:
        raise UserError(f"it is no .zip file that can be read ({error})") from error
    except (zlib.error, ValueError) as error:
        raise UserError(f"it is a damaged .zip file ({error})") from error
