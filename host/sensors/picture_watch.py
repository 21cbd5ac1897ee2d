"""Whether a picture shows the world of now: not a repetition, not blank, not a broken file.

A detector finds edges in any picture. That a camera hangs, is covered or sends spoiled files shows
in what a picture has in common with the one before, whatever is in it: the sensor's noise changes
nearly every pixel, and the scene as a whole changes little within a second.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

GRID: Final = 8
"""Every so many pixels, a JPEG's block, one is compared."""
SMALL_PX: Final = 160
"""Columns of the small grey picture, in which motion shows."""
THUMBNAIL: Final = (32, 24)
"""Columns and rows of the small picture by which two are compared."""
REPEATED_SHARE: Final = 0.01
"""Of the compared pixels that differ at least between two pictures. Pictures of the simulated
sensor differ in 0.95 and more, at rest as well; a phone that smooths its noise away while nothing
moves in less, but never so little; what an app writes into a frozen picture (the time) is less."""
CONTRAST: Final = 6.0
"""Least standard deviation of a thumbnail's grey levels. Fields have 15 and more in the simulation
and 7.6 and more in photographs; a covered, dark or blinded lens has up to 5."""
JUMP: Final = 30.0
"""Mean change of a thumbnail's grey levels from picture to picture. Turning, with two pictures a
second, it reaches 23; of spoiled files nine in ten exceed 26."""
FLAT_SHARE: Final = 0.15
"""Of the compared pixels that equal the next ones, a block of the file away, white apart: what a
decoder fills in where a file's rest is lost, 0.38 and more of a halved one. Photographs have up to
0.01 at this size, crop close before the lens 0.04."""
SAME: Final = 1.5
"""Root mean square by which the thumbnails of two pictures of one scene, from one place, differ at
most, in grey levels. Fresh noise of 3 levels makes 0.3 of it, and pictures from places 0.3 m apart
5 and more, in six drives in crop."""
MEMORY: Final = 100
"""Pictures, ten seconds': an app that repeats a longer stretch is not known by it."""
WHITE: Final = 250
"""Of 255, in every colour: burnt-out sky is no broken file."""


class PictureWatch:
    """Looks at every picture of one camera, in order."""

    def __init__(self, width_px: int, height_px: int) -> None:
        self._shape = (height_px, width_px, 3)
        self._taken = 0
        self._kept_at = np.full(MEMORY, -MEMORY)
        self._kept = np.zeros((MEMORY, THUMBNAIL[0] * THUMBNAIL[1]), np.float32)
        """The thumbnails of that many pictures, and the how many-th each was."""
        self._power = np.zeros(MEMORY, np.float32)
        """The mean square of each."""
        self.small_size = (SMALL_PX, max(1, round(SMALL_PX * height_px / width_px)))
        self.small: NDArray[np.uint8] = np.zeros(self.small_size[::-1], np.uint8)
        """The last picture that had its right size, grey and `small_size` (columns, rows)."""
        self.same_ago = 0
        """How many pictures ago the first one came that the last one is the same as, but for its
        noise, of those that are remembered; 0: it is like none."""
        self._pixels: NDArray[np.int32] | None = None
        self._thumbnail: NDArray[np.int16] | None = None
        self.jumped = False
        """Whether the last picture, if sound, is quite another than the one before."""

    def problem(self, bgr: NDArray[np.uint8]) -> str:
        """Why the picture is not to be believed, in words; empty where it is. `bgr` is (height,
        width, 3), or of no pixels where the file is damaged."""
        self._taken += 1
        self.same_ago = 0
        if bgr.size == 0:
            return "the camera's picture is broken: its file is damaged"
        if bgr.shape != self._shape:
            return "the camera's picture is broken: it has another size"
        half = GRID // 2
        colours = bgr[half:-1:GRID, half:-1:GRID]
        pixels = colours.astype(np.int32) @ np.array([1, 1 << 8, 1 << 16], np.int32)
        grey = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
        small = cv2.resize(grey, self.small_size, interpolation=cv2.INTER_AREA)
        self.small = np.asarray(small, np.uint8)
        thumbnail = cv2.resize(small, THUMBNAIL, interpolation=cv2.INTER_AREA).astype(np.int16)
        self._compare(thumbnail)
        before, earlier = self._pixels, self._thumbnail
        self._pixels, self._thumbnail = pixels, thumbnail
        if before is not None and np.count_nonzero(pixels != before) < REPEATED_SHARE * pixels.size:
            return "the camera repeats its picture"
        if float(thumbnail.std()) < CONTRAST:
            return "the camera's picture shows nothing: dark, blinded or covered"
        here = pixels[:-1, :-1]
        flat = (here == pixels[:-1, 1:]) & (here == pixels[1:, :-1])
        if np.count_nonzero(flat) > FLAT_SHARE * flat.size:
            white = colours[:-1, :-1].min(axis=2) >= WHITE
            if np.count_nonzero(flat & ~white) > FLAT_SHARE * flat.size:
                return "the camera's picture is broken"
        jump = 0.0 if earlier is None else float(np.abs(thumbnail - earlier).mean())
        self.jumped = jump > JUMP
        return ""

    def _compare(self, thumbnail: NDArray[np.int16]) -> None:
        """With those that are remembered; and remembers it."""
        flat = thumbnail.astype(np.float32).ravel() - 128.0  # small numbers lose less in a sum
        power = flat @ flat / flat.size
        squares = self._power + power - 2.0 / flat.size * (self._kept @ flat)
        remembered = self._kept_at > self._taken - MEMORY
        same = self._kept_at[(squares < SAME**2) & remembered]
        self.same_ago = int(self._taken - same.min()) if same.size else 0
        at = self._taken % MEMORY
        self._kept[at], self._power[at], self._kept_at[at] = flat, power, self._taken
