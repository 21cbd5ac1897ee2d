"""Facts about what a field's file leaves in doubt: what lies in the field and is no keep-out, and
numbers that were rounded."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.field.boundary_file import Boundary, load_field, save_field
from host.field.shapes import Mark
from tests.helpers.console import Cli

Ring = list[tuple[float, float]]

FRAME = LocalFrame(31.5, 74.3)
FIELD: Ring = [(0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (0.0, 30.0)]
ACROSS_EDGE: Ring = [(39.0, 10.0), (42.0, 10.0), (42.0, 13.0), (39.0, 13.0)]
POLE: Ring = [(39.8, 10.0), (40.2, 10.0), (40.2, 10.4), (39.8, 10.4)]


def degrees(ring: Ring) -> list[list[float]]:
    """Longitude first."""
    return [list(FRAME.to_wgs84(*place)[::-1]) for place in ring]


def polygon(name: str, ring: Ring) -> dict[str, Any]:
    return feature(name, "Polygon", [degrees([*ring, ring[0]])])


def feature(name: str, kind: str, coordinates: Any) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": {"name": name}, "geometry": geometry}


def saved(path: Path, *more: dict[str, Any]) -> Path:
    """A GeoJSON with the field and what else there is."""
    features = [polygon("North", FIELD), *more]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def names(field: Boundary) -> str:
    """Of what it leaves out."""
    return ", ".join(mark.name for mark in field.left_out)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (feature("well", "Point", degrees([(20.0, 15.0)])[0]), "'well' (Point)"),
        (feature("wire", "LineString", degrees([(-9.0, 9.0), (20.0, 15.0)])), "'wire' (LineSt"),
        (polygon("pond", ACROSS_EDGE), "'pond' (Polygon)"),
        (polygon("pole", POLE), "'pole' (Polygon)"),
        (
            feature("trees", "MultiPoint", degrees([(9.0 + k, 9.0) for k in range(8)])),
            "'trees' (Point), 'trees' (Point), 'trees' (Point) and 3 more",
        ),
    ],
    ids=["point", "line", "over the edge", "pole at the edge", "many"],
)
def test_what_lies_in_the_field_and_is_no_keep_out_is_said(
    tmp_path: Path, more: dict[str, Any], said: str
) -> None:
    field = load_field(saved(tmp_path / "field.geojson", more), "North")
    assert said in field.not_kept_out
    assert any(said in doubt and "drives over" in doubt for doubt in field.doubts)
    assert field.keep_outs == ()


@pytest.mark.parametrize(
    "more",
    [
        feature("gate", "Point", degrees([(60.0, 15.0)])[0]),
        feature("corner", "Point", degrees(FIELD)[2]),
        feature("outline", "LineString", degrees([*FIELD, FIELD[0]])),
        polygon("neighbour", [(39.99, 0.0), (90.0, 0.0), (90.0, 30.0), (39.99, 30.0)]),
        polygon("North, last year", [*FIELD[1:], FIELD[0]]),
        polygon("pond", [(10.0, 10.0), (14.0, 10.0), (14.0, 15.0)]),
    ],
    ids=["outside", "corner", "outline", "neighbour", "twice", "keep-out"],
)
def test_what_is_beside_it_or_kept_out_is_no_doubt(tmp_path: Path, more: dict[str, Any]) -> None:
    field = load_field(saved(tmp_path / "field.geojson", more), "1")
    assert (field.left_out, field.doubts) == ((), [])


def test_a_placemark_in_the_field_is_said(tmp_path: Path) -> None:
    around = " ".join(f"{lon},{lat}" for lon, lat in degrees([*FIELD, FIELD[0]]))
    (lon, lat), *_ = degrees([(20.0, 15.0)])
    (path := tmp_path / "field.kml").write_text(
        "<kml><Document><Placemark><name>North</name><Polygon><outerBoundaryIs><LinearRing>"
        f"<coordinates>{around}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>"
        f"<Placemark><name>well</name><Point><coordinates>{lon},{lat}</coordinates></Point>"
        "</Placemark></Document></kml>"
    )
    assert names(load_field(path)) == "'well' (Point)"


def test_a_waypoint_in_the_field_is_said(tmp_path: Path) -> None:
    track = "".join(f'<trkpt lat="{lat}" lon="{lon}"/>' for lon, lat in degrees(FIELD))
    (lon, lat), *_ = degrees([(20.0, 15.0)])
    (path := tmp_path / "field.gpx").write_text(
        '<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1">'
        f'<wpt lat="{lat}" lon="{lon}"><name>tree</name></wpt>'
        f"<trk><trkseg>{track}</trkseg></trk></gpx>"
    )
    assert names(load_field(path)) == "'tree' (Point)"


def points(ring: Ring, kind: str = "2", name: str = "") -> str:
    return "".join(
        f'<PNT A="{kind}" B="{name}" C="{lat}" D="{lon}"/>' for lon, lat in degrees(ring)
    )


@pytest.mark.parametrize(
    ("element", "said"),
    [
        (points([(20.0, 15.0)], "5", "mast"), "'mast' (Point)"),
        (points([(20.0, 15.0)], "10", "reference"), ""),
        ('<PNT A="5" B="nowhere"/>', ""),
        (f'<LSG A="9" B="wall">{points(FIELD[::2])}</LSG>', "'wall' (LineString)"),
        (f'<LSG A="3" B="tramline">{points(FIELD[::2])}</LSG>', ""),
        (
            f'<PLN A="12" B="trees"><LSG A="1">{points(ACROSS_EDGE)}</LSG></PLN>',
            "'trees' (LineString)",
        ),
    ],
    ids=["obstacle", "reference", "nowhere", "wall", "tramline", "windbreak"],
)
def test_isoxml_obstacles_without_an_outline_are_said(
    tmp_path: Path, element: str, said: str
) -> None:
    (path := tmp_path / "TASKDATA.XML").write_text(
        '<ISO11783_TaskData VersionMajor="4"><PFD A="PFD1" C="North" D="0"><PLN A="1">'
        f'<LSG A="1">{points(FIELD)}</LSG></PLN>{element}</PFD></ISO11783_TaskData>'
    )
    assert names(load_field(path)) == said


def test_another_format_loses_nothing_unsaid(tmp_path: Path, cli: Cli) -> None:
    source = saved(tmp_path / "field.geojson", polygon("pond", ACROSS_EDGE))
    for target in ("kept.geojson", "field.kml"):
        code, out, _ = cli("convert", str(source), str(tmp_path / target), "--field", "North")
        assert code == 0
        assert "'pond' (Polygon)" in out
    assert names(load_field(tmp_path / "kept.geojson")) == "'pond' (Polygon)"


def test_it_is_kept_with_the_field(tmp_path: Path) -> None:
    crop = tuple(FRAME.to_wgs84(*place) for place in FIELD)
    latitude, longitude = FRAME.to_wgs84(20.0, 15.0)
    well = Mark("'well' (Point)", longitude, latitude)
    save_field(path := tmp_path / "field.geojson", Boundary(crop, left_out=(well,)))
    assert load_field(path).left_out == (well,)


@pytest.mark.parametrize("wrong", ["well", "[1]", '[["well", "east", 3]]', 7])
def test_a_list_of_it_that_was_spoilt_is_told(tmp_path: Path, wrong: Any) -> None:
    spoilt = polygon("North", FIELD)
    spoilt["properties"]["left_out"] = wrong
    (path := tmp_path / "field.geojson").write_text(json.dumps(spoilt))
    with pytest.raises(UserError, match="its left_out is not a list"):
        load_field(path)


@pytest.mark.parametrize(
    ("digits", "off"), [(3, "up to 56 m"), (4, "up to 6 m"), (5, ""), (6, ""), (7, "")]
)
def test_corners_that_were_rounded_to_metres_are_told(
    tmp_path: Path, digits: int, off: str
) -> None:
    square = [(0.0003, 0.0003), (0.0059, 0.0003), (0.0059, 0.0044), (0.0003, 0.0044)]
    lines = [f"{31.5112368 + y:.{digits}f},{74.3112392 + x:.{digits}f}\n" for x, y in square]
    (path := tmp_path / "field.csv").write_text("".join(lines))
    doubts = load_field(path).doubts
    assert len(doubts) == bool(off)
    assert all(f"{digits} decimals" in doubt and off in doubt for doubt in doubts)
    save_field(known := tmp_path / "known.geojson", replace(load_field(path), sigma_m=0.2))
    assert load_field(known).doubts == [], "somebody has said how surely they are known"
