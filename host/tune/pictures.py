"""Pictures of what was identified and tuned."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import control
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from host.core.whole_file import saved
from host.tune import closed_loop
from host.tune.actuator_model import TICK_S, ActuatorModel, Findings, predict
from host.tune.on_machine import TELEMETRY_S
from host.tune.pid_rules import loops
from host.tune.step_response import Floats, Step

mpl.use("Agg")


def draw_fit(findings: Findings, model: ActuatorModel, path: Path) -> None:
    """Measured against fitted, run by run."""
    runs = findings.runs
    columns = 4
    lines = -(-len(runs) // columns)
    figure = Figure(figsize=(15, 2.8 * lines), layout="constrained")
    grid = figure.subplots(lines, columns, squeeze=False)
    for axes in grid.flat[len(runs) :]:
        axes.axis("off")
    for axes, run in zip(grid.flat, runs, strict=False):
        fitted = predict(run, model) + run.start_deg
        error = float(np.sqrt(np.mean((fitted - np.array(run.angle_deg)) ** 2)))
        axes.plot(run.time_s, run.angle_deg, ".", ms=4, label="measured")
        axes.plot(run.time_s, fitted, lw=1.2, label="fitted")
        axes.set_title(f"{run.kind} {run.duties[0]:+d}: rms {error:.2f} deg", fontsize=9)
        axes.grid(alpha=0.3)
    grid.flat[0].legend(fontsize=8)
    figure.supxlabel("s")
    figure.supylabel("steering angle, deg")
    with saved(path) as fresh:
        figure.savefig(fresh, dpi=80)


def draw_tuning(
    path: Path,
    model: ActuatorModel,
    laws: Mapping[str, Mapping[str, float]],
    measured: Floats | None,
    step: Step,
) -> None:
    """Step responses and loops before and after, and the machine's own step."""
    figure = Figure(figsize=(13, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, law in laws.items():
        _, trace = closed_loop.respond(model, law, step)
        time = np.arange(trace.shape[1]) * TICK_S
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
    with saved(path) as fresh:
        figure.savefig(fresh, dpi=80)
