"""Mutation testing of host, hil and sim_plant: one deliberate break a time, against its tests.

    python tools/mutate_python.py            # all of tools/python_mutants.toml, as a table
    python tools/mutate_python.py hil/judge  # those of the files below a path

Each entry of the list names a file, a text that stands in it once, what takes its place, and the
tests that must notice. The tests run on a copy of the tree, so that nothing here changes. Exits 1
where a mutant survives or its text is no longer there (tests/docs/test_mutants.py finds that too).
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

ROOT = Path(__file__).resolve().parent.parent
LIST = Path(__file__).with_name("python_mutants.toml")
COPIED = (
    *("host", "hil", "sim_plant", "numba_cache", "tests", "tools", "docs"),
    *("pyproject.toml", "README.md"),
)
LINKED = (".pio", "build", "firmware", "platformio.ini", "Makefile", "CONTRIBUTING.md")
TIMEOUT_S = 240
"""A mutant that never ends counts as killed."""


@dataclass(frozen=True, slots=True)
class Mutant:
    """One break. `tests`: what pytest is given, words apart."""

    file: str
    old: str
    new: str
    tests: str


def mutants() -> list[Mutant]:
    """The list. ValueError where an entry's text does not stand in its file just once."""
    found = [Mutant(**entry) for entry in tomllib.loads(LIST.read_text("utf-8"))["mutant"]]
    for mutant in found:
        count = (ROOT / mutant.file).read_text("utf-8").count(mutant.old)
        if count != 1:
            raise ValueError(
                f"{mutant.file}: {mutant.old!r} stands there {count} times, not once; "
                f"give {LIST.name} a break of what stands there now"
            )
    return found


def copy_of_the_tree(into: Path) -> None:
    """What the tests need; what is only read is linked."""
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, into / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, into / name)
    for name in LINKED:
        (into / name).symlink_to(ROOT / name)


def forget_compiled(tree: Path, source: str) -> None:
    """Drops the compiled loops where `source` has one: what another file compiled into its own
    would go on with the loop as it was."""
    if "njit" in source:
        for kept in tree.rglob("*.nb[ic]"):
            kept.unlink()


def killed(mutant: Mutant, tree: Path) -> bool:
    """Whether a test notices."""
    path = tree / mutant.file
    sound = path.read_text("utf-8")
    path.write_text(sound.replace(mutant.old, mutant.new), "utf-8")
    forget_compiled(tree, sound)
    try:
        words = [sys.executable, "-m", "pytest", "-q", "-x", "-n0", "-p", "no:cacheprovider"]
        run = subprocess.run(
            [*words, *mutant.tests.split()],
            cwd=tree,
            capture_output=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return True
    finally:
        path.write_text(sound, "utf-8")
        forget_compiled(tree, sound)
    if run.returncode not in (0, 1):
        raise SystemExit(f"{mutant.tests}: pytest could not run them:\n{run.stdout.decode()}")
    return run.returncode == 1


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description="Breaks the Python code and runs its tests.")
    parser.add_argument("below", nargs="?", default="", help="only files whose path begins so")
    below = parser.parse_args().below
    try:
        chosen = [m for m in mutants() if m.file.startswith(below)]
    except ValueError as error:
        print(error, file=sys.stderr)
        return 1
    survivors = 0
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        tree = Path(folder)
        copy_of_the_tree(tree)
        for mutant in chosen:
            noticed = killed(mutant, tree)
            survivors += not noticed
            word = "killed" if noticed else "SURVIVED"
            print(f"{word:9} {mutant.file:38} {mutant.old}  ->  {mutant.new}", flush=True)
    print(f"{len(chosen) - survivors} of {len(chosen)} killed")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
