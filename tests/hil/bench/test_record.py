"""Facts about records: they give back what went in, and survive the death of their run."""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import os
import random
import struct
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType, Writer

from hil.bench.replay import replay
from hil.firmware import targets
from hil.judge.plots import series
from host.core.errors import UserError
from host.core.messages import Command, Fix, Request, State, Telemetry, Turned
from host.core.vehicle import Vehicle
from host.runs import record
from host.runs.pictures import recorded
from host.runs.record import Recorder
from host.vision.view import CropView
from tests.helpers.oracle import run_for_ever

needs_firmware = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built: make build"
)
NUMBER = st.floats(allow_nan=False, allow_infinity=False, width=64)
SEEN = st.one_of(NUMBER, st.just(math.nan), st.just(math.inf), st.just(-math.inf))
STAMP = st.integers(0, 10**13).map(lambda ns: ns / 1e9)


# ---- what goes in comes out ----------------------------------------------------------------------


@given(STAMP, SEEN, SEEN, SEEN, st.text(max_size=20))
def test_a_view_comes_back_as_it_was(
    stamp: float, offset: float, heading: float, ahead: float, reason: str
) -> None:
    view = CropView(
        0.75,
        edge_offset_m=offset,
        edge_heading_rad=heading,
        crop_ahead_m=ahead,
        ahead_confidence=1.0,
        reason=reason,
    )
    with Scratch() as path:
        with Recorder(path) as recorder:
            recorder.view(stamp, view)
        ((topic, at, message),) = record.read(path)
    back = record.view_of(message)
    assert (topic, at) == ("/view", stamp)
    for name in record.SCHEMAS["/view"][1]["properties"]:
        before, after = getattr(view, name), getattr(back, name)
        assert before == after or (math.isnan(before) and math.isnan(after)), name


@given(STAMP, NUMBER, NUMBER, st.one_of(st.none(), NUMBER), st.integers(0, 2**32 - 1))
def test_telemetry_command_and_fix_come_back_as_they_were(
    stamp: float, a: float, b: float, c: float | None, faults: int
) -> None:
    telemetry = Telemetry(stamp, State.RUNNING, faults, a, b, -255, 255, True, c, a, b, 255, 65535)
    command = Command(Request.DRIVE, a, b, True, "why")
    fix = Fix(stamp, a, b, 1, 0.9, 8, c, c)
    with Scratch() as path:
        with Recorder(path) as recorder:
            recorder.telemetry(telemetry)
            recorder.command(stamp, command)
            recorder.fix(fix)
        (_, at, first), (_, _, second), (_, _, third) = record.read(path)
    assert record.telemetry_of(at, first) == telemetry
    assert record.command_of(second) == command
    assert record.fix_of(at, third) == fix


@given(STAMP, NUMBER, NUMBER, st.one_of(st.just(math.nan), NUMBER))
def test_what_the_gyroscope_turned_comes_back_as_it_was(
    stamp: float, yaw: float, since: float, nose_up: float
) -> None:
    turned = Turned(stamp, yaw, since, nose_up)
    with Scratch() as path:
        with Recorder(path) as recorder:
            recorder.turned(turned)
        ((_, at, message),) = record.read(path)
    back = record.turned_of(at, message)
    assert replace(back, nose_up_rad=0.0) == replace(turned, nose_up_rad=0.0)
    assert back.nose_up_rad == pytest.approx(nose_up, nan_ok=True)


def test_of_a_record_before_the_accelerometer_was_kept_it_is_not_known() -> None:
    assert math.isnan(record.turned_of(1.0, {"yaw_rad": 0.1, "since": 0.0}).nose_up_rad)


class Scratch:
    """A record's path that hypothesis may use again and again."""

    def __enter__(self) -> Path:
        self._path = Path(f"/tmp/daranti-test-{os.getpid()}.mcap")
        return self._path

    def __exit__(self, *_: object) -> None:
        self._path.unlink(missing_ok=True)


def test_a_record_says_what_its_run_depends_on_before_anything_happened(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorder = Recorder(path, {"scenario": "{}"})
    assert record.about(path) == {"scenario": "{}"}
    assert list(record.read(path)) == []
    recorder.close()
    assert record.about(path) == {"scenario": "{}"}


@pytest.mark.parametrize("content", [b"", b"no record at all", b"\x89MCAP0\r\n"[:5]])
def test_what_is_no_record_is_one_message(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "odd.mcap"
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"odd\.mcap is not a record"):
        list(record.read(path))


def test_a_missing_record_is_one_message(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot read the record"):
        list(record.read(tmp_path / "none.mcap"))


def test_a_record_that_cannot_be_written_is_one_message(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot write the record"):
        Recorder(tmp_path / "file" / "run.mcap")


CUT_TAIL = (McapError, struct.error)
"""What the library's reader raises where a file ends: between two fields, or within one."""


def messages_by_the_library(path: Path) -> int:
    """How many messages another reader finds before the file ends."""
    seen = 0
    with path.open("rb") as file, contextlib.suppress(*CUT_TAIL):
        for _ in NonSeekingReader(file).iter_messages(log_time_order=False):
            seen += 1
    return seen


def of_3000_messages(folder: Path) -> Path:
    """A record of half a minute that does not compress."""
    path = folder / "run.mcap"
    with Recorder(path) as recorder:
        for k in range(3000):
            recorder.put("/serial/to_host", k / 100, {"data": random.Random(k).randbytes(60)})
    return path


def test_a_cut_tail_costs_only_itself(tmp_path: Path) -> None:
    path = of_3000_messages(tmp_path)
    whole = path.read_bytes()
    before = list(record.read(path))
    assert len(before) == 3000
    counts = []
    for size in range(len(whole), 200, -len(whole) // 97):
        path.write_bytes(whole[:size])
        got = list(record.read(path))
        assert got == before[: len(got)]
        assert len(got) == messages_by_the_library(path)
        counts.append(len(got))
    assert counts == sorted(counts, reverse=True)
    assert counts[len(counts) // 2] > 1000


def test_what_is_missing_is_told_and_nothing_else_is(tmp_path: Path) -> None:
    path = of_3000_messages(tmp_path)
    whole = path.read_bytes()
    spoiled = bytearray(whole)
    begins = len(whole) // 4  # of a chunk: the middle is of an index
    spoiled[begins : begins + 4000] = bytes(4000)
    said: dict[str, list[str]] = {}
    for name, content in (
        ("whole", whole),
        ("index cut", whole[:-20]),
        ("cut", whole[: len(whole) // 2]),
        ("spoiled", bytes(spoiled)),
    ):
        path.write_bytes(content)
        said[name] = []
        last = [stamp for _, stamp, _ in record.read(path, said[name].append)][-1]
        if said[name]:
            assert f"{path} is not whole: its last message is of {last:.1f} s" in said[name][0]
    assert {name: len(texts) for name, texts in said.items()} == {
        "whole": 0,
        "index cut": 0,
        "cut": 1,
        "spoiled": 1,
    }


def test_pictures_of_a_record_that_was_cut_off_are_not_all(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    jpeg = cv2.imencode(".jpg", np.zeros((480, 640, 3), np.uint8))[1].tobytes()
    with Recorder(path) as recorder:
        for k in range(200):
            recorder.picture(k / 10, jpeg)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    found = []
    with pytest.raises(UserError, match=r"is not whole.*; it has \d+ pictures up to there"):
        found.extend(recorded(path))
    assert 0 < len(found) < 200


# ---- a run that is killed ------------------------------------------------------------------------


CLEAN = multiprocessing.get_context("forkserver")
"""Processes that inherit no threads and need not import everything again."""
CLEAN.set_forkserver_preload([run_for_ever.__module__])
LIMIT_S = 300.0


def killed_run(path: Path, size: int) -> None:
    """A run in a process of its own, killed once its record has grown to `size` bytes."""
    child = CLEAN.Process(target=run_for_ever, args=(str(path),))
    child.start()
    try:
        deadline = time.monotonic() + LIMIT_S
        while not (path.exists() and path.stat().st_size >= size):
            assert child.is_alive()
            assert time.monotonic() < deadline
            time.sleep(0.001)
    finally:
        child.kill()
        child.join()


@needs_firmware
@pytest.mark.parametrize("count", [6, pytest.param(50, marks=pytest.mark.long)], ids=["6", "50"])
def test_a_run_killed_at_any_moment_leaves_a_record_that_replays(
    tmp_path: Path, count: int
) -> None:
    draw = random.Random(count)
    commands = []
    for k in range(count):
        path = tmp_path / f"run{k}.mcap"
        killed_run(path, draw.randrange(400_000))
        with path.open("rb") as file:
            assert next(iter(NonSeekingReader(file).iter_metadata())).name == record.ABOUT
        assert messages_by_the_library(path) == sum(1 for _ in record.read(path))
        outcome = replay(path)
        assert not outcome.pilot, outcome.pilot[0]
        assert not outcome.firmware, outcome.firmware[0]
        commands.append(outcome.commands)
    assert max(commands) > 100


def test_a_small_file_that_would_fill_the_memory_is_no_record(tmp_path: Path) -> None:
    """A megabyte of zeros a byte of file: zstandard's best case as a chunk."""
    path = tmp_path / "bomb.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1 << 30, compression=CompressionType.ZSTD)
        writer.start(profile="", library="x")
        schema = writer.register_schema("daranti.Bytes", "jsonschema", b"{}")
        channel = writer.register_channel("/serial/to_host", "json", schema)
        for k in range(12):
            writer.add_message(channel, k, b" " * 8_000_000, k, k)
        writer.finish()
    assert path.stat().st_size < 100_000
    assert list(record.read(path)) == []


@pytest.mark.parametrize("spoil", [b"\xff", b"\0" * 40, b"(\xb5/\xfd" * 8])
def test_a_spoiled_chunk_is_no_internal_error(tmp_path: Path, spoil: bytes) -> None:
    path = tmp_path / "a.mcap"
    with Recorder(path) as recorder:
        for k in range(200):
            recorder.put("/serial/to_host", k / 100, {"data": random.Random(k).randbytes(900)})
    data = bytearray(path.read_bytes())
    for at in range(400, len(data) - 100, 997):
        data[at : at + len(spoil)] = spoil
    path.write_bytes(data)
    try:
        list(record.read(path))
    except UserError as error:
        assert str(path) in str(error)


def written(path: Path, messages: list[tuple[str, bytes]], about: dict[str, str]) -> Path:
    """A record whose container is sound."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1 << 20, compression=CompressionType.ZSTD)
        writer.start(profile="", library="x")
        writer.add_metadata(record.ABOUT, about)
        for k, (topic, data) in enumerate(messages):
            schema = writer.register_schema("x", "jsonschema", b"{}")
            channel = writer.register_channel(topic, "json", schema)
            writer.add_message(channel, k, data, k, k)
        writer.finish()
    return path


RUN = {"vehicle": Vehicle().model_dump_json(), "mount": "mast", "mode": "robust"}
READ = ("/camera", "/fix", "/telemetry", "/command", "/view", "/pilot", "/fault", "/operator")


@pytest.mark.parametrize("topic", READ)
@pytest.mark.parametrize(
    "data",
    [
        b"[" * 100_000, b"[1]", b"3", b"null", b"{}", b"\xff", b'{"data": 5}', b'{"data": "%"}',
        b'{"state": "NOPE", "request": "fly", "x": 1}',
        b'{"phase": 1, "begins": "no"}', b'{"paused": 3}',
    ],
)  # fmt: skip
def test_messages_that_no_run_writes_are_told_by_all_that_read_records(
    tmp_path: Path, topic: str, data: bytes
) -> None:
    path = written(tmp_path / "a.mcap", [(topic, data)], RUN)
    for reader in (replay, series, lambda path: list(recorded(path))):
        with contextlib.suppress(UserError):
            reader(path)


@pytest.mark.parametrize(
    ("name", "value"),
    [("plan", "[1]"), ("plan", "[" * 100_000), ("plan", '{"sides": [{}]}'), ("vehicle", "{"),
     ("scenario", "[" * 100_000), ("paper", "{}{")],
)  # fmt: skip
def test_a_run_that_is_not_understood_is_told(tmp_path: Path, name: str, value: str) -> None:
    with pytest.raises(UserError, match="not understood"):
        replay(written(tmp_path / "a.mcap", [], RUN | {name: value}))


def test_many_small_chunks_that_would_fill_the_memory_are_no_record(tmp_path: Path) -> None:
    full = b'{"data": "' + b"A" * 40_000_000 + b'"}'
    path = written(tmp_path / "a.mcap", [("/serial/to_host", full)] * 5, RUN)
    assert path.stat().st_size < 100_000
    assert sum(1 for _ in record.read(path)) < 4
