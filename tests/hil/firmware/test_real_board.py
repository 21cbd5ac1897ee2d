"""Facts about a board on a serial port: the Uno's `uno_hil` build, here in simavr behind a
pseudo-terminal, drives the machine as the simulated Uno does."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from hil.bench.lockstep import Bench
from hil.bench.ports import PseudoTerminal
from hil.bench.slices import SLICE_US
from hil.commands.rig import rig
from hil.firmware import coupling, targets
from hil.firmware.real_board import Board, Frames
from hil.firmware.signal_wires import honest
from hil.firmware.targets import ROOT, Target
from hil.firmware.wiring import layout
from hil.scenario.faults import At, Fault
from hil.scenario.scenario import Scenario
from host.core.errors import UserError
from host.core.messages import Command, Request, State, Telemetry
from host.link import protocol
from host.link.session import Session
from sim_plant import machine
from sim_plant.machine import MachineSpec
from tests.helpers.oracle import quick

IMAGE = ROOT / ".pio" / "build" / "uno_hil" / "firmware.elf"
WAIT_S = 30.0
"""Only a hang takes this long."""

needs_simavr = pytest.mark.skipif(
    not targets.AVR_LIBRARY.exists(), reason="the simavr shim is not built: make build"
)


@given(st.lists(st.binary(max_size=20), max_size=20))
def test_frames_come_out_whole_and_nothing_is_lost(chunks: list[bytes]) -> None:
    frames = Frames()
    out = [frame for chunk in chunks for frame in frames.feed(chunk)]
    sent = b"".join(chunks)
    assert b"".join(out) == sent[: sent.rfind(b"\0") + 1]
    assert all(frame.count(b"\0") == 1 and frame.endswith(b"\0") for frame in out)


@pytest.fixture(scope="module")
def image() -> Path:
    """The build for the bench, made anew where it is not today's."""
    done = subprocess.run(
        [sys.executable, "-m", "platformio", "run", "--silent", "-e", "uno_hil"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return IMAGE


class SimulatedBoard(threading.Thread):
    """A board behind a pseudo-terminal. Its clock runs a slice for every frame that comes, so
    nothing depends on the wall's."""

    def __init__(self, image: Path) -> None:
        super().__init__(daemon=True)
        self.port = PseudoTerminal()
        self.target = Target(targets.AVR_LIBRARY, image)
        self.ended = threading.Event()

    def run(self) -> None:
        frames = Frames()
        while not self.ended.wait(0.0002):
            for frame in frames.feed(self.port.read()):
                self.target.write(frame)
                # a host's frame takes no time: the next of the plant's brings it along
                sensors = any(
                    isinstance(m, protocol.HilSensors) for _, m in protocol.Parser().feed(frame)
                )
                if sensors or not self.met(frame):
                    self.target.run_until(self.target.time_us + SLICE_US)
                self.port.write(self.target.read())

    @staticmethod
    def met(frame: bytes) -> bool:
        """Whether this is one of a run, and not of the introduction."""
        kinds = (protocol.Hello, protocol.ParamSet)
        return not any(isinstance(m, kinds) for _, m in protocol.Parser().feed(frame))

    def end(self) -> None:
        self.ended.set()
        self.join()
        self.target.close()
        self.port.close()


@contextmanager
def simulated(image: Path) -> Iterator[SimulatedBoard]:
    board = SimulatedBoard(image)
    board.start()
    yield board
    board.end()


def driven(bench: Bench, seconds: float, until_s: float) -> list[Telemetry]:
    """Arms, then steers 15 degrees left at 0.3 m/s until a time, then says nothing more. A board
    whose sensors have said nothing yet has a fault to clear first."""
    session, out = Session(), []
    asks = {State.SAFE: Command(Request.ARM), State.FAULT: Command(Request.CLEAR)}
    go = Command(Request.DRIVE, math.radians(15), 0.3)
    for tick in range(1, round(seconds * 20) + 1):
        now = tick / 20
        for stamp, data in bench.advance(now):
            out += session.feed(stamp, data)
        if now > until_s:
            continue
        state = session.telemetry.state if session.telemetry is not None else State.SAFE
        bench.send(session.encode(now, asks.get(state, go)))
    return out


def test_of_two_wheel_sensors_the_board_is_told_forward_less_backward() -> None:
    spec = MachineSpec()
    state, given, params = machine.initial(spec), machine.inputs(), machine.parameters(spec)
    outputs, sensors = np.zeros(3), np.zeros(coupling.SENSORS, np.int64)
    run = coupling.bind_apart(outputs, sensors, state, params, given, honest(), layout())
    went = []
    for k, duty in enumerate((0.5, -0.5, -0.5)):
        outputs[1] = duty
        run(k * 2_000_000, (k + 1) * 2_000_000)
        pulses, way = int(sensors[5]), int(sensors[7])
        went.append((pulses, way))
        assert way == pytest.approx(
            float(state["distance"][0]) * spec.drive.hall_pulses_per_m, abs=1
        )
    assert went[0][1] > 20
    assert went[2][1] < 0
    assert went[2][0] > 2 * went[0][1]


@needs_simavr
def test_the_board_drives_the_machine_as_the_simulated_uno_does(image: Path) -> None:
    chosen = Scenario.model_validate(quick().model_dump() | {"firmware": "avr"})
    with simulated(image) as behind:
        board = Board(behind.port.name, chosen.told.parameters, wait_s=WAIT_S)
        with Bench(chosen, board=board) as bench:
            said = driven(bench, 4.0, 3.0)
            there, speed = bench.pose, float(bench.state["v"])
    with Bench(chosen) as bench:
        simulated_said = driven(bench, 4.0, 3.0)
        here = bench.pose
    assert board.answers == 400
    assert max(t.angle_rad for t in said) == pytest.approx(math.radians(15), abs=0.03)
    assert math.dist(there, here) < 0.05
    assert abs(speed) < 0.05, "without commands it has stopped"
    for one in (said, simulated_said):
        assert protocol.Fault(one[-1].faults) & protocol.Fault.LINK_LOST


@needs_simavr
def test_the_e_stop_reaches_the_board(image: Path) -> None:
    fault = Fault(component="estop", failure="off", at=At(time_s=2.0))
    chosen = quick(faults=(fault,))
    with simulated(image) as behind:
        board = Board(behind.port.name, chosen.told.parameters, wait_s=WAIT_S)
        with Bench(chosen, board=board) as bench:
            said = driven(bench, 2.5, 9.0)
    first = next(t for t in said if t.faults and t.stamp > 2.0)
    assert protocol.Fault(first.faults) & protocol.Fault.ESTOP_OPEN
    assert first.stamp - 2.0 < 0.1


@needs_simavr
def test_a_board_that_would_drive_real_motors_is_refused() -> None:
    with (
        simulated(targets.AVR_IMAGE) as behind,
        pytest.raises(UserError, match="drives real motors"),
    ):
        Board(behind.port.name)


@needs_simavr
def test_a_board_that_falls_silent_is_one_message(image: Path) -> None:
    chosen = quick()
    with simulated(image) as behind:
        board = Board(behind.port.name, chosen.told.parameters, wait_s=WAIT_S)
        with Bench(chosen, board=board) as bench:
            bench.advance(0.2)
            board.wait_s = 0.0
            behind.ended.set()
            behind.join()
            with pytest.raises(UserError, match="does not answer for 1 s"):
                bench.advance(3.0)


@needs_simavr
def test_the_bench_does_not_pretend_to_reset_a_board(image: Path) -> None:
    fault = Fault(component="firmware", failure="off", at=At(time_s=0.5))
    chosen = quick(faults=(fault,))
    with simulated(image) as behind:
        board = Board(behind.port.name, chosen.told.parameters, wait_s=WAIT_S)
        with Bench(chosen, board=board) as bench, pytest.raises(UserError, match="real board"):
            bench.advance(1.0)


def test_a_port_that_is_not_there_is_one_message() -> None:
    done = CliRunner().invoke(rig, ["--firmware", "serial:/dev/ttyNONE", "--scenario", "small"])
    assert isinstance(done.exception, UserError)
    assert "/dev/ttyNONE does not exist" in str(done.exception)
