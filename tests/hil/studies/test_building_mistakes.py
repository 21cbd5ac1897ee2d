"""A wrongly built machine is found out before its blade can be armed; a good one is not accused."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.studies.building_mistakes import MISTAKES, Mistake, inspect
from host.check.lines import NAMES
from host.panel.texts import LANGUAGES, texts

QUICK = {"steering motor swapped", "camera upside down", "wrong corner"}
CHECK_S = 15 * 60


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


@pytest.mark.long
@pytest.mark.parametrize(
    "mistake", [m for m in MISTAKES if m.name not in QUICK], ids=lambda m: m.name
)
def test_every_mistake_is_named(mistake: Mistake, tmp_path: Path) -> None:
    names_it(mistake, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(101, 121))
def test_good_machines_are_not_accused(seed: int, tmp_path: Path) -> None:
    outcome = inspect(None, tmp_path, seed)
    assert outcome.findings == ()
    assert outcome.green
    assert outcome.simulated_s < CHECK_S
