"""Stored parameters with something wrong: the other copy, or defaults, and said so, on either
target."""

from __future__ import annotations

from functools import cache

import crcmod.predefined
import pytest

from hil.firmware.provision import eeprom
from host.link import protocol
from host.link.protocol import Fault, Result, State
from tests.firmware.conftest import Maker
from tests.helpers.firmware_bench import Bench

COUNT = len(protocol.PARAMS)
BLOCK = 2 + 2 * COUNT + 2
"""Magic, count, values, CRC."""
SECOND = 512
"""Where the second copy lies."""
MAGIC = 0xDB
crc_ccitt_false = crcmod.predefined.mkCrcFun("crc-ccitt-false")
DEFAULTS = {spec.id: spec.default_raw for spec in protocol.PARAMS.values()}
CALIBRATED = {"pot_left": 800.0, "pot_centre": 500.0, "pot_right": 200.0}


@cache
def stored() -> bytes:
    """A memory in which no parameter has its default."""
    values = {
        name: spec.from_raw(spec.max_raw if spec.default_raw != spec.max_raw else spec.min_raw)
        for name, spec in protocol.PARAMS.items()
    }
    return eeprom(tuple((values | CALIBRATED).items()))


def written(values: list[int], copies: tuple[int, ...] = (0, SECOND)) -> bytes:
    """A memory with these raw values, as a firmware that knows so many of them writes it."""
    image = bytearray(b"\xff" * 1024)
    body = bytes((MAGIC, len(values)))
    body += b"".join(value.to_bytes(2, "little", signed=True) for value in values)
    body += crc_ccitt_false(body).to_bytes(2, "little")
    for at in copies:
        image[at : at + len(body)] = body
    return bytes(image)


def booted(make: Maker, image: bytes) -> Bench:
    """A bench whose firmware has run for a few ticks."""
    bench = Bench(make(image))
    bench.run(26)
    return bench


def read_back(bench: Bench, ids: list[int]) -> dict[int, int]:
    """The raw values that the firmware uses."""
    for number in ids:
        bench.send(protocol.ParamGet(number))
        bench.run(5)
    bench.run(5)
    return {a.param: a.value for a in bench.answers if isinstance(a, protocol.ParamValue)}


def test_what_is_stored_is_taken_and_is_what_the_format_says(make_target: Maker) -> None:
    bench = booted(make_target, stored())
    assert bench.last.state == State.SAFE
    values = read_back(bench, list(DEFAULTS))
    assert values.keys() == DEFAULTS.keys()
    assert not any(values[number] == DEFAULTS[number] for number in DEFAULTS)
    assert stored() == written([values[number] for number in DEFAULTS])


@pytest.mark.parametrize("flip", (0x01, 0x80, 0xFF))
@pytest.mark.parametrize("copy", (0, SECOND))
def test_any_wrong_byte_of_a_copy_means_the_other_and_is_reported(
    copy: int, flip: int, make_target: Maker
) -> None:
    for at in range(copy, copy + BLOCK, 7):
        image = bytearray(stored())
        image[at] ^= flip
        bench = booted(make_target, bytes(image))
        assert bench.last.state == State.FAULT, at
        assert bench.last.faults == Fault.PARAMS_COPY, at
        near = max(0, min((at - copy - 2) // 2, COUNT - 1))
        assert read_back(bench, [near])[near] != DEFAULTS[near], at
        bench.send(protocol.Clear())
        bench.run(10)
        assert bench.result() == Result.OK, at
        bench.target.close()


def test_with_both_copies_wrong_every_parameter_is_the_default(make_target: Maker) -> None:
    image = bytearray(stored())
    image[20] ^= 4
    image[SECOND + 30] ^= 4
    bench = booted(make_target, bytes(image))
    assert bench.last.faults == Fault.PARAMS_BAD
    assert read_back(bench, list(DEFAULTS)) == DEFAULTS


def test_with_rubbish_in_it_every_parameter_is_the_default(make_target: Maker) -> None:
    image = bytes((37 * i + 11) & 0xFF for i in range(1024))
    bench = booted(make_target, image)
    assert bench.last.faults == Fault.PARAMS_BAD
    assert read_back(bench, list(DEFAULTS)) == DEFAULTS


def test_what_lies_behind_the_copies_does_not_matter(make_target: Maker) -> None:
    image = bytearray(stored())
    image[BLOCK] ^= 0xFF
    image[SECOND + BLOCK] ^= 0xFF
    assert booted(make_target, bytes(image)).last.faults == 0


@pytest.mark.parametrize("known", (COUNT - 5, COUNT + 5))
def test_a_version_with_other_parameters_keeps_those_that_both_know(
    known: int, make_target: Maker
) -> None:
    raw = read_back(booted(make_target, stored()), list(DEFAULTS))
    values = [raw[number] for number in DEFAULTS][:known]
    values += [1] * (known - len(values))
    bench = booted(make_target, written(values))
    assert bench.last.faults == 0
    expected = DEFAULTS | dict(list(enumerate(values))[:COUNT])
    assert read_back(bench, list(DEFAULTS)) == expected


def test_a_value_out_of_its_range_costs_that_value_only(make_target: Maker) -> None:
    values = list(DEFAULTS.values())
    limit, gain = (protocol.PARAMS[name] for name in ("steer_limit", "steer_kp"))
    values[limit.id], values[gain.id] = 1234, gain.max_raw + 1
    bench = booted(make_target, written(values))
    assert bench.last.faults == Fault.PARAMS_BAD
    assert read_back(bench, [limit.id, gain.id]) == {limit.id: 1234, gain.id: gain.default_raw}


def test_a_save_that_loses_its_power_leaves_the_values_before_or_after(make_target: Maker) -> None:
    spec = protocol.PARAMS["steer_limit"]
    for cut_ms in range(1, 90, 4):
        bench = booted(make_target, stored())
        bench.set_param("steer_limit", 12.5)
        bench.send(protocol.ParamSave())
        bench.run(cut_ms)
        after = booted(make_target, bench.target.eeprom())
        value = read_back(after, [spec.id])[spec.id]
        assert value in (spec.to_raw(12.5), spec.max_raw, spec.min_raw), cut_ms
        assert after.last.faults in (0, Fault.PARAMS_COPY), cut_ms
        bench.target.close()
        after.target.close()
