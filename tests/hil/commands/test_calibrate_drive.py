"""Facts about `daranti calibrate drive`, on a machine of other motors behind a serial port."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import pytest
import yaml

from hil.firmware import targets
from hil.scenario.scenario import load
from host.core.vehicle import Vehicle
from host.core.vehicle_file import load_vehicle, save_vehicle
from sim_plant.drive_response import drive_response

pytestmark = [
    pytest.mark.skipif(
        not targets.DESK_LIBRARY.exists(), reason="needs the desk firmware: make build"
    ),
    pytest.mark.wallclock,
]

FREE_GROUND: Final = {"x": -9.0, "y": 1.0, "yaw": math.pi / 2}
WORLD: Final[dict[str, Any]] = {
    "machine": {
        "drive": {"k_vspm": 7.5, "rolling": 0.05, "hall_pulses_per_m": 64.0},
        "steering": {"pot_centre_counts": 521.0},
    },
    "field": {"size_m": [12.0, 9.0], "neighbours": "none", "bump_sd_deg": 0.2},
    "belief": {"errors": "exact", "parameters": {
        "hall_per_metre": 60.0, "speed_full": 1.0, "drive_min_duty": 0.0,
        "pot_left": 737.0, "pot_centre": 512.0, "pot_right": 287.0,
    }},
}  # fmt: skip
"""An owner's values before: the firmware's own, and pulses a metre from ten turns by hand."""


class Person:
    """Beside the machine: does deeds, and sees what is so."""

    def __init__(self, rig: subprocess.Popen[str]) -> None:
        self._rig = rig

    def do(self, deed: str, **what: Any) -> dict[str, Any]:
        """What is so after it."""
        assert self._rig.stdin is not None
        assert self._rig.stdout is not None
        self._rig.stdin.write(json.dumps({"do": deed, **what}) + "\n")
        self._rig.stdin.flush()
        seen = json.loads(self._rig.stdout.readline())
        assert isinstance(seen, dict)
        return seen


@contextmanager
def beside(scenario: Path, out: Path) -> Iterator[tuple[Person, str]]:
    """(a person beside the machine, its serial port)."""
    command = [sys.executable, "-m", "tests.helpers.manned_rig", str(scenario), str(out)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as rig:
        assert rig.stdout is not None
        port = json.loads(rig.stdout.readline())["port"]
        try:
            yield Person(rig), port
        finally:
            rig.kill()


def run(port: str, vehicle: Path, *options: str) -> subprocess.Popen[str]:
    """The command."""
    main = "from host.commands.cli import main; main()"
    command = [sys.executable, "-uc", main, "calibrate", "drive", "--port", port]
    return subprocess.Popen(
        [*command, "--vehicle", str(vehicle), *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def until(host: subprocess.Popen[str], *words: str) -> str:
    """What is said, up to one of these words; a question ends no line."""
    assert host.stdout is not None
    said = ""
    while not any(said.endswith(word) for word in words):
        letter = host.stdout.read(1)
        assert letter, f"it ended: {said} {host.stderr.read() if host.stderr else ''}"
        said += letter
    return said


def answer(host: subprocess.Popen[str], words: object) -> None:
    """Types a line."""
    assert host.stdin is not None
    host.stdin.write(f"{words}\n")
    host.stdin.flush()


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """The machine."""
    path = tmp_path / "machine.yaml"
    path.write_text(yaml.safe_dump(WORLD))
    return path


def test_a_tape_and_four_ways_tell_what_the_drive_is(scenario: Path, tmp_path: Path) -> None:
    file = tmp_path / "vehicle.yaml"
    save_vehicle(file, Vehicle(cutting_speed_mps=0.9))
    true = drive_response(load(str(scenario), {}).world.machine, 12.0)
    with beside(scenario, tmp_path / "rig") as (person, port):
        x, y, yaw = person.do("put", **FREE_GROUND)["pose"]
        host = run(port, file, "--length", "8", "--save")
        until(host, "May it drive? [y/N]: ")
        answer(host, "y")
        until(host, "line, m: ")
        pose = person.do("look")["pose"]
        dx, dy = pose[0] - x, pose[1] - y
        answer(host, round(dx * math.cos(yaw) + dy * math.sin(yaw), 2))
        until(host, "[0.0]: ")
        answer(host, round(dy * math.cos(yaw) - dx * math.sin(yaw), 2))
        said, err = host.communicate(timeout=120)
        told = person.do("look")
    assert host.returncode == 0, err
    assert "saved in the firmware" in said
    found = load_vehicle(file)
    assert found.full_duty_speed_mps == pytest.approx(true.full_mps, rel=0.04)
    assert found.dead_duty == pytest.approx(true.dead, abs=0.015)
    assert found.drive_lag_s == pytest.approx(true.lag_s, rel=0.3)
    assert found.hall_pulses_per_m == pytest.approx(64.0, rel=0.02)
    assert found.cutting_speed_mps == 0.9, "the rest of the file stays"
    assert math.dist(told["pose"][:2], (x, y)) < 1.0, "it ends where it began"
    assert told["blade_seen"] == 0


def test_without_consent_nothing_moves(scenario: Path, tmp_path: Path) -> None:
    file = tmp_path / "vehicle.yaml"
    with beside(scenario, tmp_path / "rig") as (person, port):
        before = person.do("put", **FREE_GROUND)
        host = run(port, file)
        until(host, "May it drive? [y/N]: ")
        answer(host, "n")
        host.communicate(timeout=30)
        after = person.do("look")
    assert host.returncode != 0
    assert after["off_at"] == before["off_at"]
    assert after["pose"] == pytest.approx(before["pose"], abs=1e-3)
    assert not file.exists()
