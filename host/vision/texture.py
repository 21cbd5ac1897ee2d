"""Colour and texture of a photograph on a grid of square cells."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from host.vision.pictures import Picture, u8

WORK_PX = 448
"""Longer side at which texture is measured."""
CELL_PX = 4
FINE_SIGMA, COARSE_SIGMA = 2.0, 5.0
"""Px at that size: between these two scales and below the first, grain is told apart."""

Cells = dict[str, NDArray[np.float32]]


def measure(bgr: Picture) -> Cells:
    """Cell means (h, w) from which `features` makes features: of Lab, of brightness steps, of what
    two blurs take away, and of squares."""
    longer = max(bgr.shape[:2])
    if longer > WORK_PX:
        scale = WORK_PX / longer
        if scale < 0.5:
            bgr = u8(cv2.resize(bgr, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
        else:  # bilinear averages enough down to a half, and is far quicker
            bgr = u8(cv2.resize(bgr, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR))
    h, w = bgr.shape[:2]
    grid = (max(8, w // CELL_PX), max(8, h // CELL_PX))

    def cells(picture: NDArray[np.generic]) -> NDArray[np.float32]:
        return np.asarray(
            cv2.resize(np.asarray(picture, np.float32), grid, interpolation=cv2.INTER_AREA),
            np.float32,
        )

    planes = cv2.split(cv2.cvtColor(bgr, cv2.COLOR_BGR2LAB))
    light, green_red, blue_yellow = (p.astype(np.float32) for p in planes)
    fine = cv2.GaussianBlur(light, (0, 0), FINE_SIGMA)
    half = cv2.resize(fine, (max(1, w // 2), max(1, h // 2)), interpolation=cv2.INTER_AREA)
    coarse = cv2.resize(cv2.GaussianBlur(half, (0, 0), COARSE_SIGMA / 2), (w, h))
    relief = np.clip(light - coarse, -60, 60)
    return {
        "L": cells(light),
        "a": cells(green_red),
        "b": cells(blue_yellow),
        "across": cells(np.abs(cv2.Sobel(light, cv2.CV_32F, 1, 0, ksize=1))),
        "along": cells(np.abs(cv2.Sobel(light, cv2.CV_32F, 0, 1, ksize=1))),
        "fine": cells(np.abs(light - fine)),
        "coarse": cells(np.abs(fine - coarse)),
        "L2": cells(light * light),
        "b2": cells(blue_yellow * blue_yellow),
        "skew": cells(relief * relief * relief),
    }


def features(cells: Cells, sigma: float, with_light: bool) -> NDArray[np.float32]:
    """(h, w, n) features, pooled over `sigma` cells. Brightness itself is left out of the search
    for a line: shadows and dust divide a picture as neatly as crop does."""

    def pool(name: str) -> NDArray[np.float32]:
        return np.asarray(cv2.GaussianBlur(cells[name], (0, 0), sigma), np.float32)

    light, yellow = pool("L"), pool("b")
    spread = np.sqrt(np.maximum(pool("L2") - light * light, 0.0))
    colours = np.sqrt(np.maximum(pool("b2") - yellow * yellow, 0.0))
    out = [
        pool("a"),
        yellow,
        np.log(pool("across") + 0.5),
        np.log(pool("along") + 0.5),
        np.log(spread + 1.0),
        np.log(pool("fine") + 0.5),
        np.log(pool("coarse") + 0.5),
        np.log(colours + 0.5),
        np.cbrt(pool("skew")),
    ]
    if with_light:
        out.append(light)
    return np.stack(out, -1).astype(np.float32)
