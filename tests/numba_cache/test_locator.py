"""A change in any file that went into compiled code has it compiled anew."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from numba_cache.locator import stamp

ROOT = Path(__file__).parents[2]

FILES = {
    "near/__init__.py": "",
    "far/__init__.py": "",
    "far/units.py": "SCALE = {value}\n",
    "far/step.py": """
from numba import njit
from far.units import SCALE

@njit(cache=True)
def step(x):
    return x + SCALE
""",
    "near/loop.py": """
from numba import njit
from far import (
    step,
)

@njit(cache=True)
def run(x):
    return step.step(x)
""",
}
RUN = """
import sys; sys.path.append({root!r})
import numba_cache; numba_cache.follow_imports()
from near import loop
print(loop.run(0), sum(loop.run.stats.cache_hits.values()))
"""


def write(folder: Path, value: int) -> None:
    for name, text in FILES.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text.replace("{value}", str(value)))


@pytest.mark.parametrize("base", [None, "elsewhere"])
def test_a_constant_of_another_package_reaches_a_cached_caller(
    tmp_path: Path, base: str | None
) -> None:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")}
    if base is not None:
        environment["NUMBA_CACHE_DIR"] = str(tmp_path / base)

    def run(value: int) -> tuple[int, int]:
        write(tmp_path, value)
        script = [sys.executable, "-B", "-c", RUN.format(root=str(ROOT))]
        done = subprocess.run(
            script, cwd=tmp_path, capture_output=True, text=True, check=True, env=environment
        )
        found, hits = done.stdout.split()
        return int(found), int(hits)

    assert [run(1), run(1), run(2), run(2), run(1)] == [(1, 0), (1, 1), (2, 0), (2, 1), (1, 0)]
    assert (base is None) or list((tmp_path / base).glob("*/*.nbi"))


@pytest.mark.parametrize(
    ("changed", "matters"),
    [("far/units.py", True), ("far/step.py", True), ("near/loop.py", True), ("far/b.py", False)],
)
def test_what_is_imported_matters_and_nothing_else(
    tmp_path: Path, changed: str, matters: bool
) -> None:
    stamps = []
    for place in ("before", "after"):
        folder = tmp_path / place
        folder.mkdir()
        write(folder, 1)
        (folder / "far/b.py").write_text("")
        if place == "after":
            with (folder / changed).open("a") as source:
                source.write("\n")
        stamps.append(stamp(folder / "near/loop.py"))
    assert (stamps[0] != stamps[1]) is matters


@pytest.mark.parametrize("package", ["host", "hil", "sim_plant"])
@pytest.mark.parametrize("first", ["", "import numba; "])
def test_every_package_caches_so(package: str, first: str) -> None:
    script = f"{first}import {package}, numba; print(numba.config.CACHE_LOCATOR_CLASSES)"
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")}
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        env=environment,
    )
    assert done.stdout.strip() == "numba_cache.locator.ByImports"
