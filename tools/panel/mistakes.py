"""Machines built wrongly and good ones, each walked through the check in lockstep.

    python -m tools.panel.mistakes --out out/mistakes [--only NAME] [--workers 2]

Prints a line per machine as it comes and writes OUT/summary.json. Exits with 1 where a mistake is
not named or its remedy not told in every language, a good machine is accused, a blade was armed, or
a check takes more than 15 minutes of machine time.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from hil.studies.building_mistakes import MISTAKES, good_machine, inspect
from host.core.number_range import WholeRange, argument
from host.panel.texts import LANGUAGES, texts

GOOD: Final = range(101, 121)
"""Seeds of machines without a mistake, each with lengths, motors, sensors and a camera of its own,
commissioned as an owner does."""
CHECK_S: Final = 15 * 60
"""Longest check, in machine time."""


@dataclass(frozen=True)
class Row:
    """One machine."""

    name: str
    wanted: tuple[str, ...]
    findings: tuple[str, ...]
    armed: bool
    seconds: float
    off: Mapping[str, float]
    """What the figures of its roll are off by, degrees and s."""

    @property
    def ok(self) -> bool:
        """Whether the check said what it should, in time, the blade off."""
        named = set(self.wanted) & set(self.findings)
        said = bool(named) if self.wanted else not self.findings
        told = all(f"todo.{one}" in texts(language) for one in named for language in LANGUAGES)
        return said and told and not self.armed and self.seconds < CHECK_S


def walked(name: str, seed: int | None) -> Row:
    """A machine with the mistake of that name, or a good one of that seed."""
    mistake = next((one for one in MISTAKES if one.name == name), None)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        seen = inspect(mistake, place) if seed is None else good_machine(seed, place)
    wanted = () if mistake is None else mistake.findings
    # What is not green without a finding was skipped: a good machine must pass every line.
    missing = ("not green",) if mistake is None and not seen.green else ()
    findings = seen.findings + missing
    return Row(name, wanted, findings, seen.blade_armed, round(seen.simulated_s, 1), seen.off)


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Counts, the longest check, and what the good machines' rolls are off by."""
    wrong = [row for row in rows if row.wanted]
    good = [row for row in rows if not row.wanted]
    return {
        "mistakes": len(wrong),
        "named": sum(row.ok for row in wrong),
        "good_machines": len(good),
        "accused": sum(not row.ok for row in good),
        "blade_armed": sum(row.armed for row in rows),
        "longest_check_s": max((row.seconds for row in rows), default=0.0),
        "longest_good_check_s": max((row.seconds for row in good), default=0.0),
        **_errors([row.off for row in good]),
        "rows": [asdict(row) for row in rows],
    }


def _errors(off: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Root mean square and worst of each figure of the rolls."""
    found = {}
    for name, unit in (("pitch", "deg"), ("yaw", "deg"), ("roll", "deg"), ("delay", "s")):
        values = [one[name] for one in off if name in one]
        if values:
            found[f"{name}_rms_{unit}"] = round(math.hypot(*values) / math.sqrt(len(values)), 2)
            found[f"{name}_worst_{unit}"] = round(max(map(abs, values)), 2)
    return found


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/mistakes"))
    parser.add_argument("--only", help="machines whose name has this")
    parser.add_argument("--workers", type=argument(WholeRange(1, 256)), default=2)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    machines: list[tuple[str, int | None]] = [(one.name, None) for one in MISTAKES]
    machines += [(f"good machine, seed {seed}", seed) for seed in GOOD]
    chosen = [one for one in machines if given.only is None or given.only in one[0]]
    rows: list[Row] = []
    with ProcessPoolExecutor(given.workers) as pool:
        for done in as_completed(pool.submit(walked, *one) for one in chosen):
            row = done.result()
            rows.append(row)
            said = ", ".join(row.findings) or "all well"
            print(
                f"{'ok ' if row.ok else 'BAD'} {row.seconds:6.1f} s  {row.name}: {said}", flush=True
            )
            text = json.dumps(summary(rows), indent=1)
            (given.out / "summary.json").write_text(text, encoding="utf-8")
    for name, value in summary(rows).items():
        if name != "rows":
            print(f"{name:<22}{value}")
    return 0 if rows and all(row.ok for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
