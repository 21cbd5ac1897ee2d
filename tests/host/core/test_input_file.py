"""Facts about files that are read: what would never end is refused, what can be read is read."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import NoReturn

import pytest

from host.core.errors import EXIT_UNFINISHED, EXIT_USER, UserError
from host.core.input_file import check_input, is_piped
from host.core.vehicle_file import load_vehicle
from tests.helpers.console import Cli
from tests.helpers.fake_firmware import FakeFirmware
from tests.helpers.walker import around, walk

LIMIT_S = 60


@pytest.fixture(autouse=True)
def _ends() -> Iterator[None]:
    """What waits for ever is a failure, not a test that never ends."""

    def late(_signal: int, _frame: FrameType | None) -> NoReturn:
        raise TimeoutError("it waits")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(LIMIT_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def test_what_never_ends_is_told_by_its_kind(tmp_path: Path) -> None:
    pipe, plug = tmp_path / "pipe", tmp_path / "socket"
    os.mkfifo(pipe)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(plug))
        for path, kind in ((pipe, "a pipe"), (plug, "a socket"), (Path("/dev/zero"), "a device")):
            with pytest.raises(UserError, match=f"^the walk {path} is {kind}, not a file"):
                check_input(path, "the walk")
    check_input(tmp_path, "the walk")
    check_input(tmp_path / "none", "the walk")
    check_input(Path("a\0b"), "the walk")


def test_a_shells_pipe_is_read_once() -> None:
    read, write = os.pipe()
    os.write(write, b"wheelbase_m: 1.25\n")
    os.close(write)
    try:
        path = Path(f"/dev/fd/{read}")
        assert is_piped(path)
        with pytest.raises(UserError, match="is a pipe"):
            check_input(path, "the record", once=False)
        assert load_vehicle(path).wheelbase_m == 1.25
    finally:
        os.close(read)


COMMANDS = (
    "plan FILE",
    "plan --vehicle FILE none.geojson",
    "convert FILE out.geojson",
    "survey FILE --out out.geojson",
    "survey walk.nmea --keep-out FILE --out out.geojson",
    "params load FILE",
    "params diff FILE",
    "see FILE --side left",
    "see FILE.jpg --side left",
    "see FILE.mcap",
    "see x.jpg --manifest FILE",
    "tune pid --model FILE --dry-run",
    "tune follow --vehicle FILE",
    "tune vision FILE",
    "calibrate camera FILE",
    "calibrate delay --camera FILE",
    "calibrate delay --camera http://127.0.0.1:1/video --vehicle FILE",
    "drive --camera FILE",
    "drive --camera http://127.0.0.1:1/video --gnss FILE",
    "drive --camera http://127.0.0.1:1/video --resume FILE",
    "drive --camera http://127.0.0.1:1/video --boundary FILE",
)


@pytest.mark.parametrize("words", COMMANDS)
def test_no_command_waits_for_a_pipe_that_nobody_writes(
    words: str, cli: Cli, board: FakeFirmware, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("walk.nmea").write_text("\n".join(walk(around([(0, 0), (20, 0), (20, 20)]))))
    for suffix in ("", ".jpg", ".mcap"):
        os.mkfifo(f"pipe{suffix}")
    spoken_to = ("params", "drive", "tune pid", "calibrate delay")
    port = ["--port", board.port] if words.startswith(spoken_to) else []
    code, _, err = cli(*words.replace("FILE", "pipe").split(), *port)
    assert code in (EXIT_USER, EXIT_UNFINISHED)
    assert "pipe" in err
    assert "internal error" not in err


def test_a_walk_may_come_through_standard_input(tmp_path: Path) -> None:
    corners: list[tuple[float, float]] = [(0, 0), (20, 0), (20, 20), (0, 20)]
    text = "\r\n".join(walk(around(corners)))
    program = "from host.commands.cli import main; main()"
    out = tmp_path / "field.geojson"
    command = [sys.executable, "-c", program, "survey", "/dev/stdin", "--out", str(out)]
    done = subprocess.run(command, input=text.encode(), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert out.exists()
