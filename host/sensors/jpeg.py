"""JPEG files of a camera to pixels, spoiled ones told apart.

libjpeg fills in what is lost and only warns; simplejpeg can make an error of such a warning. A
machine must not steer by what was filled in.
"""

from __future__ import annotations

from typing import Final

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


def size_of(jpeg: bytes) -> tuple[int, int] | None:
    """(width, height) as the file's header says; None where it says nothing."""
    try:
        height, width, *_ = simplejpeg.decode_jpeg_header(jpeg, strict=False)
    except (ValueError, KeyError):
        return None
    return int(width), int(height)


class JpegDecoder:
    """Decodes the files of one camera, in order.

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
        return bgr


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
