"""Partfields in ISOXML (ISO 11783-10), versions 3 and 4: a TASKDATA.XML with the files that it
refers to, in a folder or in a .zip as farm programs save it.

The models are isoxml's. What it is given was parsed by defusedxml before: its own parser would
follow entities, and its reader of .zip unpacks whatever it finds.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from decimal import Decimal
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree as ET

import defusedxml.ElementTree
import shapely
from isoxml.converter.shapely_geom import ShapelyConverterV4
from isoxml.models.base import v3, v4
from isoxml.util.isoxml_io import isoxml_to_text
from xsdata.exceptions import ParserError
from xsdata.formats.dataclass.parsers import XmlParser
from xsdata.formats.dataclass.parsers.config import ParserConfig

from host.core.errors import UserError
from host.field.archive import MAX_BYTES, Archive
from host.field.gpx_file import UNREADABLE_XML
from host.field.shapes import Shape

TASKDATA = "TASKDATA.XML"
PARTFIELD_FILE = "PFD"
BOUNDARY = "1"
OBSTACLES = ("3", "4", "6")
"""PolygonType: water surface, building, obstacle."""
EXTERIOR, INTERIOR = "1", "2"
MARKING_POLYGONS = ("7", "8", "12")
"""PolygonType: flag, other, windbreak: it may stand in the way, and reaches over the edge."""
MARKING_LINES = ("7", "8", "9")
"""LineStringType: fence, flag, obstacle."""
MARKING_POINTS = ("1", "2", "5")
"""PointType: flag, other, obstacle."""
DESIGNATOR = 32
"""Characters that a name may have."""

Files = Callable[[str], bytes | None]
"""A file's content by its name in capitals; None where there is none."""


def read_folder(path: Path) -> list[Shape]:
    """Of a TASKDATA.XML with its neighbours, or of a folder that holds one."""
    inside = [path, path / "TASKDATA"] if path.is_dir() else [path.parent]
    for folder in inside:
        there = {each.name.upper(): each for each in sorted(folder.glob("*")) if each.is_file()}
        main = there.get(TASKDATA) if path.is_dir() else path
        if main is not None:
            neighbours = there

            def content(name: str, known: dict[str, Path] = neighbours) -> bytes | None:
                return _limited(known[name]) if name in known else None

            return _shapes(_limited(main), content)
    raise UserError(f"there is no {TASKDATA} in this folder; name a file")


def read_archive(files: Archive) -> list[Shape]:
    """Of an archive that holds a TASKDATA.XML, in whichever folder."""
    main = next(name for name in files.names if name.name.upper() == TASKDATA)
    beside = files.beside(main)

    def content(name: str) -> bytes | None:
        return files.content(beside[name]) if name in beside else None

    return _shapes(files.content(main), content)


def _limited(path: Path) -> bytes:
    if path.stat().st_size > MAX_BYTES:
        raise UserError(f"{path.name} has {path.stat().st_size / 1e6:.0f} MB; that is no task data")
    return path.read_bytes()


def _root(data: bytes, name: str) -> ET.Element:
    try:
        root = defusedxml.ElementTree.fromstring(data, forbid_dtd=True)
    except UNREADABLE_XML as error:
        raise UserError(f"{name} is not XML that can be read ({error})") from error
    assert isinstance(root, ET.Element)
    if any(point.get("J") for point in root.iter("PNT")):
        raise UserError("its points are in a binary file; save the partfield with XML points")
    return root


def _parsed(root: ET.Element, kind: type[Any], name: str) -> Any:
    parser = XmlParser(
        ParserConfig(fail_on_unknown_properties=False, fail_on_unknown_attributes=False)
    )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a value of no concern that is not as the schema says
            return parser.from_bytes(ET.tostring(root, encoding="utf-8"), kind)
    except (ParserError, ValueError, ArithmeticError, TypeError, RecursionError) as error:
        raise UserError(f"{name} is not ISOXML as its version says ({error})") from error


def _shapes(main: bytes, content: Files) -> list[Shape]:
    root = _root(main, TASKDATA)
    if root.tag != "ISO11783_TaskData":
        raise UserError(f"its root is <{root.tag}>, not <ISO11783_TaskData> as in ISOXML")
    models: ModuleType = v4 if root.get("VersionMajor") == "4" else v3
    task = _parsed(root, models.Iso11783TaskData, TASKDATA)
    partfields = list(task.partfields)
    for reference in task.external_file_references:
        name = str(reference.filename or "").upper()
        if not name.startswith(PARTFIELD_FILE):
            continue
        beside = content(f"{name}.XML")
        if beside is None:
            raise UserError(f"it refers to {name}.XML, which is not beside it")
        more = _parsed(_root(beside, name), models.ExternalFileContents, name)
        partfields += more.partfields
    found = [shape for partfield in partfields if (shape := _shape(partfield)) is not None]
    if not found:
        raise UserError("no partfield (PFD) in it has a boundary (PLN of type 1)")
    return [*found, *(mark for partfield in partfields for mark in _marks(partfield))]


def _marks(partfield: Any) -> Iterator[Shape]:
    """What marks something in a partfield, and is no keep-out."""
    areas = [pln for pln in partfield.polygons if _type(pln) in MARKING_POLYGONS]
    lines = [line for line in partfield.line_strings if _type(line) in MARKING_LINES]
    marks = [(pln, line.points) for pln in areas for line in pln.line_strings]
    marks += [(line, line.points) for line in lines]
    marks += [(pnt, [pnt]) for pnt in partfield.points if _type(pnt) in MARKING_POINTS]
    for what, points in marks:
        with suppress(UserError):  # without numbers it is nowhere
            places = _places(points)
            shape = shapely.LineString(places) if len(places) > 1 else shapely.Point(*places)
            yield Shape(shapely.Polygon(), str(what.designator or ""), mark=shape)


def _shape(partfield: Any) -> Shape | None:
    """Boundary and obstacles of a partfield; None where it has no boundary. One that nobody can use
    is no obstacle to the others."""
    name = str(partfield.designator or partfield.id or "?")
    try:
        polygon = _polygon(partfield, name)
    except UserError as error:
        return Shape(shapely.Polygon(), name, fault=str(error))
    return None if polygon is None else Shape(polygon, name)


def _polygon(partfield: Any, name: str) -> shapely.Polygon | None:
    boundaries = [pln for pln in partfield.polygons if _type(pln) == BOUNDARY]
    if not boundaries:
        return None
    lines = [line for pln in boundaries for line in pln.line_strings]
    outer = [_ring(line) for line in lines if _type(line) == EXTERIOR]
    holes = [_ring(line) for line in lines if _type(line) == INTERIOR]
    for pln in partfield.polygons:
        if _type(pln) in OBSTACLES:
            holes += [_ring(line) for line in pln.line_strings if _type(line) == EXTERIOR]
    if len(outer) != 1:
        raise UserError(f"its partfield {name!r} has {len(outer)} outer rings instead of one")
    rings = [outer[0], *holes]
    if any(len(ring) < 3 for ring in rings):
        raise UserError(f"its partfield {name!r} has a ring of fewer than three corners")
    try:
        return shapely.Polygon(outer[0], holes)
    except (shapely.errors.ShapelyError, ValueError) as error:
        raise UserError(f"its partfield {name!r} is no polygon ({error})") from error


def _type(element: Any) -> str:
    """The code of a type that may be missing, or none that the standard knows."""
    return str(getattr(element.type, "value", element.type))


def _ring(line: Any) -> list[tuple[float, float]]:
    """(longitude, latitude) of its points."""
    return _places(line.points)


def _places(found: Iterable[Any]) -> list[tuple[float, float]]:
    """(longitude, latitude) of points."""
    points = [(point.east, point.north) for point in found]
    if not all(
        isinstance(value, Decimal) and value.is_finite() for pair in points for value in pair
    ):
        raise UserError("a point (PNT) has no numbers in C (north) and D (east)")
    return [(float(east), float(north)) for east, north in points]


def write(path: Path, polygon: shapely.Polygon, name: str, area_m2: float) -> None:
    """A TASKDATA of version 4 with one partfield; `polygon` in (longitude, latitude)."""
    boundary = ShapelyConverterV4().to_iso_polygon(
        polygon,
        v4.PolygonType.PartfieldBoundary,
        designator=name[:DESIGNATOR],
        area=round(area_m2),
    )
    task = v4.Iso11783TaskData(
        version_minor=v4.Iso11783TaskDataVersionMinor.VALUE_3,
        management_software_manufacturer="Daranti",
        management_software_version="1",
        data_transfer_origin=v4.Iso11783TaskDataDataTransferOrigin.FMIS,
        partfields=[
            v4.Partfield(
                id="PFD1",
                designator=name[:DESIGNATOR],
                area=round(area_m2),
                polygons=[boundary],
            )
        ],
    )
    path.write_text(isoxml_to_text(task), encoding="utf-8")
