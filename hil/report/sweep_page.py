"""A sweep as pictures and one self-contained page."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd

matplotlib.use("Agg")
from matplotlib import pyplot as plt

from hil.studies import sweep as sweeps

FRONT = ("error_s_mean", "energy_j_mean")
_STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:70em;margin:2em auto;padding:0 1em}
table{border-collapse:collapse}
td,th{padding:.2em .7em;border-bottom:1px solid #ddd;text-align:right}
th:first-child,td:first-child{text-align:left}img{max-width:100%}"""


def write(
    out: Path,
    space: sweeps.Space,
    table: pd.DataFrame,
    ranked: pd.DataFrame,
    summary: Mapping[str, Any],
) -> None:
    """Writes heatmaps.png, pareto.png, plants.png and report.html."""
    swept = list(space.parameters)
    front = sweeps.pareto(ranked[ranked["faults"] == 0], FRONT)
    pictures = {
        "heatmaps.png": _heat_maps(ranked, space),
        "pareto.png": _pareto(ranked, front),
        "plants.png": _plants(table, int(ranked.index.to_numpy()[0])),
    }
    for name, data in pictures.items():
        (out / name).write_bytes(data)
    columns = [*swept, "cost", "meets", "settle_s_worst", "overshoot_worst", "energy_j_mean"]
    worst = summary["worst_case"]
    parts = [
        f"<h1>Sweep: {summary['responses']} step responses</h1>",
        f"<p>{summary['candidates']} candidates ({html.escape(str(summary['method']))}) on "
        f"{summary['plants']} plants, steps of {summary['steps_deg']} degrees, seed "
        f"{summary['seed']}; {summary.get('wall_s', '?')} s. Table sha256 "
        f"<code>{summary['table_sha256'][:16]}</code>.</p>",
        "<h2>Chosen</h2>",
        _pairs(summary["chosen"]),
        f"<p>Meets the step figures in {summary['chosen_meets']:.1%} of its responses. Its worst "
        "case:</p>",
        _pairs({k: v for k, v in worst.items() if k not in summary["chosen"]}),
        "<h2>The best ten</h2>",
        _table(ranked.head(10)[columns]),
        "<h2>Cost over each pair of parameters</h2>",
        "<p>The best candidate in each cell; dark is cheap.</p>",
        _image(pictures["heatmaps.png"]),
        "<h2>Tracking against energy</h2>",
        _image(pictures["pareto.png"]),
        _table(front.head(15)[columns]),
        "<h2>The chosen parameters on each plant</h2>",
        _image(pictures["plants.png"]),
    ]
    if "spot_check" in summary:
        parts += ["<h2>On the Uno's binary</h2>", _pairs(summary["spot_check"])]
    page = (
        "<!doctype html><html lang=en><meta charset=utf-8><title>Daranti sweep</title>"
        f"<style>{_STYLE}</style>{''.join(parts)}</html>"
    )
    (out / "report.html").write_text(page, encoding="utf-8")


def _png(figure: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=90, bbox_inches="tight", metadata={"Software": None})
    plt.close(figure)
    return buffer.getvalue()


def _heat_maps(ranked: pd.DataFrame, space: sweeps.Space, bins: int = 8) -> bytes:
    names = list(space.parameters)
    size = max(1, len(names) - 1)
    figure, grid = plt.subplots(size, size, figsize=(2.6 * size, 2.3 * size), squeeze=False)
    cheap, dear = np.percentile(ranked["cost"], [0, 60])
    shares = {n: _share(ranked[n].to_numpy(), space.parameters[n]) for n in names}
    for row in range(size):
        for column in range(size):
            axes = grid[row][column]
            if column > row or len(names) < 2:
                axes.axis("off")
                continue
            x, y = names[column], names[row + 1]
            cells = np.full((bins, bins), np.nan)
            at = np.minimum(bins - 1, (np.stack([shares[y], shares[x]]) * bins).astype(int))
            for i, j, cost in zip(*at, ranked["cost"], strict=True):
                cells[i, j] = np.fmin(cells[i, j], cost)
            axes.imshow(cells, origin="lower", cmap="viridis", vmin=cheap, vmax=dear, aspect="auto")
            ticks = (-0.5, bins - 0.5)
            axes.set_xticks(ticks, _ends(space.parameters[x]), fontsize=7)
            axes.set_yticks(ticks, _ends(space.parameters[y]), fontsize=7)
            if row == size - 1:
                axes.set_xlabel(x, fontsize=8)
            if column == 0:
                axes.set_ylabel(y, fontsize=8)
    return _png(figure)


def _share(values: Any, axis: sweeps.Axis) -> Any:
    if axis.log:
        return np.log(values / axis.low) / np.log(axis.high / axis.low)
    return (values - axis.low) / (axis.high - axis.low)


def _ends(axis: sweeps.Axis) -> list[str]:
    return [f"{axis.low:g}", f"{axis.high:g}"]


def _pareto(ranked: pd.DataFrame, front: pd.DataFrame) -> bytes:
    figure, axes = plt.subplots(figsize=(7, 4.5))
    x, y = FRONT
    shown = axes.scatter(ranked[x], ranked[y], c=ranked["meets"], s=14, cmap="viridis")
    axes.plot(front[x], front[y], "r.-", lw=1, label="Pareto front")
    axes.plot(ranked[x].iloc[0], ranked[y].iloc[0], "k*", ms=14, label="chosen")
    axes.set_xlabel("mean of the normalised error's integral, s")
    axes.set_ylabel("mean energy of a step, J")
    axes.legend()
    figure.colorbar(shown, label="share of responses that meet the figures")
    return _png(figure)


def _plants(table: pd.DataFrame, candidate: int) -> bytes:
    own = table[table["candidate"] == candidate]
    figures = ("settle_s", "overshoot", "steady_error_deg", "reversals")
    figure, grid = plt.subplots(1, len(figures), figsize=(4 * len(figures), 3.3))
    for axes, name in zip(grid, figures, strict=True):
        for size, group in own.groupby("step_deg"):
            axes.scatter(group["plant_slew_degps"], group[name], s=14, label=f"{size:g} degrees")
        axes.set_xlabel("slew at full duty, deg/s")
        axes.set_title(name)
        axes.legend(fontsize=7)
    return _png(figure)


def _image(data: bytes) -> str:
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(data).decode()}">'


def _pairs(values: Mapping[str, Any]) -> str:
    rows = "".join(
        f"<tr><td>{html.escape(str(k))}</td><td>{html.escape(_number(v))}</td></tr>"
        for k, v in values.items()
    )
    return f"<table>{rows}</table>"


def _table(frame: pd.DataFrame) -> str:
    head: Sequence[str] = ["candidate", *(str(c) for c in frame.columns)]
    rows = "".join(
        "<tr>" + "".join(f"<td>{_number(v)}</td>" for v in (number, *row)) + "</tr>"
        for number, row in zip(frame.index, frame.to_numpy().tolist(), strict=True)
    )
    return f"<table><tr>{''.join(f'<th>{html.escape(h)}</th>' for h in head)}</tr>{rows}</table>"


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
