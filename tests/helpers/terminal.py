"""A terminal that a command asks at, and who types there."""

from __future__ import annotations

import os
import pty


class Terminal:
    """A pseudo-terminal as stdin."""

    def __init__(self) -> None:
        self.master, slave = pty.openpty()
        self.stdin = os.fdopen(slave, "r")

    def type(self, text: str) -> None:
        os.write(self.master, text.encode())

    def close(self) -> None:
        os.close(self.master)
        self.stdin.close()
