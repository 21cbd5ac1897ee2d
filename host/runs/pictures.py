"""Pictures to look at: of a record of a drive, besides photographs and videos."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from host.core.errors import UserError
from host.runs import record
from host.sensors.jpeg import JpegDecoder
from host.vision import pictures
from host.vision.pictures import Picture

RECORD_SUFFIX = ".mcap"


def is_record(source: str) -> bool:
    """Whether a source of pictures is the record of a drive."""
    return "://" not in source and Path(source).suffix.lower() == RECORD_SUFFIX


def recorded(path: Path) -> Iterator[tuple[str, Picture]]:
    """The pictures that a record of a drive has kept."""
    decoder, spoiled, index = JpegDecoder(), 0, 0
    cut: list[str] = []
    for topic, stamp, message in record.read(path, cut.append):
        if topic != record.PICTURES:
            continue
        index += 1
        bgr = decoder.decode(message["data"])
        if bgr.size:
            yield f"{path.stem}-{stamp:08.2f}", bgr
        else:
            spoiled += 1
    if spoiled:
        raise UserError(f"{path}: {spoiled} of {index} pictures are damaged files, left out")
    if cut:
        raise UserError(f"{cut[0]}; it has {index} pictures up to there")
    if index == 0:
        raise UserError(f"{path}: the record keeps no pictures; record a drive with pictures")


def frames(source: str) -> Iterator[tuple[str, Picture]]:
    """As `vision.pictures.frames`, of a record (MCAP) too."""
    path = Path(source)
    if is_record(source) and path.is_file():
        return recorded(path)
    return pictures.frames(source)
