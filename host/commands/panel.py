"""`daranti panel`: serves the operator's page."""

from __future__ import annotations

import time
from pathlib import Path

import click

from host.commands.options import (
    camera_option,
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
from host.core.errors import UserError
from host.core.number_range import WholeRange
from host.core.terminal import echo
from host.core.vehicle_file import load_vehicle
from host.field.boundary_file import load_field
from host.link.port import check_address, check_port
from host.panel.fields import FieldDesk
from host.panel.guard import Pairing
from host.panel.machine import Settings
from host.panel.server import Panel, application
from host.panel.serving import listening, serve_on
from host.runs.errand import chosen_corner
from host.runs.ready import make_ready_visibly
from host.sensors.camera_stream import camera_feed
from host.sensors.gyro import gyro_of
from host.sensors.nmea import gnss_feed
from host.tune.follow_margins import check_steady
from host.vision.mounted.in_view import seeing_mount


@click.command()
@port_option
@camera_option
@gnss_option
@gyro_option
@vehicle_option
@mount_option
@mode_option
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("out/panel"),
    show_default=True,
    help="Where fields and records go.",
)
@click.option("--boundary", type=click.Path(path_type=Path), help="The field, if there is a file.")
@field_option
@gap_option
@inset_option
@click.option("--lan", is_flag=True, help="For phones on the same network: they pair by a code.")
@click.option(
    "--no-presence",
    "presence",
    flag_value=False,
    default=True,
    help="Go on driving when the page that drives is closed or asleep.",
)
@click.option(
    "--web-port", type=WholeRange(0, 65535), default=8023, show_default=True, help="0: any."
)
def panel(
    port: str,
    camera: str | None,
    gnss: str | None,
    gyro: str | None,
    vehicle: Path | None,
    mount: str,
    mode: str,
    folder: Path,
    boundary: Path | None,
    chosen: str,
    gap: float | None,
    inset: float,
    lan: bool,
    presence: bool,
    web_port: int,
) -> None:
    """Serves the operator's page: check, field, harvest, stop.

    Open the printed address in a browser. Ctrl-C stops the machine and ends."""
    machine = load_vehicle(vehicle)
    check_steady(machine)
    seeing_mount(machine, mount)
    _check_devices(port, camera, gnss, gyro)
    if boundary is not None:
        field = load_field(boundary, chosen)
        chosen_corner(field, boundary, None, gap, inset, None)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"cannot make the folder {folder}: {error.strerror}") from error
    settings = Settings.model_validate(
        {
            "port": port,
            "camera": camera,
            "gnss": gnss,
            "gyro": gyro,
            "vehicle": vehicle.resolve() if vehicle is not None else None,
            "mount": mount,
            "mode": mode,
            "folder": folder.resolve(),
            "presence": presence,
        }
    )
    address = "0.0.0.0" if lan else "127.0.0.1"
    with listening(address, web_port, "--web-port") as listener:
        make_ready_visibly()
        pairing = Pairing(time.monotonic, needed=lan)
        fields = FieldDesk(folder, machine, boundary, gap, inset, chosen)
        app = application(Panel(settings, pairing, fields, _show_code))
        serve_on(listener, app, address, lambda url: echo(f"panel: {url}"))


def _check_devices(port: str, camera: str | None, gnss: str | None, gyro: str | None) -> None:
    """UserError where an address means nothing. A board may be plugged in later: the page says what
    it waits for."""
    check_address(port)
    try:
        check_port(port)
    except UserError as error:
        echo(f"warning: {error}", err=True)
    for feed, url in ((camera_feed, camera), (gnss_feed, gnss)):
        if url is not None:
            feed(url, time.monotonic, echo)
    gyro_of(gyro, camera or "", time.monotonic, echo)


def _show_code(code: str, wait_s: float) -> None:
    if wait_s > 0:
        echo(f"too many wrong codes: nobody pairs for {wait_s:.0f} s, then:")
    echo(f"pair a phone with the code {code}")
