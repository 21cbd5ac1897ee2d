"""Detectors for photographs of unknown mount, whose standing side the operator names."""

from __future__ import annotations

from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from host.vision.curve import follow
from host.vision.paper import PaperParams, PaperPhoto
from host.vision.pictures import Picture
from host.vision.score import edge_of
from host.vision.split import Line, Search, Side, best_line, whiten
from host.vision.texture import CELL_PX, Cells, features, measure
from host.vision.view import NAN, CropView

SEARCH_SIGMA = 0.8
FOLLOW_SIGMA = 0.5
"""Cells over which texture is pooled for the line and for the curve."""
COARSE_CELLS = 64
"""Along the longer side, for the search."""
LEAST_PX = 16 * CELL_PX
LEAST_GRAIN = 0.8
"""Mean fine texture, of 255."""
LEAST_YELLOW = 3.0
"""Of Lab's b above neutral."""

Signed = NDArray[np.float32]


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
        cells = measure(bgr)
        fine = whiten(features(cells, FOLLOW_SIGMA, True))
        rows, columns = fine.shape[:2]
        step = max(1, round(max(rows, columns) / COARSE_CELLS))
        wide = features(cells, SEARCH_SIGMA, False)
        grid = (columns // step, rows // step)
        planes = [
            cv2.resize(np.ascontiguousarray(wide[..., k]), grid, interpolation=cv2.INTER_AREA)
            for k in range(wide.shape[2])
        ]
        line = best_line(whiten(np.stack(planes, -1).astype(np.float32)), self.side, self.search)
        line = line.scaled(columns / grid[0])
        signed, apart = follow(fine, line)
        full = cv2.resize(signed, (w, h), interpolation=cv2.INTER_LINEAR)
        standing = np.asarray(full > 0)
        edge = edge_of(standing, self.side)
        confidence, reason = judge(cells, line, signed, apart)
        return CropView(
            confidence,
            e_outer_px=float(edge[-1, 0]) if len(edge) else NAN,
            standing=standing,
            edge_px=edge,
            reason=reason,
            stages=_pictures(signed, (w, h)) if stages else {},
        )


def judge(cells: Cells, line: Line, signed: Signed, apart: float) -> tuple[float, str]:
    """Confidence 0..1 and, where it is low, why.

    A line is doubted when it explains little, when the two kinds beside it hardly differ, and when
    the curve found little to hold on to and strayed; a picture when it shows no grain at all or not
    the colours of ripe cereals and their stubble."""
    grain = float(cells["fine"].mean())
    if grain < LEAST_GRAIN:
        return 0.0, "the picture shows no texture: dark, glaring or a covered lens"
    yellow, red = cells["b"] - 128, cells["a"] - 128
    ripe = float(np.mean((yellow > LEAST_YELLOW) & (red > -0.4 * yellow) & (red < 1.2 * yellow)))
    rows, columns = signed.shape
    u, v = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    strayed = float(np.abs(line.signed(u, v) - signed).mean()) / min(rows, columns)
    doubts = {
        "the best line divides hardly anything": 2.0 * (line.explained - 0.2),
        "the two sides of the best line hardly differ": apart / 3.0,
        "the edge does not follow any line": 1.35 - 25.0 * strayed,
        "not the colours of ripe cereals": 5.0 * (ripe - 0.4),
    }
    reason = min(doubts, key=lambda k: doubts[k])
    value = max(0.0, min(0.95, doubts[reason]))
    return value, "" if value >= 0.5 else reason


def _pictures(signed: NDArray[np.float32], size: tuple[int, int]) -> dict[str, Picture]:
    shade = np.clip(128 + 8 * signed, 0, 255).astype(np.uint8)
    grown = cv2.resize(shade, size, interpolation=cv2.INTER_NEAREST)
    return {"side": np.asarray(cv2.applyColorMap(grown, cv2.COLORMAP_VIRIDIS), np.uint8)}


def photo_detector(mode: str, side: Side, params: PaperParams | None = None) -> PhotoDetector:
    """The detector of `mode` (paper, robust) for photographs whose crop stands on `side`."""
    return PaperPhoto(side, params) if mode == "paper" else RobustPhoto(side)
