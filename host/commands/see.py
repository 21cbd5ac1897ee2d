"""`daranti see`: what the vision finds in photographs, folders, videos and streams."""

from __future__ import annotations

import time
from pathlib import Path

import click
from pydantic import ValidationError

from host.commands.options import mode_option
from host.core.errors import UnfinishedError, UserError
from host.core.output_place import check_folder
from host.core.terminal import echo
from host.core.vehicle import Vehicle
from host.runs import record
from host.runs.pictures import frames, is_record
from host.vision.figure import staged
from host.vision.mounted.detector import Mode, MountedDetector, make_detector
from host.vision.mounted.paper import PaperParams
from host.vision.photo.detector import photo_detector
from host.vision.photo.split import SIDES, Side
from host.vision.pictures import write_picture
from host.vision.results import own_name, read_sides, write_result


def _driver(path: Path) -> MountedDetector:
    """The detector that a drive went by, from what its record says. UserError where it does not."""
    about = record.about(path)
    try:
        vehicle = Vehicle.model_validate_json(about["vehicle"])
        mount = vehicle.mounts[about["mount"]]
        mode: Mode = "paper" if about["mode"] == "paper" else "robust"
        paper = PaperParams.model_validate_json(about["paper"]) if "paper" in about else None
    except (KeyError, ValidationError) as error:
        raise UserError(
            f"{path}: the record does not say which vehicle and mount took its pictures; "
            "record the drive again with this version"
        ) from error
    return make_detector(mode, vehicle, mount, params=paper)


@click.command()
@click.argument("source", nargs=-1, required=True, metavar="PHOTO|FOLDER|VIDEO|RECORD|URL...")
@mode_option
@click.option(
    "--side",
    type=click.Choice(SIDES),
    help="Where the crop stands in photographs; a record of a drive knows it.",
)
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

    Photographs need --side or --manifest: colour and texture say where the edge is, not which of
    the two halves stands. The pictures of a record of a drive are shown to the detector that
    drives, with the record's own vehicle, mount and mode.

    A picture that cannot be used is named on stderr and the others are still done; the exit code is
    then 3."""
    sides = read_sides(manifest) if manifest else {}
    check_folder(out)
    failed = 0
    taken: set[str] = set()
    for item in source:
        pictures = frames(item)
        drove = _driver(Path(item)) if is_record(item) else None
        while True:
            try:
                name, bgr = next(pictures)
            except StopIteration:
                break
            except UserError as error:
                echo(f"daranti see: {error}", err=True)
                failed += 1
                break
            where = side or sides.get(name)
            if drove is None and where is None:
                raise UserError(
                    f"{name}: on which side does the crop stand? Say --side left, right, top or "
                    "bottom, or name a --manifest that does"
                )
            name = own_name(name, taken)
            detector = drove or photo_detector(mode, where or "left")
            wanted = stages is not False
            start = time.perf_counter()
            view = detector.see(bgr, stages=drove is not None and wanted)
            ms = 1e3 * (time.perf_counter() - start)
            out.mkdir(parents=True, exist_ok=True)
            write_result(out, name, bgr, view, ms)
            if wanted:
                # one that follows an edge from picture to picture must see each once
                full = view if drove else detector.see(bgr, stages=True)
                write_picture(out / f"{name}.stages.png", staged(bgr, full))
            text = f": {view.reason}" if view.reason else ""
            echo(f"{name}: confidence {view.confidence:.2f}, {ms:.1f} ms{text}")
    if failed:
        raise UnfinishedError(f"{failed} of the sources could not be used, see above")
