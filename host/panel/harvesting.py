"""A harvest from the panel: the same loop as `daranti drive`, its operator a page."""

from __future__ import annotations

import contextlib
import datetime
import json
import math
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field

from host.core.errors import UserError
from host.core.frames import LatLon
from host.core.strict import Strict
from host.field.boundary_file import load_field
from host.link import protocol
from host.panel import snapshot
from host.panel.machine import (
    PANEL_LOST_S,
    Machine,
    NotYetError,
    StoppedError,
)
from host.panel.snapshot import Json, number
from host.pilot.phase import Phase
from host.pilot.pilot import Pilot
from host.route.plan import Plan
from host.runs.at_the_start import look, some_fixes
from host.runs.drive import Drive
from host.runs.errand import Errand, errand_of
from host.runs.first_picture import FIRST_PICTURE_S, fitting
from host.runs.preflight import (
    Problem,
    agree,
    length_s,
    mount_problem,
    room_for,
    start_problem,
)
from host.runs.record import Recorder
from host.runs.resume import Keeper, load
from host.vision.watched import watched_detector

SLOW_STEP_S: Final = 0.05
"""A step that takes its whole period counts as slow."""
TRAIL_M: Final = 0.2
"""Between points of the trail on the map."""
MOST_PLACES: Final = 1000
"""Of the trail in one message: more would take a step too long."""


class Order(Strict):
    """Which field, from where. The paths were made by the panel."""

    boundary: Path
    gap_m: float | None = None
    inset_m: float = 0.0
    corner: int = 0
    turn: Literal["three_point", "arc"] = "three_point"
    resume: Path | None = None
    heading_deg: Annotated[float, Field(ge=0, le=360)] | None = None
    """Where the machine heads by a compass on it."""


@dataclass
class Operator:
    """Pause and its reason: pressed on the page, or the page is gone."""

    machine: Machine
    errand: Errand
    paused: bool = False
    why: str = ""
    slow_steps: int = 0
    steps: int = 0
    longest_ms: float = 0.0
    trail: list[list[float]] = field(default_factory=list)
    """Places of the blade's middle where it cut."""
    told: int = 0
    """How many of them the pages have."""
    met: int = 0
    """Which panel has them."""
    shown: Plan | None = None
    """What the pages have."""
    cut_from: tuple[float, float] = (math.nan, math.nan)

    def show_plan(self, plan: Plan) -> None:
        """The map's still part with what earlier runs have cut, and again when it has been laid
        out anew."""
        frame = self.errand.frame
        about = {
            "anew": self.shown is not None,
            "origin": frame and list(frame.origin),
            "cut": snapshot.of_cut(self.errand.whole, self.errand.begun),
        }
        self.machine.post({"kind": "plan", **snapshot.of_plan(plan), **about})
        self.shown = plan

    def show_map(self, plan: Plan) -> None:
        """What is new on the map; all of it to a panel that has come anew."""
        new_panel = self.machine.meetings != self.met
        if new_panel:
            self.met, self.told = self.machine.meetings, 0
        if new_panel or plan is not self.shown:
            self.show_plan(plan)
        places = self.trail[self.told : self.told + MOST_PLACES]
        self.told += len(places)
        if places:
            self.machine.post({"kind": "trail", "places": places, "all": new_panel})

    def wants_pause(self) -> bool:
        """Asked before every step of the loop."""
        machine = self.machine
        if machine.deserted and not self.paused:
            self.paused, self.why = True, "away"
        if machine.panel_away_s > PANEL_LOST_S:
            raise UserError("no panel for two minutes: the run has ended, its progress is saved")
        while machine.wishes:
            match machine.wishes.popleft().get("do"):
                case "pause":
                    self.paused, self.why = True, "asked"
                case "go_on" if not machine.deserted:
                    self.paused, self.why = False, ""
                case _:
                    pass
        return self.paused

    def after_step(self, run: Drive) -> None:
        """Called after every step of the loop: the pages, and how long the step took."""
        self.steps += 1
        self.slow_steps += run.step_s > SLOW_STEP_S
        self.longest_ms = max(self.longest_ms, run.step_s * 1e3)
        run.step_s = 0.0
        pilot = run.pilot
        if pilot.position.known and run.command.blade:
            x, y, yaw = pilot.position.pose
            if not math.hypot(x - self.cut_from[0], y - self.cut_from[1]) < TRAIL_M:
                self.cut_from = (x, y)
                self.trail.append([round(x, 2), round(y, 2), round(yaw, 3)])
        self.machine.serve()


def prepare(machine: Machine, order: Order) -> Errand:
    """What is to be driven, once place, direction and pictures fit. Raises NotYetError where the
    machine stands wrong, UserError where something is missing."""
    if machine.camera is None or machine.gnss is None or machine.link is None:
        raise UserError("a harvest needs a board, a camera and a receiver")
    boundary = load_field(order.boundary)
    saved = load(order.resume) if order.resume is not None else None
    errand = errand_of(
        boundary,
        order.corner,
        machine.vehicle,
        order.turn,
        order.gap_m,
        saved,
        order.resume,
        order.inset_m,
    )
    room = room_for(machine.settings.folder / "record", length_s(errand.plan, machine.vehicle))
    if room:
        machine.events.append(room)
    agree(machine.link, machine.vehicle)
    problem = _problem(machine, errand, boundary.crop, order.heading_deg)
    if problem is not None:
        raise NotYetError(problem)
    see_first(machine)
    machine.pump(0.2)  # what the page said meanwhile: that it is there, or STOP
    return errand


def _problem(
    machine: Machine, errand: Errand, corners: Sequence[LatLon], heading_deg: float | None
) -> Problem | None:
    assert machine.camera is not None
    eye = watched_detector(machine.settings.mode, machine.vehicle, machine.mount, None)
    view, bgr = look(machine.camera, eye, machine.mount, machine.pump, machine.clock)
    found = None
    if bgr is not None:
        found = mount_problem(bgr, machine.settings.mount, machine.vehicle)
    if found is None:
        fixes = some_fixes(machine.gnss, machine.pump, machine.clock)
        found = start_problem(errand, corners, fixes, view, heading_deg)
    return found


def harvest(machine: Machine, order: Order, errand: Errand) -> None:
    """Runs to the field's end. Raises StoppedError or UserError where something ends it before."""
    camera, gnss, link = machine.camera, machine.gnss, machine.link
    vehicle, mount, clock = machine.vehicle, machine.mount, machine.clock
    if camera is None or link is None:
        raise UserError("a harvest needs a board, a camera and a receiver")
    plan = errand.plan
    folder = machine.settings.folder
    now = datetime.datetime.now(tz=datetime.UTC)
    path = folder / f"drive-{now:%Y%m%d-%H%M%S}.mcap"
    detector = watched_detector(machine.settings.mode, vehicle, mount, None)
    pilot = Pilot(vehicle, detector, plan)
    operator = Operator(machine, errand)
    progress = order.resume or path.with_suffix(".progress.json")
    ended: Json = {}
    with ExitStack() as stack:
        # Done last: where to go on is read from the progress, which is kept by then.
        stack.callback(_tell, machine, ended, path, progress)
        keeper = Keeper(progress, errand.entered, order.corner, machine.events.append, errand.begun)
        stack.callback(keeper.close, pilot)
        recorder = stack.enter_context(record(machine, path, order, plan, now.isoformat()))
        link.tap = lambda direction, at, data: recorder.put(
            f"/serial/{direction}", at, {"data": data}
        )
        stack.callback(setattr, link, "tap", None)
        run = Drive(
            pilot,
            link,
            camera,
            gnss,
            mount,
            vehicle,
            clock,
            recorder,
            errand.fence,
            operator.wants_pause,
            keeper,
            machine.gyro,
        )
        operator.show_map(plan)
        machine.mode = "drive"
        machine.more = lambda: _about(run, operator)
        outcome, why = "stopped", ""
        try:
            run.run(operator.after_step)
            outcome = "finished" if pilot.phase is Phase.FINISHED else "fault"
        except StoppedError:
            raise
        except UserError as error:
            outcome, why = "fault", str(error)
            raise
        finally:
            ended |= _summary(run, operator, outcome, path)
            if why:  # it was not the pilot that ended it
                ended |= {"reason": why, "code": "", "words": {}}


def _tell(machine: Machine, ended: Json, path: Path, progress: Path) -> None:
    """How a run ended, to the pages and into its folder."""
    if not ended:
        return
    left = ended["outcome"] != "finished" and progress.exists()
    ended["resume"] = str(progress) if left else None
    machine.post({"kind": "ended", **ended})
    with contextlib.suppress(OSError):
        path.with_suffix(".run.json").write_text(json.dumps(ended), encoding="utf-8")


def record(machine: Machine, path: Path, order: Order, plan: Plan, begun: str) -> Recorder:
    """The run's record. A disk that is full ends it and not the run; the pages are told."""
    about = {"begun": begun, "mount": machine.settings.mount}
    about |= {"mode": machine.settings.mode, "turn": order.turn}
    about |= {"vehicle": machine.vehicle.model_dump_json(), "plan": json.dumps(asdict(plan))}

    def lost(why: str) -> None:
        machine.events.append(why)
        machine.post({"kind": "failed", "what": "record", "why": why})

    return Recorder(path, about, lost=lost)


def see_first(machine: Machine) -> None:
    """UserError where the camera sends no picture, or none of the mount's size."""
    camera = machine.camera
    assert camera is not None
    camera.take()
    deadline = machine.clock() + FIRST_PICTURE_S
    while (picture := camera.take()) is None or fitting(picture, machine.mount) is None:
        machine.pump(0.05)
        if machine.clock() > deadline:
            raise UserError(f"no picture from the camera: {camera.problem}")


def _about(run: Drive, operator: Operator) -> Json:
    plan = run.pilot.plan
    operator.show_map(plan)
    return {
        "paused": operator.paused,
        "paused_why": operator.why,
        "pilot": snapshot.of_pilot(run.pilot, plan, operator.machine.vehicle.cutting_speed_mps),
        "command": {"blade": run.command.blade, "speed_mps": number(run.command.speed_mps, 2)},
        "pictures": {
            "count": run.pictures,
            "bad": run.pictures_bad,
            "repeated": run.pictures_repeated,
        },
        "steps": {
            "count": operator.steps,
            "slow": operator.slow_steps,
            "late": run.late,
            "longest_ms": number(operator.longest_ms, 1),
        },
    }


def _summary(run: Drive, operator: Operator, outcome: str, path: Path) -> dict[str, Any]:
    pilot, last = run.pilot, run.telemetry
    faults = protocol.Fault(last.faults if last is not None else 0)
    return {
        "outcome": outcome,
        "reason": pilot.reason,
        **snapshot.of_reason(pilot),
        "believed_wrong": pilot.believed_wrong,
        "phase": pilot.phase.value,
        "faults": [bit.name for bit in protocol.Fault if bit in faults],
        "record": str(path),
        "turns": pilot.turns,
        "steps": operator.steps,
        "slow_steps": operator.slow_steps,
        "late_steps": run.late,
        "longest_ms": number(operator.longest_ms, 1),
        "pictures": run.pictures,
        "seconds": number(operator.steps * 0.05, 0),
    }
