"""Colour and texture of a photograph on a grid of square cells."""

from __future__ import annotations

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from host.core.compiled import compiled
from host.vision.pictures import Picture, u8

QUANTITIES = 10
"""Quantities whose means over a cell make its features: Lab's three, the two brightness steps, what
two blurs take away, squares of light and yellow, and the cube of the relief."""

Means = NDArray[np.float32]
"""(h, w, QUANTITIES)."""

WITHOUT_LIGHT = 9
"""The first features of `combine`, by which the line is searched."""
DARK = 25.0
"""Of 255, added to brightness before colour and texture are seen relative to it: there is little of
either in the dark."""
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
    planes = cv2.split(u8(cv2.cvtColor(bgr, cv2.COLOR_BGR2LAB)))
    light = planes[0].astype(np.float32)
    fine, coarse = (_blurred(light, sigma) for sigma in sigmas)
    h, w = light.shape
    means = np.empty((h // cell[0], w // cell[1], QUANTITIES), np.float32)
    _accumulate(light, u8(planes[1]), u8(planes[2]), fine, coarse, cell, means)
    means /= cell[0] * cell[1]
    return means


def _blurred(light: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    """OpenCV's own choice of size for floats reaches four sigmas, which nothing here needs."""
    size = 2 * round(REACH_SIGMAS * sigma) + 1
    return np.asarray(cv2.GaussianBlur(light, (size, size), sigma), np.float32)


@compiled(
    "(f4[:, ::1], u1[:, ::1], u1[:, ::1], f4[:, ::1], f4[:, ::1], UniTuple(i8, 2), f4[:, :, ::1])",
    boundscheck=False,
)
def _accumulate(
    light: NDArray[np.float32],
    red: NDArray[np.uint8],
    yellow: NDArray[np.uint8],
    fine: NDArray[np.float32],
    coarse: NDArray[np.float32],
    cell: tuple[int, int],
    sums: Means,
) -> None:
    """Sums over the rows of a cell, column by column, which compilers make quick, and then over its
    columns."""
    height, width = light.shape
    columns = np.empty((QUANTITIES, width), np.float32)
    for i in range(sums.shape[0]):
        columns[:] = 0.0
        for v in range(i * cell[0], (i + 1) * cell[0]):
            _add_row(
                light[v],
                light[max(0, v - 1)],
                light[min(height - 1, v + 1)],
                red[v],
                yellow[v],
                fine[v],
                coarse[v],
                columns,
            )
        if cell[1] == 1:
            for j in range(sums.shape[1]):
                for q in range(QUANTITIES):
                    sums[i, j, q] = columns[q, j]
            continue
        for q in range(QUANTITIES):
            for j in range(sums.shape[1]):
                total = np.float32(0.0)
                for u in range(j * cell[1], (j + 1) * cell[1]):
                    total += columns[q, u]
                sums[i, j, q] = total


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _add_row(
    light: NDArray[np.float32],
    above: NDArray[np.float32],
    below: NDArray[np.float32],
    red: NDArray[np.uint8],
    yellow: NDArray[np.uint8],
    fine: NDArray[np.float32],
    coarse: NDArray[np.float32],
    columns: NDArray[np.float32],
) -> None:
    """Adds a row's quantities to (QUANTITIES, width) sums."""
    last = light.shape[0] - 1
    columns[3, 0] += abs(light[1] - light[0])
    columns[3, last] += abs(light[last] - light[last - 1])
    across = columns[3]
    for u in range(1, last):
        across[u] += abs(light[u + 1] - light[u - 1])
    for u in range(last + 1):
        columns[0, u] += light[u]
        columns[7, u] += light[u] * light[u]
        columns[4, u] += abs(below[u] - above[u])
    for u in range(last + 1):
        b = np.float32(yellow[u])
        columns[1, u] += np.float32(red[u])
        columns[2, u] += b
        columns[8, u] += b * b
    for u in range(last + 1):
        relief = light[u] - coarse[u]
        limited = min(RELIEF, max(-RELIEF, relief))
        columns[5, u] += abs(light[u] - fine[u])
        columns[6, u] += abs(fine[u] - coarse[u])
        columns[9, u] += limited * limited * limited


def pooled(means: Means, sigma: float) -> Means:
    """Means over wider surroundings of `sigma` cells."""
    return np.asarray(cv2.GaussianBlur(means, (0, 0), sigma), np.float32)


def combine(means: Means) -> NDArray[np.float32]:
    """(h, w, 10) features of means, brightness itself the last: the search for a line leaves that
    out, for shadows and dust divide a picture as neatly as crop does."""
    height, width, n = means.shape
    planes = np.asarray(cv2.transpose(means.reshape(-1, n)), np.float32).reshape(n, height, width)
    light, yellow = planes[0], planes[2]
    out = np.empty((10, *light.shape), np.float32)
    out[:2] = planes[1:3]
    out[2:6] = planes[3:7] + np.float32(0.5)
    out[6] = np.maximum(planes[7] - light * light, 0.0) + np.float32(1.0)
    out[7] = np.maximum(planes[8] - yellow * yellow, 0.0) + np.float32(0.25)
    out[8] = np.abs(planes[9]) + np.float32(1e-6)
    np.log(out[2:9], out=out[2:9])
    out[6:8] *= np.float32(0.5)
    out[8] = np.copysign(np.exp(out[8] * np.float32(1 / 3)), planes[9])
    out[9] = light
    together = cv2.transpose(out.reshape(len(out), -1))
    return np.asarray(together, np.float32).reshape(height, width, -1)


def unlit(features: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w, WITHOUT_LIGHT) of (h, w, 10) features of `combine`: colour and the logarithms of
    texture relative to brightness. A shadow has no border in them: it scales light, colour and
    texture alike."""
    light = features[..., WITHOUT_LIGHT:]
    out = features[..., :WITHOUT_LIGHT].copy()
    out[..., :2] = 100.0 * (out[..., :2] - 128.0) / (light + DARK)
    out[..., 2:7] -= np.log(light + 0.5 * DARK)
    return np.asarray(out, np.float32)
