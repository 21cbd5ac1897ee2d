"""Random bytes into the Uno's binary in simavr: it neither hangs nor moves anything, and takes the
very next valid frame.

Exits 1 at the first fact that does not hold.
"""

from __future__ import annotations

import argparse
import random
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from hil.firmware.targets import Target, TargetError, avr
from host.core.errors import UserError
from host.core.number_range import WholeRange, argument
from host.link import protocol

OUTPUTS = (3, 4, 5, 6, 7, 8, 9, 10, 11)
LONGEST = 400
"""Bytes of garbage before the next valid frame; between 1 and this."""
BYTE_US = 85
TICK_US = 5000
TELEMETRY_S = 0.021


def garbage(rng: random.Random) -> bytes:
    """Random bytes, random bytes without a zero, or a valid frame with a few bytes wrong."""
    kind = rng.randrange(3)
    count = rng.randint(1, LONGEST)
    if kind == 0:
        return rng.randbytes(count)
    if kind == 1:
        return bytes(rng.randint(1, 255) for _ in range(count))
    whole = protocol.encode(protocol.Drive(rng.uniform(-1, 1), 0.5, 1), rng.randrange(256))
    frame = bytearray(whole)
    for _ in range(rng.randint(1, 3)):
        frame[rng.randrange(len(frame))] ^= rng.randint(1, 255)
    return bytes(frame)


class Fuzz:
    """One board under fire."""

    def __init__(self, target: Target) -> None:
        self.target = target
        self.parser = protocol.Parser()
        self.now_us = 0
        self.clock_s = 0.0
        for channel, millivolt in enumerate((2502, 3000, 2500, 2500, 880)):
            target.set_analog_mv(channel, millivolt)
        self.run(100_000)

    def run(self, duration_us: int) -> list[protocol.Message]:
        """What the firmware says meanwhile. Raises UserError where it moves something, restarts or
        falls silent."""
        heard = []
        end = self.now_us + duration_us
        while self.now_us < end:
            self.now_us = min(self.now_us + TICK_US, end)
            self.target.run_until(self.now_us)
            if any(self.target.pwm(pin) for pin in OUTPUTS):
                raise UserError("an output went on")
            for _, message in self.parser.feed(self.target.read()):
                heard.append(message)
                if not isinstance(message, protocol.Telemetry):
                    continue
                if message.time < self.clock_s or message.faults & protocol.Fault.WATCHDOG:
                    raise UserError("it restarted")
                self.clock_s = message.time
        return heard

    def shot(self, data: bytes, seq: int) -> None:
        """Garbage, and then at once a Hello that must be answered."""
        hello = protocol.encode(protocol.Hello(protocol.VERSION), seq)
        self.target.write(data + hello)
        # A tick to take it, and the telemetry that may stand before the answer on the line.
        heard = self.run((len(data) + len(hello)) * BYTE_US + 2 * TICK_US + 104 * BYTE_US)
        if not any(isinstance(message, protocol.Version) for message in heard):
            raise UserError(f"Hello was not taken after {data.hex()}")
        if self.now_us / 1e6 - self.clock_s > 2 * TELEMETRY_S:
            raise UserError("telemetry has stopped")


def main() -> int:
    """Runs the campaign."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bytes", nargs="?", type=argument(WholeRange(1)), default=1_000_000)
    parser.add_argument("seed", nargs="?", type=argument(WholeRange(0)), default=1)
    asked = parser.parse_args()
    total, seed = asked.bytes, asked.seed
    rng = random.Random(seed)
    sent = shots = 0
    try:
        with avr() as target:
            fuzz = Fuzz(target)
            while sent < total:
                data = garbage(rng)
                fuzz.shot(data, shots & 0xFF)
                sent += len(data)
                shots += 1
    except (UserError, TargetError) as error:
        print(f"fuzz_avr: after {sent} bytes (seed {seed}): {error}", file=sys.stderr)
        return 1
    print(
        f"{sent} random bytes in {shots} runs, {fuzz.now_us / 1e6:.0f} s on the line: "
        "no output on, no restart, every next frame taken"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
