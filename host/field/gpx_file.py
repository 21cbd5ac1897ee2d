"""GPX 1.1, as phone apps record a walk: rings for a boundary file, fixes for a survey."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

import defusedxml.ElementTree
import gpxpy
import gpxpy.gpx
import shapely
from defusedxml.common import DefusedXmlException
from gpxpy.geo import haversine_distance

from host.core.errors import UserError
from host.core.messages import Fix
from host.field.shapes import Shape, shape_of

FIX_S = 1.0
"""Between fixes of a survey, as a receiver sends them."""
MOST_UNSEEN_S = 60.0
"""An app that saves battery saves a point every 5 to 30 s; what lies between two that are further
apart is not known."""
WALKING_MPS = 1.2
"""Taken for the speed of a walk whose points have no time: a walker's."""
UNREADABLE_XML: Final = (
    ET.ParseError,
    DefusedXmlException,
    ValueError,
    LookupError,  # an encoding that there is not
    RecursionError,
)
"""What reading a stranger's XML, or writing it anew, raises."""


def bare(root: ET.Element) -> ET.Element:
    """Without namespaces: readers know a format by how its text begins."""
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
        element.attrib = {k: v for k, v in element.attrib.items() if not k.startswith("{")}
    return root


def _parsed(path: Path) -> gpxpy.gpx.GPX:
    try:
        root = defusedxml.ElementTree.parse(path, forbid_dtd=True).getroot()
        assert isinstance(root, ET.Element)
        return gpxpy.parse(ET.tostring(bare(root), encoding="unicode"))
    except (*UNREADABLE_XML, gpxpy.gpx.GPXException) as error:
        raise UserError(f"it is not GPX that can be read ({error})") from error


def _check(points: Sequence[gpxpy.gpx.GPXTrackPoint | gpxpy.gpx.GPXRoutePoint]) -> None:
    """UserError where one is no place on earth; of no number nothing is true."""
    if not all(abs(point.latitude) <= 90 and abs(point.longitude) <= 180 for point in points):
        raise UserError("a point is no latitude and longitude in degrees")


def read_rings(path: Path) -> list[Shape]:
    """Every track segment and route of three corners or more, as a ring, and the waypoints."""
    gpx = _parsed(path)
    ways: list[tuple[str | None, Sequence[gpxpy.gpx.GPXTrackPoint | gpxpy.gpx.GPXRoutePoint]]]
    ways = [(route.name, route.points) for route in gpx.routes]
    ways += [(track.name, segment.points) for track in gpx.tracks for segment in track.segments]
    for _, points in ways:
        _check(points)
    shapes = [
        Shape(shapely.Polygon([(point.longitude, point.latitude) for point in points]), name or "")
        for name, points in ways
        if len(points) >= 3
    ]
    if not shapes:
        raise UserError("it holds no track or route around a field")
    if len(shapes) == 1 and not shapes[0].polygon.is_valid:
        raise UserError("its track crosses itself; `daranti survey` makes a boundary of a walk")
    return [*shapes, *_marks(gpx)]


def read_marks(path: Path) -> list[Shape]:
    """The places that somebody marked on the way. UserError where it is no GPX."""
    return _marks(_parsed(path))


def _marks(gpx: gpxpy.gpx.GPX) -> list[Shape]:
    return [
        shape_of(shapely.Point(point.longitude, point.latitude), point.name or "")
        for point in gpx.waypoints
    ]


def read_fixes(path: Path) -> tuple[list[Fix], int]:
    """The walk that its tracks are, a fix every FIX_S, and how many points it had.

    An app leaves points out where the walker goes straight on; the points of a segment are
    connected all the same (GPX 1.1, trksegType). Where it lost its receiver, it begins another
    segment. UserError where it is no GPX or holds no track.
    """
    segments = [segment.points for track in _parsed(path).tracks for segment in track.segments]
    points = [point for segment in segments for point in segment]
    if not points:
        raise UserError("it holds no track; record one around the field")
    _check(points)
    fixes: list[Fix] = []
    for segment in segments:
        fixes += _connected(segment, fixes[-1].stamp if fixes else 0.0)
    return fixes, len(points)


def _connected(points: list[gpxpy.gpx.GPXTrackPoint], stamp: float) -> Iterator[Fix]:
    before = None
    for point in points:
        took = _seconds(before, point) if before is not None else 0.0
        if point.time is not None and before is None:
            stamp = point.time.timestamp()
        steps = max(1, math.ceil(took / FIX_S)) if took <= MOST_UNSEEN_S else 1
        for k in range(1, steps + 1):
            share = k / steps
            origin = before or point
            yield Fix(
                stamp + share * took,
                origin.latitude + share * (point.latitude - origin.latitude),
                origin.longitude + share * (point.longitude - origin.longitude),
                1,
                math.nan if point.horizontal_dilution is None else point.horizontal_dilution,
                int(point.satellites or 0),
            )
        stamp += took
        before = point


def _seconds(a: gpxpy.gpx.GPXTrackPoint, b: gpxpy.gpx.GPXTrackPoint) -> float:
    if a.time is not None and b.time is not None:
        return max(0.0, b.time.timestamp() - a.time.timestamp())
    return haversine_distance(a.latitude, a.longitude, b.latitude, b.longitude) / WALKING_MPS
