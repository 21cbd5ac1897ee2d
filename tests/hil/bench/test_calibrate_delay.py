"""Facts about `daranti calibrate delay` itself, on the rig: a real serial port, a real phone's
pictures over HTTP, in wall-clock time. The firmware is the compiled one."""

from __future__ import annotations

import math
import os
import pty
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from hil.firmware import targets
from hil.scenario.scenario import load
from host.core.errors import EXIT_FAULT, EXIT_INTERRUPTED, EXIT_USER
from host.core.vehicle_file import load_vehicle
from host.tune.weaving import LOST_S, WEAVE_MPS
from sim_plant.phone import Phone, PhoneSpec
from tests.helpers.rig_process import ROOT, Rig
from tests.helpers.yard import WIDTH, far_scene

pytestmark = [
    pytest.mark.skipif(
        not targets.DESK_LIBRARY.exists(), reason="needs the desk firmware: make build"
    ),
    pytest.mark.wallclock,
]

SCENARIO = """
seed: 31
lens: {delay_s: 0.17}
field: {size_m: [8.0, 8.0], neighbours: none}
"""
OUTSIDE = {"x": -3.0, "y": 4.0, "yaw": math.pi}
"""Beside the field, heading away from it."""
TELL_S = 0.05
"""What the found delay may be off."""
COASTS_M = 0.15
"""What the machine rolls on."""
LIMIT_S = 120.0


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    folder = tmp_path_factory.mktemp("yard")
    (folder / "yard.yaml").write_text(SCENARIO)
    found = Rig(str(folder / "yard.yaml"), folder)
    yield found
    found.close()


@pytest.fixture
def machine(rig: Rig) -> Rig:
    """On free ground, its camera on."""
    rig.do("see")
    rig.do("put", **OUTSIDE)
    return rig


class Command:
    """`daranti calibrate delay` as a process at a terminal of its own."""

    def __init__(self, rig: Rig, file: Path, *options: str, camera: str | None = None) -> None:
        self.master, slave = pty.openpty()
        program = "from host.commands.cli import main; main()"
        words = ["calibrate", "delay", "--port", rig.about["port"], "--vehicle", str(file)]
        words += ["--camera", camera or rig.about["camera"], "--countdown", "1", *options]
        self.process = subprocess.Popen(
            [sys.executable, "-c", program, *words],
            stdin=slave,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            env=os.environ | {"PYTHONUNBUFFERED": "1", "TERM": "dumb"},
        )
        os.close(slave)
        self.said = ""

    def until(self, words: str) -> None:
        """Reads what it says up to these words."""
        assert self.process.stdout is not None
        while words not in self.said:
            line = self.process.stdout.readline()
            assert line, self.said + self.process.communicate()[1]
            self.said += line

    def drives(self, rig: Rig, from_m: float) -> None:
        """Waits until the machine has come a foot from there."""
        end = time.monotonic() + LIMIT_S
        while rig.do()["distance_m"] < from_m + 0.3:
            assert self.process.poll() is None, self.ended()
            assert time.monotonic() < end
            time.sleep(0.1)

    def type(self, text: str) -> None:
        os.write(self.master, text.encode())

    def ended(self) -> tuple[int, str, str]:
        """(exit code, all of stdout, stderr)."""
        out, err = self.process.communicate(timeout=LIMIT_S)
        os.close(self.master)
        return self.process.returncode, self.said + out, err


def test_the_delay_that_the_scenario_has_is_found_and_written(machine: Rig, tmp_path: Path) -> None:
    file = tmp_path / "machine.yaml"
    file.write_text(Path(machine.about["vehicle"]).read_text())
    before = load_vehicle(file)
    begun = machine.do()
    command = Command(machine, file)
    command.until("type start")
    assert machine.do()["distance_m"] == begun["distance_m"]
    command.type("start\n")
    code, out, err = command.ended()
    assert code == 0, out + err
    true = load("default", {"lens": {"delay_s": 0.17}}).world.lens.delay_s
    after = load_vehicle(file)
    assert after.camera_delay_s == pytest.approx(true, abs=TELL_S)
    assert after.model_copy(update={"camera_delay_s": before.camera_delay_s}) == before
    assert f"{after.camera_delay_s:.3f} s late" in out
    assert f"said {before.camera_delay_s:.3f} s" in out
    assert "stopped: the firmware confirms" in out
    assert "weaving" in err
    truth = machine.do()
    assert truth["blade_seen"] == 0
    assert not truth["driven"]
    assert truth["distance_m"] - begun["distance_m"] == pytest.approx(4.5, abs=0.5)


def test_without_the_word_no_motor_is_driven(machine: Rig, tmp_path: Path) -> None:
    begun = machine.do()
    command = Command(machine, tmp_path / "machine.yaml")
    command.until("type start")
    command.type("yes please\n")
    code, out, err = command.ended()
    assert code == EXIT_USER, out + err
    assert "nothing has moved" in err
    truth = machine.do()
    assert truth["driven_seen"] == begun["driven_seen"]
    assert truth["distance_m"] == begun["distance_m"]
    assert not (tmp_path / "machine.yaml").exists()


def test_ctrl_c_stops_it_at_once(machine: Rig, tmp_path: Path) -> None:
    begun = machine.do()
    command = Command(machine, tmp_path / "machine.yaml", "--yes")
    command.drives(machine, begun["distance_m"])
    command.process.send_signal(signal.SIGINT)
    asked_at = time.time()
    code, out, err = command.ended()
    assert code == EXIT_INTERRUPTED, out + err
    assert "stopped: the firmware confirms" in out
    truth = machine.do()
    assert not truth["driven"]
    assert truth["off_at"] - asked_at < 0.5
    assert truth["distance_m"] - begun["distance_m"] < 1.0
    assert not (tmp_path / "machine.yaml").exists()


def test_a_camera_that_is_lost_on_the_way_ends_it(machine: Rig, tmp_path: Path) -> None:
    begun = machine.do()
    command = Command(machine, tmp_path / "machine.yaml", "--yes")
    command.drives(machine, begun["distance_m"])
    gone = machine.do("blind")
    code, out, err = command.ended()
    assert code == EXIT_FAULT, out + err
    assert "the camera is lost on the way" in err
    rolled = machine.do()["distance_m"] - gone["distance_m"]
    assert rolled < WEAVE_MPS * (LOST_S + 0.5) + COASTS_M
    assert not (tmp_path / "machine.yaml").exists()


def test_the_emergency_stop_ends_it_and_is_named(machine: Rig, tmp_path: Path) -> None:
    begun = machine.do()
    command = Command(machine, tmp_path / "machine.yaml", "--yes")
    command.drives(machine, begun["distance_m"])
    machine.do("press")
    code, out, err = command.ended()
    machine.do("release")
    assert code == EXIT_FAULT, out + err
    assert "emergency-stop loop open" in err


# ---- another camera on the machine ---------------------------------------------------------------


@contextmanager
def phone(pictures: Iterator[Any]) -> Iterator[str]:
    """A phone's stream of these pictures, ten a second; its address."""
    ended = threading.Event()

    def show(server: Phone) -> None:
        for bgr in pictures:
            server.show(cv2.imencode(".jpg", bgr)[1].tobytes())
            if ended.wait(0.1):
                return

    with Phone(PhoneSpec(http_port=0, nmea_port=0, delay_s=0.0)) as server:
        thread = threading.Thread(target=show, args=(server,), daemon=True)
        thread.start()
        yield server.camera_url
        ended.set()
        thread.join()


def for_ever(bgr: Any, noise: int) -> Iterator[Any]:
    """One picture, with the sensor's noise."""
    rng = np.random.default_rng(1)
    while True:
        grain = rng.integers(-noise, noise + 1, bgr.shape)
        yield np.clip(bgr + grain, 0, 255).astype(np.uint8)


def test_a_covered_camera_is_told_before_any_motor_is_driven(machine: Rig, tmp_path: Path) -> None:
    begun = machine.do()
    with phone(for_ever(0 * far_scene(WIDTH), 8)) as address:
        command = Command(machine, tmp_path / "machine.yaml", "--yes", camera=address)
        code, out, err = command.ended()
    assert code == EXIT_USER, out + err
    assert "shows nothing: dark, blinded or covered; nothing has moved" in err
    assert machine.do()["driven_seen"] == begun["driven_seen"]


@pytest.mark.parametrize(
    ("noise", "code", "said", "rolls_m"),
    [(0, EXIT_FAULT, "repeats its picture", 1.0), (4, EXIT_USER, "do not turn as", 5.0)],
)
def test_a_camera_that_shows_a_still_picture_is_told(
    machine: Rig, tmp_path: Path, noise: int, code: int, said: str, rolls_m: float
) -> None:
    begun = machine.do()
    with phone(for_ever(far_scene(WIDTH), noise)) as address:
        command = Command(machine, tmp_path / "machine.yaml", "--yes", camera=address)
        found, out, err = command.ended()
    assert found == code, out + err
    assert said in err
    assert machine.do()["distance_m"] - begun["distance_m"] < rolls_m
    assert not (tmp_path / "machine.yaml").exists()
