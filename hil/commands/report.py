"""`daranti-hil report`: report.html of a folder of results."""

from __future__ import annotations

from pathlib import Path

import click

from hil.report.report import report_of
from host.core.progress import Watch
from host.core.terminal import echo


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option(
    "--against",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Another of the same kind, to compare with.",
)
def report(folder: Path, against: Path | None) -> None:
    """Writes report.html, complete in itself, of a harvest, a campaign or a fault matrix."""
    with Watch(f"report of {folder}"):
        written = report_of(folder, against)
    echo(f"written: {written}")
