"""What the firmware costs on the ATmega328P: flash, RAM, stack, and time in simulated cycles.

Runs the Uno's binary in simavr through a busy scenario (driving, a full line of commands and of
garbage, parameter saving, faults) and prints a table; exits 1 where a limit is passed.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from hil.firmware.targets import AVR_IMAGE, Target, avr
from host.core.errors import UserError
from host.link import protocol

CLOCK_HZ = 16_000_000
TICK_CYCLES = CLOCK_HZ // 200
SRAM_AT, SRAM_SIZE = 0x100, 2048
PAINT = 0xA5
FLASH_LIMIT = 24 * 1024
RAM_LIMIT = int(1.2 * 1024)
TICK_LIMIT = 40.0
MASKED_LIMIT_US = 85.0
"""One byte's time on the line: with the UART's two-byte buffer nothing is lost."""
LINE_MS = 100
"""How often a load that fills the line is topped up."""


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

    def paint(self) -> None:
        """Paints what lies between the static data and the sleeping main loop's stack."""
        for at in range(self._bottom, SRAM_SIZE - 64):
            self._sram[at] = PAINT

    def start(self) -> None:
        """Forgets the longest times so far."""
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


def filler(bytes_: bytes) -> Callable[[int], bytes]:
    """A load that repeats these bytes for as long as the line takes them."""
    return lambda k: bytes_ if k % LINE_MS == 0 else b""


def flood(*messages: protocol.Message) -> Callable[[int], bytes]:
    """A load of these messages over and over, without a pause on the line."""
    once = b"".join(protocol.encode(message, 1) for message in messages)
    return filler(once * (LINE_MS * protocol.BAUD // 10_000 // len(once) + 1))


NEAR_MISS = bytes((16, 11, 9, 9, 9, 9, 10, 5, 10, 9, 6, 1, 4, 9, 9, 9, 0))
"""Its suffixes of 16, 10, 9, 6 and 5 bytes are HilSensors, Drive, Ident, Hello and Clear, whole but
for their CRCs."""
DRIVE = protocol.Drive(0.2, 0.5, 1)
IDENT = protocol.Ident(100, 0.1)
HALL = protocol.PARAMS["hall_per_metre"]
PARAM_SET = protocol.ParamSet(HALL.id, HALL.to_raw(20.0))
HIL_SENSORS = protocol.HilSensors(2.5, 3.0, 0.0, 0.0, 0, 0)
NOISE = random.Random(1)


def weave(k: int) -> bytes:
    """A setpoint that wanders, forward and then in reverse."""
    steer = math.radians(25 * math.sin(k / 150) + NOISE.uniform(-3, 3))
    return protocol.encode(protocol.Drive(steer, 0.5 if k < 1000 else -0.5, 1), k & 0xFF)


ARM = flood(protocol.Clear(), protocol.Arm(protocol.VERSION))
LOADS: dict[str, tuple[int, Callable[[int], bytes]]] = {
    "at rest": (200, lambda _: b""),
    "parameters saved": (1000, lambda k: protocol.encode(protocol.ParamSave(), 1) * (k == 0)),
    "driving, 400 commands a second": (2000, lambda k: weave(k) if k % 5 < 2 else b""),
    "driving, line full of DRIVE": (300, flood(DRIVE)),
    "identification": (300, flood(IDENT)),
    "line full of Hello": (300, flood(protocol.Hello(1))),
    "line full of Arm and Clear": (300, ARM),
    "line full of ParamGet": (300, flood(protocol.ParamGet(3))),
    "line full of ParamSet": (300, flood(PARAM_SET)),
    "line full of ParamDefaults": (300, flood(protocol.ParamDefaults())),
    "ParamSet twice a tick": (300, lambda k: protocol.encode(PARAM_SET, 1) * 2 * (k % 5 == 0)),
    "ParamSet among Hello": (300, flood(PARAM_SET, PARAM_SET, *[protocol.Hello(1)] * 5)),
    "ParamSet and ParamDefaults": (300, flood(protocol.ParamDefaults(), PARAM_SET)),
    "line full of HilSensors": (300, flood(HIL_SENSORS)),
    "line full of STOP": (300, flood(protocol.Stop())),
    "line full of zeros": (300, filler(bytes(1200))),
    "random bytes": (1000, lambda _: bytes(NOISE.randrange(256) for _ in range(12))),
    "bytes without a zero": (300, filler(b"\x07" * 1200)),
    "frames that nearly hold": (300, filler(NEAR_MISS * 70)),
    "frames cut short": (300, filler((b"\x05" * 15 + b"\0") * 75)),
}
"""What costs time: milliseconds, and the bytes to send in each."""
ARMED = ("driving", "identification")
"""Loads that begin armed, by their names' first words."""


class Run:
    """The Uno's binary under one load after the other."""

    def __init__(self, target: Target) -> None:
        self.target = target
        self.now_us = 0
        target.set_analog_mv(1, 3000)
        target.set_analog_mv(0, 2502)
        target.set_pin(2, False)

    def run(self, ms: int, load: Callable[[int], bytes]) -> None:
        """Milliseconds under a load, the steering moving and the wheels turning."""
        for k in range(ms):
            self.target.write(load(k))
            self.now_us += 1000
            self.target.run_until(self.now_us)
            self.target.set_pin(12, self.now_us // 1000 % 8 < 4)
            angle = 25 * math.sin(self.now_us / 150e3)
            self.target.set_analog_mv(0, round((512 + 4.5 * angle) * 5000 / 1023))
            self.target.read()

    def quiet(self) -> None:
        """Until the line is empty, and what was asked is forgotten."""
        self.run(120, lambda k: protocol.encode(protocol.Stop(), 0) * (k == 100))


def loads(run: Run, probe: Probe) -> dict[str, tuple[int, int]]:
    """Each load's longest tick and longest time with interrupts off, in cycles."""
    run.run(20, lambda k: protocol.encode(PARAM_SET, 1) * (k == 10))
    out = {}
    for name, (ms, load) in LOADS.items():
        run.quiet()
        if name.startswith(ARMED):
            run.run(10, lambda k: protocol.encode(protocol.Clear(), 1) * (k == 0))
            run.run(10, lambda k: protocol.encode(protocol.Arm(protocol.VERSION), 1) * (k == 0))
        probe.start()
        run.run(ms, load)
        out[name] = probe.cycles()
    return out


def main() -> int:
    """Prints the loads, and then the table."""
    argparse.ArgumentParser(description=__doc__).parse_args()
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
    probe.paint()
    found = loads(Run(target), probe)
    print(f"{'load':<34}{'worst tick':>12}{'':>9}")
    for name, (cycles, _) in found.items():
        print(f"{name:<34}{cycles:>12}{100 * cycles / TICK_CYCLES:>7.1f} %")
    print()
    tick = max(cycles for cycles, _ in found.values())
    masked = max(cycles for _, cycles in found.values())
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
