"""`daranti survey`: the field's boundary from a walk around it with the phone's positions."""

from __future__ import annotations

from pathlib import Path

import click

from host.core.errors import UserError
from host.core.input_file import check_input, is_piped
from host.core.number_range import NumberRange, WholeRange
from host.core.progress import Watch
from host.core.terminal import echo
from host.field.boundary_file import check_target, save_field
from host.field.corners import MAX_CORNERS
from host.field.survey import (
    CLOSE_M,
    draw_survey,
    read_walk,
    record_walk,
    report,
    survey_track,
    with_keep_out,
    with_marks,
)


def _corners(_: click.Context, __: click.Parameter, value: str) -> int | None:
    if value == "auto":
        return None
    if not value.isdecimal() or not 3 <= int(value) <= 2 * MAX_CORNERS:
        raise click.BadParameter(f"give auto or a number from 3 to {2 * MAX_CORNERS}")
    return int(value)


@click.command()
@click.argument("source")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    help="FIELD.geojson; .kml, .shp, .xml (ISOXML), .csv also.",
)
@click.option("--name", default="", help="The field's name; default the file's.")
@click.option("--corners", default="auto", callback=_corners, show_default=True, metavar="N|auto")
@click.option("--irregular", is_flag=True, help="Keep all of the edge instead of corners.")
@click.option("--lap", type=WholeRange(1), help="Take one lap only instead of the average.")
@click.option(
    "--keep-out",
    "keep_outs",
    multiple=True,
    type=click.Path(path_type=Path),
    help="A recorded walk around a tree, a well, a pole; may be repeated.",
)
@click.option(
    "--close",
    type=NumberRange(0.5, 50),
    default=CLOSE_M,
    show_default=True,
    help="Metres between the ends of a loop.",
)
def survey(
    source: str,
    out: Path,
    name: str,
    corners: int | None,
    irregular: bool,
    lap: int | None,
    keep_outs: tuple[Path, ...],
    close: float,
) -> None:
    """The field's boundary from a walk around it.

    SOURCE is a recorded NMEA file or a GPX track, or tcp://HOST:PORT, udp://:PORT or a serial port:
    then it records beside OUT until Ctrl-C first. Writes OUT and a picture of what was
    understood."""
    if irregular and corners is not None:
        raise UserError("--corners and --irregular exclude each other; give one of them")
    check_target(out)
    path = Path(source)
    if not path.is_char_device():  # a receiver is one
        check_input(path, "the walk")
    if not path.is_file() and not is_piped(path):
        path = out.with_suffix(".nmea")
        record_walk(source, path, echo)
    with Watch(f"survey of {path}") as watch:

        def tell(text: str) -> None:
            watch.reach(0, text)

        track, receiver = read_walk(path, tell)
        try:
            found = survey_track(
                track, corners=corners, irregular=irregular, lap=lap, close_m=close, tell=tell
            )
        except UserError as error:
            raise UserError(f"{path}: {error}") from error
        for keep_out in keep_outs:
            tell(f"keep-out {keep_out}")
            found = with_keep_out(found, read_walk(keep_out)[0], str(keep_out), close)
        name = name or out.stem
        boundary = with_marks(found.boundary(name), (path, *keep_outs))
        save_field(out, boundary)
        lines = report(found, receiver)
        picture = out.with_suffix(".png")
        about = lines[-1 - len(found.warnings)].removeprefix("boundary: ")
        tell("drawing")
        draw_survey(picture, found, f"{name}: {about}")
    if boundary.not_kept_out:
        lines.append(f"warning: {boundary.not_kept_out}")
    for text in (*lines, f"written: {out}, {picture}"):
        echo(text)
