"""`daranti flash`: writes the firmware onto a board, and asks it who it is."""

from __future__ import annotations

import time
from pathlib import Path

import click

from host.commands.options import port_option
from host.core.terminal import echo
from host.link.flash import LOADERS, check_image, check_port, find_image, write_image
from host.link.session import Link
from host.link.words import greeting


@click.command()
@port_option
@click.option("--board", type=click.Choice(list(LOADERS)), default="uno", show_default=True)
@click.option("--image", type=click.Path(path_type=Path), help="A .hex or .elf file instead.")
def flash(port: str, board: str, image: Path | None) -> None:
    """Writes the firmware onto the board, verifies it and asks it who it is.

    nano_old is a Nano with the old bootloader, uno_hil an Uno for the bench. The parameters in the
    board's EEPROM stay."""
    check_port(port)
    chosen = image or find_image(LOADERS[board].build)
    check_image(chosen, board)
    echo(f"writing {chosen} to {port}")
    write_image(port, chosen, board)
    with Link(port, time.monotonic) as link:
        echo(greeting(link.meet()))
