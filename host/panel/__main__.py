"""The machine's process: `python -m host.panel SETTINGS.json SOCKET`, started by `daranti panel`.

It outlives a panel that dies, and ends when the panel asks it to or stays away."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import time
from pathlib import Path

from host.core.errors import UserError
from host.panel.deeds import DEEDS
from host.panel.machine import Machine, Settings, listen
from host.runs.ready import make_ready

PRIORITY = -15
"""Before browser and panel, where the system lets its user ask for that."""


def main(settings_file: str, socket_file: str) -> None:
    """Runs the machine until it is told to end."""
    settings = Settings.model_validate(json.loads(Path(settings_file).read_text(encoding="utf-8")))
    begun = time.monotonic()

    def clock() -> float:
        return time.monotonic() - begun

    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, PRIORITY)
    path = Path(socket_file)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the panel's Ctrl-C; the panel says when to end
    make_ready()
    machine = Machine(settings, listen(path), clock)
    try:
        machine.plug()
        machine.run(DEEDS)
    finally:
        machine.unplug()
        path.unlink(missing_ok=True)


if __name__ == "__main__":
    try:
        main(*sys.argv[1:3])
    except UserError as error:
        sys.exit(f"daranti panel: {error}")
