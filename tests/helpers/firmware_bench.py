"""One firmware on one target, with a small actuator on its pins and a host on its line."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from hil.firmware import provision
from hil.firmware.targets import Board, Target
from hil.firmware.wiring import PINS, Channel
from host.link import protocol
from tests.helpers.actuator import Actuator, ActuatorSpec

STEP_US = 1000
TOLD = provision.FITTED | {"drive_driver": 3.0, "steer_current_cont": 4.0}
"""What the firmware has been told of this bench's bridges: a VNH5019 drives, so that its braking
shows, and what steers stands 4 A for long."""
POT, BATTERY, STEER_SENSE, DRIVE_SENSE, ESTOP = Channel
OUTPUTS = PINS["uno"].outputs
"""Bridges and blade, on an Uno."""
CLOSED_MV, OPEN_MV, SHORT_MV = 880, 5000, 0
"""The e-stop's loop."""


def steer_mv(ampere: float) -> int:
    """What an ACS712-20A gives."""
    return round(2500 + 100 * ampere)


def drive_mv(ampere: float) -> int:
    """What an ACS758-050B gives."""
    return round(2500 + 40 * ampere)


@dataclass
class Bench:
    """Advances target and actuator together, one millisecond at a time."""

    target: Target
    spec: ActuatorSpec = field(default_factory=ActuatorSpec)
    start_deg: float = 0.0
    seed: int = 0
    bts7960: bool = False
    """It drives; else a VNH5019."""
    vnh5019_steers: bool = False
    """Else a bridge with a wire for either direction."""
    board: Board = "uno"
    telemetry: list[protocol.Telemetry] = field(default_factory=list)
    readings: list[protocol.Readings] = field(default_factory=list)
    answers: list[protocol.Message] = field(default_factory=list)
    """All that is neither."""
    trace: list[tuple[int, ...]] = field(default_factory=list)
    """Each millisecond: steering duty, drive duty, blade, LED."""
    drive_period_ms: int = 0
    """A DRIVE every so often; 0 sends none."""
    command: protocol.Drive = field(default_factory=lambda: protocol.Drive(0.0, 0.0, 0))
    pot_mv: int | None = None
    """Instead of what the actuator's potentiometer reads."""

    cut_frames: int = 0
    """How many frames a reset may have cut in two."""

    def __post_init__(self) -> None:
        self.actuator = Actuator(self.spec, self.start_deg, self.seed)
        self.parser = protocol.Parser()
        self.now_us = 0
        self.seq = 0
        self.wheel_m = 0.0
        self.hall_per_metre = 0.0
        self.wheel_backward = False
        """The wheel turns backward, whatever the duty."""
        self.blade_hz = 0.0
        """Pulses a second of the blade's sensor; 0: none fitted, or the belt is off."""
        self.blade_welded = False
        self.blade_pulses = 0.0
        self.pins = PINS[self.board]
        self.target.set_pin(self.pins.hall, False)
        self.target.set_analog_mv(BATTERY, 3000)
        self.target.set_analog_mv(STEER_SENSE, steer_mv(0.0))
        self.target.set_analog_mv(DRIVE_SENSE, drive_mv(0.0))
        self.estop(CLOSED_MV)
        self._pot()

    def _pot(self) -> None:
        mv = self.actuator.pot_mv()
        self.target.set_analog_mv(POT, mv if self.pot_mv is None else self.pot_mv)

    def estop(self, millivolt: int) -> None:
        """Voltage of the e-stop's loop."""
        self.target.set_analog_mv(ESTOP, millivolt)

    def send(self, message: protocol.Message) -> int:
        """Queues a frame; returns its sequence number."""
        self.seq = (self.seq + 1) & 0xFF
        self.target.write(protocol.encode(message, self.seq))
        return self.seq

    def signed(self, two: bool, pwm: int, lpwm: int, in1: int, in2: int) -> int:
        """The duty at a bridge's pins; two: it has a wire for either direction."""
        forward, backward = self.target.pwm(pwm), self.target.pwm(lpwm)
        if two:
            assert not self.target.pin(in1) and not self.target.pin(in2)
            assert forward == 0 or backward == 0
            return forward - backward
        if self.target.pin(in1) == self.target.pin(in2):
            return 0
        return forward if self.target.pin(in1) else -forward

    @property
    def steer_duty(self) -> int:
        """-255..255, positive left."""
        p = self.pins
        two = not self.vnh5019_steers
        return self.signed(two, p.steer_pwm, p.steer_lpwm, p.steer_in1, p.steer_in2)

    @property
    def drive_duty(self) -> int:
        """-255..255, positive forward."""
        p = self.pins
        return self.signed(self.bts7960, p.drive_pwm, p.drive_lpwm, p.drive_in1, p.drive_in2)

    @property
    def wheel_duty(self) -> float:
        """0..255: the speed at which the wheels turn. A VNH5019 that shorts its motor for a part of
        each period lets go for the rest, and the motor drives the battery's 12 V and two diodes."""
        shorted = self.target.pwm(self.pins.drive_pwm)
        inputs = self.target.pin(self.pins.drive_in1), self.target.pin(self.pins.drive_in2)
        if self.bts7960 or any(inputs) or shorted == 0:
            return abs(self.drive_duty)
        return (255 - shorted) * 13.6 / 12.0

    def off(self) -> bool:
        """Nothing moves or cuts."""
        return not any(self.target.pwm(pin) for pin in self.pins.outputs)

    @property
    def blade(self) -> bool:
        """Whether the blade's relay is told to close."""
        return self.target.pin(self.pins.blade)

    @property
    def lamp(self) -> bool:
        """The board's LED."""
        return self.target.pin(self.pins.lamp)

    def run(self, ms: int) -> None:
        """Advances by so many milliseconds."""
        for _ in range(ms):
            if self.drive_period_ms and self.now_us // STEP_US % self.drive_period_ms == 0:
                self.send(self.command)
            self.now_us += STEP_US
            self.target.run_until(self.now_us)
            steer, drive = self.steer_duty, self.drive_duty
            self.trace.append((steer, drive, self.blade, self.lamp))
            self.actuator.step(steer, STEP_US * 1e-6)
            self._pot()
            if self.hall_per_metre:
                self.wheel_m += self.wheel_duty / 255 * STEP_US * 1e-6
                phase = self.wheel_m * self.hall_per_metre
                late = phase + (0.25 if self.wheel_backward else -0.25)
                self.target.set_pin(self.pins.hall, phase - math.floor(phase) < 0.5)
                self.target.set_pin(self.pins.hall_b, late - math.floor(late) < 0.5)
            if self.blade_hz:
                turns = self.blade or self.blade_welded
                self.blade_pulses += turns * self.blade_hz * STEP_US * 1e-6
                phase = self.blade_pulses
                self.target.set_pin(self.pins.blade_turn, phase - math.floor(phase) < 0.5)
            self.receive()

    def receive(self) -> None:
        """Takes what the firmware has sent."""
        for _, message in self.parser.feed(self.target.read()):
            if isinstance(message, protocol.Telemetry):
                self.telemetry.append(message)
            elif isinstance(message, protocol.Readings):
                self.readings.append(message)
            else:
                self.answers.append(message)
        assert self.parser.frames_bad <= self.cut_frames

    def result(self) -> protocol.Result:
        """Of the newest Ack."""
        acks = [each for each in self.answers if isinstance(each, protocol.Ack)]
        return acks[-1].result

    def ask(self, steer_deg: float = 0.0, speed: float = 0.0, blade: int = 0) -> None:
        """From now on a DRIVE with this, every 20 ms."""
        self.command = protocol.Drive(math.radians(steer_deg), speed, blade)
        self.drive_period_ms = 20

    def arm(self) -> None:
        """From boot to ARMED."""
        self.run(10)
        self.send(protocol.Arm(protocol.VERSION))
        self.run(20)
        assert self.result() == protocol.Result.OK

    def set_param(self, name: str, value: float) -> None:
        """Sets a parameter in RAM and checks the answer."""
        spec = protocol.PARAMS[name]
        self.send(protocol.ParamSet(spec.id, spec.to_raw(value)))
        self.run(10)
        assert self.result() == protocol.Result.OK

    def save_params(self) -> None:
        """Saves them; a byte that differs takes a tick to write."""
        self.send(protocol.ParamSave())
        self.run(1800)
        assert self.result() == protocol.Result.OK

    @property
    def last(self) -> protocol.Telemetry:
        """The newest telemetry."""
        return self.telemetry[-1]
