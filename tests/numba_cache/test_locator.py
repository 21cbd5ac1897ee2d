"""A change in any file that went into compiled code has it compiled anew."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from numba_cache.locator import stamp

ROOT = Path(__file__).parents[2]

FILES = {
    "sim_plant/__init__.py": "import numba_cache\nnumba_cache.follow_imports()\n",
    "sim_plant/units.py": "SCALE = {value}\n",
    "sim_plant/step.py": """
from numba import njit
from sim_plant.units import SCALE

@njit(cache=True)
def step(x):
    return x + SCALE
""",
    "hil/__init__.py": "",
    "hil/other.py": "",
    "hil/loop.py": """
import library
from numba import njit
from sim_plant import (
    step,
)

@njit(cache=True)
def run(x):
    return step.step(x)
""",
    "library/__init__.py": "",
    "aside/tool.py": """
import sys
from numba import njit
from hil import loop

@njit(cache=True)
def run(x):
    return loop.run(x)

for each in (loop.run, run):
    print(each(0), sum(each.stats.cache_hits.values()))
""",
}
"""As an installation has them: others' packages lie beside ours, and a tool lies elsewhere."""


def write(folder: Path, value: int) -> None:
    for name, text in FILES.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text.replace("{value}", str(value)))


@pytest.mark.parametrize("base", [None, "elsewhere"])
def test_a_constant_of_another_package_reaches_cached_callers_inside_and_outside(
    tmp_path: Path, base: str | None
) -> None:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")}
    environment["PYTHONPATH"] = str(tmp_path)
    if base is not None:
        environment["NUMBA_CACHE_DIR"] = str(tmp_path / base)
    shutil.copytree(ROOT / "numba_cache", tmp_path / "numba_cache")

    def run(value: int) -> list[str]:
        write(tmp_path, value)
        script = [sys.executable, "-B", "aside/tool.py"]
        done = subprocess.run(
            script, cwd=tmp_path, capture_output=True, text=True, check=True, env=environment
        )
        return done.stdout.split("\n")[:2]

    fresh, kept = (lambda value, hits=hits: [f"{value} {hits}"] * 2 for hits in (0, 1))
    found = [run(value) for value in (1, 1, 2, 2, 1)]
    assert found == [fresh(1), kept(1), fresh(2), kept(2), fresh(1)]
    assert (base is None) or list((tmp_path / base).glob("*/*.nbi"))


@pytest.mark.parametrize("of", ["hil/loop.py", "aside/tool.py"])
@pytest.mark.parametrize(
    ("changed", "matters"),
    [
        ("sim_plant/units.py", True),
        ("sim_plant/step.py", True),
        ("hil/loop.py", True),
        ("hil/other.py", False),
        ("library/__init__.py", False),
    ],
)
def test_what_is_imported_of_our_packages_matters_and_nothing_else(
    tmp_path: Path, of: str, changed: str, matters: bool
) -> None:
    stamps = []
    for place in ("before", "after"):
        folder = tmp_path / place
        folder.mkdir()
        write(folder, 1)
        if place == "after":
            with (folder / changed).open("a") as source:
                source.write("\n")
        stamps.append(stamp(folder / of, folder))
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
