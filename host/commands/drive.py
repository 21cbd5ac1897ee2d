"""`daranti drive`: the harvest."""

from __future__ import annotations

from pathlib import Path

import click

from host.commands.moving import countdown_option, yes_option
from host.commands.options import (
    field_option,
    gap_option,
    gnss_option,
    gyro_option,
    inset_option,
    mode_option,
    mount_option,
    port_option,
    vehicle_option,
)
from host.core.number_range import NumberRange, WholeRange
from host.core.vehicle_file import load_vehicle
from host.runs.session import Order, harvest
from host.tune.follow_margins import check_steady
from host.vision.mounted.detector import Mode
from host.vision.tuning.profiles import DATABASE


@click.command()
@port_option
@click.option("--camera", required=True, metavar="URL", help="http://..., video file, /dev/videoN.")
@gnss_option
@gyro_option
@vehicle_option
@mount_option
@mode_option
@click.option(
    "--boundary",
    type=click.Path(path_type=Path),
    help="The crop's corners: GeoJSON, KML, Shapefile, ISOXML, GPX, a .zip of these, or "
    "latitude,longitude lines.",
)
@click.option("--corner", type=WholeRange(0), help="Where it stands; default the nearest.")
@gap_option
@inset_option
@click.option(
    "--turn", type=click.Choice(["three_point", "arc"]), default="three_point", show_default=True
)
@click.option(
    "--record", type=click.Path(path_type=Path), help="The record's file; default out/drive-*.mcap."
)
@click.option(
    "--resume",
    type=click.Path(path_type=Path),
    help="Go on where the run that left this .progress.json ended.",
)
@click.option(
    "--db",
    "profiles",
    type=click.Path(path_type=Path),
    default=DATABASE,
    show_default=True,
    help="Tuned colour thresholds for --mode paper: `daranti tune vision`.",
)
@click.option(
    "--heading",
    "heading_deg",
    type=NumberRange(0, 360),
    help="Where the machine heads by the compass; checked before it starts.",
)
@yes_option
@countdown_option
@field_option
def drive(
    port: str,
    camera: str,
    gnss: str | None,
    gyro: str | None,
    vehicle: Path | None,
    mount: str,
    mode: Mode,
    boundary: Path | None,
    corner: int | None,
    gap: float | None,
    inset: float,
    turn: str,
    record: Path | None,
    resume: Path | None,
    profiles: Path,
    heading_deg: float | None,
    yes: bool,
    chosen: str,
    countdown_s: int,
) -> None:
    """Harvest: follow the crop's edge, turn at its end, go inward, until nothing stands.

    Put the machine at a corner, the crop to its left, the blade's right end on the crop's edge.
    It says what it will do, checks place and direction, and starts when you type the word. The
    machine does not see people, animals or posts: keep everybody 10 m away and stay beside the
    emergency stop.

    Enter pauses and goes on, Ctrl-C stops at once. Exits with 0 when the field is finished, 2 where
    it could not start, 4 when a fault ended the run, 130 after Ctrl-C."""
    check_steady(load_vehicle(vehicle))
    harvest(
        Order(
            port=port,
            camera=camera,
            gnss=gnss,
            gyro=gyro,
            vehicle=vehicle,
            mount=mount,
            mode=mode,
            boundary=boundary,
            corner=corner,
            gap_m=gap,
            inset_m=inset,
            turn=turn,
            record=record,
            resume=resume,
            profiles=profiles,
            heading_deg=heading_deg,
            yes=yes,
            field=chosen,
            countdown_s=countdown_s,
        )
    )
