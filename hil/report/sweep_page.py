"""A sweep as pictures and one self-contained page."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd

matplotlib.use("Agg")
from matplotlib import pyplot as plt

from hil.judge.figures import unit_of
from hil.report import report
from hil.report.report import Grid, Section
from hil.studies import sweep as sweeps
from host.core.whole_file import saved
from host.link.protocol import PARAMS

FRONT = ("error_s_mean", "energy_j_mean")
BINS = 8
"""Of a heat map, along each axis."""


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
        with saved(out / name) as fresh:
            fresh.write_bytes(data)
    columns = [*swept, "cost", "meets", "settle_s_worst", "overshoot_worst", "energy_j_mean"]
    chosen, worst = summary["chosen"], summary["worst_case"]
    about = (
        f"{summary['candidates']} candidates ({summary['method']}) on {summary['plants']} plants, "
        f"steps of {summary['steps_deg']} degrees, seed {summary['seed']}; "
        f"{summary.get('wall_s', '?')} s. Table sha256 {summary['table_sha256'][:16]}."
    )
    sections = [
        Section("Chosen", about, _pairs(chosen)),
        Section(
            "Its worst case",
            f"It meets the step figures in {summary['chosen_meets']:.1%} of its responses.",
            _pairs({k: v for k, v in worst.items() if k not in chosen}),
        ),
        Section("The best ten", grid=_table(ranked.head(10)[columns])),
        Section(
            "Cost over each pair of parameters",
            "The best candidate in each cell; dark is cheap.",
            pictures=[(_image(pictures["heatmaps.png"]), "")],
        ),
        Section(
            "Tracking against energy",
            pictures=[(_image(pictures["pareto.png"]), "")],
        ),
        Section("The Pareto front", grid=_table(front.head(15)[columns])),
        Section(
            "The chosen parameters on each plant",
            pictures=[(_image(pictures["plants.png"]), "")],
        ),
    ]
    if "spot_check" in summary:
        sections.append(Section("On the Uno's binary", grid=_pairs(summary["spot_check"])))
    report.write(out, f"Sweep: {summary['responses']} step responses", sections)


def _png(figure: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=90, bbox_inches="tight", metadata={"Software": None})
    plt.close(figure)
    return buffer.getvalue()


def _heat_maps(ranked: pd.DataFrame, space: sweeps.Space) -> bytes:
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
            cells = np.full((BINS, BINS), np.nan)
            at = np.minimum(BINS - 1, (np.stack([shares[y], shares[x]]) * BINS).astype(int))
            for i, j, cost in zip(*at, ranked["cost"], strict=True):
                cells[i, j] = np.fmin(cells[i, j], cost)
            axes.imshow(cells, origin="lower", cmap="viridis", vmin=cheap, vmax=dear, aspect="auto")
            ticks = (-0.5, BINS - 0.5)
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
    return f"data:image/png;base64,{base64.b64encode(data).decode()}"


def _pairs(values: Mapping[str, Any]) -> Grid:
    units = {k: PARAMS[k].unit if k in PARAMS else unit_of(k) for k in values}
    rows = [("", [k, _number(v), units[k]]) for k, v in values.items()]
    return Grid(("", "value", "unit"), rows)


def _table(frame: pd.DataFrame) -> Grid:
    rows = [
        ("", [_number(v) for v in (number, *row)])
        for number, row in zip(frame.index, frame.to_numpy().tolist(), strict=True)
    ]
    return Grid(("candidate", *(str(c) for c in frame.columns)), rows)


def _number(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
