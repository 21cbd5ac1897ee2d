"""Facts about what happens before the first motion: consent, checks, the jog, faults cleared."""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from host.core.errors import EXIT_FAULT, EXIT_USER, UserError
from host.core.frames import LocalFrame
from host.core.messages import Fix
from host.core.terminal import Outlet
from host.core.vehicle import MAST, Vehicle
from host.field.boundary_file import load_field
from host.link import protocol
from host.link.session import connect
from host.pilot.phase import Phase
from host.runs import preflight
from host.runs.errand import Errand, errand_of
from host.runs.operator import Operator
from host.runs.record import ROOM_EVERY, SPARE_BYTES, Recorder, read, unused
from host.runs.resume import Progress, digest
from host.vision.view import CropView
from tests.helpers.console import Cli
from tests.helpers.fake_firmware import RESTING, FakeFirmware
from tests.helpers.steady_phone import always
from tests.helpers.terminal import Terminal

LIMIT_S = 10.0
JPEG = cv2.imencode(".jpg", np.full((MAST.height_px, MAST.width_px, 3), 90, np.uint8))[1].tobytes()
VEHICLE = Vehicle()


def field_of(folder: Path) -> Path:
    """A square of 20 m, its corner 0 in the south-west."""
    frame = LocalFrame(31.5, 74.3)
    corners = [frame.to_wgs84(x, y) for x, y in ((0, 0), (20, 0), (20, 20), (0, 20))]
    path = folder / "field.csv"
    path.write_text("".join(f"{lat:.9f},{lon:.9f}\n" for lat, lon in corners))
    return path


def errand(folder: Path, side: int = 0, cut_m: float = 0.0) -> Errand:
    path = field_of(folder)
    whole = errand_of(load_field(path), 0, VEHICLE, "three_point", 2.0, None, None).whole
    saved = Progress(plan=digest(whole), corner=0, side=side, cut_m=cut_m, phase=Phase.FAULT)
    resumed = saved if side or cut_m else None
    return errand_of(load_field(path), 0, VEHICLE, "three_point", 2.0, resumed, path)


def fix_at(x: float, y: float) -> Fix:
    return Fix(0.0, *LocalFrame(31.5, 74.3).to_wgs84(x, y), 1, 0.9, 8)


@pytest.fixture
def camera(monkeypatch: pytest.MonkeyPatch) -> None:
    """A phone that always shows the same grey."""
    monkeypatch.setattr("host.runs.session.camera_feed", always(JPEG))


GIVEN = ("drive", "--camera", "http://127.0.0.1:1/video", "--port")


# ---- consent -------------------------------------------------------------------------------------


@pytest.mark.usefixtures("camera")
def test_without_a_terminal_and_without_consent_nothing_moves(
    cli: Cli, board: FakeFirmware
) -> None:
    code, _, err = cli(*GIVEN, board.port)
    assert code == EXIT_USER
    assert "--yes" in err
    assert not board.moved


@pytest.mark.usefixtures("camera")
def test_it_says_what_it_will_do_and_moves_only_after_the_word_and_the_countdown(
    cli: Cli,
    board: FakeFirmware,
    terminal: Terminal,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sys.stdin", terminal.stdin)
    given = ("--boundary", str(field_of(tmp_path)), "--corner", "0", "--countdown", "2")
    armed: list[float] = []
    begun = time.monotonic()

    def person() -> None:
        terminal.type("what\n")
        time.sleep(0.5)
        assert not board.moved
        terminal.type("start\n")
        board.wait_for(protocol.Arm, LIMIT_S)
        armed.append(time.monotonic() - begun)
        board.unplug()

    hand = threading.Thread(target=person)
    hand.start()
    code, out, err = cli(*GIVEN, board.port, *given, "--record", str(tmp_path / "a.mcap"))
    hand.join()
    assert code == EXIT_FAULT, err
    assert armed[0] > 2.0
    for words in (
        "corner 0",
        "90 degrees by the compass",
        "blade: 1 m wide",
        "does not see people",
    ):
        assert words in out
    assert out.count("\a") == 3
    assert "no --gnss" in out
    assert "no --gap" in out


@pytest.mark.usefixtures("camera")
def test_enter_breaks_the_countdown_off(
    cli: Cli,
    board: FakeFirmware,
    terminal: Terminal,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sys.stdin", terminal.stdin)
    terminal.type("start\n\n")
    code, _, err = cli(*GIVEN, board.port, "--record", str(tmp_path / "a.mcap"))
    assert code == EXIT_USER
    assert "nothing has moved" in err
    assert not board.moved


@pytest.mark.usefixtures("camera")
def test_after_a_fault_the_operator_clears_it_and_is_asked_again(
    cli: Cli,
    board: FakeFirmware,
    terminal: Terminal,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sys.stdin", terminal.stdin)

    def came(kind: type[protocol.Message], count: int) -> bool:
        with board.changed:
            return board.changed.wait_for(
                lambda: sum(isinstance(each, kind) for each in board.received) >= count, LIMIT_S
            )

    def person() -> None:
        terminal.type("start\n")
        came(protocol.Arm, 1)
        board.telemetry = replace(
            RESTING, state=protocol.State.FAULT, faults=protocol.Fault.LINK_LOST
        )
        came(protocol.Stop, 1)  # the pilot has tried to clear it once, and given up
        terminal.type("clear\n")
        came(protocol.Clear, 2)
        board.telemetry = RESTING
        board.received.clear()
        terminal.type("start\n")
        again.append(came(protocol.Arm, 1))
        board.unplug()

    again: list[bool] = []
    hand = threading.Thread(target=person)
    hand.start()
    record = ("--record", str(tmp_path / "a.mcap"), "--countdown", "0")
    code, out, err = cli(*GIVEN, board.port, *record)
    hand.join()
    assert code == EXIT_FAULT, err
    assert "type clear and Enter" in out
    assert "cleared" in out
    assert again == [True]


# ---- checks --------------------------------------------------------------------------------------


@pytest.mark.usefixtures("camera")
def test_a_firmware_that_was_set_back_to_defaults_is_refused_with_what_to_do(
    cli: Cli, board: FakeFirmware
) -> None:
    board.params[protocol.PARAMS["hall_per_metre"].id] = 0
    code, _, err = cli(*GIVEN, board.port, "--yes")
    assert code == EXIT_USER
    assert "daranti params set hall_per_metre 50 --save" in err
    assert not board.moved


@pytest.mark.parametrize("pair", preflight.PAIRS, ids=lambda pair: f"{pair.parameter}-{pair.field}")
def test_every_pair_is_compared(pair: preflight.Pair) -> None:
    held = {each.parameter: float(getattr(VEHICLE, each.field)) for each in preflight.PAIRS[::-1]}
    held["speed_max"] = 1.0
    assert preflight.differing(VEHICLE, held) == []
    half = held[pair.parameter] = 0.5 * float(getattr(VEHICLE, pair.field))
    assert (pair, half, 2 * half) in preflight.differing(VEHICLE, held)


def said(problem: preflight.Problem | None) -> str:
    return "" if problem is None else problem.text


def test_a_machine_at_another_corner_is_told_so(tmp_path: Path) -> None:
    corners = load_field(field_of(tmp_path)).crop
    begin = errand(tmp_path)
    assert preflight.place_problem([fix_at(2.0, -3.0)], begin, corners) is None
    assert "from corner 1" in said(preflight.place_problem([fix_at(21.0, 1.0)], begin, corners))
    assert preflight.place_problem([], begin, corners) is None


def test_a_resumed_machine_has_to_stand_where_the_run_ended(tmp_path: Path) -> None:
    corners = load_field(field_of(tmp_path)).crop
    again = errand(tmp_path, cut_m=12.0)
    x, y, _ = preflight.where_of(again) or (0.0, 0.0, 0.0)
    assert (x, y) == pytest.approx((11.8, 0.0), abs=0.1)
    assert preflight.place_problem([fix_at(x - 3, y)], again, corners) is None
    assert "12 m" in said(preflight.place_problem([fix_at(0, 0)], again, corners))


def test_one_reflected_position_does_not_count(tmp_path: Path) -> None:
    corners = load_field(field_of(tmp_path)).crop
    fixes = [fix_at(0, 0), fix_at(80, 0), fix_at(1, 0)]
    assert preflight.place_problem(fixes, errand(tmp_path), corners) is None


@pytest.mark.parametrize(
    ("shown", "turn"), [(90, ""), (124, "34 degrees to the left"), (56, "34 degrees to the right")]
)
def test_a_machine_that_stands_askew_is_told_which_way_to_turn(
    tmp_path: Path, shown: float, turn: str
) -> None:
    found = preflight.heading_problem(errand(tmp_path, cut_m=5.0), shown)
    assert turn in said(found)
    assert (found is not None) == bool(turn)


def test_an_edge_whose_corners_are_unsure_may_run_otherwise_than_the_boundary_says(
    tmp_path: Path,
) -> None:
    """Its two corners, each half a metre wrong and 20 m apart: 4 degrees; 5 m apart: 16."""
    long = errand(tmp_path, cut_m=5.0)
    long = replace(long, whole=replace(long.whole, sigma_m=0.5))
    first = replace(long.whole.sides[0], length_m=5.0)
    short = replace(long, whole=replace(long.whole, sides=(first, *long.whole.sides[1:])))
    assert preflight.heading_problem(long, 90 + 17) is None
    assert preflight.heading_problem(long, 90 + 21) is not None
    assert preflight.heading_problem(short, 90 + 29) is None
    assert preflight.heading_problem(short, 90 + 33) is not None
    lost = replace(short, whole=replace(short.whole, sigma_m=9.0))
    assert preflight.heading_problem(lost, 90 + 44) is None
    assert preflight.heading_problem(lost, 90 + 46) is not None


def test_pictures_of_another_mount_are_told_before_anything_moves() -> None:
    """The upper border: sky (blue, grey, or white with haze), crop, or a dark nothing."""

    def picture(blue: int, green: int, red: int) -> np.ndarray[Any, np.dtype[np.uint8]]:
        made = np.full((480, 640, 3), (40, 90, 120), np.uint8)
        made[:30] = blue, green, red
        return made

    for sky in ((210, 180, 160), (190, 185, 180), (150, 150, 160)):
        assert "--mount low" in said(preflight.mount_problem(picture(*sky), "mast", VEHICLE))
        assert preflight.mount_problem(picture(*sky), "low", VEHICLE) is None
    for crop in ((80, 140, 180), (120, 140, 150)):
        assert "--mount mast" in said(preflight.mount_problem(picture(*crop), "low", VEHICLE))
        assert preflight.mount_problem(picture(*crop), "mast", VEHICLE) is None
    for name in ("low", "mast"):
        assert preflight.mount_problem(picture(40, 40, 40), name, VEHICLE) is None
    alone = VEHICLE.model_copy(update={"mounts": {"mast": MAST}})
    assert preflight.mount_problem(picture(210, 180, 160), "mast", alone) is None


def test_an_edge_that_is_not_at_the_blade_is_told() -> None:
    assert preflight.view_problem(CropView(0.9, edge_offset_m=0.1)) is None
    assert preflight.view_problem(CropView(0.2, edge_offset_m=2.0)) is None
    assert "0.8 m left" in said(preflight.view_problem(CropView(0.9, edge_offset_m=0.8)))
    assert "0.8 m right" in said(preflight.view_problem(CropView(0.9, edge_offset_m=-0.8)))
    askew = CropView(0.9, edge_offset_m=0.0, edge_heading_rad=-0.6)
    assert "34 degrees to the right" in said(preflight.view_problem(askew))


@pytest.mark.usefixtures("camera")
def test_a_resume_without_any_direction_is_refused(
    cli: Cli, board: FakeFirmware, tmp_path: Path
) -> None:
    again = errand(tmp_path, cut_m=12.0)
    saved = tmp_path / "a.progress.json"
    progress = Progress(plan=digest(again.whole), corner=0, side=0, cut_m=12.0, phase=Phase.FAULT)
    saved.write_text(progress.model_dump_json())
    given = ("--boundary", str(tmp_path / "field.csv"), "--gap", "2", "--resume", str(saved))
    record = ("--record", str(tmp_path / "b.mcap"))
    code, _, err = cli(*GIVEN, board.port, "--yes", *given, *record)
    assert code == EXIT_USER
    assert "--heading" in err
    code, _, err = cli(*GIVEN, board.port, "--yes", *given, *record, "--heading", "56")
    assert code == EXIT_USER
    assert "34 degrees to the right" in err
    assert not board.moved


# ---- by hand -------------------------------------------------------------------------------------


def test_a_jog_creeps_while_a_key_is_held_with_the_blade_off(
    board: FakeFirmware, terminal: Terminal
) -> None:
    said: list[str] = []
    hand = Operator(terminal.stdin, said.append, said.append, time.monotonic)

    def person() -> None:
        board.wait_for(protocol.Arm)
        board.telemetry = replace(RESTING, state=protocol.State.ARMED)
        time.sleep(0.2)
        terminal.type("aw")
        time.sleep(1.2)
        terminal.type("q")
        time.sleep(0.3)
        board.telemetry = RESTING

    thread = threading.Thread(target=person)
    with connect(board.port) as link:
        thread.start()
        hand.jog(link)
        thread.join()
    first = next(each for each in board.received if isinstance(each, protocol.Drive | protocol.Arm))
    assert isinstance(first, protocol.Drive) and first.speed == 0, "a board arms only then"
    drives = [each for each in board.received if isinstance(each, protocol.Drive)]
    assert max(each.speed for each in drives) == pytest.approx(0.12, abs=0.001)
    assert drives[-1].speed == 0, "let go of, it stands"
    assert max(each.steer for each in drives) == pytest.approx(0.0873, abs=0.001)
    assert not any(each.blade for each in drives)
    assert isinstance(board.received[-1], protocol.Stop)


def test_a_jog_that_the_firmware_does_not_arm_says_why(
    board: FakeFirmware, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("host.runs.operator.ARM_S", 0.3)
    board.telemetry = replace(RESTING, state=protocol.State.FAULT, faults=protocol.Fault(2))
    with connect(board.port) as link, pytest.raises(UserError, match="emergency-stop"):
        Operator(terminal.stdin, print, print, time.monotonic).jog(link)


# ---- the record ----------------------------------------------------------------------------------


def test_what_was_recorded_is_not_written_over(tmp_path: Path) -> None:
    first = tmp_path / "a.mcap"
    assert unused(first) == first
    first.write_bytes(b"an hour's work")
    assert unused(first).name == "a-2.mcap"
    (tmp_path / "a-2.mcap").touch()
    assert unused(first).name == "a-3.mcap"


def test_a_full_disk_ends_the_record_and_not_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    path = tmp_path / "a.mcap"
    with Recorder(path, lost=said.append) as recorder:
        recorder.put("/operator", 0.0, {"paused": True})

        def full(*_: object) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("mcap.writer.Writer.add_message", full)
        recorder.put("/operator", 1.0, {"paused": True})
        recorder.put("/operator", 2.0, {"paused": True})
    assert said == [f"the record {path} ends here: No space left on device"]
    assert list(read(path)) == []


def test_the_record_leaves_room_for_the_progress_and_is_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    path = tmp_path / "a.mcap"
    free = [1e9]
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": free[0]}))
    with Recorder(path, lost=said.append) as recorder:
        for k in range(3 * ROOM_EVERY):
            free[0] = 1e9 if k < ROOM_EVERY else SPARE_BYTES - 1
            recorder.put("/operator", float(k), {"paused": True})
    assert said == [f"the record {path} ends here: the disk has only 20 MB left"]
    cut: list[str] = []
    assert len(list(read(path, tell=cut.append))) == ROOM_EVERY
    assert cut == []


def test_a_disk_without_room_is_told_before_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def usage(free: float) -> Callable[[Path], Any]:
        return lambda _: type("Usage", (), {"free": free})

    monkeypatch.setattr("shutil.disk_usage", usage(1e12))
    assert preflight.room_for(tmp_path / "new" / "a.mcap", 3600) == ""
    monkeypatch.setattr("shutil.disk_usage", usage(1e9))
    assert "25 of about 60 minutes" in preflight.room_for(tmp_path / "a.mcap", 3600)
    monkeypatch.setattr("shutil.disk_usage", usage(1e8))
    with pytest.raises(UserError, match="100 MB left"):
        preflight.room_for(tmp_path / "a.mcap", 3600)


# ---- the terminal --------------------------------------------------------------------------------


def test_a_terminal_that_is_not_read_holds_nothing_up() -> None:
    reading, writing = os.pipe()
    outlet = Outlet(os.fdopen(writing, "w"))
    begun = time.monotonic()
    for _ in range(400):
        outlet.write("x" * 1000)
    assert time.monotonic() - begun < 1.0
    assert not outlet.drain(0.1)
    while select.select([reading], [], [], 0.5)[0]:
        os.read(reading, 65536)
    assert outlet.drain()
    os.close(reading)
