"""Facts about files that are written: whole or not at all, and one message where they cannot be."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from host.core.errors import EXIT_USER, UserError
from host.core.whole_file import save_text, saved
from host.runs.record import Recorder
from tests.helpers.fake_firmware import RESTING, FakeFirmware
from tests.helpers.walker import around, walk

LIMIT_S = 300.0
SMALL_BYTES = 40
"""No file that a command writes is so small."""


def test_what_stood_there_stands_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    save_text(path, "old")
    with pytest.raises(UserError, match=rf"cannot write {path}: No space left"), saved(path) as new:
        new.write_text("half")
        assert path.read_text() == "old"
        raise OSError(5, "No space left")
    with pytest.raises(ValueError, match="x"), saved(path):
        raise ValueError("x")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    with saved(path) as new:
        assert new.suffix == path.suffix
        new.write_text("new")
    assert path.read_text() == "new"


def test_a_link_stays_one_and_a_device_is_not_replaced(tmp_path: Path) -> None:
    link, file = tmp_path / "link", tmp_path / "file"
    link.symlink_to(file)
    save_text(link, "text")
    assert link.is_symlink()
    assert file.read_text() == "text"
    full = tmp_path / "full"
    full.symlink_to("/dev/full")
    with pytest.raises(UserError, match=f"cannot write {full}: the disk is full; free some of it"):
        save_text(full, "text")
    assert Path("/dev/full").is_char_device()
    with pytest.raises(UserError, match="No such file or directory"):
        save_text(tmp_path / "none" / "file", "text")


def cramped() -> None:
    """In the child: no file may grow."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (SMALL_BYTES, SMALL_BYTES))


@pytest.fixture
def inputs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a walk, a field and a record."""
    monkeypatch.chdir(tmp_path)
    corners: list[tuple[float, float]] = [(0, 0), (20, 0), (20, 20), (0, 20)]
    Path("walk.nmea").write_text("\r\n".join(walk(around(corners))))
    degrees = [(74.3 + x / 95_000, 31.5 + y / 111_000) for x, y in [*corners, corners[0]]]
    shape = {"type": "Polygon", "coordinates": [degrees]}
    Path("field.geojson").write_text(json.dumps(shape))
    with Recorder(Path("drive.mcap")) as recorder:
        for k in range(30):
            recorder.put("/telemetry", k / 10, telemetry())
            recorder.put(
                "/pilot", k / 10, {"phase": "follow", "reason": "", "x_m": 0.1 * k, "y_m": 0}
            )
    return tmp_path


def telemetry() -> dict[str, object]:
    zeros = dict.fromkeys(("setpoint_rad", "angle_rad", "steer_duty", "drive_duty", "faults"), 0)
    return {"state": "SAFE", "battery_v": RESTING.battery, **zeros}


COMMANDS = (
    ("host", "params export out.yaml --port PORT"),
    ("host", "survey walk.nmea --out out.geojson"),
    ("host", "convert field.geojson out.kml"),
    ("hil", "plot drive.mcap"),
    ("hil", "report drive.mcap"),
)


@pytest.mark.parametrize(("room", "words"), COMMANDS, ids=[words for _, words in COMMANDS])
def test_a_file_that_cannot_be_written_is_one_message_and_leaves_nothing(
    room: str, words: str, inputs: Path, board: FakeFirmware
) -> None:
    before = {path.name: path.read_bytes() for path in inputs.iterdir()}
    program = f"from {room}.commands.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program, *words.replace("PORT", board.port).split()],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
        preexec_fn=cramped,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
    )
    assert done.returncode == EXIT_USER, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith(("daranti: cannot write ", "daranti-hil: cannot write "))
    assert "Traceback" not in done.stderr
    assert {path.name: path.read_bytes() for path in inputs.iterdir()} == before
