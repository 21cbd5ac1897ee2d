"""Facts about the wall-clock loop: what the pilot gets, what the firmware gets, how it ends."""

from __future__ import annotations

import io
import math
import os
import pty
import queue
import select
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, nullcontext, suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from host.core.errors import EXIT_USER, FaultError, UserError
from host.core.frames import LocalFrame
from host.core.messages import Command, Fix, Frame, Request, Telemetry, Turned
from host.core.vehicle import MAST, Vehicle
from host.estimate.kalman import Innovation
from host.estimate.odometry import Odometry
from host.estimate.position import Position
from host.field.fence import Fence
from host.link import protocol
from host.link.session import Link
from host.pilot.phase import Phase
from host.pilot.pilot import PAUSED, Pilot
from host.route.plan import Plan, spiral
from host.runs import session
from host.runs.drive import (
    PERIOD_S,
    TELEMETRY_TIMEOUT_S,
    Drive,
    fitted,
    halt,
)
from host.runs.record import Recorder, read
from host.runs.resume import Keeper, Progress, digest, load, save
from host.runs.screen import Keyboard, Screen, status
from host.sensors.camera_stream import Picture
from host.sensors.jpeg import JpegDecoder
from host.sensors.newest import Feed
from host.sensors.nmea import Receiver
from host.vision.mounted.detector import make_detector
from host.vision.view import CropView
from host.vision.watched import WatchedDetector
from tests.helpers.console import Cli
from tests.helpers.fake_firmware import RESTING, FakeFirmware
from tests.helpers.places import OnLane

LIMIT_S = 10.0
BGR = np.full((MAST.height_px, MAST.width_px, 3), 90, np.uint8)
JPEG = cv2.imencode(".jpg", BGR)[1].tobytes()
FIX = Fix(0.5, 31.5, 74.3, 1, 0.9, 8)


class Script:
    """Stands for the pilot: gives the commands of a list, then is done."""

    def __init__(self, commands: list[Command], then: Phase = Phase.FINISHED) -> None:
        self.seen: list[tuple[float, Frame | None, Fix | None, Telemetry | None]] = []
        self.turned: list[Turned | None] = []
        self.phase = Phase.FOLLOW
        self.reason = "as the script says"
        self.view: CropView | None = None
        self.paused = False
        self.believed_wrong = ""
        self.turns = 0
        self.cut_m = 0.0
        self.plan = Plan()
        self.position = Position(Vehicle())
        self.lane = OnLane(Vehicle()).lane
        self.motion = Odometry(Vehicle()).now
        self._commands = iter(commands)
        self._then = then

    @property
    def done(self) -> bool:
        return self.phase in (Phase.FINISHED, Phase.FAULT)

    def take_innovations(self) -> list[Innovation]:
        return []

    def step(
        self,
        now: float,
        frame: Frame | None,
        fix: Fix | None,
        telemetry: Telemetry | None,
        turned: Turned | None = None,
    ) -> Command:
        self.seen.append((now, frame, fix, telemetry))
        self.turned.append(turned)
        command = next(self._commands, None)
        if command is None:
            self.phase = self._then
            return Command(Request.STOP)
        return command


class Given(Feed[Any]):
    """A started feed of what a test gives it."""

    def __init__(self, name: str, items: Sequence[Any]) -> None:
        self._items: queue.Queue[Any] = queue.Queue()
        super().__init__(name, self._given, time.monotonic, lambda _: None)
        self.start()
        for item in items:
            self.give(item)

    def give(self, item: Any) -> None:
        """The next item; there to be taken when this returns."""
        self._items.put(item)
        self._items.join()

    def _given(self, feed: Feed[Any]) -> Iterator[Any]:
        while not feed.stopping:
            with suppress(queue.Empty):
                yield self._items.get(timeout=0.01)
                self._items.task_done()


@pytest.fixture
def driven(board: FakeFirmware) -> Iterator[Callable[..., Drive]]:
    """Makes a Drive on the fake board, met and ready."""
    with ExitStack() as stack:

        def make(
            pilot: Script,
            pictures: list[Picture] | None = None,
            fixes: list[Fix] | None = None,
            recorder: Recorder | None = None,
            fence: Fence | None = None,
            clock: Callable[[], float] = time.monotonic,
            paused: Callable[[], bool] | None = None,
            keeper: Keeper | None = None,
            turned: list[Turned] | None = None,
        ) -> Drive:
            link = stack.enter_context(Link(board.port, time.monotonic))
            link.meet()
            camera = Given("camera", pictures or [])
            gnss = Given("GNSS", fixes or [])
            stack.callback(camera.close)
            stack.callback(gnss.close)
            gyro = Given("gyroscope", turned or [])
            stack.callback(gyro.close)
            return Drive(
                cast(Pilot, pilot),
                link,
                camera,
                gnss,
                MAST,
                Vehicle(),
                clock,
                recorder,
                fence,
                paused,
                keeper,
                gyro,
            )

        yield make


def nothing(_drive: Drive) -> None:
    """Shows nothing."""


def test_the_pilots_commands_reach_the_firmware_in_order_every_50_ms(
    board: FakeFirmware, driven: Callable[..., Drive]
) -> None:
    commands = [Command(Request.DRIVE, 0.01 * n, 0.5, True) for n in range(10)]
    script = Script(commands)
    run = driven(script)
    begun = time.monotonic()
    run.run(nothing)
    assert board.wait_for(protocol.Stop)
    drives = [m for m in board.received if isinstance(m, protocol.Drive)]
    assert [drive.steer for drive in drives] == pytest.approx(
        [command.steer_rad for command in commands], abs=1e-4
    )
    for step, (now, *_) in enumerate(script.seen, start=1):
        assert now - begun >= step * PERIOD_S, "never early"


def test_what_the_gyroscope_says_is_given_once(driven: Callable[..., Drive]) -> None:
    script = Script([Command(Request.STOP)] * 5)
    turned = Turned(0.1, 0.2, 0.0)
    driven(script, turned=[turned]).run(lambda _: None)
    assert [each for each in script.turned if each is not None] == [turned]


def test_picture_and_fix_are_given_once_and_telemetry_is_the_latest(
    driven: Callable[..., Drive],
) -> None:
    script = Script([Command(Request.STOP)] * 8)
    driven(script, [Picture(5.0, JPEG)], [FIX]).run(nothing)
    frames = [frame for _, frame, _, _ in script.seen if frame is not None]
    assert [frame.stamp for frame in frames] == [5.0 - Vehicle().camera_delay_s]
    assert [fix for _, _, fix, _ in script.seen if fix is not None] == [FIX]
    stamps = [telemetry.stamp for *_, telemetry in script.seen if telemetry is not None]
    assert stamps == sorted(stamps)
    assert len(set(stamps)) >= 4


def test_a_picture_that_repeats_the_one_before_is_no_new_view(
    driven: Callable[..., Drive],
) -> None:
    script = Script([Command(Request.STOP)] * 6)
    run = driven(script, [Picture(5.0, JPEG)])

    def again(_drive: Drive) -> None:
        cast(Given, run.camera).give(Picture(6.0, JPEG))

    run.run(again)
    assert [frame.stamp for _, frame, *_ in script.seen if frame is not None] == [
        5.0 - Vehicle().camera_delay_s
    ]
    assert run.pictures_repeated >= 5


class ManualClock:
    """Stands still but for a millisecond at each look, and for what a step is said to take."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        self.now += 0.001
        return self.now


def test_a_step_that_takes_too_long_is_counted_and_not_made_up_for(
    driven: Callable[..., Drive],
) -> None:
    clock = ManualClock()

    class Slow(Script):
        def step(self, *given: Any) -> Command:
            if len(self.seen) == 2:
                clock.now += 0.23
            return super().step(*given)

    script = Slow([Command(Request.STOP)] * 8)
    run = driven(script, clock=clock)
    run.run(nothing)
    times = [now for now, *_ in script.seen]
    gaps = [after - before for before, after in pairwise(times)]
    assert run.late == 1
    assert 0.23 < run.step_s < 0.25
    assert gaps[2] == pytest.approx(0.24, abs=0.02)
    assert [gap for n, gap in enumerate(gaps) if n != 2] == pytest.approx([0.05] * 7, abs=0.02)


def test_the_time_from_shutter_to_firmware_is_measured(
    board: FakeFirmware, driven: Callable[..., Drive]
) -> None:
    shutter = time.monotonic()
    run = driven(
        Script([Command(Request.DRIVE)] * 20), [Picture(shutter + Vehicle().camera_delay_s, JPEG)]
    )
    board.echo.set()
    run.run(nothing)
    (latency,) = run.latencies_s
    assert 0 < latency < time.monotonic() - shutter


def test_nothing_of_a_broken_picture_is_given_and_it_is_counted(
    driven: Callable[..., Drive],
) -> None:
    script = Script([Command(Request.STOP)])
    run = driven(script, [Picture(0.0, b"\xff\xd8 nothing \xff\xd9")])
    run.run(nothing)
    assert run.pictures_bad == 1
    pixels = [frame.bgr.size for _, frame, _, _ in script.seen if frame is not None]
    assert pixels == [0], "that there was one, for the picture watch"


def test_everything_is_recorded(driven: Callable[..., Drive], tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with Recorder(path) as recorder:
        run = driven(
            Script([Command(Request.DRIVE, 0.1, reason="so")] * 5),
            [Picture(5.0, JPEG)],
            [FIX],
            recorder,
        )
        run.run(nothing)
    topics: dict[str, list[dict[str, Any]]] = {}
    for topic, _, message in read(path):
        topics.setdefault(topic, []).append(message)
    assert topics["/camera"][0]["data"] == JPEG, "as it came, not compressed again"
    assert topics["/fix"][0]["latitude"] == FIX.lat_deg
    assert len(topics["/command"]) == 6
    assert topics["/command"][0]["reason"] == "so"
    assert topics["/pilot"][0]["phase"] == "follow"
    assert topics["/telemetry"]


def test_a_firmware_that_falls_silent_is_one_message(
    board: FakeFirmware, driven: Callable[..., Drive]
) -> None:
    run = driven(Script([Command(Request.DRIVE)] * 1000))
    board.mute.set()
    begun = time.monotonic()
    with pytest.raises(UserError, match="no telemetry for 1 s"):
        run.run(nothing)
    assert time.monotonic() - begun < 3 * TELEMETRY_TIMEOUT_S


def test_a_firmware_that_restarts_mid_run_ends_it_with_its_faults_in_words(
    board: FakeFirmware, driven: Callable[..., Drive]
) -> None:
    run = driven(Script([Command(Request.DRIVE)] * 1000))
    steps = iter(range(5))

    def reset_after_five(_drive: Drive) -> None:
        if next(steps, None) is None:
            board.telemetry = replace(RESTING, faults=protocol.Fault.BROWN_OUT)
            board.reset()

    with pytest.raises(UserError, match=r"restarted in the middle of the run.*brown-out"):
        run.run(reset_after_five)


def test_a_port_that_vanishes_mid_run_is_one_message(
    board: FakeFirmware, driven: Callable[..., Drive]
) -> None:
    run = driven(Script([Command(Request.DRIVE)] * 1000))
    steps = iter(range(5))

    def unplug_after_five(_drive: Drive) -> None:
        if next(steps, None) is None:
            board.unplug()

    with pytest.raises(UserError, match=r"vanished.*within 250 ms"):
        run.run(unplug_after_five)


def test_positions_far_outside_the_boundary_stop_the_run(driven: Callable[..., Drive]) -> None:
    frame = LocalFrame(31.5, 74.3)
    corners = [frame.to_wgs84(*corner) for corner in ((0, 0), (20, 0), (20, 10))]
    far = replace(FIX, lat_deg=31.6)
    run = driven(Script([Command(Request.DRIVE)] * 1000), fixes=[far], fence=Fence(corners))

    def again(_drive: Drive) -> None:
        cast(Given, run.gnss).give(far)

    with pytest.raises(UserError, match="outside the boundary"):
        run.run(again)


def test_the_operators_pause_reaches_the_pilot_and_the_record(
    driven: Callable[..., Drive], tmp_path: Path
) -> None:
    wants = iter([False, True, True, False, False])
    script = Script([Command(Request.DRIVE)] * 4)
    seen: list[bool] = []
    path = tmp_path / "run.mcap"
    with Recorder(path) as recorder:
        run = driven(script, recorder=recorder, paused=lambda: next(wants))
        run.run(lambda drive: seen.append(drive.pilot.paused))
    assert seen == [False, True, True, False, False]
    told = [message["paused"] for topic, _, message in read(path) if topic == "/operator"]
    assert told == [True, False]


def test_the_progress_is_on_the_disk_when_a_run_dies(
    board: FakeFirmware, driven: Callable[..., Drive], tmp_path: Path
) -> None:
    plan = spiral([(0, 0), (10, 0), (10, 10), (0, 10)], 1, Vehicle())
    path = tmp_path / "run.progress.json"
    script = Script([Command(Request.DRIVE)] * 1000)
    keeper = Keeper(path, plan, 1, print)
    run = driven(script, keeper=keeper)

    def cut_on(_drive: Drive) -> None:
        script.cut_m += 0.2
        if script.cut_m > 3.0:
            script.turns, script.cut_m = 2, 1.4
            board.unplug()

    with pytest.raises(UserError, match="vanished"):
        run.run(cut_on)
    keeper.close(cast(Pilot, script))
    saved = load(path)
    assert (saved.side, saved.cut_m, saved.corner) == (2, pytest.approx(1.4), 1)


def keyboard() -> tuple[Keyboard, Any, Any]:
    """One on a terminal, the end that types, and the one that is read."""
    master, slave = pty.openpty()
    terminal = os.fdopen(slave)
    return Keyboard(terminal), os.fdopen(master, "wb", buffering=0), terminal


def test_enter_pauses_and_enter_goes_on() -> None:
    keys, types, terminal = keyboard()
    assert [keys(), keys()] == [False, False]
    types.write(b"\n")
    until(lambda: select.select([terminal], [], [], LIMIT_S)[0])
    assert [keys(), keys()] == [True, True]
    types.write(b"\x04")  # Ctrl-D
    until(lambda: select.select([terminal], [], [], LIMIT_S)[0])
    assert [keys(), keys()] == [True, True]
    types.write(b"what\n")
    until(lambda: select.select([terminal], [], [], LIMIT_S)[0])
    assert not keys()


def test_a_terminal_that_is_gone_changes_nothing() -> None:
    keys, types, _terminal = keyboard()
    types.close()
    assert [keys(), keys()] == [False, False]


@given(st.lists(st.integers(0, 3), max_size=6))
def test_every_enter_counts_however_many_come_at_once(bursts: list[int]) -> None:
    keys, types, terminal = keyboard()
    typed = 0
    for burst in bursts:
        types.write(b"\n" * burst)
        typed += burst
        if burst:
            until(lambda: select.select([terminal], [], [], LIMIT_S)[0])
        assert keys() is (typed % 2 == 1)
    types.close()
    terminal.close()


def test_without_a_terminal_nothing_pauses(tmp_path: Path) -> None:
    text = tmp_path / "text"
    text.write_text("\n\n\n")
    with text.open() as file:
        assert not Keyboard(file)()


def until(condition: Callable[[], object]) -> None:
    """A condition that itself waits must hold."""
    assert condition()


def test_halt_is_confirmed_by_the_firmware_only(board: FakeFirmware) -> None:
    with Link(board.port, time.monotonic) as link:
        link.meet()
        assert halt(link, time.monotonic)
        board.telemetry = replace(RESTING, state=protocol.State.RUNNING)
        assert not halt(link, time.monotonic)
    assert board.wait_for(protocol.Stop)


class Said:
    """Stands for the screen: keeps what is said."""

    def __init__(self, then: Callable[[], None]) -> None:
        self.lines: list[str] = []
        self._then = then

    def open(self) -> nullcontext[None]:
        return nullcontext()

    def show(self, _drive: Drive) -> None:
        self._then()

    def last(self, _drive: Drive) -> None:
        """Nothing is left on it."""

    def say(self, text: str) -> None:
        self.lines.append(text)


def broken_off() -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize("rests", [True, False])
def test_after_ctrl_c_it_is_said_whether_the_firmware_has_stopped(
    board: FakeFirmware, driven: Callable[..., Drive], rests: bool
) -> None:
    run = driven(Script([Command(Request.DRIVE)] * 1000))
    if not rests:
        board.telemetry = replace(RESTING, state=protocol.State.RUNNING)
    screen = Said(broken_off)
    machine = SimpleNamespace(screen=screen, link=run.link, clock=time.monotonic)
    with pytest.raises(KeyboardInterrupt):
        session._drive(run, cast(Any, machine))
    words = "stopped: the firmware confirms" if rests else "STOP is not confirmed"
    assert any(line.startswith(words) for line in screen.lines), screen.lines


def test_a_port_that_vanishes_leaves_the_stop_unconfirmed_and_that_is_said(
    board: FakeFirmware, driven: Callable[..., Drive]
) -> None:
    run = driven(Script([Command(Request.DRIVE)] * 1000))
    screen = Said(board.unplug)
    machine = SimpleNamespace(screen=screen, link=run.link, clock=time.monotonic)
    with pytest.raises(FaultError, match="vanished"):
        session._drive(run, cast(Any, machine))
    assert "STOP is not confirmed: press the emergency stop" in screen.lines


# ---- what the operator sees ----------------------------------------------------------------------


def text_of(renderable: Any) -> str:
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(renderable)
    return console.export_text()


def test_the_status_says_what_the_pilot_does_and_every_fault_in_words(
    board: FakeFirmware, driven: Callable[..., Drive]
) -> None:
    faults = protocol.Fault.POT_OPEN | protocol.Fault.BATTERY_LOW
    board.telemetry = replace(RESTING, state=protocol.State.FAULT, faults=faults, battery=9.5)
    script = Script([Command(Request.DRIVE, math.radians(12), 0.5, True)] * 3)
    run = driven(script, [Picture(5.0, JPEG)], [FIX])
    run.run(nothing)
    script.view = CropView(0.3, edge_offset_m=-0.07, reason="dust")
    text = text_of(status(run, Receiver()))
    for words in (
        "finished",
        "as the script says",
        "-0.07 m",
        "confidence 0.30 dust",
        "FAULT",
        "battery 9.5 V",
        "31.500000 74.300000, quality 1",
        "1 pictures, 0 bad, 0 repeated",
        *protocol.fault_texts(faults),
    ):
        assert words in text


def test_a_pause_is_shown(driven: Callable[..., Drive]) -> None:
    script = Script([Command(Request.DRIVE)] * 3)
    run = driven(script)
    run.run(nothing)
    script.paused = True
    assert f"{PAUSED}; Enter goes on" in text_of(status(run, None))


def test_without_a_terminal_each_change_is_one_line(
    driven: Callable[..., Drive], capsys: pytest.CaptureFixture[str]
) -> None:
    events = deque(["camera lost: it fell off"])
    screen = Screen(lambda: 12.5, events, None)
    with screen.open():
        driven(Script([Command(Request.STOP)] * 5)).run(screen.show)
    screen.close()
    assert capsys.readouterr().out.splitlines() == [
        "   12.5 s  camera lost: it fell off",
        "   12.5 s  follow: as the script says",
        "   12.5 s  finished: as the script says",
    ]


# ---- pictures and mounts -------------------------------------------------------------------------


def test_a_larger_picture_of_the_same_shape_is_brought_to_the_mounts_size() -> None:
    big = np.zeros((2 * MAST.height_px, 2 * MAST.width_px, 3), np.uint8)
    big[:, : MAST.width_px] = 200
    frame = fitted(Picture(1.0, None, big), JpegDecoder(), MAST, 0.25)
    assert frame.stamp == 0.75
    assert frame.bgr.shape == BGR.shape
    assert frame.bgr[:, : MAST.width_px // 2].min() == 200


WIDE = Picture(0.0, None, np.zeros((360, 640, 3), np.uint8))


def test_a_first_picture_of_another_shape_is_refused_with_both_sizes(
    cli: Cli, board: FakeFirmware, monkeypatch: pytest.MonkeyPatch
) -> None:
    def source(feed: Feed[Picture]) -> Iterator[Picture]:
        yield WIDE
        feed.pause(LIMIT_S)

    def camera(_url: str, clock: Callable[[], float], report: Callable[[str], None]) -> Any:
        return Feed("camera", source, clock, report)

    monkeypatch.setattr("host.runs.session.camera_feed", camera)
    code, _, err = cli(
        "drive", "--yes", "--port", board.port, "--camera", "http://127.0.0.1:1/video"
    )
    assert code == EXIT_USER
    assert "640x360 pixels, the mount expects 640x480" in err
    assert err.count("\n") == 1
    assert board.wait_for(protocol.Stop)


def test_a_picture_of_another_shape_in_mid_drive_is_a_bad_one_that_is_not_believed(
    driven: Callable[..., Drive],
) -> None:
    script = Script([Command(Request.DRIVE)] * 3)
    run = driven(script, [WIDE])
    run.run(nothing)
    assert (run.pictures, run.pictures_bad) == (1, 1)
    frame = next(frame for _, frame, _, _ in script.seen if frame is not None)
    view = WatchedDetector(make_detector("robust", Vehicle(), MAST), MAST).see(frame.bgr)
    assert not view.usable
    assert "another size" in view.reason


# ---- the command ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--port", "/dev/no-such-port"), "serial port /dev/no-such-port does not exist"),
        (("--vehicle", "no-such.yaml"), "cannot read the vehicle file no-such.yaml"),
        (("--mount", "roof"), "no camera mount 'roof'"),
        (("--camera", "no-such.mp4"), "camera no-such.mp4 does not exist"),
        (("--gnss", "tcp://nowhere"), "needs a host and a port"),
        (("--boundary", "no-such.csv"), "cannot read the boundary no-such.csv"),
    ],
)
def test_bad_input_is_one_message(
    cli: Cli, board: FakeFirmware, options: tuple[str, str], message: str
) -> None:
    given = {"--port": board.port, "--camera": "http://127.0.0.1:1/video"}
    given[options[0]] = options[1]
    code, _, err = cli("drive", "--yes", *(word for pair in given.items() for word in pair))
    assert code == EXIT_USER
    assert message in err
    assert err.count("\n") == 1


def test_a_corner_that_the_boundary_has_not_is_one_message(
    cli: Cli, board: FakeFirmware, tmp_path: Path
) -> None:
    field = tmp_path / "field.csv"
    field.write_text("31.5,74.3\n31.5,74.301\n31.501,74.301\n")
    given = (
        "drive",
        "--yes",
        "--port",
        board.port,
        "--camera",
        "http://127.0.0.1:1/video",
        "--corner",
        "3",
    )
    for more, message in (
        (("--boundary", str(field)), "has the corners 0 to 2"),
        ((), "--boundary, which is not given"),
    ):
        code, _, err = cli(*given, *more)
        assert code == EXIT_USER
        assert message in err


SQUARE = "31.5,74.3\n31.5,74.3002\n31.5002,74.3002\n31.5002,74.3\n"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--gap", "2"), "--gap is measured from the edge of --boundary, which is not given"),
        (("--boundary", "FIELD", "--gap", "0.1"), "no room for the machine's wheels"),
        (("--boundary", "FIELD", "--gap", "1e9"), "is not in the range"),
        (("--resume", "SAVED"), "--resume goes on with the plan of --boundary"),
        (("--boundary", "FIELD", "--resume", "none.json"), "cannot read the saved progress"),
        (("--boundary", "FIELD", "--resume", "FIELD"), "is no saved progress"),
        (("--boundary", "FIELD", "--resume", "SAVED", "--corner", "0"), "began at corner 9"),
        (("--boundary", "FIELD", "--resume", "SAVED"), "is not the boundary of that run"),
    ],
)
def test_options_that_do_not_fit_are_one_message(
    cli: Cli, board: FakeFirmware, tmp_path: Path, options: tuple[str, ...], message: str
) -> None:
    names = {"FIELD": tmp_path / "field.csv", "SAVED": tmp_path / "run.progress.json"}
    names["FIELD"].write_text(SQUARE)
    save(names["SAVED"], Progress(plan=digest(Plan()), corner=9, side=0, phase=Phase.FAULT))
    given = ("drive", "--yes", "--port", board.port, "--camera", "http://127.0.0.1:1/video")
    code, _, err = cli(*given, *(str(names.get(word, word)) for word in options))
    assert code == EXIT_USER
    assert message in err
    assert err.count("\n") == (1 if "range" not in message else 4)


def test_no_picture_is_one_message_and_the_machine_is_stopped(
    cli: Cli, board: FakeFirmware, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("host.runs.first_picture.FIRST_PICTURE_S", 0.3)
    code, _, err = cli(
        "drive", "--yes", "--port", board.port, "--camera", "http://127.0.0.1:1/video"
    )
    assert code == EXIT_USER
    assert "no picture from the camera http://127.0.0.1:1/video within 0.3 s" in err
    assert "Connection refused" in err
    assert board.wait_for(protocol.Stop)
