"""`daranti-hil constants`: counts them, and says what each changes."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import click
from rich.table import Table

from hil.firmware.provision import check_built
from hil.scenario.scenario import load
from hil.studies.constants import ROOT, SHARE, Figures, driven, found, varied
from host.core.errors import UserError
from host.core.number_range import WholeRange
from host.core.progress import Watch
from host.core.terminal import PlainConsole


@click.command()
@click.option("--tree", type=click.Path(path_type=Path, exists=True, file_okay=False),
              default=ROOT, help="Count in another checkout.")  # fmt: skip
@click.option("--vary", metavar="TEXT", help="Vary those whose path or name has it; `all`: all.")
@click.option("--scenario", default="small", show_default=True, metavar="NAME|FILE")
@click.option("--seed", type=WholeRange(0), default=1, show_default=True)
def constants(tree: Path, vary: str | None, scenario: str, seed: int) -> None:
    """Counts the numbers in capitals on the way from picture to steering. With --vary, drives a
    scenario with model eyes with each of them 30 % smaller and larger."""
    console = PlainConsole()
    every = found(tree)
    if vary is None:
        table = Table("room", "constants", "without a text")
        rooms = Counter("/".join(c.path.split("/")[:2]) for c in every)
        bare = Counter("/".join(c.path.split("/")[:2]) for c in every if not c.about)
        for room, count in rooms.items():
            table.add_row(room, str(count), str(bare[room]))
        table.add_row("all", str(len(every)), str(sum(bare.values())))
        console.print_table(table)
        return
    chosen = [one for one in every if vary == "all" or vary in f"{one.path}:{one.name}"]
    if not chosen:
        raise UserError(f"--vary {vary}: no constant has that in its path or name")
    usual_one = load(scenario, {"seed": seed, "eyes": "model"})
    check_built(usual_one.firmware)
    usual = driven(usual_one)
    table = Table("constant", "share", "outcome", "coverage", "lateral m", "time s", "")
    table.add_row("as they are", "", *_cells(usual), "")
    with Watch("constants", len(chosen)) as watch:
        for one in chosen:
            for factor in (1 - SHARE, 1 + SHARE):
                with varied(one, factor):
                    got = driven(usual_one)
                mark = "knife's edge" if got.knife(usual) else ""
                table.add_row(f"{one.path}:{one.name}", f"{factor:.1f}", *_cells(got), mark)
            watch.step(one.name)
    console.print_table(table)


def _cells(figures: Figures) -> tuple[str, ...]:
    return (
        figures.outcome + (", harm" if figures.harm else ""),
        f"{figures.coverage:.4f}",
        f"{figures.lateral_rms_m:.3f}",
        f"{figures.time_s:.0f}",
    )
