"""The rig's machine and all the ways to it: serial ports, the phone, the files of its owner."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from hil.bench.lockstep import Bench
from hil.bench.ports import Port, PseudoTerminal, Rfc2217Port, TcpPort
from hil.bench.rig import Rig, develop, handouts, rehearse
from hil.firmware.real_board import PREFIX, Board
from hil.scenario.scenario import Scenario
from host.core.errors import UserError
from sim_plant.phone import Phone, PhoneSpec

AnyRig = TypeVar("AnyRig", bound=Rig)


@dataclass(frozen=True, slots=True)
class Ways:
    """Where the machine is served. Port 0: any free one."""

    link: Path | None = None
    """Symbolic link to the pseudo-terminal."""
    tcp: int | None = None
    rfc2217: int | None = None
    http_port: int = 0
    nmea_port: int = 0
    host: str = "127.0.0.1"
    """Who may come, for all network ports; 0.0.0.0: every machine."""


@dataclass(frozen=True, slots=True)
class Served(Generic[AnyRig]):
    """A machine that can be reached and does not run yet."""

    machine: AnyRig
    about: dict[str, str]
    """Its ports and addresses and its owner's files, by the options of `daranti drive`."""


@contextmanager
def served(
    chosen: Scenario,
    out: Path,
    kind: type[AnyRig],
    ways: Ways | None = None,
    *,
    board: str | None = None,
    factor: float = 1.0,
    tend: Callable[[Bench], None] = lambda _: None,
) -> Iterator[Served[AnyRig]]:
    """The machine of a scenario, served for as long as the context lasts. `board`: the port of a
    real one. `tend` is called ten times a simulated second. UserError where a port is taken."""
    ways = ways or Ways()
    rehearse(chosen)
    real = Board(board, chosen.told.parameters) if board is not None else None
    with Bench(chosen, board=real) as bench, ExitStack() as plugged:
        ports: dict[str, Port] = {"port": PseudoTerminal(ways.link)}
        plugged.callback(ports["port"].close)
        for one, number in ((TcpPort, ways.tcp), (Rfc2217Port, ways.rfc2217)):
            if number is not None:
                port = ports[one.SCHEME] = one(number, ways.host)
                plugged.callback(port.close)
        phone = plugged.enter_context(_phone(ways))
        machine = kind(bench, list(ports.values()), phone, factor=factor, tend=lambda: tend(bench))
        plugged.callback(machine.close)
        phone.show(develop(bench.camera, bench.shutter()))
        addresses = {name: port.name for name, port in ports.items()}
        addresses |= {"camera": phone.camera_url, "gnss": phone.gnss_url}
        yield Served(machine, addresses | handouts(chosen, out))


def _phone(ways: Ways) -> Phone:
    spec = PhoneSpec(
        host=ways.host, http_port=ways.http_port, nmea_port=ways.nmea_port, delay_s=0.0
    )
    try:
        return Phone(spec)
    except OSError as error:
        raise UserError(
            f"cannot serve the phone on ports {ways.http_port} and {ways.nmea_port} of "
            f"{ways.host}: {error.strerror}"
        ) from error


def board_of(firmware: str | None) -> str | None:
    """The port of a real board where `firmware` names one, None for a build. UserError for anything
    else."""
    if firmware is not None and firmware.startswith(PREFIX):
        return firmware.removeprefix(PREFIX)
    if firmware not in (None, "desk", "avr"):
        raise UserError(f"--firmware {firmware}: give desk, avr or serial:PORT of a real board")
    return None


def summary_of(machine: Rig) -> dict[str, Any]:
    """What was truly harvested, and how well the clock was kept."""
    crop, faults = machine.bench.field, machine.bench.faults
    return {
        "simulated_s": round(machine.bench.now, 3),
        "coverage": round(float(crop.coverage()), 4),
        "missed_m2": round(float(crop.missed_m2()), 4),
        "neighbour_cut_m2": round(float(crop.neighbour_cut_m2()), 4),
        "pose": [round(value, 3) for value in machine.bench.pose],
        **machine.deadlines.summary(),
        "faults_injected": [
            (
                f"{event.stamp:.2f} s",
                faults.faults[event.index].name,
                "begins" if event.begins else "ends",
            )
            for event in faults.events
        ],
    }
