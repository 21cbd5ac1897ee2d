"""Corners of the field that the operator moves, adds and removes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from host.core.frames import LocalFrame
from host.core.vehicle import Vehicle
from host.field.boundary_file import Boundary, load_field, save_field
from host.field.shapes import Mark
from host.panel.fields import FieldDesk
from tests.helpers.walker import Place

FRAME = LocalFrame(31.5, 74.3)
PLACES: list[Place] = [(0, 0), (14, 1), (13, 12), (-1, 11)]
HOLE: list[Place] = [(5, 5), (6, 5), (6, 6)]


@pytest.fixture(autouse=True)
def _unplanned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plans take seconds, and may move where the machine begins."""
    monkeypatch.setattr(FieldDesk, "_plan", lambda _desk: None)


def desk(folder: Path, corner: int = 0) -> FieldDesk:
    """At a field of four corners, begun at one of them."""
    around, hole = (tuple(FRAME.to_wgs84(*place) for place in ring) for ring in (PLACES, HOLE))
    save_field(folder / "field.geojson", Boundary(around, (hole,), name="field"))
    kept = f'{{"name": "field.geojson", "gap_m": 2.0, "corner": {corner}}}'
    (folder / "panel.json").write_text(kept)
    return FieldDesk(folder, Vehicle(), None, None)


def corners(folder: Path) -> list[Place]:
    """On disk."""
    return [FRAME.to_local(*place) for place in load_field(folder / "field.geojson").crop]


def close(places: list[Place]) -> list[object]:
    return [pytest.approx(place, abs=0.01) for place in places]


@pytest.mark.parametrize(("begun", "then"), [(0, 0), (1, 1), (2, 3)])
def test_a_corner_is_added_in_the_middle_of_the_side(tmp_path: Path, begun: int, then: int) -> None:
    found = desk(tmp_path, begun)
    found.do({"do": "add_corner", "index": 1})
    assert found.problem == ""
    assert corners(tmp_path) == close([*PLACES[:2], (13.5, 6.5), *PLACES[2:]])
    assert found.boundary is not None
    assert found.boundary.keep_outs, "keep-outs stay"
    assert found.corner == then, "the machine begins where it did"


def test_a_corner_is_added_on_the_side_that_leads_back_to_the_first(tmp_path: Path) -> None:
    desk(tmp_path).do({"do": "add_corner", "index": 3})
    assert corners(tmp_path) == close([*PLACES, (-0.5, 5.5)])


def test_a_corner_is_added_where_a_finger_drags_it(tmp_path: Path) -> None:
    found = desk(tmp_path, 2)
    found.do({"do": "add_corner", "index": 1, "x": 15.5, "y": 6.0})
    assert found.problem == ""
    assert corners(tmp_path) == close([*PLACES[:2], (15.5, 6.0), *PLACES[2:]])
    assert found.corner == 3, "the machine begins where it did"


@pytest.mark.parametrize(
    ("x", "y", "problem"),
    [
        (float("nan"), 6.0, "there is no such corner"),
        (13.5, 206.6, "a corner moves by 200 m at most"),
        (-5.0, 6.0, "the field's sides would cross"),
    ],
)
def test_where_it_cannot_lie_none_is_added(
    tmp_path: Path, x: float, y: float, problem: str
) -> None:
    found = desk(tmp_path)
    found.do({"do": "add_corner", "index": 1, "x": x, "y": y})
    assert found.problem == problem
    assert corners(tmp_path) == close(PLACES)


@pytest.mark.parametrize(
    ("begun", "index", "then"), [(0, 1, 0), (3, 1, 2), (1, 1, 1), (3, 3, 0), (2, 0, 1)]
)
def test_a_corner_is_removed(tmp_path: Path, begun: int, index: int, then: int) -> None:
    found = desk(tmp_path, begun)
    found.do({"do": "keep_out_drop"})
    found.do({"do": "drop_corner", "index": index})
    assert found.problem == ""
    assert corners(tmp_path) == close(PLACES[:index] + PLACES[index + 1 :])
    assert found.corner == then


@pytest.mark.parametrize("do", ["add_corner", "drop_corner", "move_corner"])
@pytest.mark.parametrize("index", [-1, 4])
def test_there_is_no_such_corner(tmp_path: Path, do: str, index: int) -> None:
    found = desk(tmp_path)
    found.do({"do": do, "index": index, "x": 0.0, "y": 0.0})
    assert found.problem == "there is no such corner"
    assert corners(tmp_path) == close(PLACES)


def test_three_corners_are_left(tmp_path: Path) -> None:
    found = desk(tmp_path)
    found.do({"do": "keep_out_drop"})
    for _ in range(2):
        found.do({"do": "drop_corner", "index": 3})
        found.do({"do": "drop_corner", "index": 2})
    assert found.problem == "a field has three corners at least"
    assert len(corners(tmp_path)) == 3


def test_a_field_of_which_nothing_would_be_left_stays(tmp_path: Path) -> None:
    """And the machine begins where it did, not at the number that it would have then."""
    found = desk(tmp_path, 3)
    found.do({"do": "keep_out_drop"})
    found.do({"do": "move_corner", "index": 2, "x": 27.9, "y": 1.9999})
    before = corners(tmp_path)
    found.do({"do": "drop_corner", "index": 3})
    assert "is no field" in found.problem
    assert found.corner == 3
    assert corners(tmp_path) == close(before)


def test_a_corner_that_cannot_go_changes_nothing(tmp_path: Path) -> None:
    """Without it the keep-out would lie outside."""
    found = desk(tmp_path, 3)
    hole = [(13.0, 2.0), (13.5, 2.0), (13.5, 3.0)]
    found.do({"do": "keep_out", "ring": hole})
    found.do({"do": "drop_corner", "index": 1})
    assert found.problem == "the field's sides would cross"
    assert found.corner == 3
    assert corners(tmp_path) == close(PLACES)


def test_what_stands_in_the_field_stays_said_until_a_keep_out_lies_around_it(
    tmp_path: Path,
) -> None:
    found = desk(tmp_path)
    assert found.boundary is not None
    marks = []
    for name, place in (("'well' (Point)", (8.8, 8.5)), ("'tree' (Point)", (4.0, 4.0))):
        latitude, longitude = found.boundary.frame.to_wgs84(*place)
        marks.append(Mark(name, longitude, latitude))
    save_field(tmp_path / "field.geojson", replace(found.boundary, left_out=tuple(marks)))
    found.do({"do": "open", "name": "field.geojson"})
    found.do({"do": "move_corner", "index": 2, "x": 13.5, "y": 12.5})
    assert "'well' (Point), 'tree' (Point)" in found.boundary.not_kept_out
    found.do({"do": "keep_out", "ring": [(8, 8), (9, 8), (9, 9)]})
    assert found.problem == ""
    assert len(found.boundary.keep_outs) == 2
    assert "'tree'" in found.boundary.not_kept_out
    assert "'well'" not in found.boundary.not_kept_out
    found.do({"do": "keep_out", "ring": [(3.5, 3.5), (4.5, 3.5), (4.5, 4.5), (3.5, 4.5)]})
    assert found.boundary.not_kept_out == ""


NO_NUMBERS = (math.inf, -math.inf, math.nan, 10**400, -1, 4, None, [1], "x")


@pytest.mark.parametrize("number", NO_NUMBERS, ids=lambda one: str(one)[:8])
@pytest.mark.parametrize("what", ["corner", "gap", "move_corner", "add_corner", "drop_corner"])
def test_what_is_no_number_changes_nothing_and_is_said(
    tmp_path: Path, what: str, number: object
) -> None:
    found = desk(tmp_path, corner=2)
    wish: dict[str, object] = {"do": what, "index": number, "corner": number, "x": 1.0, "y": 1.0}
    if what == "gap":
        number = 101 if number == 4 else number
        wish["gap_m"] = number
    found.do(wish)
    assert found.problem
    assert found.corner == 2
    assert found.gap_m == 2.0
    assert corners(tmp_path) == close(PLACES)


def test_a_keep_out_that_reaches_to_infinity_is_none(tmp_path: Path) -> None:
    found = desk(tmp_path)
    for far in (math.inf, 10**400):
        found.do({"do": "keep_out", "ring": [[1, 1], [far, 2], [3, 3]]})
        assert found.problem
    assert found.boundary is not None
    assert len(found.boundary.keep_outs) == 1


def test_a_file_that_cannot_be_read_leaves_the_field_that_was_chosen(tmp_path: Path) -> None:
    """Otherwise the page shows the old corners under the new name, and a change is saved there."""
    found = desk(tmp_path)
    for name, content in (("half.geojson", b'{"type":'), ("odd \u202e<b>.geojson", b"\xff\xfe")):
        (tmp_path / name).write_bytes(content)
        found.do({"do": "open", "name": name})
        assert f"the field {name} cannot be read" in found.problem
        assert found.name == "field.geojson"
        assert found.path == tmp_path / "field.geojson"


def test_a_panel_starts_without_the_field_whose_file_is_spoiled(tmp_path: Path) -> None:
    """A laptop whose battery ended while it wrote."""
    desk(tmp_path)
    (tmp_path / "field.geojson").write_text('{"type":')
    found = FieldDesk(tmp_path, Vehicle(), None, None)
    assert found.name is None
    assert found.boundary is None
    assert "the field field.geojson cannot be read" in found.about(None)["problem"]


def test_a_keep_out_marked_on_the_page_outlives_the_same_command(tmp_path: Path) -> None:
    """`daranti panel --boundary FIELD` again: what stands in the field still stands there."""
    folder, given = tmp_path / "panel", tmp_path / "given.geojson"
    folder.mkdir()
    around = tuple(FRAME.to_wgs84(*place) for place in PLACES)
    save_field(given, Boundary(around, name="given"))
    ring = [list(place) for place in HOLE]
    first = kept_desk(folder, given)
    first.do({"do": "keep_out", "ring": ring})
    assert first.problem == ""
    again = kept_desk(folder, given)
    assert again.boundary is not None
    assert len(again.boundary.keep_outs) == 1
    # Another survey of the field is another field.
    save_field(given, Boundary(around[:3], name="given"))
    other = kept_desk(folder, given)
    assert other.boundary is not None
    assert len(other.boundary.crop) == 3
    assert other.boundary.keep_outs == ()


def kept_desk(folder: Path, given: Path) -> FieldDesk:
    """As the command makes it; a plan, which is left out here, keeps what was chosen."""
    found = FieldDesk(folder, Vehicle(), given, 2.0)
    found._keep()
    return found
