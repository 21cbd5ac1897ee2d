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

from host.core.vehicle import Mount
from host.vision.view import CropView, Detector

GRID: Final = 8
"""Every so many pixels, a JPEG's block, one is compared."""
THUMBNAIL: Final = (32, 24)
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
WHITE: Final = 250
PROVED: Final = 3
"""Sound pictures in a row after a spoiled one until they are believed: of spoiled files one in ten
looks sound, and would keep a blind machine driving."""


class PictureWatch:
    """Looks at every picture of one camera, in order."""

    def __init__(self, width_px: int, height_px: int) -> None:
        self._shape = (height_px, width_px, 3)
        self._pixels: NDArray[np.int32] | None = None
        self._thumbnail: NDArray[np.int16] | None = None
        self.jumped = False
        """Whether the last picture, if sound, is quite another than the one before."""

    def problem(self, bgr: NDArray[np.uint8]) -> str:
        """Why the picture is not to be believed, in words; empty where it is. `bgr` is (height,
        width, 3), or of no pixels where the file is damaged."""
        if bgr.size == 0:
            return "the camera's picture is broken: its file is damaged"
        if bgr.shape != self._shape:
            return "the camera's picture is broken: it has another size"
        half = GRID // 2
        colours = bgr[half:-1:GRID, half:-1:GRID]
        pixels = colours.astype(np.int32) @ np.array([1, 1 << 8, 1 << 16], np.int32)
        grey = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
        thumbnail = cv2.resize(grey, THUMBNAIL, interpolation=cv2.INTER_AREA).astype(np.int16)
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


class WatchedDetector:
    """A detector that is shown only what its camera's watch believes."""

    def __init__(self, detector: Detector, mount: Mount) -> None:
        self._detector = detector
        self._watch = PictureWatch(mount.width_px, mount.height_px)
        self._spoilt = ""
        self._sound = PROVED

    def see(self, bgr: NDArray[np.uint8], *, stages: bool = False) -> CropView:
        """The detector's view, or one without any confidence that says why."""
        return self._problem(bgr) or self._detector.see(bgr, stages=stages)

    def glance(self, bgr: NDArray[np.uint8]) -> CropView:
        """Likewise, of a picture in which nothing is to be measured."""
        return self._problem(bgr) or self._detector.glance(bgr)

    def _problem(self, bgr: NDArray[np.uint8]) -> CropView | None:
        problem = self._watch.problem(bgr)
        self._sound = 0 if problem else self._sound + 1
        self._spoilt = problem or self._spoilt
        if self._sound < PROVED:
            return CropView(0.0, usable=False, reason=self._spoilt)
        if self._watch.jumped:
            # Stalks right before the lens do that: nothing to be measured, but no dead camera.
            reason = "the camera's picture is quite another than the one before"
            return CropView(0.0, reason=reason)
        return None

    def restart(self, *, turned: bool = True) -> None:
        """As the detector's; the camera is still the same."""
        self._detector.restart(turned=turned)
