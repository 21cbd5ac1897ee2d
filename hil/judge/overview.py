"""What many runs come to: figures over their summaries, and which setting cost least."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Any

FIGURES = (
    "coverage",
    "missed_m2",
    "neighbour_cut_m2",
    "outside_m",
    "keep_out_m",
    "lateral_rms_m",
    "end_of_field_error_worst_m",
    "false_ends",
    "simulated_s",
    "realtime_factor",
)


HARM = ("neighbour_cut_m2", "outside_m", "keep_out_m")


def stopped_safely(summary: dict[str, Any]) -> bool:
    """Whether a run that was not finished ended by the pilot's own decision, without harm."""
    harmless = all(summary.get(figure) == 0 for figure in HARM)
    return summary["outcome"] == "fault" and harmless


def _row(name: str, runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    finished = [s for s in runs if s["outcome"] == "finished"]
    row: dict[str, Any] = {
        "scenario": name,
        "runs": len(runs),
        "finished": len(finished),
        "stopped safely": sum(map(stopped_safely, runs)),
        "crashed": sum(s["outcome"] == "crashed" for s in runs),
    }
    for figure in FIGURES:
        source = finished if figure in ("coverage", "missed_m2") else runs
        values = [float(s[figure]) for s in source if s.get(figure) is not None]
        if values:
            low = figure in ("coverage", "realtime_factor")
            worst = min(values) if low else sorted(values, key=abs)[-1]
            row[f"{figure} median"] = round(statistics.median(values), 4)
            row[f"{figure} worst"] = round(worst, 4)
    return row


def overview(summaries: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """One row per scenario, and one of all where there are several: how many runs finished, and
    median and worst of each figure of merit over those that have it (coverage: over the finished
    ones)."""
    names = sorted({str(s["scenario"]) for s in summaries})
    rows = [_row(name, [s for s in summaries if s["scenario"] == name]) for name in names]
    return [*rows, _row("all", summaries)] if len(names) > 1 else rows


COST_PER_M = 10.0
"""Of lateral RMS error: 10 cm weigh as much as a field left standing."""


NO_RUN = 2.0
"""What a run costs that has no lateral error to show, or did harm."""


def cost(summary: dict[str, Any]) -> float:
    """What one run's steering law and speed are worth; less is better."""
    lateral = summary.get("lateral_rms_m")
    harm = summary.get("neighbour_cut_m2") or summary.get("outside_m")
    if lateral is None or harm:
        return NO_RUN
    return COST_PER_M * float(lateral) + 1.0 - float(summary["coverage"])


def ranking(summaries: Sequence[dict[str, Any]]) -> list[tuple[str, float, float]]:
    """(scenario, mean cost, worst cost) over its seeds, best first."""
    costs: dict[str, list[float]] = {}
    for summary in summaries:
        costs.setdefault(str(summary["scenario"]), []).append(cost(summary))
    rows = [(name, statistics.mean(values), max(values)) for name, values in costs.items()]
    return sorted(rows, key=lambda row: (row[1], row[0]))
