"""What the finders look at: a mode's own stages of one picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from host.vision.pictures import Mask

Floats = NDArray[np.float32]
Sums = NDArray[np.float64]

LOGARITHM = np.round(255 * np.log1p(np.arange(256) / 10.0) / np.log1p(25.5)).astype(np.uint8)
"""Brightness to its logarithm, both 0..255."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a mode's own stages say of one picture; all (height, width)."""

    upright: Mask
    """255 on the standing crop's stems (VTSY)."""
    steps: Mask
    """255 on every step of brightness across the picture."""
    grey: Mask
    """Brightness, by its logarithm."""
