"""The manned rig as a process of its own, and the person beside it."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[2]
Json = dict[str, Any]


class Rig:
    """`tests/helpers/manned_rig.py` as a process."""

    def __init__(self, scenario: str, folder: Path) -> None:
        self._log = (folder / "rig.log").open("wb")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.helpers.manned_rig", scenario, folder / "rig"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
            cwd=ROOT,
        )
        self.about: Json = self._line()

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    def _line(self) -> Json:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"the rig has ended: see {self._log.name}")
        return dict(json.loads(line))

    def do(self, deed: str = "look", **values: Any) -> Json:
        """A deed of the person; returns the truth after it."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"do": deed, **values}) + "\n")
        self._process.stdin.flush()
        return self._line()

    def close(self) -> None:
        """Ends it."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        self._process.wait(20)
        self._log.close()
