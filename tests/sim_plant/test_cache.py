"""A change anywhere in the plant recompiles whatever has the plant compiled into it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from sim_plant import cache_folder

PLANT = """
from numba import njit

@njit(cache=True)
def step(x):
    return x + {value}
"""
LOOP = """
import sim_plant
from numba import njit
from sim_plant import machine

@njit(cache=True)
def run(x):
    return machine.step(x)

print(run(0))
"""


def test_the_folder_follows_the_content(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("1")
    one = cache_folder(tmp_path)
    assert cache_folder(tmp_path) == one
    (tmp_path / "a.py").write_text("2")
    two = cache_folder(tmp_path)
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert len({one, two, cache_folder(tmp_path)}) == 3


@pytest.mark.parametrize("base", [None, "elsewhere"])
def test_a_cached_caller_in_another_package_sees_the_change(
    tmp_path: Path, base: str | None
) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    if base is not None:
        environment["NUMBA_CACHE_DIR"] = str(tmp_path / base)
    package = tmp_path / "sim_plant"
    package.mkdir()
    real = Path(sys.modules["sim_plant"].__file__ or "")
    (package / "__init__.py").write_text(real.read_text())
    (tmp_path / "loop.py").write_text(LOOP)

    def run(value: int) -> str:
        (package / "machine.py").write_text(PLANT.format(value=value))
        script = [sys.executable, "-B", "-c", "import loop"]
        done = subprocess.run(
            script, cwd=tmp_path, capture_output=True, text=True, check=True, env=environment
        )
        return done.stdout.strip()

    assert (run(1), run(1), run(2), run(1)) == ("1", "1", "2", "1")
