"""`daranti-hil moments`: one fault at many moments of a harvest, each in a copy of the process.

A row of the fault matrix is one moment. How soon a fault is told may hang on what the machine does
just then, so here the harvest goes on as if nothing were, and copies of it take the fault.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
import shapely
from dask.local import SynchronousExecutor
from numpy.typing import NDArray

from hil.bench.harvest import Harvest
from hil.judge.fault_verdict import Situation
from hil.scenario.faults import At, Component, Failure, Fault
from hil.scenario.scenario import Scenario
from hil.studies.fault_matrix import Watch, in_a_copy

FIRST_S: Final = 10.0
"""Of a harvest: its start is no moment."""
PHASES: Final[tuple[Situation, ...]] = ("follow", "turn")
HARMS: Final = ("neighbour_cut_m2", "outside_m")
"""Figures of merit that must not grow."""
FARTHER_S: Final = 1.0
"""For which the harvest itself goes on after the last copy: one that is a little faster gets beyond
the end of a path, and is not aside of it."""
STILL_S: Final = 1.0
"""With drive and blade off for so long, nothing more comes."""


@dataclass(frozen=True, slots=True)
class Moment:
    """What became of a fault that began then."""

    seed: int
    at_s: float
    phase: str
    shown_s: float | None
    """After how long it made a difference; None: never while it was watched."""
    by: str
    """Who named something first."""
    stop_ms: float | None
    """From when it made a difference until drive and blade were off; 0 where they were before;
    None: not while it was watched."""
    way_m: float
    """Travelled from then on."""
    turned_deg: float
    """The most by which the wheel turned away from where it was, until the stop."""
    aside_m: float
    """The most by which the rear axle was off the path that the machine took without the fault."""
    harm: str
    """What must not be: the neighbour's crop cut, outside, the blade on in reverse."""


class _Wheel(Watch):
    """Watches how far the wheel turns, too."""

    def __init__(self, run: Harvest) -> None:
        super().__init__(run)
        self.turned_deg = 0.0
        self._angle = math.degrees(float(run.bench.state["steer_angle"]))
        self._alive_at = run.bench.now

    def __call__(self, said: bytes) -> None:
        super().__call__(said)
        bench = self.run.bench
        angle = math.degrees(float(bench.state["steer_angle"]))
        _, drive, blade = bench.drives
        if drive != 0.0 or blade:
            self._alive_at = bench.now
            self.turned_deg = max(self.turned_deg, abs(angle - self._angle))

    @property
    def over(self) -> bool:
        """Whether drive and blade have been off for long."""
        return self.run.bench.now - self._alive_at >= STILL_S


@dataclass(frozen=True, slots=True)
class _Taken:
    moment: Moment
    path: NDArray[np.float64]
    """(n, 2) of the rear axle, from the fault on."""


def _taken(run: Harvest, fault: Fault, situation: Situation, watch_s: float) -> _Taken:
    """The run with the fault from now on."""
    run.scenario = run.scenario.model_copy(update={"faults": (fault,)})
    run.bench.faults.add(fault)
    before = run.truth.summary()
    watch = _Wheel(run)
    begin, begun_at = run.bench.now, len(run.truth.path)
    run.run(enough=lambda: watch.over or run.bench.now - begin >= watch_s)
    shown = run.bench.faults.shown_at(0)
    verdict = watch.verdict(fault, situation)
    after = run.truth.summary()
    worse = [key for key in HARMS if (after[key] or 0) > (before[key] or 0)]
    if watch.reversed_blade_at > begin:
        worse.append("blade in reverse")
    moment = Moment(
        seed=run.scenario.seed,
        at_s=begin,
        phase=situation,
        shown_s=None if shown is None else shown - begin,
        by=verdict.detected_by,
        stop_ms=None if shown is None else verdict.stop_latency_ms,
        way_m=verdict.moved_m,
        turned_deg=watch.turned_deg,
        aside_m=0.0,
        harm=", ".join(worse),
    )
    return _Taken(moment, np.array([p[1:3] for p in run.truth.path[begun_at:]]))


def moments(
    base: Scenario,
    failing: tuple[Component, Failure],
    *,
    count: int,
    every_s: float,
    watch_s: float,
) -> list[Moment]:
    """The first `count` of one harvest, `every_s` apart but for a jitter by the scenario's seed."""
    component, failure = failing
    rng = np.random.default_rng([base.seed, 0x303E])
    # A copy has no threads, so none may be at work: the pictures are developed in this one.
    run = Harvest(base, darkroom=SynchronousExecutor())
    taken: list[_Taken] = []
    try:
        due = FIRST_S
        while len(taken) < count and not run.pilot.done:
            due += every_s * rng.uniform(0.5, 1.5)
            run.run(enough=partial(_reached, run, due))
            if not _reached(run, due):
                break
            phase = run.pilot.phase.value
            for situation in PHASES:
                if situation == phase:
                    at = At(time_s=run.bench.now)
                    fault = Fault(component=component, failure=failure, at=at)
                    taken.append(in_a_copy(partial(_taken, run, fault, situation, watch_s)))
        if taken:
            run.run(enough=partial(_reached, run, taken[-1].moment.at_s + watch_s + FARTHER_S))
        healthy = shapely.LineString([p[1:3] for p in run.truth.path])
    finally:
        run.close()
    return [
        replace(t.moment, aside_m=float(shapely.distance(shapely.points(t.path), healthy).max()))
        for t in taken
    ]


def _reached(run: Harvest, at_s: float) -> bool:
    return run.bench.now >= at_s
