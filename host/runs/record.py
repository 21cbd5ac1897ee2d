"""Records: one MCAP file a run, JSON messages whose schemas Foxglove understands.

Crash-safe by construction: what the run depends on stands at the beginning, outside any chunk; then
come chunks of a second or two, each written whole, so a run that was killed leaves everything up to
its last chunk. Any MCAP reader that reads in the file's order does; `read` stops there, and says it
to whoever asks.

Numbers are kept in full, so that a replay computes with what the run computed with.
"""

from __future__ import annotations

import base64
import contextlib
import errno
import itertools
import json
import math
import shutil
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, NoReturn, TypeVar

import zstandard
from mcap import records
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, DataEnd, McapRecord, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, IndexType, Writer

from host.core.errors import UserError
from host.core.input_file import check_input
from host.core.messages import Command, Fix, Request, State, Telemetry, Turned
from host.estimate.kalman import Innovation
from host.pilot.snapshot import Snapshot
from host.route.plan import Plan
from host.vision.view import CropView

PICTURES = "/camera"
"""The topic of the pictures."""
CHUNK_BYTES = 64 * 1024
"""What a crash may lose of a record: less than a second with pictures."""
LARGEST = 64 * 1024 * 1024
"""Bytes of a chunk or a record in it; a picture takes a tenth of a megabyte."""
DENSEST = 200
"""Times its bytes that a file may unpack to, beyond LARGEST; a record without pictures: 20."""
SPARE_BYTES = 20e6
"""Of a disk that a live run's record leaves free: the progress, some kilobytes, is what the next
run needs."""
ROOM_EVERY = 50
"""Messages after which the disk is asked again: less than a second of a drive, a megabyte."""
INFINITE = 1e9
"""Stands for infinity, which JSON does not have."""

_NUMBER: dict[str, Any] = {"type": ["number", "null"]}
_TEXT: dict[str, Any] = {"type": "string"}
_BYTES: dict[str, Any] = {"type": "string", "contentEncoding": "base64"}
_TIME: dict[str, Any] = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
}


def _schema(**fields: dict[str, Any]) -> dict[str, Any]:
    return {"type": "object", "properties": fields}


def _numbers(*names: str) -> dict[str, dict[str, Any]]:
    return dict.fromkeys(names, _NUMBER)


SCHEMAS: dict[str, tuple[str, dict[str, Any]]] = {
    "/camera": (
        "foxglove.CompressedImage",
        _schema(timestamp=_TIME, frame_id=_TEXT, data=_BYTES, format=_TEXT),
    ),
    "/fix": (
        "foxglove.LocationFix",
        _schema(
            timestamp=_TIME,
            frame_id=_TEXT,
            **_numbers("latitude", "longitude", "altitude", "quality", "hdop", "satellites"),
            **_numbers("speed_mps", "course_rad"),
        ),
    ),
    "/turned": ("daranti.Turned", _schema(**_numbers("yaw_rad", "since", "nose_up_rad"))),
    "/telemetry": (
        "daranti.Telemetry",
        _schema(
            state=_TEXT,
            **_numbers("faults", "setpoint_rad", "angle_rad", "steer_duty", "drive_duty"),
            blade={"type": "boolean"},
            **_numbers("speed_mps", "distance_m", "battery_v", "last_seq", "frames_bad"),
            refusal=_TEXT,
        ),
    ),
    "/command": (
        "daranti.Command",
        _schema(
            request=_TEXT,
            **_numbers("steer_rad", "speed_mps"),
            blade={"type": "boolean"},
            reason=_TEXT,
        ),
    ),
    "/operator": ("daranti.Operator", _schema(paused={"type": "boolean"})),
    "/view": (
        "daranti.CropView",
        _schema(
            **_numbers("confidence", "edge_offset_m", "edge_heading_rad", "crop_ahead_m"),
            **_numbers("edge_offset_most_m", "edge_beside_m", "edge_ahead_m", "tip_share"),
            **_numbers("lies_confidence", "shown_turn_rad", "shown_way_m", "same_ago"),
            **_numbers("ahead_confidence", "end_of_field", "e_outer_px", "o_map_px"),
            **_numbers("l_height_px", "l_reference_px", "ahead_by_height_m"),
            reason=_TEXT,
            hidden={"type": "boolean"},
            crop_right={"type": "boolean"},
            usable={"type": "boolean"},
        ),
    ),
    "/pilot": (
        "daranti.Pilot",
        _schema(
            phase=_TEXT,
            reason=_TEXT,
            **_numbers("turns", "offset_m", "heading_rad", "distance_m", "x_m", "y_m", "yaw_rad"),
        ),
    ),
    "/plan": ("daranti.Plan", _schema(text=_TEXT)),
    "/innovation": (
        "daranti.Innovation",
        _schema(
            name=_TEXT, **_numbers("value", "sigma", "nis", "dimensions"), used={"type": "boolean"}
        ),
    ),
    "/truth": (
        "daranti.Truth",
        _schema(
            **_numbers("x_m", "y_m", "yaw_rad", "speed_mps", "steer_rad", "coverage"),
            **_numbers("missed_m2", "neighbour_cut_m2", "edge_offset_m"),
        ),
    ),
    "/serial/to_firmware": ("daranti.Bytes", _schema(data=_BYTES)),
    "/serial/to_host": ("daranti.Bytes", _schema(data=_BYTES)),
    "/fault": ("daranti.Fault", _schema(index=_NUMBER, fault=_TEXT, begins={"type": "boolean"})),
    "/summary": ("daranti.Summary", _schema(text=_TEXT)),
}


def _clean(value: Any) -> Any:
    """JSON has neither NaN, which becomes null, nor infinity."""
    if isinstance(value, float):
        if math.isfinite(value):
            return value
        return None if math.isnan(value) else math.copysign(INFINITE, value)
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    return value


def _time(stamp: float) -> dict[str, int]:
    nanoseconds = round(stamp * 1e9)
    return {"sec": nanoseconds // 10**9, "nsec": nanoseconds % 10**9}


_BROKEN = (McapError, ValueError, KeyError, EOFError, struct.error, zstandard.ZstdError)
"""What a file that is cut off, spoiled or no record makes the reader raise."""

ABOUT = "daranti"
"""Name of the metadata that say what the run depends on."""


class Recorder(contextlib.AbstractContextManager["Recorder"]):
    """Writes one record. Deterministic: the same messages give the same bytes."""

    def __init__(
        self,
        path: Path,
        metadata: Mapping[str, str] | None = None,
        tee: Callable[[str, int, bytes], None] | None = None,
        lost: Callable[[str], None] | None = None,
    ) -> None:
        """`metadata` says what the run depends on; `tee(topic, nanoseconds, JSON)` gets every
        message as well. Raises UserError where the file cannot be written, later on too, but where
        `lost` is given: that is told once, and the run goes on without its record. Then the record
        ends before the disk is full."""
        self.path = path
        self._tee = tee
        self._lost = lost
        self._ended = False
        fresh = path.with_name(f".{path.name}.new")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = fresh.open("wb")
        except OSError as error:
            raise UserError(f"cannot write the record {path}: {error.strerror}") from error
        self._writer = Writer(
            self._file,
            chunk_size=CHUNK_BYTES,
            compression=CompressionType.ZSTD,
            index_types=IndexType.ALL,
        )
        self._writer.start(profile="", library="daranti")
        self._channels: dict[str, int] = {}
        self._sequence = 0
        self._writer.add_metadata(ABOUT, dict(metadata or {}))
        self._file.flush()
        fresh.replace(path)  # whoever sees the record sees its beginning

    def put(self, topic: str, stamp: float, message: Mapping[str, Any]) -> None:
        """Appends a message of a topic in SCHEMAS at `stamp` seconds."""
        channel = self._channels.get(topic)
        if channel is None:
            name, schema = SCHEMAS[topic]
            schema_id = self._writer.register_schema(
                name, "jsonschema", json.dumps(schema, sort_keys=True).encode()
            )
            channel = self._writer.register_channel(topic, "json", schema_id)
            self._channels[topic] = channel
        data = json.dumps({key: _clean(value) for key, value in message.items()}).encode()
        nanoseconds = max(0, round(stamp * 1e9))
        if not self._ended:
            try:
                if self._lost is not None and self._sequence % ROOM_EVERY == 0:
                    self._leave_room()
                self._writer.add_message(channel, nanoseconds, data, nanoseconds, self._sequence)
                self._file.flush()  # a chunk that is complete is on the disk
            except OSError as error:
                self._end(error)
        self._sequence += 1
        if self._tee is not None:
            self._tee(topic, nanoseconds, data)

    def picture(self, stamp: float, jpeg: bytes) -> None:
        """A camera picture as it came from the phone; `stamp` is the shutter's."""
        message = {"timestamp": _time(stamp), "frame_id": "camera", "format": "jpeg", "data": jpeg}
        self.put(PICTURES, stamp, message)

    def telemetry(self, telemetry: Telemetry) -> None:
        """One telemetry message."""
        fields = {n: getattr(telemetry, n) for n in telemetry.__dataclass_fields__ if n != "stamp"}
        self.put("/telemetry", telemetry.stamp, fields | {"state": telemetry.state.name})

    def command(self, stamp: float, command: Command) -> None:
        """One command, as the pilot gave it."""
        message = {
            "request": command.request.value,
            "steer_rad": command.steer_rad,
            "speed_mps": command.speed_mps,
            "blade": command.blade,
            "reason": command.reason,
        }
        self.put("/command", stamp, message)

    def fix(self, fix: Fix) -> None:
        """One GNSS epoch."""
        message = {
            "timestamp": _time(fix.stamp),
            "frame_id": "wgs84",
            "latitude": fix.lat_deg,
            "longitude": fix.lon_deg,
            "altitude": 0.0,
            "quality": fix.quality,
            "hdop": fix.hdop,
            "satellites": fix.satellites,
            "speed_mps": fix.speed_mps,
            "course_rad": fix.course_rad,
        }
        self.put("/fix", fix.stamp, message)

    def turned(self, turned: Turned) -> None:
        """What the gyroscope has turned."""
        numbers = {"yaw_rad": turned.yaw_rad, "since": turned.since}
        self.put("/turned", turned.stamp, {**numbers, "nose_up_rad": turned.nose_up_rad})

    def pilot(self, stamp: float, snapshot: Snapshot) -> None:
        """What the pilot is doing, and where it believes to be."""
        self.put("/pilot", stamp, asdict(snapshot))

    def plan(self, stamp: float, plan: Plan) -> None:
        """The plan as it has been laid out anew, in JSON: `boundary` has the corners as found."""
        self.put("/plan", stamp, {"text": json.dumps(asdict(plan))})

    def innovations(self, stamp: float, innovations: Iterable[Innovation]) -> None:
        """What the estimator made of its measurements since the last call."""
        for one in innovations:
            self.put("/innovation", stamp, asdict(one))

    def view(self, stamp: float, view: CropView) -> None:
        """What vision made of the picture taken at `stamp`."""
        names = SCHEMAS["/view"][1]["properties"]
        self.put("/view", stamp, {name: getattr(view, name) for name in names})

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Writes the index; without it the record is readable, only slower to seek in."""
        try:
            if not self._ended:
                self._finish()
        except OSError as error:
            self._end(error)

    def _finish(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def _leave_room(self) -> None:
        """OSError where the disk is all but full; the record is whole until here."""
        if shutil.disk_usage(self.path.parent).free < SPARE_BYTES:
            self._finish()
            raise OSError(errno.ENOSPC, f"the disk has only {SPARE_BYTES / 1e6:.0f} MB left")

    def _end(self, error: OSError) -> None:
        self._ended = True
        with contextlib.suppress(OSError):
            self._file.close()
        words = f"the record {self.path} ends here: {error.strerror}"
        if self._lost is None:
            raise UserError(words) from error
        self._lost(words)


def unused(path: Path) -> Path:
    """The path, or beside it the first of NAME-2, NAME-3 ... that no record has: what was recorded
    once is not written over."""
    names = (path.with_name(f"{path.stem}-{k}{path.suffix}") for k in itertools.count(2))
    return next(each for each in itertools.chain([path], names) if not each.exists())


def _records(path: Path, cut: Callable[[str], None] | None = None) -> Iterator[McapRecord]:
    """The file's records up to its end or the first that is not whole: then `cut` is told why.
    UserError where the file is missing or is no record."""
    check_input(path, "the record", once=False)
    try:
        file = path.open("rb")
    except OSError as error:
        raise UserError(f"cannot read the record {path}: {error.strerror}") from error
    count, room, whole = 0, LARGEST + DENSEST * path.stat().st_size, False
    with file:
        try:
            for record in StreamReader(file, emit_chunks=True, record_size_limit=LARGEST).records:
                room -= record.uncompressed_size if isinstance(record, Chunk) else 0
                if room < 0:
                    raise ValueError("it holds far more than a record of its size")
                whole = whole or isinstance(record, DataEnd)  # what follows is but an index
                for each in _unpacked(record):
                    count += 1
                    yield each
        except _BROKEN as error:
            if not count:
                why = str(error) or ("it is empty" if not path.stat().st_size else "it is cut off")
                raise UserError(f"{path} is not a record (MCAP): {why}") from error
            if cut is not None and not whole:
                cut(str(error) or "cut off")


def _unpacked(record: McapRecord) -> Iterator[McapRecord]:
    """A chunk's records, anything else as it is. ValueError where a chunk claims to hold more than
    any run writes: what is small on the disk may fill the memory."""
    if not isinstance(record, Chunk):
        yield record
        return
    size = record.uncompressed_size
    if record.compression == "zstd":
        size = max(size, zstandard.frame_content_size(record.data))
    if size > LARGEST:
        raise ValueError(f"a chunk of {size / 1e6:.0f} MB")
    yield from breakup_chunk(record, validate_crc=True)


def about(path: Path) -> dict[str, str]:
    """What the run depends on, as its Recorder was told. UserError as in `read`."""
    for record in _records(path):
        if isinstance(record, Metadata) and record.name == ABOUT:
            return dict(record.metadata)
    return {}


class Message(dict[str, Any]):
    """A message as it was read. UserError where it lacks what is asked of it."""

    def __init__(self, values: Mapping[str, Any], where: str) -> None:
        super().__init__(values)
        self.where = where

    def __missing__(self, name: str) -> NoReturn:
        raise UserError(f"{self.where} has no {name}: it was written by another program")


def read(
    path: Path, tell: Callable[[str], None] | None = None
) -> Iterator[tuple[str, float, Message]]:
    """(topic, stamp in s, message) in the order written; ends at the last whole chunk of a record
    that is not whole, whose run was killed or whose file was cut off: then `tell` is told so in
    words. UserError where the file is missing or is no record, or holds what no run writes."""
    topics: dict[int, str] = {}
    last = 0.0

    def cut(why: str) -> None:
        if tell is not None:
            tell(
                f"{path} is not whole: its last message is of {last:.1f} s, what came after it is "
                f"missing or damaged ({why}). Its run was killed, or its file was not copied whole"
            )

    for record in _records(path, cut):
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, records.Message):
            topic, stamp = topics.get(record.channel_id, ""), record.log_time / 1e9
            last = stamp
            yield topic, stamp, _message(record.data, topic, f"{path}: {topic} at {stamp:.2f} s")


def _message(data: bytes, topic: str, where: str) -> Message:
    """UserError where it is none, or a field is of another kind than the topic's."""
    try:
        message = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise UserError(f"{where} is damaged: {error}") from error
    fields: Mapping[str, Any] = SCHEMAS[topic][1]["properties"] if topic in SCHEMAS else {}
    if not isinstance(message, dict):
        raise UserError(f"{where} is damaged: no object of JSON")
    for name, kind in fields.items():
        if name in message and not isinstance(message[name], _PYTHON[str(kind["type"])]):
            raise UserError(f"{where} is damaged: {name} is {type(message[name]).__name__}")
        if name in message and "contentEncoding" in kind:
            try:
                message[name] = base64.b64decode(message[name])
            except ValueError as error:
                raise UserError(f"{where} is damaged: {name}: {error}") from error
    return Message(message, where)


_PYTHON: Final[dict[str, Any]] = {
    "['number', 'null']": float | int | None,
    "string": str,
    "boolean": bool,
    "object": dict,
    "integer": int,
    "array": list,
}
"""What the kinds of SCHEMAS become."""

Built = TypeVar("Built")


def _built(kind: Callable[..., Built], message: Message, **more: Any) -> Built:
    try:
        return kind(**{**message, **more})
    except TypeError as error:
        raise UserError(f"{message.where} is not understood: {error}") from error


def _named(kind: Callable[[str], Built], name: str, message: Message) -> Built:
    try:
        return kind(message[name])
    except (KeyError, ValueError) as error:
        raise UserError(f"{message.where}: there is no {name} {message[name]!r}") from error


def telemetry_of(stamp: float, message: Message) -> Telemetry:
    """A /telemetry message as it went in."""
    state = _named(State.__getitem__, "state", message)
    return _built(Telemetry, message, stamp=stamp, state=state)


def fix_of(stamp: float, message: Message) -> Fix:
    """A /fix message as it went in."""
    return Fix(
        stamp,
        message["latitude"],
        message["longitude"],
        message["quality"],
        message["hdop"],
        message["satellites"],
        message["speed_mps"],
        message["course_rad"],
    )


def turned_of(stamp: float, message: Message) -> Turned:
    """A /turned message as it went in."""
    nose_up = message.get("nose_up_rad")
    nose_up_rad = math.nan if nose_up is None else nose_up
    return Turned(stamp, message["yaw_rad"], message["since"], nose_up_rad)


def view_of(message: Message) -> CropView:
    """The numbers of a /view message as they went in; pictures are not kept."""
    values: dict[str, Any] = {}
    for name, value in message.items():
        if value is None:
            values[name] = math.nan
        elif isinstance(value, float) and abs(value) == INFINITE:
            values[name] = math.copysign(math.inf, value)
        else:
            values[name] = value
    return _built(CropView, Message(values, message.where))


def command_of(message: Message) -> Command:
    """A /command message as it went in."""
    return _built(Command, message, request=_named(Request, "request", message))
