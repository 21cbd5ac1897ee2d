"""How far a camera has turned and gone between two pictures, by how the scene has shifted in them.

Phase correlation (Kuglin and Hines 1975, The phase correlation image alignment method) of three
parts of a small grey picture, one above and two below. What a part shifts by when the machine turns
or drives on level ground follows from the mount. Crop is not level ground: the way may come out
half or twice as long, the turn within a third, the signs as they are.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import Mount
from host.vision.geometry import Array, Camera

PART: Final = (0.4, 0.4)
"""Width and height of a part, as shares of the picture's: larger ones shift less alike in
themselves, smaller ones lose a quick turn."""
PARTS: Final = ((0.3, 0.04), (0.05, 0.56), (0.55, 0.56))
"""Left and upper ends of the parts, as shares: the blade's dust hides the middle below."""
ALIKE: Final = 0.5
"""Of the peak that two parts correlate with, from 0 to 1: of parts that show nothing in common,
stalks right before the lens, it stays below. Lower takes chance for a shift."""
TELLS: Final = 0.3
"""Share of what all parts tell of the way, that those which are alike must: one of those below."""
FAR_M: Final = 30.0
"""What is seen at and above the horizon, or farther, is taken to stand so far away: from there on a
metre's way shifts nothing that could be measured."""
STEP: Final = (0.05, 0.02)
"""Way, m, and turn, rad, over which the shift is taken to be proportional."""


class Shown(NamedTuple):
    """NaN where the pictures do not say."""

    turn_rad: float
    """To the left."""
    way_m: float
    """Forward, if the ground is level and bare."""


NOTHING: Final = Shown(math.nan, math.nan)


class ShownMotion:
    """Fed with the small grey pictures of one camera, in order."""

    def __init__(self, mount: Mount, width_px: int, height_px: int) -> None:
        """Of pictures that are so small."""
        size = np.array([width_px, height_px])
        width, height = (int(v) for v in np.rint(size * PART))
        self._parts = [
            (slice(y, y + height), slice(x, x + width))
            for x, y in np.rint(np.array(PARTS) * size).astype(int).tolist()
        ]
        self._window = cv2.createHanningWindow((width, height), cv2.CV_32F)
        middles = np.array([[x.start + width / 2, y.start + height / 2] for y, x in self._parts])
        scale = np.array([mount.width_px, mount.height_px]) / size
        shifts = _shifts(Camera(mount), middles * scale) / scale
        self._px_per_m: Array = shifts[0, :, 1]
        """How far down each part shifts when the machine drives on;"""
        self._px_per_rad: Array = shifts[1, :, 0]
        """and to the right when it turns left."""
        self._last: list[NDArray[np.float32]] = []

    def take(self, small: NDArray[np.uint8]) -> Shown:
        """What it shows since the one before, (height, width)."""
        last = self._last
        self._last = [small[part].astype(np.float32) for part in self._parts]
        if not last:
            return NOTHING
        pairs = zip(last, self._last, strict=True)
        found = [cv2.phaseCorrelate(before, now, self._window) for before, now in pairs]
        alike = np.array([peak > ALIKE for _, peak in found])
        shift = np.array([shift for shift, _ in found])
        if not alike.any():
            return NOTHING
        right, down = shift[alike].T
        per_rad, per_m = self._px_per_rad[alike], self._px_per_m[alike]
        tells = per_m @ per_m > TELLS * (self._px_per_m @ self._px_per_m)
        way_m = float(down @ per_m / (per_m @ per_m)) if tells else math.nan
        return Shown(float(np.median(right / per_rad)), way_m)


def _shifts(camera: Camera, pixels: Array) -> Array:
    """(2, n, 2): by how many pixels what is seen at `pixels` (n, 2) shifts for each metre that the
    machine drives on, and for each radian that it turns left."""
    rays = camera.rays(pixels)
    ground = camera.on_height(pixels, 0.0)
    far = camera.position + FAR_M * rays / np.linalg.norm(rays, axis=1, keepdims=True)
    near = np.hypot(*(ground - camera.position[:2]).T) < FAR_M
    seen = np.where(near[:, None], np.column_stack([ground, np.zeros(len(ground))]), far)
    way, turn = STEP
    c, s = math.cos(turn), math.sin(turn)
    driven = seen - np.array([way, 0.0, 0.0])
    turned = seen @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.stack(
        [(camera.project(driven) - pixels) / way, (camera.project(turned) - pixels) / turn]
    )
