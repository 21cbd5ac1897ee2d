"""Upright stems by brightness alone: no colour, hence nothing to tune between morning and evening.

A stem is a step of brightness across the picture that goes on along the image of a true vertical
for longer than stubble is high at that place. Brightness is taken by its logarithm, so that stems
in shadow count as those in the sun do.
"""

from __future__ import annotations

import cv2
import numpy as np

from host.core.compiled import compiled
from host.core.vehicle import Vehicle
from host.vision.geometry import Camera
from host.vision.mounted.evidence import LOGARITHM, Evidence
from host.vision.mounted.lines import least_length_px, rails, upright_pieces
from host.vision.pictures import Mask, Picture, u8

TILTS_DEG = (-3.5, 3.5)
"""Of wind-blown and leaning stems, about the mount's own verticals."""
CUT_QUANTILE = 0.72
"""A step counts where it is greater than this share of those on the ground that the machine is
about to roll over, which is known to be cut: focus, noise and dust set the scale by themselves."""
FAINTER = 0.7
"""Factor on the least step while crop is being cut: dust dims it."""
STEP_RANGE = (8, 11)
"""In 255ths of the logarithmic range."""
GAP_PX = 2
"""A stem that is interrupted by so much is one."""


class Stems:
    """The stage for pictures of one mount."""

    def __init__(self, camera: Camera, vehicle: Vehicle) -> None:
        width, height = camera.size
        self._tracks = [rails(width, height, camera, tilt) for tilt in TILTS_DEG]
        self._least_px = least_length_px(camera, vehicle.blade_height_m)
        self._cut = _cut_ground(camera, vehicle)

    def run(self, bgr: Picture, cutting: bool = False) -> Evidence:
        """The evidence of one picture (height, width, 3). `cutting`: through the blade's dust,
        fainter steps count; stubble that then passes for stems is behind the blade."""
        grey = u8(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY))
        cv2.LUT(grey, LOGARITHM, grey)
        least = _quantile(grey[self._cut], CUT_QUANTILE, *STEP_RANGE)
        steps = np.empty_like(grey)
        _upright_steps(grey, int(least * (FAINTER if cutting else 1.0)), steps)
        upright = upright_pieces(steps, self._tracks, self._least_px, GAP_PX)
        return Evidence(upright, steps, grey)


@compiled("(u1[:, ::1], f8, i8, i8)", "(u1[:, :], f8, i8, i8)", boundscheck=False)
def _quantile(grey: Mask, share: float, least: int, most: int) -> int:
    """The step across the picture that `share` of all do not exceed, in [least, most]."""
    height, width = grey.shape
    enough = share * (height * (width - 2))
    for level in range(least, most):
        below = 0
        for v in range(height):
            row = grey[v]
            for u in range(width - 2):
                below += int(abs(np.int16(row[u + 2]) - np.int16(row[u])) <= level)
        if below >= enough:
            return level
    return most


@compiled("(u1[:, ::1], i8, u1[:, ::1])", boundscheck=False)
def _upright_steps(grey: Mask, least: int, steps: Mask) -> None:
    """255 where the step across the picture exceeds `least` and the step along it."""
    height, width = grey.shape
    enough = np.uint8(least)
    for v in range(height):
        above, below = grey[abs(v - 1)], grey[v + 1 if v + 1 < height else v - 1]
        row, out = grey[v], steps[v]
        out[0], out[width - 1] = 0, 0
        for u in range(1, width - 1):
            left, right, up, down = row[u - 1], row[u + 1], above[u], below[u]
            across = np.uint8(max(left, right) - min(left, right))
            along = np.uint8(max(up, down) - min(up, down))
            out[u] = np.uint8(255) if (across > along) & (across > enough) else np.uint8(0)


def _cut_ground(camera: Camera, vehicle: Vehicle) -> tuple[slice, slice]:
    """Rows and columns between the picture's lower border and the blade's line."""
    half = 0.4 * vehicle.blade_width_m
    ends = camera.project([[vehicle.blade_x_m, half, 0], [vehicle.blade_x_m, -half, 0]])
    width, height = camera.size
    top = int(np.clip(ends[:, 1].max() + 4, 0, height - 8))
    left, right = (int(np.clip(u, 0, width)) for u in ends[:, 0])
    return slice(top, height), slice(left, max(right, left + 8))
