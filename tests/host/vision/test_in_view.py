"""Facts about mounts that can show what the detectors look for, and mounts that cannot."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.scenario.drawn_machine import drawn_lens, drawn_machine
from host.core.errors import UserError
from host.core.vehicle import LOW, MAST, Mount, Vehicle
from host.core.vehicle_file import save_vehicle
from host.vision.mounted.detector import Mode, make_detector
from host.vision.mounted.in_view import seeing_mount
from tests.helpers.console import Cli

GREY = np.full((480, 640, 3), 128, np.uint8)


@pytest.mark.parametrize(
    "wrong",
    [
        {"pitch_deg": -60.0},
        {"pitch_deg": 90.0},
        {"yaw_deg": 180.0},
        {"centre_px": (5000.0, 100.0)},
        {"x_m": 2.5},
    ],
    ids=["at the sky", "straight down", "backwards", "a slip of the pen", "ahead of the blade"],
)
@pytest.mark.parametrize("mode", ["robust", "paper"])
def test_a_mount_that_cannot_show_the_crop_is_told(mode: Mode, wrong: dict[str, Any]) -> None:
    with pytest.raises(UserError, match="the camera cannot show the blade's way"):
        make_detector(mode, Vehicle(), MAST.model_copy(update=wrong))


@pytest.mark.parametrize("mode", ["robust", "paper"])
@pytest.mark.parametrize("roll_deg", [0.0, 180.0])
@pytest.mark.parametrize("mount", [LOW, MAST], ids=["low", "mast"])
def test_the_drawings_mounts_can_upside_down_too(mode: Mode, mount: Mount, roll_deg: float) -> None:
    turned = mount.model_copy(update={"roll_deg": roll_deg})
    assert make_detector(mode, Vehicle(), turned).see(GREY).confidence < 0.5


@pytest.mark.parametrize("name", ["low", "mast"])
def test_every_drawn_machines_own_mount_can(name: str) -> None:
    for seed in range(200):
        machine = drawn_machine(seed)
        lens = {k: v for k, v in drawn_lens(seed, name, machine).items() if k not in ("k1", "k2")}
        mount = (LOW if name == "low" else MAST).model_copy(update=lens)
        vehicle = Vehicle(
            wheelbase_m=machine.wheelbase_m,
            half_width_m=machine.half_width_m,
            blade_width_m=machine.blade_width_m,
            blade_ahead_m=machine.blade_ahead_m,
            hall_left_m=machine.drive.hall_left_m,
            mounts={name: mount},
        )
        assert seeing_mount(vehicle, name) == mount


@pytest.mark.parametrize(
    "command",
    [
        ("drive", "--camera", "http://127.0.0.1:1/video", "--yes"),
        ("check", "--camera", "http://127.0.0.1:1/video"),
        ("panel",),
    ],
    ids=lambda command: command[0],
)
def test_a_command_says_it_before_it_opens_anything(
    tmp_path: Path, cli: Cli, command: tuple[str, ...]
) -> None:
    sky = MAST.model_copy(update={"pitch_deg": -60.0})
    save_vehicle(path := tmp_path / "machine.yaml", Vehicle(mounts={"mast": sky}))
    board, terminal = os.openpty()
    code, _, err = cli(*command, "--port", os.ttyname(terminal), "--vehicle", str(path))
    os.close(board)
    os.close(terminal)
    assert code == 2
    assert "pitch_deg -60" in err
