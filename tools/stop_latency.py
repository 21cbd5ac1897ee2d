"""From a cause to all outputs off, on the desk build and on the Uno's binary in simavr: the worst
over the phases of a tick, to 0.1 ms. Exits 1 where a bound is passed.

What the firmware sees at once must be off within 10 ms, a limit within its time and 10 ms.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from hil.firmware.targets import Hang, ResetCause
from host.core.errors import UserError
from host.link import protocol
from tests.firmware.conftest import Maker, maker_of
from tests.firmware.test_behaviour import bench_running
from tests.helpers.firmware_bench import (
    BATTERY,
    DRIVE_SENSE,
    OPEN_MV,
    POT,
    SHORT_MV,
    STEER_SENSE,
    Bench,
    drive_mv,
    steer_mv,
)

FINE_US = 100
PHASES_MS = range(5)
LONGEST_MS = 2000


@dataclass(frozen=True)
class Case:
    """`cause` strikes a machine that drives and cuts; it may run it on to where the time begins."""

    name: str
    bound_ms: float
    cause: Callable[[Bench], None]
    keep_driving: bool = True
    """Whether commands keep coming."""


def analog(channel: int, millivolt: int) -> Callable[[Bench], None]:
    """A voltage at an input."""

    def cause(bench: Bench) -> None:
        bench.target.set_analog_mv(channel, millivolt)
        if channel == POT:
            bench.pot_mv = millivolt

    return cause


def jump(bench: Bench) -> None:
    """10 degrees at once."""
    analog(POT, bench.actuator.pot_mv() + 220)(bench)


def open_loop(bench: Bench) -> None:
    """The e-stop."""
    bench.estop(OPEN_MV)


def shorted_loop(bench: Bench) -> None:
    """The e-stop's wire touches the chassis."""
    bench.estop(SHORT_MV)


def full_duty(bench: Bench) -> None:
    """Asks for an angle until the motor has full duty."""
    bench.ask(steer_deg=40.0, speed=0.5)
    while bench.steer_duty != 255:
        bench.run(1)


def freeze(bench: Bench) -> None:
    """The potentiometer's reading stays, and the wheel is driven."""
    bench.pot_mv = bench.actuator.pot_mv()
    full_duty(bench)


def jam(bench: Bench) -> None:
    """The wheel stays, with the motor's stall current."""
    bench.actuator.jammed = True
    bench.target.set_analog_mv(STEER_SENSE, steer_mv(9.0))
    full_duty(bench)


def silence(bench: Bench) -> None:
    """No command any more; the time begins with the end of the last one's frame."""
    bench.run(20 - bench.now_us // 1000 % 20)
    bench.target.write(frame := protocol.encode(bench.command, (bench.seq + 1) & 0xFF))
    end_us = bench.now_us + len(frame) * 85
    bench.now_us = -(-end_us // FINE_US) * FINE_US
    bench.target.run_until(bench.now_us)


def stop(bench: Bench) -> None:
    """A STOP on the line; its 0.5 ms there count."""
    bench.target.write(protocol.encode(protocol.Stop(), 0))


def hang(bench: Bench) -> None:
    """The main loop."""
    bench.target.hang(Hang.MAIN)


def hang_interrupt(bench: Bench) -> None:
    """With interrupts off."""
    bench.target.hang(Hang.INTERRUPT)


def brown_out(bench: Bench) -> None:
    """A reset by the supply."""
    bench.cut_frames = 1
    bench.target.reset(ResetCause.BROWN_OUT)


CASES = (
    Case("STOP", 10, stop, False),
    Case("ESTOP_OPEN", 10, open_loop),
    Case("ESTOP_SHORT", 20, shorted_loop),
    Case("POT_JUMP", 10, jump),
    Case("POT_OPEN", 20, analog(POT, 5000)),
    Case("POT_SHORT", 20, analog(POT, 0)),
    Case("STEER_OVERCURRENT", 60, analog(STEER_SENSE, steer_mv(22.0))),
    Case("DRIVE_OVERCURRENT", 60, analog(DRIVE_SENSE, drive_mv(45.0))),
    Case("BATTERY_HIGH", 110, analog(BATTERY, 4000)),
    Case("BATTERY_LOW", 610, analog(BATTERY, 2400)),
    Case("LINK_LOST", 250, silence, False),
    Case("POT_FROZEN, full duty", 250, freeze),
    Case("STEER_STALL, full duty", 250, jam),
    Case("WATCHDOG, hung main loop", 20, hang),
    Case("WATCHDOG, hung interrupt", 40, hang_interrupt),
    Case("BROWN_OUT, reset", 10, brown_out),
)


def latency_ms(case: Case, make: Maker, phase_ms: int) -> float:
    """One run."""
    bench = bench_running(make)
    bench.run(phase_ms)
    if not case.keep_driving:
        bench.drive_period_ms = 0
    case.cause(bench)
    start = bench.now_us
    coming = bench.drive_period_ms
    while not bench.off():
        if coming and bench.now_us % (coming * 1000) == 0:
            bench.send(bench.command)
        bench.now_us += FINE_US
        bench.target.run_until(bench.now_us)
        if bench.now_us - start > LONGEST_MS * 1000:
            raise UserError(f"{case.name}: still on after {LONGEST_MS} ms")
    bench.target.close()
    return (bench.now_us - start) / 1000


def main() -> int:
    """Prints the table."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    bad = 0
    print(f"{'cause':<28}{'desk':>9}{'avr':>9}{'bound':>9}  ms")
    try:
        for case in CASES:
            worst = [
                max(latency_ms(case, make, phase) for phase in PHASES_MS)
                for make in (maker_of("desk"), maker_of("avr"))
            ]
            late = max(worst) > case.bound_ms
            bad += late
            print(
                f"{case.name:<28}{worst[0]:>9.1f}{worst[1]:>9.1f}{case.bound_ms:>9.0f}"
                f"{'  PASSED' if late else ''}"
            )
    except UserError as error:
        print(f"stop_latency: {error}", file=sys.stderr)
        return 2
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
