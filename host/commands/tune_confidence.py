"""`daranti tune confidence`: learns from labelled photographs how far edges can be trusted."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from host.commands.bench_vision import photographs
from host.core.number_range import WholeRange
from host.core.output_place import check_file
from host.core.progress import Watch
from host.core.terminal import echo
from host.vision.photo import calibration
from host.vision.photo.confidence import REASONS, TOLERANCE, WEIGHTS


@click.command()
@click.option(
    "--data",
    type=click.Path(path_type=Path),
    help="Labelled photographs: manifest.csv, images/, masks/. Default: DARANTI_DATA or "
    "../shared/data, its wheat-edge.",
)
@click.option("--seed", type=WholeRange(min=0), default=0, show_default=True)
@click.option(
    "--out", type=click.Path(path_type=Path), default=WEIGHTS, help="Default: the package's own."
)
def tune_confidence(data: Path | None, seed: int, out: Path) -> None:
    """Weighs what speaks against an edge by how wrong edges were on labelled photographs and on
    disturbed pictures of them, and writes the weights.

    What is printed holds scenes out; what is written is learnt from all."""
    check_file(out)
    with Watch("photographs"):
        samples = calibration.gather(photographs(data), seed)
        sure = calibration.held_out(samples)
    right = samples.wrong <= TOLERANCE
    echo(
        f"{len(right)} pictures of {len(np.unique(samples.scenes))} scenes; "
        f"right: at most {100 * TOLERANCE:.1f} % of the picture on the wrong side"
    )
    for low in (0.0, 0.2, 0.4, 0.6, 0.8):
        inside = (sure >= low) & (sure < low + 0.2)
        if inside.any():
            said, true = sure[inside].mean(), right[inside].mean()
            echo(f"confidence {said:.2f}: {true:.2f} right, {inside.sum()} pictures")
    learnt = calibration.fit(samples, np.ones(len(right), np.bool_))
    for name, weight in zip(REASONS, learnt.weight, strict=True):
        echo(f"{name:12} {weight:+.2f}")
    calibration.write(out, learnt, f"daranti tune confidence --seed {seed}")
    echo(f"written: {out}")
