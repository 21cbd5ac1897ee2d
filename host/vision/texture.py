"""Colour and texture of a photograph on a grid of square cells."""

from __future__ import annotations

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from host.vision.pictures import Picture, u8

QUANTITIES = 10
"""Quantities whose means over a cell make its features: Lab's three, the two brightness steps, what
two blurs take away, squares of light and yellow, and the cube of the relief."""

Means = NDArray[np.float32]
"""(h, w, QUANTITIES)."""

REACH_SIGMAS = 2.5
"""Half the width of a blur."""
RELIEF = np.float32(60)
"""Grey levels to which the relief is limited."""


def reduced(bgr: Picture, longer_px: int) -> Picture:
    """The picture with its longer side at most `longer_px`."""
    scale = longer_px / max(bgr.shape[:2])
    if scale >= 1:
        return bgr
    # bilinear averages enough down to a half, and is far quicker
    kind = cv2.INTER_AREA if scale < 0.5 else cv2.INTER_LINEAR
    return u8(cv2.resize(bgr, None, fx=scale, fy=scale, interpolation=kind))


def measure(bgr: Picture, cell: tuple[int, int], sigmas: tuple[float, float]) -> Means:
    """Means of a picture (height, width, 3) over cells of (rows, columns); what is left over at the
    right and lower borders is not looked at. `sigmas` in px: below the first scale, and between the
    two, grain is told apart."""
    lab = u8(cv2.cvtColor(bgr, cv2.COLOR_BGR2LAB))
    light = lab[..., 0].astype(np.float32)
    fine, coarse = (_blurred(light, sigma) for sigma in sigmas)
    h, w = light.shape
    means = np.zeros((h // cell[0], w // cell[1], QUANTITIES), np.float32)
    _accumulate(lab, fine, coarse, cell, means)
    means /= cell[0] * cell[1]
    return means


def _blurred(light: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    """OpenCV's own choice of size for floats reaches four sigmas, which nothing here needs."""
    size = 2 * round(REACH_SIGMAS * sigma) + 1
    return np.asarray(cv2.GaussianBlur(light, (size, size), sigma), np.float32)


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _accumulate(
    lab: Picture,
    fine: NDArray[np.float32],
    coarse: NDArray[np.float32],
    cell: tuple[int, int],
    sums: Means,
) -> None:
    height, width, _ = lab.shape
    for i in range(sums.shape[0]):
        for v in range(i * cell[0], (i + 1) * cell[0]):
            above, below = max(0, v - 1), min(height - 1, v + 1)
            for j in range(sums.shape[1]):
                for u in range(j * cell[1], (j + 1) * cell[1]):
                    before, after = max(0, u - 1), min(width - 1, u + 1)
                    light, yellow = np.float32(lab[v, u, 0]), np.float32(lab[v, u, 2])
                    across = np.int32(lab[v, after, 0]) - np.int32(lab[v, before, 0])
                    along = np.int32(lab[below, u, 0]) - np.int32(lab[above, u, 0])
                    relief = min(RELIEF, max(-RELIEF, light - coarse[v, u]))
                    sums[i, j, 0] += light
                    sums[i, j, 1] += np.float32(lab[v, u, 1])
                    sums[i, j, 2] += yellow
                    sums[i, j, 3] += np.float32(abs(across))
                    sums[i, j, 4] += np.float32(abs(along))
                    sums[i, j, 5] += abs(light - fine[v, u])
                    sums[i, j, 6] += abs(fine[v, u] - coarse[v, u])
                    sums[i, j, 7] += light * light
                    sums[i, j, 8] += yellow * yellow
                    sums[i, j, 9] += relief * relief * relief


def pooled(means: Means, sigma: float) -> Means:
    """Means over wider surroundings of `sigma` cells."""
    return np.asarray(cv2.GaussianBlur(means, (0, 0), sigma), np.float32)


def combine(means: Means, with_light: bool) -> NDArray[np.float32]:
    """(h, w, n) features of means. Brightness itself is left out of the search for a line: shadows
    and dust divide a picture as neatly as crop does."""
    light, yellow = means[..., 0], means[..., 2]
    out = np.empty((*means.shape[:2], 10 if with_light else 9), np.float32)
    out[..., :2] = means[..., 1:3]
    out[..., 2:6] = np.log(means[..., 3:7] + np.float32(0.5))
    out[..., 6] = 0.5 * np.log(np.maximum(means[..., 7] - light * light, 0.0) + np.float32(1.0))
    out[..., 7] = 0.5 * np.log(np.maximum(means[..., 8] - yellow * yellow, 0.0) + np.float32(0.25))
    out[..., 8] = np.cbrt(means[..., 9])
    if with_light:
        out[..., 9] = light
    return out
