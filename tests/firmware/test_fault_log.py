"""The fault log on the desk and on the Uno's binary: it outlives a reset, and a loss of power while
it is written."""

from __future__ import annotations

import pytest

from hil.firmware.provision import FITTED, eeprom
from hil.firmware.targets import ResetCause
from host.link import protocol
from host.link.fault_log import ENTRIES
from host.link.protocol import Fault, State
from tests.firmware.conftest import Maker
from tests.helpers.firmware_bench import BATTERY, CLOSED_MV, OPEN_MV, Bench

LOG = 1024 - 12 * ENTRIES
"""Where it begins."""


def entries(bench: Bench) -> list[protocol.LogEntry]:
    """What the firmware answers, newest first."""
    bench.answers.clear()
    for index in range(ENTRIES):
        bench.send(protocol.LogGet(index))
        bench.run(8)
    bench.run(20)
    found = [a for a in bench.answers if isinstance(a, protocol.LogEntry)]
    assert [a.index for a in found] == list(range(ENTRIES))
    return [a for a in found if a.faults]


def test_what_failed_while_running_is_there_after_a_reset(make_target: Maker) -> None:
    bench = Bench(make_target(eeprom(tuple(FITTED.items()))))
    bench.run(1500)
    bench.arm()
    bench.ask(speed=0.5)
    bench.run(300)
    assert bench.last.state == State.RUNNING
    bench.estop(OPEN_MV)
    bench.run(10)
    bench.estop(CLOSED_MV)
    bench.run(300)
    bench.target.reset(ResetCause.EXTERNAL)
    bench.run(1500)
    [entry] = entries(bench)
    assert entry.faults == Fault.ESTOP_OPEN
    assert entry.state == State.RUNNING
    assert entry.reset_cause == ResetCause.POWER_ON
    assert entry.uptime == 1


def test_a_hang_is_in_it(make_target: Maker) -> None:
    bench = Bench(make_target())
    bench.run(100)
    bench.target.hang()
    bench.run(1500)
    [entry] = entries(bench)
    assert entry.faults == Fault.WATCHDOG
    assert entry.state == State.FAULT
    assert entry.uptime == 0


def test_two_faults_are_two_entries_and_clearing_leaves_none(make_target: Maker) -> None:
    bench = Bench(make_target())
    bench.run(1500)
    bench.estop(OPEN_MV)
    bench.run(10)
    bench.estop(CLOSED_MV)
    bench.run(2500)
    bench.target.set_analog_mv(BATTERY, 2000)
    bench.run(1000)
    found = entries(bench)
    assert [(e.number, e.faults) for e in found] == [(1, Fault.BATTERY_LOW), (0, Fault.ESTOP_OPEN)]
    assert [e.state for e in found] == [State.FAULT, State.SAFE]
    bench.answers.clear()
    bench.send(protocol.LogClear())
    bench.run(400)
    assert bench.result() == protocol.Result.OK
    assert entries(bench) == []
    again = Bench(make_target(bench.target.eeprom()))
    again.run(100)
    assert entries(again) == []


@pytest.mark.parametrize("cut_ms", range(0, 90, 7))
def test_power_lost_while_an_entry_is_written_costs_that_entry_at_most(
    make_target: Maker, cut_ms: int
) -> None:
    bench = Bench(make_target())
    bench.run(1500)
    bench.estop(OPEN_MV)
    bench.run(10)
    bench.estop(CLOSED_MV)
    bench.run(2500)
    bench.target.set_analog_mv(BATTERY, 2000)
    bench.run(605 + cut_ms)
    again = Bench(make_target(bench.target.eeprom()))
    again.run(100)
    found = [e.faults for e in entries(again)]
    assert found in ([Fault.ESTOP_OPEN], [Fault.BATTERY_LOW, Fault.ESTOP_OPEN])
    assert again.last.faults == 0, "the parameters are not touched"


def test_rubbish_in_its_place_is_no_entry_and_no_fault(make_target: Maker) -> None:
    image = bytearray(eeprom(tuple(FITTED.items())))
    image[LOG:] = bytes((37 * i + 11) & 0xFF for i in range(1024 - LOG))
    bench = Bench(make_target(bytes(image)))
    bench.run(100)
    assert bench.last.faults == 0
    assert entries(bench) == []


def test_both_targets_leave_the_same_memory(make_target: Maker) -> None:
    bench = Bench(make_target())
    bench.run(1500)
    for _ in range(3):
        bench.estop(OPEN_MV)
        bench.run(10)
        bench.estop(CLOSED_MV)
        bench.run(10)
        bench.send(protocol.Clear())
        bench.run(2500)
    log = bench.target.eeprom()[LOG:]
    for k in range(3):
        entry = log[12 * k : 12 * k + 12]
        crc = protocol.crc16(entry[:10])
        expected = (k, int(Fault.ESTOP_OPEN), [1, 4, 6][k], 1, 0)
        assert entry[:10] == b"".join(
            value.to_bytes(size, "little")
            for value, size in zip(expected, (2, 4, 2, 1, 1), strict=True)
        )
        assert entry[10:] == crc.to_bytes(2, "little")
    assert set(log[36:]) == {0xFF}
