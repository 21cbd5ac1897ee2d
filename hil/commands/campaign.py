"""`daranti-hil campaign`: scenarios x seeds x settings, and their table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from hil.commands.seeds import SEEDS
from hil.firmware.provision import check_built
from hil.judge.causes import causes, circumstances
from hil.judge.overview import overview, ranking, stopped_safely
from hil.report import campaign_tables, report
from hil.studies.campaign import (
    Again,
    Job,
    jobs_of,
    looked_at_again,
    run_campaign,
    scenarios_of,
)
from host.core.number_range import WholeRange
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import PlainConsole, echo

REASONS = 40
"""Runs that did not finish whose reasons the command prints."""


@click.command()
@click.option("--scenario", "names", multiple=True, metavar="NAME|FILE", help="May be repeated.")
@click.option("--random", "random_fields", is_flag=True, help="Random fields, one per seed.")
@click.option("--outlines", is_flag=True,
              help="Small fields with edges that bend, one per seed.")  # fmt: skip
@click.option("--seeds", type=SEEDS, default="1-4", show_default=True)
@click.option(
    "--set", "settings", multiple=True, metavar="FIELD=A,B", help="Sweeps a scenario field."
)
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/campaign"))
@click.option("--commissioned", is_flag=True,
              help="Commission each machine in the loop first.")  # fmt: skip
@click.option("--workers", type=WholeRange(1, 256), default=2, show_default=True)
@click.option("--scheduler", metavar="ADDRESS", help="A Dask scheduler, tcp://HOST:PORT.")
@click.option("--keep-records", is_flag=True, help="Keep the records of finished runs, too.")
@click.option("--rank", is_flag=True, help="Rank the settings by their cost, best first.")
@click.option("--eyes", type=click.Choice(["picture", "model"]), default="picture",
              show_default=True, help="Pictures, or their model.")  # fmt: skip
@click.option("--worst", "worst_runs", type=WholeRange(0), default=0, show_default=True,
              help="With model eyes: drive so many of the worst again with pictures.")  # fmt: skip
@click.option("--sample", type=WholeRange(0), default=0, show_default=True,
              help="And so many of the others, at random.")  # fmt: skip
@click.option("--maps", type=WholeRange(0), default=8, show_default=True,
              help="With model eyes: maps of so many of the worst.")  # fmt: skip
def campaign(
    names: tuple[str, ...],
    random_fields: bool,
    outlines: bool,
    seeds: list[int],
    settings: tuple[str, ...],
    out: Path,
    commissioned: bool,
    workers: int,
    scheduler: str | None,
    keep_records: bool,
    rank: bool,
    eyes: str,
    worst_runs: int,
    sample: int,
    maps: int,
) -> None:
    """Runs scenarios x seeds x settings and prints the table. The same command goes on where it
    was killed; a run that fails keeps its record in OUT/runs.

    The cost of a run, for --rank, is 10 / m of lateral RMS error plus the share left standing: for
    sweeps of the steering law and the speed in runs of one length."""

    chosen = scenarios_of(
        names, seeds, settings, eyes, random_fields=random_fields, outlines=outlines
    )
    check_folder(out)
    check_built(*(one.firmware for one in chosen))
    jobs = jobs_of(chosen, out, keep_records, commissioned=commissioned)

    def run(todo: Sequence[Job], where: Path, what: str) -> list[dict[str, Any]]:
        with Watch(what, len(todo)) as watch:
            return run_campaign(
                todo,
                where,
                workers=workers,
                scheduler=scheduler,
                progress=lambda done, _: watch.reach(done),
            )

    summaries = run(jobs, out, f"{len(jobs)} runs")
    rows = overview(summaries)
    found = causes(summaries, [circumstances(one) for one in chosen])
    apart: list[dict[str, Any]] = []
    if eyes == "model":
        again = Again(worst_runs, sample, maps)
        summaries, apart = looked_at_again(jobs, summaries, out, again, run)
    console = PlainConsole()
    console.print_table(campaign_tables.figures(rows))
    console.print_table(campaign_tables.what_went_wrong(found))
    console.print_table(campaign_tables.hesitated(summaries))
    if apart:
        console.print_table(campaign_tables.disagreeing(apart))
    report.campaign_report(out, summaries, rows, found, apart)
    if rank:
        for place, (name, mean, worst) in enumerate(ranking(summaries), 1):
            echo(f"{place:3}. {name}: cost {mean:.3f}, worst {worst:.3f}")
    echo(f"written to {out}: campaign.json, runs.parquet, events.parquet, report.html, runs/")
    _tell_of_the_unfinished(summaries, out)


def _tell_of_the_unfinished(summaries: Sequence[dict[str, Any]], out: Path) -> None:
    bad = [s for s in summaries if s["outcome"] != "finished"]
    for summary in bad[:REASONS]:
        how = "stopped safely" if stopped_safely(summary) else summary["outcome"]
        echo(f"{how}: runs/{summary['run']}: {summary['reason']}")
    if len(bad) > REASONS:
        echo(f"{len(bad) - REASONS} more that did not finish: see {out}/report.html")
