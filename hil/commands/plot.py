"""`daranti-hil plot`: a record drawn."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from hil.judge.plots import draw_path, draw_time, series
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import echo
from host.core.whole_file import saved
from host.link import protocol


@click.command()
@click.argument("path", metavar="RECORD", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder; default beside the record.")
def plot(path: Path, out: Path | None) -> None:
    """Draws a record: over time, and where the machine went."""
    folder = out or path.parent
    check_folder(folder)
    with Watch(f"plot of {path}"):
        data = series(path)
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in (("time", draw_time(data)), ("path", draw_path(data))):
            target = folder / f"{path.stem}-{name}.png"
            with saved(target) as fresh:
                figure.savefig(fresh, dpi=110)
            echo(f"written: {target}")
    if data.cut:
        echo(f"warning: {data.cut}", err=True)
    for stamp, phase, reason in data.phases:
        echo(f"{stamp:8.1f} s  {phase}: {reason}")
    word = protocol.Fault(int(np.bitwise_or.reduce(data.telemetry[:, 6].astype(np.int64))))
    for text in protocol.fault_texts(word):
        echo(f"fault reported: {text}")
