"""`daranti-hil report`: report.html of a folder of results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    pass
from hil.report.report import report_of


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option(
    "--against",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Another of the same kind, to compare with.",
)
def report(folder: Path, against: Path | None) -> None:
    """Writes report.html, complete in itself, of a harvest, a campaign or a fault matrix."""
    click.echo(f"written: {report_of(folder, against)}")
