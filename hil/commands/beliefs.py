"""`daranti-hil beliefs`: what each wrong belief does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from hil.commands.seeds import SEEDS
from hil.firmware.provision import Firmware, check_built
from hil.studies.belief_sizes import SIZED, draw_sizes
from hil.studies.beliefs import (
    AND,
    CASES,
    MOST_PAIRS,
    ONLY_PICTURES,
    SEED,
    harmless,
    run,
    table_of,
)
from hil.studies.beliefs import pairs as drawn_pairs
from host.core.errors import UserError
from host.core.number_range import WholeRange
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import PlainConsole, echo


@click.command()
@click.argument("cases", nargs=-1, metavar="[CASE]...")
@click.option("--eyes", type=click.Choice(["picture", "model"]), default="picture")
@click.option("--firmware", type=click.Choice(["desk", "avr"]), default="desk", show_default=True)
@click.option("--pairs", type=WholeRange(1, MOST_PAIRS), help="So many pairs of them instead.")
@click.option("--seed", type=WholeRange(0), default=1, show_default=True, help="Of the pairs.")
@click.option("--seeds", type=SEEDS, default=str(SEED), show_default=True,
              help="Of each harvest's crop, weather and noise.")  # fmt: skip
@click.option("--sizes", is_flag=True, help="Errors of several sizes instead, and their plot.")
@click.option("--workers", type=WholeRange(1, 256), default=2, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/beliefs"))
def beliefs(
    cases: tuple[str, ...],
    eyes: str,
    firmware: Firmware,
    pairs: int | None,
    seed: int,
    seeds: list[int],
    sizes: bool,
    workers: int,
    out: Path,
) -> None:
    """Harvests a small field with one thing other than the host was told, CASE by CASE; two CASEs
    joined by " and " are wrong at once.

    Exits with an error where the neighbour's crop was cut or the machine left its area."""
    if bool(cases) + (pairs is not None) + sizes > 1:
        raise UserError("give cases, --pairs or --sizes, and not two of them")
    if sizes and len(seeds) > 1:
        raise UserError("--sizes draws one seed: give one in --seeds")
    chosen = list(cases or CASES)
    if pairs is not None:
        chosen = drawn_pairs(pairs, seed)
    elif sizes:
        chosen = list(SIZED)
    known = {**CASES, **SIZED}
    unknown = [one for case in chosen for one in case.split(AND) if one not in known]
    if unknown:
        raise UserError(f"no case is named {unknown[0]!r}; there are: {'; '.join(CASES)}")
    check_folder(out)
    check_built(firmware)
    if eyes == "model":
        blind = [case for case in chosen if not ONLY_PICTURES.isdisjoint(case.split(AND))]
        if blind:
            echo(f"left out, model eyes know no such pictures: {', '.join(blind)}")
        chosen = [case for case in chosen if case not in blind]

    def show(row: dict[str, Any]) -> None:
        watch.step()
        end = f"{row['outcome']}: {row['reason']}"
        echo(
            f"{row['belief']}: neighbour {row['neighbour_cut_m2']:g} m2, outside "
            f"{row['outside_m']:g} m, coverage {row['coverage']:.3f}, {end}"
        )

    with Watch("beliefs", len(chosen) * len(seeds)) as watch:
        rows = run(chosen, out, eyes, firmware, show, known, seeds, workers)
    PlainConsole().print_table(table_of(rows))
    if sizes:
        draw_sizes(rows, out / "beliefs.png")
        echo(f"drawn: {out / 'beliefs.png'}")
    harm = [str(row["belief"]) for row in rows if not harmless(row)]
    if harm:
        raise UserError(f"{len(harm)} of {len(rows)} did harm: {', '.join(harm)}")
