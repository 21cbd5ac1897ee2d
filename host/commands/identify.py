"""`daranti identify`: the steering actuator's model, measured on the machine through a port."""

from __future__ import annotations

import time
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from host.commands import params
from host.commands.cli import port_option
from host.core.errors import UserError
from host.core.messages import Telemetry
from host.link import protocol
from host.link.session import Link, Session
from host.tune.experiments import (
    ActuatorModel,
    Findings,
    PotCalibration,
    armed,
    calibrate_pot,
    fit,
    predict,
)

POLL_S = 0.002


class LinkWire:
    """A serial port as identify.Wire."""

    def __init__(self, link: Link) -> None:
        self._link = link

    @property
    def session(self) -> Session:
        """The link's."""
        return self._link.session

    @property
    def now(self) -> float:
        """Seconds on the host's clock."""
        return time.monotonic()

    def request(self, message: protocol.Message) -> None:
        """Sends a message."""
        self._link.request(message)

    def poll(self) -> list[Telemetry]:
        """What has arrived, waiting a little for the first byte."""
        return self._link.poll(POLL_S)


def connect(port: str) -> Link:
    """An open link after the handshake."""
    link = Link(port, time.monotonic)
    try:
        link.meet()
    except BaseException:
        link.close()
        raise
    return link


def read_params(link: Link) -> dict[str, float]:
    """All of the firmware's parameters, in their units."""
    return {name: params.read(link, spec) for name, spec in protocol.PARAMS.items()}


def write_params(link: Link, values: dict[str, float]) -> None:
    """Sets parameters and reads each one back. UserError where the firmware holds another value."""
    for name, value in values.items():
        spec = protocol.PARAMS[name]
        held = params.write(link, spec, value)
        if spec.to_raw(held) != spec.to_raw(value):
            raise UserError(f"{name}: wrote {value:g}, but the firmware holds {held:g}")


def measure(
    link: Link, name: str, console: Console, values: dict[str, float]
) -> tuple[Findings, ActuatorModel]:
    """Experiments and fit on the machine at a link; `values`: its parameters."""
    with (
        console.status("the steering will move; keep clear") as status,
        armed(LinkWire(link), name, values) as experimenter,
    ):
        experimenter.say = lambda text: status.update(f"identifying: {text} (Ctrl-C stops)")
        findings = experimenter.identify()
    return findings, fit(findings)


def table(model: ActuatorModel) -> Table:
    """The model, its uncertainty as one standard deviation."""
    rows = [
        ("gain", f"{model.gain_degps:.4f}", "deg/s per count of duty"),
        ("slew at full duty", f"{model.slew_degps:.1f}", "deg/s"),
        ("time constant", f"{model.lag_s:.4f}", "s"),
        ("dead time", f"{model.dead_time_s:.4f}", "s"),
        ("minimum duty left", f"{model.min_left:.1f} ± 0.5", "counts of 255"),
        ("minimum duty right", f"{model.min_right:.1f} ± 0.5", "counts of 255"),
        ("friction in motion", f"{model.friction_duty:.1f}", "counts of 255"),
        ("backlash", f"{model.backlash_deg:.2f}", "deg"),
        ("noise of the angle", f"{model.noise_deg:.3f}", "deg, sd"),
        ("fit", f"{model.fit_rms_deg:.3f}", "deg, rms"),
        ("took", f"{model.duration_s:.1f}", "s"),
    ]
    out = Table(title="steering actuator")
    for column in ("figure", "value", "unit"):
        out.add_column(column)
    for row in rows:
        out.add_row(*row)
    return out


def draw(findings: Findings, model: ActuatorModel, path: Path) -> None:
    """Measured against fitted, run by run."""
    import matplotlib  # noqa: PLC0415

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415

    runs = findings.runs
    columns = 4
    lines = -(-len(runs) // columns)
    figure, grid = plt.subplots(lines, columns, figsize=(15, 2.8 * lines), squeeze=False)
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
    figure.tight_layout()
    figure.savefig(path, dpi=80)
    plt.close(figure)


def calibrate(
    link: Link, name: str, stop_deg: float, values: dict[str, float], console: Console
) -> PotCalibration:
    """Drives gently into both stops and writes the calibration. Meanwhile the angles are scaled
    down, so that the angle limit of the identification mode does not end the search."""
    wide = {"angle_left": 10.0, "angle_right": -10.0}
    kept = {key: values[key] for key in wide}
    _recalibrate(link, wide)
    try:
        with armed(LinkWire(link), name, values) as experimenter:
            console.print("driving gently into both stops; keep clear")
            found = calibrate_pot(experimenter, values | wide, stop_deg)
    except BaseException:
        link.request(protocol.Stop())
        _recalibrate(link, kept)
        raise
    _recalibrate(link, found.params())
    return found


def _recalibrate(link: Link, values: dict[str, float]) -> None:
    """Another calibration makes the reading jump, which the firmware takes for a fault; a fault
    that has another reason comes back."""
    write_params(link, values)
    link.ask(protocol.Clear())


@click.command()
@port_option
@click.option(
    "--stops",
    "stop_deg",
    type=click.FloatRange(10, 80),
    metavar="DEG",
    help="First calibrate the potentiometer: the wheel's angle at its mechanical stops.",
)
@click.option("--save", "keep", is_flag=True, help="Store the calibration in the EEPROM.")
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("out/identify"), show_default=True
)
def identify(port: str, stop_deg: float | None, keep: bool, out: Path) -> None:
    """Measures the steering: raw-PWM experiments of some 50 s, the wheels off the ground or the
    machine standing on smooth ground. Writes model.json and fit.png for `daranti tune pid`."""
    console = Console()
    with connect(port) as link:
        values = read_params(link)
        if stop_deg is not None:
            found = calibrate(link, port, stop_deg, values, console)
            values |= found.params()
            console.print(
                f"potentiometer: left stop {found.left_counts:.1f}, centre "
                f"{found.centre_counts:.1f}, right stop {found.right_counts:.1f} counts"
            )
            if keep:
                params.save(link)
        findings, model = measure(link, port, console, values)
    out.mkdir(parents=True, exist_ok=True)
    model.save(out / "model.json")
    draw(findings, model, out / "fit.png")
    console.print(table(model))
    click.echo(f"written to {out}: model.json, fit.png")
