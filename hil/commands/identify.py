"""`daranti-hil identify`: identification and tuning of simulated actuators."""

from __future__ import annotations

import json
from pathlib import Path

import click
from rich.table import Table

from hil.firmware.provision import check_built
from hil.scenario.drawn_machine import NOMINAL_RANGES
from hil.studies.actuators import (
    DAY_RANGES,
    Firmware,
    population,
)
from hil.studies.identification import campaign, identify_plant, summary_of
from host.commands.identify import table as table_of
from host.core.number_range import WholeRange
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import PlainConsole, echo
from host.core.whole_file import save_text, saved
from host.tune.pictures import draw_fit


@click.command("identify")
@click.option("--plants", "count", type=WholeRange(1, 100_000), default=1, show_default=True)
@click.option("--seed", type=WholeRange(0, 2**31 - 1), default=0, show_default=True)
@click.option("--days", is_flag=True, help="Battery, load, wear and temperature vary as well.")
@click.option("--tune", is_flag=True, help="Tune on each model and compare gains on its plant.")
@click.option("--firmware", type=click.Choice(["desk", "avr"]), default="desk", show_default=True)
@click.option("--workers", type=WholeRange(1, 256), default=2, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/identify"))
def command(
    count: int, seed: int, days: bool, tune: bool, firmware: Firmware, workers: int, out: Path
) -> None:
    """Identifies simulated steering actuators, and says how far off the truth that was.

    Writes plants.parquet, summary.json and, of the first plant, model.json and fit.png."""

    check_folder(out)
    check_built(firmware)
    ranges = {**NOMINAL_RANGES, **DAY_RANGES} if days else NOMINAL_RANGES
    plants = population(count, seed, ranges=ranges)
    out.mkdir(parents=True, exist_ok=True)
    findings, model, _ = identify_plant(plants[0], firmware)
    model.save(out / "model.json")
    draw_fit(findings, model, out / "fit.png")
    console = PlainConsole()
    console.print_table(table_of(model))
    with Watch("actuators", count) as watch:
        table = campaign(plants, tune=tune, workers=workers, firmware=firmware, progress=watch.step)
    summary = summary_of(table)
    with saved(out / "plants.parquet") as fresh:
        table.to_parquet(fresh, index=False)
    save_text(out / "summary.json", json.dumps(summary, indent=1))
    shown = Table(title=f"{count} actuators, seed {seed}")
    shown.add_column("figure")
    shown.add_column("value", justify="right")
    for key, value in summary.items():
        shown.add_row(key, f"{value:g}")
    console.print_table(shown)
    for number, text in enumerate(table["error"]):
        if text:
            console.print(f"actuator {number}: {text}")
    echo(f"written to {out}: plants.parquet, summary.json, model.json, fit.png")
