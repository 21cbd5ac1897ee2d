"""Pictures from outside: photographs, folders, videos and streams, as 8-bit colour or one clear
message."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from host.core.errors import UserError
from host.core.input_file import check_input
from host.core.whole_file import saved

Picture = NDArray[np.uint8]
"""(height, width, 3) blue, green, red."""
Mask = NDArray[np.uint8]
"""(height, width), 0 or 255."""

PHOTO_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"})
UNREAD_SUFFIXES = frozenset({".heic", ".heif", ".dng"})
"""Of photographs as phones make them that are not decoded: named, never passed over in a folder."""
LARGEST_SIDE_PX = 20_000
SMALLEST_SIDE_PX = 16
"""Sides of a picture that is read at all, greatest and least."""


def u8(picture: NDArray[np.generic]) -> NDArray[np.uint8]:
    """OpenCV's results, whose element type its stubs leave open."""
    return np.asarray(picture, dtype=np.uint8)


def to_bgr(picture: NDArray[np.generic]) -> Picture:
    """Any decoded picture (grey, alpha, 16 bits) as 8-bit blue-green-red."""
    p = picture
    if p.dtype == np.uint16:
        p = (p.astype(np.uint16) >> 8).astype(np.uint8)
    elif p.dtype != np.uint8:
        p = np.clip(np.nan_to_num(p.astype(np.float64)) * 255, 0, 255).astype(np.uint8)
    if p.ndim == 2:
        p = p[..., None]
    if p.shape[2] == 1:
        p = np.repeat(p, 3, axis=2)
    elif p.shape[2] == 2:
        p = np.repeat(p[..., :1], 3, axis=2)
    return np.ascontiguousarray(p[..., :3], dtype=np.uint8)


def read_photo(path: Path) -> Picture:
    """One photograph, the way up that a viewer shows it: a phone stores what its sensor saw, and
    says in EXIF how it was held. UserError where it cannot be used."""
    check_input(path, "the picture")
    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    decoded = None
    if len(data):
        try:
            decoded = cv2.imdecode(data, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
        except cv2.error:
            decoded = None
    if decoded is None:
        raise UserError(
            f"{path}: not a picture that can be decoded; give a whole JPEG or PNG, no HEIC"
        )
    h, w = decoded.shape[:2]
    if min(h, w) < SMALLEST_SIDE_PX or max(h, w) > LARGEST_SIDE_PX:
        raise UserError(
            f"{path}: {w}x{h} pixels; give a picture with sides of "
            f"{SMALLEST_SIDE_PX} to {LARGEST_SIDE_PX} pixels"
        )
    return to_bgr(decoded)


def write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    """UserError where it cannot be written: OpenCV would say nothing."""
    good, data = cv2.imencode(path.suffix, picture)
    if not good:
        raise ValueError(f"{path}: OpenCV does not write such pictures")
    with saved(path, sync=False) as fresh:
        fresh.write_bytes(data.tobytes())


def _is_photo(path: Path) -> bool:
    return path.suffix.lower() in PHOTO_SUFFIXES | UNREAD_SUFFIXES


def photos_in(path: Path) -> list[Path]:
    """The photographs of a folder, sorted; or the one named."""
    if not path.is_dir():
        return [path]
    found = sorted(p for p in path.iterdir() if _is_photo(p))
    if not found:
        raise UserError(
            f"{path}: no photographs in this folder ({', '.join(sorted(PHOTO_SUFFIXES))})"
        )
    return found


def frames(source: str) -> Iterator[tuple[str, Picture]]:
    """(name, picture) of every photograph of a file or folder, or every frame of a video
    file or an HTTP stream. UserError where the source cannot be opened; pictures that cannot
    be decoded are left out, and named by one after the others."""
    path = Path(source)
    if "://" not in source:
        if not path.exists():
            raise UserError(f"{source}: no such file or folder; check the path")
        if not path.is_char_device():  # a camera is one
            check_input(path, "the source", once=False)
        if path.is_dir() or _is_photo(path):
            bad = []
            for photo in photos_in(path):
                try:
                    picture = read_photo(photo)
                except UserError as error:
                    bad.append(str(error))
                    continue
                yield photo.stem, picture
            if bad:
                raise UserError("\n".join(bad))
            return
    capture = cv2.VideoCapture(source)
    try:
        if not capture.isOpened():
            raise UserError(f"{source}: neither a picture nor a video or stream that can be opened")
        stem = path.stem or "stream"
        index = 0
        while True:
            good, frame = capture.read()
            if not good:
                break
            yield f"{stem}-{index:06d}", to_bgr(frame)
            index += 1
        if index == 0:
            raise UserError(f"{source}: the video holds no frame that can be decoded")
    finally:
        capture.release()
