"""`daranti see`: what the vision finds in photographs, folders, videos and streams."""

from __future__ import annotations

import csv
import json
import math
import os
import time
from pathlib import Path

import click
import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from host.core.errors import UserError
from host.vision.figure import staged
from host.vision.mounted.paper import PaperPhoto
from host.vision.photo import benchmark
from host.vision.photo.detector import RobustPhoto, photo_detector
from host.vision.photo.score import labelled_set
from host.vision.photo.split import SIDES, Side
from host.vision.pictures import Picture, frames
from host.vision.view import CropView


def read_sides(manifest: Path) -> dict[str, Side]:
    """Standing side by file name without suffix, from a CSV with columns file, standing_side."""
    try:
        with manifest.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{manifest}: cannot be read ({error}); give a CSV file") from error
    sides: dict[str, Side] = {}
    for number, row in enumerate(rows, start=2):
        if not row.get("file") or row.get("standing_side") not in SIDES:
            raise UserError(
                f"{manifest}: line {number} needs the columns file and standing_side "
                f"({', '.join(SIDES)})"
            )
        sides[Path(row["file"]).stem] = row["standing_side"]  # type: ignore[assignment]
    return sides


def heading_deg(edge: NDArray[np.float32] | None) -> float:
    """Direction of an edge in the picture, degrees in (-90, 90] from upright, positive where its
    upper end leans to the right; NaN below two points."""
    if edge is None or len(edge) < 2:
        return math.nan
    centred = edge - edge.mean(0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    du, dv = axes[0]
    return float((math.degrees(math.atan2(du, -dv)) + 90.0) % 180.0 - 90.0)


def write_result(folder: Path, name: str, bgr: Picture, view: CropView, ms: float) -> None:
    """NAME.mask.png (255 = cut, 0 = standing) and NAME.json."""
    h, w = bgr.shape[:2]
    standing = view.standing if view.standing is not None else np.zeros((h, w), np.bool_)
    cv2.imwrite(str(folder / f"{name}.mask.png"), np.where(standing, 0, 255).astype(np.uint8))
    edge = view.edge_px if view.edge_px is not None else np.zeros((0, 2), np.float32)
    heading = heading_deg(edge)
    record = {
        "edge_px": [[round(float(u), 2), round(float(v), 2)] for u, v in edge],
        "heading_deg": round(heading, 3) if math.isfinite(heading) else None,
        "confidence": round(view.confidence, 4),
        "reason": view.reason,
        "ms": round(ms, 3),
    }
    (folder / f"{name}.json").write_text(json.dumps(record) + "\n", encoding="utf-8")


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


def data_folder() -> Path:
    """`DARANTI_DATA`, or shared/data beside the checkout."""
    named = os.environ.get("DARANTI_DATA")
    return Path(named) if named else Path(__file__).resolve().parents[3] / "shared" / "data"


def overlay(photo: benchmark.Photo, result: benchmark.Result) -> Picture:
    """The label's edge in blue, the found one in red."""
    out = photo.bgr.copy()
    for mask, colour in ((photo.standing, (235, 120, 30)), (result.standing, (40, 40, 235))):
        shapes, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(out, shapes, -1, colour, max(1, out.shape[1] // 250))
    scale = 360 / out.shape[0]
    return np.asarray(cv2.resize(out, None, fx=scale, fy=scale), np.uint8)


@click.command()
@click.option(
    "--data",
    type=click.Path(path_type=Path),
    help="Labelled photographs: manifest.csv, images/, masks/. Default: DARANTI_DATA or "
    "../shared/data, its wheat-edge.",
)
@click.option("--out", type=click.Path(path_type=Path), default=Path("bench"), show_default=True)
@click.option("--worst", type=click.IntRange(0, 50), default=8, show_default=True, metavar="N")
def bench_vision(data: Path | None, out: Path, worst: int) -> None:
    """Scores both modes and two baselines on labelled photographs; writes summary.json, the folds
    and overlays of the worst pictures."""
    folder = data or data_folder() / "wheat-edge"
    if not (folder / "manifest.csv").exists() and (folder / "wheat-edge").is_dir():
        folder = folder / "wheat-edge"
    photos = [
        benchmark.Photo(item, item.picture(), item.standing()) for item in labelled_set(folder)
    ]
    out.mkdir(parents=True, exist_ok=True)
    robust, folds = benchmark.cross_validated(photos)

    def robust_see(p: benchmark.Photo) -> CropView:
        return RobustPhoto(p.item.side).see(p.bgr)

    def paper_see(p: benchmark.Photo) -> CropView:
        return PaperPhoto(p.item.side).see(p.bgr)

    def fixed(see: benchmark.See) -> list[benchmark.Result]:
        return [benchmark.judge(p, see(p)) for p in photos]

    paper_ms = benchmark.median_ms(photos, paper_see)
    modes = {
        "robust": (robust, benchmark.median_ms(photos, robust_see)),
        "paper": (fixed(paper_see), paper_ms),
        "paper_tuned_per_scene": (benchmark.tuned_per_scene(photos), paper_ms),
        "lab_and_texture": (
            fixed(benchmark.lab_and_texture),
            benchmark.median_ms(photos, benchmark.lab_and_texture),
        ),
        "hough": (fixed(benchmark.hough), benchmark.median_ms(photos, benchmark.hough)),
    }
    figures = {name: benchmark.summary(results, ms) for name, (results, ms) in modes.items()}
    table = Table(
        "mode",
        "mIoU",
        "lateral %",
        "within 5 %",
        "heading 5°",
        "sure and wrong",
        "sure",
        "ms",
        title=f"{len(photos)} photographs, {len(folds)} scenes",
    )
    for name, f in figures.items():
        table.add_row(
            name,
            f"{f['miou_mean']:.3f}",
            f"{100 * f['lateral_median']:.2f}",
            *(f"{100 * f[k]:.1f} %" for k in ("within_5pct", "heading_within_5deg")),
            *(f"{100 * f[k]:.1f} %" for k in ("confident_wrong", "confident")),
            f"{f['ms_median']:.1f}",
        )
    console = Console()
    console.print(table)
    stages = benchmark.stage_times(photos)
    times = Table("stage, 640x480, one thread", "ms")
    for name, ms in stages.items():
        times.add_row(name, f"{ms:.2f}")
    console.print(times)
    record = {**figures, "stages_ms": stages, "folds": folds}
    (out / "summary.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    by_error = sorted(zip(photos, robust, strict=True), key=lambda pair: pair[1].miou)
    for rank, (photo, result) in enumerate(by_error[:worst], start=1):
        name = f"worst-{rank:02d}-{photo.item.name}-{result.miou:.2f}.png"
        cv2.imwrite(str(out / name), overlay(photo, result))
    console.print(f"{out}/summary.json, {min(worst, len(photos))} overlays of the worst")
