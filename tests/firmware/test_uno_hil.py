"""The build for a real board on a bench: sensors over the link, no output driven. In simavr."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from hil.firmware import targets
from host.link import protocol
from host.link.protocol import Fault, Result, State
from tests.helpers.actuator import Actuator, ActuatorSpec
from tests.helpers.firmware_bench import ESTOP, OPEN_MV, OUTPUTS, POT

EXCHANGE_MS = 5
"""Sensors out, outputs back, in every tick."""
BUILD = 2


class Board:
    """A board on a line of 115200 baud, and the plant at the line's other end."""

    def __init__(self, target: targets.Target, spec: ActuatorSpec) -> None:
        self.target = target
        self.actuator = Actuator(spec)
        self.parser = protocol.Parser()
        self.telemetry: list[protocol.Telemetry] = []
        self.answers: list[protocol.Message] = []
        self.outputs = protocol.HilOutputs(0, 0, 0)
        self.drives: list[protocol.HilOutputs] = []
        self.command: protocol.Drive | None = None
        self.estop = 0.88
        self.speaking = True
        self.now_ms = 0
        self.seq = 0
        # What is truly at its pins is nothing that a machine could show.
        target.set_analog_mv(ESTOP, OPEN_MV)
        target.set_analog_mv(POT, 5000)

    def send(self, message: protocol.Message) -> None:
        self.seq = (self.seq + 1) & 0xFF
        self.target.write(protocol.encode(message, self.seq))

    def sensors(self) -> protocol.HilSensors:
        pot = self.actuator.pot_mv() / 1000
        return protocol.HilSensors(pot, 3.0, 2.5, 2.5, self.estop, 0, 0, 0)

    def run(self, ms: int) -> None:
        for _ in range(ms):
            if self.now_ms % EXCHANGE_MS == 0 and self.speaking:
                self.send(self.sensors())
            if self.command is not None and self.now_ms % 20 == 2:
                self.send(self.command)
            self.now_ms += 1
            self.target.run_until(self.now_ms * 1000)
            assert not any(self.target.pwm(pin) for pin in OUTPUTS)
            for _, message in self.parser.feed(self.target.read()):
                if isinstance(message, protocol.Telemetry):
                    self.telemetry.append(message)
                elif isinstance(message, protocol.Readings):
                    pass
                elif isinstance(message, protocol.HilOutputs):
                    self.outputs = message
                    self.drives.append(message)
                else:
                    self.answers.append(message)
            self.actuator.step(self.outputs.steer_duty, 1e-3)

    def result(self) -> protocol.Result:
        return [each for each in self.answers if isinstance(each, protocol.Ack)][-1].result

    def arm(self) -> None:
        """From boot, where nothing was plausible yet, to ARMED."""
        self.run(50)
        for name in ("steer_driver", "drive_driver"):
            self.send(protocol.ParamSet(protocol.PARAMS[name].id, 3))
            self.run(20)
        for request in (protocol.Clear(), protocol.Arm(protocol.VERSION)):
            self.send(request)
            self.run(20)
            assert self.result() == Result.OK


@pytest.fixture
def board() -> Iterator[Board]:
    if not targets.AVR_LIBRARY.exists() or not targets.UNO_HIL_IMAGE.exists():
        pytest.skip("not built: run `make build`")
    with targets.uno_hil() as target:
        yield Board(target, ActuatorSpec(60.0, 0.07, 45.0, 1.0))


def test_it_says_which_build_it_is(board: Board) -> None:
    board.send(protocol.Hello(protocol.VERSION))
    board.run(20)
    [version] = [each for each in board.answers if isinstance(each, protocol.Version)]
    assert version.build == BUILD


def test_it_steers_by_the_sensors_of_the_link_and_drives_no_output(board: Board) -> None:
    board.arm()
    for angle in (0.5, -0.35, 0.0):
        board.command = protocol.Drive(angle, 0.4, 0)
        board.run(100)
        board.command = protocol.Drive(angle, 0.4, 1)
        board.run(1500)
        assert board.telemetry[-1].state == State.RUNNING
        assert board.telemetry[-1].faults == 0
        assert board.telemetry[-1].angle == pytest.approx(angle, abs=0.012)
        assert board.actuator.angle_deg == pytest.approx(57.2958 * angle, abs=0.7)
    assert board.outputs.drive_duty > 0
    assert board.outputs.blade == 1
    assert len(board.drives) > 800
    assert board.parser.frames_bad == 0


def test_the_e_stop_of_the_link_stops_it(board: Board) -> None:
    board.arm()
    board.command = protocol.Drive(0.3, 0.4, 1)
    board.run(300)
    assert board.outputs.drive_duty > 0
    board.estop = 5.0
    board.run(15)
    assert board.outputs == protocol.HilOutputs(0, 0, 0)
    board.run(30)
    assert board.telemetry[-1].faults == Fault.ESTOP_OPEN


def test_without_the_plant_nothing_is_plausible(board: Board) -> None:
    board.speaking = False
    board.run(50)
    assert board.telemetry[-1].state == State.FAULT
    assert Fault.ESTOP_OPEN in board.telemetry[-1].faults
    assert Fault.POT_SHORT in board.telemetry[-1].faults
    board.send(protocol.Clear())
    board.run(20)
    assert board.result() == Result.NOT_PLAUSIBLE


def test_a_board_with_sensors_of_its_own_refuses_them() -> None:
    if not targets.AVR_LIBRARY.exists() or not targets.AVR_IMAGE.exists():
        pytest.skip("not built: run `make build`")
    with targets.avr() as target:
        real = Board(target, ActuatorSpec())
        real.send(real.sensors())
        real.speaking = False
        real.run(20)
        assert real.result() == Result.UNKNOWN
