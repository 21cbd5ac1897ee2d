"""What the firmware costs on every board: flash, RAM, stack, and time in simulated cycles.

Runs each board's binary in simavr through a busy scenario (driving, a full line of commands and of
garbage, parameter saving, faults, noise on the hall inputs) and prints a table; exits 1 where a
limit is passed.
"""

from __future__ import annotations

import argparse
import ctypes
import itertools
import math
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from hil.firmware import provision
from hil.firmware.targets import BOARDS, Board, Target, avr, image_of
from hil.firmware.wiring import PINS, Pins
from host.core.errors import UserError
from host.link import protocol

CLOCK_HZ = 16_000_000
TICK_CYCLES = CLOCK_HZ // 200
PAINT = 0xA5
FLASH_LIMIT = 24 * 1024
RAM_LIMIT = int(1.2 * 1024)
TICK_LIMIT = 40.0
MASKED_LIMIT_US = 85.0
"""One byte's time on the line: with the UART's two-byte buffer nothing is lost."""
LINE_MS = 100
"""How often a load that fills the line is topped up."""


def sections(image: Path) -> dict[str, int]:
    """Section sizes of the ELF."""
    text = subprocess.run(
        ["avr-size", "-A", str(image)], capture_output=True, text=True, check=True
    ).stdout
    rows = (line.split() for line in text.splitlines() if line.startswith("."))
    return {row[0]: int(row[1]) for row in rows}


def static_end(image: Path) -> int:
    """First SRAM address after the static data."""
    text = subprocess.run(["avr-nm", str(image)], capture_output=True, text=True, check=True).stdout
    for line in text.splitlines():
        address, _, name = line.partition(" ")
        if name.endswith(" __heap_start") or name.endswith(" _end"):
            return int(address, 16) & 0xFFFF
    raise UserError(f"{image}: no symbol _end; build it with `make build`")


class Probe:
    """The shim's measurements beyond the Target ABI."""

    def __init__(self, target: Target, image: Path) -> None:
        library = ctypes.CDLL(str(target.pointers._loaded._name))
        library.probe_sram.restype = ctypes.POINTER(ctypes.c_uint8)
        library.probe_sram.argtypes = [ctypes.c_void_p]
        library.probe_start.argtypes = [ctypes.c_void_p]
        pointer = ctypes.POINTER(ctypes.c_uint64)
        library.probe_read.argtypes = [ctypes.c_void_p, pointer, pointer]
        self._library, self._handle = library, target.handle
        start = ctypes.cast(library.probe_sram(target.handle), ctypes.c_void_p).value
        assert start is not None
        at, size = ctypes.c_uint32(), ctypes.c_uint32()
        places = ctypes.POINTER(ctypes.c_uint32)
        library.probe_sram_place.argtypes = [ctypes.c_void_p, places, places]
        library.probe_sram_place(target.handle, ctypes.byref(at), ctypes.byref(size))
        self.size = size.value
        self._sram = (ctypes.c_uint8 * self.size).from_address(start)
        self._bottom = static_end(image) - at.value

    def paint(self) -> None:
        """Paints what lies between the static data and the sleeping main loop's stack."""
        for at in range(self._bottom, self.size - 64):
            self._sram[at] = PAINT

    def start(self) -> None:
        """Forgets the longest times so far."""
        self._library.probe_start(self._handle)

    def stack_bytes(self) -> int:
        """Deepest the stack has been."""
        at = self._bottom
        while at < self.size and self._sram[at] == PAINT:
            at += 1
        return self.size - at

    def cycles(self) -> tuple[int, int]:
        """Longest tick, longest time with interrupts off."""
        tick, masked = ctypes.c_uint64(), ctypes.c_uint64()
        self._library.probe_read(self._handle, ctypes.byref(tick), ctypes.byref(masked))
        return tick.value, masked.value


def filler(bytes_: bytes) -> Callable[[int], bytes]:
    """A load that repeats these bytes for as long as the line takes them."""
    return lambda k: bytes_ if k % LINE_MS == 0 else b""


SEQUENCE = itertools.count()
"""Of every frame that is sent: a repeated one would not be taken."""


def frame(message: protocol.Message) -> bytes:
    """The next frame."""
    return protocol.encode(message, next(SEQUENCE) & 0xFF)


def flood(*messages: protocol.Message) -> Callable[[int], bytes]:
    """A load of these messages over and over, without a pause on the line."""
    once = sum(len(frame(message)) for message in messages)
    times = LINE_MS * protocol.BAUD // 10_000 // once + 1

    def load(k: int) -> bytes:
        return b"".join(map(frame, messages * times)) if k % LINE_MS == 0 else b""

    return load


NEAR_MISS = bytes((21, 11, 9, 9, 9, 9, 9, 9, 9, 9, 9, 10, 5, 10, 9, 6, 1, 4, 9, 9, 9, 0))
"""Its suffixes of 21, 10, 9, 6 and 5 bytes are HilSensors, Drive, Ident, Hello and Clear, whole but
for their CRCs."""
DRIVE = protocol.Drive(0.2, 0.5, 1)
IDENT = protocol.Ident(100, 0.1)
HALL = protocol.PARAMS["hall_per_metre"]
PARAM_SET = protocol.ParamSet(HALL.id, HALL.to_raw(20.0))
HIL_SENSORS = protocol.HilSensors(2.5, 3.0, 2.5, 2.5, 0.88, 0, 0, 0)
NOISE = random.Random(1)


def weave(k: int) -> bytes:
    """A setpoint that wanders, forward and then in reverse."""
    steer = math.radians(25 * math.sin(k / 150) + NOISE.uniform(-3, 3))
    return frame(protocol.Drive(steer, 0.5 if k < 1000 else -0.5, int(k > 100)))


ARM = flood(protocol.Clear(), protocol.Arm(protocol.VERSION))
LOADS: dict[str, tuple[int, Callable[[int], bytes]]] = {
    "at rest": (200, lambda _: b""),
    "parameters saved": (1000, lambda k: frame(protocol.ParamSave()) if k == 0 else b""),
    "driving, 400 commands a second": (2000, lambda k: weave(k) if k % 5 < 2 else b""),
    "driving, line full of DRIVE": (300, flood(DRIVE)),
    "identification": (300, flood(IDENT)),
    "driving, noise on the hall inputs": (300, flood(DRIVE)),
    "line full of Hello": (300, flood(protocol.Hello(1))),
    "line full of Arm and Clear": (300, ARM),
    "line full of ParamGet": (300, flood(protocol.ParamGet(3))),
    "line full of ParamSet": (300, flood(PARAM_SET)),
    "line full of ParamDefaults": (300, flood(protocol.ParamDefaults())),
    "ParamSet twice a tick": (
        300,
        lambda k: frame(PARAM_SET) + frame(PARAM_SET) if k % 5 == 0 else b"",
    ),
    "ParamSet among Hello": (300, flood(PARAM_SET, PARAM_SET, *[protocol.Hello(1)] * 5)),
    "ParamSet and ParamDefaults": (300, flood(protocol.ParamDefaults(), PARAM_SET)),
    "line full of LogGet": (300, flood(protocol.LogGet(0))),
    "LogGet among ParamSet and ParamDefaults": (
        300,
        flood(protocol.ParamDefaults(), PARAM_SET, protocol.LogGet(0)),
    ),
    "line full of LogClear": (300, flood(protocol.LogClear())),
    "line full of HilSensors": (300, flood(HIL_SENSORS)),
    "line full of STOP": (300, flood(protocol.Stop())),
    "line full of zeros": (300, filler(bytes(1200))),
    "random bytes": (1000, lambda _: bytes(NOISE.randrange(256) for _ in range(12))),
    "bytes without a zero": (300, filler(b"\x07" * 1200)),
    "frames that nearly hold": (300, filler(NEAR_MISS * 55)),
    "frames cut short": (300, filler((b"\x05" * 20 + b"\0") * 57)),
}
"""What costs time: milliseconds, and the bytes to send in each."""
ARMED = ("driving", "identification")
"""Loads that begin armed, by their names' first words."""


class Run:
    """A board's binary under one load after the other."""

    def __init__(self, target: Target, pins: Pins) -> None:
        self.target = target
        self.pins = pins
        self.now_us = 0
        self.noisy = False
        for channel, millivolt in enumerate((2502, 3000, 2500, 2500, 880)):
            target.set_analog_mv(channel, millivolt)

    def run(self, ms: int, load: Callable[[int], bytes]) -> None:
        """Milliseconds under a load, the steering moving and the wheels turning."""
        target = self.target
        for k in range(ms):
            target.write(load(k))
            for _ in range(NOISY_STEPS if self.noisy else 1):
                self.now_us += 1000 // (NOISY_STEPS if self.noisy else 1)
                target.run_until(self.now_us)
                if self.noisy:
                    for pin in (self.pins.hall, self.pins.hall_b, self.pins.blade_turn):
                        target.set_pin(pin, NOISE.random() < 0.5)
            if not self.noisy:
                target.set_pin(self.pins.hall, self.now_us // 1000 % 100 < 50)
            angle = 25 * math.sin(self.now_us / 150e3)
            target.set_analog_mv(0, round((512 + 4.5 * angle) * 5000 / 1023))
            target.read()

    def quiet(self) -> None:
        """Until the line is empty, and what was asked is forgotten."""
        self.run(120, lambda k: frame(protocol.Stop()) if k == 100 else b"")


NOISY_STEPS = 50
"""Changes of the hall inputs in a millisecond, where they are noisy."""


def loads(run: Run, probe: Probe) -> dict[str, tuple[int, int]]:
    """Each load's longest tick and longest time with interrupts off, in cycles."""
    run.run(20, lambda k: frame(PARAM_SET) if k == 10 else b"")
    out = {}
    for name, (ms, load) in LOADS.items():
        run.quiet()
        if name.startswith(ARMED):
            run.run(10, lambda k: frame(protocol.Clear()) if k == 0 else b"")
            run.run(10, lambda k: frame(protocol.Arm(protocol.VERSION)) if k == 0 else b"")
        probe.start()
        run.noisy = "noise on" in name
        run.run(ms, load)
        run.noisy = False
        out[name] = probe.cycles()
    return out


def budget(board: Board) -> bool:
    """Prints a board's loads and table; whether all limits hold."""
    image = image_of(board)
    target = avr(provision.eeprom(tuple(provision.FITTED.items())), board)
    size = sections(image)
    probe = Probe(target, image)
    flash = size[".text"] + size[".data"]
    ram = sum(size.get(name, 0) for name in (".data", ".bss", ".noinit"))
    target.run_until(0)
    probe.paint()
    found = loads(Run(target, PINS[board]), probe)
    print(f"{board + ', load':<40}{'worst tick':>12}{'':>9}")
    for name, (cycles, _) in found.items():
        print(f"{name:<40}{cycles:>12}{100 * cycles / TICK_CYCLES:>7.1f} %")
    print()
    tick = max(cycles for cycles, _ in found.values())
    masked = max(cycles for _, cycles in found.values())
    stack = probe.stack_bytes()
    share = 100 * tick / TICK_CYCLES
    masked_us = masked / CLOCK_HZ * 1e6
    room = probe.size - ram
    rows = [
        ("flash", f"{flash} B", f"{FLASH_LIMIT} B", flash <= FLASH_LIMIT),
        ("static RAM", f"{ram} B", f"{RAM_LIMIT} B", ram <= RAM_LIMIT),
        ("stack, high water", f"{stack} B", f"{room} B", stack <= room),
        ("worst tick", f"{tick} cycles, {share:.1f} %", f"{TICK_LIMIT:.0f} %", share <= TICK_LIMIT),
        (
            "interrupts off",
            f"{masked} cycles, {masked_us:.1f} us",
            f"{MASKED_LIMIT_US:.0f} us",
            masked_us <= MASKED_LIMIT_US,
        ),
    ]
    print(f"{board:<20}{'measured':<26}limit")
    for name, measured, limit, good in rows:
        print(f"{name:<20}{measured:<26}{limit}{'' if good else '   PASSED'}")
    print()
    return all(row[3] for row in rows)


def main() -> int:
    """Prints the boards' tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "boards", nargs="*", help=f"of {', '.join(BOARDS)}; all where none is named"
    )
    chosen = parser.parse_args().boards
    if unknown := set(chosen) - set(BOARDS):
        parser.error(f"no board is named {', '.join(sorted(unknown))}")
    try:
        held = [budget(board) for board in BOARDS if not chosen or board in chosen]
    except UserError as error:
        print(f"avr_budget: {error}", file=sys.stderr)
        return 2
    return 0 if all(held) else 1


if __name__ == "__main__":
    sys.exit(main())
