"""What a run is to do: the plan of the field, or what is left of it, and where it begins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from host.core.errors import UserError
from host.core.frames import LatLon, LocalFrame
from host.core.messages import Fix
from host.core.vehicle import Vehicle
from host.field.areas import areas_of
from host.field.boundary_file import Boundary
from host.field.fence import Fence, nearest_corner
from host.route.field_plan import plan_of
from host.route.plan import Plan, Tell
from host.route.side import NO_EDGE
from host.runs.resume import Progress, laid_out, remaining, resume_at
from host.sensors.newest import Feed

FIRST_FIX_S = 10.0
"""How long the first position is waited for."""
FIRST_FIXES = 10
"""Tries to read a fix that has a position."""
UNSEEN = (
    "it does not see people, animals, posts or stones: whoever or whatever is in its way is driven "
    "over. Keep everybody 10 m away, walk the strip first, stay beside the machine with a hand at "
    "the emergency stop"
)


@dataclass(frozen=True, slots=True)
class Errand:
    """What is to be driven."""

    plan: Plan
    """What is left of the whole."""
    whole: Plan
    """As it is laid out: around the corners as an earlier run found them."""
    entered: Plan
    """The whole as the boundary's file has it."""
    corner: int | None = None
    """Of the boundary, where the whole begins."""
    begun: tuple[int, float] = (0, 0.0)
    """Side and way along it (m) of the whole that the rest begins with."""
    frame: LocalFrame | None = None
    fence: Fence | None = None


def errand_of(
    field: Boundary | None,
    start: int | None,
    vehicle: Vehicle,
    turn: str,
    gap_m: float | None,
    saved: Progress | None,
    source: Path | None,
    inset_m: float = 0.0,
    tell: Tell | None = None,
) -> Errand:
    """The plan from corner `start` on, or what the progress `saved` (read from `source`) leaves of
    it. Without a field: no plan."""
    if field is None or start is None:
        bare = Plan(turn=turn)
        return Errand(bare, bare, bare)
    frame, whole = plan_of(field, start, vehicle, turn, gap_m, inset_m, tell)
    errand = Errand(whole, whole, whole, start, (0, 0.0), frame, Fence(field.crop))
    return errand if saved is None or source is None else going_on(errand, saved, source, vehicle)


def going_on(errand: Errand, saved: Progress, source: Path, vehicle: Vehicle) -> Errand:
    """What the progress `saved` (read from `source`) leaves of an errand."""
    whole = laid_out(saved, errand.entered, source, vehicle)
    begun = resume_at(saved, whole, source)
    return replace(errand, plan=remaining(whole, *begun), whole=whole, begun=begun)


def chosen_corner(
    field: Boundary | None,
    path: Path | None,
    corner: int | None,
    gap: float | None,
    inset_m: float,
    saved: Progress | None,
) -> int | None:
    """The corner that the plan begins at, None where the position has to tell. UserError where the
    options do not fit the boundary or each other."""
    for given, name, what in (
        (corner, "--corner", "names a corner"),
        (gap, "--gap", "is measured from the edge"),
        (inset_m or None, "--inset", "is measured from the edge"),
        (saved, "--resume", "goes on with the plan"),
    ):
        if given is not None and field is None:
            raise UserError(f"{name} {what} of --boundary, which is not given")
    if field is None:
        return None
    if corner is not None and corner >= len(field.crop):
        raise UserError(f"--corner {corner}: {path} has the corners 0 to {len(field.crop) - 1}")
    areas_of(field.polygon(field.frame), gap, inset_m=inset_m)
    if saved is None:
        return corner
    if corner is not None and corner != saved.corner:
        raise UserError(f"--corner {corner}: the run to be resumed began at corner {saved.corner}")
    if saved.corner >= len(field.crop):
        raise UserError(f"--resume: {path} is not the boundary of that run; give the same one")
    return saved.corner


def warnings(field: Boundary | None, gap: float | None, gnss: str | None) -> list[str]:
    """What does not watch over the run, or not well."""
    doubts = field.doubts if field is not None else []
    return [*_without_boundary(field, gap), *_without_gnss(field, gnss), *doubts]


def _without_gnss(field: Boundary | None, gnss: str | None) -> list[str]:
    if gnss is not None:
        return []
    return [
        "no --gnss: no position tells where the machine starts or when it leaves the field"
        + (", and a wrong --corner or direction is not noticed" if field is not None else "")
    ]


def _without_boundary(field: Boundary | None, gap: float | None) -> list[str]:
    if field is None:
        return [
            "no --boundary: no plan and no geofence. Only the picture ends a side and keeps the "
            "machine out of the neighbour's crop, and the run cannot be resumed"
        ]
    if gap is None:
        return [
            "no --gap: there is no geofence. Only the picture and the sides' lengths keep the "
            "machine out of the neighbour's crop; measure the ground between and give --gap METRES"
        ]
    return []


def intention(boundary: Path | None, errand: Errand, vehicle: Vehicle) -> list[str]:
    """What the machine will do once it is started, for the operator to read before."""
    blade = (
        f"blade: {vehicle.blade_width_m:g} m wide, {vehicle.blade_height_m:g} m above the ground; "
        "it turns as soon as the machine moves towards the crop"
    )
    if not errand.whole.sides or errand.frame is None:
        return [
            "it will follow the crop's edge from where it stands, the crop to its left, and turn "
            "left at each end",
            blade,
            UNSEEN,
        ]
    index, cut_m = errand.begun
    side = errand.whole.sides[index]
    x, y, _ = side.pose(cut_m)
    heading_rad = side.heading_rad
    lat, lon = errand.frame.to_wgs84(x, y)
    where = f"at corner {errand.corner} of {boundary}"
    if (index, cut_m) != (0, 0.0):
        where = (
            f"{cut_m:.1f} m along it, where its crop still stands" if cut_m else "at its beginning"
        )
    elif errand.whole.begins_inside != NO_EDGE:
        where += ", its blade there, in standing crop: the edge goes on behind it"
        heading_rad += errand.whole.begins_along[0]
    left = len(errand.whole.sides) - index
    return [
        f"it will cut {errand.whole.name(index)}, {side.length_m:.0f} m, then {left - 1} more",
        f"it has to stand {where} (near {lat:.6f} {lon:.6f}), heading "
        f"{round(compass_deg(heading_rad)) % 360} degrees by the compass, the crop to its "
        "left, the blade's right end on the crop's edge",
        blade,
        UNSEEN,
    ]


def compass_deg(heading_rad: float) -> float:
    """A heading of the field frame by the compass: clockwise from north, 0..360."""
    return (90.0 - math.degrees(heading_rad)) % 360


def corner_at(corners: Sequence[LatLon], fixes: Feed[Fix] | None) -> int:
    """The corner nearest to where the machine says it is."""
    for _ in range(FIRST_FIXES):
        if fixes is None or not fixes.wait(FIRST_FIX_S):
            break
        fix = fixes.take()
        if fix is not None and fix.quality > 0:
            return nearest_corner(corners, fix.lat_deg, fix.lon_deg)
    why = "no --gnss" if fixes is None else fixes.problem or "the receiver has no fix yet"
    raise UserError(
        f"which corner does the machine stand at? There is no position ({why}): give --corner, "
        f"0 to {len(corners) - 1}"
    )
