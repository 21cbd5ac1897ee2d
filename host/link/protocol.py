"""Generated from firmware/protocol.toml by tools/protogen.py. Do not edit.

The serial link's frames and messages, in SI units. No I/O and no clock.

A frame on the wire: COBS(id, seq, payload, CRC-16/CCITT-FALSE little-endian) 0x00.
"""

from __future__ import annotations

import abc
import binascii
import enum
import functools
import math
import struct
from dataclasses import dataclass
from typing import ClassVar


@dataclass(frozen=True, slots=True)
class Message(abc.ABC):
    """Base of all messages; the fields are in SI units."""

    ID: ClassVar[int]
    LAYOUT: ClassVar[struct.Struct]

    def payload(self) -> bytes:
        """Raises ValueError where a value does not fit its field."""
        try:
            return self.LAYOUT.pack(*self.raws())
        except struct.error as error:
            raise ValueError(f"{self}: a value does not fit its field ({error})") from error
        except TypeError as error:
            raise ValueError(f"{self}: a value must not be None") from error

    @abc.abstractmethod
    def raws(self) -> tuple[int, ...]:
        """The integers on the wire, the nearest ones. Written out for each message, as `of` is."""

    @classmethod
    def parse(cls, payload: bytes) -> Message:
        """Raises ValueError for a wrong length or an enum value out of range."""
        try:
            return cls.of(*cls.LAYOUT.unpack(payload))
        except struct.error as error:
            raise ValueError(f"{cls.__name__}: {error}") from error

    @classmethod
    @abc.abstractmethod
    def of(cls, *raws: int) -> Message:
        """From the integers on the wire. Written out for each message: telemetry comes fifty times
        a second. Raises ValueError for an enum value out of range."""


@dataclass(frozen=True, slots=True)
class ParamSpec:
    """One parameter of the firmware; value in `unit` = raw * scale."""

    name: str
    id: int
    scale: float
    default_raw: int
    min_raw: int
    max_raw: int
    unit: str
    doc: str

    def to_raw(self, value: float) -> int:
        """Raises ValueError, with the range, for a value outside it."""
        raw = round(value / self.scale) if math.isfinite(value) else self.max_raw + 1
        if not self.min_raw <= raw <= self.max_raw:
            low, high = self.from_raw(self.min_raw), self.from_raw(self.max_raw)
            unit = f" {self.unit}" if self.unit else ""
            raise ValueError(f"{self.name} must be {low:g} to {high:g}{unit}, not {value:g}")
        return raw

    def from_raw(self, raw: int) -> float:
        """The value in `unit`."""
        return raw * self.scale


VERSION = 3
BAUD = 115200


class State(enum.IntEnum):
    """What the supervisor allows."""

    SAFE = 0
    ARMED = 1
    RUNNING = 2
    FAULT = 3


_STATE = functools.cache(State)


class Result(enum.IntEnum):
    """Why a request was or was not taken."""

    OK = 0
    WRONG_VERSION = 1
    WRONG_STATE = 2
    NOT_PLAUSIBLE = 3
    OUT_OF_RANGE = 4
    UNKNOWN = 5
    STORE_FAILED = 6
    NOT_SET_UP = 7
    STALE = 8


_RESULT = functools.cache(Result)


class Fault(enum.IntFlag):
    """Latched reasons; each bit has its text on the host."""

    LINK_LOST = 1 << 0
    ESTOP_OPEN = 1 << 1
    POT_OPEN = 1 << 2
    POT_SHORT = 1 << 3
    POT_JUMP = 1 << 4
    POT_FROZEN = 1 << 5
    STEER_STALL = 1 << 6
    STEER_RUNAWAY = 1 << 7
    STEER_OVERCURRENT = 1 << 8
    DRIVE_OVERCURRENT = 1 << 9
    BATTERY_LOW = 1 << 10
    BATTERY_HIGH = 1 << 11
    BROWN_OUT = 1 << 12
    WATCHDOG = 1 << 13
    PARAMS_BAD = 1 << 14
    HALL_LOST = 1 << 15
    IDENT_LIMIT = 1 << 16
    ESTOP_SHORT = 1 << 17
    HALL_NOISE = 1 << 18
    WHEEL_RUNAWAY = 1 << 19
    WRONG_WAY = 1 << 20
    BLADE_LOST = 1 << 21
    BLADE_STUCK = 1 << 22
    RESET_UNKNOWN = 1 << 23
    PARAMS_COPY = 1 << 24


_FAULT = functools.cache(Fault)


FAULT_TEXTS: dict[Fault, tuple[str, str]] = {
    Fault.LINK_LOST: (
        "no valid command for 250 ms",
        "check the cable and that the host runs, then CLEAR and ARM",
    ),
    Fault.ESTOP_OPEN: (
        "emergency-stop loop open",
        "release the emergency stop, then CLEAR and ARM",
    ),
    Fault.POT_OPEN: (
        "steering potentiometer reads above its range (wire open)",
        "check the potentiometer's wiring",
    ),
    Fault.POT_SHORT: (
        "steering potentiometer reads below its range (short to ground)",
        "check the potentiometer's wiring",
    ),
    Fault.POT_JUMP: (
        "steering angle jumped faster than the steering can move",
        "check the potentiometer's wiper and plug",
    ),
    Fault.POT_FROZEN: (
        "steering driven but the potentiometer does not move",
        "check the potentiometer's coupling to the steering rod",
    ),
    Fault.STEER_STALL: (
        "steering motor stalled",
        "free the wheel and check the motor's supply",
    ),
    Fault.STEER_RUNAWAY: (
        "steering moves away from its setpoint",
        "check the motor's polarity and the bridge",
    ),
    Fault.STEER_OVERCURRENT: (
        "steering bridge over-current",
        "check the motor and its wiring for a short",
    ),
    Fault.DRIVE_OVERCURRENT: (
        "drive bridge over-current",
        "check the drive motors and that the wheels turn",
    ),
    Fault.BATTERY_LOW: (
        "battery below its limit",
        "charge or change the battery",
    ),
    Fault.BATTERY_HIGH: (
        "battery above its limit",
        "check the charger and the battery's divider",
    ),
    Fault.BROWN_OUT: (
        "the controller's supply collapsed (brown-out reset)",
        "check the 5 V supply",
    ),
    Fault.WATCHDOG: (
        "the controller hung and its watchdog reset it",
        "report it with the record",
    ),
    Fault.PARAMS_BAD: (
        "stored parameters corrupt or out of range; defaults stand in for them",
        "restore the parameters, save them, CLEAR",
    ),
    Fault.HALL_LOST: (
        "wheels driven but the hall sensor is silent",
        "check the hall sensor, its magnets and its wire",
    ),
    Fault.IDENT_LIMIT: (
        "identification stopped at its angle or time limit",
        "CLEAR and start it again",
    ),
    Fault.ESTOP_SHORT: (
        "emergency-stop loop shorted: the button would not be seen",
        "look for a chafed wire between the board and the button's box",
    ),
    Fault.HALL_NOISE: (
        "the hall sensor counts faster than the machine can drive",
        "lead its wire away from the motors' wires, or check hall_per_metre",
    ),
    Fault.WHEEL_RUNAWAY: (
        "the wheels turn faster than asked",
        "cut the power: the drive bridge may have failed closed. If the wheels obey again, look whether their sensor loses pulses",
    ),
    Fault.WRONG_WAY: (
        "the wheels turn against the direction asked",
        "check the drive motors' polarity and the order of the two hall sensors",
    ),
    Fault.BLADE_LOST: (
        "blade switched on but its sensor shows no turning",
        "check belt, blade motor, relay, fuse and the sensor",
    ),
    Fault.BLADE_STUCK: (
        "the blade turns although it is switched off",
        "press the e-stop: the relay may have welded",
    ),
    Fault.RESET_UNKNOWN: (
        "the controller was reset while it was armed, and its bootloader hides why",
        "check the 5 V supply and that nothing else opens the port",
    ),
    Fault.PARAMS_COPY: (
        "one of the two stored copies of the parameters is damaged; the other is in use",
        "compare the parameters with your notes and save them again",
    ),
}
"""What each bit means, and what to do about it."""


class ResetCause(enum.IntFlag):
    """Why the controller started."""

    BY_POWER_ON = 1 << 0
    BY_RESET_PIN = 1 << 1
    BY_BROWN_OUT = 1 << 2
    BY_WATCHDOG = 1 << 3
    BY_UNKNOWN = 1 << 4
    WHILE_ARMED = 1 << 5


_RESETCAUSE = functools.cache(ResetCause)


RESETCAUSE_TEXTS: dict[ResetCause, tuple[str, str]] = {
    ResetCause.BY_POWER_ON: (
        "power-on",
        "",
    ),
    ResetCause.BY_RESET_PIN: (
        "reset button, or the port was opened",
        "",
    ),
    ResetCause.BY_BROWN_OUT: (
        "brown-out",
        "",
    ),
    ResetCause.BY_WATCHDOG: (
        "watchdog",
        "",
    ),
    ResetCause.BY_UNKNOWN: (
        "hidden by the bootloader",
        "",
    ),
    ResetCause.WHILE_ARMED: (
        "while it was armed",
        "",
    ),
}
"""What each bit means, and what to do about it."""


@dataclass(frozen=True, slots=True)
class Hello(Message):
    """To the firmware: Asks who is there; answered by Version."""

    protocol_version: int

    ID: ClassVar[int] = 1
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<B")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            int(self.protocol_version),
        )

    @classmethod
    def of(cls, *raws: int) -> Hello:
        """From the integers on the wire."""
        (protocol_version,) = raws
        return cls(
            protocol_version,
        )


@dataclass(frozen=True, slots=True)
class Arm(Message):
    """To the firmware: SAFE to ARMED, when the version matches and every precondition holds; answered by Ack."""

    protocol_version: int

    ID: ClassVar[int] = 2
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<B")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            int(self.protocol_version),
        )

    @classmethod
    def of(cls, *raws: int) -> Arm:
        """From the integers on the wire."""
        (protocol_version,) = raws
        return cls(
            protocol_version,
        )


@dataclass(frozen=True, slots=True)
class Stop(Message):
    """To the firmware: All outputs off in the same tick, state SAFE. Wins over anything else."""

    ID: ClassVar[int] = 3
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return ()

    @classmethod
    def of(cls, *raws: int) -> Stop:
        """From the integers on the wire."""
        () = raws
        return cls(
        )


@dataclass(frozen=True, slots=True)
class Clear(Message):
    """To the firmware: Clears latched faults whose cause is gone; FAULT to SAFE."""

    ID: ClassVar[int] = 4
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return ()

    @classmethod
    def of(cls, *raws: int) -> Clear:
        """From the integers on the wire."""
        () = raws
        return cls(
        )


@dataclass(frozen=True, slots=True)
class Drive(Message):
    """To the firmware: The command. Only a fresh one, whose sequence number has advanced by 1 to 127 since the last command or ARM, is taken and feeds the link watchdog."""

    steer: float
    """rad; steering angle, positive to the left"""
    speed: float
    """m/s; negative reverses"""
    blade: int
    """0 off, 1 on"""

    ID: ClassVar[int] = 5
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<hhB")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            round(self.steer / 0.00017453292519943296),
            round(self.speed / 0.001),
            int(self.blade),
        )

    @classmethod
    def of(cls, *raws: int) -> Drive:
        """From the integers on the wire."""
        (steer, speed, blade,) = raws
        return cls(
            steer * 0.00017453292519943296,
            speed * 0.001,
            blade,
        )


@dataclass(frozen=True, slots=True)
class Version(Message):
    """To the host: Answer to Hello."""

    protocol_version: int
    firmware_major: int
    firmware_minor: int
    build: int
    """0 uno, 1 desk, 2 uno_hil, 3 nano, 4 mega2560"""
    reset_cause: ResetCause
    commit: int
    """first eight hexadecimal digits of the commit it was built from; 0 where that is not known"""
    modified: int
    """1 where the sources differed from that commit"""

    ID: ClassVar[int] = 65
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBBBBIB")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            int(self.protocol_version),
            int(self.firmware_major),
            int(self.firmware_minor),
            int(self.build),
            int(self.reset_cause),
            int(self.commit),
            int(self.modified),
        )

    @classmethod
    def of(cls, *raws: int) -> Version:
        """From the integers on the wire."""
        (protocol_version, firmware_major, firmware_minor, build, reset_cause, commit, modified,) = raws
        return cls(
            protocol_version,
            firmware_major,
            firmware_minor,
            build,
            _RESETCAUSE(reset_cause),
            commit,
            modified,
        )


@dataclass(frozen=True, slots=True)
class Ack(Message):
    """To the host: Answer to a request that can be refused."""

    request_id: int
    request_seq: int
    result: Result

    ID: ClassVar[int] = 66
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBB")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            int(self.request_id),
            int(self.request_seq),
            int(self.result),
        )

    @classmethod
    def of(cls, *raws: int) -> Ack:
        """From the integers on the wire."""
        (request_id, request_seq, result,) = raws
        return cls(
            request_id,
            request_seq,
            _RESULT(result),
        )


@dataclass(frozen=True, slots=True)
class Telemetry(Message):
    """To the host: 50 Hz."""

    time: float
    """s; firmware clock, wraps"""
    state: State
    faults: Fault
    setpoint: float
    """rad"""
    angle: float
    """rad"""
    steer_duty: int
    """-255..255, positive to the left"""
    drive_duty: int
    """-255..255, positive forward"""
    blade: int
    speed: float | None
    """m/s; measured; none where no hall sensor is configured"""
    distance: float
    """m; signed odometer since reset; 0 where no sensor is configured"""
    battery: float
    """V"""
    last_seq: int
    """sequence number of the last command taken"""
    frames_bad: int
    """frames dropped since reset (CRC, COBS, length, id), saturating"""

    ID: ClassVar[int] = 67
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<IBIhhhhBhiHBH")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            round(self.time / 1e-06),
            int(self.state),
            int(self.faults),
            round(self.setpoint / 0.00017453292519943296),
            round(self.angle / 0.00017453292519943296),
            int(self.steer_duty),
            int(self.drive_duty),
            int(self.blade),
            -32768 if self.speed is None else round(self.speed / 0.001),
            round(self.distance / 0.001),
            round(self.battery / 0.001),
            int(self.last_seq),
            int(self.frames_bad),
        )

    @classmethod
    def of(cls, *raws: int) -> Telemetry:
        """From the integers on the wire."""
        (time, state, faults, setpoint, angle, steer_duty, drive_duty, blade, speed, distance, battery, last_seq, frames_bad,) = raws
        return cls(
            time * 1e-06,
            _STATE(state),
            _FAULT(faults),
            setpoint * 0.00017453292519943296,
            angle * 0.00017453292519943296,
            steer_duty,
            drive_duty,
            blade,
            None if speed == -32768 else speed * 0.001,
            distance * 0.001,
            battery * 0.001,
            last_seq,
            frames_bad,
        )


@dataclass(frozen=True, slots=True)
class Readings(Message):
    """To the host: 6 Hz: what the sensors read, and how well the controller and its line fare."""

    steer_current: float
    """A"""
    drive_current: float
    """A"""
    pot: float
    """counts; of 1023 for 5 V, as the following"""
    battery: float
    """counts"""
    steer_sense: float
    """counts"""
    drive_sense: float
    """counts"""
    estop: float
    """counts; the loop: 102 to 307 closed"""
    hall: int
    """pulses since reset, modulo 65536"""
    blade_turns: int
    """pulses of the blade's sensor since reset, modulo 65536"""
    overruns: int
    """ticks that began late or were lost since reset, saturating"""
    line_errors: int
    """bytes lost or misread on the line since reset, saturating"""
    stale: int
    """commands refused as repeated or old since reset, saturating"""

    ID: ClassVar[int] = 70
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<hhHHHHHHHHHH")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            round(self.steer_current / 0.01),
            round(self.drive_current / 0.01),
            round(self.pot / 0.0625),
            round(self.battery / 0.0625),
            round(self.steer_sense / 0.0625),
            round(self.drive_sense / 0.0625),
            round(self.estop / 0.0625),
            int(self.hall),
            int(self.blade_turns),
            int(self.overruns),
            int(self.line_errors),
            int(self.stale),
        )

    @classmethod
    def of(cls, *raws: int) -> Readings:
        """From the integers on the wire."""
        (steer_current, drive_current, pot, battery, steer_sense, drive_sense, estop, hall, blade_turns, overruns, line_errors, stale,) = raws
        return cls(
            steer_current * 0.01,
            drive_current * 0.01,
            pot * 0.0625,
            battery * 0.0625,
            steer_sense * 0.0625,
            drive_sense * 0.0625,
            estop * 0.0625,
            hall,
            blade_turns,
            overruns,
            line_errors,
            stale,
        )


@dataclass(frozen=True, slots=True)
class ParamGet(Message):
    """To the firmware: Answered by ParamValue, or by Ack UNKNOWN."""

    param: int
    """id of a parameter"""

    ID: ClassVar[int] = 6
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<B")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            int(self.param),
        )

    @classmethod
    def of(cls, *raws: int) -> ParamGet:
        """From the integers on the wire."""
        (param,) = raws
        return cls(
            param,
        )


@dataclass(frozen=True, slots=True)
class ParamSet(Message):
    """To the firmware: Changes a parameter in RAM, in SAFE or FAULT only; answered by Ack."""

    param: int
    """id of a parameter"""
    value: int
    """raw; the scale is the parameter's"""

    ID: ClassVar[int] = 7
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<Bh")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            int(self.param),
            int(self.value),
        )

    @classmethod
    def of(cls, *raws: int) -> ParamSet:
        """From the integers on the wire."""
        (param, value,) = raws
        return cls(
            param,
            value,
        )


@dataclass(frozen=True, slots=True)
class ParamSave(Message):
    """To the firmware: Stores all parameters in EEPROM and reads them back, in SAFE or FAULT only; answered by Ack when done."""

    ID: ClassVar[int] = 8
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return ()

    @classmethod
    def of(cls, *raws: int) -> ParamSave:
        """From the integers on the wire."""
        () = raws
        return cls(
        )


@dataclass(frozen=True, slots=True)
class ParamDefaults(Message):
    """To the firmware: Sets all parameters to their defaults in RAM, in SAFE or FAULT only; answered by Ack. One a tick is taken, as of Hello."""

    ID: ClassVar[int] = 9
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return ()

    @classmethod
    def of(cls, *raws: int) -> ParamDefaults:
        """From the integers on the wire."""
        () = raws
        return cls(
        )


@dataclass(frozen=True, slots=True)
class Ident(Message):
    """To the firmware: Raw PWM on the steering motor while ARMED, within the ident_* limits; feeds the link watchdog when fresh, as Drive does. Answered by Ack."""

    duty: int
    """-255..255, positive to the left"""
    duration: float
    """s; the motor is released after this time"""

    ID: ClassVar[int] = 10
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<hH")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            int(self.duty),
            round(self.duration / 0.001),
        )

    @classmethod
    def of(cls, *raws: int) -> Ident:
        """From the integers on the wire."""
        (duty, duration,) = raws
        return cls(
            duty,
            duration * 0.001,
        )


@dataclass(frozen=True, slots=True)
class HilSensors(Message):
    """To the firmware: uno_hil only: what the plant's sensors read; answered by HilOutputs. Other builds answer Ack UNKNOWN."""

    pot: float
    """V"""
    battery: float
    """V; at the pin, behind the divider"""
    steer_current: float
    """V; at the sense pin"""
    drive_current: float
    """V; at the sense pin"""
    estop: float
    """V; of the loop, at the pin"""
    hall: int
    """pulses since start, modulo 65536"""
    hall_way: int
    """by both hall sensors, pulses forward less pulses backward since start, modulo 65536"""
    blade_turns: int
    """pulses of the blade's sensor since start, modulo 65536"""

    ID: ClassVar[int] = 11
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<HHHHHHHH")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            round(self.pot / 0.001),
            round(self.battery / 0.001),
            round(self.steer_current / 0.001),
            round(self.drive_current / 0.001),
            round(self.estop / 0.001),
            int(self.hall),
            int(self.hall_way),
            int(self.blade_turns),
        )

    @classmethod
    def of(cls, *raws: int) -> HilSensors:
        """From the integers on the wire."""
        (pot, battery, steer_current, drive_current, estop, hall, hall_way, blade_turns,) = raws
        return cls(
            pot * 0.001,
            battery * 0.001,
            steer_current * 0.001,
            drive_current * 0.001,
            estop * 0.001,
            hall,
            hall_way,
            blade_turns,
        )


@dataclass(frozen=True, slots=True)
class LogGet(Message):
    """To the firmware: Asks for an entry of the fault log; answered by LogEntry, or by Ack UNKNOWN. One a tick is answered, the last that came."""

    index: int
    """0 the newest, 15 the oldest that may be there"""

    ID: ClassVar[int] = 12
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<B")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            int(self.index),
        )

    @classmethod
    def of(cls, *raws: int) -> LogGet:
        """From the integers on the wire."""
        (index,) = raws
        return cls(
            index,
        )


@dataclass(frozen=True, slots=True)
class LogClear(Message):
    """To the firmware: Makes the fault log empty, in SAFE or FAULT only; answered by Ack when done."""

    ID: ClassVar[int] = 13
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return ()

    @classmethod
    def of(cls, *raws: int) -> LogClear:
        """From the integers on the wire."""
        () = raws
        return cls(
        )


@dataclass(frozen=True, slots=True)
class LogEntry(Message):
    """To the host: Answer to LogGet: faults that latched, as the EEPROM keeps them."""

    index: int
    """as asked for"""
    number: int
    """counts the entries, modulo 65536"""
    faults: Fault
    """those that came together; 0: there is no such entry"""
    uptime: int
    """s; from that start to the first of them, saturating"""
    reset_cause: ResetCause
    """of that start"""
    state: State
    """before the first of them"""

    ID: ClassVar[int] = 71
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BHIHBB")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            int(self.index),
            int(self.number),
            int(self.faults),
            int(self.uptime),
            int(self.reset_cause),
            int(self.state),
        )

    @classmethod
    def of(cls, *raws: int) -> LogEntry:
        """From the integers on the wire."""
        (index, number, faults, uptime, reset_cause, state,) = raws
        return cls(
            index,
            number,
            _FAULT(faults),
            uptime,
            _RESETCAUSE(reset_cause),
            _STATE(state),
        )


@dataclass(frozen=True, slots=True)
class ParamValue(Message):
    """To the host: Answer to ParamGet."""

    param: int
    """id of a parameter"""
    value: int
    """raw; the scale is the parameter's"""

    ID: ClassVar[int] = 68
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<Bh")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            int(self.param),
            int(self.value),
        )

    @classmethod
    def of(cls, *raws: int) -> ParamValue:
        """From the integers on the wire."""
        (param, value,) = raws
        return cls(
            param,
            value,
        )


@dataclass(frozen=True, slots=True)
class HilOutputs(Message):
    """To the host: uno_hil only: what the outputs would be; they are held off on the board itself."""

    steer_duty: int
    """-255..255, positive to the left"""
    drive_duty: int
    """-255..255, positive forward"""
    blade: int

    ID: ClassVar[int] = 69
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<hhB")

    def raws(self) -> tuple[int, ...]:
        """The integers on the wire."""
        return (
            int(self.steer_duty),
            int(self.drive_duty),
            int(self.blade),
        )

    @classmethod
    def of(cls, *raws: int) -> HilOutputs:
        """From the integers on the wire."""
        (steer_duty, drive_duty, blade,) = raws
        return cls(
            steer_duty,
            drive_duty,
            blade,
        )


MESSAGES: tuple[type[Message], ...] = (
    Hello,
    Arm,
    Stop,
    Clear,
    Drive,
    Version,
    Ack,
    Telemetry,
    Readings,
    ParamGet,
    ParamSet,
    ParamSave,
    ParamDefaults,
    Ident,
    HilSensors,
    LogGet,
    LogClear,
    LogEntry,
    ParamValue,
    HilOutputs,
)

PARAMS: dict[str, ParamSpec] = {
    "steer_driver": ParamSpec(
        "steer_driver",
        0,
        1.0,
        0,
        0,
        3,
        "",
        "steering bridge: 0 not set (ARM is refused), 1 L298N (PWM at IN1, IN2; its enables wired high), 2 BTS7960 (RPWM, LPWM), 3 VNH5019 or VNH2SP30 (INA, INB, PWM)",
    ),
    "drive_driver": ParamSpec(
        "drive_driver",
        1,
        1.0,
        0,
        0,
        3,
        "",
        "drive bridge: 0 not set (ARM is refused), 1 L298N (PWM at IN1, IN2; its enables wired high), 2 BTS7960 (RPWM, LPWM), 3 VNH5019 or VNH2SP30 (INA, INB, PWM)",
    ),
    "steer_pwm_freq": ParamSpec(
        "steer_pwm_freq",
        2,
        1.0,
        20000,
        123,
        25000,
        "Hz",
        "timer 1 gives any frequency",
    ),
    "drive_pwm_freq": ParamSpec(
        "drive_pwm_freq",
        3,
        1.0,
        3922,
        123,
        25000,
        "Hz",
        "timer 2 gives 123, 245, 490, 980, 3922 Hz: the highest that is not above",
    ),
    "pot_left": ParamSpec(
        "pot_left",
        4,
        0.1,
        7370,
        0,
        10230,
        "counts",
        "potentiometer at the left calibration angle",
    ),
    "pot_centre": ParamSpec(
        "pot_centre",
        5,
        0.1,
        5120,
        0,
        10230,
        "counts",
        "potentiometer at straight ahead",
    ),
    "pot_right": ParamSpec(
        "pot_right",
        6,
        0.1,
        2870,
        0,
        10230,
        "counts",
        "potentiometer at the right calibration angle",
    ),
    "angle_left": ParamSpec(
        "angle_left",
        7,
        0.01,
        5000,
        1000,
        8000,
        "deg",
        "steering angle where pot_left was taken",
    ),
    "angle_right": ParamSpec(
        "angle_right",
        8,
        0.01,
        -5000,
        -8000,
        -1000,
        "deg",
        "steering angle where pot_right was taken",
    ),
    "pot_low": ParamSpec(
        "pot_low",
        9,
        1.0,
        120,
        10,
        500,
        "counts",
        "below it the potentiometer counts as shorted",
    ),
    "pot_high": ParamSpec(
        "pot_high",
        10,
        1.0,
        904,
        524,
        1013,
        "counts",
        "above it the potentiometer counts as open",
    ),
    "steer_rate_max": ParamSpec(
        "steer_rate_max",
        11,
        1.0,
        400,
        50,
        2000,
        "deg/s",
        "a measured angle that changes faster is a jump",
    ),
    "steer_limit": ParamSpec(
        "steer_limit",
        12,
        0.01,
        5000,
        500,
        5000,
        "deg",
        "largest steering setpoint to either side",
    ),
    "steer_slew": ParamSpec(
        "steer_slew",
        13,
        0.1,
        1200,
        50,
        3000,
        "deg/s",
        "fastest change of the steering setpoint",
    ),
    "steer_kp": ParamSpec(
        "steer_kp",
        14,
        0.01,
        7500,
        0,
        10000,
        "duty/deg",
        "proportional gain",
    ),
    "steer_ki": ParamSpec(
        "steer_ki",
        15,
        0.01,
        5500,
        0,
        10000,
        "duty/(deg s)",
        "integral gain",
    ),
    "steer_kd": ParamSpec(
        "steer_kd",
        16,
        0.001,
        3000,
        0,
        20000,
        "duty s/deg",
        "derivative gain, on the measurement",
    ),
    "steer_d_filter": ParamSpec(
        "steer_d_filter",
        17,
        1.0,
        35,
        0,
        200,
        "ms",
        "time constant of the derivative's low-pass",
    ),
    "steer_min_duty": ParamSpec(
        "steer_min_duty",
        18,
        1.0,
        53,
        0,
        150,
        "duty",
        "duty at which the steering motor just moves; added to small commands",
    ),
    "steer_deadband": ParamSpec(
        "steer_deadband",
        19,
        0.01,
        45,
        0,
        500,
        "deg",
        "error within which a resting motor stays released; it releases again within two thirds of it",
    ),
    "steer_duty_max": ParamSpec(
        "steer_duty_max",
        20,
        1.0,
        255,
        30,
        255,
        "duty",
        "",
    ),
    "steer_duty_slew": ParamSpec(
        "steer_duty_slew",
        21,
        1.0,
        15000,
        200,
        25500,
        "duty/s",
        "fastest growth of the steering duty; it falls at once",
    ),
    "speed_max": ParamSpec(
        "speed_max",
        22,
        0.001,
        1000,
        100,
        3000,
        "m/s",
        "largest speed, forward and in reverse",
    ),
    "speed_full": ParamSpec(
        "speed_full",
        23,
        0.001,
        1000,
        100,
        10000,
        "m/s",
        "speed at full duty and nominal battery",
    ),
    "drive_accel": ParamSpec(
        "drive_accel",
        24,
        0.001,
        1000,
        100,
        5000,
        "m/s2",
        "soft start: fastest change of the speed setpoint",
    ),
    "drive_min_duty": ParamSpec(
        "drive_min_duty",
        25,
        1.0,
        0,
        0,
        150,
        "duty",
        "duty at which the drive motors just move",
    ),
    "drive_kp": ParamSpec(
        "drive_kp",
        26,
        0.1,
        800,
        0,
        10000,
        "duty s/m",
        "speed loop, with a hall sensor only",
    ),
    "drive_ki": ParamSpec(
        "drive_ki",
        27,
        0.1,
        2000,
        0,
        20000,
        "duty/m",
        "speed loop, with a hall sensor only",
    ),
    "hall_per_metre": ParamSpec(
        "hall_per_metre",
        28,
        0.1,
        0,
        0,
        4000,
        "pulses/m",
        "0: no hall sensor fitted",
    ),
    "battery_low": ParamSpec(
        "battery_low",
        29,
        0.001,
        10000,
        5000,
        30000,
        "V",
        "",
    ),
    "battery_high": ParamSpec(
        "battery_high",
        30,
        0.001,
        15500,
        6000,
        30000,
        "V",
        "",
    ),
    "battery_nominal": ParamSpec(
        "battery_nominal",
        31,
        0.001,
        12000,
        0,
        30000,
        "V",
        "the drive duty is scaled by nominal over measured, which counts as battery_low at least; 0 switches this off",
    ),
    "steer_current_max": ParamSpec(
        "steer_current_max",
        32,
        0.01,
        2000,
        50,
        10000,
        "A",
        "peak, for 50 ms; what the sensor can show is the limit (ACS712-20A: 24 A)",
    ),
    "drive_current_max": ParamSpec(
        "drive_current_max",
        33,
        0.01,
        4000,
        50,
        10000,
        "A",
        "peak, for 50 ms; what the sensor can show is the limit (ACS758-050B: 60 A)",
    ),
    "stall_current": ParamSpec(
        "stall_current",
        34,
        0.01,
        300,
        10,
        10000,
        "A",
        "a driven, motionless steering above it is stalled, below it its potentiometer is frozen",
    ),
    "stall_time": ParamSpec(
        "stall_time",
        35,
        1.0,
        250,
        100,
        3000,
        "ms",
        "driven at full duty without movement for about this long is a stall or a frozen potentiometer: 100 ms for the motor to come to speed, and the rest, at least 50 ms, in which it must show that it turns; at less duty the rest is longer, in proportion to what is above steer_min_duty. The default is for the slowest motor, 20 deg/s; tuning writes what the identified one needs",
    ),
    "ident_duty_max": ParamSpec(
        "ident_duty_max",
        36,
        1.0,
        200,
        10,
        255,
        "duty",
        "",
    ),
    "ident_angle_max": ParamSpec(
        "ident_angle_max",
        37,
        0.01,
        3500,
        500,
        4500,
        "deg",
        "",
    ),
    "ident_time_max": ParamSpec(
        "ident_time_max",
        38,
        1.0,
        3000,
        100,
        10000,
        "ms",
        "longest duration that Ident may ask for",
    ),
    "steer_current_zero": ParamSpec(
        "steer_current_zero",
        39,
        1.0,
        2500,
        0,
        4000,
        "mV",
        "steering current sensor's output at no current (ACS712 and ACS758: 2500; a BTS7960's IS pins: 0)",
    ),
    "steer_current_scale": ParamSpec(
        "steer_current_scale",
        40,
        1.0,
        100,
        0,
        1000,
        "mV/A",
        "steering current sensor (ACS712-20A 100, ACS712-05B 185, a BTS7960's IS over 1 kOhm about 118); 0: none fitted",
    ),
    "drive_current_zero": ParamSpec(
        "drive_current_zero",
        41,
        1.0,
        2500,
        0,
        4000,
        "mV",
        "drive current sensor's output at no current",
    ),
    "drive_current_scale": ParamSpec(
        "drive_current_scale",
        42,
        1.0,
        40,
        0,
        1000,
        "mV/A",
        "drive current sensor (ACS758-050B 40, ACS712-30A 66); 0: none fitted",
    ),
    "steer_current_cont": ParamSpec(
        "steer_current_cont",
        43,
        0.01,
        400,
        50,
        3000,
        "A",
        "mean over a second: the driver's rating (an L298N's two channels in parallel 4, a BTS7960 or VNH5019 module up to 30 with cooling)",
    ),
    "drive_current_cont": ParamSpec(
        "drive_current_cont",
        44,
        0.01,
        1000,
        50,
        3000,
        "A",
        "mean over a second: the driver's rating (a BTS7960 module about 10, a VNH5019 carrier 12, up to 30 with cooling)",
    ),
    "battery_scale": ParamSpec(
        "battery_scale",
        45,
        0.001,
        20000,
        6000,
        32000,
        "V",
        "battery voltage that the divider makes 5 V of",
    ),
    "speed_excess": ParamSpec(
        "speed_excess",
        46,
        0.001,
        350,
        100,
        3000,
        "m/s",
        "wheels that turn faster than asked by more than this, for 0.4 s, run away; what is asked falls with drive_lag here; with a hall sensor only",
    ),
    "blade_rest": ParamSpec(
        "blade_rest",
        47,
        1.0,
        500,
        200,
        10000,
        "ms",
        "the blade stays off for at least this long",
    ),
    "blade_turn_min": ParamSpec(
        "blade_turn_min",
        48,
        1.0,
        0,
        0,
        1000,
        "pulses/s",
        "what the blade's sensor gives at least while the blade turns; 0: no sensor fitted",
    ),
    "blade_spin_time": ParamSpec(
        "blade_spin_time",
        49,
        1.0,
        1500,
        200,
        10000,
        "ms",
        "longest time that the blade takes to start, and to stop",
    ),
    "hall_phases": ParamSpec(
        "hall_phases",
        50,
        1.0,
        1,
        1,
        2,
        "",
        "hall sensors on the wheel; 2, a quarter of a pulse apart, tell the direction",
    ),
    "drive_lag": ParamSpec(
        "drive_lag",
        51,
        0.001,
        250,
        0,
        2000,
        "s",
        "lag with which the speed follows the duty; what a moving machine lacks because of it does not count for the speed loop's integral. 0: none",
    ),
}

_BY_ID: dict[int, type[Message]] = {message.ID: message for message in MESSAGES}
_ENCODED_SIZES: tuple[int, ...] = tuple(
    sorted({message.LAYOUT.size + 5 for message in MESSAGES}, reverse=True)
)
MAX_ENCODED = _ENCODED_SIZES[0]
"""The longest frame without its closing zero."""


def fault_texts(faults: Fault) -> list[str]:
    """One line for each bit: what it means and what to do."""
    lines = [f"{text}: {remedy}" for bit, (text, remedy) in FAULT_TEXTS.items() if bit & faults]
    unknown = int(faults) & ~sum(FAULT_TEXTS)
    if unknown:
        lines.append(f"unknown fault bits 0x{unknown:x}: update the host's software")
    return lines


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected."""
    return binascii.crc_hqx(data, 0xFFFF)


def cobs_encode(data: bytes) -> bytes:
    """Consistent overhead byte stuffing (Cheshire and Baker 1999), without the closing zero."""
    out = bytearray()
    for block in data.split(b"\0"):
        rest = block
        while len(rest) >= 254:
            out += b"\xff" + rest[:254]
            rest = rest[254:]
        out.append(len(rest) + 1)
        out += rest
    return bytes(out)


def cobs_decode(data: bytes) -> bytes:
    """Raises ValueError where a block is cut short or a zero stands inside."""
    if 0 in data:
        raise ValueError("not a COBS block")
    if len(data) > 254:
        return _cobs_decode_long(data)
    out, at, size = bytearray(data), 0, len(data)
    while at < size:
        code = out[at]
        out[at] = 0
        at += code
    if at != size:
        raise ValueError("not a COBS block")
    return bytes(out[1:])


def _cobs_decode_long(data: bytes) -> bytes:
    out = bytearray()
    at = 0
    while at < len(data):
        code = data[at]
        block = data[at + 1 : at + code]
        if len(block) != code - 1:
            raise ValueError("not a COBS block")
        out += block
        at += code
        if code < 0xFF and at < len(data):
            out.append(0)
    return bytes(out)


def encode(message: Message, seq: int) -> bytes:
    """The whole frame with its closing zero. Raises ValueError where a value does not fit."""
    body = bytes((message.ID, seq & 0xFF)) + message.payload()
    return cobs_encode(body + crc16(body).to_bytes(2, "little")) + b"\0"


def decode(frame: bytes) -> tuple[int, Message]:
    """One frame without its closing zero. Raises ValueError for anything but a valid one."""
    body = cobs_decode(frame)
    if len(body) < 4:
        raise ValueError("frame too short")
    if crc16(body[:-2]) != int.from_bytes(body[-2:], "little"):
        raise ValueError("CRC differs")
    kind = _BY_ID.get(body[0])
    if kind is None:
        raise ValueError(f"unknown message id {body[0]}")
    return body[1], kind.parse(body[2:-2])


class Parser:
    """Bytes in, messages out. After any garbage the next whole valid frame is taken: at each zero
    the longest suffix of what came since the last zero that is a valid frame counts."""

    def __init__(self) -> None:
        self.frames_ok = 0
        self.frames_bad = 0
        """Runs of bytes between zeros that held something else than exactly one valid frame."""
        self._run = b""
        """Since the last zero, MAX_ENCODED bytes at most."""
        self._overlong = False
        """Whether it was longer."""

    def feed(self, data: bytes) -> list[tuple[int, Message]]:
        """The (seq, message) pairs that these bytes complete."""
        *runs, rest = (self._run + data).split(b"\0")
        found = []
        for run in runs:
            one = self._take(run, overlong=self._overlong)
            self._overlong = False
            if one is not None:
                found.append(one)
        self._overlong = self._overlong or len(rest) > MAX_ENCODED
        self._run = rest[-MAX_ENCODED:]
        return found

    def _take(self, run: bytes, *, overlong: bool) -> tuple[int, Message] | None:
        found = None
        used = 0
        for size in _ENCODED_SIZES:
            if size <= len(run):
                try:
                    found, used = decode(run[-size:]), size
                    break
                except ValueError:
                    continue
        self.frames_ok += found is not None
        self.frames_bad += (bool(run) or overlong) and (used != len(run) or overlong)
        return found
