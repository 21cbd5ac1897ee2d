"""What lies on the lens: parts of the picture that stay as they are while the machine moves.

Ground and crop pass by, and every part of the picture shows now this, now that. Mud on the lens
stays, and lets no light through. Its border is as sharp as the crop's, and the crop may go on
behind it. Even ground may seem to stay as well, but it is bright.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from host.core.compiled import compiled
from host.vision.pictures import Mask, u8

CELL_PX: Final = 8
"""Side of the cells that are watched."""
MEMORY: Final = 1 / 15
"""Weight of the newest picture: 1.5 s are remembered."""
KNOWN: Final = 10
"""Pictures, taken while moving, from which on something is said."""
MOVES: Final = 1.5
"""Mean change of a cell from picture to picture, of 255, above which the machine moves. Driven
pictures have 3 to 10; noise alone has less than 1."""
AGAIN: Final = 5
"""Of the pictures taken while moving, every so many it is asked anew what is covered."""
STAYS: Final = 0.35
"""Of the cells' median spread over time: what varies less, and is darker than the median cell, is
covered. In drives of seed 31 half to three quarters of the cells under mud are, and no others."""


class LensWatch:
    """Watches the pictures of one camera, in order."""

    def __init__(self, size: tuple[int, int], horizon: int) -> None:
        """`size`: width and height, pixels; `horizon`: the first row of ground."""
        self._cells = (max(1, size[0] // CELL_PX), max(1, size[1] // CELL_PX))
        self._scale = np.array([self._cells[0] / size[0], self._cells[1] / size[1]])
        self._ground = min(self._cells[1] - 1, horizon // CELL_PX + 1)
        self._before: Mask | None = None
        self._mean = np.zeros((self._cells[1], self._cells[0]), np.float32)
        self._square = np.zeros_like(self._mean)
        self._seen = 0
        self.covered = np.zeros(self._mean.shape, np.bool_)
        """Cells in which something lies on the lens."""

    def see(self, grey: Mask) -> None:
        """`grey`: (height, width) brightness, 0..255."""
        small = self._shrunk(grey)
        before, self._before = self._before, small
        if before is None or _change(small, before) < MOVES * small.size:
            return
        self._seen += 1
        weight = max(MEMORY, 1.0 / self._seen)
        cv2.accumulateWeighted(small, self._mean, weight)
        cv2.accumulateWeighted(np.square(small, dtype=np.float32), self._square, weight)
        if self._seen < KNOWN or self._seen % AGAIN:
            return
        variance = np.maximum(self._square - self._mean * self._mean, 0.0)
        spread = cv2.blur(np.sqrt(variance), (3, 3))
        ground = slice(self._ground, None)
        stays = spread < STAYS * np.median(spread[ground])
        self.covered = np.asarray(stays & (self._mean < np.median(self._mean[ground])))
        self.covered[: self._ground] = False

    def _shrunk(self, grey: Mask) -> Mask:
        """The mean of each cell."""
        if grey.shape != (CELL_PX * self._cells[1], CELL_PX * self._cells[0]):
            return u8(cv2.resize(grey, self._cells, interpolation=cv2.INTER_AREA))
        small = np.empty((self._cells[1], self._cells[0]), np.uint8)
        _means(grey, small)
        return small

    def share(self, pixels: NDArray[np.float64]) -> float:
        """Of (n, 2) pixels (u, v), those that are covered; what lies outside of the picture counts
        as seen."""
        u, v = np.floor(pixels * self._scale).astype(np.int64).T
        inside = (u >= 0) & (u < self._cells[0]) & (v >= 0) & (v < self._cells[1])
        return float(self.covered[v[inside], u[inside]].sum()) / len(pixels)


@compiled("(u1[:, ::1], u1[:, ::1])", boundscheck=False)
def _means(grey: Mask, small: Mask) -> None:
    """Of cells of `CELL_PX` by `CELL_PX` pixels, halves to the even number: as OpenCV's
    INTER_AREA, which takes five times as long."""
    pixels = CELL_PX * CELL_PX
    columns = np.empty(grey.shape[1], np.uint16)
    for i in range(small.shape[0]):
        columns[:] = 0
        for v in range(CELL_PX * i, CELL_PX * (i + 1)):
            row = grey[v]
            for u in range(row.shape[0]):
                columns[u] += row[u]
        for j in range(small.shape[1]):
            total = 0
            for u in range(CELL_PX * j, CELL_PX * (j + 1)):
                total += columns[u]
            half = pixels // 2 - 1 + (total // pixels & 1)
            small[i, j] = (total + half) // pixels


@compiled("(u1[:, ::1], u1[:, ::1])", boundscheck=False)
def _change(now: Mask, before: Mask) -> int:
    """Sum of how much each cell differs."""
    total = 0
    for i in range(now.shape[0]):
        for j in range(now.shape[1]):
            total += int(abs(np.int16(now[i, j]) - np.int16(before[i, j])))
    return total
