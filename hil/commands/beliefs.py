"""`daranti-hil beliefs`: what each wrong belief does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from hil.studies.beliefs import CASES, harmless, run, table_of
from host.core.errors import UserError
from host.core.progress import Watch
from host.core.terminal import PlainConsole, echo


@click.command()
@click.argument("cases", nargs=-1, metavar="[CASE]...")
@click.option("--eyes", type=click.Choice(["picture", "model"]), default="picture")
@click.option("--firmware", type=click.Choice(["desk", "avr"]), default="desk", show_default=True)
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/beliefs"))
def beliefs(cases: tuple[str, ...], eyes: str, firmware: str, out: Path) -> None:
    """Harvests a small field with one thing other than the host was told, CASE by CASE.

    Exits with an error where the neighbour's crop was cut or the machine left its area."""
    unknown = [case for case in cases if case not in CASES]
    if unknown:
        raise UserError(f"no case is named {unknown[0]!r}; there are: {'; '.join(CASES)}")

    def show(row: dict[str, Any]) -> None:
        watch.step()
        end = f"{row['outcome']}: {row['reason']}"
        echo(
            f"{row['belief']}: neighbour {row['neighbour_cut_m2']:g} m2, outside "
            f"{row['outside_m']:g} m, coverage {row['coverage']:.3f}, {end}"
        )

    with Watch("beliefs", len(cases or CASES)) as watch:
        rows = run(cases or CASES, out, eyes, firmware, show)
    PlainConsole().print_table(table_of(rows))
    harm = [str(row["belief"]) for row in rows if not harmless(row)]
    if harm:
        raise UserError(f"{len(harm)} of {len(rows)} did harm: {', '.join(harm)}")
