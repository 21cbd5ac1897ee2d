"""Options that several commands have alike."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from host.core.number_range import NumberRange
from host.field.areas import MAX_GAP_M, MAX_INSET_M

camera_option = click.option("--camera", metavar="URL", help="http://..., video file, /dev/videoN.")
gnss_option = click.option(
    "--gnss", metavar="URL", help="tcp://HOST:PORT, udp://:PORT, serial port or NMEA file."
)
gyro_option = click.option(
    "--gyro",
    metavar="URL",
    help="http://HOST:PORT/sensors.json; default beside the camera's pictures; none: without.",
)
vehicle_option = click.option(
    "--vehicle", type=click.Path(path_type=Path), help="The machine's file."
)


def written_vehicle_option(what: str, *, required: bool = False) -> Callable[[Any], Any]:
    """Of a command that writes what it has measured into the machine's file."""
    return click.option(
        "--vehicle",
        type=click.Path(path_type=Path),
        required=required,
        help=f"The machine's file: {what} is written into it. It is made where it is not there; "
        "comments in it are lost.",
    )


mount_option = click.option(
    "--mount", default="mast", show_default=True, help="Which of its camera mounts."
)
mode_option = click.option(
    "--mode", type=click.Choice(["paper", "robust"]), default="robust", show_default=True
)
port_option = click.option(
    "--port",
    required=True,
    envvar="DARANTI_PORT",
    help="The firmware's serial port, or socket://HOST:PORT; DARANTI_PORT names a default.",
)

gap_option = click.option(
    "--gap",
    type=NumberRange(0, MAX_GAP_M),
    metavar="METRES",
    help="To the neighbour's crop: the geofence.",
)
inset_option = click.option(
    "--inset",
    type=NumberRange(0, MAX_INSET_M),
    default=0.0,
    metavar="METRES",
    help="So far inside the boundary the crop begins: a border that is cut by hand, or left.",
)
field_option = click.option(
    "--field",
    "chosen",
    default="",
    metavar="NAME",
    help="Which of a file's fields, by its name or number.",
)
