"""Writes docs/build/safety-case.md from docs/build/safety-case.yaml.

`--check` exits with 1 where a row's evidence does not exist, where a fault of the firmware, a limit
of the fault matrix or a fault that must stop the machine belongs to no hazard, or where the page is
not what the table says. Whether the evidence passes is what running it says.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from hil.scenario.faults import PAIRS, Expect  # noqa: E402

TABLE = ROOT / "docs" / "build" / "safety-case.yaml"
PAGE = TABLE.with_suffix(".md")
TEXTS = ("id", "hazard", "require", "operator")
KINDS = {
    "tests": "test",
    "units": "unit test",
    "faults": "fault row",
    "bits": "fault of the firmware",
    "mistakes": "building mistake",
    "mutants": "mutants of",
}
FAULTS = {f"{component} {failure}": pair for (component, failure), pair in PAIRS.items()}


@cache
def _functions(path: Path) -> frozenset[str]:
    """Names of the functions of a Python file; none where there is no such file."""
    if not path.is_file():
        return frozenset()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return frozenset(node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def _known() -> dict[str, frozenset[str]]:
    """By kind of evidence, what exists; `tests` apart."""
    core = ROOT / "firmware" / "src"
    cases = "\n".join(p.read_text() for p in (ROOT / "firmware/test/test_core").glob("*.cpp"))
    mistakes = (ROOT / "hil/studies/building_mistakes.py").read_text(encoding="utf-8")
    sources = [*(core / "core").glob("*.cpp"), *(core / "boards/atmega").glob("*.cpp")]
    functions = "\n".join(p.read_text(encoding="utf-8") for p in sources)
    protocol = tomllib.loads((ROOT / "firmware/protocol.toml").read_text(encoding="utf-8"))
    return {
        "units": frozenset(re.findall(r'TEST_CASE\(\s*"([^"]+)"', cases)),
        "faults": frozenset(FAULTS),
        "bits": frozenset(n for n, bit in protocol["bits"]["Fault"].items() if n != "doc" and bit),
        "mistakes": frozenset(re.findall(r'Mistake\(\s*"([^"]+)"', mistakes)),
        "mutants": frozenset(re.findall(r"^\w[\w :*&]*? ([\w:]+)\(", functions, re.MULTILINE)),
    }


def problems(hazards: list[dict[str, Any]]) -> list[str]:
    """What is named and does not exist, or exists and is not named."""
    known = _known()
    found = []
    named: dict[str, set[str]] = {kind: set() for kind in KINDS}
    for row in hazards:
        where = f"{TABLE.name}: {row.get('id', '?')}"
        found += [f"{where}: `{key}` is missing" for key in TEXTS if not row.get(key)]
        found += [f"{where}: unknown key `{key}`" for key in row if key not in (*TEXTS, *KINDS)]
        if not any(row.get(kind) for kind in KINDS):
            found.append(f"{where}: no evidence")
        for kind, title in KINDS.items():
            for name in row.get(kind, ()):
                named[kind].add(name)
                file, _, function = name.partition("::")
                exists = (
                    function in _functions(ROOT / file) if kind == "tests" else name in known[kind]
                )
                if not exists:
                    found.append(f"{where}: there is no {title} {name!r}")
    found += [f"{TABLE.name}: {bit} belongs to no hazard" for bit in known["bits"] - named["bits"]]
    for name, pair in FAULTS.items():
        if (pair.expect is Expect.STOP or pair.limit) and name not in named["faults"]:
            found.append(f"{TABLE.name}: fault row {name!r} belongs to no hazard")
    return sorted(found)


def page(intro: str, hazards: list[dict[str, Any]]) -> str:
    """The document."""
    parts = [intro]
    for number, row in enumerate(hazards, 1):
        parts.append(f"## {number}. {row['hazard']}\n")
        parts.append(f"**Required.** {row['require']}\n")
        parts.append(f"**Stays with you.** {row['operator']}\n")
        lines = ["| evidence | name |", "|---|---|"]
        for kind, title in KINDS.items():
            if kind == "faults":
                for name in row.get(kind, ()):
                    limit = FAULTS[name].limit
                    lines.append(
                        f"| {title} | {name}" + (f" (LIMIT: {limit}) |" if limit else " |")
                    )
            elif row.get(kind):
                code = "`" if kind in ("tests", "bits", "mutants") else ""
                names = "<br>".join(f"{code}{name}{code}" for name in row[kind])
                lines.append(f"| {title} | {names} |")
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def main() -> int:
    """Writes the page, or with --check compares."""
    table = yaml.safe_load(TABLE.read_text(encoding="utf-8"))
    hazards = table["hazards"]
    wrong = problems(hazards)
    if not wrong and sys.argv[1:] == ["--check"]:
        if not PAGE.is_file() or PAGE.read_text(encoding="utf-8") != page(table["intro"], hazards):
            wrong = [f"{PAGE.name} is not what {TABLE.name} says: `python tools/safety_case.py`"]
    elif not wrong:
        PAGE.write_text(page(table["intro"], hazards), encoding="utf-8")
    for line in wrong:
        print(line, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
