"""The field as the operator walked it: corners for the plan, and the fence of last resort.

Files and their formats: `host.field.boundary_file`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import click
import shapely

from host.core.errors import UserError
from host.core.messages import Fix
from host.core.vehicle import Vehicle
from host.field.boundary_file import Boundary, LatLon, load_field, save_field
from host.route.plan import Plan, spiral
from host.sensors.nmea import LocalFrame

FENCE_M = 10.0
"""A phone's position errs by some metres: nearer to the boundary it proves nothing."""
FENCE_FIXES = 3


def nearest_corner(corners: Sequence[LatLon], lat_deg: float, lon_deg: float) -> int:
    """Index of the corner that the machine stands at."""
    frame = LocalFrame(lat_deg, lon_deg)
    return min(range(len(corners)), key=lambda k: math.hypot(*frame.to_local(*corners[k])))


def plan_of(
    field: Boundary, start: int, vehicle: Vehicle, turn: str, gap_m: float | None = None
) -> tuple[LocalFrame, Plan]:
    """The field frame (origin at the first corner) and the plan that begins at corner `start`. With
    a gap of `gap_m` between field and neighbour's crop the pilot has a geofence. UserError where
    the field cannot be begun there: a strip's both ends must be open ground."""
    frame = field.frame
    ring = [frame.to_local(*corner) for corner in field.crop]
    holes = [[frame.to_local(*corner) for corner in hole] for hole in field.keep_outs]
    plan = spiral(ring, start, vehicle, turn, gap_m, holes)
    first = plan.sides[0]
    begins = min(range(len(ring)), key=lambda k: math.dist(ring[k], (first.x_m, first.y_m)))
    if begins != start:
        raise UserError(
            f"this field is not to be begun at corner {start}: put the machine at corner {begins}, "
            f"heading for corner {(begins + 1) % len(ring)}, and give --corner {begins}"
        )
    return frame, plan


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


@click.command()
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("target", type=click.Path(path_type=Path))
def convert(source: Path, target: Path) -> None:
    """Write the field in SOURCE to TARGET; the suffix names the format: .geojson, .kml, .shp, .xml
    (ISOXML), .csv."""
    boundary = load_field(source)
    save_field(target, boundary)
    click.echo(
        f"{target}: {boundary.name or 'field'}, {len(boundary.crop)} corners, "
        f"{len(boundary.keep_outs)} keep-outs, {boundary.polygon(boundary.frame).area:.0f} m2"
    )
