"""`daranti-hil rig`: the machine in wall-clock time, for `daranti drive`."""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path
from typing import Any, TextIO, cast

import click

from hil.bench.alone import alone
from hil.bench.lockstep import Bench
from hil.bench.ports import NETWORK
from hil.bench.rig import Rig
from hil.bench.serving import Ways, board_of, served, summary_of
from hil.bench.typed_faults import USAGE, TypedFaults
from hil.firmware.provision import check_built
from hil.judge import pictures
from hil.scenario import scenario
from host.core.errors import UserError
from host.core.number_range import NumberRange, WholeRange
from host.core.output_place import check_folder
from host.core.progress import Watch
from host.core.terminal import Outlet, PlainConsole, echo
from host.core.whole_file import save_text


@click.command()
@click.option("--scenario", "name", default="default", show_default=True, metavar="NAME|FILE")
@click.option("--firmware", metavar="desk|avr|serial:PORT", help="A build, or a real board.")
@click.option("--seed", type=WholeRange(0, 2**31 - 1), help="Of field, sensors and errors.")
@click.option("--camera", metavar="low|mast", help="Camera mount, by its name in the vehicle file.")
@click.option("--duration", type=NumberRange(0, min_open=True), help="Seconds; else Ctrl-C.")
@click.option(
    "--realtime-factor",
    "factor",
    type=NumberRange(0, 1000, min_open=True),
    default=1.0,
    show_default=True,
)
@click.option("--link", type=click.Path(path_type=Path), help="Symbolic link to the port.")
@click.option("--tcp", type=WholeRange(0, 65535), help="Serve the serial port over TCP, too.")
@click.option("--rfc2217", type=WholeRange(0, 65535), help="The same as RFC 2217.")
@click.option("--http-port", type=WholeRange(0, 65535), default=0, help="0: any free one.")
@click.option("--nmea-port", type=WholeRange(0, 65535), default=0, help="0: any free one.")
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
    board = board_of(firmware)
    given = options | ({"firmware": firmware} if board is None else {})
    overrides = {k: v for k, v in given.items() if v is not None}
    for setting in settings:
        overrides = scenario.merge(overrides, scenario.assigned(setting))
    chosen = scenario.load(name, overrides)
    if any(fault.at.state is not None for fault in chosen.faults):
        raise UserError(
            f"{name}: faults: the rig does not see the pilot's state; give at.time_s or at.place"
        )
    check_folder(out)
    if board is None:
        check_built(chosen.firmware)
    ways = Ways(link, tcp, rfc2217, http_port, nmea_port, host)
    with alone(out, "rig"), _watch(duration) as watch:
        typed = TypedFaults(sys.stdin, echo)

        def tend(bench: Bench) -> None:
            typed.poll(bench.now, bench.faults, board is not None)
            watch.reach(bench.now, f"{100 * bench.field.coverage():.1f} % cut")

        with served(chosen, out, Rig, ways, board=board, factor=factor, tend=tend) as found:
            _announce(found.about, out)
            echo(f"faults may be typed here while it runs: {USAGE}")
            with contextlib.suppress(KeyboardInterrupt):  # the way to end it
                found.machine.run(duration)
        # A port that is open and silent is another fault than one that is gone: the map takes a
        # second.
        _report(found.machine, out)


def _watch(duration: float | None) -> Watch:
    """A line now and then, on a terminal too, where faults are typed; it never waits for it."""
    console = PlainConsole(
        file=cast(TextIO, Outlet(sys.stderr)), force_terminal=False, soft_wrap=True
    )
    return Watch("rig", round(duration) if duration is not None else None, console)


def _announce(about: dict[str, str], out: Path) -> None:
    """Says, and writes to rig.json, how to reach the machine; the command comes last."""
    save_text(out / "rig.json", json.dumps(about, indent=1))
    for key, value in about.items():
        echo(f"{key:9} {value}")
    line = " ".join(f"--{key} {value}" for key, value in about.items() if key not in NETWORK)
    echo(f"drive it: daranti drive {line}")


def _report(machine: Rig, out: Path) -> None:
    """Prints and keeps the summary, and draws where it went."""
    summary = summary_of(machine)
    for key, value in summary.items():
        if key != "faults_injected":
            echo(f"{key:18} {value}")
    save_text(out / "summary.json", json.dumps(summary, indent=1))
    if len(machine.track) > 1:
        title = f"rig: coverage {summary['coverage']:.3f}"
        pictures.draw_map(out / "map.png", machine.bench.field, machine.track, title)
