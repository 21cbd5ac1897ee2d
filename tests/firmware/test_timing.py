"""How fast everything goes off, at 0.1 ms, measured on either target; the AVR's count."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from host.link import protocol
from tests.firmware.conftest import Maker
from tests.firmware.test_behaviour import bench_running
from tests.helpers.firmware_bench import OPEN_MV, POT, Bench

FINE_US = 100


def until_off(bench: Bench, limit_ms: float) -> float:
    """Milliseconds until all outputs are off."""
    start = bench.now_us
    while not bench.off():
        bench.now_us += FINE_US
        bench.target.run_until(bench.now_us)
        assert bench.now_us - start <= limit_ms * 1000, f"still on after {limit_ms} ms"
    return (bench.now_us - start) / 1000


def open_estop(bench: Bench) -> None:
    bench.estop(OPEN_MV)


def jump_pot(bench: Bench) -> None:
    bench.target.set_analog_mv(POT, bench.actuator.pot_mv() + 200)


@pytest.mark.parametrize("phase_ms", range(5))
@pytest.mark.parametrize("cause", [open_estop, jump_pot])
def test_outputs_are_off_within_10_ms_of_what_is_driven_at_once(
    cause: Callable[[Bench], None], phase_ms: int, make_target: Maker
) -> None:
    bench = bench_running(make_target)
    bench.run(phase_ms)
    cause(bench)
    assert until_off(bench, 10.0) <= 10.0


@pytest.mark.parametrize("phase_ms", range(5))
def test_the_estop_does_not_wait_for_the_converter(phase_ms: int, make_target: Maker) -> None:
    """Its pin is read in every tick. The converter would see it up to 7 ms later."""
    bench = bench_running(make_target)
    bench.run(phase_ms)
    open_estop(bench)
    assert until_off(bench, 10.0) <= 5.5


@pytest.mark.parametrize("phase_ms", range(5))
def test_link_loss_takes_at_most_250_ms_from_the_last_valid_command(
    phase_ms: int, make_target: Maker
) -> None:
    bench = bench_running(make_target)
    bench.drive_period_ms = 0
    bench.run(phase_ms)
    frame = protocol.encode(bench.command, (bench.seq + 1) & 0xFF)
    bench.target.write(frame)
    sent_ms = len(frame) * 0.085
    elapsed = until_off(bench, 252.0) - sent_ms
    assert 240.0 <= elapsed <= 250.0


@pytest.mark.parametrize("phase_ms", range(5))
def test_a_frozen_pot_is_found_within_250_ms_of_full_duty(
    phase_ms: int, make_target: Maker
) -> None:
    bench = bench_running(make_target)
    bench.pot_mv = bench.actuator.pot_mv()
    bench.run(phase_ms)
    bench.ask(steer_deg=40.0, speed=0.5)
    while bench.steer_duty != 255:
        bench.run(1)
    driven_at = bench.now_us
    while not bench.off():
        bench.run(1)
        assert bench.now_us - driven_at <= 250_000
    bench.run(40)
    assert bench.last.faults == protocol.Fault.POT_FROZEN


@pytest.mark.parametrize("phase_ms", range(5))
def test_stop_takes_one_tick(phase_ms: int, make_target: Maker) -> None:
    bench = bench_running(make_target)
    bench.drive_period_ms = 0
    bench.run(phase_ms)
    bench.target.write(protocol.encode(protocol.Stop(), 0))
    assert until_off(bench, 8.0) <= 7.0
