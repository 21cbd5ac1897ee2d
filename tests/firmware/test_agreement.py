"""Desk and board agree, whatever the parameters. `int` has 32 bits on the one and 16 on the other:
a product that is right on the desk, and in every unit test, may overflow on the board, and with
the default parameters it may not. So parameters are drawn at the ends of their ranges and between,
of machines that are set up. What they drive answers as it is driven, more or less."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest

from hil.firmware import targets
from hil.firmware.targets import Board, Target
from hil.firmware.wiring import PINS, Channel, Pins
from host.link import protocol
from tests.firmware.test_eeprom import written

VOLT_5 = 1023
TICK_MS = 5
SENT_AT, TICK_AT, SEEN_AT = 0, 4, 3
"""Of a tick's period, in ms: when frames are sent (whole before the tick), when it comes, and when
what it drives is looked at: the board's tick takes up to 2 ms."""
SECONDS = 3
Raw = dict[str, int]


def drawn(rng: random.Random) -> Raw:
    """Raw parameters: every one at an end, at its default or anywhere, then what a machine must be
    to arm."""
    raw = {
        name: rng.choice(
            (spec.min_raw, spec.max_raw, spec.default_raw, rng.randint(spec.min_raw, spec.max_raw))
        )
        for name, spec in protocol.PARAMS.items()
    }
    for motor in ("steer", "drive"):
        driver = raw[f"{motor}_driver"] = rng.randint(1, 3)
        if driver == 1:
            raw[f"{motor}_current_max"] = min(raw[f"{motor}_current_max"], 500)
            raw[f"{motor}_current_cont"] = min(raw[f"{motor}_current_cont"], 400)
        scale, zero = f"{motor}_current_scale", raw[f"{motor}_current_zero"]
        raw[scale] = max(10, raw[scale])
        if (4890 - zero) * 100 // raw[scale] < raw[f"{motor}_current_max"]:
            raw[scale] = 0
    if raw["steer_driver"] == 3:
        raw["steer_pwm_freq"] = min(raw["steer_pwm_freq"], 20_000)
    raw["battery_scale"] = max(raw["battery_scale"], 8000)
    raw["battery_high"] = min(raw["battery_high"], raw["battery_scale"] // 50 * 49)
    raw["battery_low"] = min(raw["battery_low"], raw["battery_high"] - 1000)
    raw["steer_duty_max"] = max(raw["steer_duty_max"], raw["steer_min_duty"] + 40)
    raw["hall_per_metre"] = rng.choice((0, max(100, raw["hall_per_metre"])))
    while True:
        points = sorted(rng.choice((0, 10_230, rng.randint(0, 10_230))) for _ in range(3))
        left, centre, right = points if rng.random() < 0.5 else points[::-1]
        wide = abs(left - centre) * 10 > raw["angle_left"] + 100
        if wide and abs(right - centre) * 10 > 100 - raw["angle_right"]:
            return raw | {"pot_left": left, "pot_centre": centre, "pot_right": right}


@dataclass
class Side:
    """One of the two."""

    target: Target
    pins: Pins
    parser: protocol.Parser = field(default_factory=protocol.Parser)
    messages: list[protocol.Message] = field(default_factory=list)

    def run_until(self, us: int) -> None:
        self.target.run_until(us)
        self.messages += [message for _, message in self.parser.feed(self.target.read())]

    @property
    def outputs(self) -> list[int]:
        """Duties of bridges and blade."""
        return [self.target.output(pin) for pin in (*self.pins.outputs, self.pins.lamp)]


def duty(driver: int, wires: list[int]) -> int:
    """-255..255 at a bridge's four wires."""
    pwm, lpwm, in1, in2 = wires
    if driver == 3:
        return pwm if in1 else -pwm if in2 else 0
    return pwm - lpwm


class Machine:
    """What the sensors read: a machine that does as it is driven, and now and then does not."""

    def __init__(self, raw: Raw, rng: random.Random) -> None:
        self.raw, self.rng = raw, rng
        low, high = raw["pot_low"] + 3, raw["pot_high"] - 3
        self.pot = min(max(raw["pot_centre"] / 10, low), high)
        rising = 1 if raw["pot_left"] > raw["pot_centre"] else -1
        counts = abs(raw["pot_left"] - raw["pot_centre"]) / 10 / (raw["angle_left"] / 100)
        self.pot_per_duty_ms = rising * counts * rng.choice((45, 20, 0)) / 255 / 1000
        battery = (raw["battery_low"] + raw["battery_high"]) / 2 / raw["battery_scale"]
        self.volts = [0.0, 5000 * battery, *(raw[f"{m}_current_zero"] for m in ("steer", "drive"))]
        self.ampere = [0.0, 0.0]
        self.quality = rng.choice((1.0, 1.0, 0.8, 1.3, 0.0))
        self.wheel = self.blade = 0.0

    def step(self, steer: int, drive: int, blade: bool) -> None:
        """A millisecond at these duties."""
        raw = self.raw
        self.pot = min(max(self.pot + self.pot_per_duty_ms * steer, 0), VOLT_5)
        mps = drive / 255 * raw["speed_full"] / 1000 * self.quality
        self.wheel += max(-0.49, min(0.49, mps / 1000 * raw["hall_per_metre"] / 10))
        self.blade += blade * min(0.49, 1.5 * raw["blade_turn_min"] / 1000)
        if self.rng.random() < 0.02:
            for k, motor in enumerate(("steer", "drive")):
                most = min(raw[f"{motor}_current_max"], raw[f"{motor}_current_cont"]) / 100
                self.ampere[k] = self.rng.uniform(-0.95, 0.95) * most

    def show(self, side: Side, ms: int) -> None:
        """To a board's pins. Levels stand still in the millisecond of the tick, for the board may
        take a sample before it counts them."""
        for k, motor in enumerate(("steer", "drive")):
            swing = self.ampere[k] * self.raw[f"{motor}_current_scale"]
            self.set(side, (Channel.STEER_SENSE, Channel.DRIVE_SENSE)[k], self.volts[2 + k] + swing)
        self.set(side, Channel.POT, self.pot * 5000 / VOLT_5)
        self.set(side, Channel.BATTERY, self.volts[1])
        self.set(side, Channel.ESTOP, 880)
        if ms % TICK_MS != TICK_AT:
            side.target.set_pin(side.pins.hall, self.wheel % 1 < 0.5)
            side.target.set_pin(side.pins.hall_b, (self.wheel - 0.25) % 1 < 0.5)
            side.target.set_pin(side.pins.blade_turn, self.blade % 1 < 0.5)

    @staticmethod
    def set(side: Side, channel: Channel, millivolt: float) -> None:
        side.target.set_analog_mv(channel, round(min(5000, max(0, millivolt))))


def host(rng: random.Random) -> Iterator[list[protocol.Message]]:
    """What is sent, tick by tick: armed every second, then driven and identified."""
    command = protocol.Drive(0.0, 0.0, 0)
    for tick in range(SECONDS * 200):
        if tick % 200 == 2:
            command = protocol.Drive(0.0, 0.0, 0)
            yield [command, protocol.Clear(), protocol.Arm(protocol.VERSION)]
            continue
        if tick % 40 == 10:
            speed = rng.choice((0.0, 0.05, 0.1, 0.3, 1.0, 3.0, 32.7, -0.3, -3.0, -32.7))
            command = protocol.Drive(rng.choice((0.0, 0.3, -0.3, 5.7, -5.7)), speed, 1)
        if tick % 40 == 30 and command.speed == 0.0:
            yield [protocol.Ident(rng.randint(-255, 255), rng.choice((0.05, 0.5)))]
            continue
        yield [command] if tick % 4 == 2 else []


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("board", ["uno", "mega2560"])
def test_desk_and_board_agree_with_any_parameters(board: Board, seed: int) -> None:
    rng = random.Random(seed)
    raw = drawn(rng)
    image = written([raw[name] for name in protocol.PARAMS])
    if not (targets.AVR_LIBRARY.exists() and targets.image_of(board).exists()):
        pytest.skip("not built (run `make build`)")
    with targets.desk(image) as here, targets.avr(image, board) as there:
        desk, avr = sides = Side(here, PINS["uno"]), Side(there, PINS[board])
        machine, told = Machine(raw, rng), host(rng)
        seq, outputs = 0, desk.outputs
        for ms in range(SECONDS * 1000):
            frames = b""
            if ms % TICK_MS == SENT_AT:
                for message in next(told):
                    seq = (seq + 1) % 256
                    frames += protocol.encode(message, seq)
            for side in sides:
                machine.show(side, ms)
                side.target.write(frames)
                side.run_until(1000 * ms + 1000)
            if (ms + 1) % TICK_MS == SEEN_AT:
                outputs = desk.outputs
                assert outputs == avr.outputs, f"{ms} ms"
            steer, drive = (
                duty(raw["steer_driver"], outputs[:4]),
                duty(raw["drive_driver"], outputs[4:8]),
            )
            machine.step(steer, drive, outputs[8] > 0)
        count = min(len(side.messages) for side in sides)
        assert desk.messages[:count] == avr.messages[:count]
        assert count > SECONDS * 50
        acks = [a for a in desk.messages if isinstance(a, protocol.Ack)]
        assert any(a.request_id == protocol.Arm.ID and a.result == 0 for a in acks)
