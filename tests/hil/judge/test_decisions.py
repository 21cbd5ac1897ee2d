"""The maps of what stood around a machine when it last decided."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from hil.judge.decisions import KEPT, Decisions
from hil.judge.pictures import GROUND
from host.core.vehicle import Vehicle
from host.pilot.phase import Phase, Transition
from sim_plant import ground
from sim_plant.field import Field
from sim_plant.field_spec import FieldSpec

POSE = (2.0, 3.0, 0.0)


def deciding(field: Field) -> tuple[Decisions, Any]:
    """And a pilot that has decided nothing yet, on its lane."""
    lane = SimpleNamespace(blade_offset_m=0.0, heading_rad=0.0, offset_sigma_m=0.1)
    return Decisions(field, Vehicle()), SimpleNamespace(transitions=[], lane=lane)


def decide(decisions: Decisions, pilot: Any, now: float) -> None:
    pilot.transitions.append(Transition(now, Phase.FOLLOW, "so", "so"))
    decisions.step(now, POSE, pilot)


def shows(path: Path, kind: int) -> bool:
    """Whether much of the picture has that ground's colour."""
    bgr = cv2.imread(str(path))
    assert bgr is not None
    off = np.abs(bgr[:, :, ::-1] / 255.0 - GROUND[kind]).max(axis=2)
    return bool((off < 0.02).mean() > 0.02)


@pytest.fixture
def field() -> Field:
    return Field(FieldSpec(size_m=(6.0, 6.0)), 1)


def test_a_decision_is_drawn_as_things_stood_then(field: Field, tmp_path: Path) -> None:
    decisions, pilot = deciding(field)
    field.kind[:] = ground.CROP
    decide(decisions, pilot, 1.0)
    field.kind[:] = ground.STUBBLE
    assert decisions.draw(tmp_path / "d.png", [])
    assert shows(tmp_path / "d.png", ground.CROP)
    assert not shows(tmp_path / "d.png", ground.STUBBLE)


def test_the_last_decisions_are_drawn_and_no_moment_between(field: Field, tmp_path: Path) -> None:
    decisions, pilot = deciding(field)
    field.kind[:] = ground.NEIGHBOUR
    decide(decisions, pilot, 1.0)
    field.kind[:] = ground.CROP
    for k in range(KEPT):
        decide(decisions, pilot, 2.0 + k)
    field.kind[:] = ground.STUBBLE
    decisions.step(60.0, POSE, pilot)
    decisions.draw(tmp_path / "d.png", [])
    assert shows(tmp_path / "d.png", ground.CROP)
    assert not shows(tmp_path / "d.png", ground.NEIGHBOUR)
    assert not shows(tmp_path / "d.png", ground.STUBBLE)


def test_of_a_run_without_a_decision_nothing_is_drawn(field: Field, tmp_path: Path) -> None:
    decisions, pilot = deciding(field)
    decisions.step(1.0, POSE, pilot)
    assert not decisions.draw(tmp_path / "d.png", [])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("left_m", [0.0, 1.5])
def test_the_believed_edge_is_drawn_where_it_is_believed(
    field: Field, tmp_path: Path, left_m: float
) -> None:
    """In line with the blade's right end, less the overlap; below it by what the machine is left
    of its lane."""
    decisions, pilot = deciding(field)
    field.kind[:] = ground.CROP
    pilot.lane.blade_offset_m = left_m
    decide(decisions, pilot, 1.0)
    decisions.draw(tmp_path / "d.png", [])
    bgr = cv2.imread(str(tmp_path / "d.png"))
    assert bgr is not None
    off = np.abs(bgr[:, :, ::-1].astype(int) - (31, 119, 180)).max(axis=2)
    blue = np.argwhere(off < 60)
    crop = np.argwhere(np.abs(bgr[:, :, ::-1] / 255.0 - GROUND[ground.CROP]).max(axis=2) < 0.02)
    bottom, top = crop[:, 0].max(), crop[:, 0].min()
    per_m = (bottom - top) / 8.0
    y_m = (bottom - np.median(blue[:, 0])) / per_m - 4.0
    assert y_m == pytest.approx(-Vehicle().inset_m - left_m, abs=0.1)
