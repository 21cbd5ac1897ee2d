"""`daranti-hil world`: contact sheets and videos of the simulated world."""

from __future__ import annotations

from pathlib import Path

import click
import cv2

from hil.studies import realism
from hil.studies.contact_sheets import SHEETS, _write_video, drive, sheet
from host.core.errors import UserError
from host.core.number_range import NumberRange, WholeRange
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import echo
from host.core.whole_file import saved
from sim_plant.camera import LOW, MAST


@click.command()
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("out/world"),
    show_default=True,
    help="Folder for the pictures.",
)
@click.option("--seed", type=WholeRange(0, 2**31 - 1), default=1, show_default=True)
@click.option(
    "--sheet", "names", multiple=True, type=click.Choice(sorted(SHEETS)), help="Only these."
)
@click.option("--drive", "seconds", type=NumberRange(0, 600), default=15.0, show_default=True,
              help="Length of drive-*.mp4 in s; 0 writes none.")  # fmt: skip
@click.option(
    "--compare", is_flag=True, help="Compare with the photographs of DARANTI_DATA instead."
)
def world(out: Path, seed: int, names: tuple[str, ...], seconds: float, compare: bool) -> None:
    """Shows the simulated world: contact sheets and a drive, or figures against photographs."""
    if compare:
        with Watch("comparison"):
            realism.report(seed)
        return
    mounts = {"low": LOW, "mast": MAST}
    check_folder(out)
    out.mkdir(parents=True, exist_ok=True)
    for name in names or sorted(SHEETS):
        path = out / f"{name}.jpg"
        drawn = sheet(name, seed, mounts)
        with saved(path) as fresh:
            if not cv2.imwrite(str(fresh), drawn, [cv2.IMWRITE_JPEG_QUALITY, 82]):
                raise UserError(f"cannot write {path}; choose another --out")
        echo(path)
    if seconds > 0 and not names:
        for mount_name, mount in mounts.items():
            path = out / f"drive-{mount_name}.mp4"
            _write_video(path, drive(seed, mount, seconds, 10.0), 10.0)
            echo(path)
