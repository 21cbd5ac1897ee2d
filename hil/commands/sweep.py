"""`daranti-hil sweep`: firmware parameters over a population of actuators."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from hil.firmware.provision import check_built
from hil.report import sweep_page
from hil.studies.sweep import (
    DEFAULT_SPACE,
    Map,
    Sweep,
    candidates_of,
    dask,
    load_space,
    serial,
    spot_check,
    summary_of,
)
from host.core.number_range import WholeRange
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import echo
from host.core.whole_file import save_text, saved


@click.command()
@click.option("--space", "space_file", type=click.Path(path_type=Path), help="YAML; see docs.")
@click.option("--method", type=click.Choice(["grid", "random", "optuna"]), default="optuna")
@click.option("--trials", type=WholeRange(1, 1_000_000), default=200, show_default=True)
@click.option("--plants", "plant_count", type=WholeRange(1, 100_000), default=25, show_default=True)
@click.option("--seed", type=WholeRange(0, 2**31 - 1), default=0, show_default=True)
@click.option("--firmware", type=click.Choice(["desk", "avr"]), default="desk", show_default=True)
@click.option("--workers", type=WholeRange(0, 256), default=2, show_default=True,
              help="Local processes; 0 works in this one.")  # fmt: skip
@click.option("--scheduler", metavar="ADDRESS", help="A Dask scheduler, e.g. tcp://10.0.0.5:8786.")
@click.option("--spot-check", "check", type=WholeRange(0), default=0, show_default=True,
              help="Repeat so many responses on the Uno's binary in simavr.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/sweep"))
def sweep(
    space_file: Path | None,
    workers: int,
    scheduler: str | None,
    check: int,
    out: Path,
    **options: Any,
) -> None:
    """Tries firmware parameters on a population of steering actuators.

    Writes responses.parquet, candidates.parquet, summary.json, pictures and report.html."""

    chosen = Sweep(DEFAULT_SPACE if space_file is None else load_space(space_file), **options)
    check_folder(out)
    check_built(chosen.firmware, "avr" if check else "desk")
    out.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    with _spread(workers, scheduler) as spread:
        ready_s = time.monotonic() - began
        with Watch("step responses", chosen.responses()) as watch:
            table = chosen.run(spread, watch.reach)
        wall_s = time.monotonic() - began - ready_s
        summary: dict[str, Any] = summary_of(chosen, table)
        summary["wall_s"] = round(wall_s, 2)
        if check:
            with Watch("spot check"):
                summary["spot_check"] = spot_check(chosen, table, check, spread)
    names = [*chosen.space.parameters, *chosen.space.fixed]
    ranked = candidates_of(table, names)
    with saved(out / "responses.parquet") as fresh:
        table.to_parquet(fresh, index=False)
    with saved(out / "candidates.parquet") as fresh:
        ranked.to_parquet(fresh)
    save_text(out / "summary.json", json.dumps(summary, indent=1))
    sweep_page.write(out, chosen.space, table, ranked, summary)
    echo(f"{len(table)} step responses in {wall_s:.1f} s on {_where(workers, scheduler)}")
    echo(f"chosen: {_words(summary['chosen'])}")
    echo(
        f"meets the figures in {summary['chosen_meets']:.1%} of its responses; "
        f"table sha256 {summary['table_sha256'][:16]}"
    )
    for key, value in summary.get("spot_check", {}).items():
        echo(f"spot check on the Uno's binary: {key} {value}")
    echo(f"written to {out}: report.html, summary.json, responses.parquet")


@contextmanager
def _spread(workers: int, scheduler: str | None) -> Iterator[Map]:
    if workers == 0 and scheduler is None:
        yield serial
    else:
        with dask(workers, scheduler) as spread:
            yield spread


def _where(workers: int, scheduler: str | None) -> str:
    return scheduler or (f"{workers} worker processes" if workers else "this process")


def _words(gains: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in gains.items())
