"""Keeps the figures of the documents: stored results in, tables out.

    python tools/figures.py add harvest-desk --what "default harvest, desk firmware" \\
        --command "daranti-hil harvest" out/harvest/summary.json coverage lateral_rms_m
    python tools/figures.py write          # docs/figures/README.md and the table in README.md
    python tools/figures.py write --check  # fails where they differ from what is stored

A result is one JSON file in docs/figures/results: what was measured, by which command, when, on
which commit and machine, and the figures. A figure is a key of a command's summary (dots lead into
it), or NAME=VALUE where a command prints only text.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "docs" / "figures" / "results"
PAGE = ROOT / "docs" / "figures" / "README.md"
README = ROOT / "README.md"
BEGIN, END = "<!-- figures: begin -->", "<!-- figures: end -->"


def processor() -> str:
    """This machine in a few words: its processor and how many cores there are."""
    names = [
        line.partition(":")[2].strip()
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        if line.startswith("model name")
    ]
    return f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores"


def commit() -> str:
    """The commit that is checked out, with + where files differ from it."""
    run = subprocess.run(
        ["git", "describe", "--always", "--dirty=+"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout.strip()


def found(summary: dict[str, Any], key: str) -> Any:
    """The value that a dotted key names. KeyError where there is none."""
    value: Any = summary
    for part in key.split("."):
        value = value[part]
    return value


def add(name: str, what: str, command: str, source: Path | None, keys: list[str]) -> None:
    """Stores one result. SystemExit with a message where a figure is not to be had."""
    try:
        summary = json.loads(source.read_text(encoding="utf-8")) if source is not None else {}
    except (OSError, ValueError) as error:
        sys.exit(f"{source}: no summary to read ({error}); where there is none, say -")
    figures: dict[str, Any] = {}
    for key in keys:
        label, given, value = key.partition("=")
        if given:
            figures[label] = value
            continue
        try:
            figures[key] = found(summary, key)
        except (KeyError, TypeError):
            sys.exit(f"{source}: it has no figure {key!r}; it has {', '.join(summary)}")
    result = {
        "what": what,
        "command": command,
        "date": datetime.date.today().isoformat(),
        "commit": commit(),
        "machine": processor(),
        "figures": figures,
    }
    RESULTS.mkdir(parents=True, exist_ok=True)
    path = RESULTS / f"{name}.json"
    path.write_text(json.dumps(result, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print(f"stored: {path.relative_to(ROOT)}")


def shown(value: Any) -> str:
    """A figure as a table shows it."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def tables() -> tuple[str, str]:
    """(docs/figures/README.md, the rows of the README's table)."""
    page = [
        "# Figures",
        "",
        "`python tools/figures.py write` writes this page from the results in `results/`. Each row",
        "says which command gave it, on which day, commit and machine. A `+` marks a commit with",
        "changes beside it. Speeds depend on how busy the machine is; ratios do not.",
        "",
        "| what | figures | command | date | commit | machine |",
        "|---|---|---|---|---|---|",
    ]
    short = ["| what | figures | command |", "|---|---|---|"]
    for path in sorted(RESULTS.glob("*.json")):
        result = json.loads(path.read_text(encoding="utf-8"))
        figures = ", ".join(f"{key} {shown(value)}" for key, value in result["figures"].items())
        row = [result["what"], figures, f"`{result['command']}`"]
        page.append(
            "| " + " | ".join([*row, *(result[k] for k in ("date", "commit", "machine"))]) + " |"
        )
        short.append("| " + " | ".join(row) + " |")
    page += ["", "The fault matrix has a page of its own: [faults.md](faults.md).", ""]
    return "\n".join(page), "\n".join(short)


def write(check: bool) -> int:
    """Writes both tables; with `check` says instead whether they are as they should be."""
    page, short = tables()
    text = README.read_text(encoding="utf-8")
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        sys.exit(f"README.md: the marks {BEGIN} and {END} are missing")
    wanted = {PAGE: page, README: f"{before}{BEGIN}\n{short}\n{END}{after}"}
    stale = [
        path
        for path, content in wanted.items()
        if not path.exists() or path.read_text(encoding="utf-8") != content
    ]
    if check and stale:
        names = ", ".join(str(path.relative_to(ROOT)) for path in stale)
        print(f"{names}: not as stored; run python tools/figures.py write", file=sys.stderr)
        return 1
    for path in stale:
        path.write_text(wanted[path], encoding="utf-8")
    return 0


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description="Keeps the figures of the documents.")
    verbs = parser.add_subparsers(dest="verb", required=True)
    adding = verbs.add_parser("add", help="store one result")
    adding.add_argument("name")
    adding.add_argument("--what", required=True)
    adding.add_argument("--command", required=True)
    adding.add_argument("source", type=Path, help="a summary (JSON), or - where there is none")
    adding.add_argument("figures", nargs="+", help="KEY of the summary, or NAME=VALUE")
    writing = verbs.add_parser("write", help="write the tables")
    writing.add_argument("--check", action="store_true")
    given = parser.parse_args()
    if given.verb == "add":
        source = None if str(given.source) == "-" else given.source
        add(given.name, given.what, given.command, source, given.figures)
        return 0
    return write(given.check)


if __name__ == "__main__":
    sys.exit(main())
