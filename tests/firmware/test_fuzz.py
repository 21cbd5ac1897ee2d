"""The fuzz targets build, run and reach what they judge: tools/fuzz.sh, short. The controller's had
not compiled for months, and had never armed the machine: nothing of it was judged."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent


@pytest.mark.parametrize(("target", "inputs"), [("parser", 20_000), ("controller", 500)])
def test_every_fact_holds(target: str, inputs: int) -> None:
    command = ["sh", str(ROOT / "tools" / "fuzz.sh"), target, str(inputs), "7"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    if target == "parser":
        return
    told = re.search(r"live in (\d+) of (\d+) ticks, (\d+) in reverse, (\d+) with", done.stdout)
    assert told is not None, done.stdout
    live, ticks, reverse, blade = map(int, told.groups())
    assert live > ticks // 20
    assert reverse > ticks // 1000
    assert blade > ticks // 1000
