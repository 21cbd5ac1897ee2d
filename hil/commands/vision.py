"""`daranti-hil vision`: the detectors on drives along edges of known place."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from functools import partial
from pathlib import Path

import click
from rich.table import Table

from hil.studies.beside_views import KINDS, Judged, judged
from hil.studies.camera_troubles import DISTURBED, FORMATS, NONE, TROUBLES
from hil.studies.spread import spread
from hil.studies.vision_curves import draw_curves
from hil.studies.vision_drives import (
    SURE_FROM,
    Drive,
    Mode,
    Outcome,
    Said,
    curve,
    run,
    said_of,
    summary,
)
from hil.studies.vision_photographs import MOUNTS, WRONG, as_mounted, as_photographs
from host.core.errors import UserError
from host.core.number_range import NumberRange, WholeRange
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import PlainConsole, echo
from host.core.whole_file import save_text
from host.vision.photo.score import labelled_set

Curves = dict[str, list[dict[str, float]]]
EACH = {"each": tuple(DISTURBED), "formats": tuple(FORMATS)}
"""Short for several troubles."""


def _figure(value: float | int | None, factor: float = 1.0, digits: int = 1) -> str:
    return "-" if value is None else f"{factor * value:.{digits}f}"


def show(figures: dict[str, dict[str, float | int | None]]) -> Table:
    """One row a mount."""
    table = Table("", "km", "sure %", "offset rmse / bias cm", "wrong %", "lane offset cm",
                  "lane heading °", "end median / worst m", "ends", "missed", "false")  # fmt: skip
    for name, f in figures.items():
        table.add_row(
            name,
            _figure(f["km"], digits=2),
            _figure(f["availability"], 100),
            f"{_figure(f['offset_rmse_m'], 100)} / {_figure(f['offset_bias_m'], 100)}",
            _figure(f["confident_wrong"], 100),
            _figure(f["lane_offset_rmse_m"], 100),
            _figure(f["lane_heading_rmse_deg"], digits=2),
            f"{_figure(f['end_of_field_error_median_m'], digits=2)} / "
            f"{_figure(f['end_of_field_error_worst_m'], digits=2)}",
            str(f["ends"]),
            str(f["missed_ends"]),
            str(f["false_ends"]),
        )
    return table


def show_curves(named: Curves) -> Table:
    """How often sure, and sure and wrong, of all pictures; one row a kind of picture."""
    table = Table("sure from", *(f"{least:g}" for least in SURE_FROM))
    for name, rows in named.items():
        shares = (f"{100 * r['sure']:.0f} / {100 * r['sure_and_wrong']:.1f}" for r in rows)
        table.add_row(name, *shares)
    return table


def _show_beside(seed: int, count: int, mounts: tuple[str, ...], out: Path) -> None:
    """Prints and writes what the detector makes of standing views."""
    table = Table("views", "asked", "edge said", "RMS cm", "sure", "crop on the right")
    found: dict[str, Judged] = {}
    with Watch(f"{count} views of {len(KINDS)} kinds", len(mounts) * len(KINDS)) as watch:
        for mount in mounts:
            for kind in KINDS:
                one = found[f"{mount}, {kind}"] = judged(seed, count, mount, kind)
                rms = "-" if math.isnan(one.rms_m) else _figure(one.rms_m, 100)
                counts = str(one.sure), str(one.crop_right)
                table.add_row(f"{mount}, {kind}", str(one.views), str(one.seen), rms, *counts)
                watch.step()
    record = {
        name: asdict(one) | {"rms_m": one.rms_m if one.seen else None}
        for name, one in found.items()
    }
    path = out / "beside.json"
    save_text(path, json.dumps(record, indent=1) + "\n")
    PlainConsole().print_table(table)
    echo(f"written: {path}")


def chosen(named: tuple[str, ...]) -> tuple[str, ...]:
    """The troubles that a command line names, each once, without any first. UserError."""
    out = [NONE]
    for name in named:
        if name not in EACH and name not in TROUBLES:
            known = ", ".join((*EACH, *TROUBLES))
            raise UserError(f"--trouble {name}: no such trouble; the camera may have {known}")
        out.extend(EACH.get(name, (name,)))
    return tuple(dict.fromkeys(out))


def photographed(folder: Path, mode: Mode) -> dict[str, list[Said]]:
    """What the detector of `mode` says of labelled photographs."""
    items = labelled_set(folder / "wheat-edge")
    if mode == "photo":
        return {"photographs": [said for _, said in as_photographs(items)]}
    return {
        f"photographs, as from {guess}": [said for _, said, _ in as_mounted(items, guess, mode)]
        for guess in MOUNTS
    }


@click.command()
@click.option("--km", type=NumberRange(0.01, 100), default=0.2, show_default=True,
              help="Of edges, over all mounts.")  # fmt: skip
@click.option("--mount", "mounts", multiple=True, type=click.Choice(["low", "mast"]),
              help="Only this one; default both.")  # fmt: skip
@click.option("--mode", type=click.Choice(["robust", "paper", "photo"]), default="robust",
              show_default=True,
              help="photo: the photographs' detector, which never drives.")  # fmt: skip
@click.option("--length", "length_m", type=NumberRange(5, 200), default=20.0,
              show_default=True, help="Of one edge, m.")  # fmt: skip
@click.option("--dust", type=NumberRange(0, 1),
              help="Instead of a random one between 0 and 0.6.")  # fmt: skip
@click.option("--trouble", "troubles", multiple=True, metavar="NAME",
              help=f"Of the camera, besides none: {', '.join((*EACH, *TROUBLES))}.")  # fmt: skip
@click.option("--own", is_flag=True,
              help="Each edge with lengths, mount and lens of its own, as random fields have them; "
                   "else those of the drawing.")  # fmt: skip
@click.option("--photographs", type=click.Path(path_type=Path, file_okay=False, exists=True),
              help="Folder of labelled data (wheat-edge/), to be judged besides.")  # fmt: skip
@click.option("--beside", type=WholeRange(1, 10_000), metavar="N",
              help="Instead of drives: N standing views of each kind from each mount, of crop "
                   "beside the way, on either side, of what an earlier strip has left, and of a "
                   "narrow gap.")  # fmt: skip
@click.option("--seed", type=WholeRange(0, 2**31 - 1), default=1, show_default=True)
@click.option("--workers", type=WholeRange(1, 256), default=1, show_default=True)
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), default=Path("out/vision"),
              show_default=True)  # fmt: skip
def vision(
    km: float,
    mounts: tuple[str, ...],
    mode: Mode,
    length_m: float,
    dust: float | None,
    troubles: tuple[str, ...],
    own: bool,
    photographs: Path | None,
    beside: int | None,
    seed: int,
    workers: int,
    out: Path,
) -> None:
    """Measures the detectors on simulated drives along edges over hours, weather and mounts, with a
    sound camera and with what is wrong with real ones.

    How often a detector is sure, and sure and wrong (by 0.1 m, on photographs by a tenth of the
    width), is printed by the confidence from which one calls it sure, as % of all pictures, and
    drawn in curves.png. --km is each trouble's.

    Every drive's result is kept in --out: a run that was stopped goes on where it stopped, and more
    --km add to it. Writes summary.json."""
    check_folder(out)
    out.mkdir(parents=True, exist_ok=True)
    names = mounts or ("low", "mast")
    if beside is not None:
        _show_beside(seed, beside, names, out)
        return
    count = max(1, round(1e3 * km / length_m / len(names)))
    make = partial(
        Drive, seed=seed, mode=mode, length_m=length_m, folder=str(out), dust=dust, own_machine=own
    )
    drives = [
        make(number=n, mount=name, trouble=trouble)
        for trouble in chosen(troubles)
        for n in range(count)
        for name in names
    ]
    found: dict[str, list[Outcome]] = {}
    with Watch(f"{len(drives)} edges of {length_m:g} m", len(drives)) as watch:
        for drive, outcome in spread(run, drives, workers=workers):
            title = drive.mount if drive.trouble == NONE else f"{drive.mount}, {drive.trouble}"
            found.setdefault(title, []).append(outcome)
            watch.step()
    found = {title: found[title] for title in sorted(found)}
    figures = {title: summary(outcomes) for title, outcomes in found.items()}
    shown = {title: curve(said_of(some)) for title, some in found.items()}
    if photographs is not None:
        for title, said in photographed(photographs, mode).items():
            shown[title] = curve(said, WRONG)
    record = {"mode": mode, "seed": seed, "length_m": length_m, "dust": dust, "own": own,
              "mounts": figures, "curves": shown}  # fmt: skip
    save_text(out / "summary.json", json.dumps(record, indent=1) + "\n")
    draw_curves(shown, out / "curves.png")
    PlainConsole().print_table(show(figures))
    PlainConsole().print_table(show_curves(shown))
    echo(f"written: {out / 'summary.json'}, {out / 'curves.png'}")
