"""What the check needs before it touches the machine: the field's file, room on the disk, power."""

from __future__ import annotations

from typing import Final

from host.check.lines import Target
from host.check.notes import Notes
from host.core.errors import UserError
from host.field.boundary_file import Boundary, load_field
from host.route.field_plan import plan_of, told

BYTES_AN_HOUR: Final = 2.4e9
"""What a record takes, pictures included, as the default harvest's does."""
LEAST_BYTES: Final = 2 * BYTES_AN_HOUR
"""Room for half a day's two hours of cutting."""
LEAST_POWER: Final = 30
"""Percent of a laptop's battery: an old one lasts an hour with that. By judgement."""


def field(notes: Notes, target: Target) -> Boundary | None:
    """The field's file and its plan; the boundary, where it is sound."""
    if target.boundary is None:
        notes.note("field", "bad", "field.none")
        return None
    try:
        boundary = load_field(target.boundary, target.field)
        vehicle, gap_m = notes.hands.vehicle, target.gap_m
        with told(f"plan of {target.boundary}") as tell:
            _, plan = plan_of(
                boundary, target.corner, vehicle, "three_point", gap_m, target.inset_m, tell
            )
    except UserError as error:
        notes.note("field", "bad", "field.unusable", why=str(error))
        return None
    if target.gap_m is None:
        notes.note("field", "bad", "field.no_gap")
        return boundary
    area = boundary.polygon(boundary.frame).area
    notes.note("field", "ok", "field.ok", area=round(area), sides=len(plan.sides))
    return boundary


def laptop(notes: Notes) -> None:
    """Room for the record, and power."""
    free = notes.hands.free_bytes()
    hours = round(free / BYTES_AN_HOUR, 1)
    notes.judge("disk", free >= LEAST_BYTES, "disk.full", free=round(free / 1e9, 1), hours=hours)
    power = notes.hands.power()
    if power is None:
        notes.note("power", "ok", "power.mains")
    elif power[0] < LEAST_POWER and not power[1]:
        notes.note("power", "bad", "power.low", percent=power[0])
    else:
        notes.note("power", "ok", "power.ok", percent=power[0])
