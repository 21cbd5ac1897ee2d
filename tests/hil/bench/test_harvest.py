"""Facts about harvests in lockstep: what they depend on, and what they do not."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest

from hil.bench.harvest import Harvest, harvest
from hil.commands.harvest import harvest_command
from hil.firmware import targets
from hil.scenario.scenario import Scenario
from host.runs.record import read
from tests.helpers.oracle import Oracle, quick

pytestmark = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built: make build"
)


def digest(path: Path, scenario: Scenario, **more: Any) -> str:
    run = Harvest(scenario, path, **more)
    run.run()
    run.close()
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_the_same_seed_gives_the_same_record_byte_for_byte(tmp_path: Path) -> None:
    """With the real camera and the real vision, whatever the number of the camera's threads."""
    lens = {"width_px": 320, "height_px": 240}
    scenario = quick(lens=lens, limits={"time_s": 4.0}, record={"pictures_every": 1})
    one = digest(tmp_path / "one.mcap", scenario, camera_threads=1)
    assert one == digest(tmp_path / "two.mcap", scenario, camera_threads=2)


def test_another_seed_gives_another_record(tmp_path: Path) -> None:
    one, other = (
        digest(tmp_path / f"{seed}.mcap", quick(limits={"time_s": 1.0}, seed=seed))
        for seed in (1, 2)
    )
    assert one != other


def test_a_side_is_cut_and_the_machine_turns(tmp_path: Path) -> None:
    run = Harvest(quick(limits={"time_s": 25.0}), tmp_path / "r.mcap", detector=Oracle)
    run.run()
    run.close()
    assert run.pilot.turns == 1
    assert run.truth.summary()["neighbour_cut_m2"] == 0
    assert 0.15 < run.bench.field.coverage() < 0.4


def test_the_pilot_is_told_how_the_phone_lies(tmp_path: Path) -> None:
    """The default machine's camera looks down by its mount's pitch, on next to level ground."""
    chosen = quick(limits={"time_s": 3.0})
    run = Harvest(chosen, tmp_path / "r.mcap", detector=Oracle)
    run.run()
    run.close()
    told = [m["nose_up_rad"] for topic, _, m in read(tmp_path / "r.mcap") if topic == "/turned"]
    down_deg = chosen.world.lens.pitch_deg
    assert len(told) > 20
    assert math.degrees(np.mean(told)) == pytest.approx(-down_deg, abs=4.0)


def test_a_run_leaves_what_it_promises(tmp_path: Path) -> None:
    summary = harvest(quick(limits={"time_s": 2.0}), tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    pictures = {"map.png", "decisions.png", "steering.png", "camera.mp4"}
    assert names == pictures | {"summary.json", "events.json", "record.mcap"}
    assert summary["simulated_s"] == 2.0
    assert {"coverage", "missed_m2", "neighbour_cut_m2", "outside_m", "false_ends"} <= set(summary)


def test_every_option_of_the_command_is_a_field_of_the_scenario() -> None:
    fields = set(Scenario.model_fields)
    inside = {"hour": "weather", "film": "record", "live": "record"}
    for option in harvest_command.params:
        assert isinstance(option, click.Option)
        name = option.name or ""
        if name not in ("name", "out", "settings"):
            assert inside.get(name, name) in fields, name
