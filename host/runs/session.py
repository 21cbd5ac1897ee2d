"""A whole run: sources opened, plan made, warmed up, driven, reported."""

from __future__ import annotations

import contextlib
import datetime
import json
import sys
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from host.core.errors import UserError
from host.core.messages import Fix, Frame
from host.core.vehicle import Mount, Vehicle
from host.core.vehicle_file import load_vehicle, mount_of
from host.field.boundary_file import Boundary, load_field
from host.link import protocol
from host.link.session import Link
from host.pilot.pilot import Phase, Pilot
from host.runs.drive import Drive, halt
from host.runs.errand import Errand, chosen_corner, corner_at, errand_of, warnings, where_to_go_on
from host.runs.record import Recorder
from host.runs.resume import Keeper, Progress, load
from host.runs.screen import Keyboard, Screen
from host.runs.sources import paper_params, warm_up
from host.sensors.camera_stream import camera_feed
from host.sensors.newest import Feed
from host.sensors.nmea import gnss_feed
from host.vision.mounted.detector import Mode
from host.vision.mounted.paper import PaperParams
from host.vision.tuning.profiles import DATABASE
from host.vision.watched import watched_detector


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """What the operator asks for; see `daranti drive --help`."""

    port: str
    camera: str
    gnss: str | None = None
    vehicle: Path | None = None
    mount: str = "mast"
    mode: Mode = "robust"
    boundary: Path | None = None
    corner: int | None = None
    gap_m: float | None = None
    turn: str = "three_point"
    record: Path | None = None
    resume: Path | None = None
    profiles: Path = DATABASE


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
    field = load_field(order.boundary) if order.boundary is not None else None
    saved = load(order.resume) if order.resume is not None else None
    corner = chosen_corner(field, order.boundary, order.corner, order.gap_m, saved)
    return _Given(vehicle, mount_of(vehicle, order.mount), field, saved, corner)


def harvest(order: Order) -> None:
    """Drives until the field is finished, the operator ends it or a fault does. UserError with the
    reason where it is not finished."""
    given = _read(order)
    begun = time.monotonic()

    def clock() -> float:
        return time.monotonic() - begun

    events: deque[str] = deque(maxlen=200)
    pictures = camera_feed(order.camera, clock, events.append)
    fixes, receiver = gnss_feed(order.gnss, clock, events.append) if order.gnss else (None, None)
    screen = Screen(clock, events, receiver)
    with ExitStack() as stack:
        link = stack.enter_context(Link(order.port, clock))
        version = link.meet()
        screen.say(f"firmware {version.firmware_major}.{version.firmware_minor} on {order.port}")
        for feed in (pictures, fixes):
            if feed is not None:
                stack.callback(feed.close)
                feed.start()
        first = warm_up(pictures, order.camera, given.mount, given.vehicle, order.mode)
        for line in warnings(given.field, order.gap_m):
            screen.say(line)
        errand = _errand(order, given, fixes, screen)
        now = datetime.datetime.now(tz=datetime.UTC)
        path = order.record or Path("out") / f"drive-{now:%Y%m%d-%H%M%S}.mcap"
        params = _paper(order, given, first, screen)
        recorder = stack.enter_context(
            Recorder(path, _about(order, given, errand, params, now.isoformat()))
        )
        _tapped(stack, link, recorder)
        stack.callback(lambda: screen.say(f"record: {path}"))
        detector = watched_detector(order.mode, given.vehicle, given.mount, params)
        run = Drive(
            Pilot(given.vehicle, detector, errand.plan),
            link,
            pictures,
            fixes,
            given.mount,
            given.vehicle,
            clock,
            recorder,
            errand.fence,
            Keyboard(sys.stdin),
            _keeper(order, path, errand, events.append),
        )
        _drive(run, screen, link, clock)


def _errand(order: Order, given: _Given, fixes: Feed[Fix] | None, screen: Screen) -> Errand:
    """The plan, and what the operator has to know of it."""
    start = given.corner
    if start is None and given.field is not None:
        start = corner_at(given.field.crop, fixes)
    errand = errand_of(
        given.field, start, given.vehicle, order.turn, order.gap_m, given.saved, order.resume
    )
    if errand.frame is not None:
        screen.say(f"{len(errand.whole.sides)} sides from corner {start}")
        if given.saved is not None:
            screen.say(where_to_go_on(errand.whole, errand.begun, errand.frame))
    return errand


def _paper(order: Order, given: _Given, first: Frame | None, screen: Screen) -> PaperParams | None:
    """The colour thresholds of the paper's mode."""
    if order.mode != "paper" or first is None:
        return None
    params, said = paper_params(order.profiles, order.mount, first, given.vehicle, given.mount)
    screen.say(said)
    return params


def _about(
    order: Order, given: _Given, errand: Errand, params: PaperParams | None, begun: str
) -> dict[str, str]:
    """What the run depends on, for its record."""
    about = {"begun": begun, "mount": order.mount, "mode": order.mode, "turn": order.turn}
    if params is not None:
        about["paper"] = params.model_dump_json()
    about["vehicle"] = given.vehicle.model_dump_json()
    about["plan"] = json.dumps(asdict(errand.plan))
    return about


def _tapped(stack: ExitStack, link: Link, recorder: Recorder) -> None:
    """Every byte on the wire into the record."""
    link.tap = lambda direction, at, data: recorder.put(f"/serial/{direction}", at, {"data": data})
    stack.callback(setattr, link, "tap", None)


def _keeper(
    order: Order, record: Path, errand: Errand, say: Callable[[str], None]
) -> Keeper | None:
    """Writes the progress beside the record, or on where a run is resumed."""
    if errand.corner is None:
        return None
    progress = order.resume or record.with_suffix(".progress.json")
    progress.parent.mkdir(parents=True, exist_ok=True)
    return Keeper(progress, errand.whole, errand.corner, say, errand.begun)


def _drive(run: Drive, screen: Screen, link: Link, clock: Callable[[], float]) -> None:
    pilot = run.pilot
    try:
        with screen.open():
            run.run(screen.show)
    finally:
        with contextlib.suppress(UserError):
            held = halt(link, clock)
            screen.say("stopped: the firmware confirms" if held else "STOP is not confirmed")
        if run.keeper is not None:
            run.keeper.close(pilot)
            if pilot.phase is not Phase.FINISHED:
                screen.say(f"to go on: the same command with --resume {run.keeper.path}")
        _report(run, screen)
    if pilot.phase is Phase.FAULT:
        raise UserError(f"stopped: {_why(run)}")
    screen.say(f"finished: {pilot.reason}")


def _report(run: Drive, screen: Screen) -> None:
    """How quick the run was."""
    late = 1e3 * np.array(run.latencies_s)
    if late.size:
        screen.say(
            f"shutter to firmware: median {np.median(late):.0f} ms, 99th percentile "
            f"{np.percentile(late, 99):.0f} ms over {late.size} pictures; {run.late} late steps"
        )


def _why(run: Drive) -> str:
    faults = protocol.Fault(run.telemetry.faults if run.telemetry is not None else 0)
    return "; ".join([run.pilot.reason, *protocol.fault_texts(faults)])
