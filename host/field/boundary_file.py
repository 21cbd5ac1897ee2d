"""A field on disk: one polygon of the crop's outer edge, its holes the keep-outs.

| suffix          | format                                     | by                  |
|-----------------|--------------------------------------------|---------------------|
| .geojson, .json | GeoJSON (RFC 7946, WGS 84)                 | GDAL (pyogrio)      |
| .kml            | KML 2.2 (WGS 84)                           | GDAL (pyogrio)      |
| .shp            | Shapefile, any CRS that its .prj names     | GDAL (pyogrio)      |
| .xml            | ISOXML TASKDATA (ISO 11783-10, WGS 84)     | this module         |
| .csv, .txt      | `latitude,longitude` a line, no keep-outs  | this module         |

Inside Daranti a place is (latitude, longitude) in degrees of WGS 84. GDAL gives x before y, that is
longitude before latitude; that order is turned here and nowhere else. No kept library on PyPI
writes ISOXML: its partfields are a few elements of XML.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import defusedxml.ElementTree
import numpy as np
import pyogrio
import shapely
from defusedxml.common import DefusedXmlException
from numpy.typing import NDArray
from pyproj import Transformer
from pyproj.exceptions import ProjError

from host.core.errors import UserError
from host.core.frames import LatLon, LocalFrame

MAX_AROUND_M = 20_000.0
MIN_AREA_M2 = 1.0
GEOJSON_DIGITS = 11
"""Decimals of a degree: GDAL may take the last three for a rounding error."""
SUFFIXES = ".geojson, .json, .kml, .shp, .xml (ISOXML), .csv, .txt"

# ISO 11783-10: PLN.A, PolygonType; LSG.A, LineStringType; PNT.A, PointType.
PARTFIELD_BOUNDARY = "1"
OBSTACLES = ("3", "4", "6")
"""Water surface, building, obstacle."""
EXTERIOR, INTERIOR = "1", "2"
POINT_OTHER = "2"


@dataclass(frozen=True, slots=True)
class Boundary:
    """The crop's outer edge and what stands inside it; every ring counter-clockwise, not closed."""

    crop: tuple[LatLon, ...]
    keep_outs: tuple[tuple[LatLon, ...], ...] = ()
    name: str = ""

    @property
    def frame(self) -> LocalFrame:
        """The field frame, its origin at the first corner."""
        return LocalFrame(*self.crop[0])

    def polygon(self, frame: LocalFrame) -> shapely.Polygon:
        """Field less keep-outs, in metres of the frame."""
        return shapely.Polygon(
            [frame.to_local(*corner) for corner in self.crop],
            [[frame.to_local(*corner) for corner in ring] for ring in self.keep_outs],
        )


def boundary_of(polygon: shapely.Polygon, frame: LocalFrame, name: str = "") -> Boundary:
    """From metres of a frame. UserError where it cannot be a field."""
    rings = [polygon.exterior, *polygon.interiors]
    places = [[frame.to_wgs84(x, y) for x, y, *_ in ring.coords] for ring in rings]
    return _checked(places[0], places[1:], name)


def load_field(path: Path) -> Boundary:
    """Reads by suffix; a folder is taken for an ISOXML task set. UserError where it is unreadable,
    not one polygon, its sides cross, its numbers are no degrees or it is larger than a field."""
    if path.is_dir():
        path = _taskdata(path)
    suffix = path.suffix.lower()
    try:
        if suffix == ".xml":
            return _read_isoxml(path)
        if suffix in (".shp", ".kml", ".geojson", ".json") or _is_json(path):
            return _read_gdal(path)
        return _checked(_read_csv(path), [], path.stem)
    except UserError as error:
        raise UserError(f"boundary {path}: {error}") from error
    except OSError as error:
        raise UserError(f"cannot read the boundary {path}: {error.strerror or error}") from error


def save_field(path: Path, boundary: Boundary) -> None:
    """Writes by suffix; `load_field` reads the same places back, to a millimetre. UserError where
    `check_target` has one, or the format cannot hold what the boundary has."""
    check_target(path)
    try:
        _WRITERS[path.suffix.lower()](path, boundary)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror or error}") from error


def check_target(path: Path) -> None:
    """UserError where a field can never be written to this path: better before the work."""
    if path.suffix.lower() not in _WRITERS:
        raise UserError(f"cannot write {path}: its suffix names no format; use {SUFFIXES}")
    if not path.parent.is_dir():
        raise UserError(f"cannot write {path}: there is no folder {path.parent}")


# ---- what makes a field --------------------------------------------------------------------------


def _open(ring: Iterable[Sequence[float]]) -> list[LatLon]:
    """Without repetitions in a row and without the closing corner."""
    corners: list[LatLon] = []
    for lat, lon, *_ in ring:
        if not corners or corners[-1] != (lat, lon):
            corners.append((lat, lon))
    while len(corners) > 1 and corners[0] == corners[-1]:
        corners.pop()
    return corners


def _checked(
    crop: Iterable[Sequence[float]], holes: Iterable[Iterable[Sequence[float]]], name: str
) -> Boundary:
    rings = [_open(crop), *map(_open, holes)]
    for number, ring in enumerate(rings):
        what = f"keep-out {number}" if number else "the field"
        if len(ring) < 3 or len(set(ring)) < len(ring):
            raise UserError(
                f"{what} needs three or more different corners; it has {len(ring)}, "
                f"{len(set(ring))} of them different"
            )
    flat = np.array([corner for ring in rings for corner in ring])
    if not np.isfinite(flat).all() or (np.abs(flat) > (90, 180)).any():
        raise UserError("a corner is not a latitude and longitude in degrees")
    frame = LocalFrame(*rings[0][0])
    local = [shapely.LinearRing([frame.to_local(*corner) for corner in ring]) for ring in rings]
    around = local[0].length
    if not around <= MAX_AROUND_M:
        raise UserError(
            f"it is {around / 1e3:.0f} km around; are its numbers swapped? Latitude comes first in "
            "text, longitude in GeoJSON"
        )
    field = shapely.Polygon(local[0])
    if not field.is_valid:
        raise UserError("its sides cross; walk it again or correct its corners")
    if field.area < MIN_AREA_M2:
        raise UserError(f"it encloses {field.area:.1f} m2; that is no field")
    if not shapely.Polygon(local[0], local[1:]).is_valid:
        raise UserError("its keep-outs cross each other or the field's edge; correct them")
    # The first corner stays the first: people know corners by their numbers.
    ccw = [
        tuple(ring if line.is_ccw else [ring[0], *ring[:0:-1]])
        for ring, line in zip(rings, local, strict=True)
    ]
    return Boundary(ccw[0], tuple(ccw[1:]), name)


def _compose(polygons: list[shapely.Polygon], name: str) -> Boundary:
    """One field from polygons in (longitude, latitude): the others must lie inside the largest."""
    if not polygons:
        raise UserError("it holds no polygon; draw the field's outline as a polygon")
    polygons = sorted(polygons, key=lambda polygon: -float(polygon.area))
    outline = shapely.Polygon(polygons[0].exterior)
    if not outline.is_valid:
        raise UserError("its sides cross; walk it again or correct its corners")
    beside = [polygon for polygon in polygons[1:] if not outline.contains(polygon)]
    if beside:
        raise UserError(
            f"it holds {1 + len(beside)} fields side by side; save one of them to a file of its own"
        )
    holes = [*polygons[0].interiors, *(polygon.exterior for polygon in polygons[1:])]
    return _checked(
        [(y, x) for x, y, *_ in outline.exterior.coords],
        [[(y, x) for x, y, *_ in hole.coords] for hole in holes],
        name,
    )


# ---- GeoJSON, KML, Shapefile ---------------------------------------------------------------------


def _is_json(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(64).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")


def _polygons(geometry: shapely.Geometry | None) -> list[shapely.Polygon]:
    if isinstance(geometry, shapely.Polygon):
        return [] if geometry.is_empty else [geometry]
    if isinstance(geometry, shapely.MultiPolygon | shapely.GeometryCollection):
        return [polygon for part in geometry.geoms for polygon in _polygons(part)]
    return []


def _read_gdal(path: Path) -> Boundary:
    """Every polygon of every layer; points and lines beside them (placemarks) mean nothing here."""
    with path.open("rb"):  # the system's own words where it cannot be read
        pass
    polygons: list[shapely.Polygon] = []
    kinds: set[str] = set()
    names: list[str] = []
    try:
        layers = [str(layer) for layer, _ in pyogrio.list_layers(path)]
        for layer in layers:
            meta, _, wkb, columns = pyogrio.raw.read(path, layer=layer, force_2d=True)
            geometries = shapely.from_wkb(wkb) if wkb is not None else []
            kinds |= {geometry.geom_type for geometry in geometries if geometry is not None}
            found = [polygon for geometry in geometries for polygon in _polygons(geometry)]
            if found:
                polygons += _to_wgs84(found, meta["crs"])
                names += _names(meta["fields"], columns)
    except (RuntimeError, ValueError) as error:
        reason = str(error).split("; ")[0].replace("\n", " ")
        raise UserError(f"its format is not understood ({reason}); use {SUFFIXES}") from error
    if kinds and not polygons:
        raise UserError(f"its type is {', '.join(sorted(kinds))}, not Polygon")
    return _compose(polygons, next(iter(names), path.stem))


def _names(fields: NDArray[np.object_], columns: list[NDArray[np.object_]]) -> list[str]:
    for field, column in zip(fields, columns, strict=True):
        if str(field).lower() == "name":
            return [str(value) for value in column if isinstance(value, str) and value]
    return []


def _to_wgs84(polygons: list[shapely.Polygon], crs: str | None) -> list[shapely.Polygon]:
    """To (longitude, latitude) of WGS 84."""
    if crs is None:
        raise UserError(
            "its coordinate system is unknown; put the .prj file of the Shapefile beside it"
        )
    try:
        transformer = Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    except ProjError as error:
        raise UserError(f"its coordinate system {crs!r} is unknown; save it in WGS 84") from error

    def convert(places: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack(transformer.transform(*places.T))

    return list(shapely.transform(polygons, convert))


def _write_gdal(path: Path, boundary: Boundary) -> None:
    polygon = shapely.Polygon(
        [(lon, lat) for lat, lon in boundary.crop],
        [[(lon, lat) for lat, lon in ring] for ring in boundary.keep_outs],
    )
    driver, options = {
        ".shp": ("ESRI Shapefile", {"ENCODING": "UTF-8"}),
        ".kml": ("KML", {}),
    }.get(
        path.suffix.lower(),
        ("GeoJSON", {"RFC7946": "YES", "COORDINATE_PRECISION": str(GEOJSON_DIGITS)}),
    )
    try:
        pyogrio.raw.write(
            path,
            geometry=np.array([shapely.to_wkb(polygon)], dtype=object),
            field_data=[np.array([boundary.name], dtype=object)],
            fields=np.array(["Name"], dtype=object),
            geometry_type="Polygon",
            crs="EPSG:4326",
            driver=driver,
            layer_options=options,
        )
    except RuntimeError as error:
        raise UserError(f"cannot write {path}: {error}") from error


# ---- ISOXML --------------------------------------------------------------------------------------


def _taskdata(folder: Path) -> Path:
    for inner in (folder, folder / "TASKDATA"):
        for path in sorted(inner.glob("*")):
            if path.name.upper() == "TASKDATA.XML":
                return path
    raise UserError(f"boundary {folder}: there is no TASKDATA.XML in this folder; name a file")


def _parse_xml(path: Path) -> ET.Element:
    try:
        root = defusedxml.ElementTree.parse(path).getroot()
    except (ET.ParseError, DefusedXmlException, ValueError) as error:
        raise UserError(f"{path.name} is not XML that can be read ({error})") from error
    assert root is not None
    return root


def _partfields(path: Path) -> list[ET.Element]:
    """Those of the file and of the files that its XFR elements name."""
    root = _parse_xml(path)
    if root.tag != "ISO11783_TaskData":
        raise UserError(f"its root is <{root.tag}>, not <ISO11783_TaskData> as in ISOXML")
    roots = [root]
    for reference in root.iter("XFR"):
        name = reference.get("A", "")
        if name.upper().startswith("PFD"):
            beside = [p for p in path.parent.glob("*") if p.name.upper() == f"{name}.XML".upper()]
            if not beside:
                raise UserError(f"it refers to {name}.XML, which is not beside it")
            roots.append(_parse_xml(beside[0]))
    return [field for root in roots for field in root.iter("PFD")]


def _ring(line: ET.Element) -> list[LatLon]:
    corners = []
    for point in line.iter("PNT"):
        if point.get("J"):
            raise UserError("its points are in a binary file; save the partfield with XML points")
        try:
            corners.append((float(point.attrib["C"]), float(point.attrib["D"])))
        except (KeyError, ValueError) as error:
            raise UserError("a point (PNT) has no numbers in C (north) and D (east)") from error
    return corners


def _read_isoxml(path: Path) -> Boundary:
    with_area = []
    for field in _partfields(path):
        polygons = [pln for pln in field.findall("PLN") if pln.get("A") == PARTFIELD_BOUNDARY]
        if polygons:
            with_area.append((field, polygons))
    if not with_area:
        raise UserError("no partfield (PFD) in it has a boundary (PLN of type 1)")
    if len(with_area) > 1:
        names = ", ".join(field.get("C", field.get("A", "?")) for field, _ in with_area)
        raise UserError(f"it holds the partfields {names}; save one of them to a file of its own")
    ((field, polygons),) = with_area
    lines = [line for pln in polygons for line in pln.findall("LSG")]
    outer = [_ring(line) for line in lines if line.get("A") == EXTERIOR]
    holes = [_ring(line) for line in lines if line.get("A") == INTERIOR]
    for pln in field.findall("PLN"):
        if pln.get("A") in OBSTACLES:
            holes += [_ring(line) for line in pln.findall("LSG") if line.get("A") == EXTERIOR]
    if len(outer) != 1:
        raise UserError(f"its partfield has {len(outer)} outer rings instead of one")
    return _checked(outer[0], holes, field.get("C", path.stem))


def _write_isoxml(path: Path, boundary: Boundary) -> None:
    area = str(round(boundary.polygon(boundary.frame).area))
    root = ET.Element(
        "ISO11783_TaskData",
        VersionMajor="4",
        VersionMinor="3",
        ManagementSoftwareManufacturer="Daranti",
        ManagementSoftwareVersion="1",
        DataTransferOrigin="1",
    )
    name = boundary.name[:32]  # a designator's limit
    field = ET.SubElement(root, "PFD", A="PFD1", C=name, D=area)
    polygon = ET.SubElement(field, "PLN", A=PARTFIELD_BOUNDARY, B=name, C=area)
    for kind, ring in [(EXTERIOR, boundary.crop), *((INTERIOR, r) for r in boundary.keep_outs)]:
        line = ET.SubElement(polygon, "LSG", A=kind)
        for lat, lon in (*ring, ring[0]):
            ET.SubElement(line, "PNT", A=POINT_OTHER, C=f"{lat:.9f}", D=f"{lon:.9f}")
    ET.indent(root)
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


# ---- latitude,longitude lines --------------------------------------------------------------------


def _read_csv(path: Path) -> list[LatLon]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise UserError(f"it is neither text nor a known format; use {SUFFIXES}") from error
    corners: list[LatLon] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        parts = line.split(",")
        try:
            corners.append((float(parts[0]), float(parts[1])))
        except (ValueError, IndexError) as error:
            if not corners and number == 1:  # a heading
                continue
            raise UserError(
                f"line {number} is not latitude,longitude; give such lines or a GeoJSON Polygon"
            ) from error
    return corners


def _write_csv(path: Path, boundary: Boundary) -> None:
    if boundary.keep_outs:
        raise UserError(f"cannot write {path}: CSV has no keep-outs; use another suffix")
    lines = [f"{lat:.9f},{lon:.9f}\n" for lat, lon in boundary.crop]
    path.write_text("latitude,longitude\n" + "".join(lines), encoding="utf-8")


_WRITERS: dict[str, Callable[[Path, Boundary], None]] = {
    ".geojson": _write_gdal,
    ".json": _write_gdal,
    ".kml": _write_gdal,
    ".shp": _write_gdal,
    ".xml": _write_isoxml,
    ".csv": _write_csv,
    ".txt": _write_csv,
}
