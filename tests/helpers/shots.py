"""Pictures of a smooth scene that a camera pans over, with a sensor's noise."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT = 640, 480
Picture = NDArray[np.uint8]


def scene(seed: int = 1) -> Picture:
    """Something to look at: smooth shapes, wider than a picture so that it can pan over it."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(40, 200, (24, 64, 3), dtype=np.uint8)
    return np.asarray(cv2.resize(coarse, (2 * WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC))


def shot(scene: Picture, at_px: int = 0, noise_seed: int = 0) -> Picture:
    """The scene from `at_px`, with the sensor's noise."""
    rng = np.random.default_rng(noise_seed)
    part = scene[:, at_px : at_px + WIDTH].astype(np.int16)
    return np.clip(part + rng.normal(0, 2, part.shape).round(), 0, 255).astype(np.uint8)
