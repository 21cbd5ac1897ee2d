"""`daranti calibrate delay`: how late the camera's pictures come, from a drive in curves."""

from __future__ import annotations

import math
import time
from contextlib import ExitStack
from pathlib import Path

import click

from host.commands.moving import asked, consent, countdown_option, stopped_after, yes_option
from host.commands.options import mount_option, port_option, written_vehicle_option
from host.core.output_place import check_file
from host.core.progress import Watch
from host.core.terminal import echo
from host.core.vehicle_file import load_vehicle, mount_of, save_vehicle
from host.link.port import check_port
from host.link.session import connect
from host.runs.first_picture import first_picture
from host.runs.ready import make_ready_visibly
from host.sensors.camera_stream import camera_feed
from host.tune.camera_delay import Delay
from host.tune.on_machine import LinkWire
from host.tune.weaving import WEAVE_M, WEAVE_MPS, WEAVE_RAD, measured_delay

LINE_EVERY_S = 5.0
"""Between lines of progress where no terminal shows a bar, s: three in the drive."""
WILL = (
    f"the machine will weave {WEAVE_M:.1f} m ahead at {WEAVE_MPS:g} m/s, its wheel "
    f"{math.degrees(WEAVE_RAD):.0f} degrees to either side, the blade off",
    "it does not see people, animals or posts: see that the ground is free and level and nobody "
    "within 10 m, switch the blade's own supply off, keep a hand at the emergency stop",
)


@click.command()
@port_option
@click.option("--camera", required=True, metavar="URL", help="http://..., /dev/videoN.")
@written_vehicle_option("the delay")
@mount_option
@yes_option
@countdown_option
def calibrate_delay(
    port: str, camera: str, vehicle: Path | None, mount: str, yes: bool, countdown_s: int
) -> None:
    """Measures how late the camera's pictures come, and writes it into the vehicle file.

    Put the machine on free, level ground. It weaves some metres ahead with its blade off, and what
    the pictures show of the turning is compared with what wheels and steering say. The machine does
    not see people, animals or posts: keep everybody 10 m away and stay beside the emergency stop.

    Ctrl-C stops at once. Exits with 0 when the delay was found, 2 where it could not start or the
    pictures do not tell, 4 when a fault ended the drive, 130 after Ctrl-C."""
    if vehicle is not None:
        check_file(vehicle)
    machine = load_vehicle(vehicle if vehicle is not None and vehicle.exists() else None)
    mounted = mount_of(machine, mount)
    check_port(port)
    pictures = camera_feed(camera, time.monotonic, lambda _: None)
    operator = asked(yes=yes)
    make_ready_visibly()
    with ExitStack() as stack:
        link = stack.enter_context(connect(port))
        stack.callback(pictures.close)
        pictures.start()
        first_picture(pictures, camera, mounted)
        for line in WILL:
            echo(line)
        consent(operator, link, countdown_s, yes=yes)
        with (
            stopped_after(link),
            Watch("weaving, keep clear (Ctrl-C stops)", 1.0, every_s=LINE_EVERY_S) as watch,
        ):
            found = measured_delay(LinkWire(link), port, machine, pictures, watch.reach)
    delay_s = round(found.delay_s, 3)
    echo(_found(found, machine.camera_delay_s, vehicle))
    if vehicle is None:
        echo(f"camera_delay_s: {delay_s:g}: write it into the vehicle file, or give --vehicle")
        return
    save_vehicle(vehicle, machine.model_copy(update={"camera_delay_s": delay_s}))
    echo(f"{vehicle}: camera_delay_s is {delay_s:g} now")


def _found(found: Delay, before_s: float, vehicle: Path | None) -> str:
    there = vehicle is not None and vehicle.exists()
    before = f"{vehicle} said" if there else "without a file it is taken for"
    return (
        f"the pictures come {found.delay_s:.3f} s late, standard deviation {found.sigma_s:.3f} s; "
        f"{before} {before_s:.3f} s"
    )
