"""Detectors for photographs of unknown mount."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from host.vision.paper import PaperPhoto
from host.vision.split import Side
from host.vision.view import CropView


class PhotoDetector(Protocol):
    """Picture in, CropView in pixels out; metres stay NaN."""

    def see(self, bgr: NDArray[np.uint8], *, stages: bool = False) -> CropView: ...


def photo_detector(mode: str, side: Side) -> PhotoDetector:
    """The detector of `mode` for photographs whose crop stands on `side`."""
    del mode
    return PaperPhoto(side)
