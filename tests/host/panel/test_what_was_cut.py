"""What the map shows of a field that an earlier run has cut in part."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.messages import Fix
from host.core.vehicle import Vehicle
from host.field.boundary_file import Boundary, boundary_of, load_field, save_field
from host.panel import snapshot
from host.panel.fields import FieldDesk
from host.panel.harvesting import MOST_PLACES, Operator
from host.panel.snapshot import Json
from host.pilot.phase import Phase
from host.route.plan import Plan
from host.route.side import Side
from host.runs.errand import Errand, errand_of
from host.runs.resume import Progress, digest, remaining, save
from tests.helpers.served_panel import now, served

FRAME = LocalFrame(31.5, 74.3)
CORNERS = ((0, 0), (12, 0), (12, 10), (0, 10))
VEHICLE = Vehicle()
FIELD = Boundary(tuple(FRAME.to_wgs84(x, y) for x, y in CORNERS), name="field")
ERRAND = errand_of(FIELD, 0, VEHICLE, "three_point", 2.0, None, None)


def area(rings: list[Any]) -> shapely.Geometry:
    return shapely.union_all([shapely.Polygon(ring) for ring in rings])


def test_whole_strips_and_the_begun_one_are_shown_as_cut() -> None:
    side = ERRAND.whole.sides[0]
    assert snapshot.of_cut(ERRAND.whole, (0, 0.0)) == []
    one = area(snapshot.of_cut(ERRAND.whole, (0, 5.0)))
    assert one.area == pytest.approx(5.0 * side.width_m, rel=0.01)
    assert one.contains(shapely.Point(side.pose(2.5, side.width_m / 2)[:2]))
    three = area(snapshot.of_cut(ERRAND.whole, (2, 3.0)))
    strips = ERRAND.whole.sides[:3]
    lengths = [strips[0].length_m, strips[1].length_m, 3.0]
    for strip, long_m in zip(strips, lengths, strict=True):
        assert three.contains(shapely.Point(strip.pose(long_m - 0.2, 0.3)[:2]))
        assert not three.contains(shapely.Point(strip.pose(long_m / 2, 1.4)[:2]))
    assert not three.contains(shapely.Point(strips[2].pose(4.0, 0.3)[:2]))


def test_a_bent_strip_is_shown_along_its_bend() -> None:
    bent = Side(0.0, 0.0, 0.0, 10.0, 1.0, 10.0, bends=((6.0, 0.3),))
    shown = area(snapshot.of_cut(Plan(sides=(bent,)), (1, 0.0)))
    for along_m in (3.0, 8.0):
        assert shown.contains(shapely.Point(bent.pose(along_m, 0.5)[:2]))
    assert not shown.contains(shapely.Point(9.0, 0.5))
    told = snapshot.of_plan(Plan(sides=(bent,)))["sides"]
    assert told == [[pytest.approx(bent.pose(at)[:2], abs=0.01) for at in (0.0, 6.0, 10.0)]]


def test_a_run_that_goes_on_tells_the_pages_what_is_cut_also_when_laid_out_anew() -> None:
    posted: list[Json] = []
    whole = ERRAND.whole
    errand = Errand(remaining(whole, 1, 4.0), whole, whole, 0, (1, 4.0), FRAME)
    machine = SimpleNamespace(post=posted.append, meetings=1)
    operator = Operator(machine, errand)  # type: ignore[arg-type]
    operator.show_map(errand.plan)
    operator.show_map(errand.plan)
    assert len(posted) == 1, "only what is new"
    operator.show_map(remaining(whole, 1, 4.0))
    assert [told["anew"] for told in posted] == [False, True]
    for told in posted:
        assert area(told["cut"]).contains(shapely.Point(whole.sides[0].pose(5.0, 0.5)[:2]))


def test_a_panel_that_comes_anew_is_told_the_whole_map() -> None:
    posted: list[Json] = []
    machine = SimpleNamespace(post=posted.append, meetings=1)
    operator = Operator(machine, ERRAND)  # type: ignore[arg-type]

    def trail() -> Json:
        operator.show_map(ERRAND.plan)
        return next(told for told in reversed(posted) if told["kind"] == "trail")

    operator.trail += [[1.0, 0.5, 0.0]]
    trail()
    operator.trail += [[1.2, 0.5, 0.0]]
    assert trail() == {"kind": "trail", "places": [[1.2, 0.5, 0.0]], "all": False}
    machine.meetings, posted[:] = 2, []
    assert trail() == {"kind": "trail", "places": operator.trail, "all": True}
    assert [told["kind"] for told in posted] == ["plan", "trail"]
    machine.meetings = 3
    operator.trail *= MOST_PLACES
    assert (trail()["all"], trail()["all"]) == (True, False), "a long one in several messages"
    whole = [told["places"] for told in posted if told["kind"] == "trail"][-2:]
    assert whole[0] + whole[1] == operator.trail


def kept(folder: Path, name: str, phase: Phase, plan: str, age_s: float = 0.0) -> Path:
    path = folder / f"drive-{name}.progress.json"
    save(path, Progress(plan=plan, corner=0, side=1, cut_m=3.0, phase=phase))
    os.utime(path, (1e9 - age_s, 1e9 - age_s))
    return path


def test_what_a_crash_left_of_this_field_is_found_and_nothing_else(tmp_path: Path) -> None:
    save_field(tmp_path / "field.geojson", FIELD)
    (tmp_path / "panel.json").write_text('{"name": "field.geojson", "gap_m": 2.0, "corner": 0}')
    desk = FieldDesk(tmp_path, VEHICLE, None, None)
    assert desk.unfinished() is None
    assert desk.plan is not None
    this = digest(desk.plan)
    left = kept(tmp_path, "1", Phase.FOLLOW, this, age_s=50)
    assert desk.unfinished() == left
    goal = desk.goal(left)
    assert goal is not None
    assert area(goal["cut"]).contains(shapely.Point(ERRAND.whole.sides[0].pose(5.0, 0.5)[:2]))
    kept(tmp_path, "0", Phase.FINISHED, this, age_s=10)
    assert desk.unfinished() is None, "the last one to be driven has finished the field"
    kept(tmp_path, "2", Phase.FOLLOW, "another")
    assert desk.unfinished() is None


def walked_fixes(corners: Sequence[tuple[float, float]] = CORNERS) -> list[Fix]:
    """Two laps around a field in steps of 1.2 m, as a phone in the hand says them."""
    ring = shapely.Polygon(corners).exterior
    steps = np.arange(0, 2 * ring.length + 1, 1.2) % ring.length
    places = [ring.interpolate(step) for step in steps]
    at = [FRAME.to_wgs84(place.x + 0.013, place.y + 0.017) for place in places]
    return [Fix(float(k), lat, lon, 1, 0.8, 9, 0.0) for k, (lat, lon) in enumerate(at)]


@pytest.mark.parametrize("round_", [True, False])
def test_a_field_that_bends_is_kept_as_it_was_walked(tmp_path: Path, round_: bool) -> None:
    """On the page nobody says how many corners it has. What is changed by hand stays what it is."""
    circle = [
        (40.0 * math.cos(k * math.tau / 90), 40.0 * math.sin(k * math.tau / 90)) for k in range(90)
    ]
    desk = FieldDesk(tmp_path, VEHICLE, None, 2.0)
    desk.do({"do": "walk_begin"})
    assert desk.walk is not None
    desk.walk.fixes += walked_fixes(circle if round_ else CORNERS)
    desk.do({"do": "walk_end"})
    assert desk.boundary is not None
    assert desk.boundary.recorded is round_
    assert desk.about(None)["recorded"] is round_
    found = desk.boundary.polygon(desk.boundary.frame)
    true = shapely.Polygon(circle if round_ else CORNERS)
    assert found.area == pytest.approx(true.area, rel=0.02)
    middle = found.centroid
    ring = [(middle.x + x, middle.y + y) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    desk.do({"do": "keep_out", "ring": ring})
    assert desk.boundary.keep_outs
    assert desk.boundary.recorded is round_


@pytest.mark.parametrize("change", ["walked", "corner moved", "keep-out"])
def test_a_run_on_a_field_of_this_session_can_be_gone_on_with(tmp_path: Path, change: str) -> None:
    """The run drives what the file says; the desk has to speak of the same plan."""
    save_field(tmp_path / "field.geojson", FIELD)
    desk = FieldDesk(tmp_path, VEHICLE, tmp_path / "field.geojson", 2.0)
    if change == "walked":
        desk.do({"do": "walk_begin"})
        assert desk.walk is not None
        desk.walk.fixes += walked_fixes()
        desk.do({"do": "walk_end"})
    elif change == "corner moved":
        desk.do({"do": "move_corner", "index": 1, "x": 13.123456789, "y": 0.987654321})
    else:
        ring = shapely.box(5.0123456789, 4.0, 6.3, 5.1987654321).exterior.coords
        desk.do({"do": "keep_out", "ring": list(ring)[:-1]})
    assert desk.path is not None
    assert desk.plan is not None
    driven = errand_of(load_field(desk.path), 0, VEHICLE, "three_point", 2.0, None, None)
    left = kept(tmp_path, "1", Phase.FOLLOW, digest(driven.whole))
    assert desk.goal(left) is not None


def test_pages_hear_of_what_a_crash_left_until_another_plan_is_chosen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    save_field(tmp_path / "field.geojson", FIELD)
    (tmp_path / "panel.json").write_text('{"name": "field.geojson", "gap_m": 2.0, "corner": 0}')
    plan = FieldDesk(tmp_path, VEHICLE, None, None).plan
    assert plan is not None
    left = kept(tmp_path, "1", Phase.FOLLOW, digest(plan))
    with served("/dev/no-port", tmp_path) as panel:
        page = panel.page()
        told = page.until(lambda m: m["kind"] == "goal" and m["place"] is not None)
        assert (told["side"], told["along_m"]) == (2, 2.8)
        assert any(m["kind"] == "ended" and m["resume"] == str(left) for m in page.seen)
        page.ask("take")
        page.until(now(driver=True, mode="idle"))
        page.ask("corner", corner=1)
        page.until(lambda m: m["kind"] == "plan" and m["boundary"] == [])
        page.until(lambda m: m["kind"] == "goal" and m["place"] is None and m["stuck"])
        goals = [m for m in page.seen if m["kind"] == "goal"]
        assert goals[-2]["place"] is None, "the old place is gone while the new one is looked for"
        assert not goals[-2]["stuck"]
        page.close()


def test_a_panel_starts_with_a_field_that_cannot_be_planned(tmp_path: Path) -> None:
    """It was walked on the page, and is mended there."""
    parted = shapely.Polygon(CORNERS, [[(5, 0.1), (6, 0.1), (6, 9.9), (5, 9.9)]])
    save_field(tmp_path / "field.geojson", boundary_of(parted, FRAME, "field"))
    (tmp_path / "panel.json").write_text('{"name": "field.geojson", "gap_m": 2.0, "corner": 0}')
    desk = FieldDesk(tmp_path, VEHICLE, None, None)
    assert desk.plan is None
    assert "part the field" in desk.about(None)["problem"]
    desk.do({"do": "keep_out_drop"})
    assert desk.plan is not None
    assert desk.about(None)["problem"] == ""
    save_field(tmp_path / "given.geojson", boundary_of(parted, FRAME, "given"))
    (tmp_path / "other").mkdir()
    with pytest.raises(UserError, match="part the field"):
        FieldDesk(tmp_path / "other", VEHICLE, tmp_path / "given.geojson", 2.0)
