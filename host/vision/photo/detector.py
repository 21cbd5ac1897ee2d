"""Detectors for photographs of unknown mount, whose standing side the operator names."""

from __future__ import annotations

from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from host.vision.mounted.paper import PaperParams, PaperPhoto
from host.vision.photo.curve import Curve, follow
from host.vision.photo.score import edge_of
from host.vision.photo.split import Line, Search, Side, best_line, whiten
from host.vision.photo.texture import Means, combine, measure, pooled, reduced
from host.vision.pictures import Picture
from host.vision.view import NAN, CropView

SEARCH_PX, EDGE_PX = 320, 448
"""Longer side of the picture in which the line is searched, and of that in which the edge is
followed."""
CELL_PX = 4
SIGMAS = (1.5, 3.6)
"""Px: the scales of grain."""
SEARCH_SIGMA = 0.8
"""Cells over which texture is pooled."""
LEAST_PX = 64
LEAST_GRAIN = 0.8
"""Mean fine texture, of 255."""
LEAST_YELLOW = 3.0
"""Of Lab's b above neutral."""


class PhotoDetector(Protocol):
    """Picture in, CropView in pixels out; metres stay NaN."""

    def see(self, bgr: Picture, *, stages: bool = False) -> CropView: ...


class RobustPhoto:
    """The line that divides colour and texture best, and the curve beside it."""

    def __init__(self, side: Side, search: Search | None = None) -> None:
        self.side = side
        self.search = search or Search()

    def see(self, bgr: Picture, *, stages: bool = False) -> CropView:
        """`bgr` (height, width, 3)."""
        h, w = bgr.shape[:2]
        if min(h, w) < LEAST_PX:
            return CropView(0.0, reason=f"smaller than {LEAST_PX} pixels")
        sharp = reduced(bgr, EDGE_PX)
        small = reduced(sharp, SEARCH_PX)
        cells = measure(small, (CELL_PX, CELL_PX), SIGMAS)
        found = whiten(combine(pooled(cells, SEARCH_SIGMA), with_light=False))
        line = best_line(found, self.side, self.search)
        curve = follow(sharp, line.scaled(sharp.shape[1] / found.shape[1]))
        standing = curve.scaled(w / sharp.shape[1]).standing((w, h))
        edge = edge_of(standing, self.side)
        confidence, reason = judge(cells, curve, min(sharp.shape[:2]))
        return CropView(
            confidence,
            e_outer_px=float(edge[-1, 0]) if len(edge) else NAN,
            standing=standing,
            edge_px=edge,
            reason=reason,
            stages=_pictures(bgr, line.scaled(w / found.shape[1]), standing) if stages else {},
        )


def judge(cells: Means, curve: Curve, shorter_px: int) -> tuple[float, str]:
    """Confidence 0..1 and, where it is low, why.

    A line is doubted when it explains little, when the two kinds beside it hardly differ, and when
    the curve found little to hold on to and strayed; a picture when it shows no grain at all or not
    the colours of ripe cereals and their stubble."""
    grain = float(cells[..., 5].mean())
    if grain < LEAST_GRAIN:
        return 0.0, "the picture shows no texture: dark, glaring or a covered lens"
    yellow, red = cells[..., 2] - 128, cells[..., 1] - 128
    ripe = float(np.mean((yellow > LEAST_YELLOW) & (red > -0.4 * yellow) & (red < 1.2 * yellow)))
    strayed = curve.strayed_px / shorter_px
    doubts = {
        "the best line divides hardly anything": 2.0 * (curve.line.explained - 0.2),
        "the two sides of the best line hardly differ": curve.apart / 3.0,
        "the edge does not follow any line": 1.35 - 55.0 * strayed / max(curve.apart, 1.0),
        "not the colours of ripe cereals": 5.0 * (ripe - 0.4),
    }
    reason = min(doubts, key=lambda k: doubts[k])
    value = max(0.0, min(0.95, doubts[reason]))
    return value, "" if value >= 0.5 else reason


def _pictures(bgr: Picture, line: Line, standing: NDArray[np.bool_]) -> dict[str, Picture]:
    """The dividing line and its strip, and the side that each pixel is taken for."""
    h, w = standing.shape
    u, v = np.meshgrid(np.arange(w) + 0.5, np.arange(h) + 0.5)
    signed = line.signed(u, v)
    width = max(1.0, 0.004 * max(h, w))
    divided = bgr.copy()
    divided[np.abs(signed) < width] = (40, 40, 235)
    if line.strip > 0:
        divided[np.abs(signed + line.strip) < width] = (235, 120, 30)
    side = np.asarray(cv2.addWeighted(bgr, 0.5, np.zeros_like(bgr), 0.5, 0), np.uint8)
    side[standing] = bgr[standing]
    return {"line": divided, "side": side}


def photo_detector(mode: str, side: Side, params: PaperParams | None = None) -> PhotoDetector:
    """The detector of `mode` (paper, robust) for photographs whose crop stands on `side`."""
    return PaperPhoto(side, params) if mode == "paper" else RobustPhoto(side)
