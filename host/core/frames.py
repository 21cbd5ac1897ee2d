"""Places: on the earth, in the field frame, and the poses in it."""

from __future__ import annotations

import math
from typing import NamedTuple

from pyproj import Proj

LatLon = tuple[float, float]
"""Degrees of WGS 84."""


class Pose2(NamedTuple):
    """A place and a direction in the plane: metres and radians, counter-clockwise from x."""

    x_m: float
    y_m: float
    heading_rad: float

    def ahead(self, along_m: float, left_m: float = 0.0) -> Pose2:
        """The pose so far ahead and to the left of this one, with the same heading."""
        x, y, heading = self
        c, s = math.cos(heading), math.sin(heading)
        return Pose2(x + c * along_m - s * left_m, y + s * along_m + c * left_m, heading)

    def seen_from(self, x_m: float, y_m: float) -> tuple[float, float]:
        """(ahead, left) in metres of a place of the same frame."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        dx, dy = x_m - self.x_m, y_m - self.y_m
        return c * dx + s * dy, c * dy - s * dx


class LocalFrame:
    """The field frame: x east, y north in metres about an origin on the WGS 84 ellipsoid.

    Azimuthal equidistant, so distances from the origin are true and, over a field of kilometres,
    all others to below a millimetre.
    """

    def __init__(self, lat_deg: float, lon_deg: float) -> None:
        self.origin = (lat_deg, lon_deg)
        self._proj = Proj(proj="aeqd", lat_0=lat_deg, lon_0=lon_deg, ellps="WGS84")

    def to_local(self, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """(x, y) in metres."""
        x, y = self._proj(lon_deg, lat_deg)
        return float(x), float(y)

    def to_wgs84(self, x_m: float, y_m: float) -> tuple[float, float]:
        """(latitude, longitude) in degrees."""
        lon, lat = self._proj(x_m, y_m, inverse=True)
        return float(lat), float(lon)
