"""`daranti plan`: what the harvest of a field comes to, before anything moves."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import click
import shapely
from rich.table import Table

from host.commands.options import field_option, gap_option, inset_option, vehicle_option
from host.core.errors import UserError
from host.core.number_range import WholeRange
from host.core.progress import Watch
from host.core.terminal import PlainConsole
from host.core.vehicle import Vehicle
from host.core.vehicle_file import load_vehicle
from host.field.areas import Areas, areas_of
from host.field.boundary_file import RECORDED, Boundary, boundary_of, load_field, save_field
from host.field.corners import was_recorded
from host.route.field_plan import plan_field, told
from host.route.preview import Preview, check_picture, draw_preview, hours, preview
from host.route.side import NO_EDGE


def table_of(previews: list[Preview]) -> Table:
    """The turns side by side."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("turn", no_wrap=True)
    names = ("sides", "shuttles", "cutting", "turning", "time", "stays", "coverage", "room")
    for name in names:
        table.add_column(name, justify="right", no_wrap=True)
    for shown in previews:
        table.add_row(
            shown.plan.turn,
            str(len(shown.plan.sides)),
            str(shown.shuttles),
            f"{shown.cutting_m:.0f} m",
            f"{shown.turning_m:.0f} m",
            hours(shown.time_s),
            f"{shown.leftover.area:.1f} m2",
            f"{100 * shown.coverage:.2f} %",
            f"{shown.room_m:.2f} m",
        )
    return table


@click.command()
@click.argument("field", type=click.Path(path_type=Path))
@vehicle_option
@click.option(
    "--corner",
    "--start",
    "start",
    type=WholeRange(0),
    default=0,
    show_default=True,
    help="Where it begins; the survey's picture numbers the corners.",
)
@inset_option
@gap_option
@click.option(
    "--turn", type=click.Choice(["three_point", "arc"]), default="three_point", show_default=True
)
@click.option("--out", type=click.Path(path_type=Path), help="The picture; default FIELD.plan.png.")
@field_option
def plan(
    field: Path,
    vehicle: Path | None,
    start: int,
    inset: float,
    gap: float | None,
    turn: str,
    out: Path | None,
    chosen: str,
) -> None:
    """Length, time, turns and what stays standing, before anything moves.

    FIELD is a boundary: .geojson, .kml, .kmz, .shp, .xml (ISOXML), .zip, .gpx or .csv. Both kinds
    of turn are compared; the picture shows the one of --turn."""
    machine = load_vehicle(vehicle)
    boundary = load_field(field, chosen)
    if start >= len(boundary.crop):
        raise UserError(
            f"--corner {start}: {field} has the corners 0 to {len(boundary.crop) - 1}; the picture "
            "of the survey numbers them"
        )
    beside = field if field.name.strip(".") else field.resolve()  # the folder one stands in
    picture = out or beside.with_suffix(".plan.png")
    check_picture(picture)
    areas = areas_of(boundary.polygon(boundary.frame), gap, inset_m=inset)
    try:
        previews = _previews(field, boundary, areas, machine, start, turn, gap, inset)
    except UserError as error:
        raise UserError(f"{field}: {error}") from error
    shown = previews[turn]
    console = PlainConsole(soft_wrap=True)
    name = boundary.name or field.stem
    _say_field(console, name, boundary, areas, start, inset)
    console.print_table(table_of(list(previews.values())))
    _say_plan(console, boundary, shown, start, gap)
    _keep_parts(console, picture.with_name(beside.stem), name, boundary, shown)
    title = (
        f"{name}: {len(shown.plan.sides)} sides, {shown.plan.turn} turns, "
        f"{hours(shown.time_s)}, coverage {100 * shown.coverage:.2f} %"
    )
    try:
        draw_preview(picture, shown, title)
    except OSError as error:
        raise UserError(f"cannot write the picture {picture}: {error.strerror}") from error
    console.print(f"written: {picture}")


def _previews(
    field: Path,
    boundary: Boundary,
    areas: Areas,
    machine: Vehicle,
    start: int,
    turn: str,
    gap: float | None,
    inset: float,
) -> dict[str, Preview]:
    """By both kinds of turn."""
    corner = boundary.frame.to_local(*boundary.crop[start])
    with told(f"plan of {field}") as tell:
        sides = plan_field(
            areas,
            corner,
            machine,
            turn,
            gap,
            boundary.known_to_m,
            inset,
            tell,
            boundary.recorded,
        )
    turns = ("three_point", "arc")
    found: dict[str, Preview] = {}
    with Watch(f"preview of {field}", len(turns)) as watch:
        for name in turns:
            found[name] = preview(replace(sides, turn=name), areas, machine)
            watch.step(name)
    return found


def _say_field(
    console: PlainConsole, name: str, boundary: Boundary, areas: Areas, start: int, inset: float
) -> None:
    console.print(
        f"{name}: {areas.field.area:.0f} m2, {len(boundary.crop)} corners, "
        f"{len(boundary.keep_outs)} keep-outs, start at corner {start}"
    )
    said = "" if boundary.sigma_m is not None else "; the file does not say it, as walked once"
    console.print(f"corners known to {boundary.known_to_m:.2f} m{said}")
    if was_recorded(boundary.crop, boundary.recorded):
        said = (
            ""
            if boundary.recorded
            else (
                f"; taken so for its many points: if it was drawn corner by corner, say "
                f"{RECORDED}: false as a property of a GeoJSON file"
            )
        )
        console.print(f"recorded point by point: the edge may bend between its corners{said}")
    if areas.price > 0:
        console.print(
            f"left standing by choice (inset {inset:g} m, keep-outs' margin): "
            f"{areas.field.area - areas.crop.area:.1f} m2, {100 * areas.price:.2f} % of the crop"
        )


def _say_plan(
    console: PlainConsole, boundary: Boundary, shown: Preview, start: int, gap: float | None
) -> None:
    first = shown.plan.sides[0]
    begins = min(
        range(len(boundary.crop)),
        key=lambda k: math.dist(boundary.frame.to_local(*boundary.crop[k]), (first.x_m, first.y_m)),
    )
    if begins != start:
        console.print(f"begins at corner {begins}: from corner {start} more would stay standing")
    if shown.plan.begins_inside != NO_EDGE:
        console.print(
            f"the edge goes on at corner {begins}: put the blade there, in the standing crop, and "
            "the machine along the edge"
        )
    if gap is None:
        console.print(
            "no --gap: whether the turns have room is not checked, and a drive without it has no "
            "geofence; measure the ground up to the neighbour's crop"
        )
    for text in [*shown.warnings, *boundary.doubts]:
        console.print(f"warning: {text}")


def _keep_parts(
    console: PlainConsole, stem: Path, name: str, boundary: Boundary, shown: Preview
) -> None:
    """What no turn leads to, as fields of their own beside the picture: there can be written."""
    for number, ring in enumerate(shown.plan.parts, start=1):
        part = shapely.Polygon(ring)
        rest = stem.with_name(f"{stem.name}.part{number}.geojson")
        field = boundary_of(
            part,
            boundary.frame,
            f"{name}, part {number}",
            boundary.sigma_m,
            shown.plan.recorded,
        )
        save_field(rest, replace(field, left_out=boundary.left_out))
        console.print(
            f"the field parts: {part.area:.0f} m2 are left that no turn leads to; harvest them "
            f"after the rest, as a field of their own: {rest}"
        )
