"""`daranti-hil campaign`: scenarios x seeds x settings, and their table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from hil.judge.overview import overview, ranking, stopped_safely
from hil.report import report
from hil.scenario.random_fields import random_field
from hil.scenario.scenario import Scenario, changed, load, merge
from hil.studies.campaign import jobs_of, run_campaign, seeds_of, variants
from host.core.errors import UserError

REASONS = 40
"""Runs that did not finish whose reasons the command prints."""


@click.command()
@click.option("--scenario", "names", multiple=True, metavar="NAME|FILE", help="May be repeated.")
@click.option("--random", "random_fields", is_flag=True, help="Random fields, one per seed.")
@click.option("--seeds", default="1-4", show_default=True, metavar="1-30|1,4,9")
@click.option(
    "--set", "settings", multiple=True, metavar="FIELD=A,B", help="Sweeps a scenario field."
)
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/campaign"))
@click.option("--workers", type=click.IntRange(1), default=2, show_default=True)
@click.option("--scheduler", metavar="ADDRESS", help="A Dask scheduler, tcp://HOST:PORT.")
@click.option("--keep-records", is_flag=True, help="Keep the records of finished runs, too.")
@click.option("--rank", is_flag=True, help="Rank the settings by their cost, best first.")
def campaign(
    names: tuple[str, ...],
    random_fields: bool,
    seeds: str,
    settings: tuple[str, ...],
    out: Path,
    workers: int,
    scheduler: str | None,
    keep_records: bool,
    rank: bool,
) -> None:
    """Runs scenarios x seeds x settings and prints the table. The same command goes on where it
    was killed; a run that fails keeps its record in OUT/runs.

    The cost of a run, for --rank, is 10 / m of lateral RMS error plus the share left standing: for
    sweeps of the steering law and the speed in runs of one length."""

    try:
        numbers = seeds_of(seeds)
    except ValueError as error:
        raise UserError(f"--seeds {seeds}: say 1-30, or 1,4,9 ({error})") from error
    chosen: list[Scenario] = []
    for label, overrides in variants(settings):
        for seed in numbers:
            for name in names or (() if random_fields else ("default",)):
                one = load(name, merge(overrides, {"seed": seed}))
                chosen.append(one.model_copy(update={"name": f"{one.name} {label}".strip()}))
            if random_fields:
                one = changed(random_field(seed), overrides)
                chosen.append(one.model_copy(update={"name": f"{one.name} {label}".strip()}))
    jobs = jobs_of(chosen, out, keep_records)
    console = Console(stderr=True)
    with Progress(console=console) as bar:
        task = bar.add_task(f"{len(jobs)} runs", total=len(jobs))
        summaries = run_campaign(
            jobs,
            out,
            workers=workers,
            scheduler=scheduler,
            progress=lambda done, _: bar.update(task, completed=done),
        )
    rows = overview(summaries)
    Console().print(_table(rows))
    report.campaign_report(out, summaries, rows)
    if rank:
        for place, (name, mean, worst) in enumerate(ranking(summaries), 1):
            click.echo(f"{place:3}. {name}: cost {mean:.3f}, worst {worst:.3f}")
    click.echo(f"written to {out}: campaign.json, report.html, runs/")
    bad = [s for s in summaries if s["outcome"] != "finished"]
    for summary in bad[:REASONS]:
        how = "stopped safely" if stopped_safely(summary) else summary["outcome"]
        click.echo(f"{how}: runs/{summary['run']}: {summary['reason']}")
    if len(bad) > REASONS:
        click.echo(f"{len(bad) - REASONS} more that did not finish: see {out}/report.html")


def _table(rows: Sequence[dict[str, Any]]) -> Table:
    """Scenarios as columns: there are more figures than scenarios."""
    table = Table(title="campaign")
    table.add_column("figure")
    for row in rows:
        table.add_column(str(row["scenario"]), justify="right")
    for key in dict.fromkeys(key for row in rows for key in row if key != "scenario"):
        table.add_row(key, *(f"{row[key]:g}" if key in row else "" for row in rows))
    return table
