"""Upright stems by brightness alone: no colour, hence nothing to tune between morning and evening.

A stem is a step of brightness across the picture that goes on along the image of a true vertical
for longer than stubble is high at that place. Brightness is taken by its logarithm, so that stems
in shadow count as those in the sun do.
"""

from __future__ import annotations

import cv2
import numpy as np

from host.vision.face import Evidence
from host.vision.geometry import Camera
from host.vision.lines import rails, upright_pieces
from host.vision.pictures import Picture, u8

TILTS_DEG = (-3.5, 3.5)
"""Of wind-blown and leaning stems, about the mount's own verticals."""
STEP = 10
"""Least step between neighbours, in 255ths of the logarithmic range."""
LONGER = 1.7
"""Than stubble: a stem's least length."""
RAGGED_M = 0.02
"""Stubble stands this much above the blade's height."""
LEAST_PX = 6.0
GAP_PX = 2

_DARKEST = 10.0
_LOGARITHM = np.round(255 * np.log1p(np.arange(256) / _DARKEST) / np.log1p(255 / _DARKEST)).astype(
    np.uint8
)


class Stems:
    """The stage for pictures of one mount."""

    def __init__(self, camera: Camera, blade_height_m: float) -> None:
        width, height = camera.size
        self._tracks = [rails(width, height, camera, tilt) for tilt in TILTS_DEG]
        stubble = camera.stem_rows_px(blade_height_m + RAGGED_M)
        self._least_px = np.maximum(LEAST_PX, LONGER * stubble).astype(np.float32)

    def run(self, bgr: Picture) -> Evidence:
        """The evidence of one picture (height, width, 3)."""
        grey = u8(cv2.LUT(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY), _LOGARITHM))
        across = cv2.convertScaleAbs(cv2.Sobel(grey, cv2.CV_16S, 1, 0, ksize=1))
        along = cv2.convertScaleAbs(cv2.Sobel(grey, cv2.CV_16S, 0, 1, ksize=1))
        _, step = cv2.threshold(across, STEP, 255, cv2.THRESH_BINARY)
        steps = u8(cv2.bitwise_and(step, cv2.compare(across, along, cv2.CMP_GT)))
        upright = upright_pieces(steps, self._tracks, self._least_px, GAP_PX)
        return Evidence(upright, steps, grey)
