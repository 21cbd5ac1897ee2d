"""Pictures for people: the staged picture of the paper's Fig. 3, and the lines drawn in a frame."""

from __future__ import annotations

import math

import cv2
import numpy as np

from host.vision.pictures import Picture, u8
from host.vision.view import CropView

RED = (40, 40, 235)
BLUE = (235, 120, 30)
YELLOW = (40, 220, 250)
GREEN = (70, 200, 60)
WHITE = (255, 255, 255)
"""Colours of the drawings, blue, green, red (0..255)."""


def _label(picture: Picture, text: str, at: tuple[int, int], colour: tuple[int, int, int]) -> None:
    scale = max(0.4, picture.shape[1] / 1200)
    for thickness, ink in ((3, (0, 0, 0)), (1, colour)):
        cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, ink, thickness, cv2.LINE_AA)


def draw(bgr: Picture, view: CropView) -> Picture:
    """A copy with the standing crop tinted, the edge, E_outer, O_map, l_height and l_reference."""
    out = bgr.copy()
    h, w = out.shape[:2]
    if view.standing is not None:
        tint = out.copy()
        tint[view.standing] = GREEN
        out = u8(cv2.addWeighted(out, 0.82, tint, 0.18, 0))
    wide = max(1, w // 320)
    if view.edge_px is not None and len(view.edge_px) > 1:
        points = np.round(view.edge_px).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(out, [points], False, RED, wide + 1, cv2.LINE_AA)
    for name, column, colour, below in (
        ("O_map", view.o_map_px, BLUE, 14),
        ("E_outer", view.e_outer_px, RED, 34),
    ):
        if math.isfinite(column):
            u = min(max(round(column), -w), 2 * w)
            cv2.line(out, (u, h // 3), (u, h), colour, wide)
            _label(out, name, (min(max(u + 4, 0), w - w // 8), h // 3 + below), colour)
    for name, row, colour in (
        ("l_reference", view.l_reference_px, BLUE),
        ("l_height", view.l_height_px, YELLOW),
    ):
        if math.isfinite(row):
            v = round(row)
            cv2.line(out, (0, v), (w, v), colour, wide)
            _label(out, name, (4 if name == "l_height" else w // 4, max(14, v - 4)), colour)
    text = f"confidence {view.confidence:.2f}" + (f": {view.reason}" if view.reason else "")
    _label(out, text, (6, h - 8), WHITE)
    return out


def staged(bgr: Picture, view: CropView, width: int = 640) -> Picture:
    """The stages side by side, two in a row: original, then what `view.stages` holds, then the
    picture with the lines drawn in."""
    h, w = bgr.shape[:2]
    size = (width, max(1, round(h * width / w)))
    tiles = []
    for name, picture in {"original": bgr, **view.stages, "result": draw(bgr, view)}.items():
        tile = u8(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
        _label(tile, name, (6, 18), WHITE)
        tiles.append(tile)
    if len(tiles) % 2:
        tiles.append(np.zeros_like(tiles[0]))
    rows = [np.hstack(tiles[i : i + 2]) for i in range(0, len(tiles), 2)]
    return np.vstack(rows)
