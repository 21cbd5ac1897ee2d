"""The field's corners against positions: which one the machine stands at, and the fence of last
resort."""

from __future__ import annotations

import math
from collections.abc import Sequence

import shapely

from host.core.frames import LatLon, LocalFrame
from host.core.messages import Fix

FENCE_M = 10.0
"""A phone's position errs by some metres: nearer to the boundary it proves nothing."""
FENCE_FIXES = 3
"""In a row: one reflection off a wall stops nothing."""


def nearest_corner(corners: Sequence[LatLon], lat_deg: float, lon_deg: float) -> int:
    """Index of the corner that the machine stands at."""
    frame = LocalFrame(lat_deg, lon_deg)
    return min(range(len(corners)), key=lambda k: math.hypot(*frame.to_local(*corners[k])))


class Fence:
    """The last resort against a machine that runs away: positions that lie far outside."""

    def __init__(self, corners: Sequence[LatLon]) -> None:
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
