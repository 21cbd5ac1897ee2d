"""`daranti bench vision`: the detectors' scores on labelled photographs."""

from __future__ import annotations

import json
from pathlib import Path

import click
from rich.table import Table

from host.core.errors import UserError
from host.core.number_range import WholeRange
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import PlainConsole
from host.core.whole_file import save_text
from host.vision.photo import benchmark
from host.vision.photo.comparison import Comparison, compare, data_folder, overlay
from host.vision.photo.score import labelled_set
from host.vision.pictures import write_picture


def photographs(data: Path | None) -> list[benchmark.Photo]:
    """Of a labelled folder; None: the development data's. UserError where there are not two scenes
    of them: each is judged by what the others have taught."""
    folder = data or data_folder() / "wheat-edge"
    if not (folder / "manifest.csv").exists() and (folder / "wheat-edge").is_dir():
        folder = folder / "wheat-edge"
    items = labelled_set(folder)
    scenes = {item.scene for item in items}
    if len(scenes) < 2:
        raise UserError(
            f"{folder}/manifest.csv: {len(items)} photographs of {len(scenes)} scenes that are not "
            "doubtful; label photographs of two or more scenes"
        )
    return [benchmark.Photo(item, item.picture(), item.standing()) for item in items]


def _sure_table(found: Comparison) -> Table:
    table = Table("sure from", title="How often sure, and sure and wrong, scene-wise held out")
    for name in ("photographs: sure", "and wrong", "disturbed: sure", "and wrong"):
        table.add_column(name, justify="right")
    for row in found.curve:
        least, *shares = row.values()
        table.add_row(f"{least:.1f}", *(f"{100 * share:.1f} %" for share in shares))
    return table


def _disturbed_table(found: Comparison) -> Table:
    table = Table("picture", title="Robust mode, disturbed")
    for name in ("mIoU", "lateral %", "within 5 %", "sure", "sure and wrong"):
        table.add_column(name, justify="right")
    for name, f in found.disturbed.items():
        table.add_row(
            name,
            f"{f['miou_mean']:.3f}",
            f"{100 * f['lateral_median']:.2f}",
            *(f"{100 * f[k]:.1f} %" for k in ("within_5pct", "confident", "confident_wrong")),
        )
    return table


@click.command()
@click.option(
    "--data",
    type=click.Path(path_type=Path),
    help="Labelled photographs: manifest.csv, images/, masks/. Default: DARANTI_DATA or "
    "../shared/data, its wheat-edge.",
)
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("out/bench-vision"), show_default=True
)
@click.option("--worst", type=WholeRange(0, 50), default=8, show_default=True, metavar="N")
def bench_vision(data: Path | None, out: Path, worst: int) -> None:
    """Scores both modes and two baselines on labelled photographs; writes summary.json, the folds
    and overlays of the worst pictures."""
    check_folder(out)
    photos = photographs(data)
    out.mkdir(parents=True, exist_ok=True)
    with Watch(f"{len(photos)} photographs"):
        found = compare(photos)
    table = Table(
        "mode",
        "mIoU",
        "lateral %",
        "within 5 %",
        "heading 5°",
        "sure and wrong",
        "sure",
        "ms",
        title=f"{len(photos)} photographs, {len(found.folds)} scenes",
    )
    for name, f in found.figures.items():
        table.add_row(
            name,
            f"{f['miou_mean']:.3f}",
            f"{100 * f['lateral_median']:.2f}",
            *(f"{100 * f[k]:.1f} %" for k in ("within_5pct", "heading_within_5deg")),
            *(f"{100 * f[k]:.1f} %" for k in ("confident_wrong", "confident")),
            f"{f['ms_median']:.1f}",
        )
    console = PlainConsole()
    console.print_table(table)
    times = Table("stage, 640x480, one thread", "ms")
    for name, ms in found.stages_ms.items():
        times.add_row(name, f"{ms:.2f}")
    console.print_table(times)
    console.print_table(_sure_table(found))
    console.print_table(_disturbed_table(found))
    record = {
        "curve": found.curve,
        "reliability": found.reliability,
        "disturbed": found.disturbed,
        **found.figures,
        "stages_ms": found.stages_ms,
        "folds": found.folds,
    }
    save_text(out / "summary.json", json.dumps(record, indent=1) + "\n")
    by_error = sorted(zip(photos, found.robust, strict=True), key=lambda pair: pair[1].miou)
    for rank, (photo, result) in enumerate(by_error[:worst], start=1):
        name = f"worst-{rank:02d}-{photo.item.name}-{result.miou:.2f}.png"
        write_picture(out / name, overlay(photo, result))
    console.print(f"{out}/summary.json, {min(worst, len(photos))} overlays of the worst")
