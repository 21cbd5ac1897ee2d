"""Whether the estimator knows how well it knows: its errors against the truth, in its own standard
deviations.

A normalised squared error (NEES, Bar-Shalom et al. 2001, 5.4) is the squared error over its
covariance. Of a filter that knows its errors it is 1 on average for each dimension, and 95 % of all
lie within the chi-squared distribution's 95 % quantile. Samples of one field are not independent,
so the fields' means are what a confidence interval is taken of.
"""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.stats import chi2, t

from hil.bench.harvest import Harvest
from hil.judge.metrics import OVERLAP_M
from hil.scenario.scenario import Scenario
from host.estimate.states import PLAN_YAW, YAW
from host.field.areas import outline_of, placed
from host.pilot.phase import Phase

EVERY_S: Final = 1.0
"""Between samples of error and belief."""
QUANTILE: Final = 0.95
"""Share of the errors that ought to lie within what is believed."""
MEASURES: Final = {"position": 2, "direction": 1, "lane": 1, "outline": 2, "border": 1}
"""Dimensions of what is compared: the rear axle's place; the yaw; the blade's offset from the
crop's true edge; the worst corner of the machine, which the geofence stands on; and how far the
machine's corner that is nearest to the field's border is from it. A boundary that was walked lies
elsewhere than the true one, so a place can be compared with the true one only where it is exact.
The distance from the border means the same in both. So does the direction, with what the filter
says of how the boundary is turned (`host.estimate.states.PLAN_YAW`)."""

Row = tuple[str, float, float]
"""Measure, normalised squared error over its dimensions, error in m or rad."""


@dataclass
class Samples:
    """Of one run."""

    rows: list[Row] = field(default_factory=list)

    def add(self, measure: str, squared: float, error: float) -> None:
        """One sample, where there is one."""
        if math.isfinite(squared):
            self.rows.append((measure, squared / MEASURES[measure], error))


class Watcher:
    """Compares once a second while a harvest runs; `enough` is the harvest's hook."""

    def __init__(self, run: Harvest) -> None:
        self._run = run
        self._next_s = 0.0
        self._corners = outline_of(run.scenario.told.vehicle)
        self._true = shapely.Polygon(run.scenario.world.corners)
        self.samples = Samples()

    def enough(self) -> bool:
        """Looks; the run goes on."""
        run = self._run
        if run.bench.now >= self._next_s and run.pilot.phase in (Phase.FOLLOW, Phase.TURN):
            self._next_s = run.bench.now + EVERY_S
            self._look()
        return False

    def _look(self) -> None:
        pilot, bench = self._run.pilot, self._run.bench
        if pilot.position.known:
            if pilot.position.outline.states == 0:
                self._look_at_place(pilot.position.pose, bench.pose)
            self._look_at_direction()
            self._look_at_border()
        if pilot.phase is Phase.FOLLOW and pilot.cut_m > 0.0:
            edge = self._run.truth.edge_offset(bench.pose) - OVERLAP_M - pilot.strip.shift_m
            error = edge + pilot.lane.blade_offset_m
            self.samples.add("lane", (error / pilot.lane.true_offset_sigma_m) ** 2, abs(error))

    def _look_at_place(
        self, believed: tuple[float, float, float], true: tuple[float, float, float]
    ) -> None:
        x, y = np.subtract(believed, true)[:2]
        p = self._run.pilot.position.covariance
        squared = float(np.array([x, y]) @ np.linalg.solve(p[:2, :2], [x, y]))
        self.samples.add("position", squared, math.hypot(x, y))
        here = placed(self._corners, *believed)
        off = here - placed(self._corners, *true)
        p = self._run.pilot.position.borders.covariance_of(here)
        squared = np.einsum("ni,nij,nj->n", off, np.linalg.inv(p), off)
        worst = int(np.argmax(squared))
        self.samples.add("outline", float(squared[worst]), float(np.hypot(*off[worst])))

    def _look_at_direction(self) -> None:
        position, true = self._run.pilot.position, self._run.bench.pose[2]
        h = np.zeros(len(position.x))
        h[YAW] = 1.0
        h[PLAN_YAW] = 1.0 if position.outline.states else 0.0
        turned = math.remainder(float(h @ position.x) - true, math.tau)
        self.samples.add("direction", (turned / position.sigma(h)) ** 2, abs(turned))

    def _look_at_border(self) -> None:
        position, told = self._run.pilot.position, self._run.scenario.told
        found = shapely.Polygon(position.outline.corners or told.boundary)
        here = placed(self._corners, *position.pose)
        believed = _inside_m(found, here)
        true = _inside_m(self._true, placed(self._corners, *self._run.bench.pose))
        nearest = int(np.argmin(np.minimum(believed, true)))
        out = here[nearest] - _nearest(found, here[nearest])
        length = math.hypot(*out)
        if length > 0.0:
            out /= length
            p = position.borders.covariance_of(here)[nearest]
            error = float(believed[nearest] - true[nearest])
            self.samples.add("border", error**2 / float(out @ p @ out), abs(error))


def _inside_m(field_: shapely.Polygon, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) how far points (n, 2) are from a field's border, negative outside of it."""
    places = shapely.points(points)
    away = shapely.distance(field_.exterior, places)
    return np.asarray(np.where(shapely.contains(field_, places), away, -away))


def _nearest(field_: shapely.Polygon, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2,) the place of a field's border that is nearest to a point."""
    along = field_.exterior.project(shapely.Point(point))
    return np.array(field_.exterior.interpolate(along).coords[0])


def watched(scenario: Scenario) -> dict[str, Any]:
    """One harvest: its outcome, and per measure the mean, the share within the quantile, the root
    mean square and the largest error, and the number of samples."""
    with closing(Harvest(scenario)) as run:
        watcher = Watcher(run)
        run.run(enough=watcher.enough)
        out: dict[str, Any] = {
            "seed": scenario.seed,
            "scenario": scenario.name,
            "outcome": run.pilot.phase.value,
            "reason": run.pilot.reason,
            "coverage": run.bench.field.coverage(),
            "outside_m": run.truth.outside_m,
            "neighbour_cut_m2": run.bench.field.neighbour_cut_m2(),
            "lateral_rms_m": float(np.sqrt(np.mean(np.square(run.truth.lateral or [math.nan])))),
            "false_ends": run.truth.false_ends,
            "time_s": run.bench.now,
        }
    for measure, count in MEASURES.items():
        own = np.array([row[1:] for row in watcher.samples.rows if row[0] == measure])
        if not own.size:
            continue
        out[measure] = {
            "nees": float(own[:, 0].mean()),
            "within": float((own[:, 0] * count < chi2.ppf(QUANTILE, count)).mean()),
            "rms": float(np.sqrt(np.mean(own[:, 1] ** 2))),
            "worst": float(own[:, 1].max()),
            "samples": len(own),
        }
    return out


@dataclass(frozen=True, slots=True)
class Line:
    """One measure over all runs."""

    measure: str
    runs: int
    nees: float
    """Mean of the runs' means: 1 where the filter knows its errors."""
    nees_low: float
    nees_high: float
    """95 % confidence interval of it."""
    median: float
    """Of the runs' means."""
    within: float
    """Share of samples within the 95 % quantile, mean of the runs."""
    rms: float
    worst: float


def overview(runs: list[dict[str, Any]]) -> list[Line]:
    """Of every measure that the runs have."""
    lines = []
    for measure in MEASURES:
        own = [run[measure] for run in runs if measure in run]
        if not own:
            continue
        means = np.array([one["nees"] for one in own])
        half = math.inf
        if len(own) > 1:
            half = float(t.ppf(0.975, len(own) - 1) * means.std(ddof=1) / math.sqrt(len(own)))
        lines.append(
            Line(
                measure,
                len(own),
                float(means.mean()),
                float(means.mean()) - half,
                float(means.mean()) + half,
                float(np.median(means)),
                float(np.mean([one["within"] for one in own])),
                float(np.sqrt(np.mean([one["rms"] ** 2 for one in own]))),
                float(max(one["worst"] for one in own)),
            )
        )
    return lines
