"""Mutation testing of the boards' code and of the simulator's shim, and the first firmware's twelve
mistakes brought back: every change of firmware/test/board_mutants.toml, built and tested.

The tests run once for each change in a copy of the checkout. One that no test notices survives
and makes this fail, unless the list says why nobody could; so does one that cannot be built, for
no test has seen it. Some ten seconds to a minute each; `--twelve` and NAME choose among them.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

ROOT = Path(__file__).resolve().parent.parent
LIST = ROOT / "firmware" / "test" / "board_mutants.toml"
SOURCE = "firmware/src/boards/atmega/atmega.cpp"
TESTS: Final = ("tests/firmware/test_boards.py", "not mega2560 and not nano")
COPIED = (
    "docs",
    "firmware",
    "hil",
    "host",
    "sim_plant",
    "tests",
    "tools",
    ".pio",
    ".platformio",
    "build",
)
SHIM = "shim"
"""In place of a PlatformIO environment: hil/firmware/simavr."""


@dataclass(frozen=True)
class Mutant:
    """One change."""

    name: str
    original: str
    mutated: str
    file: str = SOURCE
    build: str = "uno"
    tests: tuple[str, ...] = TESTS
    """A file, and which of its tests (pytest's -k)."""
    item: int = 0
    """Of the twelve mistakes; 0: none of them."""
    reason: str = ""
    """Why no test can notice it."""

    def changed(self, text: str) -> str:
        """The file with the change. ValueError where it does not have just one such place."""
        if text.count(self.original) != 1:
            raise ValueError(f"{self.name}: {self.file} has not just one {self.original!r}")
        return text.replace(self.original, self.mutated)


def listed() -> list[Mutant]:
    """All of them, in the list's order."""

    def one(entry: dict[str, Any]) -> Mutant:
        values: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in entry.items()
        }
        return Mutant(**values)

    return [one(entry) for entry in tomllib.loads(LIST.read_text(encoding="utf-8"))["mutant"]]


def run(folder: Path, *command: str) -> bool:
    """Whether it succeeds in the copy."""
    done = subprocess.run(command, cwd=folder, capture_output=True, check=False)
    return done.returncode == 0


def built(folder: Path, build: str) -> bool:
    """Whether what the tests run could be built."""
    if build == SHIM:
        return run(folder, "make", "-s", "-C", "hil/firmware/simavr")
    command = (sys.executable, "-m", "platformio", "run", "--silent", "-e", build)
    return not build or run(folder, *command)


def passes(folder: Path, tests: tuple[str, ...]) -> bool:
    """Whether the tests pass."""
    file, chosen = tests
    options = ("-q", "-x", "-n0", "-p", "no:cacheprovider")
    return run(folder, sys.executable, "-m", "pytest", *options, file, "-k", chosen)


def fate(folder: Path, mutant: Mutant) -> str:
    """What becomes of it: killed, survives, or not built. The change is taken back, but not yet in
    what was built with it."""
    path = folder / mutant.file
    text = path.read_text(encoding="utf-8")
    path.write_text(mutant.changed(text), encoding="utf-8")
    try:
        if not built(folder, mutant.build):
            return "CANNOT BE BUILT"
        return "survives" if passes(folder, mutant.tests) else "killed"
    finally:
        path.write_text(text, encoding="utf-8")


def main() -> int:
    """Builds and tests the mutants, prints a line each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twelve", action="store_true", help="the first firmware's mistakes alone")
    parser.add_argument("name", nargs="*", help="of mutants, or a part of it; all where none is")
    arguments = parser.parse_args()
    chosen = [
        mutant
        for mutant in listed()
        if (mutant.item or not arguments.twelve)
        and (not arguments.name or any(part in mutant.name for part in arguments.name))
    ]
    if not chosen:
        parser.error(f"{LIST.name} has no such mutant")
    unexplained = 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for name in COPIED:
            shutil.copytree(ROOT / name, folder / name, symlinks=True)
        for name in ("platformio.ini", "pyproject.toml"):
            shutil.copy(ROOT / name, folder / name)
        for tests in dict.fromkeys(mutant.tests for mutant in chosen):
            if not passes(folder, tests):
                print(f"{tests} fails without any mutant: mend it first", file=sys.stderr)
                return 1
        changed = ""  # what was built with a change
        for mutant in chosen:
            if changed != mutant.build:
                built(folder, changed)
            changed = mutant.build
            try:
                found = fate(folder, mutant)
            except ValueError as error:
                print(error, file=sys.stderr)
                return 1
            verdict = found
            if found == "survives":
                verdict += f": {mutant.reason or 'NOBODY NOTICES'}"
            elif found == "killed" and mutant.reason:
                verdict += ", though the list says why nobody could"
            mark = f"{mutant.item:>2}" if mutant.item else "  "
            print(f"{mark} {mutant.name:<78}{verdict}", flush=True)
            unexplained += (found == "killed") == bool(mutant.reason)
    return 1 if unexplained else 0


if __name__ == "__main__":
    sys.exit(main())
