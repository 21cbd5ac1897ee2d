"""`daranti drive`: the harvest."""

from __future__ import annotations

from pathlib import Path

import click

from host.commands.cli import port_option
from host.runs.session import Order, harvest
from host.vision.mounted.detector import Mode
from host.vision.tuning.profiles import DATABASE


@click.command()
@port_option
@click.option("--camera", required=True, metavar="URL", help="http://..., video file, /dev/videoN.")
@click.option("--gnss", metavar="URL", help="tcp://HOST:PORT, serial port or NMEA file.")
@click.option("--vehicle", type=click.Path(path_type=Path), help="The machine's file.")
@click.option("--mount", default="mast", show_default=True, help="Which of its camera mounts.")
@click.option("--mode", type=click.Choice(["paper", "robust"]), default="robust", show_default=True)
@click.option(
    "--boundary",
    type=click.Path(path_type=Path),
    help="The crop's corners: GeoJSON, KML, Shapefile, ISOXML or latitude,longitude lines.",
)
@click.option("--corner", type=click.IntRange(0), help="Where it stands; default the nearest.")
@click.option("--gap", type=float, metavar="METRES", help="To the neighbour's crop: the geofence.")
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
def drive(
    port: str,
    camera: str,
    gnss: str | None,
    vehicle: Path | None,
    mount: str,
    mode: Mode,
    boundary: Path | None,
    corner: int | None,
    gap: float | None,
    turn: str,
    record: Path | None,
    resume: Path | None,
    profiles: Path,
) -> None:
    """Harvest: follow the crop's edge, turn at its end, go inward, until nothing stands.

    Put the machine at a corner, the crop to its left, the blade's right end on the crop's edge.
    Enter pauses and goes on, Ctrl-C stops at once. Exits with 0 when the field is finished."""
    harvest(
        Order(
            port=port,
            camera=camera,
            gnss=gnss,
            vehicle=vehicle,
            mount=mount,
            mode=mode,
            boundary=boundary,
            corner=corner,
            gap_m=gap,
            turn=turn,
            record=record,
            resume=resume,
            profiles=profiles,
        )
    )
