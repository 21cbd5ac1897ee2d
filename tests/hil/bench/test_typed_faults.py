"""Facts about faults that are typed while the rig runs."""

from __future__ import annotations

import io
import threading

import pytest

from hil.bench.injector import Injector
from hil.bench.lockstep import Bench
from hil.bench.typed_faults import TypedFaults, fault_of
from hil.firmware import targets
from host.core.errors import UserError
from tests.helpers.oracle import quick


class Keys(io.StringIO):
    """What is typed; tells when all of it has been read."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.read_out = threading.Event()

    def __next__(self) -> str:
        try:
            return super().__next__()
        except StopIteration:
            self.read_out.set()
            raise


def typed(text: str, faults: Injector, now: float = 5.0, **options: bool) -> list[str]:
    said: list[str] = []
    keys = Keys(text)
    commands = TypedFaults(keys, said.append)
    assert keys.read_out.wait(10)
    commands.poll(now, faults, **options)
    return said


@pytest.mark.skipif(not targets.DESK_LIBRARY.exists(), reason="the firmware is not built")
def test_a_typed_fault_begins_ends_and_is_listed() -> None:
    bench = Bench(quick())
    try:
        bench.advance(0.1)
        assert not bench.faults.active
        assert typed("pot wrong value=40\n", bench.faults, bench.now) == ["0.1 s: pot wrong"]
        bench.advance(0.2)
        assert typed("list\n", bench.faults) == ["pot wrong"]
        assert typed("end\n\n", bench.faults, bench.now) == ["0.2 s: all is whole again"]
        bench.advance(0.3)
        assert typed("list\n", bench.faults) == ["nothing is broken"]
        assert [event.begins for event in bench.faults.events] == [True, False]
        typed("phone off for=0.05\n", bench.faults, bench.now)
        bench.advance(0.5)
        assert [event.begins for event in bench.faults.events] == [True, False, True, False]
    finally:
        bench.close()


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("[/nope]", "no such component"),
        ("pot", "pot can be: off"),
        ("pot exploded", "pot can be: off"),
        ("pot off now", "say COMPONENT"),
        ("pot off for=soon", "not a number"),
        ("pot off for=-1", "greater than 0"),
        ("host off", "stop `daranti drive`"),
        ("gnss wrong how=sideways", "jump"),
    ],
)
def test_what_cannot_be_broken_is_told(line: str, says: str) -> None:
    with pytest.raises(UserError, match=says.replace("(", r"\(")):
        fault_of(line, 1.0)


def test_a_wrong_line_ends_nothing_and_a_real_board_keeps_its_power() -> None:
    faults = Injector((), 1)
    assert len(typed("nonsense\nbattery off\n", faults, real_board=True)) == 2
    assert not faults.faults
