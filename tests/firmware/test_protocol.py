"""The generated protocol against its golden frames, an independent decoder, and itself."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path

import crcmod.predefined
import pytest
from cobs import cobs
from hypothesis import given
from hypothesis import strategies as st

from host.core import messages as host_types
from host.link import protocol
from host.link.protocol import Fault, Parser

ROOT = Path(__file__).resolve().parent.parent.parent
GOLDEN = ROOT / "firmware" / "test" / "golden_frames.txt"
FRAMES = [
    line.split() for line in GOLDEN.read_text().splitlines() if line and not line.startswith("#")
]
crc_ccitt_false = crcmod.predefined.mkCrcFun("crc-ccitt-false")


@st.composite
def messages(draw: st.DrawFn) -> protocol.Message:
    """Any message that can come off the wire."""
    kind = draw(st.sampled_from(protocol.MESSAGES))
    payload = draw(st.binary(min_size=kind.LAYOUT.size, max_size=kind.LAYOUT.size))
    try:
        return kind.parse(payload)
    except ValueError:
        return protocol.Stop()


def test_generated_files_are_what_the_schema_says() -> None:
    command = [sys.executable, str(ROOT / "tools" / "protogen.py"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(("name", "seq", "payload", "frame"), FRAMES)
def test_golden_frames(name: str, seq: str, payload: str, frame: str) -> None:
    raw = bytes.fromhex(frame)
    [(taken_seq, message)] = Parser().feed(raw)
    assert type(message).__name__ == name
    assert taken_seq == int(seq, 16)
    assert message.payload() == bytes.fromhex(payload.replace("-", ""))
    assert protocol.encode(message, taken_seq) == raw


def test_every_message_has_a_golden_frame() -> None:
    assert {name for name, *_ in FRAMES} == {kind.__name__ for kind in protocol.MESSAGES}


@given(messages(), st.integers(0, 255))
def test_an_independent_decoder_agrees(message: protocol.Message, seq: int) -> None:
    frame = protocol.encode(message, seq)
    assert frame.endswith(b"\0")
    body = cobs.decode(frame[:-1])
    assert body[:2] == bytes((message.ID, seq))
    assert int.from_bytes(body[-2:], "little") == crc_ccitt_false(body[:-2])


@given(st.binary(max_size=600))
def test_cobs_agrees_with_the_library(data: bytes) -> None:
    assert protocol.cobs_encode(data) == cobs.encode(data)
    assert protocol.cobs_decode(cobs.encode(data)) == data


@given(st.binary(min_size=1, max_size=40))
def test_cobs_refuses_what_the_library_refuses(data: bytes) -> None:
    try:
        expected = cobs.decode(data)
    except cobs.DecodeError:
        with pytest.raises(ValueError, match="COBS"):
            protocol.cobs_decode(data)
    else:
        assert protocol.cobs_decode(data) == expected


@given(messages(), st.integers(0, 255))
def test_what_is_encoded_is_parsed(message: protocol.Message, seq: int) -> None:
    frame = protocol.encode(message, seq)
    [(taken, parsed)] = Parser().feed(frame)
    assert taken == seq
    assert parsed == message
    assert protocol.encode(parsed, seq) == frame


@given(st.binary(max_size=300), messages(), st.data())
def test_after_any_garbage_the_next_whole_frame_is_taken(
    garbage: bytes, message: protocol.Message, data: st.DataObject
) -> None:
    stream = garbage + protocol.encode(message, 7)
    parser = Parser()
    out: list[tuple[int, protocol.Message]] = []
    while stream:
        cut = data.draw(st.integers(1, len(stream)))
        out += parser.feed(stream[:cut])
        stream = stream[cut:]
    assert out[-1] == (7, message)


def test_bad_frames_are_counted() -> None:
    parser = Parser()
    frame = protocol.encode(protocol.Stop(), 1)
    parser.feed(b"\0\0" + frame + b"\x05\x05\0" + b"\x01" * 200 + frame + frame)
    assert parser.frames_ok == 3
    assert parser.frames_bad == 2


def test_a_value_that_does_not_fit_is_refused_with_its_message() -> None:
    with pytest.raises(ValueError, match="does not fit"):
        protocol.Drive(steer=10.0, speed=0.0, blade=0).payload()
    with pytest.raises(ValueError, match="must not be None"):
        protocol.Drive(steer=None, speed=0.0, blade=0).payload()  # type: ignore[arg-type]


def test_an_unknown_enum_value_is_a_bad_frame() -> None:
    body = bytes((protocol.Ack.ID, 0, 2, 1, 99))
    frame = cobs.encode(body + crc_ccitt_false(body).to_bytes(2, "little")) + b"\0"
    parser = Parser()
    assert parser.feed(frame) == []
    assert parser.frames_bad == 1


def test_every_fault_has_its_text_and_remedy() -> None:
    for bit in Fault:
        [text] = protocol.fault_texts(bit)
        what, remedy = protocol.FAULT_TEXTS[bit]
        assert text == f"{what}: {remedy}"
    assert protocol.fault_texts(Fault(0)) == []
    assert len(protocol.fault_texts(Fault(3))) == 2
    assert "0x80000000" in protocol.fault_texts(Fault(1 << 31))[0]


def test_the_host_s_states_are_the_wire_s() -> None:
    assert {s.name: int(s) for s in host_types.State} == {s.name: int(s) for s in protocol.State}


def test_parameters_convert_both_ways_and_name_their_range() -> None:
    for spec in protocol.PARAMS.values():
        for raw in (spec.min_raw, spec.default_raw, spec.max_raw):
            assert spec.to_raw(spec.from_raw(raw)) == raw
        for value in (spec.from_raw(spec.max_raw + 1), math.nan, math.inf):
            with pytest.raises(ValueError, match=f"{spec.name} must be .* to "):
                spec.to_raw(value)
    assert [spec.id for spec in protocol.PARAMS.values()] == list(range(len(protocol.PARAMS)))


def test_the_documentation_lists_every_fault_with_its_bit() -> None:
    text = (ROOT / "docs" / "understand" / "firmware.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| ([A-Z_]+) \|", text, flags=re.MULTILINE)
    assert rows == [(str(bit.bit_length() - 1), bit.name) for bit in Fault]
