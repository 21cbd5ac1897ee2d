"""`daranti-hil vision`: the detectors on drives along edges of known place."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import click
from rich.table import Table

from hil.studies.spread import spread
from hil.studies.vision_drives import Drive, Mode, Outcome, run, summary
from host.core.errors import UserError
from host.core.number_range import NumberRange
from host.core.progress import Watch
from host.core.terminal import PlainConsole, echo


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
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=1, show_default=True)
@click.option("--workers", type=click.IntRange(1, 256), default=1, show_default=True)
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), default=Path("out/vision"),
              show_default=True)  # fmt: skip
def vision(
    km: float,
    mounts: tuple[str, ...],
    mode: Mode,
    length_m: float,
    dust: float | None,
    seed: int,
    workers: int,
    out: Path,
) -> None:
    """Measures the detectors on simulated drives along edges over hours, weather and mounts.

    Every drive's result is kept in --out: a run that was stopped goes on where it stopped, and more
    --km add to it. Writes summary.json."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"cannot write to {out}: {error.strerror}; choose another --out") from error
    names = mounts or ("low", "mast")
    count = max(1, round(1e3 * km / length_m / len(names)))
    make = partial(Drive, seed=seed, mode=mode, length_m=length_m, folder=str(out), dust=dust)
    drives = [make(number=n, mount=name) for n in range(count) for name in names]
    found: dict[str, list[Outcome]] = {name: [] for name in names}
    with Watch(f"{len(drives)} edges of {length_m:g} m", len(drives)) as watch:
        for drive, outcome in spread(run, drives, workers=workers):
            found[drive.mount].append(outcome)
            watch.step()
    figures = {name: summary(outcomes) for name, outcomes in found.items()}
    record = {"mode": mode, "seed": seed, "length_m": length_m, "dust": dust, "mounts": figures}
    (out / "summary.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    PlainConsole().print_table(show(figures))
    echo(f"written: {out / 'summary.json'}")
