"""`daranti-hil moments`: one fault at many moments of a harvest, each in a copy of the process.

A row of the fault matrix is one moment. How soon a fault is told may hang on what the machine does
just then, so here the harvest goes on as if nothing were, and copies of it take the fault.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from dask.local import SynchronousExecutor

from hil.bench.harvest import Harvest
from hil.judge.fault_verdict import Situation
from hil.scenario.faults import At, Component, Failure, Fault
from hil.scenario.scenario import Scenario
from hil.studies.fault_matrix import Watch, in_a_copy

FIRST_S: Final = 10.0
"""Of a harvest: its start is no moment."""
PHASES: Final[tuple[Situation, ...]] = ("follow", "turn")
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
    told_ms: float | None
    """From then until firmware or pilot named something; None: not while it was watched."""
    by: str
    stop_ms: float | None
    """From then until drive and blade were off."""
    way_m: float
    """Travelled from then on."""
    turned_deg: float
    """The most by which the wheel turned away from where it was, until the stop."""
    edge_m: float
    """The most by which the blade left the crop's edge meanwhile; 0: it followed none."""
    verdict: str


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


def _taken(
    run: Harvest, fault: Fault, situation: Situation, watch_s: float
) -> Moment:
    """The run with the fault from now on."""
    run.scenario = run.scenario.model_copy(update={"faults": (fault,)})
    run.bench.faults.add(fault)
    watch = _Wheel(run)
    begin, followed = run.bench.now, len(run.truth.lateral)
    run.run(enough=lambda: watch.over or run.bench.now - begin >= watch_s)
    shown = run.bench.faults.shown_at(0)
    verdict = watch.verdict(fault, situation)
    return Moment(
        seed=run.scenario.seed,
        at_s=begin,
        phase=situation,
        shown_s=None if shown is None else shown - begin,
        told_ms=None if shown is None else verdict.detected_ms,
        by=verdict.detected_by,
        stop_ms=None if shown is None else verdict.stop_latency_ms,
        way_m=verdict.moved_m,
        turned_deg=watch.turned_deg,
        edge_m=max((abs(x) for x in run.truth.lateral[followed:]), default=0.0),
        verdict=verdict.verdict,
    )


def moments(
    base: Scenario,
    failing: tuple[Component, Failure],
    *,
    count: int,
    every_s: float,
    watch_s: float,
    phases: Sequence[Situation] = PHASES,
) -> Iterator[Moment]:
    """The first `count` of one harvest, `every_s` apart but for a jitter by the scenario's seed."""
    component, failure = failing
    rng = np.random.default_rng([base.seed, 0x303E])
    # A copy has no threads, so none may be at work: the pictures are developed in this one.
    run = Harvest(base, darkroom=SynchronousExecutor())
    try:
        found, due = 0, FIRST_S
        while found < count and not run.pilot.done:
            due += every_s * rng.uniform(0.5, 1.5)
            run.run(enough=lambda at=due: run.bench.now >= at)  # type: ignore[misc]
            if run.bench.now < due:
                return
            phase = run.pilot.phase.value
            for situation in phases:
                if situation == phase:
                    at = At(time_s=run.bench.now)
                    fault = Fault(component=component, failure=failure, at=at)
                    yield in_a_copy(partial(_taken, run, fault, situation, watch_s))
                    found += 1
    finally:
        run.close()
