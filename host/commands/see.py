"""`daranti see`: what the vision finds in photographs, folders, videos and streams."""

from __future__ import annotations

import time
from pathlib import Path

import click
import cv2

from host.core.errors import UserError
from host.runs.pictures import frames
from host.vision.figure import staged
from host.vision.photo.detector import photo_detector
from host.vision.photo.split import SIDES, Side
from host.vision.results import read_sides, write_result


@click.command()
@click.argument("source", nargs=-1, required=True, metavar="PHOTO|FOLDER|VIDEO|RECORD|URL...")
@click.option("--mode", type=click.Choice(["paper", "robust"]), default="robust", show_default=True)
@click.option("--side", type=click.Choice(SIDES), help="Where the crop stands; default left.")
@click.option(
    "--manifest",
    type=click.Path(path_type=Path),
    help="CSV with columns file, standing_side: the side of each photograph.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("see"), show_default=True, metavar="DIR"
)
@click.option(
    "--stages/--no-stages", default=None, help="Write the staged picture, NAME.stages.png."
)
def see(
    source: tuple[str, ...],
    mode: str,
    side: Side | None,
    manifest: Path | None,
    out: Path,
    stages: bool | None,
) -> None:
    """Runs the vision on photographs and writes mask, edge and the staged picture of each.

    A picture that cannot be used is named on stderr and the others are still done; the exit code is
    then 2."""
    sides = read_sides(manifest) if manifest else {}
    out.mkdir(parents=True, exist_ok=True)
    failed = 0
    for item in source:
        pictures = frames(item)
        while True:
            try:
                name, bgr = next(pictures)
            except StopIteration:
                break
            except UserError as error:
                click.echo(f"daranti see: {error}", err=True)
                failed += 1
                break
            where = side or sides.get(name, "left")
            detector = photo_detector(mode, where)
            wanted = stages is not False
            start = time.perf_counter()
            view = detector.see(bgr, stages=False)
            ms = 1e3 * (time.perf_counter() - start)
            write_result(out, name, bgr, view, ms)
            if wanted:
                full = detector.see(bgr, stages=True)
                cv2.imwrite(str(out / f"{name}.stages.png"), staged(bgr, full))
            text = f": {view.reason}" if view.reason else ""
            click.echo(f"{name}: confidence {view.confidence:.2f}, {ms:.1f} ms{text}")
    if failed:
        raise UserError(f"{failed} of the sources could not be used, see above")
