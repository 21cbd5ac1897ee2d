"""`daranti-hil`: the bench's console script. Heavy modules are imported when needed."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any, NoReturn

import click

from host import errors

LAZY = {"rig": "hil.virtual:rig", "world": "hil.world:world"}
"""Commands that live in modules of their own."""


class Commands(click.Group):
    """A group that imports a command's module when the command is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted([*super().list_commands(ctx), *LAZY])

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in LAZY:
            module, name = LAZY[cmd_name].split(":")
            command = getattr(importlib.import_module(module), name)
            assert isinstance(command, click.Command)
            return command
        return super().get_command(ctx, cmd_name)


@click.group(cls=Commands)
def cli() -> None:
    """Puts firmware, simulated plant and host together."""


@cli.command()
@click.option("--scenario", "name", default="default", show_default=True, metavar="NAME|FILE")
@click.option("--firmware", type=click.Choice(["desk", "avr"]), help="Which build of the firmware.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), help="Of field, sensors and errors.")
@click.option("--camera", metavar="low|mast", help="Camera mount, by its name in the vehicle file.")
@click.option("--mode", type=click.Choice(["paper", "robust"]), help="Which vision steers.")
@click.option("--hour", type=click.FloatRange(0, 24, max_open=True), help="Solar time of day.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/harvest"))
@click.option("--film/--no-film", default=True, help="Write camera.mp4.")
def harvest(name: str, out: Path, film: bool, hour: float | None, **options: Any) -> None:
    """Harvests a field in lockstep and says how well."""
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import BarColumn, Progress, TextColumn  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    from hil import scenario  # noqa: PLC0415
    from hil.harvest import Progress as Step  # noqa: PLC0415
    from hil.harvest import harvest as run  # noqa: PLC0415

    overrides: dict[str, Any] = {k: v for k, v in options.items() if v is not None}
    if hour is not None:
        overrides["weather"] = {"hour": hour}
    chosen = scenario.load(name, overrides)
    console = Console(stderr=True)
    columns = (
        TextColumn("coverage"),
        BarColumn(),
        TextColumn("{task.percentage:5.1f} %  {task.fields[time]:6.0f} s  {task.description}"),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("starting", total=1.0, time=0.0)

        def show(step: Step) -> None:
            bar.update(
                task, completed=step.coverage, time=step.time_s, description=step.phase.value
            )

        summary = run(chosen, out, show, film=film)
    table = Table(title=f"{summary['scenario']}: {summary['outcome']} ({summary['reason']})")
    table.add_column("figure")
    table.add_column("value", justify="right")
    for key, value in summary.items():
        if isinstance(value, int | float) and not isinstance(value, bool):
            table.add_row(key, f"{value:g}")
    Console().print(table)
    click.echo(f"written to {out}: summary.json, map.png, steering.png, camera.mp4, record.mcap")
    if summary["outcome"] != "finished":
        raise errors.UserError(
            f"the field was not finished: {summary['outcome']}: {summary['reason']} "
            f"(see {out / 'map.png'} and {out / 'camera.mp4'})"
        )


def main() -> NoReturn:
    """Entry point."""
    errors.run(cli, "daranti-hil")
