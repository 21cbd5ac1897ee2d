"""`daranti-hil commission`: an owner's first day with the simulated machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from hil.firmware.provision import check_built
from hil.scenario.belief import MOST_CEP_M, MOST_LAPS, Walk
from hil.scenario.scenario import assigned, load, merge
from hil.studies.commissioning import commission, page_of
from host.core.number_range import NumberRange, WholeRange
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import echo


@click.command("commission")
@click.option("--scenario", "name", default="default", show_default=True, metavar="NAME|FILE")
@click.option("--seed", type=WholeRange(0, 2**31 - 1), help="Of field, sensors and errors.")
@click.option("--camera", metavar="low|mast", help="Which of the machine's mounts.")
@click.option("--laps", type=WholeRange(1, MOST_LAPS), default=3, show_default=True,
              help="Of the walk.")  # fmt: skip
@click.option("--cep", type=NumberRange(0, MOST_CEP_M), default=1.0, show_default=True,
              help="Phone's, m.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/commission"))
@click.option("--set", "settings", multiple=True, metavar="FIELD=VALUE", help="Any other field.")
def commission_command(
    name: str, laps: int, cep: float, out: Path, settings: tuple[str, ...], **options: Any
) -> None:
    """Walks the field, calibrates camera, wheels and steering, and writes what `harvest --belief`
    takes; the page says found against true."""
    overrides: dict[str, Any] = {k: v for k, v in options.items() if v is not None}
    for setting in settings:
        overrides = merge(overrides, assigned(setting))
    chosen = load(name, overrides)
    check_folder(out)
    check_built(chosen.firmware)
    with Watch("commission"):
        values = commission(chosen, out, Walk(laps=laps, cep_m=cep), echo)
    echo(page_of(values))
    echo(f"written to {out}; harvest with it: daranti-hil harvest --belief {out}")
