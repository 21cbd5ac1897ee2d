"""`daranti-hil replay`: a record's inputs through today's pilot, its serial input through today's
firmware, and the first difference of each by name.

The pilot gets the recorded telemetry, fixes and pictures (or, where not every picture was kept,
what vision then made of them). The firmware gets the recorded bytes at their times; it runs on the
bench of the record's scenario, with the same faults at the times when they struck.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from hil.bench.lockstep import Bench
from hil.scenario import scenario as scenarios
from hil.scenario.faults import At
from hil.scenario.scenario import Scenario
from host.core.errors import UserError
from host.core.messages import Command, Fix, Frame, Telemetry, Turned
from host.core.vehicle import Vehicle
from host.link import protocol
from host.pilot.pilot import Pilot
from host.route.plan import Plan
from host.route.side import Side
from host.runs import record
from host.sensors.jpeg import JpegDecoder
from host.vision.mounted.detector import Mode
from host.vision.mounted.paper import PaperParams
from host.vision.view import CropView, Detector
from host.vision.watched import watched_detector

TOLERANCE: Final = 1e-6
"""Of any number; a wall-clock record keeps its times to the nanosecond only."""
NEVER_S: Final = 1e9
"""After every record's end."""
BLANK: Final = np.zeros((2, 2, 3), np.uint8)
"""A picture for a detector that does not look."""


@dataclass(frozen=True, slots=True)
class Difference:
    """Something came out otherwise than it was recorded."""

    stamp: float
    name: str
    recorded: object
    today: object

    def __str__(self) -> str:
        def show(value: object) -> str:
            return f"{value:.6g}" if isinstance(value, float) else str(value)

        return (
            f"at {self.stamp:.3f} s {self.name}: recorded {show(self.recorded)}, "
            f"today {show(self.today)}"
        )


@dataclass(slots=True)
class Outcome:
    """How much was compared, and what differed."""

    commands: int = 0
    views: int = 0
    messages: int = 0
    """Of the firmware."""
    pilot: list[Difference] = field(default_factory=list)
    firmware: list[Difference] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    """What could not be compared, and why."""


class Replayed:
    """A detector that repeats what vision made of the pictures then."""

    def __init__(self) -> None:
        self.next: CropView | None = None

    def see(self, bgr: NDArray[np.uint8], *, stages: bool = False) -> CropView:
        """The recorded view."""
        del bgr, stages
        return self.next or CropView(0.0, reason="no view was recorded")

    def glance(self, bgr: NDArray[np.uint8]) -> CropView:
        """Likewise."""
        return self.see(bgr)

    def next_crop(self, gap_m: float) -> None:
        """The recorded views knew it."""

    def restart(self, *, turned: bool = True) -> None:
        """Nothing is tracked here."""


def _same(a: object, b: object) -> bool:
    if isinstance(a, int | float) and isinstance(b, int | float):
        both_unknown = math.isnan(a) and math.isnan(b)
        return both_unknown or math.isclose(a, b, rel_tol=0, abs_tol=TOLERANCE)
    return a == b


def _compare(stamp: float, kind: str, recorded: object, today: object) -> list[Difference]:
    """Field by field of two dataclasses of one kind."""
    if type(recorded) is not type(today):
        return [Difference(stamp, kind, type(recorded).__name__, type(today).__name__)]
    names: list[str] = list(getattr(recorded, "__dataclass_fields__", {}))
    pairs = ((n, getattr(recorded, n), getattr(today, n)) for n in names)
    return [Difference(stamp, f"{kind}.{n}", a, b) for n, a, b in pairs if not _same(a, b)]


# ---- what the record says about the run ----------------------------------------------------------


@dataclass(frozen=True, slots=True)
class About:
    """What pilot and detector are made from. `scenario` is None for a drive in the field."""

    vehicle: Vehicle
    plan: Plan | None
    mode: Mode
    mount: str
    scenario: Scenario | None
    paper: PaperParams | None = None
    """Colour thresholds, where a drive was given others than the built-in ones."""


def about_of(path: Path) -> About:
    """UserError where the record does not say enough, or what no program of today understands."""
    about = record.about(path)
    try:
        return _about(path, about)
    except (
        ValidationError,
        LookupError,
        TypeError,
        ValueError,
        AttributeError,
        RecursionError,
    ) as error:
        words = _words(error) if isinstance(error, ValidationError) else repr(error)
        raise UserError(
            f"{path}: what the record says of its run is not understood ({words}); it was written "
            "by another version, or is damaged"
        ) from error


def _about(path: Path, about: Mapping[str, str]) -> About:
    if "scenario" in about:
        s = Scenario.model_validate_json(about["scenario"])
        return About(s.vehicle, s.plan(), s.mode, s.camera, s)
    if "vehicle" not in about:
        raise UserError(f"{path}: the record does not say which vehicle it is of; record it anew")
    plan = None
    if "plan" in about:
        data = json.loads(about["plan"])
        corners = tuple((float(x), float(y)) for x, y in data.get("boundary", ()))
        sides = tuple(Side(**side) for side in data["sides"])
        outs = tuple(tuple((x, y) for x, y in ring) for ring in data.get("keep_outs", ()))
        plan = Plan(
            sides,
            data["turn"],
            corners,
            data.get("gap_m"),
            outs,
            done=data.get("done", 0),
            sigma_m=data.get("sigma_m", 0.0),
            recorded=data.get("recorded", False),
            before=tuple(data.get("before", ())),
            way=data.get("way", "onward"),
            otherwise=tuple(data.get("otherwise", ())),
        )
    mode: Mode = "paper" if about.get("mode") == "paper" else "robust"
    vehicle = Vehicle.model_validate_json(about["vehicle"])
    paper = PaperParams.model_validate_json(about["paper"]) if "paper" in about else None
    return About(vehicle, plan, mode, about.get("mount", "mast"), None, paper)


# ---- the pilot -----------------------------------------------------------------------------------


def _all_pictures(path: Path) -> bool:
    count = {"/camera": 0, "/view": 0}
    for topic, _, _ in record.read(path):
        if topic in count:
            count[topic] += 1
    return count["/camera"] >= count["/view"] > 0


class _PilotReplay:
    """Feeds one record to a pilot, as the run did."""

    def __init__(self, about: About, vision: bool, outcome: Outcome) -> None:
        self._about = about
        self._vision = vision
        self._outcome = outcome
        self._frame: Frame | None = None
        self._fix: Fix | None = None
        self._turned: Turned | None = None
        self._telemetry: Telemetry | None = None
        self._view: CropView | None = None
        self._replayed = Replayed()
        self._decoder = JpegDecoder()
        self.restart()

    def restart(self) -> None:
        """The host was started again."""
        about = self._about
        self._telemetry = None
        detector: Detector = self._replayed
        if self._vision:
            mount = about.vehicle.mounts[about.mount]
            if about.scenario is not None:
                mount = about.scenario.mount
            detector = watched_detector(about.mode, about.vehicle, mount, about.paper)
        self._pilot = Pilot(about.vehicle, detector, about.plan)

    def take(self, topic: str, stamp: float, message: record.Message) -> None:
        """The next message of the record."""
        match topic:
            case "/telemetry":
                self._telemetry = record.telemetry_of(stamp, message)
            case "/fix":
                self._fix = record.fix_of(stamp, message)
            case "/turned":
                self._turned = record.turned_of(stamp, message)
            case "/camera" if self._vision:
                self._frame = Frame(stamp, self._decoder.decode(message["data"]))
            case "/view":
                self._view = record.view_of(message)
                if not self._vision:
                    self._frame = Frame(stamp, BLANK)
            case "/fault" if message["fault"] == "host off" and not message["begins"]:
                self.restart()
            case "/operator":
                self._pilot.paused = message["paused"]
            case "/command":
                self._step(stamp, record.command_of(message))

    def _step(self, now: float, recorded: Command) -> None:
        outcome = self._outcome
        self._replayed.next = self._view
        today = self._pilot.step(now, self._frame, self._fix, self._telemetry, self._turned)
        if self._vision and self._view is not None and self._pilot.view is not None:
            outcome.views += 1
            names = record.SCHEMAS["/view"][1]["properties"]
            outcome.pilot += [
                Difference(now, f"view.{name}", a, b)
                for name in names
                for a, b in ((getattr(self._view, name), getattr(self._pilot.view, name)),)
                if not _same(a, b)
            ]
        self._frame = self._fix = self._view = self._turned = None
        outcome.commands += 1
        outcome.pilot += _compare(now, "command", recorded, today)


# ---- the firmware --------------------------------------------------------------------------------


def _decoded(stamped: list[tuple[float, bytes]]) -> list[tuple[float, protocol.Message]]:
    parser = protocol.Parser()
    return [(stamp, m) for stamp, data in stamped for _, m in parser.feed(data)]


def _as_it_struck(scenario: Scenario, begins: Mapping[int, float]) -> Scenario:
    """The scenario with its faults at the times when they began."""
    faults = tuple(
        fault.model_copy(update={"at": At(time_s=begins.get(k, NEVER_S))})
        for k, fault in enumerate(scenario.faults)
    )
    return scenario.model_copy(update={"faults": faults})


def _replay_firmware(path: Path, scenario: Scenario, outcome: Outcome) -> None:
    begins = {
        int(message["index"]): stamp
        for topic, stamp, message in record.read(path)
        if topic == "/fault" and message["begins"]
    }
    recorded: list[tuple[float, bytes]] = []
    today: list[tuple[float, bytes]] = []
    with Bench(_as_it_struck(scenario, begins)) as bench:
        for topic, stamp, message in record.read(path):
            if topic == "/serial/to_host":
                recorded.append((stamp, message["data"]))
            elif topic == "/serial/to_firmware":
                today += bench.advance(stamp)
                bench.send(message["data"])
        if recorded:
            today += bench.advance(recorded[-1][0])
    if b"".join(d for _, d in recorded) == b"".join(d for _, d in today):
        outcome.messages = len(_decoded(recorded))
        return
    ours, theirs = _decoded(today), _decoded(recorded)
    for (stamp, then), (_, now) in zip(theirs, ours, strict=False):
        outcome.messages += 1
        name = type(then).__name__
        outcome.firmware += _compare(stamp, name, then, now)
    if len(ours) != len(theirs):
        end = theirs[-1][0] if theirs else 0.0
        outcome.firmware.append(Difference(end, "messages in all", len(theirs), len(ours)))


def _words(error: ValidationError) -> str:
    """Which fields are wrong, and why."""
    return "; ".join(
        f"{'.'.join(map(str, each['loc'])) or 'the machine'}: "
        + ("no such field" if each["type"] == "extra_forbidden" else each["msg"])
        for each in error.errors()
    )


def replay(
    path: Path,
    *,
    vehicle: Mapping[str, Any] | None = None,
    parameters: Mapping[str, float] | None = None,
    firmware: Literal["desk", "avr"] | None = None,
) -> Outcome:
    """Compares everything. `vehicle` and `parameters` change fields of the vehicle file and
    parameters of the firmware first; `firmware` takes another build than the record's. UserError
    where the record cannot be read or says too little."""
    outcome = Outcome()
    about = about_of(path)
    if vehicle:
        changed = scenarios.merge(about.vehicle.model_dump(mode="json"), dict(vehicle))
        try:
            new = Vehicle.model_validate(changed)
        except ValidationError as error:
            raise UserError(f"--vehicle {_words(error)}") from error
        about = About(new, about.plan, about.mode, about.mount, about.scenario)
    if about.scenario is None and about.plan is None:
        outcome.notes.append("the record holds no plan; the pilot is given none")
    vision = _all_pictures(path)
    if not vision:
        outcome.notes.append("not every picture was kept: vision is not replayed, its views are")
    pilot = _PilotReplay(about, vision, outcome)
    for topic, stamp, message in record.read(path, outcome.notes.append):
        pilot.take(topic, stamp, message)
    if not outcome.commands:
        outcome.notes.append("the record ends before the first command")
    if about.scenario is None:
        outcome.notes.append(
            "no scenario: the firmware's own inputs are unknown, it is not replayed"
        )
        return outcome
    overrides: dict[str, Any] = {"belief": {"parameters": dict(parameters or {})}}
    if firmware is not None:
        overrides["firmware"] = firmware
    _replay_firmware(path, scenarios.changed(about.scenario, overrides), outcome)
    return outcome
