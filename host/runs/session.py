"""A whole run: sources opened, plan made, warmed up, driven, reported."""

from __future__ import annotations

import contextlib
import datetime
import json
import sys
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack, nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from host.core.errors import FaultError, UserError
from host.core.messages import Fix, Frame, State, Turned
from host.core.vehicle import Mount, Vehicle
from host.core.vehicle_file import load_vehicle
from host.field.boundary_file import Boundary, load_field
from host.link import protocol
from host.link.port import check_port
from host.link.session import Link
from host.pilot.phase import Phase
from host.pilot.pilot import Pilot
from host.route.field_plan import told
from host.runs.at_the_start import look, some_fixes
from host.runs.drive import PERIOD_S, Drive, halt
from host.runs.errand import (
    Errand,
    chosen_corner,
    corner_at,
    errand_of,
    going_on,
    intention,
    warnings,
)
from host.runs.first_picture import first_picture, paper_params
from host.runs.operator import COUNTDOWN_S, JOG_WORD, WORD, Operator
from host.runs.preflight import (
    agree,
    length_s,
    mount_problem,
    room_for,
    start_problem,
)
from host.runs.ready import make_ready_visibly
from host.runs.record import Recorder, unused
from host.runs.resume import Keeper, Progress, load
from host.runs.screen import Keyboard, Screen
from host.sensors.camera_stream import Picture, camera_feed
from host.sensors.gyro import gyro_of
from host.sensors.newest import Feed
from host.sensors.nmea import gnss_feed
from host.vision.mounted.detector import Mode
from host.vision.mounted.in_view import seeing_mount
from host.vision.mounted.paper import PaperParams
from host.vision.tuning.profiles import DATABASE
from host.vision.watched import WatchedDetector, watched_detector

CLEARED_S = 0.3
"""A fault whose cause is still there is back by then."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """What the operator asks for; see `daranti drive --help`."""

    port: str
    camera: str
    gnss: str | None = None
    gyro: str | None = None
    """Where the phone's gyroscope is served; None: beside the camera's pictures; "none": nowhere.
    """
    vehicle: Path | None = None
    mount: str = "mast"
    mode: Mode = "robust"
    boundary: Path | None = None
    field: str = ""
    """Which of the boundary's fields."""
    corner: int | None = None
    gap_m: float | None = None
    inset_m: float = 0.0
    """How far inside the boundary the crop begins."""
    turn: str = "three_point"
    record: Path | None = None
    resume: Path | None = None
    profiles: Path = DATABASE
    heading_deg: float | None = None
    """Where the machine heads by the compass."""
    yes: bool = False
    """Start without asking."""
    countdown_s: int = COUNTDOWN_S


@dataclass(frozen=True, slots=True)
class _Given:
    """What the files of an order say."""

    vehicle: Vehicle
    mount: Mount
    field: Boundary | None
    saved: Progress | None
    corner: int | None


def _read(order: Order) -> _Given:
    vehicle = load_vehicle(order.vehicle)
    field = load_field(order.boundary, order.field) if order.boundary is not None else None
    saved = load(order.resume) if order.resume is not None else None
    corner = chosen_corner(field, order.boundary, order.corner, order.gap_m, order.inset_m, saved)
    check_port(order.port)
    return _Given(vehicle, seeing_mount(vehicle, order.mount), field, saved, corner)


@dataclass(frozen=True, slots=True)
class _Machine:
    """What stays the same from one start to the next of one harvest."""

    order: Order
    given: _Given
    link: Link
    pictures: Feed[Picture]
    fixes: Feed[Fix] | None
    turns: Feed[Turned] | None
    screen: Screen
    operator: Operator
    clock: Callable[[], float]
    recorder: Recorder
    colours: PaperParams | None
    say_later: Callable[[str], None]
    """From any thread."""


def harvest(order: Order) -> None:
    """Drives until the field is finished, the operator ends it or a fault does. FaultError with the
    reason where a fault did, UserError where it could not begin."""
    given = _read(order)
    begun = time.monotonic()

    def clock() -> float:
        return time.monotonic() - begun

    events: deque[str] = deque(maxlen=200)
    pictures = camera_feed(order.camera, clock, events.append)
    fixes, receiver = gnss_feed(order.gnss, clock, events.append) if order.gnss else (None, None)
    turns = gyro_of(order.gyro, order.camera, clock, events.append)
    screen = Screen(clock, events, receiver)
    operator = Operator(sys.stdin, screen.say, screen.bell, clock)
    if not (operator.present or order.yes):
        raise UserError("there is no terminal to ask at: give --yes to start without being asked")
    make_ready_visibly()
    with ExitStack() as stack:
        stack.callback(screen.close)
        link = stack.enter_context(Link(order.port, clock))
        version = link.meet()
        screen.say(f"firmware {version.firmware_major}.{version.firmware_minor} on {order.port}")
        agree(link, given.vehicle)
        for feed in (pictures, fixes, turns):
            if feed is not None:
                stack.callback(feed.close)
                feed.start()
        first = first_picture(pictures, order.camera, given.mount)
        errand = _errand(order, given, fixes)
        now = datetime.datetime.now(tz=datetime.UTC)
        path = unused(order.record or Path("out") / f"drive-{now:%Y%m%d-%H%M%S}.mcap")
        if path != order.record and order.record is not None:
            screen.say(f"{order.record} is there already; this record is {path}")
        colours = _paper(order, given, first, screen)
        for line in (
            *warnings(given.field, order.gap_m, order.gnss),
            room_for(path, length_s(errand.plan, given.vehicle)),
        ):
            if line:
                screen.say(f"warning: {line}")
        recorder = stack.enter_context(
            Recorder(path, _about(order, given, errand, colours, now.isoformat()), lost=screen.say)
        )
        _tapped(stack, link, recorder)
        stack.callback(lambda: screen.say(f"record: {path}"))
        machine = _Machine(
            order,
            given,
            link,
            pictures,
            fixes,
            turns,
            screen,
            operator,
            clock,
            recorder,
            colours,
            events.append,
        )
        _until_done(machine, errand)


def _until_done(machine: _Machine, errand: Errand) -> None:
    """Starts, and starts again after each fault that the operator clears."""
    keeper = _keeper(machine, errand)
    while True:
        _begin(machine, errand)
        run = Drive(
            Pilot(machine.given.vehicle, _eye(machine), errand.plan),
            machine.link,
            machine.pictures,
            machine.fixes,
            machine.given.mount,
            machine.given.vehicle,
            machine.clock,
            machine.recorder,
            errand.fence,
            Keyboard(sys.stdin),
            keeper,
            machine.turns,
        )
        _drive(run, machine)
        if run.pilot.phase is not Phase.FAULT:
            machine.screen.say(f"finished: {run.pilot.reason}")
            return
        why = f"stopped: {_why(run)}"
        if not machine.operator.present or machine.order.yes:
            raise FaultError(f"{why}. `daranti clear` clears the fault, --resume goes on")
        machine.screen.say(why)
        _clear(machine, why)
        if keeper is not None:
            saved = load(keeper.path)
            errand = going_on(errand, saved, keeper.path, machine.given.vehicle)
            keeper = _keeper(machine, errand, keeper.path)


def _eye(machine: _Machine) -> WatchedDetector:
    given = machine.given
    return watched_detector(machine.order.mode, given.vehicle, given.mount, machine.colours)


def _begin(machine: _Machine, errand: Errand) -> None:
    """Says what will be done, checks what can be checked, and waits for a deliberate start."""
    order, screen, operator = machine.order, machine.screen, machine.operator
    while True:
        for line in intention(order.boundary, errand, machine.given.vehicle):
            screen.say(line)
        heading = order.heading_deg
        if heading is None and errand.begun != (0, 0.0) and not order.yes:
            heading = _asked_heading(machine)
        problem = _problem(machine, errand, heading)
        if problem:
            if order.yes:
                raise UserError(problem)
            screen.say(f"not yet: {problem}")
        if order.yes:
            break
        words = f"{JOG_WORD}: creep by hand" + ("" if problem else f"; {WORD}: start")
        answer = operator.answer(f"type a word and Enter ({words}; Ctrl-C ends)", machine.link)
        if answer == JOG_WORD:
            operator.jog(machine.link)
        elif answer == WORD and not problem:
            break
    if not operator.countdown(order.countdown_s, machine.link):
        raise UserError("broken off before the start; nothing has moved")


def _asked_heading(machine: _Machine) -> float | None:
    answer = machine.operator.answer(
        "which way does the machine head, by a compass on it (degrees)?", machine.link
    )
    try:
        return float(answer) % 360
    except ValueError:
        return None


def _problem(machine: _Machine, errand: Errand, heading_deg: float | None) -> str:
    """Why it must not start from where it stands, as far as receiver, compass and picture tell."""
    given, wait, clock = machine.given, machine.link.poll, machine.clock
    view, bgr = look(machine.pictures, _eye(machine), given.mount, wait, clock)
    found = None
    if bgr is not None:
        found = mount_problem(bgr, machine.order.mount, given.vehicle)
    if found is None:
        corners = given.field.crop if given.field is not None else ()
        fixes = some_fixes(machine.fixes, wait, clock)
        found = start_problem(errand, corners, fixes, view, heading_deg)
    return "" if found is None else found.text


def _clear(machine: _Machine, why: str) -> None:
    """Guides the operator from a fault to the next start. FaultError where the cause stays, or the
    operator does not want to go on."""
    operator, link = machine.operator, machine.link
    while True:
        answer = operator.answer(
            "look around and remove the cause, then type clear and Enter to go on (end: end)", link
        )
        if answer == "end":
            raise FaultError(why)
        if answer != "clear":
            continue
        telemetry = link.session.telemetry
        if telemetry is not None and telemetry.state is State.FAULT:
            link.ask(protocol.Clear())
        end = machine.clock() + CLEARED_S
        while machine.clock() < end:
            link.poll(PERIOD_S)
        telemetry = link.session.telemetry
        if telemetry is not None and telemetry.state is not State.FAULT:
            machine.screen.say("cleared")
            return
        faults = protocol.Fault(telemetry.faults if telemetry is not None else 0)
        machine.screen.say(f"still there: {'; '.join(protocol.fault_texts(faults))}")


def _errand(order: Order, given: _Given, fixes: Feed[Fix] | None) -> Errand:
    """What is to be driven."""
    start = given.corner
    if start is None and given.field is not None:
        start = corner_at(given.field.crop, fixes)
    long = told(f"plan of {order.boundary}") if given.field is not None else nullcontext()
    with long as tell:
        return errand_of(
            given.field,
            start,
            given.vehicle,
            order.turn,
            order.gap_m,
            given.saved,
            order.resume,
            order.inset_m,
            tell,
        )


def _paper(order: Order, given: _Given, first: Frame | None, screen: Screen) -> PaperParams | None:
    """The colour thresholds of the paper's mode."""
    if order.mode != "paper" or first is None:
        return None
    found, said = paper_params(order.profiles, order.mount, first, given.vehicle, given.mount)
    screen.say(said)
    return found


def _about(
    order: Order, given: _Given, errand: Errand, colours: PaperParams | None, begun: str
) -> dict[str, str]:
    """What the run depends on, for its record."""
    about = {"begun": begun, "mount": order.mount, "mode": order.mode, "turn": order.turn}
    if colours is not None:
        about["paper"] = colours.model_dump_json()
    about["vehicle"] = given.vehicle.model_dump_json()
    about["plan"] = json.dumps(asdict(errand.plan))
    return about


def _tapped(stack: ExitStack, link: Link, recorder: Recorder) -> None:
    """Every byte on the wire into the record."""
    link.tap = lambda direction, at, data: recorder.put(f"/serial/{direction}", at, {"data": data})
    stack.callback(setattr, link, "tap", None)


def _keeper(machine: _Machine, errand: Errand, path: Path | None = None) -> Keeper | None:
    """Writes the progress beside the record, or on where a run is resumed."""
    if errand.corner is None:
        return None
    progress = path or machine.order.resume
    progress = progress or machine.recorder.path.with_suffix(".progress.json")
    progress.parent.mkdir(parents=True, exist_ok=True)
    return Keeper(progress, errand.entered, errand.corner, machine.say_later, errand.begun)


def _drive(run: Drive, machine: _Machine) -> None:
    """One start, until the pilot is done. FaultError where a device was lost."""
    pilot, screen, held = run.pilot, machine.screen, False
    try:
        with screen.open():
            try:
                run.run(screen.show)
            finally:
                with contextlib.suppress(UserError):
                    held = halt(machine.link, machine.clock)
                run.stopped()
                screen.last(run)
    except UserError as error:
        raise FaultError(str(error)) from error
    finally:  # after Ctrl-C, too: whoever stands beside it has to know
        screen.say(
            "stopped: the firmware confirms"
            if held
            else "STOP is not confirmed: press the emergency stop"
        )
        if run.keeper is not None:
            run.keeper.close(pilot)
            if pilot.phase is not Phase.FINISHED:
                screen.say(run.keeper.to_go_on)
        _report(run, screen)


def _report(run: Drive, screen: Screen) -> None:
    """What was believed wrong, and how quick the run was."""
    if run.pilot.believed_wrong:
        screen.say(run.pilot.believed_wrong)
    late = 1e3 * np.array(run.latencies_s)
    if late.size:
        screen.say(
            f"shutter to firmware: median {np.median(late):.0f} ms, 99th percentile "
            f"{np.percentile(late, 99):.0f} ms over {late.size} pictures; {run.late} late steps"
        )


def _why(run: Drive) -> str:
    faults = protocol.Fault(run.telemetry.faults if run.telemetry is not None else 0)
    return "; ".join([run.pilot.reason, *protocol.fault_texts(faults)])
