"""The field's boundary as the operator walked it: a file of WGS 84 corners, and the plan from it.

GeoJSON (a Polygon, a Feature or a FeatureCollection of one; longitude before latitude, RFC 7946)
or CSV with one `latitude,longitude` a line. The corners are those of the crop's outer edge.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import shapely

from host.errors import UserError
from host.gnss import LocalFrame
from host.plan import Plan, spiral
from host.types import Fix
from host.vehicle import Vehicle

MAX_FIELD_M = 5000.0
FENCE_M = 10.0
"""A phone's position errs by some metres: nearer to the boundary it proves nothing."""
FENCE_FIXES = 3


def load_boundary(path: Path) -> list[tuple[float, float]]:
    """(latitude, longitude) of the corners, counter-clockwise, none twice. UserError where the file
    does not hold one polygon of the size of a field."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"cannot read the boundary {path}: {error}") from error
    try:
        corners = _geojson(json.loads(text)) if text.lstrip().startswith("{") else _csv(text)
    except (ValueError, TypeError, KeyError, IndexError) as error:
        raise UserError(
            f"boundary {path}: {error}; give a GeoJSON Polygon or lines of latitude,longitude"
        ) from error
    if len(corners) > 1 and corners[0] == corners[-1]:
        corners.pop()
    if len(corners) < 3 or len(set(corners)) < len(corners):
        raise UserError(f"boundary {path}: needs three or more different corners")
    if any(not (abs(lat) <= 90 and abs(lon) <= 180) for lat, lon in corners):
        raise UserError(f"boundary {path}: a corner is not a latitude and longitude in degrees")
    frame = LocalFrame(*corners[0])
    ring = shapely.LinearRing([frame.to_local(*corner) for corner in corners])
    if ring.length > MAX_FIELD_M * 4:
        raise UserError(
            f"boundary {path}: {ring.length / 1e3:.0f} km around; are its numbers swapped?"
        )
    return corners if ring.is_ccw else corners[::-1]


def _geojson(data: Any) -> list[tuple[float, float]]:
    if data.get("type") == "FeatureCollection":
        if len(data["features"]) != 1:
            raise ValueError(f"{len(data['features'])} features instead of one")
        data = data["features"][0]
    if data.get("type") == "Feature":
        data = data["geometry"]
    if data.get("type") != "Polygon":
        raise ValueError(f"its type is {data.get('type')}, not Polygon")
    return [(float(point[1]), float(point[0])) for point in data["coordinates"][0]]


def _csv(text: str) -> list[tuple[float, float]]:
    corners = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        parts = line.split(",")
        try:
            corners.append((float(parts[0]), float(parts[1])))
        except (ValueError, IndexError) as error:
            if not corners and number == 1:  # a heading
                continue
            raise ValueError(f"line {number} is not latitude,longitude") from error
    return corners


def nearest_corner(corners: list[tuple[float, float]], lat_deg: float, lon_deg: float) -> int:
    """Index of the corner that the machine stands at."""
    frame = LocalFrame(lat_deg, lon_deg)
    return min(range(len(corners)), key=lambda k: math.hypot(*frame.to_local(*corners[k])))


def plan_of(
    corners: list[tuple[float, float]], start: int, vehicle: Vehicle, turn: str
) -> tuple[LocalFrame, Plan]:
    """The field frame (origin at the first corner) and the spiral that begins at corner `start`."""
    frame = LocalFrame(*corners[0])
    ring = [frame.to_local(*corner) for corner in corners]
    return frame, spiral(ring, start, vehicle.blade_width_m - vehicle.overlap_m, turn)


class Fence:
    """The last resort against a machine that runs away: positions that lie far outside."""

    def __init__(self, corners: list[tuple[float, float]]) -> None:
        self._frame = LocalFrame(*corners[0])
        self._field = shapely.Polygon([self._frame.to_local(*corner) for corner in corners])
        self._outside = 0

    def breach(self, fix: Fix) -> float | None:
        """How far outside, in metres, once several fixes in a row lay beyond FENCE_M; else None.
        A fix without a position neither counts nor clears."""
        if fix.quality == 0:
            return None
        at = shapely.Point(self._frame.to_local(fix.lat_deg, fix.lon_deg))
        distance = float(self._field.distance(at))
        self._outside = self._outside + 1 if distance > FENCE_M else 0
        return distance if self._outside >= FENCE_FIXES else None
