"""The paper's own chain, every stage visible: hue wedge and tilted plane (SY), hue stretched over
the full circle and thresholded (TSY), upright lines of at least the blade's height (VTSY), and from
them E_outer, O_map, l_height and l_reference.

Mended in two places: the tilt is counted from the image of the true vertical at each column, and
the least length of a line is the blade height's projection at the row where the line stands.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from host.core.compiled import compiled
from host.core.strict import Strict
from host.vision.geometry import Camera
from host.vision.mounted.evidence import LOGARITHM
from host.vision.mounted.lines import LEAST_PX, least_length_px, rails, upright_pieces
from host.vision.photo.score import edge_of
from host.vision.photo.split import Line, Side, best_line, whiten
from host.vision.pictures import Mask, Picture, u8
from host.vision.view import NAN, CropView

Hue = Annotated[float, Field(ge=0, le=360)]

TILTS_DEG = (-5.0, 0.0, 5.0)
"""Wind and natural lean, added to the mount's own."""
L_HEIGHT_SHARE = 0.8
"""Share of the crop pixels below l_height."""
L_TOLERANCE = 0.03
"""Of the picture's height, around l_reference."""


class PaperParams(Strict):
    """What the paper tunes by hand before a field and about four times a day."""

    phi1_deg: Hue = 20.0
    """First cutting half plane of the hue."""
    phi2_deg: Hue = 70.0
    """Second one; beyond it weeds and background."""
    a: float = 1.0
    b: float = -0.15
    """The tilted plane a * Saturation + b * Value = 0 (both 0..1); kept is its positive side."""
    ripe_from_deg: Hue = 0.0
    ripe_to_deg: Hue = 250.0
    """The threshold, on the hue after phi1..phi2 was stretched to 0..360; what lies above it is
    unripe and drawn red."""
    contrast: Annotated[float, Field(gt=0)] = 10.0
    """Least step of brightness across a stem, in 255ths of the logarithmic range."""
    gap_px: Annotated[int, Field(ge=0)] = 2
    """Longest interruption of a line."""

    def hue_table(self) -> NDArray[np.uint8]:
        """OpenCV's full-range hue (256) to the stretched one, 1..255; 0 outside the wedge."""
        hue = np.arange(256) * (360.0 / 256)
        span = (self.phi2_deg - self.phi1_deg) % 360 or 360.0
        along = (hue - self.phi1_deg) % 360
        return np.where(along <= span, 1 + 254 * along / span, 0).astype(np.uint8)

    def stretched(self, degrees: float) -> float:
        """A stretched hue in degrees to the table's units."""
        return 1 + 254 * degrees / 360


@dataclass(frozen=True, slots=True)
class Stages:
    """The chain's intermediate pictures, all of the input's size."""

    sy: Mask
    """Stretched hue inside the yellow subspace, 0 outside."""
    ripe: Mask
    """255 where the threshold takes it for ripe crop (TSY)."""
    unripe: Mask
    """255 where it is yellow but greener than ripe."""
    grey: Mask
    """Value, by its logarithm."""
    steps: Mask
    """255 on every step of brightness across the picture, of any colour and length."""
    upright: Mask
    """255 on upright lines that are long enough (VTSY)."""


class Chain:
    """Colour and line stages for pictures of one size. `camera` None: a photograph of unknown
    mount, whose verticals are taken as upright and whose least length is a share of its height."""

    def __init__(
        self,
        params: PaperParams,
        size: tuple[int, int],
        camera: Camera | None = None,
        blade_height_m: float = 0.12,
        least_share: float = 0.02,
    ) -> None:
        self.params = params
        width, height = size
        self._hue = params.hue_table()
        lo, hi = params.stretched(params.ripe_from_deg), params.stretched(params.ripe_to_deg)
        hues = self._hue.astype(np.float64)
        inside = self._hue > 0
        self._ripe = np.where(inside & (hues >= lo) & (hues <= hi), 255, 0).astype(np.uint8)
        self._unripe = np.where(inside & (hues > hi), 255, 0).astype(np.uint8)
        self._tracks = [rails(width, height, camera, tilt) for tilt in TILTS_DEG]
        if camera is None:
            self.least_px = np.full(height, max(LEAST_PX, least_share * height), np.float32)
        else:
            self.least_px = least_length_px(camera, blade_height_m)

    def run(self, bgr: Picture, fainter: float = 1.0) -> Stages:
        """`bgr` (height, width, 3) of the size given; `fainter` scales the least contrast."""
        p = self.params
        hue, saturation, value = cv2.split(cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV_FULL))
        plane = cv2.addWeighted(saturation, p.a, value, p.b, 0.0)
        _, yellow = cv2.threshold(plane, 0, 255, cv2.THRESH_BINARY)
        ripe = cv2.bitwise_and(cv2.LUT(hue, self._ripe), yellow)
        unripe = cv2.bitwise_and(cv2.LUT(hue, self._unripe), yellow)
        sy = cv2.bitwise_and(cv2.LUT(hue, self._hue), yellow)
        grey = u8(cv2.LUT(value, LOGARITHM))
        across = cv2.convertScaleAbs(cv2.Sobel(grey, cv2.CV_16S, 1, 0, ksize=1))
        along = cv2.convertScaleAbs(cv2.Sobel(grey, cv2.CV_16S, 0, 1, ksize=1))
        _, step = cv2.threshold(across, p.contrast * fainter, 255, cv2.THRESH_BINARY)
        steps = u8(cv2.bitwise_and(step, cv2.compare(across, along, cv2.CMP_GT)))
        sides = u8(cv2.bitwise_and(steps, ripe))
        upright = upright_pieces(sides, self._tracks, self.least_px, p.gap_px)
        return Stages(u8(sy), u8(ripe), u8(unripe), grey, steps, upright)


def staged_pictures(bgr: Picture, s: Stages) -> dict[str, Picture]:
    """The stages as colour pictures, named as in the paper."""
    hsv = np.dstack([s.sy, np.where(s.sy > 0, 255, 0), np.where(s.sy > 0, 255, 0)]).astype(np.uint8)
    tsy = u8(cv2.bitwise_and(bgr, bgr, mask=s.ripe))
    tsy[s.unripe > 0] = (0, 0, 255)
    lines = u8(cv2.cvtColor(s.upright, cv2.COLOR_GRAY2BGR))
    return {"SY": u8(cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR_FULL)), "TSY": tsy, "VTSY": lines}


def l_height(upright: Mask, share: float = L_HEIGHT_SHARE) -> float:
    """The row below which `share` of the crop pixels lie; NaN without crop."""
    row = _row_above(upright, 1.0 - share)
    return float(row) if row >= 0 else NAN


@compiled("(u1[:, ::1], f8)", boundscheck=False)
def _row_above(lit: Mask, share: float) -> int:
    """The first row down to which there is `share` of the lit pixels; -1: none is lit."""
    height, width = lit.shape
    count = np.empty(height, np.int64)
    total = 0
    for v in range(height):
        row = lit[v]
        here = np.int32(0)
        for u in range(width):
            here += np.int32(row[u] & np.uint8(1))
        total += int(here)
        count[v] = total
    if total == 0:
        return -1
    v = 0
    while count[v] < share * total:
        v += 1
    return v


class PaperPhoto:
    """The chain on a photograph of unknown mount, whose standing side the operator names."""

    def __init__(self, side: Side, params: PaperParams | None = None) -> None:
        self.side = side
        self.params = params or PaperParams()

    def contrast(self, bgr: Picture) -> float:
        """How clearly the upright lines tell the named side from the other, 0..1."""
        stages = Chain(self.params, (bgr.shape[1], bgr.shape[0])).run(bgr)
        return self._divide(stages.upright)[1]

    def _divide(self, upright: Mask) -> tuple[Line, float]:
        """The line that divides dense from sparse upright lines, in pixels, and the contrast: the
        explained variance, 0 where the named side is the sparse one."""
        h, w = upright.shape
        cell = max(1, round(max(h, w) / 64))
        grid = (max(2, w // cell), max(2, h // cell))
        coarse = cv2.resize(upright, grid, interpolation=cv2.INTER_AREA)
        density = cv2.GaussianBlur(coarse, (0, 0), 1.0).astype(np.float32)
        line = best_line(whiten(density[..., None]), self.side)
        u, v = np.meshgrid(np.arange(grid[0]) + 0.5, np.arange(grid[1]) + 0.5)
        crop = line.signed(u, v) > 0
        inside = float(density[crop].mean()) if crop.any() else 0.0
        outside = float(density[~crop].mean()) if (~crop).any() else 0.0
        share = (inside - outside) / max(inside + outside, 1.0)
        return line.scaled(w / grid[0]), max(0.0, line.explained * share)

    def see(self, bgr: Picture, *, stages: bool = False) -> CropView:
        """`bgr` (height, width, 3)."""
        h, w = bgr.shape[:2]
        s = Chain(self.params, (w, h)).run(bgr)
        if float((s.upright > 0).mean()) < 1e-3:
            return CropView(
                0.0,
                reason="no upright crop of ripe colour in the picture",
                stages=staged_pictures(bgr, s) if stages else {},
            )
        line, contrast = self._divide(s.upright)
        u, v = np.meshgrid(np.arange(w) + 0.5, np.arange(h) + 0.5)
        standing = np.asarray(line.signed(u, v) > 0)
        confidence = min(0.95, 1.25 * contrast)
        height = l_height(s.upright)
        edge = edge_of(standing, self.side)
        return CropView(
            confidence,
            e_outer_px=float(edge[-1, 0]) if len(edge) else NAN,
            l_height_px=height,
            l_reference_px=height,
            standing=standing,
            edge_px=edge,
            reason="" if confidence >= 0.5 else "the named side hardly shows more upright lines",
            stages=staged_pictures(bgr, s) if stages else {},
        )
