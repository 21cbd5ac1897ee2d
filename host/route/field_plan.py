"""From a surveyed field to the plan of its harvest."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence

import shapely

from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.progress import Watch
from host.core.vehicle import Vehicle
from host.field.areas import Areas, areas_of
from host.field.boundary_file import Boundary
from host.route.plan import Plan, Tell, spiral


class BegunElsewhereError(UserError):
    """The field cannot be begun at the corner that was asked for, but at `corner`."""

    def __init__(self, message: str, corner: int) -> None:
        super().__init__(message)
        self.corner = corner


@contextlib.contextmanager
def told(what: str) -> Iterator[Tell]:
    """For plans that take long: how far they are, on the terminal."""
    with Watch(what, 1.0) as watch:
        yield lambda strips, most: watch.reach(
            min(1.0, strips / most), f"{strips} of at most {most} strips"
        )


def plan_of(
    field: Boundary,
    start: int,
    vehicle: Vehicle,
    turn: str,
    gap_m: float | None = None,
    inset_m: float = 0.0,
    tell: Tell | None = None,
) -> tuple[LocalFrame, Plan]:
    """The field frame (origin at the first corner) and the plan that begins at corner `start`. With
    a gap of `gap_m` between field and neighbour's crop the pilot has a geofence. The crop begins
    `inset_m` inside the field's corners. BegunElsewhereError where the field cannot be begun there:
    a strip's both ends must be open ground."""
    frame = field.frame
    ring = [frame.to_local(*corner) for corner in field.crop]
    whole = field.polygon(frame)
    areas = Areas(whole, whole, None)
    if inset_m > 0.0:
        areas = areas_of(whole, gap_m, inset_m=inset_m)
    plan = plan_field(
        areas,
        ring[start],
        vehicle,
        turn,
        gap_m,
        field.known_to_m,
        inset_m,
        tell,
        field.recorded,
    )
    first = plan.sides[0]
    begun = _nearest(plan.boundary, (first.x_m, first.y_m))
    if begun != _nearest(plan.boundary, ring[start]):
        begins = _nearest(ring, plan.boundary[begun])
        raise BegunElsewhereError(
            f"this field is not to be begun at corner {start}: put the machine at corner {begins}, "
            f"heading for corner {(begins + 1) % len(ring)}, and give --corner {begins}",
            begins,
        )
    return frame, plan


def _nearest(corners: Sequence[tuple[float, float]], place: tuple[float, float]) -> int:
    """Which of the corners is nearest to a place."""
    return min(range(len(corners)), key=lambda k: math.dist(corners[k], place))


def plan_field(
    areas: Areas,
    corner: tuple[float, float],
    vehicle: Vehicle,
    turn: str,
    gap_m: float | None = None,
    sigma_m: float = 0.0,
    inset_m: float = 0.0,
    tell: Tell | None = None,
    recorded: bool | None = None,
) -> Plan:
    """The plan of the crop to be cut that begins at the crop's corner nearest to `corner`, or at
    the next that it can be begun at. sigma_m: how surely its corners are known; `recorded`: what
    was said of how they were made (`host.field.corners.was_recorded`). The ground of the areas'
    inset is the machine's to turn on, as the gap is."""
    ring = shapely.geometry.polygon.orient(areas.begins)
    corners = [(float(x), float(y)) for x, y in ring.exterior.coords[:-1]]
    start = _nearest(corners, corner)
    holes = [[(float(x), float(y)) for x, y in k.coords[:-1]] for k in areas.field.interiors]
    room_m = None if gap_m is None else gap_m + inset_m
    return spiral(corners, start, vehicle, turn, room_m, holes, sigma_m, tell, recorded)
