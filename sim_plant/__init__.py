"""The world that the machine meets: machine, field, camera picture, positions, phone.

Compiled code is cached in a folder that is named by the content of this package. Numba's own rule
looks at the file of the cached function alone: a loop elsewhere that has `machine.step` compiled
into it would go on running the old one after a change here.
"""

from __future__ import annotations

import hashlib
import shutil
import time
from pathlib import Path
from typing import Final

from numba import config

_KEPT_S: Final = 86400.0
"""Folders of older contents are kept so long, for processes that still run."""


def cache_folder(package: Path, base: Path | None = None) -> Path:
    """Where compiled code of a package with the present content belongs: below `base`
    (NUMBA_CACHE_DIR), or beside the package's byte code."""
    content = hashlib.sha256()
    for source in sorted((*package.glob("*.py"), *package.glob("*.cpp"))):
        content.update(source.name.encode() + b"\0" + source.read_bytes() + b"\0")
    return (base or package / "__pycache__") / f"numba-{content.hexdigest()[:16]}"


def _use(folder: Path) -> None:
    try:
        if not folder.exists():
            folder.mkdir(parents=True)
            for other in folder.parent.glob("numba-*"):
                if time.time() - other.stat().st_mtime > _KEPT_S:
                    shutil.rmtree(other, ignore_errors=True)
        folder.touch()
    except OSError:
        return  # a read-only installation: numba finds a place of its own
    config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]


_given: str = config.CACHE_DIR  # type: ignore[attr-defined]
_use(cache_folder(Path(__file__).parent, Path(_given) if _given else None))
