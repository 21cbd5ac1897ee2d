"""`daranti-hil consistency`: whether the estimator knows how well it knows."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
from rich.table import Table

from hil.commands.seeds import SEEDS
from hil.firmware.provision import check_built
from hil.scenario.random_fields import random_field
from hil.scenario.scenario import changed
from hil.studies.consistency import overview, watched
from hil.studies.outlines import outline_field
from host.core.number_range import NumberRange
from host.core.output_place import check_file, check_folder
from host.core.progress import Watch
from host.core.terminal import PlainConsole
from host.core.whole_file import save_text


@click.command()
@click.option("--seeds", type=SEEDS, default="1-8", show_default=True)
@click.option("--eyes", type=click.Choice(["picture", "model"]), default="model", show_default=True)
@click.option("--dust", type=NumberRange(0, 1), help="In all fields, instead of each its own.")
@click.option(
    "--outlines", is_flag=True, help="Outlines with edges that bend, as their owners walk them."
)
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/consistency.json"))
def consistency(seeds: list[int], eyes: str, dust: float | None, outlines: bool, out: Path) -> None:
    """Harvests random fields and compares the estimator's errors with what it says of them. The
    boundary is exact, so that there is one field frame; machine, mount and lens are as wrong as
    an owner's values are. With --outlines it was walked, and no place is compared: the direction,
    the lane and the distance from the border are."""
    setting: dict[str, Any] = {"eyes": eyes}
    if not outlines:
        setting["belief"] = {"errors": {"walk_cep_m": None}}
    if dust is not None:
        setting["weather"] = {"dust": dust}
    console = PlainConsole()
    check_folder(out.parent)
    check_built("desk")
    out.parent.mkdir(parents=True, exist_ok=True)
    check_file(out)
    runs = []
    with Watch("fields", len(seeds)) as watch:
        for seed in seeds:
            drawn = outline_field(seed) if outlines else random_field(seed)
            runs.append(watched(changed(drawn, setting)))
            save_text(out, json.dumps(runs))
            last = runs[-1]
            console.print(
                f"{seed}: {last['outcome']}, coverage {last['coverage']:.4f}, "
                f"lateral {last['lateral_rms_m']:.3f} m"
            )
            watch.step()
    table = Table("", "fields", "NEES, 1 is honest", "95 % of it", "median", "within 95 %", "rms",
                  "worst")  # fmt: skip
    for line in overview(runs):
        table.add_row(
            line.measure,
            str(line.runs),
            f"{line.nees:.2f}",
            f"{line.nees_low:.2f} to {line.nees_high:.2f}",
            f"{line.median:.2f}",
            f"{line.within:.3f}",
            f"{line.rms:.3f}",
            f"{line.worst:.2f}",
        )
    console.print_table(table)
