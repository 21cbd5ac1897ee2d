"""Microcontrollers that run the firmware: ctypes over the Target ABI (firmware/src/target.h).

`desk()` runs the firmware compiled for this machine, `avr(board)` a board's binary in simavr. Both
give a `Target`; a numba-compiled loop takes its raw function pointers and handle instead:

    target = desk()
    run_until, output = target.pointers.run_until, target.pointers.output
    @njit
    def loop(handle): ...  # run_until(handle, time_us); output(handle, 9)
    loop(target.handle)
"""

from __future__ import annotations

import contextlib
import ctypes
import enum
from ctypes import (
    POINTER,
    c_char_p,
    c_int16,
    c_int32,
    c_size_t,
    c_uint8,
    c_uint16,
    c_uint32,
    c_uint64,
)
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal

from host.core.errors import UserError

ROOT = Path(__file__).resolve().parents[2]
DESK_LIBRARY = ROOT / ".pio" / "build" / "desk" / "libdaranti.so"
AVR_LIBRARY = ROOT / "build" / "simavr" / "libdaranti_avr.so"
AVR_IMAGE = ROOT / ".pio" / "build" / "uno" / "firmware.elf"
UNO_HIL_IMAGE = ROOT / ".pio" / "build" / "uno_hil" / "firmware.elf"

Board = Literal["uno", "nano", "mega2560"]
BOARDS: Final[tuple[Board, ...]] = ("uno", "nano", "mega2560")

ABI = 2
EEPROM_SIZE = 1024
"""Bytes, of an ATmega328P (datasheet)."""


class ResetCause(enum.IntFlag):
    """Bits as in the ATmega328P's MCUSR."""

    POWER_ON = 1
    EXTERNAL = 2
    BROWN_OUT = 4
    WATCHDOG = 8


class Hang(enum.IntEnum):
    """Where the firmware hangs."""

    MAIN = 0
    """In its main loop; interrupts go on."""
    INTERRUPT = 1
    """With interrupts off."""


FLOATING: Final = -1
"""An input that nobody drives."""
PULLED_UP: Final = -2
"""What `output` gives for an input."""


class TargetError(Exception):
    """The simulated microcontroller crashed or could not be created."""


_HANDLE = ctypes.c_void_p
_SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "abi": (c_uint32, []),
    "create": (_HANDLE, [c_char_p, c_char_p, c_char_p]),
    "destroy": (None, [_HANDLE]),
    "error": (c_char_p, []),
    "run_until": (c_int32, [_HANDLE, c_uint64]),
    "time_us": (c_uint64, [_HANDLE]),
    "set_analog_mv": (None, [_HANDLE, c_uint8, c_uint16]),
    "set_pin": (None, [_HANDLE, c_uint8, c_uint8]),
    "output": (c_int16, [_HANDLE, c_uint8]),
    "set_baud": (None, [_HANDLE, c_uint32]),
    "write": (c_size_t, [_HANDLE, c_char_p, c_size_t]),
    "read": (c_size_t, [_HANDLE, POINTER(c_uint8), c_size_t]),
    "reset": (None, [_HANDLE, c_uint8]),
    "eeprom": (None, [_HANDLE, POINTER(c_uint8)]),
    "hang": (c_int32, [_HANDLE, c_uint8]),
}


class Pointers:
    """The ABI's functions as ctypes function pointers, which numba calls natively."""

    def __init__(self, library: Path) -> None:
        try:
            loaded = ctypes.CDLL(str(library))
        except OSError as error:
            raise UserError(f"{library}: cannot be loaded ({error}); run `make build`") from error
        self._loaded = loaded
        for name, (result, arguments) in _SIGNATURES.items():
            function = getattr(loaded, f"target_{name}")
            function.restype = result
            function.argtypes = arguments
            setattr(self, name, function)
        if self.abi() != ABI:
            raise UserError(f"{library}: built for another Target ABI; run `make build`")

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(name)


def check_built(*files: Path) -> None:
    """UserError where one of them is missing."""
    for file in files:
        if not file.exists():
            raise UserError(f"{file} is missing: the firmware is not built; run `make build`")


@cache
def _pointers(library: Path, _stamp: int) -> Pointers:
    return Pointers(library)


class Target(contextlib.AbstractContextManager["Target"]):
    """One microcontroller. Time is in microseconds since its creation and advances in run_until()
    only; pins are the board's own numbers, analog channels A0 = 0. Not to be shared between
    threads."""

    def __init__(
        self,
        library: Path,
        image: Path | None = None,
        eeprom: bytes | None = None,
        bootloader: Path | None = None,
    ) -> None:
        check_built(library, *([] if image is None else [image]))
        if eeprom is not None and len(eeprom) != EEPROM_SIZE:
            raise ValueError(f"an EEPROM has {EEPROM_SIZE} bytes, not {len(eeprom)}")
        self.pointers = _pointers(library, library.stat().st_mtime_ns)
        path = None if image is None else str(image).encode()
        loader = None if bootloader is None else str(bootloader).encode()
        handle: int | None = self.pointers.create(path, loader, eeprom)
        if handle is None:
            raise TargetError(self.pointers.error().decode())
        self.handle: int = handle
        """For compiled loops; valid until close()."""
        self._buffer = (c_uint8 * 4096)()

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Frees the simulated microcontroller; a second call does nothing."""
        if self.handle:
            self.pointers.destroy(self.handle)
            self.handle = 0

    def __del__(self) -> None:
        if getattr(self, "handle", 0):
            self.close()

    def run_until(self, time_us: int) -> None:
        """Runs up to, and without, what happens at `time_us`. Raises TargetError on a crash, or
        where the firmware does what the chip does not allow."""
        result: int = self.pointers.run_until(self.handle, time_us)
        if result < 0:
            raise TargetError(f"at {self.time_us} us: {self.pointers.error().decode()}")

    @property
    def time_us(self) -> int:
        """The target's clock."""
        return int(self.pointers.time_us(self.handle))

    def set_analog_mv(self, channel: int, millivolt: int) -> None:
        """Voltage at an analog input, 0..5000 mV."""
        self.pointers.set_analog_mv(self.handle, channel, millivolt)

    def set_pin(self, pin: int, level: bool | None) -> None:
        """Drives an input pin from outside; None lets go of it."""
        self.pointers.set_pin(self.handle, pin, 2 if level is None else int(level))

    def output(self, pin: int) -> int:
        """Duty 0..255 of 255 of a pin that the firmware drives (0 or 255 for a plain output);
        FLOATING or PULLED_UP for an input."""
        return int(self.pointers.output(self.handle, pin))

    def pin(self, pin: int) -> bool:
        """Whether the firmware drives it high all the time."""
        return self.output(pin) == 255

    def pwm(self, pin: int) -> int:
        """Duty 0..255 of 255; 0 for an input."""
        return max(0, self.output(pin))

    def set_baud(self, baud: int) -> None:
        """Speed of the line's other end."""
        self.pointers.set_baud(self.handle, baud)

    def write(self, data: bytes) -> int:
        """Queues bytes towards the firmware; returns how many fitted."""
        return int(self.pointers.write(self.handle, data, len(data)))

    def read(self) -> bytes:
        """All bytes that the firmware has finished sending."""
        out = bytearray()
        while count := int(self.pointers.read(self.handle, self._buffer, len(self._buffer))):
            out += memoryview(self._buffer)[:count]
        return bytes(out)

    def reset(self, cause: ResetCause = ResetCause.EXTERNAL) -> None:
        """Resets the firmware; the EEPROM is kept, the clock runs on."""
        self.pointers.reset(self.handle, int(cause))

    def eeprom(self) -> bytes:
        """A copy of the EEPROM."""
        image = (c_uint8 * EEPROM_SIZE)()
        self.pointers.eeprom(self.handle, image)
        return bytes(image)

    def hang(self, where: Hang = Hang.MAIN) -> None:
        """Hangs the firmware for good. Raises TargetError where the target cannot."""
        if self.pointers.hang(self.handle, int(where)) != 0:
            raise TargetError("this target cannot be hung")


def desk(eeprom: bytes | None = None) -> Target:
    """The firmware compiled for this machine; its pins are an Uno's."""
    return Target(DESK_LIBRARY, None, eeprom)


def image_of(board: Board) -> Path:
    """A board's ELF."""
    return ROOT / ".pio" / "build" / board / "firmware.elf"


def avr(
    eeprom: bytes | None = None, board: Board = "uno", bootloader: Path | None = None
) -> Target:
    """A board's binary in simavr, instruction by instruction, started by a bootloader where one
    (an Intel hex file) is given."""
    return Target(AVR_LIBRARY, image_of(board), eeprom, bootloader)


def uno_hil(eeprom: bytes | None = None) -> Target:
    """The binary for a real board whose sensors come over the link, in simavr: its analog inputs
    and pins are not wired to anything."""
    return Target(AVR_LIBRARY, UNO_HIL_IMAGE, eeprom)
