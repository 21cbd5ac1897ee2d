"""`daranti drive`: the pilot in wall-clock time, between real devices.

`Drive` is the loop: every 50 ms it gives the pilot what is newest and sends what it decides.
Whatever ends it, an exception included, the last thing sent is STOP; should even that be
impossible, the firmware's own watchdog stops the machine 250 ms after the last command.
"""

from __future__ import annotations

import contextlib
import datetime
import json
import math
import os
import select
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TextIO

import click
import cv2
import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from host.commands.cli import port_option
from host.core.errors import UserError
from host.core.messages import Command, Fix, Frame, Request, State, Telemetry
from host.core.vehicle import Mount, Vehicle
from host.core.vehicle_file import load_vehicle, mount_of
from host.field.areas import areas_of
from host.field.boundary_file import Boundary, LatLon, load_field
from host.link import protocol
from host.link.session import Link
from host.pilot.pilot import PAUSED, Phase, Pilot
from host.route.boundary import Fence, nearest_corner, plan_of
from host.route.plan import Plan
from host.runs.record import Recorder
from host.runs.resume import Keeper, Progress, load, remaining, resume_at
from host.sensors.camera_stream import Picture, camera_feed
from host.sensors.jpeg import JpegDecoder
from host.sensors.newest import Feed
from host.sensors.nmea import LocalFrame, Receiver, gnss_feed
from host.sensors.picture_watch import WatchedDetector
from host.vision import make_detector
from host.vision.mounted.detector import Mode, MountedDetector
from host.vision.mounted.paper import PaperParams
from host.vision.tuning.profiles import DATABASE, Circumstance
from host.vision.tuning.search import first_params

PERIOD_S = 0.05
SHOW_S = 0.2
TELEMETRY_TIMEOUT_S = 1.0
HALT_S = 0.5
AT_REST = (State.SAFE, State.FAULT)
FIRST_PICTURE_S = 10.0
FIRST_FIX_S = 10.0
FIRST_FIXES = 10


def fitted(picture: Picture, decoder: JpegDecoder, mount: Mount, delay_s: float) -> Frame:
    """The picture in the mount's size, stamped with its shutter's time. One of other proportions,
    or without pixels, stays as it is, for the picture watch to refuse."""
    frame = picture.frame(decoder)
    height, width = frame.bgr.shape[:2]
    bgr = frame.bgr
    size = (mount.width_px, mount.height_px)
    if bgr.size and (width, height) != size and width * mount.height_px == height * mount.width_px:
        bgr = cv2.resize(bgr, size, interpolation=cv2.INTER_AREA).astype("uint8", copy=False)
    return Frame(picture.stamp - delay_s, bgr)


def fits(frame: Frame, mount: Mount) -> bool:
    """Whether a frame has the mount's size."""
    return frame.bgr.shape[:2] == (mount.height_px, mount.width_px)


def halt(link: Link, clock: Callable[[], float], timeout_s: float = HALT_S) -> bool:
    """Sends STOP every 50 ms until the firmware says that it holds still; False when it has not in
    time."""
    deadline = clock() + timeout_s
    while clock() < deadline:
        link.send(Command(Request.STOP, reason="the run ends"))
        again = clock() + PERIOD_S
        while (left := again - clock()) > 0:
            if any(telemetry.state in AT_REST for telemetry in link.poll(left)):
                return True
    return False


class Drive:
    """One run. The devices are handed in and stay their owner's; nothing here is global."""

    def __init__(
        self,
        pilot: Pilot,
        link: Link,
        camera: Feed[Picture],
        gnss: Feed[Fix] | None,
        mount: Mount,
        vehicle: Vehicle,
        clock: Callable[[], float],
        recorder: Recorder | None = None,
        fence: Fence | None = None,
        paused: Callable[[], bool] | None = None,
        keeper: Keeper | None = None,
    ) -> None:
        """`paused`: whether the operator wants the machine to stand still."""
        self.pilot = pilot
        self.link = link
        self.camera = camera
        self.gnss = gnss
        self.command = Command(Request.STOP, reason="not started")
        self.fix: Fix | None = None
        self._decoder = JpegDecoder()
        self.pictures = 0
        self.pictures_bad = 0
        self.pictures_repeated = 0
        self.late = 0
        """Steps that could not begin in time."""
        self.latencies_s: list[float] = []
        """From a picture's shutter to the telemetry that names the command made from it."""
        self._asked: tuple[int, float] | None = None
        """(sequence number, shutter) of the command that is on its way."""
        self.step_s = 0.0
        """How long the longest step since the last look took; the looker sets it back."""
        self._jpeg: bytes | None = None
        self._mount = mount
        self._delay_s = vehicle.camera_delay_s
        self._clock = clock
        self._recorder = recorder
        self._fence = fence
        self._paused = paused
        self._keeper = keeper

    @property
    def telemetry(self) -> Telemetry | None:
        """The latest."""
        return self.link.session.telemetry

    def run(self, show: Callable[[Drive], None]) -> None:
        """Until the pilot is done. `show` is called after every step. Raises UserError when a
        device is lost for good."""
        begun = self._clock()
        resets = self.link.session.resets
        due = begun
        while not self.pilot.done:
            due += PERIOD_S
            self._listen(due)
            now = self._clock()
            if now > due + PERIOD_S:  # what was missed is not caught up
                self.late += 1
                due = now
            telemetry = self.telemetry
            heard = telemetry.stamp if telemetry is not None else begun
            if now - max(heard, begun) > TELEMETRY_TIMEOUT_S:
                raise UserError(
                    f"{self.link.port}: no telemetry for {TELEMETRY_TIMEOUT_S:g} s; the firmware "
                    "hangs or the cable is broken. Reset the board and start again"
                )
            if telemetry is not None and self.link.session.resets != resets:
                texts = protocol.fault_texts(protocol.Fault(telemetry.faults))
                raise UserError(
                    f"{self.link.port}: the firmware restarted in the middle of the run; its "
                    f"outputs are off. {'; '.join(texts) or 'Check the 5 V supply'}"
                )
            self._step(now)
            self.step_s = max(self.step_s, self._clock() - now)
            show(self)

    def _listen(self, until: float) -> None:
        """Takes telemetry as it comes, at least what is there."""
        while True:
            left = until - self._clock()
            for telemetry in self.link.poll(max(0.0, left)):
                if self._asked is not None and telemetry.last_seq == self._asked[0]:
                    self.latencies_s.append(telemetry.stamp - self._asked[1])
                    self._asked = None
                if self._recorder is not None:
                    self._recorder.telemetry(telemetry)
            if left <= 0:
                return

    def _step(self, now: float) -> None:
        picture = self._new_picture()
        frame = None
        if picture is not None:
            frame = fitted(picture, self._decoder, self._mount, self._delay_s)
            self.pictures += 1
            self.pictures_bad += not fits(frame, self._mount)
        fix = self.gnss.take() if self.gnss is not None else None
        if fix is not None:
            self.fix = fix
            beyond = self._fence.breach(fix) if self._fence is not None else None
            if beyond is not None:
                raise UserError(
                    f"stopped: the positions lie {beyond:.0f} m outside the boundary; look at the "
                    "machine, then check the boundary file and the receiver"
                )
        paused = self._paused is not None and self._paused()
        if paused is not self.pilot.paused:
            self.pilot.paused = paused
            if self._recorder is not None:
                self._recorder.put("/operator", now, {"paused": paused})
        self.command = self.pilot.step(now, frame, fix, self.telemetry)
        seq = self.link.session.next_seq
        self.link.send(self.command)
        if frame is not None:
            self._asked = (seq, frame.stamp)
        if self._keeper is not None:
            self._keeper.note(self.pilot)
        if self._recorder is not None:
            self._write(self._recorder, now, picture, frame, fix)

    def _new_picture(self) -> Picture | None:
        """The camera's newest, unless it is byte for byte the one before: a phone that is back, or
        whose camera hangs, sends what it had, and that is no view of now."""
        picture = self.camera.take()
        if picture is None or picture.jpeg is None:
            return picture
        repeated = picture.jpeg == self._jpeg
        self._jpeg = picture.jpeg
        self.pictures_repeated += repeated
        return None if repeated else picture

    def _write(
        self,
        recorder: Recorder,
        now: float,
        picture: Picture | None,
        frame: Frame | None,
        fix: Fix | None,
    ) -> None:
        if picture is not None and frame is not None:
            jpeg = picture.jpeg or cv2.imencode(".jpg", frame.bgr)[1].tobytes()
            recorder.picture(frame.stamp, jpeg)
            if self.pilot.view is not None:
                recorder.view(frame.stamp, self.pilot.view)
            recorder.pilot(now, self.pilot)
        if fix is not None:
            recorder.fix(fix)
        recorder.command(now, self.command)


# ---- what the operator sees ----------------------------------------------------------------------

_STYLES = {Phase.FOLLOW: "bold green", Phase.FINISHED: "bold green", Phase.FAULT: "bold red"}


def status(drive: Drive, receiver: Receiver | None) -> Table:
    """The run at a glance."""
    pilot, view, telemetry = drive.pilot, drive.pilot.view, drive.telemetry
    table = Table.grid(padding=(0, 2))
    reason = f"{PAUSED}; Enter goes on" if pilot.paused else pilot.reason
    table.add_row("pilot", Text(pilot.phase.value, _STYLES.get(pilot.phase, "bold")), reason)
    if view is not None:
        table.add_row(
            "edge",
            f"{view.edge_offset_m:+.2f} m",
            f"confidence {view.confidence:.2f} {view.reason}".rstrip(),
        )
    command = drive.command
    table.add_row(
        "command",
        command.request.value,
        f"{command.speed_mps:+.2f} m/s, steer {_degrees(command.steer_rad)}, blade "
        f"{'on' if command.blade else 'off'}",
    )
    if telemetry is not None:
        table.add_row(
            "machine",
            Text(telemetry.state.name, "bold red" if telemetry.state is State.FAULT else ""),
            f"steer {_degrees(telemetry.angle_rad)}, battery {telemetry.battery_v:.1f} V"
            + (f", {drive.link.session.refusal}" if drive.link.session.refusal else ""),
        )
        for text in protocol.fault_texts(protocol.Fault(telemetry.faults)):
            table.add_row("fault", "", Text(text, "red"))
    table.add_row(
        "camera",
        drive.camera.problem or "ok",
        f"{drive.pictures} pictures, {drive.pictures_bad} bad, "
        f"{drive.pictures_repeated} repeated; longest step "
        f"{drive.step_s * 1e3:.0f} ms, {drive.late} late",
    )
    if drive.gnss is not None and receiver is not None:
        fix = drive.fix
        where = f"{fix.lat_deg:.6f} {fix.lon_deg:.6f}, quality {fix.quality}" if fix else "no fix"
        bad = sum(receiver.bad.values())
        table.add_row("GNSS", drive.gnss.problem or "ok", f"{where}; {bad} bad sentences")
    return table


def _degrees(rad: float) -> str:
    return f"{rad * 57.29578:+.1f}°"


class Keyboard:
    """Enter pauses, Enter again goes on. Without a terminal nothing ever does."""

    def __init__(self, terminal: TextIO) -> None:
        self._file = terminal.fileno() if terminal.isatty() else None
        self._paused = False

    def __call__(self) -> bool:
        """Whether the machine is to stand still; returns at once."""
        while self._file is not None and select.select([self._file], [], [], 0)[0]:
            try:
                line = os.read(self._file, 4096)
            except OSError:  # the terminal is gone; its hang-up ends the run
                self._file = None
                break
            if not line:
                break
            self._paused ^= line.endswith(b"\n")
        return self._paused


class Screen:
    """Live status on a terminal; elsewhere one line at each change of what the pilot does."""

    def __init__(
        self, clock: Callable[[], float], events: deque[str], receiver: Receiver | None
    ) -> None:
        """`events`: lines from other threads, to be shown at the next step."""
        self._events = events
        self._console = Console(highlight=False)
        self._clock = clock
        self._receiver = receiver
        self._live: Live | None = None
        self._shown = -SHOW_S
        self._last = ""

    @contextmanager
    def open(self) -> Iterator[None]:
        """Shows until left."""
        if not self._console.is_terminal:
            yield
            return
        with Live(console=self._console, auto_refresh=False) as self._live:
            yield
        self._live = None

    def say(self, line: str) -> None:
        """One line that stays."""
        self._console.print(f"{self._clock():7.1f} s  {line}", soft_wrap=True)

    def show(self, drive: Drive) -> None:
        """Called at every step; draws five times a second."""
        now = self._clock()
        while self._events:
            self.say(self._events.popleft())
        reason = PAUSED if drive.pilot.paused else drive.pilot.reason
        line = f"{drive.pilot.phase.value}: {reason}"
        if line != self._last:
            self._last = line
            self.say(line)
        if self._live is not None and now - self._shown >= SHOW_S:
            self._shown = now
            self._live.update(Group(status(drive, self._receiver)), refresh=True)
            drive.step_s = 0.0


# ---- the command ---------------------------------------------------------------------------------


@click.command()
@port_option
@click.option("--camera", required=True, metavar="URL", help="http://..., video file, /dev/videoN.")
@click.option("--gnss", metavar="URL", help="tcp://HOST:PORT, serial port or NMEA file.")
@click.option("--vehicle", type=click.Path(path_type=Path), help="The machine's file.")
@click.option("--mount", default="mast", show_default=True, help="Which of its camera mounts.")
@click.option("--mode", type=click.Choice(["paper", "robust"]), default="robust", show_default=True)
@click.option(
    "--boundary",
    type=click.Path(path_type=Path),
    help="The crop's corners: GeoJSON, KML, Shapefile, ISOXML or latitude,longitude lines.",
)
@click.option("--corner", type=click.IntRange(0), help="Where it stands; default the nearest.")
@click.option("--gap", type=float, metavar="METRES", help="To the neighbour's crop: the geofence.")
@click.option(
    "--turn", type=click.Choice(["three_point", "arc"]), default="three_point", show_default=True
)
@click.option(
    "--record", type=click.Path(path_type=Path), help="The record's file; default out/drive-*.mcap."
)
@click.option(
    "--resume",
    type=click.Path(path_type=Path),
    help="Go on where the run that left this .progress.json ended.",
)
@click.option(
    "--db",
    "profiles",
    type=click.Path(path_type=Path),
    default=DATABASE,
    show_default=True,
    help="Tuned colour thresholds for --mode paper: `daranti tune vision`.",
)
def drive(
    port: str,
    camera: str,
    gnss: str | None,
    vehicle: Path | None,
    mount: str,
    mode: Mode,
    boundary: Path | None,
    corner: int | None,
    gap: float | None,
    turn: str,
    record: Path | None,
    resume: Path | None,
    profiles: Path,
) -> None:
    """Harvest: follow the crop's edge, turn at its end, go inward, until nothing stands.

    Put the machine at a corner, the crop to its left, the blade's right end on the crop's edge.
    Enter pauses and goes on, Ctrl-C stops at once. Exits with 0 when the field is finished."""
    machine = load_vehicle(vehicle)
    where = mount_of(machine, mount)
    field = load_field(boundary) if boundary is not None else None
    saved = load(resume) if resume is not None else None
    corner = _chosen_corner(field, boundary, corner, gap, saved)
    begun = time.monotonic()

    def clock() -> float:
        return time.monotonic() - begun

    events: deque[str] = deque(maxlen=200)
    pictures = camera_feed(camera, clock, events.append)
    fixes, receiver = gnss_feed(gnss, clock, events.append) if gnss else (None, None)
    screen = Screen(clock, events, receiver)
    with ExitStack() as stack:
        link = stack.enter_context(Link(port, clock))
        version = link.meet()
        screen.say(f"firmware {version.firmware_major}.{version.firmware_minor} on {port}")
        for feed in (pictures, fixes):
            if feed is not None:
                stack.callback(feed.close)
                feed.start()
        first = _warm_up(pictures, camera, where, machine, mode)
        now = datetime.datetime.now(tz=datetime.UTC)
        path = record or Path("out") / f"drive-{now:%Y%m%d-%H%M%S}.mcap"
        plan, fence, keeper = Plan(turn=turn), None, None
        for line in _warnings(field, gap):
            screen.say(line)
        if field is not None:
            start = corner if corner is not None else _corner(field.crop, fixes)
            frame, whole = plan_of(field, start, machine, turn, gap)
            begun_at = (0, 0.0)
            screen.say(f"{len(whole.sides)} sides from corner {start}")
            if saved is not None and resume is not None:
                begun_at = resume_at(saved, whole, resume)
                screen.say(_where_to_go_on(whole, begun_at, frame))
            plan = remaining(whole, *begun_at)
            fence = Fence(field.crop)
            progress = resume or path.with_suffix(".progress.json")
            progress.parent.mkdir(parents=True, exist_ok=True)
            keeper = Keeper(progress, whole, start, events.append, begun_at)
        about = {"begun": now.isoformat(), "mount": mount, "mode": mode, "turn": turn}
        params = None
        if mode == "paper" and first is not None:
            params, said = _paper_params(profiles, mount, first, machine, where)
            about["paper"] = params.model_dump_json()
            screen.say(said)
        about["vehicle"] = machine.model_dump_json()
        about["plan"] = json.dumps(asdict(plan))
        recorder = stack.enter_context(Recorder(path, about))
        link.tap = lambda direction, at, data: recorder.put(
            f"/serial/{direction}", at, {"data": data}
        )
        stack.callback(setattr, link, "tap", None)
        stack.callback(lambda: screen.say(f"record: {path}"))
        overlap = machine.overlap_m
        detector = make_detector(mode, machine, where, overlap_m=overlap, params=params)
        pilot = Pilot(machine, WatchedDetector(detector, where), plan)
        keyboard = Keyboard(sys.stdin)
        run = Drive(
            pilot, link, pictures, fixes, where, machine, clock, recorder, fence, keyboard, keeper
        )
        try:
            with screen.open():
                run.run(screen.show)
        finally:
            with contextlib.suppress(UserError):
                held = halt(link, clock)
                screen.say("stopped: the firmware confirms" if held else "STOP is not confirmed")
            if keeper is not None:
                keeper.close(pilot)
                if pilot.phase is not Phase.FINISHED:
                    screen.say(f"to go on: the same command with --resume {keeper.path}")
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


def _chosen_corner(
    field: Boundary | None,
    path: Path | None,
    corner: int | None,
    gap: float | None,
    saved: Progress | None,
) -> int | None:
    """The corner that the plan begins at, None where the position has to tell. UserError where the
    options do not fit the boundary or each other."""
    for given, name, what in (
        (corner, "--corner", "names a corner"),
        (gap, "--gap", "is measured from the edge"),
        (saved, "--resume", "goes on with the plan"),
    ):
        if given is not None and field is None:
            raise UserError(f"{name} {what} of --boundary, which is not given")
    if field is None:
        return None
    if corner is not None and corner >= len(field.crop):
        raise UserError(f"--corner {corner}: {path} has the corners 0 to {len(field.crop) - 1}")
    areas_of(field.polygon(field.frame), gap)
    if saved is None:
        return corner
    if corner is not None and corner != saved.corner:
        raise UserError(f"--corner {corner}: the run to be resumed began at corner {saved.corner}")
    if saved.corner >= len(field.crop):
        raise UserError(f"--resume: {path} is not the boundary of that run; give the same one")
    return saved.corner


def _warnings(field: Boundary | None, gap: float | None) -> list[str]:
    """What does not watch over the run."""
    if field is None:
        return [
            "no --boundary: no plan and no geofence. Only the picture ends a side and keeps the "
            "machine out of the neighbour's crop, and the run cannot be resumed"
        ]
    if gap is None:
        return [
            "no --gap: there is no geofence. Only the picture and the sides' lengths keep the "
            "machine out of the neighbour's crop; measure the ground between and give --gap METRES"
        ]
    return []


def _where_to_go_on(plan: Plan, begun: tuple[int, float], frame: LocalFrame) -> str:
    """Where the operator has to put the machine."""
    index, cut_m = begun
    side = plan.sides[index]
    x = side.x_m + cut_m * math.cos(side.heading_rad)
    y = side.y_m + cut_m * math.sin(side.heading_rad)
    lat, lon = frame.to_wgs84(x, y)
    compass = (90.0 - math.degrees(side.heading_rad)) % 360
    place = f"{cut_m:.1f} m along it, where its crop still stands" if cut_m else "at its beginning"
    return (
        f"going on with {plan.name(index)}: the machine has to stand {place} "
        f"(near {lat:.6f} {lon:.6f}), heading {compass:.0f} degrees by the compass"
    )


def _corner(corners: Sequence[LatLon], fixes: Feed[Fix] | None) -> int:
    """The corner nearest to where the machine says it is."""
    for _ in range(FIRST_FIXES):
        if fixes is None or not fixes.wait(FIRST_FIX_S):
            break
        fix = fixes.take()
        if fix is not None and fix.quality > 0:
            return nearest_corner(corners, fix.lat_deg, fix.lon_deg)
    why = "no --gnss" if fixes is None else fixes.problem or "the receiver has no fix yet"
    raise UserError(
        f"which corner does the machine stand at? There is no position ({why}): give --corner, "
        f"0 to {len(corners) - 1}"
    )


def _warm_up(
    pictures: Feed[Picture], url: str, mount: Mount, vehicle: Vehicle, mode: Mode
) -> Frame | None:
    """Lets a detector of its own see one picture, and returns that: what is compiled at first use
    takes seconds, and the firmware waits for a command no longer than 250 ms once it is armed.
    UserError where there is none, or its proportions are not the mount's."""
    if not pictures.wait(FIRST_PICTURE_S):
        raise UserError(
            f"no picture from the camera {url} within {FIRST_PICTURE_S:g} s: {pictures.problem}; "
            "start the phone's camera app and check the address"
        )
    picture = pictures.take()
    if picture is None:
        return None
    frame = fitted(picture, JpegDecoder(), mount, 0.0)
    if frame.bgr.size == 0:
        return None
    if not fits(frame, mount):
        height, width = frame.bgr.shape[:2]
        raise UserError(
            f"the camera sends {width}x{height} pixels, the mount expects {mount.width_px}x"
            f"{mount.height_px}: set the phone's resolution, or the mount in the vehicle file"
        )
    make_detector(mode, vehicle, mount).see(frame.bgr)
    return frame


def _paper_params(
    database: Path, name: str, first: Frame, vehicle: Vehicle, mount: Mount
) -> tuple[PaperParams, str]:
    """The paper's colour thresholds for this hour and mount, and where they are from."""
    now = datetime.datetime.now().astimezone()
    where = Circumstance(now.hour + now.minute / 60, mount=name)

    def make(params: PaperParams) -> MountedDetector:
        return make_detector("paper", vehicle, mount, params=params)

    return first_params(database, where, first.bgr, make)


def _why(run: Drive) -> str:
    faults = protocol.Fault(run.telemetry.faults if run.telemetry is not None else 0)
    return "; ".join([run.pilot.reason, *protocol.fault_texts(faults)])
