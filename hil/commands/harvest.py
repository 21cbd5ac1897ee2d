"""`daranti-hil harvest`: one field in lockstep, with its figures."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

import click
import cv2
from rich import progress
from rich.console import Console
from rich.table import Table

from hil.bench.harvest import SWITCH_S, Progress, harvest
from hil.bench.live_view import HOST
from hil.commands.progress import Lines, written_since
from hil.scenario.belief import in_words, wrong_by
from hil.scenario.scenario import assigned, load, merge
from host.core.errors import FaultError, UnfinishedError


@click.command("harvest")
@click.option("--scenario", "name", default="default", show_default=True, metavar="NAME|FILE")
@click.option("--firmware", type=click.Choice(["desk", "avr"]), help="Which build of the firmware.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), help="Of field, sensors and errors.")
@click.option("--camera", metavar="low|mast", help="Camera mount, by its name in the vehicle file.")
@click.option("--mode", type=click.Choice(["paper", "robust"]), help="Which vision steers.")
@click.option("--eyes", type=click.Choice(["picture", "model"]), help="Pictures, or their model.")
@click.option("--hour", type=click.FloatRange(0, 24, max_open=True), help="Solar time of day.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/harvest"))
@click.option("--film/--no-film", default=None, help="Write camera.mp4.")
@click.option("--live", type=click.IntRange(1, 65535), help="Port of a live view for Foxglove.")
@click.option("--belief", metavar="exact|FOLDER", help="What the host is told: a commissioned one.")
@click.option("--set", "settings", multiple=True, metavar="FIELD=VALUE", help="Any other field.")
def harvest_command(
    name: str,
    out: Path,
    film: bool | None,
    live: int | None,
    belief: str | None,
    hour: float | None,
    settings: tuple[str, ...],
    **options: Any,
) -> None:
    """Harvests a field in lockstep and says how well."""
    # The threads here share the cores already, and one that comes back from a kernel is not to wait
    # 5 ms for another to let go of the interpreter.
    cv2.setNumThreads(1)
    sys.setswitchinterval(SWITCH_S)
    overrides: dict[str, Any] = {k: v for k, v in options.items() if v is not None}
    if hour is not None:
        overrides["weather"] = {"hour": hour}
    if film is not None:
        overrides["record"] = {"film": film}
    if live is not None:
        overrides = merge(overrides, {"record": {"live_port": live}})
        click.echo(f"live view: open ws://{HOST}:{live} in Foxglove", err=True)
    if belief is not None:
        overrides["belief"] = "exact" if belief == "exact" else {"folder": belief}
    for setting in settings:
        overrides = merge(overrides, assigned(setting))
    chosen = load(name, overrides)
    begun = time.time()
    click.echo(in_words(wrong_by(chosen.told, chosen.world)))
    console = Console(stderr=True)
    columns = (
        progress.TextColumn("coverage"),
        progress.BarColumn(),
        progress.TaskProgressColumn(),
        progress.TextColumn("{task.fields[time]:6.0f} s  {task.description}"),
    )
    with progress.Progress(*columns, console=console) as bar:
        task = bar.add_task("starting", total=1.0, time=0.0)

        lines = Lines(console)

        def show(step: Progress) -> None:
            lines.tell(step.coverage, f"{step.time_s:.0f} s simulated, {step.phase.value}")
            bar.update(
                task, completed=step.coverage, time=step.time_s, description=step.phase.value
            )

        summary = harvest(chosen, out, show, camera_threads=os.cpu_count() or 1)
    table = Table(title=f"{summary['scenario']}: {summary['outcome']} ({summary['reason']})")
    table.add_column("figure")
    table.add_column("value", justify="right")
    for key, value in summary.items():
        if isinstance(value, int | float) and not isinstance(value, bool):
            table.add_row(key, f"{value:g}")
    Console().print(table)
    click.echo(f"written to {out}: {', '.join(sorted(written_since(out, begun)))}")
    if summary["outcome"] != "finished":
        kind = FaultError if summary["outcome"] == "fault" else UnfinishedError
        raise kind(
            f"the field was not finished: {summary['outcome']}: {summary['reason']} "
            f"(see {out / 'map.png'}; `daranti-hil report {out}` shows it all)"
        )
