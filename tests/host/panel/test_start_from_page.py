"""Where the machine must stand before the panel lets it start, and why it does what it does."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.messages import Fix
from host.core.vehicle import MAST, Vehicle
from host.field.boundary_file import Boundary, save_field
from host.link import protocol
from host.panel import harvesting, snapshot
from host.panel.harvesting import Order, harvest, prepare, record, see_first
from host.panel.machine import NotYetError
from host.panel.snapshot import Json, fix_of
from host.panel.texts import LANGUAGES, text
from host.pilot.behaviours.align import Wait
from host.pilot.phase import Phase, Transition
from host.pilot.pilot import Pilot
from host.route.plan import Plan
from host.runs import preflight
from host.runs.drive import Drive
from host.sensors.camera_stream import Picture

FRAME = LocalFrame(31.5, 74.3)
CORNERS = ((0, 0), (30, 0), (30, 25), (0, 25))


class Board:
    """Answers what it is asked for a parameter: what the vehicle file says, but for one."""

    def __init__(self, **held: float) -> None:
        self._held = {p.parameter: getattr(Vehicle(), p.field) for p in preflight.PAIRS[::-1]}
        self._held |= held

    def ask(self, message: protocol.ParamGet) -> protocol.ParamValue:
        spec = next(spec for spec in protocol.PARAMS.values() if spec.id == message.param)
        return protocol.ParamValue(spec.id, spec.to_raw(self._held[spec.name]))


def machine_at(x: float, y: float, shown: Picture | None = None) -> Any:
    """A machine whose receiver says so, and whose camera shows a picture again and again."""
    now = iter(range(10**6))
    lat, lon = FRAME.to_wgs84(x, y)
    fix = Fix(0.0, lat, lon, 1, 1.0, 9, 0.0)
    return SimpleNamespace(
        camera=SimpleNamespace(take=lambda: shown),
        gnss=SimpleNamespace(take=lambda: fix),
        gyro=None,
        link=Board(),
        events=[],
        vehicle=Vehicle(),
        mount=MAST,
        settings=SimpleNamespace(mode="robust", mount="mast", folder=Path()),
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


@pytest.mark.parametrize("language", LANGUAGES)
def test_pictures_of_another_mount_start_nothing(order: Order, language: str) -> None:
    """The mount's name is the mast's, the picture has sky in it."""
    sky = np.full((MAST.height_px, MAST.width_px, 3), (210, 180, 160), np.uint8)
    picture = Picture(0.0, cv2.imencode(".jpg", sky)[1].tobytes())
    with pytest.raises(NotYetError) as refused:
        prepare(machine_at(-1.0, 1.0, picture), order)
    problem = refused.value.problem
    assert problem.code == "mount"
    assert "--mount low" in text(language, "problem.mount", **problem.values)


def test_a_board_of_another_machine_starts_nothing(order: Order) -> None:
    machine = machine_at(-1.0, 1.0)
    machine.link = Board(hall_per_metre=25.0)
    with pytest.raises(UserError, match=r"hall_per_metre = 25 in the firmware"):
        prepare(machine, order)


def test_a_full_disk_starts_nothing(order: Order, monkeypatch: pytest.MonkeyPatch) -> None:
    full = SimpleNamespace(free=1e6)
    monkeypatch.setattr("shutil.disk_usage", lambda _: full)
    with pytest.raises(UserError, match=r"has 1 MB left"):
        prepare(machine_at(-1.0, 1.0), order)


WHOLE = Picture(0.0, None, np.zeros((480, 640, 3), np.uint8))
WIDE = Picture(0.0, None, np.zeros((360, 640, 3), np.uint8))
SPOILED = Picture(0.0, b"\xff\xd8 and no more")


@pytest.mark.parametrize(
    ("come", "problem"),
    [
        ([WHOLE, WHOLE], ""),
        ([None, None, SPOILED, WHOLE], ""),
        ([WHOLE], "no picture from the camera: it is off"),  # that is from before
        ([None, SPOILED], "no picture from the camera: it is off"),
        ([None, WIDE], "sends 640x360 pixels, the mount expects 640x480"),
    ],
)
def test_a_harvest_begins_with_a_new_picture_that_is_whole_and_of_the_mounts_size(
    come: list[Picture | None], problem: str
) -> None:
    machine, coming = machine_at(-1.0, 1.0), iter(come)
    machine.camera = SimpleNamespace(take=lambda: next(coming, None), problem="it is off")
    if problem:
        with pytest.raises(UserError, match=problem):
            see_first(machine)
    else:
        see_first(machine)
        assert next(coming, None) is None


class CutOff(Drive):
    def run(self, _: Callable[[Drive], None]) -> None:
        raise UserError("the cable is out")


def test_a_run_that_the_pilot_did_not_end_says_what_did(
    order: Order, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[Json] = []
    machine = machine_at(-1.0, 1.0)
    machine.link.session = SimpleNamespace(telemetry=None)
    machine.post, machine.meetings, machine.settings.folder = said.append, 1, tmp_path
    monkeypatch.setattr(harvesting, "see_first", lambda *_: None)
    monkeypatch.setattr(harvesting, "Drive", CutOff)
    close = harvesting.Keeper.close

    def closed(keeper: harvesting.Keeper, pilot: Pilot) -> None:
        close(keeper, pilot)
        said.append({"kind": "progress kept"})

    monkeypatch.setattr(harvesting.Keeper, "close", closed)
    errand = prepare(machine, order)
    with pytest.raises(UserError, match="the cable is out"):
        harvest(machine, order, errand)
    assert said[-2]["kind"] == "progress kept", "where to go on is read from it"
    ended = said[-1]
    assert (ended["kind"], ended["outcome"]) == ("ended", "fault")
    assert (ended["reason"], ended["code"]) == ("the cable is out", "")


def test_a_full_disk_ends_the_record_and_not_the_run(
    order: Order, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[Json] = []
    machine = machine_at(-1.0, 1.0)
    machine.post = said.append

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with record(machine, tmp_path / "a.mcap", order, Plan(()), "now") as recorder:
        monkeypatch.setattr("mcap.writer.Writer.add_message", full)
        recorder.put("/operator", 1.0, {"paused": True})
        recorder.put("/operator", 2.0, {"paused": True})
    assert [(one["kind"], one["what"]) for one in said] == [("failed", "record")]
    assert "No space left" in said[0]["why"]
    assert said[0]["why"] in machine.events


def test_a_reason_is_told_by_its_code_and_what_it_speaks_of() -> None:
    last = Transition(0.0, Phase.FAULT, "gave up after 60 s: no edge", "back off: GAVE_UP")
    ends = Transition(0.0, Phase.TURN, "end of side 2: no crop before the blade", "follow: SEEN")

    def told(transition: Transition, reason: str) -> Json:
        return snapshot.of_reason(SimpleNamespace(transitions=[transition], reason=reason))  # type: ignore[arg-type]

    gave_up = {"code": "Patience.GAVE_UP", "words": {"seconds": "60", "reason": "no edge"}}
    assert told(last, last.reason) == gave_up
    assert told(ends, ends.reason)["code"] == "SideEnd.SEEN"
    waits = Wait.NOTHING_AHEAD.go(left="1.4").text
    said = {"code": "Wait.NOTHING_AHEAD", "words": {"left": "1.4"}}
    assert told(ends, waits) == said, "what it says by now"


@given(
    fix=st.builds(
        Fix,
        stamp=st.floats(0, 1e6),
        lat_deg=st.floats(-90, 90),
        lon_deg=st.floats(-180, 180),
        quality=st.integers(1, 5),
        hdop=st.just(math.nan) | st.floats(0.5, 20),
        satellites=st.integers(0, 30),
        speed_mps=st.none() | st.floats(0, 5),
        course_rad=st.none() | st.floats(-3.2, 3.2),
    )
)
def test_a_walk_from_the_page_has_all_that_the_receiver_said(fix: Fix) -> None:
    """What passes between the machine's process and the page's: a survey needs the Doppler too."""
    heard = fix_of(json.loads(json.dumps(snapshot.of_fix(fix, fix.stamp))))
    for name in Fix.__slots__:
        said, got = getattr(fix, name), getattr(heard, name)
        if said is None or math.isnan(said):
            assert got is None or math.isnan(got)
        else:
            step = {"lat_deg": 5e-8, "lon_deg": 5e-8, "course_rad": 5e-4, "hdop": 0.05}
            assert got == pytest.approx(said, abs=1.01 * step.get(name, 5e-3))
