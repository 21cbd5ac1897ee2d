"""Many runs at once: campaigns and sweeps over scenarios and seeds, on Dask.

A run's folder is named by what it depends on and appears under its name only when it is complete,
so a campaign that was killed goes on where it stopped: nothing is lost, nothing is run twice.
Processes on this machine by default; `--scheduler` uses a cluster whose workers share OUT's file
system. Every worker runs one run at a time in one thread.
"""

from __future__ import annotations

import gc
import hashlib
import itertools
import json
import re
import shutil
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import pandas as pd
import yaml

from hil.bench import harvest
from hil.bench.alone import alone
from hil.bench.model_eyes import LIBRARY
from hil.judge.causes import circumstances, disagreements
from hil.scenario.random_fields import random_field
from hil.scenario.scenario import Scenario, assigned, changed, load, merge
from hil.studies.commissioning import commission, walk_of
from hil.studies.outlines import outline_field
from hil.studies.spread import spread
from host.core.errors import UserError

BELIEF_FOLDER = "belief"
"""In a run's folder: what commissioning has left."""
SAMPLE_SEED = 1
"""Of which runs, besides the worst, are driven again with pictures."""

# ---- one run -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Job:
    """One run of a campaign; plain data, so that it travels."""

    scenario: str
    """As JSON."""
    folder: str
    keep_records: bool
    commissioned: bool = False
    """Whether the machine is commissioned in the loop first, and harvests with what that found."""

    @property
    def key(self) -> str:
        """The run's name: scenario, seed, and a digest of everything else it depends on."""
        chosen = Scenario.model_validate_json(self.scenario)
        depends = self.scenario.encode() + b"commissioned" * self.commissioned
        if chosen.eyes == "model":
            depends += LIBRARY.read_bytes() if LIBRARY.exists() else b""
        digest = hashlib.sha256(depends).hexdigest()[:10]
        name = re.sub(r"[^\w.=]+", "-", chosen.name)
        return f"{name}-{chosen.seed:05d}-{digest}"

    @property
    def place(self) -> Path:
        """Where its results appear, complete."""
        return Path(self.folder) / self.key


def run_job(job: Job) -> dict[str, Any]:
    """Runs a job into its folder and returns its summary. A run that crashes is a result, too."""
    cv2.setNumThreads(1)
    # What is imported by now stays, and need not be looked through for garbage again and again.
    gc.collect()
    gc.freeze()
    place = job.place
    if (place / "summary.json").exists():
        return summary_of(place)
    place.parent.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=f".{job.key}-", dir=place.parent))
    chosen = described = Scenario.model_validate_json(job.scenario)
    try:
        if job.commissioned:
            commission(chosen, work / BELIEF_FOLDER, walk_of(chosen))
            described = changed(chosen, {"belief": {"folder": str(place / BELIEF_FOLDER)}})
            chosen = changed(chosen, {"belief": {"folder": str(work / BELIEF_FOLDER)}})
        summary = harvest.harvest(chosen, work, recorded_as=described)
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
        yaml.safe_dump(described.model_dump(mode="json"), sort_keys=False), encoding="utf-8"
    )
    if summary["outcome"] == "finished" and not job.keep_records:
        (work / "record.mcap").unlink(missing_ok=True)
    try:
        work.rename(place)
    except OSError:  # another worker was faster: a scheduler may hand out an item again
        shutil.rmtree(work)
    return summary_of(place)


def summary_of(place: Path) -> dict[str, Any]:
    """A finished run's summary, with its folder's name as `run` and the pilot's changes of state as
    `events`."""
    data: dict[str, Any] = json.loads((place / "summary.json").read_text(encoding="utf-8"))
    events = place / "events.json"
    changes = json.loads(events.read_text(encoding="utf-8")) if events.exists() else []
    return data | {"run": place.name, "events": changes}


# ---- the campaign --------------------------------------------------------------------------------


def jobs_of(
    chosen: Iterable[Scenario], out: Path, keep_records: bool, *, commissioned: bool = False
) -> list[Job]:
    """One job per scenario. UserError where two are the same run."""
    folder = str((out / "runs").resolve())
    jobs = []
    for s in chosen:
        lean = s.eyes == "model" and not keep_records
        quiet = {"record": {"film": False, "files": "figures" if lean else "all"}}
        described = changed(s, quiet).model_dump_json()
        jobs.append(Job(described, folder, keep_records, commissioned))
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
    with alone(out, "campaign") if scheduler is None else nullcontext():
        if scheduler is None:  # what a killed campaign left half done, and no other one's
            for rest in runs.glob(".*"):
                shutil.rmtree(rest, ignore_errors=True)
        return _run(jobs, out, workers, scheduler, progress)


def _run(
    jobs: Sequence[Job],
    out: Path,
    workers: int,
    scheduler: str | None,
    progress: Callable[[int, int], None] | None,
) -> list[dict[str, Any]]:
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
    worlds = [circumstances(Scenario.model_validate_json(job.scenario)) for job in jobs]
    tabulate(out, summaries, worlds)
    return summaries


def tabulate(
    out: Path, summaries: Sequence[dict[str, Any]], worlds: Sequence[dict[str, Any]]
) -> None:
    """OUT/runs.parquet, a row a run with its figures and its world, and OUT/events.parquet, a row a
    change of the pilot's state."""
    flat = (int, float, str, bool)
    rows = [
        {f"world_{k}": v for k, v in world.items()}
        | {k: v for k, v in summary.items() if isinstance(v, flat) or v is None}
        for summary, world in zip(summaries, worlds, strict=True)
    ]
    events = [
        {"run": summary["run"], **event} for summary in summaries for event in summary["events"]
    ]
    for name, table in (("runs", rows), ("events", events)):
        fresh = out / f"{name}.parquet.part"
        pd.DataFrame(table).to_parquet(fresh, index=False)
        fresh.replace(out / f"{name}.parquet")


# ---- what is worth another look ------------------------------------------------------------------


def badness(summary: dict[str, Any]) -> float:
    """How much a run is worth a look; the worst has most."""
    harm = float(summary.get("neighbour_cut_m2") or 0.0) + float(summary.get("outside_m") or 0.0)
    left = 1.0 - float(summary.get("coverage") or 0.0)
    stopped = summary["outcome"] != "finished"
    return 100.0 * float(harm > 0.0) + harm + 10.0 * float(stopped) + left


def picked(
    jobs: Sequence[Job], summaries: Sequence[dict[str, Any]], worst: int, sample: int
) -> list[Job]:
    """The jobs of the worst runs, then those of a random sample of the others."""
    order = sorted(range(len(jobs)), key=lambda k: -badness(summaries[k]))
    first, rest = order[:worst], order[worst:]
    drawn = np.random.default_rng(SAMPLE_SEED).permutation(len(rest))[:sample]
    return [jobs[k] for k in [*first, *(rest[n] for n in drawn)]]


def with_pictures(job: Job, out: Path) -> Job:
    """The same field by the real detector on pictures, its run under `out`."""
    chosen = Scenario.model_validate_json(job.scenario)
    other = changed(chosen, {"eyes": "picture", "record": {"files": "all"}})
    return replace(job, scenario=other.model_dump_json(), folder=str((out / "runs").resolve()))


def with_files(job: Job, out: Path) -> Job:
    """The same run again under `out`, which gives the same, with its map and its record."""
    chosen = changed(Scenario.model_validate_json(job.scenario), {"record": {"files": "all"}})
    return replace(job, scenario=chosen.model_dump_json(), folder=str((out / "runs").resolve()))


@dataclass(frozen=True, slots=True)
class Again:
    """How many runs by the model of the eyes are looked at once more."""

    worst: int = 0
    """The worst, with pictures."""
    sample: int = 0
    """Others at random, with pictures."""
    maps: int = 0
    """The worst, with their maps."""


def looked_at_again(
    jobs: Sequence[Job],
    summaries: Sequence[dict[str, Any]],
    out: Path,
    again: Again,
    run: Callable[[Sequence[Job], Path, str], list[dict[str, Any]]],
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Drives some runs of a campaign by the model of the eyes again. Returns all summaries, each
    with the run that has its map as `map`, and where model and pictures disagree. `run`: jobs into
    a folder, under a title."""
    seen_in, maps_in = out / "pictures", out / "maps"
    checked = [
        with_pictures(job, seen_in) for job in picked(jobs, summaries, again.worst, again.sample)
    ]
    seen = run(checked, seen_in, "with pictures") if checked else []
    drawn = [with_files(job, maps_in) for job in picked(jobs, summaries, again.maps, 0)]
    mapped = run(drawn, maps_in, "maps of the worst") if drawn else []
    keep = {(s["scenario"], s["seed"]): s["run"] for s in mapped}
    found = [s | {"map": keep.get((s["scenario"], s["seed"]), s["run"])} for s in summaries]
    return found, disagreements(summaries, seen)


# ---- what is run ---------------------------------------------------------------------------------


MOST_SEEDS: Final = 10_000_000
"""Ten times what docs/use/thousand_fields.md reckons with; of more, the list fills the memory."""


def seeds_of(text: str) -> list[int]:
    """`1-30`, `1,4,9` and mixtures; each once. Raises ValueError that says why."""
    seeds: dict[int, None] = {}
    for part in map(str.strip, text.split(",")):
        low, dash, high = part.partition("-")
        try:
            found = range(int(low), int(high if dash else low) + 1)
        except ValueError as error:
            raise ValueError(f"{part!r} is no seed") from error
        if not found:
            raise ValueError(f"{part!r} counts down")
        if len(seeds) + len(found) > MOST_SEEDS:
            raise ValueError(f"{part!r} is too many: {MOST_SEEDS} is the most")
        seeds |= dict.fromkeys(found)
    return list(seeds)


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


def scenarios_of(
    names: Sequence[str],
    seeds: Sequence[int],
    settings: Sequence[str] = (),
    eyes: str = "picture",
    *,
    random_fields: bool = False,
    outlines: bool = False,
) -> list[Scenario]:
    """Every scenario with every seed and every combination of settings; the default one where
    neither names nor random fields nor outlines are asked for."""
    chosen: list[Scenario] = []
    for label, overrides in variants(settings):
        for seed in seeds:
            one = [load(name, merge(overrides, {"seed": seed})) for name in names]
            if random_fields:
                one.append(changed(random_field(seed), overrides))
            if outlines:
                one.append(changed(outline_field(seed), overrides))
            if not one:
                one.append(load("default", merge(overrides, {"seed": seed})))
            chosen += [s.model_copy(update={"name": f"{s.name} {label}".strip()}) for s in one]
    return [changed(one, {"eyes": eyes}) for one in chosen]
