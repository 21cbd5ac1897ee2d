"""`daranti flash`: writes the firmware onto an Uno, and asks it who it is."""

from __future__ import annotations

import time
from pathlib import Path

import click

from host.commands.options import port_option
from host.core.terminal import echo
from host.link.flash import check_image, check_port, find_image, write_image
from host.link.session import Link
from host.link.words import greeting


@click.command()
@port_option
@click.option("--build", type=click.Choice(["uno", "uno_hil"]), default="uno", show_default=True)
@click.option("--image", type=click.Path(path_type=Path), help="A .hex or .elf file instead.")
def flash(port: str, build: str, image: Path | None) -> None:
    """Writes the firmware onto the board, verifies it and asks it who it is.

    The parameters in the board's EEPROM stay."""
    check_port(port)
    chosen = image or find_image(build)
    check_image(chosen)
    echo(f"writing {chosen} to {port}")
    write_image(port, chosen)
    with Link(port, time.monotonic) as link:
        echo(greeting(link.meet()))
