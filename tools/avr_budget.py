"""What the firmware costs on the ATmega328P: flash, RAM, stack, and time in simulated cycles.

Runs the Uno's binary in simavr through a busy scenario (driving, a full line of commands and of
garbage, parameter saving, faults) and prints a table; exits 1 where a limit is passed.
"""

from __future__ import annotations

import ctypes
import math
import random
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from hil.targets import AVR_IMAGE, Target, avr
from host import protocol
from host.errors import UserError

CLOCK_HZ = 16_000_000
TICK_CYCLES = CLOCK_HZ // 200
SRAM_AT, SRAM_SIZE = 0x100, 2048
PAINT = 0xA5
FLASH_LIMIT = 24 * 1024
RAM_LIMIT = int(1.2 * 1024)
TICK_LIMIT = 40.0
MASKED_LIMIT_US = 85.0
"""One byte's time on the line: with the UART's two-byte buffer nothing is lost."""


def sections() -> dict[str, int]:
    """Section sizes of the ELF."""
    text = subprocess.run(
        ["avr-size", "-A", str(AVR_IMAGE)], capture_output=True, text=True, check=True
    ).stdout
    rows = (line.split() for line in text.splitlines() if line.startswith("."))
    return {row[0]: int(row[1]) for row in rows}


def static_end() -> int:
    """First SRAM address after the static data."""
    text = subprocess.run(
        ["avr-nm", str(AVR_IMAGE)], capture_output=True, text=True, check=True
    ).stdout
    for line in text.splitlines():
        address, _, name = line.partition(" ")
        if name.endswith(" __heap_start") or name.endswith(" _end"):
            return int(address, 16) & 0xFFFF
    raise UserError(f"{AVR_IMAGE}: no symbol _end; build it with `pio run -e uno`")


class Probe:
    """The shim's measurements beyond the Target ABI."""

    def __init__(self, target: Target) -> None:
        library = ctypes.CDLL(str(target.pointers._loaded._name))
        library.probe_sram.restype = ctypes.POINTER(ctypes.c_uint8)
        library.probe_sram.argtypes = [ctypes.c_void_p]
        library.probe_start.argtypes = [ctypes.c_void_p]
        pointer = ctypes.POINTER(ctypes.c_uint64)
        library.probe_read.argtypes = [ctypes.c_void_p, pointer, pointer]
        self._library, self._handle = library, target.handle
        start = ctypes.cast(library.probe_sram(target.handle), ctypes.c_void_p).value
        assert start is not None
        self._sram = (ctypes.c_uint8 * SRAM_SIZE).from_address(start)
        self._bottom = static_end() - SRAM_AT

    def start(self) -> None:
        """Paints what lies between the static data and the sleeping main loop's stack."""
        top = SRAM_SIZE - 64
        for at in range(self._bottom, top):
            self._sram[at] = PAINT
        self._library.probe_start(self._handle)

    def stack_bytes(self) -> int:
        """Deepest the stack has been."""
        at = self._bottom
        while at < SRAM_SIZE and self._sram[at] == PAINT:
            at += 1
        return SRAM_SIZE - at

    def cycles(self) -> tuple[int, int]:
        """Longest tick, longest time with interrupts off."""
        tick, masked = ctypes.c_uint64(), ctypes.c_uint64()
        self._library.probe_read(self._handle, ctypes.byref(tick), ctypes.byref(masked))
        return tick.value, masked.value


def busy(target: Target) -> None:
    """Half a minute of all that costs time."""
    noise = random.Random(1)
    target.set_analog_mv(1, 3000)
    target.set_analog_mv(0, 2502)
    target.set_pin(2, False)
    now = 0

    def run(ms: int, message: protocol.Message | None = None, every: int = 5) -> None:
        nonlocal now
        for k in range(ms):
            if message is not None and k % every == 0:
                target.write(protocol.encode(message, k & 0xFF))
            now += 1000
            target.run_until(now)
            target.set_pin(12, k % 8 < 4)
            target.read()

    hall = protocol.PARAMS["hall_per_metre"]
    run(20)
    run(20, protocol.ParamSet(hall.id, hall.to_raw(50.0)), 10)
    run(1000, protocol.ParamSave(), 1000)
    for _ in range(4):
        run(10, protocol.Clear(), 5)
        run(10, protocol.Arm(protocol.VERSION), 5)
        for k in range(2000):
            angle = 25 * math.sin(k / 150)
            target.set_analog_mv(0, round((512 + 4.5 * angle) * 5000 / 1023))
            steer = math.radians(angle + noise.uniform(-3, 3))
            run(1, protocol.Drive(steer, 0.5 if k < 1000 else -0.5, 1))
        target.write(bytes(noise.randrange(256) for _ in range(2000)))
        run(200)
        target.write(bytes(noise.randrange(1, 256) for _ in range(17)) * 60 + bytes(1))
        target.write(b"".join(bytes((5,)) * 15 + b"\0" for _ in range(60)))
        run(200)
        target.write(protocol.encode(protocol.Hello(1), 0) * 200)
        run(200)
        target.write(protocol.encode(protocol.ParamGet(3), 0) * 200)
        run(200)


def main() -> int:
    """Prints the table."""
    try:
        target = avr()
        size = sections()
        probe = Probe(target)
    except UserError as error:
        print(f"avr_budget: {error}", file=sys.stderr)
        return 2
    flash = size[".text"] + size[".data"]
    ram = sum(size.get(name, 0) for name in (".data", ".bss", ".noinit"))
    target.run_until(0)
    probe.start()
    busy(target)
    tick, masked = probe.cycles()
    stack = probe.stack_bytes()
    share = 100 * tick / TICK_CYCLES
    masked_us = masked / CLOCK_HZ * 1e6
    rows = [
        ("flash", f"{flash} B", f"{FLASH_LIMIT} B", flash <= FLASH_LIMIT),
        ("static RAM", f"{ram} B", f"{RAM_LIMIT} B", ram <= RAM_LIMIT),
        ("stack, high water", f"{stack} B", f"{SRAM_SIZE - ram} B", stack <= SRAM_SIZE - ram),
        ("worst tick", f"{tick} cycles, {share:.1f} %", f"{TICK_LIMIT:.0f} %", share <= TICK_LIMIT),
        (
            "interrupts off",
            f"{masked} cycles, {masked_us:.1f} us",
            f"{MASKED_LIMIT_US:.0f} us",
            masked_us <= MASKED_LIMIT_US,
        ),
    ]
    print(f"{'':<20}{'measured':<26}limit")
    for name, measured, limit, good in rows:
        print(f"{name:<20}{measured:<26}{limit}{'' if good else '   PASSED'}")
    return 0 if all(row[3] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
