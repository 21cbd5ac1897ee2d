"""`daranti-hil sweep`: firmware parameters against a population of steering actuators.

Candidates come from a grid, at random, or from Optuna's TPE sampler; each one runs the same steps
on the same plants, with the compiled firmware in the loop. Dask spreads the work. Which candidate
is tried does not depend on how many workers there are, and neither does any bit of the table.
"""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import optuna
import pandas as pd
from pydantic import Field, ValidationError, model_validator
from scipy.stats import spearmanr

from hil.firmware import targets
from hil.scenario.drawn_machine import NOMINAL_RANGES
from hil.studies.actuators import (
    DAY_RANGES,
    Firmware,
    Plant,
    deadline_s,
    population,
    step_response,
)
from hil.studies.spread import client
from host.core.errors import UserError
from host.core.strict import Strict
from host.core.yaml_file import load_yaml
from host.link import protocol
from host.tune.step_response import Step, cost, meets

Method = Literal["grid", "random", "optuna"]
Gains = dict[str, float]
BATCH: Final = 16
"""Candidates per round of Optuna: how many it proposes before it hears of their costs. Fixed, so
that its proposals do not depend on the number of workers."""
PER_JOB: Final = 2
"""Candidates that a worker is given at once."""
WORST_SHARE: Final = 0.1
"""A candidate's cost is the mean over all responses plus the mean over this share, the worst."""
MOST_CANDIDATES: Final = 1_000_000
"""Of a grid: ten times the default's, which takes days."""
PLANT_COLUMNS: Final = tuple(Plant.__slots__)


class Axis(Strict):
    """The range of one parameter, in its unit."""

    low: float
    high: float
    points: int = 5
    """In a grid."""
    log: bool = False

    @model_validator(mode="after")
    def _ordered(self) -> Axis:
        if not self.low < self.high or (self.log and self.low <= 0) or self.points < 2:
            raise ValueError("needs low < high, at least 2 points, and low > 0 where log is set")
        return self

    def at(self, share: float) -> float:
        """The value at 0..1 of the range."""
        if self.log:
            return float(self.low * (self.high / self.low) ** share)
        return self.low + (self.high - self.low) * share


class Space(Strict):
    """What is swept over what: the file that --space names."""

    parameters: dict[str, Axis]
    fixed: dict[str, float] = Field(default_factory=dict)
    plants: dict[str, tuple[float, float]] = Field(
        default_factory=lambda: {**NOMINAL_RANGES, **DAY_RANGES}
    )
    """Range of each of a plant's properties (hil.studies.actuators.Plant)."""
    steps_deg: tuple[float, ...] = Field(default=(30.0, 5.0), min_length=1)

    @model_validator(mode="after")
    def _known(self) -> Space:
        for name in (*self.parameters, *self.fixed):
            if name not in protocol.PARAMS:
                raise ValueError(f"the firmware has no parameter {name!r}")
        for name, axis in self.parameters.items():
            spec = protocol.PARAMS[name]
            spec.to_raw(axis.low)
            spec.to_raw(axis.high)
        for name in self.plants:
            if name not in PLANT_COLUMNS:
                raise ValueError(f"a plant has no property {name!r}, only {PLANT_COLUMNS}")
        for name, (low, high) in self.plants.items():
            if not low <= high:
                raise ValueError(f"the range of a plant's {name} ends before it begins")
        if 0 in self.steps_deg:
            raise ValueError("a step of 0 degrees is none")
        count = math.prod(axis.points for axis in self.parameters.values())
        if count > MOST_CANDIDATES:
            raise ValueError(f"a grid of {count} candidates has no end; give fewer points")
        return self

    def candidate(self, shares: Sequence[float]) -> Gains:
        """Parameters at these shares of their ranges, as the firmware's raw numbers allow."""
        values = dict(self.fixed)
        for (name, axis), share in zip(self.parameters.items(), shares, strict=True):
            spec = protocol.PARAMS[name]
            values[name] = spec.from_raw(spec.to_raw(axis.at(share)))
        return values


DEFAULT_SPACE: Final = Space(
    parameters={
        "steer_kp": Axis(low=15, high=100, log=True),
        "steer_ki": Axis(low=0, high=100),
        "steer_kd": Axis(low=0, high=6),
        "steer_d_filter": Axis(low=0, high=80),
        "steer_min_duty": Axis(low=0, high=80),
        "steer_deadband": Axis(low=0.3, high=1.0),
        "steer_duty_slew": Axis(low=5000, high=25500),
    }
)


def load_space(path: Path) -> Space:
    """Reads a space from YAML. Raises UserError with what is wrong and where."""
    try:
        return Space.model_validate(load_yaml(path, "space"))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "space"
        raise UserError(f"{path}: {where}: {first['msg']}") from error


# ---- one candidate -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Job:
    """Candidates and what they are tried on; all that a worker needs."""

    first: int
    """Number of the first candidate."""
    candidates: tuple[Gains, ...]
    plants: tuple[Plant, ...]
    steps: tuple[Step, ...]
    firmware: Firmware = "desk"


def run_job(job: Job) -> list[dict[str, Any]]:
    """One row per candidate, plant and step, in that order."""
    rows = []
    for number, gains in enumerate(job.candidates, job.first):
        for plant_number, plant in enumerate(job.plants):
            spec = plant.machine()
            for step in job.steps:
                response, _ = step_response(plant, gains, step, job.firmware)
                rows.append(
                    {
                        "candidate": number,
                        "plant": plant_number,
                        "step_deg": step.size_deg,
                        **gains,
                        **{f"plant_{n}": getattr(plant, n) for n in PLANT_COLUMNS},
                        **asdict(response),
                        "meets": meets(response, step, deadline_s(spec, step)),
                        "cost": cost(response, step, deadline_s(spec, step)),
                    }
                )
    return rows


def candidate_cost(costs: Iterable[float]) -> float:
    """What one candidate costs over all plants and steps."""
    ordered = np.sort(np.fromiter(costs, float))
    worst = ordered[-max(1, round(len(ordered) * WORST_SHARE)) :]
    return float(ordered.mean() + worst.mean())


# ---- many candidates -----------------------------------------------------------------------------

Map = Callable[[Sequence[Job]], list[list[dict[str, Any]]]]


def serial(jobs: Sequence[Job]) -> list[list[dict[str, Any]]]:
    """In this process."""
    return [run_job(job) for job in jobs]


@contextmanager
def dask(workers: int, scheduler: str | None = None) -> Iterator[Map]:
    """On Dask: `workers` local processes of one thread each, or the scheduler at an address."""
    with client(workers, scheduler) as pool:

        def spread(jobs: Sequence[Job]) -> list[list[dict[str, Any]]]:
            results: list[list[dict[str, Any]]] = pool.gather(pool.map(run_job, jobs, pure=False))
            return results

        yield spread


@dataclass(frozen=True)
class Sweep:
    """What to try on what."""

    space: Space
    method: Method = "optuna"
    trials: int = 200
    """Candidates; a grid has its own number."""
    plant_count: int = 25
    seed: int = 0
    firmware: Firmware = "desk"

    @property
    def plants(self) -> tuple[Plant, ...]:
        """The population: the same for each candidate."""
        return tuple(population(self.plant_count, self.seed, ranges=self.space.plants))

    @property
    def steps(self) -> tuple[Step, ...]:
        """The steps that each candidate makes on each plant."""
        return tuple(Step(size_deg=size) for size in self.space.steps_deg)

    def responses(self) -> int:
        """How many step responses it takes."""
        axes = self.space.parameters.values()
        count = math.prod(axis.points for axis in axes) if self.method == "grid" else self.trials
        return count * self.plant_count * len(self.steps)

    def _jobs(self, first: int, candidates: Sequence[Gains]) -> list[Job]:
        plants, steps = self.plants, self.steps
        return [
            Job(first + at, tuple(candidates[at : at + PER_JOB]), plants, steps, self.firmware)
            for at in range(0, len(candidates), PER_JOB)
        ]

    def run(
        self, spread: Map = serial, progress: Callable[[int], None] = lambda _: None
    ) -> pd.DataFrame:
        """The table, one row per response. `progress` hears how many responses are there."""
        rows: list[dict[str, Any]] = []

        def take(first: int, candidates: Sequence[Gains]) -> list[dict[str, Any]]:
            fresh = list(itertools.chain(*spread(self._jobs(first, candidates))))
            rows.extend(fresh)
            progress(len(rows))
            return fresh

        if self.method == "optuna":
            self._optimise(take)
        else:
            candidates = list(self._grid() if self.method == "grid" else self._random())
            for at in range(0, len(candidates), BATCH):
                take(at, candidates[at : at + BATCH])
        return pd.DataFrame(rows)

    def _grid(self) -> Iterator[Gains]:
        axes = [np.linspace(0, 1, a.points).tolist() for a in self.space.parameters.values()]
        return (self.space.candidate(shares) for shares in itertools.product(*axes))

    def _random(self) -> Iterator[Gains]:
        random = np.random.default_rng(self.seed)
        count = len(self.space.parameters)
        return (self.space.candidate(random.random(count).tolist()) for _ in range(self.trials))

    def _optimise(self, take: Callable[[int, Sequence[Gains]], list[dict[str, Any]]]) -> None:
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        sampler = optuna.samplers.TPESampler(
            seed=self.seed, multivariate=True, n_startup_trials=4 * BATCH, constant_liar=True,
            warn_independent_sampling=False,
        )  # fmt: skip
        study = optuna.create_study(sampler=sampler)
        for first in range(0, self.trials, BATCH):
            trials = [study.ask() for _ in range(min(BATCH, self.trials - first))]
            shares = [
                [t.suggest_float(name, 0, 1) for name in self.space.parameters] for t in trials
            ]
            rows = take(first, [self.space.candidate(s) for s in shares])
            per_trial = len(rows) // len(trials)
            for number, trial in enumerate(trials):
                own = rows[number * per_trial : (number + 1) * per_trial]
                study.tell(trial, candidate_cost([row["cost"] for row in own]))


# ---- results -------------------------------------------------------------------------------------


def candidates_of(table: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """One row per candidate: its parameters, cost, the share of responses that meet the figures,
    means and worst cases; sorted by cost."""
    grouped = table.groupby("candidate", sort=True)
    out = grouped[list(names)].first()
    out["cost"] = grouped["cost"].agg(candidate_cost)
    out["meets"] = grouped["meets"].mean()
    for name in ("settle_s", "overshoot", "steady_error_deg", "starts", "reversals"):
        out[f"{name}_worst"] = grouped[name].max()
    for name in ("error_s", "energy_j", "reversals"):
        out[f"{name}_mean"] = grouped[name].mean()
    out["faults"] = grouped["faults"].agg(lambda faults: int((faults != 0).sum()))
    return out.sort_values("cost", kind="stable")


def pareto(candidates: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """The candidates that none other beats in all of `by` (smaller is better)."""
    values = candidates[list(by)].to_numpy()
    keep = [
        not any((other <= row).all() and (other < row).any() for other in values) for row in values
    ]
    return candidates[keep].sort_values(by[0], kind="stable")


def worst_case(table: pd.DataFrame, candidate: int) -> dict[str, Any]:
    """The dearest response of a candidate: plant, step and figures."""
    own = table[table["candidate"] == candidate]
    row = own.iloc[int(own["cost"].to_numpy().argmax())]
    return {str(name): _plain(value) for name, value in row.items()}


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def spot_check(
    sweep: Sweep, table: pd.DataFrame, responses: int, spread: Map = serial
) -> dict[str, float]:
    """Repeats some responses on the Uno's binary: ten candidates from best to worst on as many
    plants as it takes. Spearman's rank correlation of their costs, and the share of responses with
    the same verdict."""
    names = [*sweep.space.parameters, *sweep.space.fixed]
    ranked = candidates_of(table, names)
    chosen = ranked.iloc[np.linspace(0, len(ranked) - 1, min(10, len(ranked))).astype(int)]
    step = sweep.steps[0]
    plants = sweep.plants[: max(1, responses // len(chosen))]
    jobs = [
        Job(int(str(number)), ({n: float(row[n]) for n in names},), plants, (step,), "avr")
        for number, row in chosen.iterrows()
    ]
    avr = pd.DataFrame(itertools.chain(*spread(jobs)))
    keys = ["candidate", "plant", "step_deg"]
    both = avr.merge(table, on=keys, suffixes=("_avr", "_desk"))
    costs = both.groupby("candidate")[["cost_avr", "cost_desk"]].mean()
    return {
        "responses": len(both),
        "rank_correlation": round(float(spearmanr(costs["cost_avr"], costs["cost_desk"])[0]), 4),
        "same_verdict": round(float((both["meets_avr"] == both["meets_desk"]).mean()), 4),
        "settle_difference_median_s": round(
            float((both["settle_s_avr"] - both["settle_s_desk"]).abs().median()), 4
        ),
    }


def summary_of(sweep: Sweep, table: pd.DataFrame) -> dict[str, Any]:
    """The sweep in short: what was tried, what was chosen, its worst case."""
    names = [*sweep.space.parameters, *sweep.space.fixed]
    ranked = candidates_of(table, names)
    best = ranked.iloc[0]
    number = int(ranked.index.to_numpy()[0])
    own = table[table["candidate"] == number]
    digest = hashlib.sha256(table.to_csv(index=False).encode()).hexdigest()
    return {
        "method": sweep.method,
        "seed": sweep.seed,
        "candidates": len(ranked),
        "plants": sweep.plant_count,
        "steps_deg": list(sweep.space.steps_deg),
        "responses": len(table),
        "table_sha256": digest,
        "firmware_sha256": hashlib.sha256(targets.DESK_LIBRARY.read_bytes()).hexdigest(),
        "chosen": {name: round(float(best[name]), 4) for name in names},
        "chosen_candidate": number,
        "chosen_cost": round(float(best["cost"]), 4),
        "chosen_meets": round(float(best["meets"]), 4),
        "chosen_meets_by_step": {
            f"{size:g}": round(float(group.mean()), 4)
            for size, group in own.groupby("step_deg")["meets"]
        },
        "worst_case": worst_case(table, number),
    }
