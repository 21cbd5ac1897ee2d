"""Facts about `daranti calibrate delay`: what it asks before anything moves, and what it writes."""

from __future__ import annotations

import os
import signal
import threading
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from host.core.errors import EXIT_FAULT, EXIT_INTERRUPTED, EXIT_USER, FaultError, UserError
from host.core.vehicle import MAST
from host.core.vehicle_file import load_vehicle
from host.link import protocol
from host.tune.camera_delay import Delay
from host.tune.wire import Wire
from tests.helpers.console import Cli
from tests.helpers.fake_firmware import RESTING, FakeFirmware
from tests.helpers.steady_phone import always
from tests.helpers.terminal import Terminal

CALIBRATE = ("calibrate", "delay", "--camera", "http://127.0.0.1:1/video", "--countdown", "0")
NOISE = np.random.default_rng(1).integers(0, 255, (MAST.height_px, MAST.width_px, 3))
JPEG = cv2.imencode(".jpg", NOISE.astype(np.uint8))[1].tobytes()
READY = "host.commands.calibrate_delay.make_ready_visibly"
FOUND = Delay(0.2344, 0.021)


@pytest.fixture(autouse=True)
def ready(monkeypatch: pytest.MonkeyPatch) -> None:
    """As it is when it has run once."""
    monkeypatch.setattr(READY, lambda: None)


@pytest.fixture
def camera(monkeypatch: pytest.MonkeyPatch) -> None:
    """A phone that always shows the same."""
    monkeypatch.setattr("host.commands.calibrate_delay.camera_feed", always(JPEG))


def drives(monkeypatch: pytest.MonkeyPatch, ends: Delay | BaseException | None) -> list[float]:
    """The drive itself is replaced by how it `ends` (None: by Ctrl-C). Returns when it was begun,
    by the wire's clock."""
    begun: list[float] = []

    def measured(wire: Wire, *_: object) -> Delay:
        begun.append(wire.now)
        if ends is None:
            os.kill(os.getpid(), signal.SIGINT)
            threading.Event().wait(5.0)
        if isinstance(ends, BaseException):
            raise ends
        assert isinstance(ends, Delay)
        return ends

    monkeypatch.setattr("host.commands.calibrate_delay.measured_delay", measured)
    return begun


# ---- before anything moves -----------------------------------------------------------------------


@pytest.mark.usefixtures("camera")
def test_without_a_terminal_and_without_consent_nothing_moves(
    cli: Cli, board: FakeFirmware, tmp_path: Path
) -> None:
    file = tmp_path / "machine.yaml"
    code, _, err = cli(*CALIBRATE, "--port", board.port, "--vehicle", str(file))
    assert code == EXIT_USER
    assert "--yes" in err
    assert not board.moved
    assert not file.exists()


@pytest.mark.usefixtures("camera")
@pytest.mark.parametrize(
    ("typed", "countdown", "said"),
    [
        (("no\n",), "0", "not started; nothing has moved"),
        (("start\n", "\n"), "3", "broken off before the start; nothing has moved"),
    ],
)
def test_what_is_refused_or_broken_off_moves_nothing(
    cli: Cli,
    board: FakeFirmware,
    terminal: Terminal,
    monkeypatch: pytest.MonkeyPatch,
    typed: tuple[str, ...],
    countdown: str,
    said: str,
) -> None:
    monkeypatch.setattr("sys.stdin", terminal.stdin)
    begun = drives(monkeypatch, FOUND)
    for at_s, text in enumerate(typed):
        threading.Timer(at_s, terminal.type, [text]).start()
    code, out, err = cli(*CALIBRATE, "--countdown", countdown, "--port", board.port)
    assert code == EXIT_USER
    assert said in err
    assert "4.5 m ahead at 0.3 m/s" in out
    assert "nobody within 10 m" in out
    assert "emergency stop" in out
    assert begun == []
    assert not board.moved


@pytest.mark.usefixtures("camera")
def test_the_word_starts_it(
    cli: Cli, board: FakeFirmware, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", terminal.stdin)
    begun = drives(monkeypatch, FOUND)
    terminal.type("start\n")
    code, _, err = cli(*CALIBRATE, "--port", board.port)
    assert code == 0, err
    assert len(begun) == 1


def test_a_camera_that_sends_nothing_is_told_and_nothing_moves(
    cli: Cli, board: FakeFirmware, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("host.runs.first_picture.FIRST_PICTURE_S", 0.3)
    code, out, err = cli(*CALIBRATE, "--yes", "--port", board.port)
    assert code == EXIT_USER
    assert "no picture from the camera" in err
    assert "starts" not in out
    assert not board.moved


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--vehicle", "/proc/x.yaml"), "cannot write into /proc"),
        (("--vehicle", "/no/such/folder/x.yaml"), "there is no folder"),
        (("--mount", "roof"), "it has low, mast"),
        ((), "serial port /dev/none does not exist"),
        (("--camera", "gopher://x"), "scheme gopher:// is unknown"),
    ],
)
def test_what_cannot_be_is_told_before_the_port_is_opened(
    cli: Cli,
    board: FakeFirmware,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    said: str,
) -> None:
    readied: list[bool] = []
    monkeypatch.setattr(READY, lambda: readied.append(True))
    port = board.port if words else "/dev/none"
    code, _, err = cli(*CALIBRATE, "--yes", "--port", port, *words)
    assert code == EXIT_USER
    assert said in err
    assert readied == []
    assert board.received == []


# ---- what it leaves ------------------------------------------------------------------------------


@pytest.mark.usefixtures("camera")
@pytest.mark.parametrize("there", [False, True])
def test_the_delay_goes_into_the_machines_file_and_nothing_else_changes(
    cli: Cli, board: FakeFirmware, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: bool
) -> None:
    drives(monkeypatch, FOUND)
    file = tmp_path / "machine.yaml"
    if there:
        file.write_text("wheelbase_m: 1.07\ncamera_delay_s: 0.3\n")
    before = load_vehicle(file if there else None)
    given = ("--yes", "--port", board.port, "--vehicle", str(file))
    code, out, err = cli(*CALIBRATE, *given)
    assert code == 0, err
    assert "0.234 s late, standard deviation 0.021 s" in out
    assert (f"{file} said 0.300 s" if there else "without a file it is taken for 0.100 s") in out
    after = load_vehicle(file)
    assert after.camera_delay_s == 0.234
    assert after.model_copy(update={"camera_delay_s": before.camera_delay_s}) == before


@pytest.mark.usefixtures("camera")
def test_without_a_file_it_says_what_to_write(
    cli: Cli, board: FakeFirmware, monkeypatch: pytest.MonkeyPatch
) -> None:
    drives(monkeypatch, FOUND)
    code, out, _ = cli(*CALIBRATE, "--yes", "--port", board.port)
    assert code == 0
    assert "camera_delay_s: 0.234" in out


@pytest.mark.usefixtures("camera")
@pytest.mark.parametrize(
    ("ends", "code"),
    [
        (UserError("the pictures do not turn"), EXIT_USER),
        (FaultError("the camera is lost"), EXIT_FAULT),
        (None, EXIT_INTERRUPTED),
    ],
)
def test_a_drive_that_fails_leaves_the_file_and_a_machine_that_says_it_stands(
    cli: Cli,
    board: FakeFirmware,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    ends: BaseException | None,
    code: int,
) -> None:
    drives(monkeypatch, ends)
    file = tmp_path / "machine.yaml"
    file.write_text("camera_delay_s: 0.3  # by the app\n")
    found = cli(*CALIBRATE, "--yes", "--port", board.port, "--vehicle", str(file))
    assert found[0] == code
    assert "stopped: the firmware confirms" in found[1]
    assert (str(ends) if ends is not None else "interrupted") in found[2]
    assert board.wait_for(protocol.Stop)
    assert file.read_text() == "camera_delay_s: 0.3  # by the app\n"


@pytest.mark.usefixtures("camera")
def test_a_board_that_does_not_confirm_the_stop_is_told(
    cli: Cli, board: FakeFirmware, monkeypatch: pytest.MonkeyPatch
) -> None:
    drives(monkeypatch, UserError("x"))
    board.telemetry = replace(RESTING, state=protocol.State.RUNNING)
    _, out, err = cli(*CALIBRATE, "--yes", "--port", board.port)
    assert "STOP is not confirmed: press the emergency stop" in err
    assert "confirms" not in out
