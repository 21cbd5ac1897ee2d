"""Wrong beliefs by their size: until where the machine harvests on, and from where it breaks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
from matplotlib.figure import Figure

from hil.judge.figures import MARKS
from hil.studies.beliefs import (
    SAID,
    boundary_of,
    gap_of,
    hall_of,
    mount_of,
    pot_of,
    scattered_of,
)
from host.core.whole_file import saved

mpl.use("Agg")

SAID_GAP_M: Final = 2.0
"""What the host is told of the gap: the usual one."""
SAID_DELAY_S: Final = 0.1
"""Of the camera's delay."""
SAID_PULSES_PER_M: Final = 50.0
"""Of the wheels' sensor."""


def _delayed(more_s: float) -> dict[str, Any]:
    return {"lens": {"delay_s": SAID_DELAY_S + more_s}, "belief": SAID}


SIZES: Final[Mapping[str, Mapping[float, dict[str, Any]]]] = {
    "gap narrower, m": {
        m: gap_of(round(SAID_GAP_M - m, 2), SAID_GAP_M) for m in (0.2, 0.4, 0.6, 0.8, 1.0)
    },
    "corners off, m (1 sigma)": {
        m: boundary_of(scattered_of(m)) for m in (0.25, 0.5, 1.0, 1.5, 2.0)
    },
    "hall pulses lost, %": {
        p: hall_of(SAID_PULSES_PER_M * (1 - p / 100)) for p in (2.0, 5.0, 10.0, 15.0, 20.0)
    },
    "mount yaw, deg": {d: mount_of(yaw_deg=d) for d in (1.0, 2.0, 4.0, 6.0, 8.0)},
    "pot's middle, deg": {d: pot_of(d) for d in (1.0, 2.0, 4.0, 6.0, 8.0)},
    "camera later, s": {s: _delayed(s) for s in (0.05, 0.1, 0.2, 0.4, 0.8)},
}
"""By what is wrong, and by how much."""


def name_of(error: str, size: float) -> str:
    """Of one case."""
    return f"{error}: {size:g}"


SIZED: Final[Mapping[str, dict[str, Any]]] = {
    name_of(error, size): over for error, sizes in SIZES.items() for size, over in sizes.items()
}
"""All of them, as `hil.studies.beliefs.CASES` has its own."""


def draw_sizes(rows: Iterable[Mapping[str, Any]], path: Path) -> None:
    """Coverage and harm against the size of each error, as PNG. A hollow mark is a run that did not
    finish; what is harm lies above the dotted line, in red."""
    known = {str(row["belief"]): row for row in rows}
    figure = Figure(figsize=(12, 7), layout="constrained")
    for axes, (error, sizes) in zip(figure.subplots(2, 3).flat, SIZES.items(), strict=True):
        shown = [(size, known[name_of(error, size)]) for size in sizes]
        at = [size for size, _ in shown]
        axes.plot(at, [row["coverage"] for _, row in shown], color="tab:blue")
        for size, row in shown:
            finished = row["outcome"] == "finished"
            fill = "tab:blue" if finished else "white"
            axes.plot(size, row["coverage"], "o", color="tab:blue", markerfacecolor=fill)
        axes.set_ylim(0.0, 1.05)
        axes.set_xlabel(error)
        axes.set_ylabel("coverage", color="tab:blue")
        harm = axes.twinx()
        for key, mark in (("outside_m", "s-"), ("neighbour_cut_m2", "^--")):
            values = [row[key] for _, row in shown]
            harm.plot(at, values, mark, color="tab:red", label=key, markersize=4)
        harm.axhline(MARKS["outside_m"].limit, color="tab:red", linestyle=":", linewidth=0.8)
        harm.set_ylim(
            -0.02,
            max(
                0.5,
                *(1.1 * row["outside_m"] for _, row in shown),
                *(1.1 * row["neighbour_cut_m2"] for _, row in shown),
            ),
        )
        harm.set_ylabel("outside, m; neighbour's crop, m2", color="tab:red")
        harm.legend(fontsize="small", loc="center left")
    with saved(path) as fresh:
        figure.savefig(fresh, dpi=90)
