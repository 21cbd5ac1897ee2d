"""What a campaign found, as tables on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.table import Table

from hil.judge.causes import Cause, hesitations

REASONS = 40
"""Of hesitations, the most costly."""


def figures(rows: Sequence[dict[str, Any]]) -> Table:
    """Scenarios as columns: there are more figures than scenarios."""
    table = Table(title="campaign")
    table.add_column("figure")
    for row in rows:
        table.add_column(str(row["scenario"]), justify="right")
    for key in dict.fromkeys(key for row in rows for key in row if key != "scenario"):
        table.add_row(key, *(f"{row[key]:g}" if key in row else "" for row in rows))
    return table


def what_went_wrong(found: Sequence[Cause]) -> Table:
    table = Table(title="what went wrong, by how often")
    for title in ("outcome", "in", "reason", "runs", "share", "left m²", "told by", "such as"):
        right = title in ("runs", "share", "left m²")
        table.add_column(title, justify="right" if right else "left", overflow="fold")
    for c in found:
        table.add_row(
            c.outcome, c.state, c.reason, str(c.runs), f"{c.share:.1%}", f"{c.left_m2:.1f}",
            c.circumstance, c.examples[0],
        )  # fmt: skip
    return table


def hesitated(summaries: Sequence[dict[str, Any]]) -> Table:
    table = Table(title="hesitations, by the time they take")
    for title in ("reason", "times", "runs", "s in all"):
        table.add_column(title, justify="left" if title == "reason" else "right", overflow="fold")
    for reason, times, runs, seconds in hesitations(summaries)[:REASONS]:
        table.add_row(reason, str(times), str(runs), f"{seconds:.0f}")
    return table


def disagreeing(rows: Sequence[dict[str, Any]]) -> Table:
    bad = sum(row["disagree"] for row in rows)
    table = Table(title=f"by the model and by pictures: {bad} of {len(rows)} fields disagree")
    for title in ("field", "model", "pictures", "coverage", "disagree"):
        table.add_column(title)
    for row in rows:
        table.add_row(
            row["field"],
            row["model"],
            row["pictures"],
            f"{row['model coverage']} / {row['pictures coverage']}",
            "YES" if row["disagree"] else "",
        )
    return table
