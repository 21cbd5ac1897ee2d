"""`daranti tune pid`: gains for the steering loop, written to the firmware and verified."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import click
from rich.table import Table

from host.commands.identify import telling
from host.commands.options import port_option
from host.core.output_place import check_folder
from host.core.terminal import PlainConsole, echo
from host.link import protocol
from host.link.params import read_all, save
from host.link.session import connect
from host.tune import closed_loop
from host.tune.actuator_model import ActuatorModel
from host.tune.on_machine import VERIFY_S, measure, write_verified
from host.tune.pictures import draw_tuning
from host.tune.pid_rules import RULES, gains, margins
from host.tune.step_response import Step

VERIFY_SIZE_DEG: Final = 30.0
"""Of the step by which new gains are tried, where the limit leaves room for it."""


def _shown(
    model: ActuatorModel, before: Mapping[str, float], after: Mapping[str, float]
) -> tuple[Table, Table]:
    parameters = Table(title="parameters")
    for column in ("parameter", "before", "after", "unit"):
        parameters.add_column(column)
    for name in closed_loop.TUNED:
        unit = protocol.PARAMS[name].unit
        parameters.add_row(name, f"{before[name]:g}", f"{after[name]:g}", unit)
    loop = Table(title="loop on the identified model")
    for column in ("figure", "before", "after"):
        loop.add_column(column)
    both = [margins(model, law) for law in (before, after)]
    steps = [closed_loop.respond(model, law, Step())[0] for law in (before, after)]
    rows = [
        ("gain margin, dB", *(f"{m.gain_db:.1f}" for m in both)),
        ("phase margin, deg", *(f"{m.phase_deg:.1f}" for m in both)),
        ("sensitivity's peak", *(f"{m.sensitivity:.2f}" for m in both)),
        ("crossover, rad/s", *(f"{m.crossover_radps:.1f}" for m in both)),
        ("30 degrees settle, s", *(f"{r.settle_s:.2f}" for r in steps)),
        ("overshoot, %", *(f"{100 * r.overshoot:.1f}" for r in steps)),
        ("steady error, deg", *(f"{r.steady_error_deg:.2f}" for r in steps)),
    ]
    for row in rows:
        loop.add_row(*row)
    return parameters, loop


@click.command()
@port_option
@click.option(
    "--model",
    "model_file",
    type=click.Path(path_type=Path),
    help="What `daranti identify` wrote; without it the machine is identified first.",
)
@click.option("--rule", type=click.Choice(RULES), default="optimise", show_default=True)
@click.option("--save", "keep", is_flag=True, help="Store the parameters in the EEPROM.")
@click.option("--dry-run", is_flag=True, help="Show what would be written; move nothing more.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/tune"), show_default=True)
def pid(
    port: str, model_file: Path | None, rule: str, keep: bool, dry_run: bool, out: Path
) -> None:
    """Tunes the steering loop: chooses gains on the actuator's model, writes them to the firmware
    and verifies them with a step of 30 degrees. If that fails, the old parameters are restored."""
    console = PlainConsole()
    model = None if model_file is None else ActuatorModel.load(model_file)
    check_folder(out)
    out.mkdir(parents=True, exist_ok=True)
    with connect(port) as link:
        values = read_all(link)
        if model is None:
            with console.status("the steering will move; keep clear") as status:
                _, model = measure(link, port, values, telling(status))
            model.save(out / "model.json")
        before = {name: values[name] for name in closed_loop.TUNED}
        with console.status(f"choosing gains: {rule}"):
            after = gains(rule, model)
        for shown in _shown(model, before, after):
            console.print_table(shown)
        size = min(VERIFY_SIZE_DEG, 2 * values["steer_limit"])
        step = Step(size_deg=size, start_deg=-size / 2, duration_s=VERIFY_S)
        laws = {"before": before, rule: after}
        if dry_run:
            draw_tuning(out / "tune.png", model, laws, None, step)
            return
        with console.status("verifying with a step; keep clear (Ctrl-C stops)"):
            response, trace = write_verified(link, port, model, after, before, step)
        draw_tuning(out / "tune.png", model, laws, trace, step)
        echo(
            f"verified on the machine: settles in {response.settle_s:.2f} s, overshoot "
            f"{100 * response.overshoot:.1f} %, steady error {response.steady_error_deg:.2f} deg"
        )
        if keep:
            save(link)
        echo("saved" if keep else "not saved: lost at the next reset (`--save` keeps them)")
    echo(f"written to {out}: tune.png")
