"""Many runs at once: campaigns and sweeps over scenarios and seeds, on Dask.

A run's folder is named by what it depends on and appears under its name only when it is complete,
so a campaign that was killed goes on where it stopped: nothing is lost, nothing is run twice.
Processes on this machine by default; `--scheduler` uses a cluster whose workers share OUT's file
system. Every worker runs one run at a time in one thread.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import os
import re
import shutil
import statistics
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click
import cv2
import yaml
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from hil.scenario.scenario import Scenario, assigned, changed, load, merge
from host.core.errors import UserError

REASONS = 40
"""Runs that did not finish whose reasons the command prints."""

Item = TypeVar("Item")
Result = TypeVar("Result")


# ---- spreading work ------------------------------------------------------------------------------


@contextmanager
def _client(workers: int, scheduler: str | None) -> Iterator[Any]:
    """A Dask client: of the scheduler at an address, or of as many processes on this machine."""
    import distributed  # noqa: PLC0415 (takes a second to import)

    if scheduler is not None:
        try:
            client = distributed.Client(scheduler, timeout=10)  # type: ignore[no-untyped-call]
        except (OSError, ValueError, TimeoutError) as error:
            raise UserError(
                f"no Dask scheduler answers at {scheduler}: start one with `dask scheduler` and "
                "workers with `dask worker ADDRESS --nthreads 1`"
            ) from error
        with client:
            yield client
        return
    local = Path(tempfile.gettempdir()) / f"daranti-dask-{os.getuid()}"
    with (
        distributed.LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            local_directory=str(local),
            silence_logs="ERROR",
        ) as cluster,
        distributed.Client(cluster) as client,  # type: ignore[no-untyped-call]
    ):
        yield client


def spread(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    *,
    workers: int = 2,
    scheduler: str | None = None,
) -> Iterator[tuple[Item, Result]]:
    """`function` of every item, as they finish, each in a process of its own kind. What a function
    raises is raised here; a worker that dies gets its item replaced by another."""
    if not items:
        return
    if workers == 1 and scheduler is None:
        for item in items:
            yield item, function(item)
        return
    import distributed  # noqa: PLC0415

    with _client(workers, scheduler) as client:
        futures = {client.submit(function, item, pure=False): item for item in items}
        done = distributed.as_completed(list(futures))  # type: ignore[no-untyped-call]
        for future in done:
            yield futures[future], future.result()
            future.release()


# ---- one run -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Job:
    """One run of a campaign; plain data, so that it travels."""

    scenario: str
    """As JSON."""
    folder: str
    keep_records: bool

    @property
    def key(self) -> str:
        """The run's name: scenario, seed, and a digest of everything else it depends on."""
        chosen = Scenario.model_validate_json(self.scenario)
        digest = hashlib.sha256(self.scenario.encode()).hexdigest()[:10]
        name = re.sub(r"[^\w.=]+", "-", chosen.name)
        return f"{name}-{chosen.seed:05d}-{digest}"

    @property
    def place(self) -> Path:
        """Where its results appear, complete."""
        return Path(self.folder) / self.key


def run_job(job: Job) -> dict[str, Any]:
    """Runs a job into its folder and returns its summary. A run that crashes is a result, too."""
    from hil.bench.harvest import harvest  # noqa: PLC0415

    cv2.setNumThreads(1)
    place = job.place
    if (place / "summary.json").exists():
        return summary_of(place)
    place.parent.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=f".{job.key}-", dir=place.parent))
    chosen = Scenario.model_validate_json(job.scenario)
    try:
        summary = harvest(chosen, work)
    except Exception as error:  # one run's failure must not end the others
        summary = {
            "scenario": chosen.name,
            "seed": chosen.seed,
            "outcome": "crashed",
            "reason": f"{type(error).__name__}: {error}",
        }
        (work / "traceback.txt").write_text(traceback.format_exc(), encoding="utf-8")
        (work / "summary.json").write_text(json.dumps(summary, indent=2), encoding="utf-8")
    (work / "scenario.yaml").write_text(
        yaml.safe_dump(json.loads(job.scenario), sort_keys=False), encoding="utf-8"
    )
    if summary["outcome"] == "finished" and not job.keep_records:
        (work / "record.mcap").unlink(missing_ok=True)
    try:
        work.rename(place)
    except OSError:  # another worker was faster: a scheduler may hand out an item again
        shutil.rmtree(work)
    return summary_of(place)


def summary_of(place: Path) -> dict[str, Any]:
    """A finished run's summary, with its folder's name as `run`."""
    data: dict[str, Any] = json.loads((place / "summary.json").read_text(encoding="utf-8"))
    return data | {"run": place.name}


# ---- the campaign --------------------------------------------------------------------------------


def jobs_of(chosen: Iterable[Scenario], out: Path, keep_records: bool) -> list[Job]:
    """One job per scenario. UserError where two are the same run."""
    folder = str((out / "runs").resolve())
    quiet = {"record": {"film": False}}
    jobs = [Job(changed(s, quiet).model_dump_json(), folder, keep_records) for s in chosen]
    if len({job.scenario for job in jobs}) != len(jobs):
        raise UserError("the same scenario and seed are named twice; name each once")
    return jobs


def run_campaign(
    jobs: Sequence[Job],
    out: Path,
    *,
    workers: int = 2,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, Any]]:
    """Runs what is not done yet; returns the summaries of all jobs in their order, and keeps
    OUT/campaign.json up to date."""
    runs = out / "runs"
    runs.mkdir(parents=True, exist_ok=True)
    if scheduler is None:  # what a killed campaign left half done
        for rest in runs.glob(".*"):
            shutil.rmtree(rest, ignore_errors=True)
    done = {job.key: summary_of(job.place) for job in jobs if job.place.exists()}
    if progress is not None:
        progress(len(done), len(jobs))
    todo = [job for job in jobs if job.key not in done]
    for job, summary in spread(run_job, todo, workers=workers, scheduler=scheduler):
        done[job.key] = summary
        if progress is not None:
            progress(len(done), len(jobs))
    summaries = [done[job.key] for job in jobs]
    (out / "campaign.json").write_text(json.dumps(summaries, indent=1) + "\n", encoding="utf-8")
    return summaries


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


# ---- the command ---------------------------------------------------------------------------------


def seeds_of(text: str) -> list[int]:
    """`1-30`, `1,4,9` and mixtures. Raises ValueError."""
    seeds: list[int] = []
    for part in text.split(","):
        low, dash, high = part.strip().partition("-")
        seeds += range(int(low), int(high) + 1) if dash else [int(low)]
    if not seeds:
        raise ValueError("none")
    return seeds


def variants(settings: Sequence[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every combination of `field.name=a,b,c` settings: (its name, overrides for a scenario)."""
    choices: list[list[tuple[str, dict[str, Any]]]] = []
    for setting in settings:
        path, _, values = setting.partition("=")
        each = [values] if values.startswith("[") else values.split(",")
        choices.append(
            [
                (f"{path.split('.')[-1]}={value}" * (len(each) > 1), assigned(f"{path}={value}"))
                for value in each
            ]
        )
    for combination in itertools.product(*choices):
        merged: dict[str, Any] = {}
        for _, overrides in combination:
            merged = merge(merged, overrides)
        yield " ".join(name for name, _ in combination if name), merged


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
    from hil.report import report  # noqa: PLC0415
    from hil.scenario.random_fields import random_field  # noqa: PLC0415

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
