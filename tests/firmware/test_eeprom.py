"""Stored parameters with one byte wrong: defaults in use, and said so, on either target."""

from __future__ import annotations

from functools import cache

import pytest

from hil.firmware.provision import target
from host.link import protocol
from host.link.protocol import Fault, Result, State
from tests.firmware.conftest import Maker
from tests.helpers.firmware_bench import Bench

BLOCK = 2 + 2 * len(protocol.PARAMS) + 2
"""Magic, version, values, CRC."""
FLIPS = (0x01, 0x80, 0xFF)


@cache
def stored() -> bytes:
    """An EEPROM in which no parameter has its default."""
    values = {
        name: spec.from_raw(spec.max_raw if spec.default_raw != spec.max_raw else spec.min_raw)
        for name, spec in protocol.PARAMS.items()
    }
    values |= {"pot_left": 800.0, "pot_centre": 500.0, "pot_right": 200.0}
    with target("desk", values) as board:
        return board.eeprom()


def booted(make: Maker, eeprom: bytes) -> Bench:
    """A bench whose firmware has run for a few ticks."""
    bench = Bench(make(eeprom))
    bench.run(26)
    return bench


def read_back(bench: Bench, ids: list[int]) -> dict[int, int]:
    """The raw values that the firmware uses."""
    for number in ids:
        bench.send(protocol.ParamGet(number))
        bench.run(5)
    bench.run(5)
    return {a.param: a.value for a in bench.answers if isinstance(a, protocol.ParamValue)}


DEFAULTS = {spec.id: spec.default_raw for spec in protocol.PARAMS.values()}


def test_the_whole_block_is_taken(make_target: Maker) -> None:
    bench = booted(make_target, stored())
    assert bench.last.state == State.SAFE
    values = read_back(bench, list(DEFAULTS))
    assert values.keys() == DEFAULTS.keys()
    assert not any(values[number] == DEFAULTS[number] for number in DEFAULTS)


@pytest.mark.parametrize("flip", FLIPS)
def test_any_wrong_byte_means_defaults_and_is_reported(flip: int, make_target: Maker) -> None:
    for at in range(BLOCK):
        image = bytearray(stored())
        image[at] ^= flip
        bench = booted(make_target, bytes(image))
        assert bench.last.state == State.FAULT, at
        assert bench.last.faults == Fault.PARAMS_BAD, at
        near = max(0, min((at - 2) // 2, len(DEFAULTS) - 1))
        assert read_back(bench, [near]) == {near: DEFAULTS[near]}, at
        bench.send(protocol.Arm(protocol.VERSION))
        bench.run(10)
        assert bench.result() == Result.WRONG_STATE, at
        bench.target.close()


def test_with_rubbish_in_it_every_parameter_is_the_default(make_target: Maker) -> None:
    image = bytes((37 * i + 11) & 0xFF for i in range(1024))
    bench = booted(make_target, image)
    assert bench.last.faults == Fault.PARAMS_BAD
    assert read_back(bench, list(DEFAULTS)) == DEFAULTS


def test_what_lies_behind_the_block_does_not_matter(make_target: Maker) -> None:
    image = bytearray(stored())
    image[BLOCK] ^= 0xFF
    assert booted(make_target, bytes(image)).last.faults == 0
