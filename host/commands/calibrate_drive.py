"""`daranti calibrate drive`: what the drive gives at which duty, the wheels' sensor and the
steering's middle, from four ways on free ground and a tape."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import click
from rich.table import Table

from host.commands.moving import asked, consent, count_down, countdown_option, stopped_after
from host.commands.options import port_option, written_vehicle_option
from host.core.number_range import NumberRange
from host.core.output_place import check_file
from host.core.terminal import PlainConsole, echo
from host.core.vehicle import Vehicle
from host.core.vehicle_file import load_vehicle, save_vehicle
from host.link.params import read_all, save
from host.link.port import check_port
from host.link.session import Link, connect
from host.runs.operator import Operator
from host.runs.ready import make_ready_visibly
from host.tune.measured_drive import MeasuredDrive, Taped, Way, measure_drive, ways
from host.tune.on_machine import LinkWire, recalibrate

RESERVE: Final = 1.3
"""Of the cutting speed, that full duty gives on level ground: crop, a slope and an empty battery
take the rest."""
FARTHEST_M: Final = 100.0
"""Of a tape."""
ROOM: Final = (
    "it does not see people, animals or posts: it needs firm, level ground, 3 m more than that "
    "ahead, and nobody within 10 m. Switch the blade's own supply off, lay a tape along its "
    "middle, from the rear axle straight ahead, keep a hand at the emergency stop"
)


class Beside:
    """The operator at the terminal, who tapes the ways; the link is kept alive meanwhile."""

    def __init__(self, operator: Operator, link: Link, countdown_s: int) -> None:
        self._operator = operator
        self._link = link
        self._countdown_s = countdown_s

    def ready(self, way: Way) -> None:
        """Whoever has taped the last way stands in this one: it is told, and counted down. The
        first was when the operator agreed."""
        echo(str(way))
        if way.number > 0:
            count_down(self._operator, self._link, self._countdown_s, f"{way}: broken off")

    def tape(self, way: Way) -> Taped:
        """What the tape says."""
        along = self._number(
            f"{way}: it stands. By the tape, how far has it come along the line, m?", 0.0
        )
        if way.number > 0:
            return Taped(along)
        aside = "and how far to the left of the line, m? (to the right: a minus; Enter: 0)"
        return Taped(along, self._number(aside, -FARTHEST_M, "0"))

    def _number(self, question: str, least: float, usual: str = "") -> float:
        while True:
            typed = self._operator.answer(question, self._link) or usual
            try:
                return NumberRange(least, FARTHEST_M).convert(typed, None, None)
            except click.UsageError as error:
                echo(f"{error.message}; type it again", err=True)


def _table(found: MeasuredDrive, vehicle: Vehicle, before: Mapping[str, float]) -> Table:
    curve, taped = found.curve, found.taped
    told = found.told(vehicle)
    rows = [
        ("speed at full duty, m/s", vehicle.full_duty_speed_mps, told.full_duty_speed_mps,
         f"{curve.full_sigma:.3f}"),
        ("duty that just moves it, of 255", before["drive_min_duty"], curve.min_duty,
         f"{255 * curve.dead_sigma:.1f}"),
        ("steering straight ahead, pot counts", before["pot_centre"],
         found.params(before)["pot_centre"], ""),
    ]  # fmt: skip
    if curve.lag_s is not None:
        rows.append(("lag of the speed, s", vehicle.drive_lag_s, told.drive_lag_s, ""))
    if taped.pulses_per_m is not None:
        sigma = f"{taped.pulses_sigma:.1f}"
        rows.append(
            ("wheel sensor, pulses a metre", before["hall_per_metre"], taped.pulses_per_m, sigma)
        )
    table = Table(title="the drive")
    for column in ("figure", "before", "found", "±"):
        table.add_column(column)
    for name, old, new, sigma in rows:
        table.add_row(name, f"{old:.4g}", f"{new:.4g}", sigma)
    return table


@click.command()
@port_option
@written_vehicle_option("what is found", required=True)
@click.option(
    "--length",
    "length_m",
    type=NumberRange(5, 50),
    default=10.0,
    show_default=True,
    help="Of each way, m.",
)
@click.option("--save", "keep", is_flag=True, help="Store the parameters in the EEPROM.")
@countdown_option
def calibrate_drive(
    port: str, vehicle: Path, length_m: float, keep: bool, countdown_s: int
) -> None:
    """Measures what the drive gives at which duty, the wheels' sensor and the steering's middle,
    and writes them into firmware and vehicle file.

    Put the machine on firm, level ground, a tape beside it. It drives ahead and back, slowly and at
    the cutting speed, its blade off, and asks what the tape says. Before each way it counts down.
    The machine does not see people, animals or posts: keep everybody 10 m away and stay beside the
    emergency stop.

    Ctrl-C stops at once. Exits with 0 when all was found, 2 where it could not start or the ways do
    not tell, 4 when a fault ended a way, 130 after Ctrl-C."""
    check_file(vehicle)
    machine = load_vehicle(vehicle if vehicle.exists() else None)
    check_port(port)
    operator = asked(yes=False)
    make_ready_visibly()
    with connect(port) as link:
        before = read_all(link)
        counted = before["hall_per_metre"] > 0
        fast_mps = min(machine.cutting_speed_mps, before["speed_max"])
        plan = ways(fast_mps, length_m, counted=counted)
        echo("the machine will drive " + ", ".join(map(str, plan)) + ", the blade off")
        echo(ROOM)
        if not counted:
            echo("it has no wheel sensor (hall_per_metre 0): each way is taped")
        consent(operator, link, countdown_s, yes=False)
        with stopped_after(link):
            hand = Beside(operator, link, countdown_s)
            found = measure_drive(
                LinkWire(link), port, machine, before, length_m, hand.tape, hand.ready
            )
        PlainConsole().print_table(_table(found, machine, before))
        recalibrate(link, found.params(before))
        if keep:
            save(link)
    save_vehicle(vehicle, found.told(machine))
    echo(f"{vehicle}: the drive is in it")
    echo("saved in the firmware" if keep else "not saved: lost at the next reset (`--save` keeps)")
    _warn(found, machine, vehicle)


def _warn(found: MeasuredDrive, machine: Vehicle, file: Path) -> None:
    """Where the drive is too weak for what the vehicle file asks of it."""
    least = RESERVE * machine.cutting_speed_mps
    if found.curve.full_mps < least:
        echo(
            f"full duty gives {found.curve.full_mps:.2f} m/s; cutting_speed_mps "
            f"{machine.cutting_speed_mps:g} wants {least:.2f}, for crop, slopes and an emptier "
            f"battery. Set it to {found.curve.full_mps / RESERVE:.2f} in {file}",
            err=True,
        )
