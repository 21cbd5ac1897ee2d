"""Detectors for photographs of unknown mount, whose standing side the operator names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from host.vision.mounted.paper import PaperPhoto
from host.vision.photo import confidence
from host.vision.photo.curve import Curve, follow
from host.vision.photo.fisher import Features
from host.vision.photo.score import edge_of
from host.vision.photo.split import Line, Search, Side, best_line, whiten
from host.vision.photo.texture import (
    WITHOUT_LIGHT,
    Means,
    combine,
    measure,
    pooled,
    reduced,
    unlit,
)
from host.vision.pictures import Picture
from host.vision.view import NAN, CropView

SEARCH_PX, EDGE_PX = 320, 448
"""Longer side of the picture in which the line is searched, and of that in which the edge is
followed."""
CELL_PX = 4
"""Side of the cells over which features are averaged."""
SIGMAS = (1.5, 3.6)
"""Px: the scales of grain."""
SEARCH_SIGMA = 1.0
"""Cells over which texture is pooled."""
LEAST_PX = 64
"""A picture's shorter side."""
LEAST_GRAIN = 0.8
"""Mean fine texture, of 255."""
LEAST_YELLOW = 3.0
"""Of Lab's b above neutral."""
LEAST_RIPE = 0.5
"""Of the picture."""


class PhotoDetector(Protocol):
    """Picture in, CropView in pixels out; metres stay NaN."""

    def see(self, bgr: Picture, *, stages: bool = False) -> CropView: ...


@dataclass(frozen=True, slots=True)
class Trace:
    """An edge, and what it was found in."""

    cells: Means
    features: Features
    """(h, w, 10) of `texture.combine`, pooled."""
    curve: Curve
    size: tuple[int, int]
    """Width and height of the picture whose pixels the curve is in."""

    def quantities(self, side: Side) -> NDArray[np.float64]:
        """What speaks for and against the edge (`confidence.quantities`)."""
        return confidence.quantities(self.features, self.curve, side, self.size)


def trace(bgr: Picture, side: Side, search: Search) -> Trace:
    """The line that divides a picture best, and the curve beside it."""
    sharp = reduced(bgr, EDGE_PX)
    cells = measure(reduced(sharp, SEARCH_PX), (CELL_PX, CELL_PX), SIGMAS)
    features = combine(pooled(cells, SEARCH_SIGMA))
    line = best_line(searched(features), side, search, sets=2)
    height, width = sharp.shape[:2]
    curve = follow(sharp, line.scaled(width / features.shape[1]))
    return Trace(cells, features, curve, (width, height))


def searched(features: Features) -> Features:
    """(h, w, 18) in which the line is searched, of (h, w, 10) features of `texture.combine`: colour
    and texture as they are, and the same relative to brightness, two sets that are whitened each.
    What divides both is more than a shadow or a veil of dust."""
    plain = np.ascontiguousarray(features[..., :WITHOUT_LIGHT])
    return np.concatenate([whiten(plain), whiten(unlit(features))], axis=-1)


class RobustPhoto:
    """The line that divides colour and texture best, and the curve beside it."""

    def __init__(
        self, side: Side, search: Search | None = None, weights: confidence.Weights | None = None
    ) -> None:
        """`weights`: of the confidence, instead of those that the package has."""
        self.side = side
        self.search = search or Search()
        self._weights = weights

    def see(self, bgr: Picture, *, stages: bool = False) -> CropView:
        """`bgr` (height, width, 3)."""
        h, w = bgr.shape[:2]
        if min(h, w) < LEAST_PX:
            return CropView(0.0, reason=f"smaller than {LEAST_PX} pixels")
        found = trace(bgr, self.side, self.search)
        curve = found.curve.scaled(w / found.size[0])
        standing = curve.standing((w, h))
        edge = edge_of(standing, self.side)
        value, reason = self._judged(found)
        return CropView(
            value,
            e_outer_px=float(edge[-1, 0]) if len(edge) else NAN,
            standing=standing,
            edge_px=edge,
            reason=reason,
            stages=_pictures(bgr, curve.line, standing) if stages else {},
        )

    def _judged(self, found: Trace) -> tuple[float, str]:
        """Confidence 0..1 and, where it is low, why."""
        refused = unlike_a_field(found.cells)
        if refused:
            return 0.0, refused
        weights = self._weights or confidence.weights()
        value, reason = weights.judged(found.quantities(self.side))
        return value, "" if value >= 0.5 else reason


def unlike_a_field(cells: Means) -> str:
    """Why a picture shows no ripe field, in words; "" where it may. The photographs that confidence
    was learnt from hold none of these."""
    if float(cells[..., 5].mean()) < LEAST_GRAIN:
        return "the picture shows no texture: dark, glaring or a covered lens"
    yellow, red = cells[..., 2] - 128, cells[..., 1] - 128
    ripe = np.mean((yellow > LEAST_YELLOW) & (red > -0.4 * yellow) & (red < 1.2 * yellow))
    return "" if ripe >= LEAST_RIPE else "not the colours of ripe cereals"


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


def photo_detector(mode: str, side: Side) -> PhotoDetector:
    """The detector of `mode` (paper, robust) for photographs whose crop stands on `side`."""
    return PaperPhoto(side) if mode == "paper" else RobustPhoto(side)
