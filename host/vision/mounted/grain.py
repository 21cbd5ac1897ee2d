"""Which way the texture of a part of a picture runs: steps across it against steps along it."""

from __future__ import annotations

from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from host.core.compiled import compiled
from host.vision.pictures import Mask

REACH: Final = 2
"""Grey is averaged along an edge over so many pixels to either side before its step is taken: five
together."""
ROWS: Final = 8
"""Below so many nothing is said of a block."""
EVERY: Final = 3
"""Row that is looked at: neighbours hardly tell more."""
NOISE2: Final = 8.0
"""Mean squared step, in 255ths of the logarithmic range, below which there is but noise."""


@compiled("(u1[:, ::1], u1[:, ::1])", "(u1[:, :], u1[:, ::1])", boundscheck=False)
def squared_steps(grey: Mask, inside: Mask) -> tuple[float, float]:
    """Mean squares of the steps of `grey` (height, width) across the picture and along it, over the
    pixels where `inside` (height - 2, width - 2: without the border) is 255 and not 0. Beyond its
    border the picture goes on mirrored, the border itself not repeated."""
    height, width = grey.shape
    upright, level = np.empty((height, width), np.int16), np.empty((height, width), np.int16)
    wide, sums = np.empty(width + 2 * REACH, np.uint16), np.empty(width, np.uint16)
    for v in range(height):
        sums[:] = 0
        for k in range(-REACH, REACH + 1):
            at = abs(v + k)
            row = grey[at if at < height else 2 * (height - 1) - at]
            for u in range(width):
                sums[u] += row[u]
        _mean(sums, upright[v])
        row = grey[v]
        for u in range(width):
            wide[REACH + u] = row[u]
        for k in range(REACH):
            wide[REACH - 1 - k] = row[1 + k]
            wide[REACH + width + k] = row[width - 2 - k]
        for u in range(width):
            sums[u] = wide[u] + wide[u + 1] + wide[u + 2] + wide[u + 3] + wide[u + 4]
        _mean(sums, level[v])
    count, across, along = 0, 0, 0
    for v in range(1, height - 1):
        mask, middle, above, below = inside[v - 1], upright[v], level[v - 1], level[v + 1]
        x2, y2 = np.int32(0), np.int32(0)
        for u in range(1, width - 1):
            on = np.int32(mask[u - 1] & np.uint8(1))
            x, y = np.int32(middle[u + 1] - middle[u - 1]), np.int32(below[u] - above[u])
            count += int(on)
            x2 += on * x * x
            y2 += on * y * y
        across += int(x2)
        along += int(y2)
    return across / max(1, count), along / max(1, count)


@compiled("(u1[:, ::1], i4[::1], i4[::1], i8, f8[::1])", boundscheck=False)
def uprightness(
    grey: Mask,
    top: NDArray[np.int32],
    bottom: NDArray[np.int32],
    wide: int,
    out: NDArray[np.float64],
) -> None:
    """Per block of so many columns: squared steps of `grey` across the picture over those along it,
    in the rows from `top` up to `bottom` (without it); 0 where those are fewer than ROWS, or show
    no more than noise."""
    height, width = grey.shape
    for b in range(out.shape[0]):
        out[b] = 0.0
        left, right = max(1 + REACH, b * wide), min(width - 1 - REACH, (b + 1) * wide)
        first, last = max(1 + REACH, top[b]), min(height - 1 - REACH, bottom[b])
        if last - first < ROWS:
            continue
        across, along, count = 0, 0, 0
        for v in range(first, last, EVERY):
            for u in range(left, right):
                x, y = 0, 0
                for k in range(-REACH, REACH + 1):
                    x += int(grey[v + k, u + 1]) - int(grey[v + k, u - 1])
                    y += int(grey[v + 1, u + k]) - int(grey[v - 1, u + k])
                across += x * x
                along += y * y
                count += 1
        scale = (2 * REACH + 1) ** 2 * count
        if across + along > NOISE2 * scale:
            out[b] = across / max(1, along)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _mean(sums: NDArray[np.uint16], mean: NDArray[np.int16]) -> None:
    """Of five pixels, by their sums."""
    # 13108 / 2^16 is as near to a fifth as sums below 1280 need
    for u in range(sums.shape[0]):
        mean[u] = (np.uint32(sums[u]) + np.uint32(REACH)) * np.uint32(13108) >> np.uint32(16)
