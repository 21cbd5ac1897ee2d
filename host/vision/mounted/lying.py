"""Whether crop lies before the blade, where no stems stand: by texture and colour, relative to what
this run shows.

Crop that lies has no upright stems, but it is as rough as crop that stands: stalks with gaps
between them. Ground is smoother. How rough the blade's way is, is compared with the ground right of
the crop in the same picture, in the features of the photographs' detector, relative to brightness:
a shadow scales light, colour and texture alike. Dust takes texture and colour together, so what is
compared is texture in proportion to colour. How much rougher crop is than ground is learnt while
stems are seen at the blade; where they vanish, crop lies if the way is still nearer to that than to
ground.
"""

from __future__ import annotations

import math
import statistics
from collections import deque

import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import Vehicle
from host.vision.geometry import Camera
from host.vision.photo.texture import combine, measure, unlit
from host.vision.pictures import Picture
from host.vision.view import NAN

AHEAD_M = 0.6
"""Of the blade's way that is judged, by where ground would be: farther, what stands behind it comes
into it."""
CELL = (12, 16)
"""Rows and columns of a cell, px: some stalks wide at the blade."""
SIGMAS = (1.0, 3.0)
"""Of the photographs' texture, px: stalks and the gaps between them lie between the two."""
WAY_SHARE = 0.4
"""Of the blade's width, to either side of its middle: not what grows beside the swath."""
ASIDE_M = 0.12
"""Right of the crop's end ground begins: stalks hang over."""
REACH_M = 1.3
"""Right of the vehicle's middle ground is not looked at: the next crop may stand there."""
LEAST_CELLS = 6
"""Of ground, to compare with."""
A, B, MIDDLE, SPREAD = 0, 1, 5, 6
"""Among the photographs' features: colour, and the logarithms of two textures that have no
direction: what one blur keeps and the other takes away, and the spread of brightness."""
NO_COLOUR = 2.0
"""Added to the strength of colour (relative to brightness, % of it), so that it has a logarithm
where there is none; ripe crop and stubble have 15 to 30."""
DUST_SHARE = 1.5
"""Dust takes texture by so many times the logarithm of what it takes of colour: it has some colour
of its own. Chosen on drives of seed 1, with 0 (lost half of lodged crop in dust), 0.5 and 1."""
LEARN_EVERY = 10
"""Sure pictures of crop at the blade, once enough is known: crop changes little within half a
metre, and a look takes a third of a millisecond."""
LEARNT, LEAST_LEARNT = 20, 5
"""Pictures by whose median crop is known: the last 10 m; and from how many on."""
HALF, LEAST = 0.5, 0.2
"""Crop lies where the way is rougher than ground by this share of what crop is; and where dust
makes crop itself hardly rougher than ground, within this (a logarithm) of crop: it would make
ground still smoother."""
SURE, SPAN = 0.5, 0.45
"""Confidence at that border, and what is added up to the roughness of standing crop."""


class LyingCrop:
    """Looks in the pictures of one mount."""

    def __init__(self, camera: Camera, vehicle: Vehicle) -> None:
        width, height = camera.size
        near, half = vehicle.blade_x_m, 0.5 * vehicle.blade_width_m
        rows = camera.project([[near, 0.0, 0.0], [near + AHEAD_M, 0.0, 0.0]])[:, 1]
        bottom = int(np.clip(rows[0], CELL[0], height))
        count = max(1, (bottom - max(0, int(rows[1]))) // CELL[0])
        top = bottom - count * CELL[0]
        u = CELL[1] * (np.arange(width // CELL[1]) + 0.5)
        v = top + CELL[0] * (np.arange(count) + 0.5)
        rays = camera.rays(np.stack(np.meshgrid(u, v), -1))
        y = camera.rays_on_height(rays, 0.0)[..., 1]
        way = np.abs(y) < WAY_SHARE * vehicle.blade_width_m
        left = int(way.any(0).argmax())
        self._box = slice(top, bottom), slice(CELL[1] * left, None)
        self._y: NDArray[np.float64] = y[:, left:]
        self._way = way[:, left:]
        self._right_m = -half
        self._rougher: deque[float] = deque(maxlen=LEARNT)
        self._pictures = 0

    def learn(self, bgr: Picture, right_m: float) -> None:
        """A picture (height, width, 3) of crop that surely stands at the blade and ends at
        `right_m` in the vehicle frame."""
        self._pictures += 1
        if len(self._rougher) < LEAST_LEARNT or self._pictures % LEARN_EVERY == 0:
            rougher = self.rougher(bgr, right_m)
            if math.isfinite(rougher):
                self._rougher.append(rougher)

    def confidence(self, bgr: Picture, right_m: float) -> float:
        """That crop lies at the blade, in a picture that shows no stems there: from 0.5 on where it
        does; 0 where ground is bare, and where nothing is known. `right_m`: as for `learn`, NaN
        where the crop ended at the blade's right end."""
        if len(self._rougher) < LEAST_LEARNT:
            return 0.0
        crop = statistics.median(self._rougher)
        span = max(HALF * crop, LEAST)
        beyond = (self.rougher(bgr, right_m) - (crop - span)) / span
        return SURE + SPAN * min(1.0, beyond) if beyond > 0.0 else 0.0

    def rougher(self, bgr: Picture, right_m: float) -> float:
        """By how much the way is rougher than the ground right of the crop, in proportion to
        colour, a logarithm; NaN where too little of that ground is seen."""
        right = min(self._right_m, right_m) if math.isfinite(right_m) else self._right_m
        ground = (self._y < right - ASIDE_M) & (self._y > -REACH_M)
        if np.count_nonzero(ground) < LEAST_CELLS or not self._way.any():
            return NAN
        features = unlit(combine(measure(bgr[self._box], CELL, SIGMAS)))
        return _roughness(features[self._way]) - _roughness(features[ground])


def _roughness(cells: NDArray[np.float32]) -> float:
    """Of (n, features) cells: texture in proportion to colour, a logarithm."""
    mean = cells.mean(0)
    texture = 0.5 * float(mean[MIDDLE] + mean[SPREAD])
    colour = math.hypot(float(mean[A]), float(mean[B])) + NO_COLOUR
    return texture - DUST_SHARE * math.log(colour)
