"""Where numba keeps compiled code (where it always does), and what makes it out of date."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final

from numba.core import caching

PLACES: Final = (
    caching.UserProvidedCacheLocator,
    caching.InTreeCacheLocator,
    caching.UserWideCacheLocator,
)
"""NUMBA_CACHE_DIR, beside the byte code, the user's folder where the tree may not be written."""
ROOT: Final = Path(__file__).resolve().parents[1]
PACKAGES: Final = ("host", "hil", "sim_plant")
"""Below ROOT. No others are followed: where Daranti is installed, all packages lie there."""
IMPORT: Final = re.compile(
    r"^\s*(?:from\s+([\w.]+)\s+import\s+(\([^)]*\)|[^\n]+)|import\s+([\w.]+))", re.MULTILINE
)
"""A statement that imports. Regular expressions read a file in a hundredth of the time that
Python's parser takes, and what they find too much (in a text) only compiles something anew."""


class ByImports(caching._CacheLocator):
    """Compiled code is out of date if its file, wherever that lies, or any file of PACKAGES that it
    imports, directly or through others, has another content.

    Numba calls this by name: see `NUMBA_CACHE_LOCATOR_CLASSES` in numba's reference.
    """

    def __init__(self, place: Any, file: Path) -> None:
        self._place = place
        self._file = file

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> ByImports | None:
        for kind in PLACES:
            place = kind.from_function(function, file)  # type: ignore[no-untyped-call]
            if place is not None:
                return cls(place, Path(file))
        return None

    def get_cache_path(self) -> str:
        return str(self._place.get_cache_path())

    def get_disambiguator(self) -> str:
        return str(self._place.get_disambiguator())

    def get_source_stamp(self) -> bytes:
        return stamp(self._file)


@cache
def stamp(file: Path, root: Path = ROOT) -> bytes:
    """A digest of a source file and of all that it imports of PACKAGES, below `root`, to any
    depth."""
    found: dict[Path, bytes] = {}
    ahead = [file.resolve()]
    while ahead:
        source = ahead.pop()
        if source not in found:
            found[source], imported = _read(source, root)
            ahead += imported
    content = hashlib.sha256()
    for source in sorted(found):
        content.update(source.name.encode() + b"\0" + found[source])
    return content.digest()


@cache
def _read(source: Path, root: Path) -> tuple[bytes, tuple[Path, ...]]:
    """A file's own digest, and the files of PACKAGES that it imports."""
    text = source.read_bytes()
    imported = tuple(_imported(text.decode(errors="replace"), root))
    return hashlib.sha256(text).digest(), imported


def _imported(text: str, root: Path) -> Iterator[Path]:
    for module, names, plain in IMPORT.findall(text):
        path = _module(root, module or plain)
        if path is not None:
            yield path
            if path.name == "__init__.py":  # what is named may be modules of the package
                found = (_module(root, f"{module}.{name}") for name in re.findall(r"\w+", names))
                yield from (each for each in found if each is not None)


@cache
def _module(root: Path, name: str) -> Path | None:
    """The file of a module of PACKAGES; None of any other."""
    parts = name.split(".")
    if parts[0] not in PACKAGES:
        return None
    base = root.joinpath(*parts)
    for path in (base.with_suffix(".py"), base / "__init__.py"):
        if path.is_file():
            return path
    return None
