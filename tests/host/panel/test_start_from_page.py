"""Where the machine must stand before the panel lets it start, and why it does what it does."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from host.core.frames import LocalFrame
from host.core.messages import Fix
from host.core.vehicle import MAST, Vehicle
from host.field.boundary_file import Boundary, save_field
from host.panel import harvesting, snapshot
from host.panel.harvesting import Order, prepare
from host.panel.machine import NotYetError
from host.panel.texts import LANGUAGES, text
from host.pilot.phase import Phase, Transition

FRAME = LocalFrame(31.5, 74.3)
CORNERS = ((0, 0), (30, 0), (30, 25), (0, 25))


def machine_at(x: float, y: float) -> Any:
    """A machine whose receiver says so, and whose camera shows nothing."""
    now = iter(range(10**6))
    lat, lon = FRAME.to_wgs84(x, y)
    fix = Fix(0.0, lat, lon, 1, 1.0, 9, 0.0)
    return SimpleNamespace(
        camera=SimpleNamespace(take=lambda: None),
        gnss=SimpleNamespace(take=lambda: fix),
        link=object(),
        vehicle=Vehicle(),
        mount=MAST,
        settings=SimpleNamespace(mode="robust"),
        clock=lambda: 0.05 * next(now),
        pump=lambda _: [],
    )


@pytest.fixture
def order(tmp_path: Path) -> Order:
    places = tuple(FRAME.to_wgs84(x, y) for x, y in CORNERS)
    save_field(tmp_path / "field.geojson", Boundary(places, name="field"))
    return Order(boundary=tmp_path / "field.geojson", gap_m=2.0, corner=0)


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_machine_at_another_corner_is_not_started_and_told_so(
    order: Order, language: str
) -> None:
    with pytest.raises(NotYetError) as refused:
        prepare(machine_at(30.0, 0.0), order)
    problem = refused.value.problem
    assert problem.code == "corner"
    said = text(language, f"problem.{problem.code}", **problem.values)
    assert "{" not in said
    assert "2" in said


def test_a_machine_at_its_corner_is_rehearsed(
    order: Order, monkeypatch: pytest.MonkeyPatch
) -> None:
    rehearsed: list[object] = []
    monkeypatch.setattr(harvesting, "warm_up", lambda _, plan: rehearsed.append(plan))
    errand = prepare(machine_at(-1.0, 1.0), order)
    assert rehearsed == [errand.plan]


def test_a_reason_is_told_by_its_code_and_what_it_speaks_of() -> None:
    last = Transition(0.0, Phase.FAULT, "gave up after 60 s: no edge", "back off: GAVE_UP")
    told = snapshot.of_reason(SimpleNamespace(transitions=[last]))  # type: ignore[arg-type]
    assert told == {"code": "Patience.GAVE_UP", "words": {"seconds": "60", "reason": "no edge"}}
    ends = Transition(0.0, Phase.TURN, "end of side 2: no crop before the blade", "follow: SEEN")
    assert snapshot.of_reason(SimpleNamespace(transitions=[ends]))["code"] == "SideEnd.SEEN"  # type: ignore[arg-type]
