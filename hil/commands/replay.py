"""`daranti-hil replay`: a record through the pilot and the firmware of today."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from hil.bench.replay import replay
from host.core.errors import UnfinishedError, UserError
from host.core.progress import Watch
from host.core.terminal import echo
from host.link.protocol import PARAMS


def _settings(given: tuple[str, ...], option: str) -> dict[str, float]:
    values = {}
    for setting in given:
        name, _, value = setting.partition("=")
        try:
            values[name] = float(value)
        except ValueError as error:
            raise UserError(f"{option} {setting}: say NAME=NUMBER") from error
    return values


@click.command(name="replay")
@click.argument("path", metavar="RECORD", type=click.Path(path_type=Path))
@click.option("--param", multiple=True, metavar="NAME=VALUE", help="A parameter of the firmware.")
@click.option("--vehicle", multiple=True, metavar="NAME=VALUE", help="A field of the vehicle file.")
@click.option("--firmware", type=click.Choice(["desk", "avr"]), help="Another than the record's.")
@click.option("--all", "show_all", is_flag=True, help="Every difference, not only the first.")
def command(
    path: Path,
    param: tuple[str, ...],
    vehicle: tuple[str, ...],
    firmware: Literal["desk", "avr"] | None,
    show_all: bool,
) -> None:
    """Feeds a record's inputs through today's pilot and firmware and shows the first difference.

    Exits with 3 when there is one."""
    parameters = _settings(param, "--param")
    unknown = [name for name in parameters if name not in PARAMS]
    if unknown:
        raise UserError(f"--param {unknown[0]}: the firmware has no such parameter")
    with Watch(f"replay of {path}"):
        outcome = replay(
            path,
            vehicle=_settings(vehicle, "--vehicle"),
            parameters=parameters,
            firmware=firmware,
        )
    for note in outcome.notes:
        echo(f"note: {note}")
    counts = f"{outcome.commands} commands, {outcome.views} views, {outcome.messages} messages"
    for who, differences in (("pilot", outcome.pilot), ("firmware", outcome.firmware)):
        for difference in differences if show_all else differences[:1]:
            echo(f"{who}: {difference}")
    total = len(outcome.pilot) + len(outcome.firmware)
    if total:
        raise UnfinishedError(f"{path}: {total} differences in {counts}")
    echo(f"{path}: all the same: {counts}")
