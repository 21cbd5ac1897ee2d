"""Which way the texture of a part of a picture runs: steps across it against steps along it."""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from host.vision.pictures import Mask

GRAIN: Final = 5
"""Pixels over which grey is averaged along an edge before its step is taken; an odd number, so that
no mean lies halfway between two grey levels."""


@numba.njit(cache=True, nogil=True, boundscheck=False)
def squared_steps(grey: Mask, inside: Mask) -> tuple[float, float]:
    """Mean squares of the steps of `grey` (height, width) across the picture and along it, over the
    pixels where `inside` (height - 2, width - 2: without the border) is not 0."""
    height, width = grey.shape
    upright, level = np.empty((height, width), np.int16), np.empty((height, width), np.int16)
    _means_along(grey, upright)
    _means_along(grey.T, level.T)
    count, across, along = 0, 0, 0
    for v in range(1, height - 1):
        for u in range(1, width - 1):
            if inside[v - 1, u - 1]:
                count += 1
                x = np.int64(upright[v, u + 1] - upright[v, u - 1])
                y = np.int64(level[v + 1, u] - level[v - 1, u])
                across += x * x
                along += y * y
    return across / max(1, count), along / max(1, count)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _means_along(grey: Mask, mean: NDArray[np.int16]) -> None:
    """Of `GRAIN` rows about each pixel; beyond the border the picture goes on mirrored, the border
    itself not repeated."""
    height, width = grey.shape
    half = GRAIN // 2
    for v in range(height):
        row = mean[v]
        row[:] = half
        for k in range(-half, half + 1):
            at = abs(v + k)
            other = grey[at if at < height else 2 * (height - 1) - at]
            for u in range(width):
                row[u] += other[u]
        for u in range(width):
            row[u] //= GRAIN
