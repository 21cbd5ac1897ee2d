"""`daranti-hil report`: report.html of a folder of results."""

from __future__ import annotations

from pathlib import Path

import click

from hil.report.report import report_of
from host.core.progress import Watch
from host.core.terminal import echo


@click.command()
@click.argument("where", metavar="FOLDER|RECORD", type=click.Path(path_type=Path, exists=True))
@click.option(
    "--against",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Another of the same kind, to compare with.",
)
def report(where: Path, against: Path | None) -> None:
    """Writes report.html, complete in itself, of a harvest, a rig, a drive's record, a campaign or
    a fault matrix; of one that was broken off as much as there is."""
    with Watch(f"report of {where}"):
        written = report_of(where, against, lambda text: echo(f"warning: {text}", err=True))
    echo(f"written: {written}")
