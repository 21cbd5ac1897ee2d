"""`daranti tune follow`: is the loop that follows the edge stable enough, by law and speed."""

from __future__ import annotations

import math
from pathlib import Path

import click
from rich.table import Table

from host.core.errors import UserError
from host.core.terminal import PlainConsole
from host.core.vehicle import Vehicle
from host.core.vehicle_file import load_vehicle
from host.tune.follow_margins import (
    DEAD_TIME_S,
    LAWS,
    PHASE_DEG,
    SPEEDS_MPS,
    at_cutting_speed,
    gains,
    margins,
    opened,
)


def table_of(vehicle: Vehicle) -> Table:
    """Gains and margins by law and speed."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("law", no_wrap=True)
    heads = ("m/s", "k offset", "k heading", "k curv.", "gain", "phase", "|S|", "damping", "2 % in")
    for head in heads:
        table.add_column(head, justify="right", no_wrap=True)
    for law in LAWS:
        for speed in SPEEDS_MPS:
            feedback = gains(law, speed, vehicle)
            found = margins(opened(feedback, speed, vehicle.steer_lag_s), speed)
            table.add_row(
                law,
                f"{speed:g}",
                *(f"{value:.2f}" for value in feedback),
                f"{found.gain_db:.1f} dB",
                f"{found.phase_deg:.0f}°",
                f"{found.sensitivity:.2f}",
                f"{found.damping:.2f}",
                f"{found.settling_m:.1f} m",
            )
    return table


@click.command()
@click.option("--vehicle", "path", type=click.Path(path_type=Path), help="The machine's file.")
def follow(path: Path | None) -> None:
    """Margins of the loop that follows the edge, by law and speed."""
    vehicle = load_vehicle(path)
    console = PlainConsole()
    console.print(
        f"frequency {vehicle.follow_frequency_1pm:g}/m, damping {vehicle.follow_damping:g}, "
        f"steering lag {vehicle.steer_lag_s:g} s, dead time {DEAD_TIME_S:g} s"
    )
    console.print_table(table_of(vehicle))
    speed, found = vehicle.cutting_speed_mps, at_cutting_speed(vehicle)
    console.print(
        f"this machine: {vehicle.steering_law} at {speed:g} m/s, phase margin "
        f"{found.phase_deg:.0f}°"
    )
    if found.phase_deg < PHASE_DEG or not math.isfinite(found.settling_m):
        raise UserError(
            f"the loop has less than {PHASE_DEG:g}° of phase margin at {speed:g} m/s: lower "
            "follow_frequency_1pm or cutting_speed_mps in the vehicle file"
        )
