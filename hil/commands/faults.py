"""`daranti-hil faults`: every fault that the bench can make, and what the machine did about it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import get_args

import click

from hil.firmware.provision import Firmware, check_built
from hil.judge.fault_verdict import Situation
from hil.report import report
from hil.report.fault_tables import markdown_of, table_of
from hil.studies.matrix_runs import Matrix, run_matrix, worst_stop_ms
from host.core.errors import UserError
from host.core.number_range import WholeRange
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import PlainConsole, echo
from host.core.whole_file import save_text
from sim_plant.camera import MOUNTS

SITUATIONS: dict[str, tuple[Situation, ...]] = {
    "follow": ("follow",),
    "turn": ("turn",),
    "both": ("follow", "turn"),
}


@click.command()
@click.option(
    "--firmware", type=click.Choice(get_args(Firmware)), default="desk", show_default=True
)
@click.option("--only", multiple=True, metavar="COMPONENT[.FAILURE[.HOW]]", help="May be repeated.")
@click.option("--while", "situation", type=click.Choice(list(SITUATIONS)), default="both")
@click.option("--mode", type=click.Choice(["paper", "robust"]), default="robust", show_default=True)
@click.option("--camera", default="mast", show_default=True, metavar="low|mast")
@click.option("--sensors", is_flag=True, help="With the optional sensors of wheel and blade.")
@click.option(
    "--machine",
    type=WholeRange(0, 2**31 - 1),
    metavar="SEED",
    help="A machine and camera of its own, commissioned as an owner does.",
)
@click.option("--workers", type=WholeRange(1, 256), default=2, show_default=True)
@click.option("--scheduler", metavar="ADDRESS", help="A Dask scheduler, tcp://HOST:PORT.")
@click.option("--records", is_flag=True, help="Keep a record of every run.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/faults"))
def faults(
    firmware: Firmware,
    only: tuple[str, ...],
    situation: str,
    mode: str,
    camera: str,
    sensors: bool,
    machine: int | None,
    workers: int,
    scheduler: str | None,
    records: bool,
    out: Path,
) -> None:
    """Makes everything fail that can fail, and says who noticed, when, and what moved meanwhile.

    Exits with an error when any outcome is unsafe or late; known limits are counted apart. The same
    command goes on where it was killed, as long as the programs are the same."""

    if camera not in MOUNTS:
        raise UserError(f"--camera {camera}: no such mount; there are {', '.join(sorted(MOUNTS))}")
    check_folder(out)
    check_built(firmware)
    records_in = out / "records" if records else None
    owner = (out / f"machine-{machine}").resolve()
    matrix = Matrix(
        only, SITUATIONS[situation], firmware, mode, camera, sensors, records_in, machine, owner
    )
    cases = matrix.cases()
    with Watch(f"{len(cases)} faults", len(cases)) as watch:
        verdicts = run_matrix(
            cases, out, workers=workers, scheduler=scheduler, progress=watch.reach
        )
    summary = matrix.summary(verdicts)
    save_text(out / "summary.json", json.dumps(summary, indent=1) + "\n")
    PlainConsole().print_table(table_of(verdicts, matrix.title))
    save_text(out / "faults.md", markdown_of(verdicts, matrix.title))
    report.faults_report(out, matrix.title, verdicts)
    echo(
        f"{len(verdicts)} runs, {summary['limits']} known limits, worst stop_latency_ms "
        f"{worst_stop_ms(verdicts):.0f}; written to {out}"
    )
    if summary["bad"]:
        raise UserError(f"{summary['bad']} of {len(verdicts)} outcomes are unsafe or late")
