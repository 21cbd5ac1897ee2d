"""`daranti-hil rig`: the machine on the desk in wall-clock time, for the unmodified host.

Firmware and plant run behind a pseudo-terminal, which pyserial opens like /dev/ttyACM0, and a
simulated phone serves picture and positions. The bench is the lockstep one; here the wall clock
advances it, ten milliseconds at a time, each slice at its deadline. A late slice is caught up; a
rig that falls farther behind lets its time slip, and says so.
"""

from __future__ import annotations

import contextlib
import json
import os
import pty
import socket
import time
import tty
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final, Protocol

import click
import numpy as np
import serial
from serial.rfc2217 import PortManager

from hil.bench.lockstep import SLICE_US, Bench
from hil.firmware.real_board import PREFIX, Board
from hil.judge import pictures
from hil.scenario import scenario
from hil.scenario.scenario import Scenario
from host.core.errors import UserError
from host.core.vehicle_file import save_vehicle
from host.pilot.pilot import Phase
from host.sensors.nmea import LocalFrame
from sim_plant.camera import Camera, Shot
from sim_plant.field import FieldSpec
from sim_plant.phone import Phone, PhoneSpec

SLICE_S: Final = SLICE_US * 1e-6
FIX_SLICES: Final = round(1.0 / SLICE_S)
TRACK_SLICES: Final = 10
BEHIND_S: Final = 0.05
"""Farther behind than this the rig does not catch up: its time slips. Caught up in a burst, a pause
of the rig would be one of the host, whose commands of all that time arrive at once; the firmware's
watchdog ends that after 0.25 s."""
NETWORK: Final = ("socket", "rfc2217")
IN_THE_MAKING: Final = 2
"""Pictures developed or waiting for it."""
BACKLOG_BYTES: Final = 4096
"""What a real USB serial adapter keeps for a reader that does not read."""


# ---- the serial port's near end ------------------------------------------------------------------


class Port(Protocol):
    """The cable: bytes both ways, neither blocking. What nobody reads is lost, as on a real one."""

    name: str

    def read(self) -> bytes:
        """What the host has sent since."""
        ...

    def write(self, data: bytes) -> None:
        """To the host."""
        ...

    def close(self) -> None:
        """Unplugs."""
        ...


class PseudoTerminal:
    """A port that pyserial opens by its name."""

    def __init__(self, link: Path | None = None) -> None:
        """`link`: a symbolic link to keep at the same name from run to run."""
        self._master, self._slave = pty.openpty()  # the slave stays open: hosts come and go
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.name = os.ttyname(self._slave)
        self._link = link
        if link is not None:
            try:
                if link.is_symlink():
                    link.unlink()
                link.symlink_to(self.name)
            except OSError as error:
                raise UserError(f"cannot link {link} to the port: {error.strerror}") from error
            self.name = str(link)

    def read(self) -> bytes:
        with contextlib.suppress(BlockingIOError):
            return os.read(self._master, BACKLOG_BYTES)
        return b""

    def write(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, data)

    def close(self) -> None:
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        os.close(self._master)
        os.close(self._slave)


class TcpPort:
    """A port that pyserial opens as socket://HOST:PORT, for a host on another machine. One client
    at a time; when it leaves, the next may come."""

    SCHEME = "socket"

    def __init__(self, port: int, host: str = "0.0.0.0") -> None:
        try:
            self._listener = socket.create_server((host, port))
        except OSError as error:
            raise UserError(f"cannot serve TCP port {port}: {error.strerror}") from error
        self._listener.setblocking(False)
        self._peer: socket.socket | None = None
        self.name = f"{self.SCHEME}://{host}:{self._listener.getsockname()[1]}"

    def read(self) -> bytes:
        if self._peer is None:
            with contextlib.suppress(BlockingIOError):
                peer, _ = self._listener.accept()
                peer.setblocking(False)
                peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._peer = peer
                self._greet()
            return b""
        try:
            data = self._peer.recv(BACKLOG_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._hang_up()
        return self._received(data)

    def write(self, data: bytes) -> None:
        self._send(self._to_send(data))

    def _greet(self) -> None:
        """A client has come."""

    def _received(self, data: bytes) -> bytes:
        """What of a client's bytes is meant for the firmware."""
        return data

    def _to_send(self, data: bytes) -> bytes:
        """The firmware's bytes as the client expects them."""
        return data

    def _send(self, data: bytes) -> None:
        if self._peer is None:
            return
        try:
            self._peer.send(data)
        except BlockingIOError:
            pass
        except OSError:
            self._hang_up()

    def _hang_up(self) -> None:
        if self._peer is not None:
            self._peer.close()
            self._peer = None

    def close(self) -> None:
        self._hang_up()
        self._listener.close()


class Rfc2217Port(TcpPort):
    """The same with the port's settings in the stream (RFC 2217): rfc2217://HOST:PORT."""

    SCHEME = "rfc2217"

    def _greet(self) -> None:
        settings: Any = serial.serial_for_url("loop://")  # remembers baud rate and lines only
        network: Any = SimpleNamespace(write=self._send)
        self._manager = PortManager(settings, network)

    def _received(self, data: bytes) -> bytes:
        return b"".join(self._manager.filter(data))

    def _to_send(self, data: bytes) -> bytes:
        return b"" if self._peer is None else b"".join(self._manager.escape(data))


# ---- time ----------------------------------------------------------------------------------------


@dataclass
class Deadlines:
    """How well the wall clock was kept."""

    late_s: list[float] = field(default_factory=list)
    """Per slice: from its deadline to its beginning."""
    slipped_s: float = 0.0
    """Wall time that was given up."""
    pictures_skipped: int = 0

    def summary(self) -> dict[str, float | int]:
        """Lateness in ms, slices that began more than a slice late, and the time given up."""
        late = np.array(self.late_s or [0.0])
        return {
            "slices": len(self.late_s),
            "late_median_ms": round(float(np.median(late)) * 1e3, 3),
            "late_p99_ms": round(float(np.percentile(late, 99)) * 1e3, 3),
            "late_worst_ms": round(float(late.max()) * 1e3, 3),
            "deadlines_missed": int((late > SLICE_S).sum()),
            "slipped_s": round(self.slipped_s, 3),
            "pictures_skipped": self.pictures_skipped,
        }


# ---- the rig -------------------------------------------------------------------------------------


def _develop(camera: Camera, shot: Shot) -> bytes:
    return camera.encode(camera.develop(shot))


class Rig:
    """Bench, ports and phone in wall-clock time. `clock` and `wait` are the wall's; a test may hand
    in its own."""

    def __init__(
        self,
        bench: Bench,
        ports: list[Port],
        phone: Phone,
        *,
        factor: float = 1.0,
        clock: Callable[[], float] = time.monotonic,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        """`factor`: simulated seconds per second."""
        self.bench = bench
        self.deadlines = Deadlines()
        self.track: list[tuple[float, float, float, float, Phase]] = []
        """(t, x, y, yaw, -) of the rear axle, truly; what the pilot does is not known here."""
        self._ports = ports
        self._phone = phone
        self._period = SLICE_S / factor
        self._clock = clock
        self._wait = wait
        self._pool = ThreadPoolExecutor(1)
        self._pictures: deque[tuple[float, float, Future[bytes]]] = deque()
        """(when it is due, its shutter in simulated time, the picture in the making)."""
        fps = bench.scenario.lens_truth.fps
        self._picture_slices = max(1, round(1 / fps / SLICE_S))
        self._delay = bench.scenario.vehicle.camera_delay_s / factor

    def run(self, duration_s: float | None = None) -> None:
        """Until `duration_s` of simulated time have passed, or for ever."""
        start = round(self.bench.now / SLICE_S)
        count = None if duration_s is None else round(duration_s / SLICE_S)
        due = self._clock()
        done = 0
        while count is None or done < count:
            done += 1
            due += self._period
            now = self._clock()
            if now < due:
                self._wait(due - now)
                now = self._clock()
            late = now - due
            self.deadlines.late_s.append(late)
            if late > BEHIND_S:
                self.deadlines.slipped_s += late
                due = now
            self._slice(start + done, now)

    def _slice(self, number: int, now: float) -> None:
        bench = self.bench
        for port in self._ports:
            bench.send(port.read())
        for _, data in bench.advance(number * SLICE_S):
            for port in self._ports:
                port.write(data)
        if number % self._picture_slices == 0:
            self._shoot(now)
        if number % FIX_SLICES == 0:
            self._phone.say(bench.fix())
        if number % TRACK_SLICES == 0:
            self.track.append((bench.now, *bench.pose, Phase.CONNECT))
        due = None
        if self._pictures and self._pictures[0][0] <= now and self._pictures[0][2].done():
            _, shutter, work = self._pictures.popleft()
            due = (shutter, work.result())
        seen = bench.faults.camera(bench.now, due)
        if seen is not None:
            self._phone.show(seen[1])

    def _shoot(self, now: float) -> None:
        """Begins a picture; a machine too slow to develop them all loses some, as a phone does, and
        shows none late."""
        if sum(not work.done() for _, _, work in self._pictures) >= IN_THE_MAKING:
            self.deadlines.pictures_skipped += 1
            return
        work = self._pool.submit(_develop, self.bench.camera, self.bench.shutter())
        self._pictures.append((now + self._delay, self.bench.now, work))

    def close(self) -> None:
        """Ends the picture worker."""
        self._pool.shutdown(cancel_futures=True)


def handouts(chosen: Scenario, out: Path) -> dict[str, str]:
    """Writes what the operator of this machine would have: vehicle.yaml with the calibrated camera
    and boundary.geojson. Returns the options for `daranti drive`."""
    out.mkdir(parents=True, exist_ok=True)
    mounts = chosen.vehicle.mounts | {chosen.camera: chosen.mount}
    save_vehicle(out / "vehicle.yaml", chosen.vehicle.model_copy(update={"mounts": mounts}))
    frame = LocalFrame(chosen.gnss.lat_deg, chosen.gnss.lon_deg)
    rings = [
        [frame.to_wgs84(x, y)[::-1] for x, y in (*ring, ring[0])]
        for ring in (chosen.corners(), *chosen.field.keep_outs)
    ]
    polygon = {"type": "Polygon", "coordinates": rings}
    (out / "boundary.geojson").write_text(json.dumps(polygon), encoding="utf-8")
    return {
        "vehicle": str(out / "vehicle.yaml"),
        "mount": chosen.camera,
        "mode": chosen.mode,
        "boundary": str(out / "boundary.geojson"),
        "corner": str(chosen.start.corner),
        "gap": str(chosen.field.gap_m),
    }


def rehearse(chosen: Scenario) -> None:
    """Does once, on a field of its own, all that a run does: what is compiled at its first use
    would halt the clock for seconds."""
    small = FieldSpec(size_m=(3.0, 3.0))
    with Bench(chosen.model_copy(update={"field": small, "faults": ()})) as bench:
        bench.advance(2 * SLICE_S)
        _develop(bench.camera, bench.shutter())
        x, y, yaw = 1.0, 1.0, 0.0
        bench.field.cut((x, y, yaw), (x + 0.1, y, yaw), ahead_m=0.5, width_m=1.0)
        _develop(bench.camera, bench.shutter())
        bench.fix()


@click.command()
@click.option("--scenario", "name", default="default", show_default=True, metavar="NAME|FILE")
@click.option("--firmware", metavar="desk|avr|serial:PORT", help="A build, or a real board.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), help="Of field, sensors and errors.")
@click.option("--camera", metavar="low|mast", help="Camera mount, by its name in the vehicle file.")
@click.option("--duration", type=click.FloatRange(0, min_open=True), help="Seconds; else Ctrl-C.")
@click.option(
    "--realtime-factor",
    "factor",
    type=click.FloatRange(0, min_open=True),
    default=1.0,
    show_default=True,
)
@click.option("--link", type=click.Path(path_type=Path), help="Symbolic link to the port.")
@click.option("--tcp", type=click.IntRange(0, 65535), help="Serve the serial port over TCP, too.")
@click.option("--rfc2217", type=click.IntRange(0, 65535), help="The same as RFC 2217.")
@click.option("--http-port", type=click.IntRange(0, 65535), default=0, help="0: any free one.")
@click.option("--nmea-port", type=click.IntRange(0, 65535), default=0, help="0: any free one.")
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
    out: Path,
    **options: Any,
) -> None:
    """The whole machine behind a serial port and a phone, in wall-clock time.

    Prints the port and the addresses and writes them to OUT/rig.json; at the end the true result
    and how well the clock was kept."""
    real = firmware.removeprefix(PREFIX) if firmware and firmware.startswith(PREFIX) else None
    overrides = options | ({"firmware": firmware} if real is None else {})
    chosen = scenario.load(name, {k: v for k, v in overrides.items() if v is not None})
    if any(fault.at.state is not None for fault in chosen.faults):
        raise UserError(
            f"{name}: faults: the rig does not see the pilot's state; give at.time_s or at.place"
        )
    rehearse(chosen)
    board = Board(real, chosen.firmware_parameters) if real is not None else None
    with Bench(chosen, board=board) as bench:
        with ExitStack() as plugged:
            ports: dict[str, Port] = {"port": PseudoTerminal(link)}
            plugged.callback(ports["port"].close)
            for kind, number in ((TcpPort, tcp), (Rfc2217Port, rfc2217)):
                if number is not None:
                    served = ports[kind.SCHEME] = kind(number)
                    plugged.callback(served.close)
            phone = plugged.enter_context(_phone(http_port, nmea_port))
            machine = Rig(bench, list(ports.values()), phone, factor=factor)
            plugged.callback(machine.close)
            phone.show(_develop(bench.camera, bench.shutter()))
            addresses = {kind: port.name for kind, port in ports.items()}
            addresses |= {"camera": phone.camera_url, "gnss": phone.gnss_url}
            _announce(addresses | handouts(chosen, out), out)
            with contextlib.suppress(KeyboardInterrupt):  # the way to end it
                machine.run(duration)
        _report(machine, out)


def _phone(http_port: int, nmea_port: int) -> Phone:
    try:
        return Phone(PhoneSpec(http_port=http_port, nmea_port=nmea_port, delay_s=0.0))
    except OSError as error:
        raise UserError(
            f"cannot serve the phone on ports {http_port} and {nmea_port}: {error.strerror}"
        ) from error


def _announce(about: dict[str, str], out: Path) -> None:
    """Says, and writes to rig.json, how to reach the machine; the command comes last."""
    (out / "rig.json").write_text(json.dumps(about, indent=1), encoding="utf-8")
    for key, value in about.items():
        click.echo(f"{key:9} {value}")
    line = " ".join(f"--{key} {value}" for key, value in about.items() if key not in NETWORK)
    click.echo(f"drive it: daranti drive {line}")


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
    for key, value in summary.items():
        click.echo(f"{key:18} {value}")
    (out / "summary.json").write_text(json.dumps(summary, indent=1), encoding="utf-8")
    if len(machine.track) > 1:
        title = f"rig: coverage {summary['coverage']:.3f}"
        pictures.draw_map(out / "map.png", crop, machine.track, title)
