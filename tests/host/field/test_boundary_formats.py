"""Facts about the files that a field is read from and written to."""

from __future__ import annotations

import contextlib
import json
import math
import resource
import signal
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from isoxml.converter.shapely_geom import ShapelyConverterV4
from isoxml.util.isoxml_io import isoxml_from_path
from pyproj import CRS, Transformer

from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.field.boundary_file import (
    UNKNOWN_SIGMA_M,
    Boundary,
    LatLon,
    boundary_of,
    load_field,
    save_field,
)
from tests.helpers.console import Cli

SUFFIXES = (".geojson", ".kml", ".shp", ".xml")
MILLIMETRE = 1e-3
"""GDAL rounds a run of nines in text: not to the last of the digits that it writes."""
FRAME = LocalFrame(31.5, 74.3)
POND = shapely.Polygon(
    [(0, 0), (40, 0), (40, 30), (0, 30)], [[(10, 10), (14, 10), (14, 15), (10, 15)]]
)


@st.composite
def fields(draw: st.DrawFn) -> Boundary:
    """Star-shaped fields of 3 to 12 corners anywhere on earth, with up to two round keep-outs."""
    frame = LocalFrame(draw(st.floats(-70, 70)), draw(st.floats(-179, 179)))
    count = draw(st.integers(3, 12))
    radii = draw(st.lists(st.floats(20, 200), min_size=count, max_size=count))
    ring = [
        (r * math.cos(k * math.tau / count), r * math.sin(k * math.tau / count))
        for k, r in enumerate(radii)
    ]
    holes = [
        [(x + math.cos(a), math.sin(a)) for a in np.linspace(0, math.tau, 5, endpoint=False)]
        for x in draw(st.sampled_from([(), (0.0,), (-2.0, 2.0)]))
    ]
    name = draw(st.text(st.characters(codec="utf-8", categories=["L", "N"]), max_size=20))
    polygon = shapely.Polygon(ring, holes)
    if not polygon.is_valid:  # a triangle of long and short rays may not hold them
        polygon = shapely.Polygon(ring)
    return boundary_of(polygon, frame, name)


def assert_same(a: Boundary, b: Boundary) -> None:
    """The same rings, whichever corner comes first and in whichever order the keep-outs do."""
    frame = a.frame

    def rings(boundary: Boundary) -> list[list[LatLon]]:
        found = []
        for ring in (boundary.crop, *boundary.keep_outs):
            local = [frame.to_local(*corner) for corner in ring]
            first = min(range(len(local)), key=lambda k: (round(local[k][0], 2), local[k][1]))
            found.append(local[first:] + local[:first])
        return [found[0], *sorted(found[1:])]

    for one, other in zip(rings(a), rings(b), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=MILLIMETRE)


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=25, deadline=None)
@given(field=fields())
def test_what_is_written_is_read_back(suffix: str, field: Boundary) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"field{suffix}"
        save_field(path, field)
        back = load_field(path)
    assert_same(field, back)
    if field.name:
        assert back.name == field.name


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".csv"])
def test_corners_keep_their_numbers(tmp_path: Path, suffix: str) -> None:
    """The survey's picture numbers them, `--start` and `--corner` name them."""
    field = boundary_of(shapely.Polygon(POND.exterior), FRAME)
    save_field(path := tmp_path / f"field{suffix}", field)
    for before, after in zip(field.crop, load_field(path).crop, strict=True):
        assert after == pytest.approx(before, abs=1e-8)


@settings(max_examples=25, deadline=None)
@given(field=fields())
def test_csv_keeps_the_crops_edge(field: Boundary) -> None:
    bare = Boundary(field.crop)
    with tempfile.TemporaryDirectory() as folder:
        save_field(path := Path(folder) / "field.csv", bare)
        assert_same(bare, load_field(path))


@contextlib.contextmanager
def full_disk() -> Iterator[None]:
    """Of this process, no file takes another byte: GDAL's writes fail as on a full disk, and so
    would pytest's own, where its output goes to a file."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".csv"])
def test_what_did_not_arrive_whole_is_said_and_what_was_there_stays(
    tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"field{suffix}"
    square = boundary_of(shapely.box(0, 0, 20, 20), FRAME, "before")
    save_field(path, square)
    there = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    with full_disk(), pytest.raises(UserError, match=f"cannot write {path}: "):
        save_field(path, boundary_of(shapely.box(0, 0, 30, 30), FRAME, "after"))
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == there


def test_csv_refuses_keep_outs_rather_than_losing_them(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="CSV has no keep-outs"):
        save_field(tmp_path / "field.csv", boundary_of(POND, FRAME))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_latitude_and_longitude_keep_their_places(tmp_path: Path, suffix: str) -> None:
    """Lahore: a swap would put the field beyond the Arctic circle."""
    path = tmp_path / f"field{suffix}"
    save_field(path, boundary_of(POND, FRAME))
    for lat, lon in load_field(path).crop:
        assert lat == pytest.approx(31.5, abs=0.01)
        assert lon == pytest.approx(74.3, abs=0.01)


def test_geojson_has_longitude_first_and_the_outer_ring_counter_clockwise(tmp_path: Path) -> None:
    path = tmp_path / "field.geojson"
    save_field(path, boundary_of(POND, FRAME))
    outer, hole = json.loads(path.read_text())["features"][0]["geometry"]["coordinates"]
    assert outer[0] == pytest.approx([74.3, 31.5], abs=1e-9)
    assert shapely.LinearRing(outer).is_ccw
    assert not shapely.LinearRing(hole).is_ccw


@pytest.mark.parametrize(
    "crs",
    ["EPSG:32643", "EPSG:24378", "EPSG:3857"],
    ids=["UTM 43 N", "Kalianpur India zone I", "web Mercator"],
)
def test_a_projected_shapefile_is_read_through_its_prj(tmp_path: Path, crs: str) -> None:
    field = boundary_of(POND, FRAME)
    transformer = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    projected = shapely.Polygon(
        [transformer.transform(lon, lat) for lat, lon in field.crop],
        [[transformer.transform(lon, lat) for lat, lon in ring] for ring in field.keep_outs],
    )
    path = tmp_path / "field.shp"
    write(path, [projected], crs)
    assert CRS(path.with_suffix(".prj").read_text()).is_projected
    assert_same(field, load_field(path))


def write(path: Path, shapes: list[shapely.Geometry], crs: str | None = "EPSG:4326") -> None:
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(np.array(shapes, dtype=object)),
        field_data=[],
        fields=[],
        geometry_type=shapes[0].geom_type,
        driver={".kml": "KML"}.get(path.suffix),
        crs=crs,
    )


@pytest.mark.filterwarnings("ignore:'crs' was not provided")
def test_a_shapefile_without_prj_is_refused_not_guessed(tmp_path: Path) -> None:
    path = tmp_path / "field.shp"
    write(path, [shapely.box(74.3, 31.5, 74.301, 31.501)], None)
    with pytest.raises(UserError, match=r"put the \.prj file"):
        load_field(path)


def test_a_shapefile_without_its_index_says_which_file_is_missing(tmp_path: Path) -> None:
    write(tmp_path / "field.shp", [POND])
    (tmp_path / "field.shx").unlink()
    with pytest.raises(UserError, match=r"its \.shx file is missing"):
        load_field(tmp_path / "field.shp")


def test_a_polygon_inside_the_field_is_a_keep_out(tmp_path: Path) -> None:
    """As one draws a tree in a map program."""
    path = tmp_path / "field.kml"
    write(
        path,
        [shapely.box(74.3, 31.5, 74.301, 31.501), shapely.Point(74.3005, 31.5005).buffer(1e-5)],
    )
    assert len(load_field(path).keep_outs) == 1


def test_two_fields_side_by_side_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "fields.geojson"
    write(
        path, [shapely.box(74.3, 31.5, 74.301, 31.501), shapely.box(74.302, 31.5, 74.303, 31.501)]
    )
    with pytest.raises(UserError, match="2 fields side by side"):
        load_field(path)


@pytest.mark.parametrize(
    ("ring", "message"),
    [
        ([(0, 0), (10, 10), (10, 0), (0, 10)], "sides cross"),
        ([(0, 0), (10, 0), (20, 0.05)], "encloses 0.2 m2"),
    ],
)
def test_no_polygon_is_no_field(ring: list[LatLon], message: str) -> None:
    with pytest.raises(UserError, match=message):
        boundary_of(shapely.Polygon(ring), FRAME)


def test_keep_outs_that_cross_are_refused() -> None:
    holes = [list(shapely.box(x, 5, x + 5, 10).exterior.coords) for x in (5, 8)]
    with pytest.raises(UserError, match="keep-outs cross"):
        boundary_of(shapely.Polygon(POND.exterior, holes), FRAME)


# ---- ISOXML --------------------------------------------------------------------------------------

SQUARE = "".join(
    f'<PNT A="2" C="{lat}" D="{lon}"/>'
    for lat, lon in [(31.5, 74.3), (31.5, 74.301), (31.501, 74.301), (31.501, 74.3)]
)
EAST = SQUARE.replace("74.3", "74.4")
TREE = "".join(
    f'<PNT A="5" C="{lat}" D="{lon}"/>'
    for lat, lon in [(31.5004, 74.3004), (31.5004, 74.3005), (31.5005, 74.3005)]
)


def task(body: str) -> str:
    return f'<?xml version="1.0"?><ISO11783_TaskData VersionMajor="3">{body}</ISO11783_TaskData>'


def partfield(name: str, inner: str = f'<LSG A="1">{SQUARE}</LSG>') -> str:
    return f'<PFD A="PFD1" C="{name}" D="0"><PLN A="1">{inner}</PLN></PFD>'


def test_isoxml_from_another_program_is_read(tmp_path: Path) -> None:
    """A task set's folder, an obstacle of its own, elements of no concern."""
    folder = tmp_path / "TASKDATA"
    folder.mkdir()
    obstacle = f'<PLN A="6"><LSG A="1">{TREE}</LSG></PLN>'
    road = f'<PLN A="5"><LSG A="1">{SQUARE}</LSG></PLN>'
    body = '<CTR A="CTR1" B="Farmer"/>' + partfield("North").replace(
        "</PFD>", obstacle + road + "</PFD>"
    )
    (folder / "TASKDATA.XML").write_text(task(body))
    field = load_field(tmp_path)
    assert field.name == "North"
    assert field.crop[0] == (31.5, 74.3)
    assert len(field.crop) == 4
    assert len(field.keep_outs) == 1


def test_isoxml_partfields_in_a_file_of_their_own_are_found(tmp_path: Path) -> None:
    (tmp_path / "TASKDATA.XML").write_text(task('<XFR A="PFD00001" B="1"/>'))
    path = tmp_path / "TASKDATA.XML"
    with pytest.raises(UserError, match=r"refers to PFD00001\.XML"):
        load_field(path)
    (tmp_path / "PFD00001.XML").write_text(f"<XFC>{partfield('South')}</XFC>")
    assert load_field(path).name == "South"


def test_isoxml_in_a_zip_is_read_with_its_second_file(tmp_path: Path) -> None:
    with zipfile.ZipFile(path := tmp_path / "export.zip", "w") as archive:
        archive.writestr("TASKDATA/TASKDATA.XML", task('<XFR A="PFD00001" B="1"/>'))
        archive.writestr("TASKDATA/PFD00001.XML", f"<XFC>{partfield('South')}</XFC>")
        archive.writestr("../../escaped.txt", "nowhere")
    assert load_field(path).name == "South"
    assert not (tmp_path.parent.parent / "escaped.txt").exists()


def kml(name: str = "North") -> str:
    """As Google Earth saves it."""
    around = " ".join(f"{lon},{lat},312" for lon, lat in [*AROUND, AROUND[0]])
    return (
        '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2" '
        'xmlns:gx="http://www.google.com/kml/ext/2.2"><Document><name>doc.kml</name><Folder>'
        f"<Placemark><name>{name}</name><Polygon><tessellate>1</tessellate><outerBoundaryIs>"
        f"<LinearRing><coordinates>\n\t{around} \n</coordinates></LinearRing></outerBoundaryIs>"
        "</Polygon></Placemark></Folder></Document></kml>"
    )


@pytest.mark.parametrize("name", ["field.kmz", "field.zip"])
def test_google_earths_own_file_is_read(tmp_path: Path, name: str) -> None:
    with zipfile.ZipFile(path := tmp_path / name, "w") as archive:
        archive.writestr("files/icon.png", b"nothing of ours")
        archive.writestr("doc.kml", kml("Nördliches Feld"))
    field = load_field(path)
    assert (field.name, len(field.crop)) == ("Nördliches Feld", 4)


def placemark(name: str, east: float = 0.0) -> str:
    """A field of its own, `east` degrees farther."""
    around = " ".join(f"{lon + east},{lat}" for lon, lat in [*AROUND, AROUND[0]])
    return (
        f"<Placemark><name>{name}</name><Polygon><outerBoundaryIs><LinearRing><coordinates>"
        f"{around}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>"
    )


@pytest.mark.parametrize("around", ["<Document>{}</Document>", "<Folder>{}</Folder>", "{}"])
def test_kml_whose_document_has_no_name_is_read(tmp_path: Path, around: str) -> None:
    path = tmp_path / "field.kml"
    path.write_text(f"<kml>{around.format(placemark('North'))}</kml>")
    field = load_field(path)
    assert (field.name, len(field.crop)) == ("North", 4)


def test_kml_folders_of_the_same_name_are_each_read(tmp_path: Path) -> None:
    path = tmp_path / "fields.kml"
    folders = "".join(
        f"<Folder><name>2026</name>{placemark(name, east)}</Folder>"
        for name, east in (("North", 0.0), ("South", 0.1))
    )
    path.write_text(f"<kml><Document>{folders}</Document></kml>")
    with pytest.raises(UserError, match="1 'North', 2 'South'"):
        load_field(path)
    assert load_field(path, "South").name == "South"


def test_what_gdal_doubts_is_no_second_message(
    tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    path = tmp_path / "field.kml"
    path.write_text(f"<kml>{placemark('North')}</kml>".replace(f"{AROUND[0][0]},", "x,", 1))
    with pytest.raises(UserError):
        load_field(path)
    assert [str(warning.message) for warning in recwarn] == []


@pytest.mark.parametrize("folder", ["", "export/North/"])
def test_a_zipped_shapefile_is_read_with_the_files_that_belong_to_it(
    tmp_path: Path, folder: str
) -> None:
    field = boundary_of(POND, FRAME, "Pond")
    save_field(tmp_path / "x.shp", field)
    with zipfile.ZipFile(path := tmp_path / "export.zip", "w") as archive:
        for suffix in (".shp", ".SHX", ".dbf", ".prj", ".cpg"):
            content = (tmp_path / f"x{suffix.lower()}").read_bytes()
            archive.writestr(f"{folder}boundary{suffix}", content)
        archive.writestr("../../escaped.prj", "nowhere")
    read = load_field(path)
    assert read.name == "Pond"
    assert_same(read, field)
    assert not (tmp_path.parent.parent / "escaped.prj").exists()


def test_what_a_mac_writes_into_a_zip_besides_is_no_field(tmp_path: Path) -> None:
    with zipfile.ZipFile(path := tmp_path / "export.zip", "w") as archive:
        archive.writestr("farm/field.geojson", collection(feature("North", AROUND)))
        archive.writestr("__MACOSX/farm/._field.geojson", b"\0\5\x16\7")
    assert load_field(path).name == "North"


def test_what_a_zips_other_formats_have_besides_is_not_lost(tmp_path: Path) -> None:
    """The field in two formats is one field; the pond that only one of them has is a keep-out."""
    lon, lat = AROUND[0]
    pond = [(lon + x, lat + y) for x, y in [(4e-4, 4e-4), (5e-4, 4e-4), (5e-4, 5e-4)]]
    rounded = [(round(x, 6) + 1e-6, y) for x, y in AROUND]
    with zipfile.ZipFile(path := tmp_path / "export.zip", "w") as archive:
        archive.writestr("field.kml", kml("North"))
        archive.writestr("more.geojson", collection(feature("north", rounded), feature("P", pond)))
        archive.writestr("about.json", '{"program": "of a farm"}')
    field = load_field(path)
    assert field.name == "North"
    assert len(field.keep_outs) == 1
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("south.gpx", gpx_around(moved(AROUND, 0.01)))
    with pytest.raises(UserError, match=r"2 fields side by side: 1 'North', 2 'South'"):
        load_field(path)
    assert load_field(path, "North") == field


def gpx_around(ring: list[tuple[float, float]]) -> str:
    points = "".join(f'<trkpt lat="{lat}" lon="{lon}"/>' for lon, lat in ring)
    return (
        '<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1"><trk>'
        f"<name>South</name><trkseg>{points}</trkseg></trk></gpx>"
    )


def test_a_zip_of_something_else_says_what_it_may_hold(tmp_path: Path) -> None:
    with zipfile.ZipFile(path := tmp_path / "export.zip", "w") as archive:
        archive.writestr("photo.jpg", b"")
    with pytest.raises(UserError, match=r"no TASKDATA\.XML in it and no \.shp, \.kml"):
        load_field(path)


def test_a_zip_that_would_fill_the_memory_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(path := tmp_path / "e.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("TASKDATA.XML", b" " * 70_000_000)
    with pytest.raises(UserError, match="would take 70 MB"):
        load_field(path)


def test_what_is_written_is_what_isoxml_itself_reads(tmp_path: Path) -> None:
    save_field(tmp_path / "TASKDATA.XML", boundary_of(POND, FRAME, "Pond"))
    found, _ = isoxml_from_path(tmp_path)
    (partfield_,) = found.partfields
    assert partfield_.designator == "Pond"
    assert partfield_.area == 1180
    polygon = ShapelyConverterV4().to_shapely_polygon(partfield_.polygons[0])
    assert len(polygon.interiors) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<kml/>", "its root is <kml>"),
        ("<ISO11783", "not XML that can be read"),
        (
            '<!DOCTYPE x [<!ENTITY a "b">]><ISO11783_TaskData>&a;</ISO11783_TaskData>',
            "not XML that can be read",
        ),
        (task(""), "no partfield"),
        (
            task(partfield("North") + partfield("South", f'<LSG A="1">{EAST}</LSG>')),
            "1 'North', 2 'South'",
        ),
        (task(partfield("N", f'<LSG A="1">{SQUARE}</LSG>' * 2)), "2 outer rings"),
        (task(partfield("N", '<LSG A="1"><PNT A="2" J="x.bin"/></LSG>')), "binary file"),
        (task(partfield("N", '<LSG A="1"><PNT A="2" C="31"/></LSG>')), "no numbers in C"),
    ],
)
def test_bad_isoxml_is_one_message(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "TASKDATA.XML"
    path.write_text(text)
    with pytest.raises(UserError, match=message) as error:
        load_field(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("spoilt", "message"),
    [
        (f'<LSG A="1">{SQUARE}</LSG>' * 2, "2 outer rings"),
        ('<LSG A="1"><PNT A="2" C="31" D="74"/></LSG>', "fewer than three corners"),
        ('<LSG A="1"><PNT A="2" C="31"/></LSG>', "no numbers in C"),
    ],
)
def test_a_partfield_that_nobody_can_use_is_no_obstacle_to_the_others(
    tmp_path: Path, spoilt: str, message: str
) -> None:
    path = tmp_path / "TASKDATA.XML"
    path.write_text(task(partfield("North", spoilt) + partfield("South")))
    assert load_field(path, "South").name == "South"
    with pytest.raises(UserError, match="1 'North', 2 'South'"):
        load_field(path)
    with pytest.raises(UserError, match=message):
        load_field(path, "North")


# ---- anything at all -----------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".csv"])
@settings(max_examples=25, deadline=None)
@given(data=st.one_of(st.binary(max_size=200), st.just(task(partfield("N")).encode()[:-40])))
def test_garbage_is_one_message(suffix: str, data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"field{suffix}"
        path.write_bytes(data)
        try:
            load_field(path)
        except UserError as error:
            assert "\n" not in str(error)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("deep.kml", f"<kml>{'<Folder>' * 5000}{'</Folder>' * 5000}</kml>", "not XML"),
        ("deep.gpx", f"<gpx>{'<trk>' * 5000}{'</trk>' * 5000}</gpx>", "not GPX"),
        ("deep.xml", task(f"{'<PFD>' * 5000}{'</PFD>' * 5000}"), "not ISOXML"),
        ("odd.gpx", '<?xml version="1.0" encoding="odd"?><gpx/>', "not GPX"),
        (
            "odd.geojson",
            '{"type": "FeatureCollection", "features": [], "crs": {"properties": 5}}',
            "coordinate system",
        ),
        ("none.geojson", '{"type": "Polygon", "coordinates": []}', "holds no polygon"),
        (
            "none.kml",
            "<kml><Placemark><Polygon><outerBoundaryIs><LinearRing><coordinates/></LinearRing>"
            "</outerBoundaryIs></Polygon></Placemark></kml>",
            "holds no polygon",
        ),
    ],
)
def test_odd_structures_are_one_message(tmp_path: Path, name: str, text: str, message: str) -> None:
    (path := tmp_path / name).write_text(text)
    with pytest.raises(UserError, match=message):
        load_field(path)


def test_the_command_converts_and_says_what_it_wrote(tmp_path: Path, cli: Cli) -> None:
    save_field(source := tmp_path / "field.kml", boundary_of(POND, FRAME, "Pond"))
    target = tmp_path / "TASKDATA.XML"
    code, out, err = cli("convert", str(source), str(target))
    assert (code, err) == (0, "")
    assert "Pond, 4 corners, 1 keep-outs, 1180 m2" in out
    assert_same(load_field(source), load_field(target))


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".csv"])
def test_a_files_name_is_no_reason_to_warn(
    tmp_path: Path, cli: Cli, recwarn: pytest.WarningsRecorder, suffix: str
) -> None:
    save_field(tmp_path / "a.csv", boundary_of(shapely.box(0, 0, 20, 20), FRAME))
    target = tmp_path / f"My field-2, süd{suffix}"
    code, out, err = cli("convert", str(tmp_path / "a.csv"), str(target))
    assert (code, err) == (0, "")
    assert str(target) in out
    assert [str(warning.message) for warning in recwarn] == []


@pytest.mark.parametrize("name", ["field.dwg", "nowhere/field.kml"])
def test_a_target_that_cannot_be_is_one_message(tmp_path: Path, cli: Cli, name: str) -> None:
    save_field(source := tmp_path / "field.kml", boundary_of(POND, FRAME))
    code, _, err = cli("convert", str(source), str(tmp_path / name))
    assert code == 2
    assert "cannot write" in err
    assert len(err.splitlines()) == 1


# ---- what farm programs and strangers send -------------------------------------------------------

AROUND = [(74.3, 31.5), (74.301, 31.5), (74.301, 31.501), (74.3, 31.501)]


def feature(name: str, ring: list[tuple[float, float]], kind: str = "Polygon") -> dict[str, Any]:
    closed = [*ring, ring[0]]
    coordinates = [closed] if kind == "Polygon" else closed
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": {"name": name}, "geometry": geometry}


def collection(*features: dict[str, Any]) -> str:
    return json.dumps({"type": "FeatureCollection", "features": list(features)})


def moved(ring: list[tuple[float, float]], by_deg: float) -> list[tuple[float, float]]:
    return [(lon + by_deg, lat) for lon, lat in ring]


@pytest.mark.parametrize(
    ("heading", "line"),
    [
        ("longitude,latitude", "{1},{0}"),
        ("id,lon,lat", "7,{1},{0}"),
        ("Lat;Long", "{0};{1}"),
        ("latitude,longitude", "{0},{1}"),
        ("north,east", "{0},{1}"),
        ("Id\tLatitude\tLongitude", "7\t{0}\t{1}"),
    ],
)
def test_a_csv_heading_says_which_number_is_which(tmp_path: Path, heading: str, line: str) -> None:
    path = tmp_path / "field.csv"
    rows = [line.format(lat, lon) for lon, lat in AROUND]
    path.write_text("\n".join([heading, *rows]))
    assert load_field(path).crop[0] == (31.5, 74.3)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimals_may_have_a_comma_where_another_sign_divides(
    tmp_path: Path, separator: str
) -> None:
    path = tmp_path / "field.csv"
    rows = [f"{lat}{separator}{lon}".replace(".", ",") for lon, lat in AROUND]
    path.write_text("\n".join(rows))
    assert load_field(path).crop == tuple((lat, lon) for lon, lat in AROUND)


@pytest.mark.parametrize("suffix", [".geojson", ".csv"])
def test_swapped_numbers_are_told(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"field{suffix}"
    swapped = [(lat, lon) for lon, lat in AROUND]
    text = collection(feature("a", swapped))
    path.write_text(text if suffix == ".geojson" else "\n".join(f"{b},{a}" for a, b in swapped))
    with pytest.raises(UserError, match="swapped"):
        load_field(path)


def test_lines_and_points_among_the_features_mean_nothing(tmp_path: Path) -> None:
    path = tmp_path / "field.geojson"
    path.write_text(collection(feature("road", AROUND, "LineString"), feature("North", AROUND)))
    assert load_field(path).name == "North"


def test_of_several_fields_one_is_named(tmp_path: Path, cli: Cli) -> None:
    path = tmp_path / "farm.geojson"
    tree = [(74.3004, 31.5004), (74.3005, 31.5004), (74.3005, 31.5005)]
    path.write_text(
        collection(
            feature("North", AROUND), feature("East", moved(AROUND, 0.01)), feature("", tree)
        )
    )
    with pytest.raises(UserError, match="1 'North', 2 'East'; say which with --field"):
        load_field(path)
    assert load_field(path, "east").name == "East"
    assert len(load_field(path, "1").keep_outs) == 1
    with pytest.raises(UserError, match="--field West: it holds"):
        load_field(path, "West")
    code, out, _ = cli("convert", str(path), str(tmp_path / "a.csv"), "--field", "East")
    assert code == 0
    assert "East, 4 corners" in out


def test_polygons_that_cross_are_one_message(tmp_path: Path) -> None:
    path = tmp_path / "field.geojson"
    bow = [AROUND[0], AROUND[2], AROUND[1], AROUND[3]]
    path.write_text(collection(feature("North", AROUND), feature("bow", bow)))
    with pytest.raises(UserError, match="sides of 'bow' cross"):
        load_field(path)


def test_a_field_is_read_whatever_another_one_of_the_file_is_like(tmp_path: Path) -> None:
    path = tmp_path / "farm.geojson"
    bow = moved([AROUND[0], AROUND[2], AROUND[1], AROUND[3]], 0.01)
    path.write_text(collection(feature("North", AROUND), feature("bow", bow)))
    assert load_field(path, "North").name == "North"
    with pytest.raises(UserError, match="1 'North', 2 'bow'; say which"):
        load_field(path)
    with pytest.raises(UserError, match="sides of 'bow' cross"):
        load_field(path, "bow")


def test_a_field_that_is_there_twice_is_one_field_and_no_keep_out(tmp_path: Path) -> None:
    path = tmp_path / "field.geojson"
    path.write_text(collection(feature("2025", AROUND), feature("2026", [*AROUND[1:], AROUND[0]])))
    field = load_field(path)
    assert (field.name, len(field.crop), field.keep_outs) == ("2025", 4, ())


@pytest.mark.parametrize("more", [[[212.0]], [[212.0, 3.0]], [[212.0], []], [[None]]])
def test_what_follows_a_places_two_numbers_is_left_out(tmp_path: Path, more: Any) -> None:
    ring = [[*place, *more[k % len(more)]] for k, place in enumerate([*AROUND, AROUND[0]])]
    path = tmp_path / "field.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    assert load_field(path).crop == tuple((lat, lon) for lon, lat in AROUND)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_geojson_is_read_in_every_encoding_that_it_may_have(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "field.geojson"
    text = collection(feature("Öd", AROUND)).replace("\\u00d6", "Ö")
    path.write_text(text, encoding=encoding)
    assert load_field(path).name == "Öd"


def test_json_of_another_encoding_says_which_one_it_needs(tmp_path: Path) -> None:
    path = tmp_path / "field.geojson"
    text = collection(feature("Öd", AROUND)).replace("\\u00d6", "Ö")
    path.write_text(text, encoding="latin-1")
    with pytest.raises(UserError, match="save it as UTF-8"):
        load_field(path)


def test_a_device_is_not_read_for_ever() -> None:
    with pytest.raises(UserError, match="/dev/zero: it is a device or a pipe, no file"):
        load_field(Path("/dev/zero"))


def test_a_database_is_no_list_of_places(tmp_path: Path) -> None:
    path = tmp_path / "field.gpkg"
    path.write_bytes(b"SQLite format 3\0" * 10)
    with pytest.raises(UserError, match=r"neither UTF-8 text nor a known format;.* use \.geojson"):
        load_field(path)


Ring = list[tuple[float, float]]


def geojson(path: Path, *rings: Ring, hole: Ring | None = None) -> Path:
    """A MultiPolygon of outer rings in metres of FRAME, named A, with a hole in the last."""
    polygons = [[ring] for ring in rings]
    polygons[-1] += [hole] if hole is not None else []
    degrees = [
        [[FRAME.to_wgs84(*place)[::-1] for place in [*ring, ring[0]]] for ring in polygon]
        for polygon in polygons
    ]
    geometry = {"type": "MultiPolygon", "coordinates": degrees}
    path.write_text(
        json.dumps({"type": "Feature", "properties": {"FIELD_NAME": "A"}, "geometry": geometry})
    )
    return path


FOUR = [(0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (0.0, 30.0)]


@pytest.mark.parametrize(
    "ring",
    [
        pytest.param([*FOUR, (0.03, -0.05)], id="overlaps its begin"),
        pytest.param([*FOUR[:3], (20, 30), (20, 35), (20, 30), FOUR[3]], id="spike of no width"),
        pytest.param(
            [*FOUR[:3], (20, 30), (20.02, 30.02), (20.02, 29.99), (19.9, 30.01), FOUR[3]],
            id="loop of centimetres",
        ),
    ],
)
def test_a_slip_of_centimetres_makes_a_field_no_less_one(tmp_path: Path, ring: Ring) -> None:
    assert not shapely.Polygon(ring).is_valid
    well = [(10.0, 10.0), (14.0, 10.0), (14.0, 15.0)]
    field = load_field(geojson(tmp_path / "slip.geojson", ring, hole=well))
    polygon = field.polygon(FRAME)
    assert polygon.is_valid
    assert shapely.hausdorff_distance(polygon.exterior, shapely.LinearRing(FOUR)) < 0.1
    assert shapely.Polygon(polygon.interiors[0]).area == pytest.approx(10, rel=1e-3)


@pytest.mark.parametrize("width_m", [3.0, 20.0])
def test_a_crossing_that_encloses_as_much_as_a_field_is_refused(
    tmp_path: Path, width_m: float
) -> None:
    ring = [(0.0, 0.0), (40.0, 0.0), (0.0, 30.0), (width_m, 30.0)]
    with pytest.raises(UserError, match="sides of 'A' cross"):
        load_field(geojson(tmp_path / "bow.geojson", ring))


def test_a_sliver_beside_the_field_is_no_second_field(tmp_path: Path) -> None:
    sliver = [(60.0, 0.0), (60.05, 0.0), (60.05, 0.3)]
    assert len(load_field(geojson(tmp_path / "a.geojson", sliver, FOUR)).crop) == 4
    garden = [(60.0, 0.0), (62.0, 0.0), (62.0, 2.0)]
    with pytest.raises(UserError, match=r"1 'A', 2 'A'; say which with --field NAME or NUMBER"):
        load_field(geojson(tmp_path / "b.geojson", garden, FOUR))


@pytest.mark.parametrize("west_m", [0.0, -1.0])
def test_a_keep_out_at_the_fields_edge_is_refused_and_not_cut_off(
    tmp_path: Path, west_m: float
) -> None:
    well = [(west_m, 12.0), (4.0, 12.0), (4.0, 16.0), (west_m, 16.0)]
    path = geojson(tmp_path / "edge.geojson", FOUR, hole=well)
    with pytest.raises(UserError, match="keep-outs of 'A' cross each other or the field's edge"):
        load_field(path)


def test_metres_of_a_map_are_named(tmp_path: Path) -> None:
    utm = [(596597.8 + x, 5339346.8 + y) for x, y in [*FOUR, FOUR[0]]]
    path = tmp_path / "utm.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [utm]}))
    with pytest.raises(UserError, match="metres of a map"):
        load_field(path)


def test_a_gpx_track_around_a_field_is_read(tmp_path: Path) -> None:
    path = tmp_path / "field.gpx"
    points = "".join(f'<trkpt lat="{lat}" lon="{lon}"/>' for lon, lat in AROUND)
    path.write_text(
        '<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1"><wpt lat="1" '
        f'lon="2"/><trk><name>North</name><trkseg>{points}</trkseg></trk></gpx>'
    )
    field = load_field(path)
    assert (field.name, len(field.crop)) == ("North", 4)
    path.write_text(path.read_text().replace('"74.3"', '"nan"', 1))
    with pytest.raises(UserError, match="a point is no latitude and longitude"):
        load_field(path)
    path.write_text("<gpx")
    with pytest.raises(UserError, match="not GPX"):
        load_field(path)


@pytest.mark.parametrize("suffix", [".geojson", ".json", ".kml", ".shp", ".xml", ".gpx", ".csv"])
@pytest.mark.parametrize("wrap", ["{}", "<kml>{}</kml>", "<!-- {} --><kml/>"])
def test_a_file_that_would_make_gdal_open_another_is_refused(
    tmp_path: Path, suffix: str, wrap: str
) -> None:
    secret = tmp_path / "secret.geojson"
    secret.write_text(collection(feature("Secret", AROUND)))
    vrt = (
        '<OGRVRTDataSource><OGRVRTLayer name="secret"><SrcDataSource>'
        f"{secret}</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>"
    )
    path = tmp_path / f"field{suffix}"
    path.write_text(wrap.format(vrt))
    with pytest.raises(UserError):
        load_field(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_half_a_character_in_a_name_is_written_out(tmp_path: Path, suffix: str) -> None:
    """JSON can say what UTF-8 cannot."""
    (path := tmp_path / "field.geojson").write_text(collection(feature("North \ud83d", AROUND)))
    assert "\\ud83d" in path.read_text()
    save_field(target := tmp_path / f"other{suffix}", load_field(path))
    assert load_field(target).name == r"North \xd83d"


def test_a_name_from_outside_cannot_command_the_terminal(tmp_path: Path, cli: Cli) -> None:
    path = tmp_path / "field.geojson"
    path.write_text(collection(feature("\x1b[2J[/nope]\x07North", AROUND)))
    code, out, err = cli("plan", str(path))
    assert code == 0, err
    assert "\x1b" not in out
    assert "\\x1b[2J[/nope]\\x07North" in out


# ---- how surely its corners are known ------------------------------------------------------------


def test_geojson_says_how_surely_its_corners_are_known(tmp_path: Path) -> None:
    path = tmp_path / "field.geojson"
    save_field(path, boundary_of(POND, FRAME, "Pond", 0.27))
    assert load_field(path).sigma_m == 0.27
    save_field(path, boundary_of(POND, FRAME, "Pond"))
    assert load_field(path).sigma_m is None
    assert load_field(path).known_to_m == UNKNOWN_SIGMA_M


@pytest.mark.parametrize("said", [True, False, None])
def test_geojson_says_whether_its_corners_were_recorded(tmp_path: Path, said: bool | None) -> None:
    path = tmp_path / "field.geojson"
    save_field(path, boundary_of(POND, FRAME, "Pond", 0.27, said))
    assert load_field(path).recorded is said


@pytest.mark.parametrize(
    ("points", "said", "words"),
    [
        (4, None, ""),
        (4, True, "recorded point by point: the edge may bend between its corners\n"),
        (16, None, "if it was drawn corner by corner, say recorded: false as a property"),
        (16, False, ""),
    ],
)
def test_the_plan_says_what_it_takes_an_outline_for(
    tmp_path: Path, cli: Cli, points: int, said: bool | None, words: str
) -> None:
    ring = [
        (20 * math.cos(k * math.tau / points), 20 * math.sin(k * math.tau / points))
        for k in range(points)
    ]
    path = tmp_path / "field.geojson"
    save_field(path, boundary_of(shapely.Polygon(ring), FRAME, "Round", 0.1, said))
    code, out, err = cli("plan", str(path), "--gap", "2")
    assert code == 0, err
    assert words in out
    assert ("recorded point by point" in out) == bool(words)


@pytest.mark.parametrize("value", ["yes", 1, [True]])
def test_a_file_that_says_neither_yes_nor_no_to_that_is_refused(
    tmp_path: Path, value: object
) -> None:
    path = tmp_path / "field.geojson"
    save_field(path, boundary_of(POND, FRAME, "Pond", 0.27, True))
    data = json.loads(path.read_text())
    data["features"][0]["properties"]["recorded"] = value
    path.write_text(json.dumps(data))
    with pytest.raises(UserError, match=r"recorded is .+; give true or false"):
        load_field(path)


@pytest.mark.parametrize("value", ["0.3 m", -1, 1e9, True, 10**400])
def test_a_file_whose_corners_are_known_to_no_length_is_refused(
    tmp_path: Path, value: object
) -> None:
    path = tmp_path / "field.geojson"
    save_field(path, boundary_of(POND, FRAME, "Pond", 0.27))
    data = json.loads(path.read_text())
    data["features"][0]["properties"]["sigma_m"] = value
    path.write_text(json.dumps(data))
    with pytest.raises(UserError, match="sigma_m"):
        load_field(path)
