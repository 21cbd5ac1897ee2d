"""Draws how often a detector is sure and wrong against how often it is sure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from host.core.whole_file import saved

mpl.use("Agg")


def draw_curves(curves: Mapping[str, Sequence[Mapping[str, float]]], path: Path) -> None:
    """One line a kind of picture, one point a confidence from which one calls the detector sure
    (`vision_drives.curve`); both shares are of all pictures."""
    figure = Figure(figsize=(9, 6), layout="constrained")
    axes = figure.subplots()
    for number, (name, rows) in enumerate(curves.items()):
        axes.plot(
            [100 * row["sure"] for row in rows],
            [100 * row["sure_and_wrong"] for row in rows],
            marker="o",
            markersize=3,
            linestyle=("-", "--", ":", "-.")[number // 10 % 4],
            label=name,
        )
    axes.axhline(1.0, color="grey", linewidth=0.6)
    axes.set_xlim(0, 100)
    axes.set_ylim(bottom=0)
    axes.set_xlabel("sure, % of pictures")
    axes.set_ylabel("sure and wrong, % of pictures")
    axes.legend(fontsize="small", ncols=2)
    with saved(path) as fresh:
        figure.savefig(fresh, dpi=90)
