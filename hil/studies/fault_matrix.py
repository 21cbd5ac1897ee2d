"""`daranti-hil faults`: every supported fault in a short run, and what the machine did about it.

A run follows the crop's edge, or turns, when the fault strikes. Watched are what the motors truly
get, to the millisecond (drive and blade off is what counts as a stop), and what the firmware says
before any cable has its way.
"""

from __future__ import annotations

import math
import os
import pickle
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import cv2
from dask.local import SynchronousExecutor

from hil.bench.harvest import Harvest
from hil.bench.lockstep import Bench
from hil.bench.slices import SLICE_US
from hil.firmware.provision import Firmware
from hil.firmware.signal_wires import Signal
from hil.judge.fault_verdict import Situation, Verdict
from hil.scenario.faults import PAIRS, At, Expect, Fault, Pair
from hil.scenario.scenario import Limits, Recording, Scenario
from hil.studies.own_machine import own_machine
from host.core.errors import UserError
from host.core.messages import State
from host.link import protocol
from host.link.session import Session
from host.pilot.phase import Doing, Phase
from host.pilot.stop_and_look import LOOKING
from host.vision.view import Detector
from sim_plant.field_spec import FieldSpec

Result = TypeVar("Result")
SETTLE_S = 3.0
"""Following for this long before the fault."""
WATCH_S = 5.0
"""The run goes on for so long after the fault shows, at least, and for BEYOND_S after its bound."""
BEYOND_S = 2.0
OFF_EDGE_M = 0.15
"""A blade that cuts farther off the edge than this has not ridden through."""
SILENT_S = 0.5
"""A firmware that says nothing from then on is without power, which is how it stopped."""
REVERSING_MPS = -0.05
AT_REST_MPS = 0.02
GROUP = 8
"""Cases that share what comes before their faults, at most."""
LIMIT_S = 60.0
"""Of one case, should nothing end it."""
_MOVERS = (Signal.DRIVE_DUTY, Signal.BLADE)
BLADE_HZ = 40.0
"""Pulses of the blade's optional sensor at full speed."""
SENSORS = {"hall_phases": 2.0, "blade_turn_min": BLADE_HZ / 2, "blade_spin_time": 400.0}
"""What the owner tells the firmware of the optional sensors. The world's blade stops in 0.4 s
(sim_plant/machine.py, blade_spin_up_s), which is what docs/build has him measure."""


_OK, _UNSAFE, _LIMIT = "ok", "UNSAFE", "LIMIT"


@dataclass(frozen=True, slots=True)
class _Outcome:
    """What became of machine and fault."""

    shown: bool = False
    """Whether the fault changed anything."""
    since: float = 0.0
    """When it first did, else when it began."""
    detected_by: str = "nobody"
    detected_at: float | None = None
    latency_ms: float | None = None
    """Until all that moves was off; None where it goes on."""
    moved_m: float = 0.0


_NOTHING = _Outcome()


def _verdict(
    fault: Fault, situation: Situation, word: str, what: str, outcome: _Outcome
) -> Verdict:
    pair, at, latency = fault.pair, outcome.detected_at, outcome.latency_ms
    bound = f"{pair.bound_s * 1000:.0f} ms" + (f" or {pair.bound_m:g} m" if pair.bound_m else "")
    return Verdict(
        fault.name,
        situation,
        pair.expect.value,
        bound,
        detected_by=outcome.detected_by,
        detected_ms=None if at is None else round((at - outcome.since) * 1000, 1),
        stop_latency_ms=None if latency is None else round(latency, 1),
        moved_m=round(outcome.moved_m, 3),
        ok=word == _OK,
        verdict=f"{word}: {what}",
        limit=word == _LIMIT,
    )


class Watch:
    """Follows a run at every slice."""

    def __init__(self, run: Harvest) -> None:
        self.run = run
        self.path: list[tuple[float, float]] = []
        """(time, distance travelled since the fault began)."""
        self.rest_m = 0.0
        self.reversed_blade_at = -math.inf
        """When the blade was last on in reverse."""
        self.faults: list[tuple[float, protocol.Fault]] = []
        """The firmware's fault word whenever it changed."""
        self.resets: list[float] = []
        self.heard = -math.inf
        """When the firmware last said anything."""
        self._session = Session()
        self._travel = 0.0
        self._lateral_from = len(run.truth.lateral)
        run.bench.on_slice = self

    @property
    def begun(self) -> float | None:
        """When the fault began."""
        events = self.run.bench.faults.events
        return events[0].stamp if events else None

    def __call__(self, said: bytes) -> None:
        bench = self.run.bench
        now = bench.now
        resets = self._session.resets
        for telemetry in self._session.feed(now, said):
            self.heard = now
            word = protocol.Fault(telemetry.faults)
            if not self.faults or self.faults[-1][1] != word:
                self.faults.append((now, word))
            if telemetry.state is State.FAULT and not word:
                self.faults.append((now, word))
        if self._session.resets != resets:
            self.resets.append(now)
        if self.begun is None:
            self._lateral_from = len(self.run.truth.lateral)
            return
        speed = float(bench.state["v"])
        self._travel += abs(speed) * SLICE_US / 1e6
        self.path.append((now, self._travel))
        _, _, blade = bench.drives
        if abs(speed) > AT_REST_MPS:
            self.rest_m = self._travel
        if blade and speed < REVERSING_MPS:
            self.reversed_blade_at = now

    def enough(self) -> bool:
        """Whether the fault has been watched for long enough."""
        begun, shown = self.begun, self.run.bench.faults.shown_at(0)
        bound_s = self.run.scenario.faults[0].pair.bound_s
        since = begun if shown is None else shown
        return since is not None and self.run.bench.now - since >= max(WATCH_S, bound_s + BEYOND_S)

    def _harm(self, allowed_until: float) -> list[str]:
        """What must not be, but for a machine that had not to stop before `allowed_until`."""
        truth = self.run.truth.summary()
        harm = []
        if truth["neighbour_cut_m2"]:
            harm.append(f"neighbour's crop cut: {truth['neighbour_cut_m2']} m2")
        if truth["outside_m"]:
            harm.append(f"outside by {truth['outside_m']} m")
        if self.reversed_blade_at > allowed_until:
            harm.append("blade on in reverse")
        off = max((abs(x) for x in self.run.truth.lateral[self._lateral_from :]), default=0.0)
        if off > OFF_EDGE_M:
            harm.append(f"{off:.2f} m off the edge")
        return harm

    def _detection(self, begun: float) -> tuple[str, float | None]:
        before = protocol.Fault(0)
        found: list[tuple[float, str]] = []
        for stamp, word in self.faults:
            if stamp < begun:
                before = word
            elif word & ~before:
                names = "|".join(bit.name or "?" for bit in protocol.Fault if bit & word & ~before)
                found.append((stamp, f"firmware {names}"))
        found += [(stamp, "firmware: boots SAFE") for stamp in self.resets if stamp >= begun]
        found += [
            (change.stamp, f"pilot: {change.reason}")
            for change in self.run.pilot.transitions
            if change.stamp >= begun
            and change.phase in (Phase.HESITATE, Phase.FAULT)
            and LOOKING not in change.reason
        ]
        # What says why wins over the bare restart in the same telemetry.
        found.sort(key=lambda item: (item[0], item[1].startswith("firmware: ")))
        return (found[0][1], found[0][0]) if found else ("nobody", None)

    def verdict(self, fault: Fault, situation: Situation) -> Verdict:
        """After the run."""
        begun = self.begun
        if begun is None:
            return _verdict(
                fault, situation, "the run never got to it", self.run.pilot.reason, _NOTHING
            )
        outcome = self._outcome(fault.pair, begun)
        word, what = self._judged(fault.pair, begun, outcome)
        limit = fault.pair.limit
        if word != _OK and limit and not has_sensors(self.run.scenario):
            word, what = _LIMIT, f"{what}; {limit}"
        return _verdict(fault, situation, word, what, outcome)

    def _outcome(self, pair: Pair, begun: float) -> _Outcome:
        """What became of machine and fault."""
        shown = self.run.bench.faults.shown_at(0)
        since = shown if shown is not None else begun
        by, at = self._detection(begun)
        wires = self.run.bench.faults.taps
        # The pins were read as this millisecond began: by its end they were off.
        movers = _MOVERS[:1] if pair.blade_stays else _MOVERS
        last_on = max(float(wires[k]["alive_us"]) for k in movers) / 1e6
        stopped = self.path[-1][0] - last_on > 0.5
        start_m = next((m for t, m in self.path if t >= since), 0.0)
        until_m = self.rest_m if stopped else self.path[-1][1]
        return _Outcome(
            shown is not None,
            since,
            by,
            at,
            max(0.0, last_on - since) * 1000 if stopped else None,
            max(0.0, until_m - start_m),
        )

    def _judged(self, pair: Pair, begun: float, outcome: _Outcome) -> tuple[str, str]:
        """The outcome in a word, and in some more."""
        stops = pair.expect is Expect.STOP
        since, latency = outcome.since, outcome.latency_ms
        harm = self._harm(since + pair.bound_s if stops else begun)
        if harm:
            return _UNSAFE, "; ".join(harm)
        if not outcome.shown:
            return _OK, "it made no difference in this run"
        if not stops:
            return _OK, "rode through" if latency is None else "stopped"
        if outcome.detected_at is None and self.heard > since + SILENT_S:
            # where it stands nevertheless, that is a turn's change of direction
            return _UNSAFE, "nobody notices, it goes on"
        if latency is None:
            return _UNSAFE, "it goes on"
        if latency <= pair.bound_s * 1000 + 1e-6 or 0 < outcome.moved_m <= pair.bound_m:
            stays = "; the blade turns until its supply is cut" if pair.blade_stays else ""
            return _OK, f"stopped{stays}"
        return "LATE", f"{latency:.0f} ms, {outcome.moved_m:.2f} m"


def has_sensors(scenario: Scenario) -> bool:
    """Whether the firmware has been told of the optional sensors."""
    return SENSORS.keys() <= scenario.told.parameters.keys()


def with_sensors(base: Scenario) -> Scenario:
    """The machine with its optional sensors: a second one at the wheel, and one at the blade."""
    told = base.belief.parameters | SENSORS
    return base.model_copy(
        update={
            "machine": base.machine.model_copy(update={"blade_turn_hz": BLADE_HZ}),
            "belief": base.belief.model_copy(update={"parameters": told}),
        }
    )


def base_scenario(
    situation: Situation,
    firmware: Firmware,
    mode: str,
    camera: str,
    *,
    sensors: bool = False,
    machine: int | None = None,
    owner: Path | None = None,
) -> Scenario:
    """A small field; its first side is long enough, or short so that the turn comes soon.
    `machine`: the seed of one of its own, whose owner's files lie in `owner` or are made there; it
    has its own camera."""
    size = (4.0, 5.0) if situation == "follow" else (4.0, 2.0)
    base = Scenario.model_validate(
        {
            "name": f"fault-{situation}",
            "firmware": firmware,
            "mode": mode,
            "camera": camera,
            "field": FieldSpec(size_m=size).model_dump(),
            "belief": "exact",
            "limits": Limits(time_s=LIMIT_S).model_dump(),
            "record": Recording(pictures_every=1).model_dump(),
        }
    )
    if machine is not None and owner is not None:
        base = own_machine(base, machine, owner)
    return with_sensors(base) if sensors else base


def with_fault(base: Scenario, situation: Situation, name: tuple[str, str, str]) -> Scenario:
    """The scenario with one fault of (component, failure, how), while following or turning."""
    component, failure, how = name
    at = At(state="follow", after_s=SETTLE_S)
    # what a relay does wrong shows when it ought to open: at the end of the side
    if situation == "turn" and component != "blade_relay":
        at = At(doing=Doing.TURN, moving="backward", after_s=0.5)
    values: dict[str, Any] = {"component": component, "failure": failure, "at": at}
    if how:
        values["how"] = how
    if name == ("host", "stuck", ""):
        values["for_s"] = 1.0
    return base.model_copy(update={"faults": (Fault.model_validate(values),)})


def all_faults() -> list[tuple[str, str, str]]:
    """(component, failure, how) of everything in the table."""
    return [
        (component, failure, how)
        for (component, failure), pair in PAIRS.items()
        for how in pair.hows or ("",)
    ]


@dataclass(frozen=True, slots=True)
class Case:
    """One run of the matrix; plain data, so that it travels."""

    name: tuple[str, str, str]
    situation: Situation
    firmware: Firmware
    mode: str
    camera: str
    record: str | None
    """Folder for the records; None: none are kept."""
    sensors: bool = False
    """Whether the optional ones are fitted."""
    machine: int | None = None
    """Seed of one of its own; None: the default one."""
    owner: str = ""
    """Folder of its owner's files."""

    @property
    def record_file(self) -> Path | None:
        """Where its record is kept."""
        if self.record is None:
            return None
        words = "-".join(part for part in (*self.name, self.situation) if part)
        return Path(self.record) / f"{words}.mcap"


def watched(
    chosen: Scenario,
    situation: Situation,
    record: Path | None = None,
    detector: Callable[[Bench], Detector] | None = None,
) -> Verdict:
    """Runs a scenario with one fault to its verdict."""
    fault = chosen.faults[0]
    try:
        run = Harvest(chosen, record, detector=detector)
        try:
            watch = Watch(run)
            run.run(enough=watch.enough)
        finally:
            run.close()
            run.bench.on_slice = None  # else the bench, and all of the run, would live in a circle
    except UserError as error:
        return broken(fault, situation, error)
    return watch.verdict(fault, situation)


def broken(fault: Fault, situation: Situation, error: UserError) -> Verdict:
    """Where the bench itself failed: a result, but no good one."""
    return Verdict(fault.name, situation, "", "", "bench", None, None, 0.0, False, str(error))


Group = tuple[Case, ...]
"""Cases that are the same run up to where their faults begin."""


def scenario_of(case: Case) -> Scenario:
    """What a case runs."""
    base = base_scenario(
        case.situation,
        case.firmware,
        case.mode,
        case.camera,
        sensors=case.sensors,
        machine=case.machine,
        owner=Path(case.owner),
    )
    return with_fault(base, case.situation, case.name)


def grouped(cases: Sequence[Case]) -> list[Group]:
    """The cases in groups, small enough for several workers to share them."""
    alike: dict[str, list[Case]] = {}
    for case in cases:
        chosen = scenario_of(case)
        before = chosen.model_copy(update={"faults": ()}).model_dump_json()
        alike.setdefault(before + chosen.faults[0].at.model_dump_json(), []).append(case)
    return [
        tuple(same[k : k + GROUP]) for same in alike.values() for k in range(0, len(same), GROUP)
    ]


def branched(
    scenarios: Sequence[Scenario],
    situation: Situation,
    detector: Callable[[Bench], Detector] | None = None,
) -> list[Verdict]:
    """The verdicts that `watched` gives, of scenarios that differ in their fault alone and begin
    it alike: what comes before it is run once, and each fault in a copy of the process."""
    # A copy has no threads, so none may be at work: the pictures are developed in this one.
    run = Harvest(scenarios[0], detector=detector, darkroom=SynchronousExecutor())
    try:
        watch = Watch(run)
        run.run(enough=lambda: run.fault_is_next)

        def verdict(faults: tuple[Fault, ...]) -> Verdict:
            run.fail_with(faults)
            try:
                run.run(enough=watch.enough)
            except UserError as error:
                return broken(faults[0], situation, error)
            return watch.verdict(faults[0], situation)

        return [in_a_copy(partial(verdict, chosen.faults)) for chosen in scenarios]
    finally:
        run.close()
        run.bench.on_slice = None


def in_a_copy(function: Callable[[], Result]) -> Result:
    """What `function` returns in a copy of this process, which ends there. A copy that crashes is
    a RuntimeError."""
    end, begin = os.pipe()
    copy = os.fork()
    if copy == 0:
        status = 1
        try:
            with os.fdopen(begin, "wb") as pipe:
                pickle.dump(function(), pipe)
            status = 0
        except Exception:
            traceback.print_exc()
        finally:  # at an interrupt as well: the original says so
            os._exit(status)
    os.close(begin)
    with os.fdopen(end, "rb") as pipe:
        said = pipe.read()
    _, status = os.waitpid(copy, 0)
    if status != 0:
        raise RuntimeError(f"a copy of the bench crashed (wait status {status}), see above")
    result: Result = pickle.loads(said)
    return result


def run_group(group: Group) -> list[Verdict]:
    """Runs a group's cases to their verdicts; each from its beginning where a record is kept."""
    cv2.setNumThreads(1)
    situation = group[0].situation
    if group[0].record is None:
        return branched([scenario_of(case) for case in group], situation)
    return [watched(scenario_of(case), situation, case.record_file) for case in group]
