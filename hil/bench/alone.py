"""One program at a time writes into a folder."""

from __future__ import annotations

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from host.core.errors import UserError


@contextmanager
def alone(folder: Path, what: str) -> Iterator[None]:
    """Makes the folder and keeps others out of it; UserError where another `what` of this machine
    writes there. The lock ends with the process, however that ends."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / ".running").open("w", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise UserError(
                f"another {what} is writing to {folder}; wait for its end, or give another --out"
            ) from error
        yield
