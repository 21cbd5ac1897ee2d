"""`daranti tune pid`: gains for the steering loop, written to the firmware and verified."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import click
import control
import numpy as np
from rich.console import Console
from rich.table import Table

from host.commands import params
from host.commands.cli import port_option
from host.commands.identify import LinkWire, connect, measure, read_params, write_params
from host.core.errors import UserError
from host.core.messages import State, Telemetry
from host.link import protocol
from host.tune import closed_loop
from host.tune.experiments import ActuatorModel, Wire, armed
from host.tune.pid_rules import RULES, gains, loops, margins
from host.tune.step_response import Floats, Response, Step, deadline_s, judge, meets

KEEPALIVE_S: Final = 0.1
VERIFY_SIZE_DEG: Final = 30.0
VERIFY_S: Final = 3.0
TELEMETRY_S: Final = 0.02


def verify(wire: Wire, name: str, step: Step) -> tuple[Response, Floats]:
    """Makes the step on the machine: first to its start, then the step. The angle is the reading's
    running mean over five samples. Also returns (2, n) angle in degrees and duty, every 20 ms."""
    with armed(wire, name, {"ident_duty_max": 0.0}):
        _hold(wire, step.start_deg, VERIFY_S)
        seen = _hold(wire, step.start_deg + step.size_deg, step.duration_s)
    readings = np.degrees([t.angle_rad for t in seen])
    padded = np.concatenate([np.full(2, readings[0]), readings, np.full(2, readings[-1])])
    angle = np.convolve(padded, np.full(5, 0.2), mode="valid")
    duty = np.array([float(t.steer_duty) for t in seen])
    response = judge(angle, duty, TELEMETRY_S, step, faults=seen[-1].faults)
    return response, np.stack([angle, duty])


def _hold(wire: Wire, angle_deg: float, seconds: float) -> list[Telemetry]:
    """Commands an angle for a time. Raises UserError when the firmware gives up."""
    seen: list[Telemetry] = []
    end = wire.now + seconds
    due = wire.now
    while wire.now < end:
        if wire.now >= due:
            due += KEEPALIVE_S
            wire.request(protocol.Drive(math.radians(angle_deg), 0.0, 0))
        for telemetry in wire.poll():
            if telemetry.state is not State.ARMED:
                texts = protocol.fault_texts(protocol.Fault(telemetry.faults))
                raise UserError(f"the firmware gave up the step: {'; '.join(texts)}")
            seen.append(telemetry)
    if len(seen) < 0.8 * seconds / TELEMETRY_S:
        raise UserError(f"only {len(seen)} telemetry messages in {seconds:g} s: check the cable")
    return seen


def _shown(
    model: ActuatorModel, before: Mapping[str, float], after: Mapping[str, float]
) -> tuple[Table, Table]:
    parameters = Table(title="parameters")
    for column in ("parameter", "before", "after", "unit"):
        parameters.add_column(column)
    for name in closed_loop.LAW:
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


def draw(
    path: Path,
    model: ActuatorModel,
    laws: Mapping[str, Mapping[str, float]],
    measured: Floats | None,
    step: Step,
) -> None:
    """Step responses and loops before and after, and the machine's own step."""
    import matplotlib  # noqa: PLC0415

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415

    figure_, (left, right) = plt.subplots(1, 2, figsize=(13, 4.6))
    for name, law in laws.items():
        _, trace = closed_loop.respond(model, law, step)
        time = np.arange(trace.shape[1]) * closed_loop.TICK_S
        left.plot(time, trace[0], label=f"{name}, firmware's law on the model")
        opened, closed = loops(model, law)
        linear = control.step_response(closed, np.linspace(0, 1.5, 600))
        value = step.start_deg + step.size_deg * linear.outputs
        left.plot(linear.time, value, ":", lw=1, label=f"{name}, linear loop")
        w = np.logspace(-0.5, 2.5, 400)
        right.loglog(w, np.abs(opened(1j * w)), label=f"|L| {name}")
        right.loglog(w, np.abs(1 / (1 + opened(1j * w))), "--", label=f"|S| {name}")
    if measured is not None:
        left.plot(
            np.arange(measured.shape[1]) * TELEMETRY_S, measured[0], "k.", ms=4, label="machine"
        )
    left.set(xlabel="s", ylabel="steering angle, deg")
    right.set(xlabel="rad/s")
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    figure_.tight_layout()
    figure_.savefig(path, dpi=80)
    plt.close(figure_)


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
    console = Console()
    model = None if model_file is None else ActuatorModel.load(model_file)
    out.mkdir(parents=True, exist_ok=True)
    with connect(port) as link:
        values = read_params(link)
        if model is None:
            _, model = measure(link, port, console, values)
            model.save(out / "model.json")
        before = {name: values[name] for name in closed_loop.LAW}
        with console.status(f"choosing gains: {rule}"):
            after = gains(rule, model)
        for shown in _shown(model, before, after):
            console.print(shown)
        size = min(VERIFY_SIZE_DEG, 2 * values["steer_limit"])
        step = Step(size_deg=size, start_deg=-size / 2, duration_s=VERIFY_S)
        laws = {"before": before, rule: after}
        if dry_run:
            draw(out / "tune.png", model, laws, None, step)
            return
        write_params(link, after)
        try:
            with console.status("verifying with a step; keep clear (Ctrl-C stops)"):
                response, trace = verify(LinkWire(link), port, step)
            deadline = deadline_s(model.slew_degps, model.lag_s.value, step)
            if not meets(response, step, deadline):
                raise UserError(
                    f"the step on the machine misses the figures: settled after "
                    f"{response.settle_s:.2f} s (at most {deadline:.2f}), overshoot "
                    f"{100 * response.overshoot:.1f} % (5), steady error "
                    f"{response.steady_error_deg:.2f} deg (0.5), {response.starts} starts at rest "
                    "(0). The old parameters are restored; identify again with the wheel free"
                )
        except BaseException:
            link.request(protocol.Stop())
            write_params(link, before)
            raise
        draw(out / "tune.png", model, laws, trace, step)
        click.echo(
            f"verified on the machine: settles in {response.settle_s:.2f} s, overshoot "
            f"{100 * response.overshoot:.1f} %, steady error {response.steady_error_deg:.2f} deg"
        )
        if keep:
            params.save(link)
        click.echo("saved" if keep else "not saved: lost at the next reset (`--save` keeps them)")
    click.echo(f"written to {out}: tune.png")
