"""The panel's end of the machine's process: starts it, or meets the one that still runs."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from host.core.errors import UserError
from host.panel.machine import Settings
from host.panel.snapshot import Json
from host.panel.wire import Frames, WireError, packed

START_EVERY_S: Final = 2.0
"""Seconds from one start of the machine's program to the next: one that ends at once is not started
in a burst, nor does its log grow by one."""
LAST_WORDS: Final = 300
"""Bytes at the end of the log that may hold why the machine's program ended."""
AGAIN_S: Final = 0.5
"""Between tries to reach it."""


def socket_path(settings: Settings) -> Path:
    """Where the machine of a port listens: one process a port, whoever starts the panel."""
    base = Path(os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir())
    folder = base / f"daranti-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    if folder.stat().st_uid != os.getuid() or folder.stat().st_mode & 0o077:
        raise UserError(f"{folder} belongs to somebody else or is open to others: remove it")
    name = "".join(c if c.isalnum() else "-" for c in settings.port)[-60:]
    return folder / f"{name}.sock"


class MachineLine:
    """The connection to the machine's process, kept up. `on_message` and `on_picture` are called
    with what it says."""

    def __init__(
        self,
        settings: Settings,
        on_message: Callable[[Json], None],
        on_picture: Callable[[bytes], None],
    ) -> None:
        self.settings = settings
        self.path = socket_path(settings)
        self.connected = False
        self.problem = ""
        """Why the process does not run, as far as that is known."""
        self._on_message = on_message
        self._on_picture = on_picture
        self._writer: asyncio.StreamWriter | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._started = -math.inf

    async def run(self) -> None:
        """For as long as the panel lives: connects, listens, and starts the process again when it
        has died."""
        while True:
            try:
                reader, self._writer = await asyncio.open_unix_connection(str(self.path))
            except OSError:
                dead = self._process is None or self._process.poll() is not None
                if dead and time.monotonic() - self._started >= START_EVERY_S:
                    self._started = time.monotonic()
                    self._last_words()
                    try:
                        self._start()
                    except (OSError, ValueError) as error:
                        # A stick that was pulled may be back: it is tried on.
                        self.problem = str(error)
                await asyncio.sleep(AGAIN_S / 5)
                continue
            self.connected, self.problem = True, ""
            with contextlib.suppress(OSError, WireError, asyncio.IncompleteReadError):
                await self._listen(reader)
            self.connected = False
            self._writer = None
            await asyncio.sleep(AGAIN_S)

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        frames = Frames()
        while data := await reader.read(65536):
            for kind, payload in frames.feed(data):
                if kind == "P":
                    self._on_picture(payload)
                    continue
                message = json.loads(payload)
                if message["kind"] != "machine":
                    self._on_message(message)
                elif message["settings"] != self.settings.model_dump(mode="json"):
                    # Of a panel before us, with other devices: it ends unless it drives.
                    self.ask({"do": "end"})
                    if message["mode"] == "idle":
                        return

    def ask(self, wish: Json) -> bool:
        """Tells the machine's process; False where there is none to tell."""
        if self._writer is None or self._writer.is_closing():
            return False
        self._writer.write(packed(wish))
        return True

    def _last_words(self) -> None:
        """Of a process that has ended by itself."""
        if self._process is None:
            return
        with contextlib.suppress(OSError):
            log = (self.settings.folder / "machine.log").read_bytes()[-LAST_WORDS:]
            lines = log.decode(errors="replace").split("\n")
            self.problem = next((line for line in reversed(lines) if line.strip()), "")

    def _start(self) -> None:
        settings = self.path.with_suffix(".json")
        settings.write_text(self.settings.model_dump_json(), encoding="utf-8")
        command: list[Any] = [sys.executable, "-m", "host.panel", settings, self.path]
        log = (self.settings.folder / "machine.log").open("ab")
        with log:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True
            )

    def end(self, patience_s: float = 3.0) -> None:
        """Ends the process, after a STOP."""
        self.ask({"do": "stop", "id": None})
        self.ask({"do": "end"})
        if self._process is None:
            return
        deadline = time.monotonic() + patience_s
        while self._process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.02)
        if self._process.poll() is None:
            self._process.terminate()
