"""`daranti-hil rig`: the machine in wall-clock time, for `daranti drive`."""

from __future__ import annotations

import contextlib
import json
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TextIO, cast

import click

from hil.bench.lockstep import Bench
from hil.bench.ports import NETWORK, Port, PseudoTerminal, Rfc2217Port, TcpPort
from hil.bench.rig import Rig, develop, handouts, rehearse
from hil.bench.typed_faults import USAGE, TypedFaults
from hil.firmware.real_board import PREFIX, Board
from hil.judge import pictures
from hil.scenario import scenario
from host.core.errors import UserError
from host.core.number_range import NumberRange
from host.core.progress import Watch
from host.core.terminal import Outlet, PlainConsole, echo
from sim_plant.phone import Phone, PhoneSpec


@click.command()
@click.option("--scenario", "name", default="default", show_default=True, metavar="NAME|FILE")
@click.option("--firmware", metavar="desk|avr|serial:PORT", help="A build, or a real board.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), help="Of field, sensors and errors.")
@click.option("--camera", metavar="low|mast", help="Camera mount, by its name in the vehicle file.")
@click.option("--duration", type=NumberRange(0, min_open=True), help="Seconds; else Ctrl-C.")
@click.option(
    "--realtime-factor",
    "factor",
    type=NumberRange(0, min_open=True),
    default=1.0,
    show_default=True,
)
@click.option("--link", type=click.Path(path_type=Path), help="Symbolic link to the port.")
@click.option("--tcp", type=click.IntRange(0, 65535), help="Serve the serial port over TCP, too.")
@click.option("--rfc2217", type=click.IntRange(0, 65535), help="The same as RFC 2217.")
@click.option("--http-port", type=click.IntRange(0, 65535), default=0, help="0: any free one.")
@click.option("--nmea-port", type=click.IntRange(0, 65535), default=0, help="0: any free one.")
@click.option(
    "--host",
    default="127.0.0.1",
    show_default=True,
    help="Who may come, for all network ports; 0.0.0.0: every machine.",
)
@click.option("--set", "settings", multiple=True, metavar="FIELD=VALUE", help="Any other field.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/rig"), show_default=True)
def rig(
    name: str,
    firmware: str | None,
    duration: float | None,
    factor: float,
    link: Path | None,
    tcp: int | None,
    rfc2217: int | None,
    http_port: int,
    nmea_port: int,
    host: str,
    settings: tuple[str, ...],
    out: Path,
    **options: Any,
) -> None:
    """The whole machine behind a serial port and a phone, in wall-clock time.

    Prints the port and the addresses and writes them to OUT/rig.json; at the end the true result
    and how well the clock was kept. Faults can be typed while it runs, such as `pot off for=3`;
    `list` says what is broken, `end` mends it."""
    real = firmware.removeprefix(PREFIX) if firmware and firmware.startswith(PREFIX) else None
    if real is None and firmware not in (None, "desk", "avr"):
        raise UserError(f"--firmware {firmware}: give desk, avr or serial:PORT of a real board")
    given = options | ({"firmware": firmware} if real is None else {})
    overrides = {k: v for k, v in given.items() if v is not None}
    for setting in settings:
        overrides = scenario.merge(overrides, scenario.assigned(setting))
    chosen = scenario.load(name, overrides)
    if any(fault.at.state is not None for fault in chosen.faults):
        raise UserError(
            f"{name}: faults: the rig does not see the pilot's state; give at.time_s or at.place"
        )
    rehearse(chosen)
    board = Board(real, chosen.told.parameters) if real is not None else None
    with Bench(chosen, board=board) as bench:
        with ExitStack() as plugged:
            ports: dict[str, Port] = {"port": PseudoTerminal(link)}
            plugged.callback(ports["port"].close)
            for kind, number in ((TcpPort, tcp), (Rfc2217Port, rfc2217)):
                if number is not None:
                    served = ports[kind.SCHEME] = kind(number, host)
                    plugged.callback(served.close)
            phone = plugged.enter_context(_phone(host, http_port, nmea_port))
            typed = TypedFaults(sys.stdin, echo)
            watch = plugged.enter_context(_watch(duration))

            def tend() -> None:
                typed.poll(bench.now, bench.faults, real is not None)
                watch.reach(bench.now, f"{100 * bench.field.coverage():.1f} % cut")

            machine = Rig(bench, list(ports.values()), phone, factor=factor, tend=tend)
            plugged.callback(machine.close)
            phone.show(develop(bench.camera, bench.shutter()))
            addresses = {kind: port.name for kind, port in ports.items()}
            addresses |= {"camera": phone.camera_url, "gnss": phone.gnss_url}
            _announce(addresses | handouts(chosen, out), out)
            echo(f"faults may be typed here while it runs: {USAGE}")
            with contextlib.suppress(KeyboardInterrupt):  # the way to end it
                machine.run(duration)
        _report(machine, out)


def _watch(duration: float | None) -> Watch:
    """A line now and then, on a terminal too, where faults are typed; it never waits for it."""
    console = PlainConsole(
        file=cast(TextIO, Outlet(sys.stderr)), force_terminal=False, soft_wrap=True
    )
    return Watch("rig", round(duration) if duration is not None else None, console)


def _phone(host: str, http_port: int, nmea_port: int) -> Phone:
    try:
        return Phone(PhoneSpec(host=host, http_port=http_port, nmea_port=nmea_port, delay_s=0.0))
    except OSError as error:
        raise UserError(
            f"cannot serve the phone on ports {http_port} and {nmea_port} of {host}: "
            f"{error.strerror}"
        ) from error


def _announce(about: dict[str, str], out: Path) -> None:
    """Says, and writes to rig.json, how to reach the machine; the command comes last."""
    (out / "rig.json").write_text(json.dumps(about, indent=1), encoding="utf-8")
    for key, value in about.items():
        echo(f"{key:9} {value}")
    line = " ".join(f"--{key} {value}" for key, value in about.items() if key not in NETWORK)
    echo(f"drive it: daranti drive {line}")


def _report(machine: Rig, out: Path) -> None:
    """What was truly harvested, and how well the clock was kept."""
    crop = machine.bench.field
    summary: dict[str, Any] = {
        "simulated_s": round(machine.bench.now, 3),
        "coverage": round(float(crop.coverage()), 4),
        "missed_m2": round(float(crop.missed_m2()), 4),
        "neighbour_cut_m2": round(float(crop.neighbour_cut_m2()), 4),
        "pose": [round(value, 3) for value in machine.bench.pose],
        **machine.deadlines.summary(),
    }
    faults = machine.bench.faults
    injected = [
        (f"{event.stamp:.2f} s", faults.faults[event.index].name,
         "begins" if event.begins else "ends")
        for event in faults.events
    ]  # fmt: skip
    for key, value in summary.items():
        echo(f"{key:18} {value}")
    summary["faults_injected"] = injected
    (out / "summary.json").write_text(json.dumps(summary, indent=1), encoding="utf-8")
    if len(machine.track) > 1:
        title = f"rig: coverage {summary['coverage']:.3f}"
        pictures.draw_map(out / "map.png", crop, machine.track, title)
