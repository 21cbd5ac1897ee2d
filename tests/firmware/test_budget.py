"""The AVR keeps its budget and withstands random bytes: the commands of
docs/understand/firmware.md, short."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.firmware.conftest import maker_of

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.mark.parametrize("command", [["avr_budget.py"], ["fuzz_avr.py", "30000", "7"]])
def test_holds(command: list[str]) -> None:
    maker_of("avr")
    tool, *arguments = command
    done = subprocess.run(
        [sys.executable, str(ROOT / "tools" / tool), *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
