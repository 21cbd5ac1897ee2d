"""JPEG files of a camera to pixels, spoiled ones told apart.

libjpeg fills in what is lost and only warns; simplejpeg can make an error of such a warning. A
machine must not steer by what was filled in.
"""

from __future__ import annotations

import re
from typing import Final, Literal

import numpy as np
import simplejpeg
from numpy.typing import NDArray

Bgr = NDArray[np.uint8]

NOTHING: Final[Bgr] = np.zeros((0, 0, 3), np.uint8)
"""The pixels of a spoiled file: a picture came, and nothing of it is to be believed."""


MAX_PIXELS: Final = 4096 * 2160
"""More takes longer to decode than the machine may wait (50 megapixels 1.5 s, these 0.1 s): a phone
is set to a small picture, and a header that says more may be spoiled."""
MAX_SCANS: Final = 40
"""Passes over the picture in a progressive file: cameras write one, programs 10. A small file may
ask for thousands of them, each of which takes 0.2 ms of 640x480."""
SCAN: Final = b"\xff\xda"
END: Final = b"\xff\xd9"
"""The marker that ends a file (ITU-T T.81, B.1.1.3)."""
_AFTER_SCAN: Final = re.compile(rb"\xff[^\x00\xff\xd0-\xd7]")
"""What ends a scan: in it, zeros follow each FF that is no marker, and restarts belong to it."""


def size_of(jpeg: bytes) -> tuple[int, int] | None:
    """(width, height) as the file's header says; None where it says nothing."""
    try:
        height, width, *_ = simplejpeg.decode_jpeg_header(jpeg, strict=False)
    except (ValueError, KeyError):
        return None
    return int(width), int(height)


EXIF: Final = b"Exif\0\0"
EXIF_WITHIN: Final = 256
"""Bytes of a file in which that begins: its segment is the first, or follows the short JFIF one."""
ORIENTATION: Final = 0x0112
"""The tag (EXIF 2.3, 4.6.4) that says how a viewer has to turn the picture: 1 not at all."""
ENTRY: Final = 12
"""Bytes of an entry of its table: tag, type, count, value."""


def orientation_of(jpeg: bytes) -> int:
    """1..8: how the phone was held, as EXIF says; 1 where it says nothing."""
    at = jpeg.find(EXIF, 0, EXIF_WITHIN)
    if at < 0:
        return 1
    tiff = jpeg[at + len(EXIF) : at + 0x10000]
    order: Literal["little", "big"] = "little" if tiff.startswith(b"II") else "big"

    def number(begin: int, size: int = 2) -> int:
        return int.from_bytes(tiff[begin : begin + size], order)

    table = number(4, 4)
    for k in range(number(table)):
        entry = table + 2 + ENTRY * k
        if entry + ENTRY > len(tiff):
            break
        if number(entry) == ORIENTATION:
            return max(1, number(entry + 8)) if number(entry + 8) <= 8 else 1
    return 1


def upright(bgr: Bgr, orientation: int) -> Bgr:
    """The way up that a viewer shows it. From 5 on the sensor's rows are the picture's columns; of
    each four the second is mirrored left to right, the third turned round, the fourth mirrored."""
    turned = bgr.transpose(1, 0, 2) if orientation >= 5 else bgr
    rows, columns = _FLIPS[orientation]
    return np.ascontiguousarray(turned[::rows, ::columns])


_FLIPS: Final = {
    1: (1, 1), 2: (1, -1), 3: (-1, -1), 4: (-1, 1), 5: (1, 1), 6: (1, -1), 7: (-1, -1), 8: (-1, 1),
}  # fmt: skip
"""Steps along rows and columns of an orientation's picture."""


def end_of(data: bytes | bytearray, begin: int) -> int | None:
    """Behind the last byte of the file that begins there; None where it is not whole, or none. A
    file may hold another one, a thumbnail: the segments' own lengths tell which end is its."""
    at = begin + 2
    while at + 2 <= len(data) and data[at] == END[0]:
        kind = data[at + 1]
        if kind == END[1]:
            return at + 2
        at += 2 + int.from_bytes(data[at + 2 : at + 4])
        if kind == SCAN[1]:
            found = _AFTER_SCAN.search(data, at)
            if found is None:
                return None
            at = found.start()
    return None


class JpegDecoder:
    """Decodes the files of one camera, in order, the way up that EXIF says: so the panel's browser
    shows them, and so `daranti see` reads photographs.

    Some cameras' files are never clean (bytes too many before the end marker, say), so warnings
    count from the first clean file on.
    """

    def __init__(self) -> None:
        self._clean = False

    def decode(self, jpeg: bytes) -> Bgr:
        """(height, width, 3), or NOTHING where the file is spoiled."""
        bgr = _decode(jpeg, strict=True)
        if bgr.size:
            self._clean = True
        elif not self._clean:
            bgr = _decode(jpeg, strict=False)
        held = orientation_of(jpeg)
        return bgr if held == 1 else upright(bgr, held)


def _decode(jpeg: bytes, *, strict: bool) -> Bgr:
    if jpeg.count(SCAN) > MAX_SCANS:
        return NOTHING
    try:
        height, width, *_ = simplejpeg.decode_jpeg_header(jpeg, strict=strict)
        if height * width > MAX_PIXELS:
            return NOTHING
        bgr = simplejpeg.decode_jpeg(jpeg, "BGR", strict=strict)
    except (ValueError, KeyError):  # a KeyError for a header of no known colour space
        return NOTHING
    return np.asarray(bgr, np.uint8)
