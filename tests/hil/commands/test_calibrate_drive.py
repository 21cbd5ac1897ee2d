"""Facts about `daranti calibrate drive`, on a machine of other motors behind a serial port."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest
import yaml

from hil.firmware import targets
from hil.scenario.scenario import changed, load
from host.core.errors import EXIT_USER
from host.core.vehicle import Vehicle
from host.core.vehicle_file import load_vehicle, save_vehicle
from sim_plant.drive_response import drive_response
from tests.helpers.rig_process import ROOT, Rig
from tests.helpers.terminal import Terminal

pytestmark = [
    pytest.mark.skipif(
        not targets.DESK_LIBRARY.exists(), reason="needs the desk firmware: make build"
    ),
    pytest.mark.wallclock,
]

FREE_GROUND: Final = {"x": -9.0, "y": 1.0, "yaw": math.pi / 2}
LIMIT_S: Final = 180.0
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


class Command:
    """The command as a process at a terminal of its own."""

    def __init__(self, rig: Rig, file: Path, *options: str) -> None:
        self.terminal = Terminal()
        main = "from host.commands.cli import main; main()"
        words = ["calibrate", "drive", "--port", rig.about["port"], "--vehicle", str(file)]
        self.process = subprocess.Popen(
            [sys.executable, "-uc", main, *words, "--countdown", "1", *options],
            stdin=self.terminal.stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )

    def until(self, words: str) -> None:
        """Reads what it says up to these words."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if words in line:
                return
        raise AssertionError(self.process.communicate()[1])

    def type(self, words: object) -> None:
        self.terminal.type(f"{words}\n")

    def ended(self) -> tuple[int, str, str]:
        """(exit code, the rest of stdout, stderr)."""
        out, err = self.process.communicate(timeout=LIMIT_S)
        self.terminal.close()
        return self.process.returncode, out, err


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    folder = tmp_path_factory.mktemp("yard")
    (folder / "machine.yaml").write_text(yaml.safe_dump(WORLD))
    found = Rig(str(folder / "machine.yaml"), folder)
    yield found
    found.close()


def test_a_tape_and_four_ways_tell_what_the_drive_is(rig: Rig, tmp_path: Path) -> None:
    file = tmp_path / "vehicle.yaml"
    save_vehicle(file, Vehicle(cutting_speed_mps=0.9))
    true = drive_response(changed(load("default"), WORLD).world.machine, 12.0)
    x, y, yaw = rig.do("put", **FREE_GROUND)["pose"]
    command = Command(rig, file, "--length", "8", "--save")
    command.until("type start")
    command.type("start")
    command.until("along the line, m?")
    pose = rig.do()["pose"]
    dx, dy = pose[0] - x, pose[1] - y
    command.type("eight or so")
    command.until("along the line, m?")
    command.type(round(dx * math.cos(yaw) + dy * math.sin(yaw), 2))
    command.until("left of the line, m?")
    command.type(round(dy * math.cos(yaw) - dx * math.sin(yaw), 2))
    command.until("starts in 1 s")
    assert rig.do()["pose"] == pytest.approx(pose, abs=0.01), "it waits for who taped"
    code, said, err = command.ended()
    assert code == 0, err
    assert said.count("starts in 1 s") == 2
    assert "saved in the firmware" in said
    assert "stopped: the firmware confirms" in said
    found = load_vehicle(file)
    assert found.full_duty_speed_mps == pytest.approx(true.full_mps, rel=0.04)
    assert found.dead_duty == pytest.approx(true.dead, abs=0.015)
    assert found.drive_lag_s == pytest.approx(true.lag_s, rel=0.3)
    # tyres slip by what they push: 59 N of rolling of 3000 N
    assert found.hall_pulses_per_m == pytest.approx(64.0 / (1 - 59 / 3000), rel=0.015)
    assert found.cutting_speed_mps == 0.9, "the rest of the file stays"
    told = rig.do()
    assert math.dist(told["pose"][:2], (x, y)) < 1.0, "it ends where it began"
    assert told["blade_seen"] == 0


def test_without_consent_nothing_moves(rig: Rig, tmp_path: Path) -> None:
    file = tmp_path / "vehicle.yaml"
    before = rig.do("put", **FREE_GROUND)
    command = Command(rig, file)
    command.until("type start")
    command.type("no")
    code, _, err = command.ended()
    after = rig.do()
    assert code == EXIT_USER
    assert "nothing has moved" in err
    assert after["off_at"] == before["off_at"]
    assert after["distance_m"] == before["distance_m"]
    assert not file.exists()
