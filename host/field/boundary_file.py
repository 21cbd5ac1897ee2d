"""A field on disk: one polygon of the crop's outer edge, its holes the keep-outs.

| suffix               | format                                          | by                  |
|----------------------|-------------------------------------------------|---------------------|
| .geojson, .json      | GeoJSON (RFC 7946, WGS 84; others by its `crs`) | shapely             |
| .kml, .kmz           | KML 2.2 (WGS 84)                                | GDAL (pyogrio)      |
| .shp                 | Shapefile, any CRS that its .prj names          | GDAL (pyogrio)      |
| .xml, a folder       | ISOXML TASKDATA, versions 3 and 4 (WGS 84)      | `field.isoxml_file` |
| .zip                 | ISOXML, or files of the formats above           | `field.archive`     |
| .gpx                 | GPX 1.1: a track or route around it; read only  | `field.gpx_file`    |
| .csv, .txt           | `latitude,longitude` a line, no keep-outs; a    | this module         |
|                      | heading may name other columns                  |                     |

Inside Daranti a place is (latitude, longitude) in degrees of WGS 84. Most formats have longitude
first; that order is turned here and nowhere else. GDAL takes any file for whatever it finds inside,
a list of addresses to fetch too, so it is given only what has been looked at.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any, Final, NoReturn
from xml.etree import ElementTree as ET

import defusedxml.ElementTree
import numpy as np
import pyogrio
import shapely
import shapely.geometry
from numpy.typing import NDArray
from pyproj import Transformer
from pyproj.exceptions import ProjError

from host.core.errors import UserError
from host.core.frames import LatLon, LocalFrame
from host.core.output_place import check_file
from host.core.terminal import plain
from host.field import archive, isoxml_file
from host.field.corners import steerable
from host.field.gpx_file import UNREADABLE_XML, bare, read_rings
from host.field.shapes import MIN_AREA_M2, Mark, Shape, area_m2, chosen, parts_of, shape_of

MAX_AROUND_M = 20_000.0
"""A field's length around, of a square of 25 km²: longer ones are a slip in the file."""
MAX_LATITUDE_DEG = 72.0
"""No wheat grows beyond: coordinates that lie there have been swapped."""
MAX_BYTES = 64 * 1024 * 1024
"""Of a boundary's file: more is another file."""
UNKNOWN_SIGMA_M = 1.0
"""Of corners from a file that does not say it, standard deviation per axis against each other: as
if walked once with a phone of 2.5 m CEP by positions alone, whose corners err by 1.27 m, 0.9 m per
axis (hil.studies.walks)."""
SHORT_SIGMAS: Final = 5.0
"""Standard deviations of a corner: which way an edge runs that is not so long is hardly known. With
1 m, outlines with edges of 4 m and less stopped in the first side, and of 6 m did not (model
drives). Smaller warns of too few, larger of fields that are harvested."""
MOST_SHORT: Final = 4
"""Such edges that a field may have: a small one has no others, and is measured all the same."""
SIGMA = "sigma_m"
"""The property of a GeoJSON feature that says it,"""
RECORDED = "recorded"
"""and the one that says whether it was recorded point by point,"""
LEFT_OUT = "left_out"
"""and the one that keeps what another file had inside it (JSON: name, longitude, latitude each)."""
MOST_NAMED: Final = 5
"""Of that, in a message."""
MOST_SIGMA_M = 100.0
"""A larger one is no field's: a slip of the pen."""
COARSE: Final = range(5)
"""Decimals of a degree that are too few for a field's corners; 5 err by 0.3 m (standard deviation),
less than UNKNOWN_SIGMA_M."""
SAME = 1e-9
"""Degrees, a tenth of a millimetre: what arithmetic leaves of a rounded number."""
DEGREE_M = 111_320.0
"""Of latitude, and of longitude at the equator."""
GEOJSON_DIGITS = 11
"""Decimals of a degree: GDAL may take the last three for a rounding error."""
SUFFIXES = ".geojson, .kml, .kmz, .shp, .xml (ISOXML), .zip, .gpx, .csv"
"""That are read, for messages."""
IN_ARCHIVES = (".shp", ".kml", ".geojson", ".json", ".gpx")
"""Formats that a .zip may hold besides ISOXML."""
SAME_SHARE = 0.9
"""Of what two polygons of two formats cover together, that both cover where they are one: files
with six decimals of a degree leave 0.97 of a keep-out 10 m wide."""
SHAPEFILE = (".shx", ".dbf", ".prj", ".cpg")
"""What belongs to a .shp."""
NO_DEGREES = "a corner is not a latitude and longitude in degrees"
NO_UTF8 = "its text is not UTF-8; save it as UTF-8"
NAMES = ("name", "field_name", "fieldname", "field", "title", "id")
"""Properties that programs keep a field's name in, the surest first."""
SHP_MAGIC = b"\x00\x00\x27\x0a"


@dataclass(frozen=True, slots=True)
class Boundary:
    """The crop's outer edge and what stands inside it; every ring counter-clockwise, not closed."""

    crop: tuple[LatLon, ...]
    keep_outs: tuple[tuple[LatLon, ...], ...] = ()
    name: str = ""
    sigma_m: float | None = None
    """Standard deviation per axis of a corner against the others; None: nobody has said it."""
    recorded: bool | None = None
    """Whether it was recorded point by point, so that the crop's edge may bend between its corners;
    None: nobody has said it."""
    left_out: tuple[Mark, ...] = ()
    """What its file has inside it besides: a tree marked by a point, a pond drawn across its
    edge."""

    @property
    def known_to_m(self) -> float:
        """`sigma_m`, or what a corner is worth that nobody has said anything of."""
        return UNKNOWN_SIGMA_M if self.sigma_m is None else self.sigma_m

    @property
    def doubts(self) -> list[str]:
        """What the machine will not be able to do with it, in words."""
        named = [self.not_kept_out] if self.not_kept_out else []
        return [*named, *self._rounded, *self._short_edges]

    @property
    def not_kept_out(self) -> str:
        """What may stand in the field outside of every keep-out, in words; empty where nothing."""
        kept_out = [shapely.Polygon([(lon, lat) for lat, lon in ring]) for ring in self.keep_outs]
        names = [
            mark.name
            for mark in self.left_out
            if not any(
                shapely.intersects_xy(hole, mark.longitude, mark.latitude) for hole in kept_out
            )
        ]
        if not names:
            return ""
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        return (
            "the file has in the field, and not as a keep-out: "
            f"{', '.join(names[:MOST_NAMED])}{more}. The machine drives over what stands there; "
            "draw a polygon around it that lies inside the field"
        )

    @property
    def _rounded(self) -> list[str]:
        places = np.array(self.crop)
        digits = [k for k in COARSE if np.allclose(places, places.round(k), 0, SAME)]
        if not digits or self.sigma_m is not None:
            return []
        off_m = DEGREE_M * 10.0 ** -digits[0] / 2
        return [
            f"its corners have {digits[0]} decimals of a degree: each is off by up to "
            f"{off_m:.0f} m, and the machine knows its place no better. Save the field with 6 "
            "decimals or more, or survey it with the phone"
        ]

    @property
    def _short_edges(self) -> list[str]:
        recorded = [self.frame.to_local(*corner) for corner in self.crop]
        points = np.array(steerable(recorded, 0, self.known_to_m, self.recorded)[0])
        lengths = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
        least_m = SHORT_SIGMAS * self.known_to_m
        short = int((lengths < least_m).sum())
        if short <= MOST_SHORT:
            return []
        return [
            f"{short} edges of the boundary are shorter than {least_m:.1f} m and its corners are "
            f"known to {self.known_to_m:g} m only: the machine may lose its place there and stop. "
            "If they are known better, say so as the property sigma_m (metres) of a GeoJSON file; "
            "else survey the field with the phone"
        ]

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


def boundary_of(
    polygon: shapely.Polygon,
    frame: LocalFrame,
    name: str = "",
    sigma_m: float | None = None,
    recorded: bool | None = None,
) -> Boundary:
    """From metres of a frame. UserError where it cannot be a field."""
    rings = [polygon.exterior, *polygon.interiors]
    places = [[frame.to_wgs84(x, y) for x, y, *_ in ring.coords] for ring in rings]
    return _checked(places[0], places[1:], name, sigma_m, recorded)


def load_field(path: Path, field: str = "") -> Boundary:
    """Reads by suffix; a folder is taken for an ISOXML task set. Of several fields `field` names
    one. UserError where it is unreadable, not one polygon, its sides cross, its numbers are no
    degrees or it is larger than a field."""
    try:
        if path.is_dir():
            return _one(isoxml_file.read_folder(path), field, path)
        if path.exists() and not path.is_file():
            raise UserError("it is a device or a pipe, no file")
        if path.stat().st_size > MAX_BYTES:
            raise UserError(f"it has {path.stat().st_size / 1e6:.0f} MB; that is no field")
        if path.stat().st_size == 0:
            raise UserError("it is empty; save the field again")
        suffix = path.suffix.lower()
        if suffix not in _READERS and _is_json(path):
            suffix = ".json"
        if suffix in _READERS:
            return _one(_READERS[suffix](path), field, path)
        return _checked(_read_csv(path), [], path.stem)
    except shapely.errors.ShapelyError as error:
        raise UserError(f"boundary {path}: it is no polygon ({error})") from error
    except UserError as error:
        raise UserError(f"boundary {path}: {error}") from error
    except OSError as error:
        raise UserError(f"cannot read the boundary {path}: {error.strerror or error}") from error


def save_field(path: Path, boundary: Boundary) -> None:
    """Writes by suffix; `load_field` reads the same places back, to a millimetre. UserError where
    `check_target` has one, the format cannot hold what the boundary has, or it could not be written
    whole: then what stood there before still stands."""
    check_target(path)
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as folder:
            whole = Path(folder) / path.name
            _WRITERS[path.suffix.lower()](whole, boundary)
            _read_back(whole)
            for file in whole.parent.iterdir():
                file.replace(path.parent / file.name)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror or error}") from error
    except (UserError, RuntimeError) as error:
        raise UserError(f"cannot write {path}: {error}") from error


def _read_back(path: Path) -> None:
    """GDAL says nothing where the disk is full: the file is empty."""
    try:
        load_field(path)
    except UserError as error:
        raise UserError("it did not arrive whole; is the disk full?") from error


def check_target(path: Path) -> None:
    """UserError where a field can never be written to this path: better before the work."""
    if path.suffix.lower() not in _WRITERS:
        raise UserError(
            f"cannot write {path}: its suffix names no format; use {', '.join(_WRITERS)}"
        )
    check_file(path)


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
    crop: Iterable[Sequence[float]],
    holes: Iterable[Iterable[Sequence[float]]],
    name: str,
    sigma_m: float | None = None,
    recorded: bool | None = None,
) -> Boundary:
    rings = [_open(crop), *map(_open, holes)]
    if not all(abs(lat) <= 90 and abs(lon) <= 180 for ring in rings for lat, lon in ring):
        raise UserError(NO_DEGREES)
    for number, ring in enumerate(rings):
        what = f"keep-out {number}" if number else "the field"
        if len(set(ring)) < 3:
            raise UserError(
                f"{what} needs three or more different corners; it has {len(set(ring))}"
            )
        (corner, times), *_ = Counter(ring).most_common(1)
        if times > 1:
            raise UserError(
                f"{what} comes back to its corner {corner[0]:.7f}, {corner[1]:.7f}; its edge may "
                "go through a corner only once"
            )
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
    return Boundary(ccw[0], tuple(ccw[1:]), plain(name), sigma_m, recorded)


def _one(shapes: list[Shape], wanted: str, path: Path) -> Boundary:
    """The field that is meant."""
    places = shapely.get_coordinates([shape.polygon for shape in shapes])
    if not (np.abs(places) <= (180, 90)).all():
        raise UserError(
            "a corner is not a latitude and longitude in degrees; metres of a map? Save it in "
            "WGS 84"
        )
    shape = chosen([_mended(shape) for shape in shapes], wanted)
    if any(abs(lat) > MAX_LATITUDE_DEG for _, lat, *_ in shape.polygon.exterior.coords):
        raise UserError(
            f"it lies at latitude {shape.polygon.exterior.coords[0][1]:.1f}, where no wheat grows: "
            "are its numbers swapped? Longitude comes first in GeoJSON and KML"
        )
    boundary = _checked(
        [(y, x) for x, y, *_ in shape.polygon.exterior.coords],
        [[(y, x) for x, y, *_ in hole.coords] for hole in shape.polygon.interiors],
        shape.name or path.stem,
        shape.sigma_m,
        shape.recorded,
    )
    marks = tuple(replace(mark, name=plain(mark.name)) for mark in shape.left_out)
    return replace(boundary, left_out=marks)


def _mended(shape: Shape) -> Shape:
    """Without the loops and spikes of its outline that enclose less than a field: where a ring
    overlaps its own begin, or a corner was drawn beyond its neighbour. As it is where more would
    change."""
    outline = shapely.Polygon(shape.polygon.exterior)
    if outline.is_valid:
        return shape
    whole = shapely.make_valid(outline)
    parts = [part for part in parts_of(whole) if isinstance(part, shapely.Polygon)]
    if not parts:
        return shape
    kept = shapely.Polygon(max(parts, key=lambda part: float(part.area)).exterior)
    if not area_m2(kept.symmetric_difference(whole)) < MIN_AREA_M2:
        return shape
    return replace(shape, polygon=shapely.Polygon(kept.exterior, shape.polygon.interiors))


# ---- GeoJSON, KML, Shapefile ---------------------------------------------------------------------


def _is_json(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(64).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")


def _read_geojson(path: Path) -> list[Shape]:
    """Every polygon of its features, and the lines and points beside them."""
    try:
        data = json.loads(path.read_bytes(), parse_constant=_no_number)
    except UnicodeDecodeError as error:
        raise UserError(NO_UTF8) from error
    except (ValueError, RecursionError) as error:
        raise UserError(f"its format is not understood: no JSON ({error})") from error
    if not isinstance(data, dict):
        raise UserError("it is not GeoJSON: give an object with a type")
    features = data.get("features") if data.get("type") == "FeatureCollection" else [data]
    if not isinstance(features, list):
        raise UserError("it is not GeoJSON: its features are no list")
    shapes: list[Shape] = []
    crs = _crs(data)
    for feature in features:
        if not isinstance(feature, dict):
            raise UserError("it is not GeoJSON: a feature is no object")
        whole = feature.get("type") == "Feature"
        geometry = feature.get("geometry") if whole else feature
        if geometry is None:
            continue
        if not isinstance(geometry, dict) or not isinstance(geometry.get("type"), str):
            raise UserError("it is not GeoJSON: a geometry has no type; save it as GeoJSON")
        try:
            made = shapely.geometry.shape(_flat(geometry))
            if not np.isfinite(shapely.get_coordinates(made)).all():
                raise UserError(NO_DEGREES)
        except UserError:
            raise
        except Exception as error:  # whatever a wrong structure makes of shapely's reading
            raise UserError(
                f"its format is not understood ({type(error).__name__}: {error}); use {SUFFIXES}"
            ) from error
        name = _name(feature.get("properties")) if whole else ""
        sigma_m = _sigma(feature.get("properties")) if whole else None
        recorded = _recorded(feature.get("properties")) if whole else None
        left_out = _left_out(feature.get("properties")) if whole else ()
        shapes += [
            replace(shape_of(part, name), sigma_m=sigma_m, recorded=recorded, left_out=left_out)
            for part in _to_wgs84(parts_of(made), crs)
        ]
    return shapes


def _no_number(name: str) -> NoReturn:
    """JSON's reader takes NaN and Infinity for numbers."""
    raise UserError(f"{NO_DEGREES}: {name}")


def _flat(geometry: Any) -> Any:
    """Of GeoJSON: places without what may follow longitude and latitude (RFC 7946, 3.1.1)."""
    if isinstance(geometry, dict):
        return {key: _flat(value) for key, value in geometry.items()}
    if not isinstance(geometry, list):
        return geometry
    nested = any(isinstance(each, dict | list) for each in geometry)
    return [_flat(each) for each in geometry] if nested else geometry[:2]


def _name(properties: Any) -> str:
    """Of a feature: what programs call it."""
    if not isinstance(properties, dict):
        return ""
    low = {str(key).casefold(): value for key, value in properties.items()}
    found = next((low[key] for key in NAMES if low.get(key)), "")
    return found if isinstance(found, str) else str(found) if isinstance(found, int) else ""


def _sigma(properties: Any) -> float | None:
    """Of a feature: how surely its corners are known. UserError where that is no length."""
    value = properties.get(SIGMA) if isinstance(properties, dict) else None
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise UserError(f"its {SIGMA} is {value!r}, no number of metres")
    if not 0 <= value <= MOST_SIGMA_M:
        raise UserError(f"its {SIGMA} is {value!s:.12}; give 0 to {MOST_SIGMA_M:g} metres")
    return float(value)


def _recorded(properties: Any) -> bool | None:
    """Of a feature: whether it was recorded point by point. UserError where it is no yes or no."""
    value = properties.get(RECORDED) if isinstance(properties, dict) else None
    if value is None or isinstance(value, bool):
        return value
    raise UserError(f"its {RECORDED} is {value!r}; give true or false")


def _left_out(properties: Any) -> tuple[Mark, ...]:
    """Of a feature: what its file had inside it before."""
    value = properties.get(LEFT_OUT) if isinstance(properties, dict) else None
    if value is None:
        return ()
    try:
        marks = json.loads(value) if isinstance(value, str) else value
        return tuple(Mark(str(name), float(lon), float(lat)) for name, lon, lat in marks)
    except (TypeError, ValueError) as error:
        raise UserError(
            f"its {LEFT_OUT} is not a list of name, longitude and latitude each; remove it, and "
            "look what stands in the field"
        ) from error


def _crs(data: dict[str, Any]) -> str:
    """GeoJSON of before 2016 may name a coordinate system."""
    crs = data.get("crs")
    if crs is None:
        return "OGC:CRS84"
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str):
        raise UserError("its coordinate system (crs) is unknown; save it in WGS 84")
    return name


def _read_kml(path: Path) -> list[Shape]:
    """Its placemarks' polygons. GDAL is given what a strict parser wrote anew, so that nothing is
    in it but KML."""
    try:
        root = defusedxml.ElementTree.parse(path, forbid_dtd=True).getroot()
        assert isinstance(root, ET.Element)
        text = ET.tostring(bare(root), encoding="utf-8", xml_declaration=True)
    except UNREADABLE_XML as error:
        raise UserError(f"it is not XML that can be read ({error})") from error
    if root.tag != "kml":
        raise UserError(f"its root is <{root.tag}>, not <kml>")
    if any("OGRVRT" in str(element.tag) for element in root.iter()):
        raise UserError("it holds what is no KML")
    return _read_gdal(text)


def _read_shapefile(path: Path) -> list[Shape]:
    with path.open("rb") as file:
        if file.read(len(SHP_MAGIC)) != SHP_MAGIC:
            raise UserError("it is no Shapefile")
    beside = {each.name.casefold() for each in path.parent.iterdir()}
    if path.with_suffix(".shx").name.casefold() not in beside:
        raise UserError("its .shx file is missing; copy all files of the Shapefile's name")
    return _read_gdal(path)


def _read_gdal(source: Path | bytes) -> list[Shape]:
    """Every polygon of every layer, and the lines and points beside them."""
    shapes: list[Shape] = []
    try:
        # By number: two layers may share a name, and GDAL makes one up anew at each reading.
        for layer in range(len(pyogrio.list_layers(source))):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # what GDAL doubts is judged with the polygons
                meta, _, wkb, columns = pyogrio.raw.read(source, layer=layer, force_2d=True)
            geometries = shapely.from_wkb(wkb) if wkb is not None else []
            for k, geometry in enumerate(geometries):
                if found := parts_of(geometry):
                    row = [column[k : k + 1].tolist()[0] for column in columns]
                    name = _name(dict(zip(meta["fields"], row, strict=True)))
                    shapes += [shape_of(each, name) for each in _to_wgs84(found, meta["crs"])]
    except (RuntimeError, ValueError) as error:
        reason = str(error).split("; ")[0].replace("\n", " ")
        raise UserError(f"its format is not understood ({reason}); use {SUFFIXES}") from error
    return shapes


def _to_wgs84(shapes: list[shapely.Geometry], crs: str | None) -> list[shapely.Geometry]:
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

    return list(shapely.transform(shapes, convert))


def _degrees(boundary: Boundary) -> shapely.Polygon:
    """In (longitude, latitude)."""
    return shapely.Polygon(
        [(lon, lat) for lat, lon in boundary.crop],
        [[(lon, lat) for lat, lon in ring] for ring in boundary.keep_outs],
    )


def _write_gdal(path: Path, boundary: Boundary) -> None:
    polygon = _degrees(boundary)
    driver, options = {
        ".shp": ("ESRI Shapefile", {"ENCODING": "UTF-8"}),
        ".kml": ("KML", {}),
    }.get(
        path.suffix.lower(),
        ("GeoJSON", {"RFC7946": "YES", "COORDINATE_PRECISION": str(GEOJSON_DIGITS)}),
    )
    fields, values = ["Name"], [np.array([boundary.name], dtype=object)]
    if driver == "GeoJSON" and boundary.sigma_m is not None:
        fields.append(SIGMA)
        values.append(np.array([round(boundary.sigma_m, 3)]))
    if driver == "GeoJSON" and boundary.recorded is not None:
        fields.append(RECORDED)
        values.append(np.array([boundary.recorded]))
    if driver == "GeoJSON" and boundary.left_out:
        fields.append(LEFT_OUT)
        marks = json.dumps([astuple(mark) for mark in boundary.left_out])
        values.append(np.array([marks], dtype=object))
    pyogrio.raw.write(
        path,
        geometry=np.array([shapely.to_wkb(polygon)], dtype=object),
        field_data=values,
        fields=np.array(fields, dtype=object),
        geometry_type="Polygon",
        crs="EPSG:4326",
        driver=driver,
        layer="field" if driver == "KML" else None,  # of a file's name it would warn at each sign
        layer_options=options,
    )


# ---- ISOXML, archives ----------------------------------------------------------------------------


def _write_isoxml(path: Path, boundary: Boundary) -> None:
    area = float(boundary.polygon(boundary.frame).area)
    isoxml_file.write(path, _degrees(boundary), boundary.name, area)


def _read_archive(path: Path) -> list[Shape]:
    """Of a .kmz, or of a .zip as farm programs export it: an ISOXML task set, or every file of the
    first format of IN_ARCHIVES that is in it, and what files of the others have besides: a pond
    beside the field's own file is a keep-out. Others need not be readable, a program's notes are
    JSON, too."""
    with archive.opened(path) as files:
        if any(name.name.upper() == isoxml_file.TASKDATA for name in files.names):
            return isoxml_file.read_archive(files)
        named = [
            [name for name in files.names if name.suffix.lower() == suffix]
            for suffix in IN_ARCHIVES
        ]
        first, *others = [names for names in named if names] or [[]]
        shapes = [shape for name in first for shape in _unpacked(files, name)]
        for name in itertools.chain.from_iterable(others):
            with contextlib.suppress(UserError):
                shapes += [each for each in _unpacked(files, name) if not _among(each, shapes)]
    if not first:
        raise UserError(
            f"there is no {isoxml_file.TASKDATA} in it and no {', '.join(IN_ARCHIVES)}: it is no "
            "export of a field"
        )
    return shapes


def _among(shape: Shape, shapes: Sequence[Shape]) -> bool:
    """Whether a polygon is one of theirs or of their holes, as another format rounds it."""
    if shape.mark is not None or shape.fault:
        return False
    own = shapely.make_valid(shapely.Polygon(shape.polygon.exterior))
    rings = [ring for each in shapes for ring in (each.polygon.exterior, *each.polygon.interiors)]
    outlines = [shapely.make_valid(shapely.Polygon(ring)) for ring in rings]
    return any(own.intersection(each).area > SAME_SHARE * own.union(each).area for each in outlines)


def _unpacked(files: archive.Archive, name: PurePosixPath) -> list[Shape]:
    """The polygons of one file in an archive, read outside it with the files that belong to it."""
    suffix = name.suffix.lower()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"field{suffix}"
        path.write_bytes(files.content(name))
        beside = files.beside(name)
        for other in SHAPEFILE if suffix == ".shp" else ():
            if (found := beside.get(f"{name.stem}{other}".upper())) is not None:
                path.with_suffix(other).write_bytes(files.content(found))
        shapes = _READERS[suffix](path)
    return [replace(shape, name=shape.name or name.stem) for shape in shapes]


# ---- latitude,longitude lines --------------------------------------------------------------------


LATITUDES = frozenset({"latitude", "lat", "northing", "north", "y"})
LONGITUDES = frozenset({"longitude", "lon", "long", "lng", "easting", "east", "x"})
MOST_BARE = 3
"""Numbers in a line without a heading: latitude, longitude and height."""


def _read_csv(path: Path) -> list[LatLon]:
    try:
        text = path.read_text(encoding="utf-8-sig")
        if "\0" in text:
            raise ValueError("text has no zeros")
    except ValueError as error:
        raise UserError(
            f"it is neither UTF-8 text nor a known format; save a table as UTF-8, or use {SUFFIXES}"
        ) from error
    corners: list[LatLon] = []
    columns: tuple[int, int] | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        parts = _split(line)
        if columns is None and (columns := _columns(parts)) is not None:
            continue
        if columns is None and len(parts) > MOST_BARE:
            raise UserError(
                f"line {number} has {len(parts)} columns; give latitude,longitude with decimal "
                "points, or a first line that names the columns latitude and longitude"
            )
        columns = columns or (0, 1)
        try:
            corners.append((float(parts[columns[0]]), float(parts[columns[1]])))
        except (ValueError, IndexError) as error:
            raise UserError(
                f"line {number} is not latitude,longitude; give such lines, below a line that says "
                f"latitude,longitude or longitude,latitude, or one of {SUFFIXES}"
            ) from error
    if any(MAX_LATITUDE_DEG < abs(lat) <= 90 and abs(lon) <= 90 for lat, lon in corners):
        raise UserError(
            "it lies where no wheat grows: are its numbers swapped? Latitude comes first, unless a "
            "heading says longitude,latitude"
        )
    return corners


def _split(line: str) -> list[str]:
    """Tables whose decimals have a comma are divided by semicolons or tabs."""
    separator = next((each for each in "\t;" if each in line), ",")
    parts = [part.strip().strip('"') for part in line.split(separator)]
    return parts if separator == "," else [part.replace(",", ".") for part in parts]


def _columns(heading: Sequence[str]) -> tuple[int, int] | None:
    """Where latitude and longitude stand; None where the heading does not say both."""
    low = [name.casefold().removesuffix("_deg") for name in heading]
    lat = [k for k, name in enumerate(low) if name in LATITUDES]
    lon = [k for k, name in enumerate(low) if name in LONGITUDES]
    return (lat[0], lon[0]) if len(lat) == len(lon) == 1 else None


def _write_csv(path: Path, boundary: Boundary) -> None:
    if boundary.keep_outs:
        raise UserError("CSV has no keep-outs; use another suffix")
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

_READERS: dict[str, Callable[[Path], list[Shape]]] = {
    ".geojson": _read_geojson,
    ".json": _read_geojson,
    ".kml": _read_kml,
    ".shp": _read_shapefile,
    ".xml": isoxml_file.read_folder,
    ".zip": _read_archive,
    ".kmz": _read_archive,
    ".gpx": read_rings,
}
