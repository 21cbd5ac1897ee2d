"""A wrongly built machine is found out before its blade can be armed; a good one is not accused."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.studies.building_mistakes import MISTAKES, Mistake, good_machine, inspect
from host.check.lines import NAMES
from host.panel.texts import LANGUAGES, texts

QUICK = {"steering motor swapped", "camera upside down", "wrong corner"}
CHECK_S = 15 * 60
SLOW_STEERING = 114
"""Seed of a machine whose wheel turns by 26 degrees a second at 12 V."""


def names_it(mistake: Mistake, folder: Path) -> None:
    outcome = inspect(mistake, folder)
    named = set(mistake.findings) & set(outcome.findings)
    assert named, outcome.findings
    for language in LANGUAGES:
        assert {f"todo.{finding}" for finding in named} <= set(texts(language))
    assert not outcome.green
    assert not outcome.blade_armed
    assert outcome.simulated_s < CHECK_S


def test_a_good_machine_passes_every_line(tmp_path: Path) -> None:
    outcome = inspect(None, tmp_path)
    assert outcome.findings == ()
    assert outcome.green
    assert sorted(line.name for line in outcome.lines) == sorted(NAMES)
    assert not outcome.blade_armed


@pytest.mark.parametrize("mistake", [m for m in MISTAKES if m.name in QUICK], ids=lambda m: m.name)
def test_a_mistake_is_named(mistake: Mistake, tmp_path: Path) -> None:
    names_it(mistake, tmp_path)


@pytest.mark.parametrize("name", ["camera 5 degrees to the left", "camera 5 degrees to the right"])
def test_a_low_camera_that_is_turned_is_named_as_one_on_a_mast_is(
    name: str, tmp_path: Path
) -> None:
    mistake = next(m for m in MISTAKES if m.name == name)
    assert "mount.tilted" in inspect(mistake, tmp_path, {"camera": "low"}).findings


@pytest.mark.long
@pytest.mark.parametrize(
    "mistake", [m for m in MISTAKES if m.name not in QUICK], ids=lambda m: m.name
)
def test_every_mistake_is_named(mistake: Mistake, tmp_path: Path) -> None:
    names_it(mistake, tmp_path)


@pytest.mark.parametrize(
    "seed",
    [
        SLOW_STEERING,
        *(pytest.param(s, marks=pytest.mark.long) for s in range(101, 121) if s != SLOW_STEERING),
    ],
)
def test_good_machines_are_not_accused_whatever_they_are_built_of(
    seed: int, tmp_path: Path
) -> None:
    outcome = good_machine(seed, tmp_path)
    assert outcome.findings == ()
    assert outcome.green
    assert abs(outcome.off["pitch"]) < 2.0 and abs(outcome.off["yaw"]) < 1.5
    assert abs(outcome.off["roll"]) < 3.0 and abs(outcome.off["delay"]) < 0.25
    assert outcome.simulated_s < CHECK_S


@pytest.mark.parametrize(
    ("distortion", "pitch_deg", "verdict", "finding"),
    [
        ((0.0, 0.0, 0.0, 0.0, 0.0), 33.0, "warn", "mount.lens"),
        ((-0.06, 0.01, 0.0, 0.0, 0.0), 29.0, "bad", "mount.tilted"),
    ],
)
def test_what_a_lens_by_its_data_sheet_feigns_is_not_called_a_tilted_camera(
    distortion: tuple[float, ...], pitch_deg: float, verdict: str, finding: str, tmp_path: Path
) -> None:
    """The camera looks 33 degrees down through a lens of 62 that bends; its file says 66."""
    told = {"x_m": 0.0, "z_m": 1.6, "hfov_deg": 66.0, "distortion": distortion}
    mounts = {"mast": {**told, "pitch_deg": pitch_deg}}
    belief = {"errors": "exact", "vehicle": {"mounts": mounts}}
    over = {"camera": "mast", "lens": {"pitch_deg": 33.0}, "belief": belief}
    line = next(x for x in inspect(None, tmp_path, over).lines if x.name == "mount")
    assert (line.verdict, line.finding) == (verdict, finding)
