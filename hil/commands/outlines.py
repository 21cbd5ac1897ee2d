"""`daranti-hil outlines`: plans outlines as farm programs export them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import click
from rich.table import Table

from hil.commands.seeds import SEEDS
from hil.studies.outlines import Planned, outline, planned
from host.core.errors import UserError
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import PlainConsole, echo
from host.core.whole_file import save_text

MOST_TURNING: Final = 0.25
"""Metres of turning for each of cutting, where no real inner corner is."""
MOST_S: Final = 10.0
"""Processor time to plan one."""


def table_of(rows: list[Planned]) -> Table:
    """For a terminal."""
    table = Table("seed", "kind")
    for name in ("corners", "ha", "sides", "shuttles", "cutting m", "turning", "stays", "s"):
        table.add_column(name, justify="right")
    table.add_column("")
    for row in rows:
        drawn = row.outline
        table.add_row(
            str(drawn.seed),
            drawn.kind,
            str(len(drawn.ring)),
            f"{drawn.area_ha:.2f}",
            str(row.sides),
            str(row.shuttles),
            f"{row.cutting_m:.0f}",
            f"{row.turning:.2f}",
            f"{100 * row.stays:.2f} %",
            f"{row.processor_s:.1f}",
            row.error,
            style="" if good(row) else "red",
        )
    return table


def good(row: Planned) -> bool:
    """Whether an outline is planned as one may expect."""
    turns = row.outline.kind == "inner" or row.turning <= MOST_TURNING
    return not row.error and turns and row.processor_s <= MOST_S


def summary(rows: list[Planned]) -> dict[str, Any]:
    """The worst of each figure, over those that have a plan."""
    plans = [row for row in rows if not row.error]
    bends = [row.turning for row in plans if row.outline.kind != "inner"]
    return {
        "outlines": len(rows),
        "planned": len(plans),
        "stays_worst": max((row.stays for row in plans), default=None),
        "turning_worst": max(bends, default=None),
        "processor_s_worst": max(row.processor_s for row in rows),
    }


@click.command()
@click.option("--seeds", type=SEEDS, default="1-20", show_default=True)
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("out/outlines"), show_default=True
)
def outlines(seeds: list[int], out: Path) -> None:
    """Draws outlines of 10 to 160 corners and 0.1 to 60 ha, plans each, and drives the plan on
    paper: edges that bend, corners that a tractor's track has rounded, tracks that jitter, fields
    without any corner, and fields with a real inner corner.

    Writes summary.json. Exits with an error where one has no plan, takes more than 10 s of
    processor time, or turns more than a quarter of its way of cutting without having a real inner
    corner."""
    check_folder(out)
    out.mkdir(parents=True, exist_ok=True)
    rows = []
    with Watch("outlines", len(seeds)) as watch:
        for seed in seeds:
            rows.append(planned(outline(seed)))
            watch.step(str(seed))
    PlainConsole().print_table(table_of(rows))
    save_text(out / "summary.json", json.dumps(summary(rows), indent=1))
    bad = [str(row.outline.seed) for row in rows if not good(row)]
    if bad:
        raise UserError(f"{len(bad)} of {len(rows)} fall short: seeds {', '.join(bad)}")
    echo(f"{len(rows)} outlines planned")
