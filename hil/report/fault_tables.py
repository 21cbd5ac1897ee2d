"""The fault matrix as a table, on the terminal and in a document."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from hil.judge.fault_verdict import Verdict
from hil.scenario.faults import Expect


def table_of(verdicts: Sequence[Verdict], title: str) -> Table:
    """For the terminal."""
    table = Table(title=title)
    for name in ("fault", "while", "must", "within", "detected by", "after ms"):
        table.add_column(name)
    for name in ("stop_latency_ms", "moved m"):
        table.add_column(name, justify="right")
    table.add_column("verdict")
    for v in verdicts:
        table.add_row(
            v.fault,
            v.situation,
            v.expect,
            v.bound if v.expect == Expect.STOP.value else "",
            v.detected_by,
            "" if v.detected_ms is None else f"{v.detected_ms:.0f}",
            "" if v.stop_latency_ms is None else f"{v.stop_latency_ms:.0f}",
            f"{v.moved_m:.2f}",
            v.verdict,
            style="" if v.ok else "yellow" if v.limit else "bold red",
        )
    return table


def markdown_of(verdicts: Sequence[Verdict], title: str) -> str:
    """The same for a document."""
    lines = [
        f"## {title[:1].upper()}{title[1:]}",
        "",
        "| fault | while | must | detected by | stop_latency_ms | moved m | verdict |",
        "|---|---|---|---|---:|---:|---|",
    ]
    for v in verdicts:
        must = f"stop: {v.bound}" if v.expect == Expect.STOP.value else v.expect
        latency = "" if v.stop_latency_ms is None else f"{v.stop_latency_ms:.0f}"
        cells = [v.fault, v.situation, must, v.detected_by, latency, f"{v.moved_m:.2f}", v.verdict]
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"
