"""Mutation testing of the boards' code: each change below, compiled for the Uno and run in simavr.

The tests of tests/firmware run once for each, in a copy of the checkout; one that no test notices
survives and makes this fail, unless it says why nobody could. Some ten seconds to a minute each.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final, NamedTuple

ROOT = Path(__file__).resolve().parent.parent
SOURCE = Path("firmware") / "src" / "boards" / "atmega" / "atmega.cpp"
TESTS = ("tests/firmware/test_boards.py", "tests/firmware/test_behaviour.py")
NOT_NEEDED = "not mega2560 and not nano and not desk-"
COPIED = ("firmware", "hil", "host", "sim_plant", "tests", "tools", ".pio", ".platformio", "build")


class Mutant(NamedTuple):
    """One change of the source."""

    name: str
    original: str
    mutated: str
    equivalent: str = ""
    """Why no test can notice it."""


MUTANTS: Final = (
    Mutant(
        "baud divisor not rounded",
        "(F_CPU / 4 / protocol::kBaud + 1) / 2 - 1;",
        "F_CPU / 8 / protocol::kBaud;",
    ),
    Mutant(
        "watchdog kicked in the timer's interrupt",
        "  sample();\n  if (++samples",
        "  wdt_reset();\n  sample();\n  if (++samples",
    ),
    Mutant("one stage of watchdog", "WDTCSR = _BV(WDIE) | _BV(WDE);", "WDTCSR = _BV(WDE);"),
    Mutant("not remembered that it was armed", "flags & kWasArmed ?", "flags & 0 ?"),
    Mutant("converter at 1 MHz", "_BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);", "_BV(ADPS2);"),
    Mutant("converter's reference", "(_BV(REFS0) | kGroups", "(kGroups"),
    Mutant(
        "steering's PWM inverted",
        "connect(TCCR1A, _BV(COM1A1), true);",
        "connect(TCCR1A, _BV(COM1A1) | _BV(COM1A0), true);",
    ),
    Mutant("drive's PWM mode", "TCCR2A = _BV(WGM20);", "TCCR2A = _BV(WGM20) | _BV(WGM21);"),
    Mutant("seven data bits", "_BV(UCSZ01) | _BV(UCSZ00);", "_BV(UCSZ01);"),
    Mutant(
        "outputs left on at a hang",
        "  daranti::all_off();\n  wdt_disable();",
        "  wdt_disable();",
        "the program that starts anew puts them off some microseconds later",
    ),
    Mutant("e-stop's pin not readable", "_BV(ADC3D);", "_BV(ADC3D) | _BV(ADC4D);"),
    Mutant("no pull-up", "  write(pins::kHall, true);", "  write(pins::kHall, false);"),
)


def run(folder: Path, *command: str) -> bool:
    """Whether it succeeds in the copy."""
    done = subprocess.run(command, cwd=folder, capture_output=True, check=False)
    return done.returncode == 0


def main() -> int:
    """Builds and tests every mutant, prints a line each."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    text = (ROOT / SOURCE).read_text(encoding="utf-8")
    python = sys.executable
    build = (python, "-m", "platformio", "run", "--silent", "-e", "uno")
    test = (python, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *TESTS, "-k", NOT_NEEDED)
    unexplained = 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for name in COPIED:
            shutil.copytree(ROOT / name, folder / name, symlinks=True)
        for name in ("platformio.ini", "pyproject.toml"):
            shutil.copy(ROOT / name, folder / name)
        if not (run(folder, *build) and run(folder, *test)):
            print("the tests fail without any mutant: mend them first", file=sys.stderr)
            return 1
        for mutant in MUTANTS:
            if text.count(mutant.original) != 1:
                print(f"{mutant.name}: {SOURCE} has not just one such place", file=sys.stderr)
                return 1
            changed = text.replace(mutant.original, mutant.mutated)
            (folder / SOURCE).write_text(changed, encoding="utf-8")
            survives = run(folder, *build) and run(folder, *test)
            verdict = f"survives: {mutant.equivalent or 'NOBODY NOTICES'}" if survives else "killed"
            print(f"{mutant.name:<44}{verdict}", flush=True)
            unexplained += survives and not mutant.equivalent
    return 1 if unexplained else 0


if __name__ == "__main__":
    sys.exit(main())
