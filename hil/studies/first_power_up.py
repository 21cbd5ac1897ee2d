"""The first power-up (docs/build/first-power-up.md) on a board in simavr, by a person who knows
nothing: each step's readings are compared with what the page says that one must see.

The wires are resistors, and every voltage is Ohm's law with the parts of docs/build/README.md:
nothing is taken from the firmware or from the machine's model.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from hil.firmware import targets
from hil.firmware.provision import FITTED, eeprom
from hil.firmware.targets import FLOATING, PULLED_UP, ResetCause
from hil.firmware.wiring import PINS, Channel
from host.link import protocol
from host.link.protocol import Fault, State

UNO: Final = PINS["uno"]
LOADER: Final = Path(
    "/usr/share/arduino/hardware/arduino/avr/bootloaders/optiboot/optiboot_atmega328.hex"
)
SUPPLY_V: Final = 5.0
FLOATS_V: Final = 2.3
"""A converter's input that nothing holds: anything, and no fault by itself."""
TOLD: Final = FITTED | {"hall_per_metre": 20.0, "hall_phases": 2.0}
"""What step 4 has the owner tell the firmware of the machine of these wires."""
TURNS, MAGNETS = 10, 2
CURRENT_A: Final = 5.0
"""Of the lamps that step 8 has one send through the current sensors."""


@dataclass(frozen=True)
class Wires:
    """How a machine is wired; as it should be where nothing else is said."""

    estop: Literal["whole", "open", "chafed", "no resistor"] = "whole"
    button: bool = True
    """Whether its contact 1 is in the loop."""
    chassis_is_ground: bool = True
    pot_supply: bool = True
    pot_ground: bool = True
    pot_wiper: bool = True
    pot_pull_up: bool = True
    """100 kOhm from the wiper to 5 V."""
    pot_turns_left: bool = True
    """Its outer wires are as drawn: the wiper nears 5 V as the wheel turns left."""
    divider: Literal["battery", "supply"] = "battery"
    """Where its upper end hangs."""
    divider_lower_ohm: float = 10e3
    pull_downs: bool = True
    relay_active_low: bool = False
    wheel: Literal["right", "silent", "twice", "at the blade's pin"] = "right"
    second_swapped: bool = False
    steer_sense: Literal["right", "unplugged", "elsewhere"] = "right"
    drive_sense: Literal["right", "unplugged", "elsewhere"] = "right"


def node_v(*branches: tuple[float, float]) -> float:
    """Of a node that (volts, ohms) branches meet in; where there are none it floats."""
    if not branches:
        return FLOATS_V
    if any(ohm == 0 for _, ohm in branches):
        return next(volt for volt, ohm in branches if ohm == 0)
    return sum(v / ohm for v, ohm in branches) / sum(1 / ohm for _, ohm in branches)


class Person:
    """Who does what the page says, and looks."""

    def __init__(self, wires: Wires, *, told: bool) -> None:
        self.wires = wires
        image = eeprom(tuple(TOLD.items())) if told else None
        self.board = targets.avr(image, "uno", LOADER)
        self.steer, self.battery_v, self.pressed, self.joined = 0.5, 0.0, False, False
        """The wheel between its right (0) and left (1) stop; the battery; the button; A4 held to
        the chassis."""
        self.current_a = (0.0, 0.0)
        self.wiper_pulled = False
        self.moved: set[int] = set()
        """Pins of motors and relay that have been at a level which moves them."""
        self.telemetry: protocol.Telemetry | None = None
        self.readings: protocol.Readings | None = None
        self._parser, self._seq, self._now_ms = protocol.Parser(), 0, 0
        self._levels = {UNO.hall: True, UNO.hall_b: True, UNO.blade_turn: True}
        self.wait(2600)

    # ---- the wires -------------------------------------------------------------------------------

    def _voltages(self) -> dict[Channel, float]:
        w = self.wires
        loop = [(SUPPLY_V, 2.2e3)]
        if (self.joined and w.chassis_is_ground) or w.estop == "chafed":
            loop.append((0.0, 0.0))
        elif w.estop != "open" and not (self.pressed and w.button):
            loop.append((0.0, 0.0 if w.estop == "no resistor" else 470.0))
        share = 0.25 + 0.5 * self.steer
        share = share if w.pot_turns_left else 1 - share
        ends = [(SUPPLY_V, 10e3 * (1 - share))] if w.pot_supply else []
        ends += [(0.0, 10e3 * share)] if w.pot_ground else []
        held = [(SUPPLY_V, 100e3)] if w.pot_pull_up else []
        whole = w.pot_wiper and not self.wiper_pulled
        upper = self.battery_v if w.divider == "battery" else SUPPLY_V
        sensed = {}
        for channel, fitted, ampere, volt_per_a in (
            (Channel.STEER_SENSE, w.steer_sense, self.current_a[0], 0.1),
            (Channel.DRIVE_SENSE, w.drive_sense, self.current_a[1], 0.04),
        ):
            through = 0.0 if fitted == "elsewhere" else ampere
            volt = SUPPLY_V / 2 + volt_per_a * through
            sensed[channel] = 0.0 if fitted == "unplugged" else volt
        return sensed | {
            Channel.ESTOP: node_v(*loop),
            Channel.POT: node_v(*held, *(ends if whole else [])),
            Channel.BATTERY: node_v((upper, 30e3), (0.0, w.divider_lower_ohm)),
        }

    def _look(self) -> None:
        for pin in UNO.outputs:
            duty = self.board.output(pin)
            loose = duty in (FLOATING, PULLED_UP)
            high = not self.wires.pull_downs if loose else duty > 0
            relay = pin == UNO.blade and self.wires.relay_active_low
            if high != relay:
                self.moved.add(pin)

    # ---- what a person does ----------------------------------------------------------------------

    def wait(self, ms: int) -> None:
        """With an eye on motors and relay."""
        for _ in range(0, ms, 5):
            for channel, volt in self._voltages().items():
                self.board.set_analog_mv(channel, round(1000 * min(max(volt, 0.0), SUPPLY_V)))
            for pin, level in self._levels.items():
                self.board.set_pin(pin, level)
            self._now_ms += 5
            self.board.run_until(1000 * self._now_ms)
            self._look()
            for _, message in self._parser.feed(self.board.read()):
                if isinstance(message, protocol.Telemetry):
                    self.telemetry = message
                elif isinstance(message, protocol.Readings):
                    self.readings = message

    def faults(self) -> Fault:
        """What stays after `daranti clear`."""
        self._seq = self._seq + 1 & 0xFF
        self.board.write(protocol.encode(protocol.Clear(), self._seq))
        self.wait(400)
        assert self.telemetry is not None
        return Fault(self.telemetry.faults)

    def read(self) -> protocol.Readings:
        """Of `daranti monitor --readings`, after a moment."""
        self.wait(400)
        assert self.readings is not None
        return self.readings

    def turn_steering(self, to: float) -> Fault:
        """By hand, within two seconds; what fault shows on the way."""
        begun, found = self.steer, Fault(0)
        for k in range(1, 401):
            self.steer = begun + (to - begun) * k / 400
            self.wait(5)
            assert self.telemetry is not None
            found |= Fault(self.telemetry.faults)
        return found

    def turn_wheel(self) -> tuple[float, int, int]:
        """Ten turns forward: the speed that is shown meanwhile (m/s), the pulses at the wheel's and
        at the blade's input."""
        before, fastest = self.read(), 0.0
        first = UNO.blade_turn if self.wires.wheel == "at the blade's pin" else UNO.hall
        one, other = (UNO.hall_b, first) if self.wires.second_swapped else (first, UNO.hall_b)
        for _ in range(TURNS * MAGNETS * (2 if self.wires.wheel == "twice" else 1)):
            # Forward, the second sensor's pulse is a quarter behind the first's.
            for pin, level in ((one, False), (other, False), (one, True), (other, True)):
                if self.wires.wheel != "silent":
                    self._levels[pin] = level
                self.wait(20)
                shown = self.telemetry.speed if self.telemetry else None
                fastest = max(fastest, shown or 0.0, -(shown or 0.0), key=abs)
                if shown and abs(shown) >= abs(fastest):
                    fastest = shown
        after = self.read()
        return fastest, after.hall - before.hall, after.blade_turns - before.blade_turns


SEEN: Final[dict[str, tuple[int, str]]] = {
    "no battery": (3, "`FAULT`, with"),
    "loop": (3, 'no "emergency-stop loop"'),
    "button": (3, "button pressed"),
    "chassis": (3, "wire A4 joined"),
    "pot": (3, 'no "potentiometer" fault'),
    "wiper": (3, "wiper wire pulled"),
    "over-current": (3, 'no "over-current"'),
    "counts": (3, "nothing | e-stop"),
    "way": (3, "steering, stop to stop"),
    "wheel": (3, "a wheel, ten turns"),
    "volts": (5, "`monitor`: voltage"),
    "twitch": (6, "*Must:* no wheel twitches"),
    "second": (8, "**Second wheel sensor**"),
    "current": (8, "**Current sensors**"),
}
"""What must be seen: the step, and how its row or paragraph on the page begins."""


def power_up(wires: Wires) -> list[str]:
    """What a person sees otherwise than the page says, in the page's order; of SEEN."""
    bad: list[str] = []

    def must(what: str, seen: bool) -> None:
        if not seen:
            bad.append(what)

    usb = Person(wires, told=False)
    found = usb.faults()
    assert usb.telemetry is not None
    state, shown = usb.telemetry.state, usb.telemetry.battery
    must("no battery", state is State.FAULT and Fault.BATTERY_LOW in found and shown < 0.3)
    must("loop", not found & (Fault.ESTOP_OPEN | Fault.ESTOP_SHORT))
    usb.pressed = True
    must("button", Fault.ESTOP_OPEN in usb.faults())
    usb.pressed, usb.joined = False, True
    must("chassis", Fault.ESTOP_SHORT in usb.faults())
    usb.joined = False
    usb.faults()
    pot = Fault.POT_OPEN | Fault.POT_SHORT | Fault.POT_JUMP
    must("pot", not (usb.turn_steering(0.0) | usb.turn_steering(1.0) | usb.faults()) & pot)
    usb.wiper_pulled = True
    must("wiper", Fault.POT_OPEN in usb.faults())
    usb.wiper_pulled = False
    must("over-current", not usb.faults() & (Fault.STEER_OVERCURRENT | Fault.DRIVE_OVERCURRENT))
    must("counts", 170 <= usb.read().estop <= 190)
    left = usb.read().pot
    usb.turn_steering(0.0)
    right = usb.read().pot
    must("way", 120 <= right < left <= 904)
    _, wheel, blade = usb.turn_wheel()
    must("wheel", (wheel, blade) == (TURNS * MAGNETS, 0))

    told = Person(wires, told=True)
    told.battery_v = 12.4
    told.wait(400)
    assert told.telemetry is not None
    must("volts", abs(told.telemetry.battery - told.battery_v) < 0.3)
    told.moved.clear()
    told.board.reset(ResetCause.EXTERNAL)
    told.wait(2600)
    must("twitch", not told.moved)
    must("second", told.turn_wheel()[0] > 0)
    rest = told.read()
    told.current_a = (CURRENT_A, CURRENT_A)
    lit = told.read()
    rises = (lit.steer_current - rest.steer_current, lit.drive_current - rest.drive_current)
    still = max(abs(rest.steer_current), abs(rest.drive_current)) < 0.5
    must("current", still and all(abs(rise / CURRENT_A - 1) < 0.1 for rise in rises))
    for person in (usb, told):
        person.board.close()
    return bad
