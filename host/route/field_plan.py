"""From a surveyed field to the plan of its harvest."""

from __future__ import annotations

import math

import shapely

from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.vehicle import Vehicle
from host.field.areas import Areas
from host.field.boundary_file import Boundary
from host.route.plan import Plan, spiral


def plan_of(
    field: Boundary, start: int, vehicle: Vehicle, turn: str, gap_m: float | None = None
) -> tuple[LocalFrame, Plan]:
    """The field frame (origin at the first corner) and the plan that begins at corner `start`. With
    a gap of `gap_m` between field and neighbour's crop the pilot has a geofence. UserError where
    the field cannot be begun there: a strip's both ends must be open ground."""
    frame = field.frame
    ring = [frame.to_local(*corner) for corner in field.crop]
    holes = [[frame.to_local(*corner) for corner in hole] for hole in field.keep_outs]
    plan = spiral(ring, start, vehicle, turn, gap_m, holes, sigma_m=field.known_to_m)
    first = plan.sides[0]
    begins = min(range(len(ring)), key=lambda k: math.dist(ring[k], (first.x_m, first.y_m)))
    if begins != start:
        raise UserError(
            f"this field is not to be begun at corner {start}: put the machine at corner {begins}, "
            f"heading for corner {(begins + 1) % len(ring)}, and give --corner {begins}"
        )
    return frame, plan


def plan_field(
    areas: Areas,
    corner: tuple[float, float],
    vehicle: Vehicle,
    turn: str,
    gap_m: float | None = None,
    sigma_m: float = 0.0,
) -> Plan:
    """The plan of the crop to be cut that begins at the crop's corner nearest to `corner`, or at
    the next that it can be begun at. sigma_m: how surely its corners are known."""
    inset = shapely.Polygon(areas.crop.exterior)
    ring = shapely.geometry.polygon.orient(inset)
    corners = [(float(x), float(y)) for x, y in ring.exterior.coords[:-1]]
    start = min(range(len(corners)), key=lambda k: math.dist(corners[k], corner))
    holes = [[(float(x), float(y)) for x, y in k.coords[:-1]] for k in areas.field.interiors]
    return spiral(corners, start, vehicle, turn, gap_m, holes, sigma_m=sigma_m)
