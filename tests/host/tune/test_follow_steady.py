"""Facts about vehicle files whose machine would swing instead of following the edge."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from host.core.errors import UserError
from host.core.vehicle import Vehicle
from host.core.vehicle_file import save_vehicle
from host.tune.follow_margins import LEAST_DEG, at_cutting_speed, check_steady
from tests.helpers.console import Cli

SWINGING: dict[str, dict[str, Any]] = {
    "a decimal point in the frequency": {"follow_frequency_1pm": 11.4},
    "a decimal point in the damping": {"follow_damping": 0.092},
    "not stable at all": {"follow_frequency_1pm": 20.0, "follow_damping": 0.01},
}


@pytest.mark.parametrize("wrong", SWINGING.values(), ids=SWINGING)
def test_a_slip_that_makes_it_swing_is_told(wrong: dict[str, Any]) -> None:
    with pytest.raises(UserError, match="would swing instead of following the edge"):
        check_steady(Vehicle(**wrong))


@pytest.mark.parametrize(
    ("law", "speed_mps"),
    [
        *(("state", v) for v in (0.15, 0.5, 1.0, 2.0, 3.0)),
        ("proportional", 0.15),
        ("proportional", 1),
    ],
)
def test_the_defaults_are_steady(law: Any, speed_mps: float) -> None:
    vehicle = Vehicle(steering_law=law, cutting_speed_mps=speed_mps)
    check_steady(vehicle)
    assert at_cutting_speed(vehicle).phase_deg > LEAST_DEG


@pytest.mark.parametrize(
    "command",
    [("drive", "--camera", "http://127.0.0.1:1/video", "--yes"), ("check",), ("panel",)],
    ids=lambda command: command[0],
)
def test_what_drives_says_it_before_it_opens_anything(
    tmp_path: Path, cli: Cli, command: tuple[str, ...]
) -> None:
    save_vehicle(path := tmp_path / "machine.yaml", Vehicle(follow_frequency_1pm=11.4))
    board, terminal = os.openpty()
    code, _, err = cli(*command, "--port", os.ttyname(terminal), "--vehicle", str(path))
    os.close(board)
    os.close(terminal)
    assert code == 2
    assert "phase margin 12 degrees" in err
