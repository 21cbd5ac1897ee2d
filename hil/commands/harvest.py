"""`daranti-hil harvest`: one field in lockstep, with its figures."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

import click
import cv2
from rich.table import Table

from hil.bench.harvest import SWITCH_S, Progress, harvest
from hil.bench.live_view import HOST
from hil.firmware.provision import check_built
from hil.judge.figures import cells_of
from hil.scenario.belief import in_words, wrong_by
from hil.scenario.scenario import assigned, load, merge
from host.core.errors import FaultError, UnfinishedError, UserError
from host.core.number_range import NumberRange, WholeRange
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import PlainConsole, echo


def written_since(folder: Path, begun: float) -> list[str]:
    """Names of what was written into a folder since `begun` (seconds of the system's clock): what
    an earlier run has left is not announced as this one's."""
    slack_s = 1.0  # some file systems keep whole seconds
    return [each.name for each in folder.iterdir() if each.stat().st_mtime >= begun - slack_s]


@click.command("harvest")
@click.option("--scenario", "name", default="default", show_default=True, metavar="NAME|FILE")
@click.option("--firmware", type=click.Choice(["desk", "avr"]), help="Which build of the firmware.")
@click.option("--seed", type=WholeRange(0, 2**31 - 1), help="Of field, sensors and errors.")
@click.option("--camera", metavar="low|mast", help="Camera mount, by its name in the vehicle file.")
@click.option("--mode", type=click.Choice(["paper", "robust"]), help="Which vision steers.")
@click.option("--eyes", type=click.Choice(["picture", "model"]), help="Pictures, or their model.")
@click.option("--hour", type=NumberRange(0, 24, max_open=True), help="Solar time of day.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/harvest"))
@click.option("--film/--no-film", default=None, help="Write camera.mp4 (of pictures).")
@click.option("--live", type=WholeRange(1, 65535), help="Port of a live view for Foxglove.")
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
        echo(f"live view: open ws://{HOST}:{live} in Foxglove", err=True)
    if belief is not None:
        overrides["belief"] = "exact" if belief == "exact" else {"folder": belief}
    for setting in settings:
        overrides = merge(overrides, assigned(setting))
    chosen = load(name, overrides)
    if film and chosen.eyes == "model":
        raise UserError("--film: the model takes no pictures; leave it, or take --eyes picture")
    check_folder(out)
    check_built(chosen.firmware)
    begun = time.time()
    echo(in_words(wrong_by(chosen.told, chosen.world)))
    with Watch("harvest", 1.0) as watch:

        def show(step: Progress) -> None:
            watch.reach(step.coverage, f"{step.time_s:.0f} s simulated, {step.phase.value}")

        summary = harvest(chosen, out, show, camera_threads=os.cpu_count() or 1)
    table = Table(title=f"{summary['scenario']}: {summary['outcome']} ({summary['reason']})")
    for heading in ("figure", "value", "unit", "must be"):
        table.add_column(heading, justify="right" if heading == "value" else "left")
    for key, value in summary.items():
        if isinstance(value, int | float) and not isinstance(value, bool):
            table.add_row(*cells_of(key, value))
    PlainConsole().print_table(table)
    written = sorted(written_since(out, begun))
    echo(f"written to {out}: {', '.join(written)}")
    if summary["outcome"] != "finished":
        kind = FaultError if summary["outcome"] == "fault" else UnfinishedError
        shows = f"`daranti-hil report {out}` shows it all"
        if "map.png" in written:
            shows = f"see {out / 'map.png'}; {shows}"
        else:
            shows = "with --set record.files=all it draws a map and keeps a record"
        raise kind(
            f"the field was not finished: {summary['outcome']}: {summary['reason']} ({shows})"
        )
