"""Reads gcov's JSON from stdin and prints line and branch coverage of firmware/src.

Exits 1 where a line or a branch of the core was never taken."""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from pathlib import Path

CORE = Path(__file__).resolve().parent.parent / "firmware" / "src" / "core"


def main() -> int:
    """Prints the table and what is missing."""
    lines: dict[str, dict[int, int]] = defaultdict(dict)
    branches: dict[str, dict[tuple[int, int], int]] = defaultdict(dict)
    for text in sys.stdin:
        for file in json.loads(text)["files"]:
            path = Path(file["file"]).resolve()
            if path.parent != CORE:
                continue
            for line in file["lines"]:
                number = line["line_number"]
                counts = lines[path.name]
                counts[number] = counts.get(number, 0) + line["count"]
                real = [branch for branch in line["branches"] if not branch["throw"]]
                for index, branch in enumerate(real):
                    key = (number, index)
                    taken = branches[path.name]
                    taken[key] = taken.get(key, 0) + branch["count"]
    print(f"{'file':<18}{'lines':>8}{'':>8}{'branches':>10}")
    missing = []
    for name in sorted(lines):
        hit = sum(count > 0 for count in lines[name].values())
        taken = sum(count > 0 for count in branches[name].values())
        print(f"{name:<18}{hit:>8}/{len(lines[name]):<7}{taken:>10}/{len(branches[name])}")
        missing += [f"{name}:{n}: never run" for n, c in sorted(lines[name].items()) if c == 0]
        missing += [
            f"{name}:{n}: branch {i} never taken"
            for (n, i), c in sorted(branches[name].items())
            if c == 0
        ]
    print("\n".join(missing) if missing else "100 % of lines and branches")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
