"""Facts about boundary files, the corner that a plan begins at, and the fence."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.messages import Fix
from host.core.vehicle import Vehicle
from host.field.areas import areas_of
from host.field.boundary_file import Boundary, load_field
from host.field.fence import FENCE_FIXES, FENCE_M, Fence, nearest_corner
from host.route.field_plan import plan_field, plan_of
from host.runs.errand import warnings

FRAME = LocalFrame(31.5, 74.3)
SQUARE = [FRAME.to_wgs84(*corner) for corner in ((0, 0), (20, 0), (20, 10), (0, 10))]


def geojson(corners: list[tuple[float, float]]) -> dict[str, object]:
    ring = [[lon, lat] for lat, lon in [*corners, corners[0]]]
    return {"type": "Polygon", "coordinates": [ring]}


def written(folder: Path, text: str, name: str = "field.txt") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("corners", [SQUARE, SQUARE[::-1]])
@pytest.mark.parametrize("form", ["polygon", "feature", "collection", "csv", "csv with heading"])
def test_every_form_gives_the_same_corners_counter_clockwise(
    tmp_path: Path, form: str, corners: list[tuple[float, float]]
) -> None:
    polygon = geojson(corners)
    feature = {"type": "Feature", "properties": {}, "geometry": polygon}
    lines = "\n".join(f"{lat!r},{lon!r}" for lat, lon in corners)
    text = {
        "polygon": json.dumps(polygon),
        "feature": json.dumps(feature),
        "collection": json.dumps({"type": "FeatureCollection", "features": [feature]}),
        "csv": lines,
        "csv with heading": f"latitude,longitude\n{lines}\n",
    }[form]
    found = list(load_field(written(tmp_path, text)).crop)
    start = found.index(SQUARE[0])
    assert found[start:] + found[:start] == SQUARE


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "it is empty"),
        ("31,74\n31,75\n32,75\n31,75\n32,74\n", "comes back to its corner 31.0000000, 75.00000"),
        ("31,74\nnan,nan\n32,75\n32,74\n", "not a latitude and longitude"),
        ("31.5O,74.3\n31.501,74.3\n31.501,74.301\n31.5,74.301\n", "line 1 is not latitude"),
        ("Breite,Länge\n31.5,74.3\n31.501,74.3\n31.501,74.301\n", "line 1 is not latitude"),
        ("31,5,74,3\n31,501,74,3\n31,501,74,301\n", "line 1 has 4 columns"),
        ('{"type": "Polygon", "coordinates": [[[NaN, 1], [2, 3], [4, 5]]]}', "degrees: NaN"),
        ('{"features": [], "rings": []}', "a geometry has no type"),
        ("1,2\n3,4\n", "three or more different corners"),
        ("31,74\n31,74\n31,75\n31,74\n", "three or more different corners"),
        ("31,74\nhere\n", "line 2 is not latitude,longitude"),
        ("{", "its format is not understood"),
        ('{"type": "Point", "coordinates": [1, 2]}', "its type is Point, not Polygon"),
        ('{"type": "FeatureCollection", "features": []}', "holds no polygon"),
        ("74,131\n74,132\n75,281\n", "not a latitude and longitude"),
        ("31,74\n31,75\n32,75\n", "km around; are its numbers swapped"),
    ],
)
def test_a_bad_boundary_is_one_message_that_names_the_file(
    tmp_path: Path, text: str, message: str
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(UserError, match=message) as error:
        load_field(path)
    assert str(path) in str(error.value)


def test_a_missing_file_is_said(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot read"):
        load_field(tmp_path / "none")


@pytest.mark.parametrize("corner", range(4))
def test_the_nearest_corner_is_where_the_machine_stands(corner: int) -> None:
    x, y = FRAME.to_local(*SQUARE[corner])
    assert nearest_corner(SQUARE, *FRAME.to_wgs84(x + 2, y - 2)) == corner


@pytest.mark.parametrize(("corner", "first_m"), [(0, 20), (1, 10), (2, 20), (3, 10)])
def test_the_plan_begins_with_the_side_that_leaves_the_corner(corner: int, first_m: float) -> None:
    _, plan = plan_of(Boundary(tuple(SQUARE)), corner, Vehicle(), "three_point")
    assert plan.sides[0].length_m == pytest.approx(first_m, abs=1e-3)
    assert plan.corner_rad(0) == pytest.approx(math.pi / 2, abs=1e-4)


@pytest.mark.parametrize("inset_m", [0.0, 1.0])
@pytest.mark.parametrize("recorded", [True, False, None])
def test_whether_it_was_recorded_reaches_the_plan(recorded: bool | None, inset_m: float) -> None:
    field = Boundary(tuple(SQUARE), recorded=recorded)
    _, plan = plan_of(field, 0, Vehicle(), "three_point", 2.0, inset_m)
    assert plan.recorded == bool(recorded)


def test_gap_and_keep_outs_reach_the_plan() -> None:
    well = [FRAME.to_wgs84(*corner) for corner in ((9, 5), (10, 5), (10, 6), (9, 6))]
    field = Boundary(tuple(SQUARE), (tuple(well),))
    for gap_m in (1.5, None):
        _, plan = plan_of(field, 0, Vehicle(), "arc", gap_m)
        assert (plan.gap_m, plan.turn, len(plan.keep_outs)) == (gap_m, "arc", 1)


@pytest.mark.parametrize("corner", range(4))
def test_a_field_with_a_keep_out_is_begun_at_the_corner_that_is_asked_for(corner: int) -> None:
    well = [FRAME.to_wgs84(*place) for place in ((9, 5), (10, 5), (10, 6), (9, 6))]
    frame, plan = plan_of(Boundary(tuple(SQUARE), (tuple(well),)), corner, Vehicle(), "arc", 2.0)
    first = plan.sides[0]
    assert (first.x_m, first.y_m) == pytest.approx(frame.to_local(*SQUARE[corner]), abs=0.01)


def test_a_corner_that_a_field_cannot_be_begun_at_names_the_one_that_can() -> None:
    shape = ((0, 0), (12, 0), (12, 6), (6, 6), (6, 12), (0, 12))
    field = Boundary(tuple(FRAME.to_wgs84(*corner) for corner in shape))
    with pytest.raises(UserError, match=r"corner 3: put the machine at corner \d") as error:
        plan_of(field, 3, Vehicle(), "three_point")
    begin = int(str(error.value).rsplit(" ", 1)[1])
    assert plan_of(field, begin, Vehicle(), "three_point")[1].sides


def fix_at(x: float, y: float, quality: int = 1) -> Fix:
    return Fix(0.0, *FRAME.to_wgs84(x, y), quality, 1.0, 8)


def test_the_fence_needs_several_fixes_in_a_row_far_outside() -> None:
    fence = Fence(SQUARE)
    outside, near, inside = fix_at(40, 5), fix_at(20 + FENCE_M - 0.1, 5), fix_at(10, 5)
    for _ in range(FENCE_FIXES - 1):
        assert fence.breach(outside) is None
    assert fence.breach(near) is None
    for _ in range(FENCE_FIXES - 1):
        assert fence.breach(outside) is None
    assert fence.breach(fix_at(0, 0, quality=0)) is None, "no fix neither counts nor clears"
    assert fence.breach(outside) == pytest.approx(20, abs=0.01)
    assert fence.breach(inside) is None


# ---- the vehicle file ----------------------------------------------------------------------------


@pytest.mark.parametrize("corner", range(4))
def test_with_an_inset_the_crop_begins_inside_and_the_machine_may_go_as_far_as_before(
    corner: int,
) -> None:
    field, vehicle = Boundary(tuple(SQUARE)), Vehicle()
    frame, plan = plan_of(field, corner, vehicle, "three_point", 2.0, inset_m=1.0)
    inner = ((1, 1), (19, 1), (19, 9), (1, 9))[corner]
    assert (plan.sides[0].x_m, plan.sides[0].y_m) == pytest.approx(inner, abs=0.01)
    areas = areas_of(field.polygon(frame), 2.0)
    crop = shapely.Polygon(plan.boundary)
    assert crop.area == pytest.approx(18 * 8, abs=0.1)
    allowed = areas_of(crop, plan.gap_m).permitted
    assert allowed is not None
    assert allowed.symmetric_difference(areas.permitted).area < 0.1


WALKED = [(0, 0), (10, 0), (20, 0), (20, 6), (20, 10), (9, 10), (0, 10), (0, 4)]
"""With corners that lie in line."""
POND = [(18.0, 4.0), (19.8, 4.0), (19.8, 6.0), (18.0, 6.0)]
"""With its margin it reaches over the field's edge."""


@pytest.mark.parametrize(("keep_outs", "corner"), [((), 0), ((POND,), 3)])
def test_what_plan_shows_is_what_drive_drives(
    keep_outs: tuple[list[tuple[float, float]], ...], corner: int
) -> None:
    field = Boundary(
        tuple(FRAME.to_wgs84(*at) for at in WALKED),
        tuple(tuple(FRAME.to_wgs84(*at) for at in ring) for ring in keep_outs),
    )
    frame, driven = plan_of(field, corner, Vehicle(), "three_point", 2.0)
    areas = areas_of(field.polygon(frame), 2.0)
    at = frame.to_local(*field.crop[corner])
    shown = plan_field(
        areas, at, Vehicle(), "three_point", 2.0, field.known_to_m, recorded=field.recorded
    )
    assert shown == driven


def test_an_inset_that_leaves_nothing_is_refused() -> None:
    with pytest.raises(UserError, match="inset of 6 m nothing is left"):
        plan_of(Boundary(tuple(SQUARE)), 0, Vehicle(), "three_point", 2.0, inset_m=6.0)


def ring(corners: int, radius_m: float) -> list[tuple[float, float]]:
    """Edges of radius_m * 0.26 with 24 corners."""
    turns = [math.tau * k / corners for k in range(corners)]
    return [FRAME.to_wgs84(radius_m * math.cos(t), radius_m * math.sin(t)) for t in turns]


@pytest.mark.parametrize(
    ("corners", "radius_m", "sigma_m", "said"),
    [
        (24, 10.0, None, "24 edges of the boundary are shorter than 5.0 m and its corners are"),
        (24, 10.0, 0.6, "24 edges of the boundary are shorter than 3.0 m and its corners are"),
        (24, 10.0, 0.2, ""),
        (24, 30.0, None, ""),
        (4, 2.0, None, ""),  # a small field is nothing but short edges
    ],
)
def test_edges_shorter_than_their_corners_are_known_are_said_before_anything_moves(
    corners: int, radius_m: float, sigma_m: float | None, said: str
) -> None:
    boundary = Boundary(tuple(ring(corners, radius_m)), sigma_m=sigma_m)
    assert [text[: len(said)] for text in boundary.doubts] == ([said] if said else [])
    assert [text for text in warnings(boundary, 2.0, "gnss") if "edges" in text] == boundary.doubts


def test_points_along_straight_edges_are_no_short_edges() -> None:
    """Of a boundary that was recorded every two metres the corners are what the machine finds."""
    edge = shapely.box(0, 0, 30, 20).exterior
    points = [edge.interpolate(along) for along in np.arange(0.0, edge.length, 2.0)]
    boundary = Boundary(tuple(FRAME.to_wgs84(point.x, point.y) for point in points))
    assert len(boundary.crop) == 50
    assert boundary.doubts == []
