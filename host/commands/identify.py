"""`daranti identify`: the steering actuator's model, measured on the machine through a port."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import click
from rich.status import Status
from rich.table import Table

from host.commands.options import port_option
from host.core.number_range import NumberRange
from host.core.output_place import check_folder
from host.core.terminal import PlainConsole, echo
from host.link.params import read_all, save
from host.link.session import connect
from host.tune.actuator_model import ActuatorModel
from host.tune.on_machine import calibrate, measure
from host.tune.pictures import draw_fit


def telling(status: Status) -> Callable[[str], None]:
    """Shows what an experiment says beside the spinner."""
    return lambda text: status.update(f"identifying: {text} (Ctrl-C stops)")


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


@click.command()
@port_option
@click.option(
    "--stops",
    "stop_deg",
    type=NumberRange(10, 80),
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
    check_folder(out)
    console = PlainConsole()
    with connect(port) as link:
        values = read_all(link)
        if stop_deg is not None:
            console.print("driving gently into both stops; keep clear")
            found = calibrate(link, port, stop_deg, values)
            values |= found.params()
            console.print(
                f"potentiometer: left stop {found.left_counts:.1f}, centre "
                f"{found.centre_counts:.1f}, right stop {found.right_counts:.1f} counts"
            )
            if keep:
                save(link)
        with console.status("the steering will move; keep clear") as status:
            findings, model = measure(link, port, values, telling(status))
    out.mkdir(parents=True, exist_ok=True)
    model.save(out / "model.json")
    draw_fit(findings, model, out / "fit.png")
    console.print_table(table(model))
    echo(f"written to {out}: model.json, fit.png")
