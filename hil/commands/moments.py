"""`daranti-hil moments`: one fault at many moments of harvests."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import click
import numpy as np
from rich.table import Table

from hil.commands.seeds import SEEDS
from hil.firmware.provision import check_built
from hil.scenario import scenario
from hil.scenario.faults import PAIRS
from hil.studies.moments import Moment, moments
from host.core.errors import UserError
from host.core.number_range import NumberRange, WholeRange
from host.core.output_place import check_file, check_folder
from host.core.progress import Watch
from host.core.terminal import PlainConsole
from host.core.whole_file import save_text

BOUND_MS: Final = 1600.0
"""A second figure of lateness, beside the fault's own bound."""


@click.command()
@click.option("--fault", default="pot.stuck", show_default=True, metavar="COMPONENT.FAILURE")
@click.option("--scenario", "name", default="default", show_default=True)
@click.option("--seeds", type=SEEDS, default="1-4", show_default=True)
@click.option("--eyes", type=click.Choice(["picture", "model"]), default="model", show_default=True)
@click.option("--moments", "count", type=WholeRange(1), default=60, show_default=True)
@click.option("--every", type=NumberRange(0, min_open=True), default=3.0, show_default=True)
@click.option("--watch", type=NumberRange(0, min_open=True), default=12.0, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/moments.json"))
def command(
    fault: str,
    name: str,
    seeds: list[int],
    eyes: str,
    count: int,
    every: float,
    watch: float,
    out: Path,
) -> None:
    """Harvests a scenario for each seed, and at many moments of it copies of the machine take a
    fault: how soon each stops, and what moved meanwhile. A row of `daranti-hil faults` is one such
    moment."""
    failing = next((pair for pair in PAIRS if ".".join(pair) == fault), None)
    if failing is None:
        raise UserError(f"--fault {fault}: no such fault; `daranti-hil faults` knows them")
    found: list[Moment] = []
    check_folder(out.parent)
    check_built(scenario.load(name, {}).firmware)
    out.parent.mkdir(parents=True, exist_ok=True)
    check_file(out)
    bound_ms = PAIRS[failing].bound_s * 1000
    table = Table(
        "seed", "moments", "made a difference", f"later than {bound_ms:.0f} ms",
        f"than {BOUND_MS:.0f} ms", "median ms", "worst ms", "wheel turned, deg", "aside, m", "harm",
    )  # fmt: skip
    with Watch("harvests", len(seeds)) as progress:
        for seed in seeds:
            base = scenario.load(name, {"seed": seed, "eyes": eyes})
            new = moments(base, failing, count=count, every_s=every, watch_s=watch)
            found += new
            table.add_row(str(seed), *row(new, bound_ms))
            save_text(out, json.dumps([asdict(m) for m in found]))
            progress.step()
    if not found:
        raise UserError(f"no harvest lasted as long as --every {every:g}; give a smaller one")
    table.add_row("all", *row(found, bound_ms))
    PlainConsole().print_table(table)


def row(found: Sequence[Moment], bound_ms: float) -> list[str]:
    """The figures of some moments."""
    shown = [m for m in found if m.shown_s is not None]
    stops = np.array([np.inf if m.stop_ms is None else m.stop_ms for m in shown])
    worst: dict[str, Any] = {
        key: max((getattr(m, key) for m in shown), default=0.0) for key in ("turned_deg", "aside_m")
    }
    return [
        str(len(found)),
        str(len(shown)),
        str(int((stops > bound_ms).sum())),
        str(int((stops > BOUND_MS).sum())),
        f"{np.median(stops):.0f}" if shown else "",
        f"{stops.max():.0f}" if shown else "",
        f"{worst['turned_deg']:.1f}",
        f"{worst['aside_m']:.2f}",
        str(sum(bool(m.harm) for m in found)),
    ]
