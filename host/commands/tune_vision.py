"""`daranti tune vision`: the paper's parameters, from photographs, a camera or a record."""

from __future__ import annotations

import datetime
import itertools
from pathlib import Path

import click
from rich.table import Table

from host.core.errors import UserError
from host.core.number_range import NumberRange, WholeRange
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import PlainConsole
from host.panel.colour_page import Tuner, colour_application
from host.panel.serving import serve_application
from host.runs.pictures import frames
from host.vision.figure import staged
from host.vision.mounted.paper import PaperParams
from host.vision.photo.split import SIDES, Side
from host.vision.pictures import Picture, write_picture
from host.vision.results import own_name, read_sides
from host.vision.tuning.profiles import DATABASE, Circumstance, Profiles
from host.vision.tuning.search import tune
from host.vision.tuning.subject import subject_of


def show_change(old: PaperParams, new: PaperParams, contrast: tuple[float, float]) -> Table:
    """Parameters and contrast before and after."""
    table = Table("parameter", "before", "after")
    for name in PaperParams.model_fields:
        before, after = getattr(old, name), getattr(new, name)
        table.add_row(name, f"{before:g}", f"{after:g}" if after != before else "")
    table.add_row("contrast reached", f"{contrast[0]:.3f}", f"{contrast[1]:.3f}")
    return table


@click.command()
@click.argument("source", nargs=-1, required=True, metavar="PHOTO|FOLDER|VIDEO|RECORD|URL...")
@click.option("--hour", type=NumberRange(0, 24, max_open=True), help="Default: now.")
@click.option("--terrain", default="flat", show_default=True)
@click.option("--crop", default="wheat", show_default=True)
@click.option("--weather", default="clear", show_default=True)
@click.option(
    "--mount",
    default="photo",
    show_default=True,
    help="A mount (low, mast) for the machine's own camera; photo: any picture.",
)
@click.option("--side", type=click.Choice(SIDES), help="Where the crop stands on photographs.")
@click.option("--manifest", type=click.Path(path_type=Path), help="The side of each photograph.")
@click.option("--pictures", type=WholeRange(1, 100), default=8, show_default=True)
@click.option("--db", type=click.Path(path_type=Path), default=DATABASE, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), default=Path("tune"), show_default=True)
@click.option("--save/--no-save", default=True, show_default=True)
@click.option(
    "--page", is_flag=True, help="Tune by hand instead: sliders on a page, in a browser here."
)
@click.option("--web-port", "port", type=WholeRange(0, 65535), default=8023, show_default=True,
              help="0: any.")  # fmt: skip
def tune_vision(
    source: tuple[str, ...],
    hour: float | None,
    terrain: str,
    crop: str,
    weather: str,
    mount: str,
    side: Side | None,
    manifest: Path | None,
    pictures: int,
    db: Path,
    out: Path,
    save: bool,
    page: bool,
    port: int,
) -> None:
    """Finds the paper's parameters on the first pictures, starting from the nearest profile; shows
    before and after, and saves the profile. With --page a person does it, on a page with
    sliders."""
    if not page:
        check_folder(out)
    sides = read_sides(manifest) if manifest else {}
    taken: list[tuple[str, Picture]] = []
    for item in source:
        taken += itertools.islice(frames(item), pictures - len(taken))
    now = _now()
    where = Circumstance(
        now.hour + now.minute / 60 if hour is None else hour, terrain, crop, weather, mount
    )
    subject = subject_of(mount, taken, lambda name: side or sides.get(name, "left"))
    with Profiles(db) as profiles:
        near = profiles.nearest(where)
    start = near.params if near else PaperParams()
    if page:
        _serve(Tuner(taken, subject.eye, subject.contrast, start, db, where, _now), port)
        return
    with Watch("search"):
        params, reached = tune(subject.contrast, start)
    if save:
        with Profiles(db) as profiles:
            profiles.save(where, params, reached, now)
    console = PlainConsole()
    console.print_table(show_change(start, params, (subject.contrast(start), reached)))
    out.mkdir(parents=True, exist_ok=True)
    written: set[str] = set()
    for name, bgr in taken:
        own = own_name(name, written)
        for when, used in (("before", start), ("after", params)):
            view = subject.eye(name, used).see(bgr, stages=True)
            write_picture(out / f"{own}.{when}.png", staged(bgr, view))
    saved = f"; saved in {db}" if save else ""
    console.print(f"{len(taken)} pictures before and after in {out}{saved}")


def _now() -> datetime.datetime:
    return datetime.datetime.now().astimezone()


def _serve(tuner: Tuner, port: int) -> None:
    """Until Ctrl-C."""
    if not tuner.pictures:
        raise UserError("no pictures to tune on; name photographs, a folder, a video or a record")
    serve_application(
        colour_application(tuner),
        "127.0.0.1",
        port,
        "--web-port",
        lambda url: PlainConsole().print(f"sliders at {url}; Ctrl-C ends"),
    )
