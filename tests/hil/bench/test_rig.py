"""Facts about the wall-clock rig: its ports, its deadlines, and a drive against it."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import serial
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hil.bench.alone import alone
from hil.bench.harvest import harvest
from hil.bench.lockstep import SLICE_US, Bench
from hil.bench.ports import IN_THE_MAKING, NETWORK, Port, PseudoTerminal, Rfc2217Port, TcpPort
from hil.bench.rig import BEHIND_S, Deadlines, Rig, handouts
from hil.commands.rig import rig
from hil.firmware import targets
from hil.scenario import scenario
from host.core.errors import EXIT_FAULT, UserError
from host.core.frames import LocalFrame
from host.core.vehicle_file import load_vehicle
from host.field.boundary_file import load_field
from host.link import protocol
from host.link.session import Link
from host.pilot.phase import Phase
from host.route.field_plan import plan_of
from sim_plant.camera import Camera, Shot
from sim_plant.phone import Phone, PhoneSpec

LIMIT_S = 10.0
HARVEST_S = 1500.0
"""Twice what the default harvest takes."""
SLICE_S = SLICE_US * 1e-6

needs_firmware = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built: make firmware"
)


def until(port: Port, expected: bytes) -> bytes:
    """Reads until the expected bytes are there, or the limit has passed."""
    deadline = time.monotonic() + LIMIT_S
    got = b""
    while expected not in got and time.monotonic() < deadline:
        got += port.read()
    return got


# ---- ports ---------------------------------------------------------------------------------------


def opened(near: Port) -> serial.Serial:
    """The far end; the near end is served meanwhile, as by the rig, for RFC 2217 negotiates."""
    with ThreadPoolExecutor(1) as pool:
        far = pool.submit(serial.serial_for_url, near.name, timeout=LIMIT_S)
        while not wait([far], SLICE_S).done:
            near.read()
        return far.result()


@pytest.mark.filterwarnings("ignore:set:DeprecationWarning")  # pyserial's own, in rfc2217
@pytest.mark.parametrize("kind", ["pty", "tcp", "rfc2217"])
def test_bytes_pass_both_ways_unchanged(kind: str) -> None:
    near: Port
    if kind == "pty":
        near = PseudoTerminal()
    else:
        near = (TcpPort if kind == "tcp" else Rfc2217Port)(0, "127.0.0.1")
    every = bytes(range(256))
    with opened(near) as far:
        far.write(every)
        assert until(near, every) == every
        near.write(every)
        assert far.read(256) == every
    near.close()


@pytest.mark.filterwarnings("ignore:set:DeprecationWarning")
@pytest.mark.parametrize("kind", [PseudoTerminal, TcpPort, Rfc2217Port])
def test_the_hosts_link_works_on_every_port(kind: type[Any]) -> None:
    near: Port = kind() if kind is PseudoTerminal else kind(0, "127.0.0.1")
    version = protocol.Version(protocol.VERSION, 1, 0, 1, 1, 0, 0)

    def meet() -> protocol.Version:
        with Link(near.name, time.monotonic) as link:
            return link.meet(LIMIT_S)

    parser = protocol.Parser()
    with ThreadPoolExecutor(1) as pool:
        met = pool.submit(meet)
        while not wait([met], SLICE_S).done:
            for _, message in parser.feed(near.read()):
                if isinstance(message, protocol.Hello):
                    near.write(protocol.encode(version, 0))
        assert met.result() == version
    near.close()


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 12), st.binary(max_size=2)), min_size=2, max_size=9))
def test_no_negotiation_ends_the_rig(options: list[tuple[int, bytes]]) -> None:
    """RFC 2217: IAC SB COM-PORT-OPTION, a command, its value, IAC SE."""
    near = Rfc2217Port(0)
    address = ("127.0.0.1", int(near.name.rsplit(":", 1)[1]))
    with socket.create_connection(address, LIMIT_S) as far:
        for option, value in options:
            far.sendall(b"\xff\xfa\x2c" + bytes([option]) + value + b"\xff\xf0")
        for _ in range(6):
            near.read()
    near.close()


def test_a_negotiation_without_end_is_cut_off() -> None:
    near = Rfc2217Port(0)
    address = ("127.0.0.1", int(near.name.rsplit(":", 1)[1]))
    with socket.create_connection(address, LIMIT_S) as far, ThreadPoolExecutor(1) as pool:

        def left_alone() -> bool:
            with contextlib.suppress(ConnectionResetError):
                while far.recv(1000):
                    pass
            return True

        far.sendall(b"\xff\xfa\x2c" + 9000 * b"x")
        far.settimeout(LIMIT_S)
        gone = pool.submit(left_alone)
        while not wait([gone], SLICE_S).done:
            near.read()
        assert gone.result()
    near.close()


def test_a_host_may_come_back() -> None:
    near = PseudoTerminal()
    for _ in range(2):
        with serial.Serial(near.name, timeout=LIMIT_S) as far:
            far.write(b"hello")
            assert until(near, b"hello") == b"hello"
    near.close()


def test_a_client_may_come_back_over_tcp() -> None:
    near = TcpPort(0, "127.0.0.1")
    address = ("127.0.0.1", int(near.name.rsplit(":", 1)[1]))
    for _ in range(2):
        with socket.create_connection(address, LIMIT_S) as far:
            far.sendall(b"hello")
            assert until(near, b"hello") == b"hello"
        assert near.read() == b""
    near.close()


def test_what_nobody_reads_is_lost_and_does_not_block() -> None:
    for near in (PseudoTerminal(), TcpPort(0, "127.0.0.1")):
        for _ in range(1000):
            near.write(bytes(1000))
        near.close()


def test_closing_the_rig_is_an_unplugged_port_for_the_host() -> None:
    near = PseudoTerminal()
    with serial.Serial(near.name, timeout=LIMIT_S) as far:
        near.close()
        with pytest.raises((OSError, serial.SerialException)):
            far.read(1)


def test_the_link_keeps_its_name_and_goes_with_the_port(tmp_path: Path) -> None:
    link = tmp_path / "ttyDARANTI"
    link.symlink_to("/dev/null/left-over")
    near = PseudoTerminal(link)
    assert near.name == str(link)
    with serial.Serial(str(link), timeout=LIMIT_S) as far:
        far.write(b"hello")
        assert until(near, b"hello") == b"hello"
    near.close()
    assert not link.is_symlink()


def test_a_link_that_leads_somewhere_stays_as_it_is(tmp_path: Path) -> None:
    link = tmp_path / "ttyDARANTI"
    near = PseudoTerminal(link)
    with pytest.raises(UserError, match="perhaps another rig's port"):
        PseudoTerminal(link)
    assert str(link.readlink()).startswith("/dev/pts/")
    near.close()
    (tmp_path / "notes").write_text("mine")
    link.symlink_to(tmp_path / "notes")
    with pytest.raises(UserError, match="notes already"):
        PseudoTerminal(link)
    assert link.read_text() == "mine"


def test_a_port_that_ends_leaves_another_ones_link_alone(tmp_path: Path) -> None:
    link = tmp_path / "ttyDARANTI"
    near = PseudoTerminal(link)
    link.unlink()
    other = PseudoTerminal(link)
    near.close()
    assert link.is_symlink()
    other.close()
    assert not link.is_symlink()


def test_a_link_or_tcp_port_that_cannot_be_is_one_message() -> None:
    with pytest.raises(UserError, match="cannot link"):
        PseudoTerminal(Path("/no/such/folder/port"))
    taken = TcpPort(0, "127.0.0.1")
    with pytest.raises(UserError, match="cannot serve TCP port"):
        TcpPort(int(taken.name.rsplit(":", 1)[1]), "127.0.0.1")
    taken.close()


# ---- deadlines -----------------------------------------------------------------------------------


class FakeWall:
    """A wall clock that stands still but for waiting and for what a slice is said to cost."""

    def __init__(self) -> None:
        self.now = 100.0
        self.waits: list[float] = []

    def clock(self) -> float:
        return self.now

    def wait(self, seconds: float) -> None:
        self.waits.append(seconds)
        self.now += seconds


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    with Bench(scenario.load("default", {"firmware": "desk"})) as made:
        yield made


class Costly:
    """A port whose reading takes wall time."""

    name = "costly"

    def __init__(self, wall: FakeWall, costs: list[float]) -> None:
        self._wall = wall
        self._costs = iter(costs)

    def read(self) -> bytes:
        self._wall.now += next(self._costs, 0.0)
        return b""

    def write(self, data: bytes) -> None:
        del data

    def close(self) -> None:
        pass


@contextmanager
def timed(bench: Bench, costs: list[float], factor: float = 1.0) -> Iterator[tuple[Rig, FakeWall]]:
    wall = FakeWall()
    phone = Phone(PhoneSpec(http_port=0, nmea_port=0, delay_s=0.0))
    with phone:
        rig = Rig(
            bench,
            [Costly(wall, costs)],
            phone,
            factor=factor,
            clock=wall.clock,
            wait=wall.wait,
        )
        yield rig, wall
        rig.close()


@needs_firmware
def test_every_slice_begins_at_its_deadline(bench: Bench) -> None:
    before = bench.now
    with timed(bench, [0.003] * 50) as (rig, wall):
        rig.run(0.5)
        assert wall.now - 100.0 == pytest.approx(0.5 + 0.003, abs=1e-9)
    assert bench.now - before == pytest.approx(0.5)
    assert rig.deadlines.summary()["late_worst_ms"] == pytest.approx(0.0, abs=1e-6)


@needs_firmware
def test_the_realtime_factor_scales_the_wall(bench: Bench) -> None:
    before = bench.now
    with timed(bench, [], factor=2.0) as (rig, wall):
        rig.run(0.5)
        assert wall.now - 100.0 == pytest.approx(0.25)
    assert bench.now - before == pytest.approx(0.5)


@needs_firmware
def test_a_late_slice_is_caught_up_and_reported(bench: Bench) -> None:
    with timed(bench, [0.0, 0.035]) as (rig, wall):
        rig.run(0.2)
        assert wall.now - 100.0 == pytest.approx(0.2, abs=1e-9)
    summary = rig.deadlines.summary()
    assert summary["late_worst_ms"] == pytest.approx(25.0)
    assert summary["deadlines_missed"] == 2, "25 and 15 ms late; 5 ms is within the slice"
    assert summary["slipped_s"] == 0


@needs_firmware
def test_far_behind_the_rigs_time_slips_and_says_how_much(bench: Bench) -> None:
    cost = 3 * BEHIND_S
    with timed(bench, [cost]) as (rig, wall):
        rig.run(0.2)
        assert wall.now - 100.0 == pytest.approx(cost + 0.2 - SLICE_S, abs=1e-9)
    assert rig.deadlines.summary()["slipped_s"] == pytest.approx(cost - SLICE_S, abs=1e-3)


@needs_firmware
def test_a_camera_that_is_too_slow_skips_pictures_and_never_shows_them_late(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = threading.Event()

    def develop(_camera: Camera, _shot: Shot) -> NDArray[np.uint8]:
        slow.wait(LIMIT_S)
        return np.zeros((480, 640, 3), np.uint8)

    monkeypatch.setattr(Camera, "develop", develop)
    with timed(bench, []) as (rig, _):
        rig.run(1.0)
        assert rig.deadlines.pictures_skipped == 10 - IN_THE_MAKING
        slow.set()


def test_no_slices_have_a_summary() -> None:
    assert Deadlines().summary()["slices"] == 0


# ---- what the operator gets ----------------------------------------------------------------------


def test_the_handouts_describe_the_simulated_machine_and_field(tmp_path: Path) -> None:
    chosen = scenario.load("default", {"belief": "exact"})
    options = handouts(chosen, tmp_path)
    vehicle = load_vehicle(Path(options["vehicle"]))
    assert vehicle.mounts[options["mount"]] == chosen.mount
    field = load_field(Path(options["boundary"]))
    frame = LocalFrame(chosen.gnss.lat_deg, chosen.gnss.lon_deg)
    x, y, yaw = chosen.start_pose()
    _, plan = plan_of(field, int(options["corner"]), vehicle, "three_point")
    assert float(options["gap"]) == chosen.field.gap_m
    side = plan.sides[0]
    assert side.heading_rad == pytest.approx(yaw, abs=1e-3)
    at = frame.to_local(*field.crop[int(options["corner"])])
    assert abs(at[0] - x) < 3
    assert abs(at[1] - y) < 3


# ---- in wall-clock time --------------------------------------------------------------------------


def console(module: str, *args: str) -> list[str]:
    """A console script, run by this interpreter."""
    return [sys.executable, "-c", f"from {module} import main; main()", *args]


def test_a_second_rig_does_not_write_over_the_first_ones_files(tmp_path: Path) -> None:
    with (
        alone(tmp_path, "rig"),
        pytest.raises(UserError, match=f"another rig is writing to {tmp_path}"),
    ):
        rig.main(["--out", str(tmp_path), "--duration", "0.01"], standalone_mode=False)
    assert [path.name for path in tmp_path.iterdir()] == [".running"]


@contextmanager
def a_rig(out: Path, *options: str) -> Iterator[tuple[subprocess.Popen[str], dict[str, str]]]:
    """`daranti-hil rig`, ready; ended by Ctrl-C."""
    process = subprocess.Popen(
        console("hil.commands.cli", "rig", "--out", str(out), *options),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith("drive it"):
                break
        else:
            assert process.stderr is not None
            pytest.fail(f"the rig did not start: {process.stderr.read()}")
        yield process, json.loads((out / "rig.json").read_text())
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.communicate(timeout=30)


def drive(about: dict[str, str], record: Path, *options: str) -> subprocess.Popen[str]:
    given = {key: value for key, value in about.items() if key not in NETWORK}
    words = [word for key, value in given.items() for word in (f"--{key}", value)]
    return subprocess.Popen(
        console(
            "host.commands.cli",
            "drive",
            *words,
            "--record",
            str(record),
            "--yes",
            "--countdown",
            "0",
            *options,
        ),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"TERM": "dumb", "PYTHONUNBUFFERED": "1"},
    )


def summary_of(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "summary.json").read_text())
    return found


@needs_firmware
@pytest.mark.wallclock
def test_drive_follows_an_edge_of_10_m_takes_the_turn_and_stops_at_ctrl_c(tmp_path: Path) -> None:
    field = ("--set", "field.size_m=[10, 10]")
    with a_rig(tmp_path, "--duration", "120", *field) as (_, about):
        host = drive(about, tmp_path / "drive.mcap")
        assert host.stdout is not None
        phases: list[str] = []
        said = ""
        for line in host.stdout:
            said += line
            found = re.match(r"\s*[\d.]+ s  (\w+): ", line)
            if found and found[1] in {phase.value for phase in Phase}:
                phases.append(found[1])
                if found[1] == "follow" and "turn" in phases:
                    host.send_signal(signal.SIGINT)
        _, err = host.communicate(timeout=LIMIT_S)
        assert "turn" in phases, said + err
        assert phases[-1] == "follow", said + err
        assert host.returncode == 130, said + err
        assert "stopped: the firmware confirms" in said
    summary = summary_of(tmp_path)
    assert summary["coverage"] >= 0.09, "a strip of 0.95 m by 10 m of 10 m by 10 m"
    assert summary["neighbour_cut_m2"] == 0


@needs_firmware
@pytest.mark.long
def test_the_default_harvest_over_the_serial_port_covers_what_the_lockstep_run_does(
    tmp_path: Path,
) -> None:
    lockstep = harvest(scenario.load("default", {"record": {"film": False}}), tmp_path / "lockstep")
    with a_rig(tmp_path) as (_, about):
        host = drive(about, tmp_path / "drive.mcap")
        said, err = host.communicate(timeout=HARVEST_S)
        assert host.returncode == 0, said[-2000:] + err
    summary = summary_of(tmp_path)
    assert summary["coverage"] == pytest.approx(lockstep["coverage"], abs=0.01), said[-2000:]
    assert summary["neighbour_cut_m2"] == 0


@needs_firmware
@pytest.mark.wallclock
def test_a_rig_that_ends_mid_run_is_one_message_and_leaves_a_readable_record(
    tmp_path: Path,
) -> None:
    from host.runs.record import read  # noqa: PLC0415

    path = tmp_path / "drive.mcap"
    with a_rig(tmp_path) as (machine, about):
        host = drive(about, path)
        assert host.stdout is not None
        for line in host.stdout:
            if "follow" in line:
                machine.send_signal(signal.SIGINT)
        _, err = host.communicate(timeout=LIMIT_S)
    assert host.returncode == EXIT_FAULT
    assert re.fullmatch(r"daranti: .* vanished .*\n", err), err
    topics = {topic for topic, _, _ in read(path)}
    assert {"/camera", "/telemetry", "/command", "/pilot"} <= topics


@needs_firmware
@pytest.mark.wallclock
def test_the_unmodified_monitor_and_params_work_on_the_rig(tmp_path: Path) -> None:
    with a_rig(tmp_path, "--duration", "60", "--tcp", "0", "--rfc2217", "0") as (_, about):
        for kind in ("port", *NETWORK):
            port = about[kind].replace("0.0.0.0", "127.0.0.1")
            done = subprocess.run(
                console("host.commands.cli", "monitor", "--port", port, "--duration", "1"),
                capture_output=True,
                text=True,
                timeout=30,
                check=True,
            )
            assert "SAFE" in done.stdout
            done = subprocess.run(
                console("host.commands.cli", "params", "get", "steer_kp", "--port", port),
                capture_output=True,
                text=True,
                timeout=30,
                check=True,
            )
            assert done.stdout.startswith("steer_kp = ")
            spec = protocol.PARAMS["steer_kp"]
            assert f"{spec.from_raw(spec.default_raw):g}" in done.stdout
