"""`daranti-hil campaign`: scenarios x seeds x settings, and their table."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click
from rich.table import Table

from hil.judge.causes import Cause, causes, circumstances, disagreements, hesitations
from hil.judge.overview import overview, ranking, stopped_safely
from hil.report import report
from hil.scenario.random_fields import random_field
from hil.scenario.scenario import Scenario, changed, load, merge
from hil.studies.campaign import (
    Job,
    jobs_of,
    picked,
    run_campaign,
    seeds_of,
    variants,
    with_files,
    with_pictures,
)
from host.core.errors import UserError
from host.core.progress import Watch
from host.core.terminal import PlainConsole, echo

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
@click.option("--eyes", type=click.Choice(["picture", "model"]), default="picture",
              show_default=True, help="Pictures, or their model.")  # fmt: skip
@click.option("--worst", "worst_runs", type=click.IntRange(0), default=0, show_default=True,
              help="With model eyes: drive so many of the worst again with pictures.")  # fmt: skip
@click.option("--sample", type=click.IntRange(0), default=0, show_default=True,
              help="And so many of the others, at random.")  # fmt: skip
@click.option("--maps", type=click.IntRange(0), default=8, show_default=True,
              help="With model eyes: maps of so many of the worst.")  # fmt: skip
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
    eyes: str,
    worst_runs: int,
    sample: int,
    maps: int,
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
    chosen = [changed(one, {"eyes": eyes}) for one in chosen]
    jobs = jobs_of(chosen, out, keep_records)
    run = partial(_run, workers=workers, scheduler=scheduler)
    summaries = run(jobs, out, f"{len(jobs)} runs")
    rows = overview(summaries)
    worlds = [circumstances(one) for one in chosen]
    found = causes(summaries, worlds)
    apart: list[dict[str, Any]] = []
    if eyes == "model":
        seen_in, maps_in = out / "pictures", out / "maps"
        again = picked(jobs, summaries, worst_runs, sample)
        checked = [with_pictures(job, seen_in) for job in again]
        seen = run(checked, seen_in, "with pictures") if checked else []
        apart = disagreements(summaries, seen)
        drawn = [with_files(job, maps_in) for job in picked(jobs, summaries, maps, 0)]
        mapped = run(drawn, maps_in, "maps of the worst") if drawn else []
        keep = {(s["scenario"], s["seed"]): s["run"] for s in mapped}
        summaries = [s | {"map": keep.get((s["scenario"], s["seed"]), s["run"])} for s in summaries]
    PlainConsole().print_table(_table(rows))
    PlainConsole().print_table(_causes(found))
    PlainConsole().print_table(_hesitations(summaries))
    if apart:
        PlainConsole().print_table(_apart(apart))
    report.campaign_report(out, summaries, rows, found, apart)
    if rank:
        for place, (name, mean, worst) in enumerate(ranking(summaries), 1):
            echo(f"{place:3}. {name}: cost {mean:.3f}, worst {worst:.3f}")
    echo(f"written to {out}: campaign.json, runs.parquet, events.parquet, report.html, runs/")
    bad = [s for s in summaries if s["outcome"] != "finished"]
    for summary in bad[:REASONS]:
        how = "stopped safely" if stopped_safely(summary) else summary["outcome"]
        echo(f"{how}: runs/{summary['run']}: {summary['reason']}")
    if len(bad) > REASONS:
        echo(f"{len(bad) - REASONS} more that did not finish: see {out}/report.html")


def _table(rows: Sequence[dict[str, Any]]) -> Table:
    """Scenarios as columns: there are more figures than scenarios."""
    table = Table(title="campaign")
    table.add_column("figure")
    for row in rows:
        table.add_column(str(row["scenario"]), justify="right")
    for key in dict.fromkeys(key for row in rows for key in row if key != "scenario"):
        table.add_row(key, *(f"{row[key]:g}" if key in row else "" for row in rows))
    return table


def _run(
    jobs: Sequence[Job], out: Path, what: str, *, workers: int, scheduler: str | None
) -> list[dict[str, Any]]:
    with Watch(what, len(jobs)) as watch:
        return run_campaign(
            jobs,
            out,
            workers=workers,
            scheduler=scheduler,
            progress=lambda done, _: watch.reach(done),
        )


def _causes(found: Sequence[Cause]) -> Table:
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


def _hesitations(summaries: Sequence[dict[str, Any]]) -> Table:
    table = Table(title="hesitations, by the time they take")
    for title in ("reason", "times", "runs", "s in all"):
        table.add_column(title, justify="left" if title == "reason" else "right", overflow="fold")
    for reason, times, runs, seconds in hesitations(summaries)[:REASONS]:
        table.add_row(reason, str(times), str(runs), f"{seconds:.0f}")
    return table


def _apart(rows: Sequence[dict[str, Any]]) -> Table:
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
