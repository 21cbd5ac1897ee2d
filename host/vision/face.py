"""The face of the standing crop, in metres, from a picture of its upright stems.

While cutting, the crop ahead ends in a face across the vehicle's path at the blade's line; after a
turn the face stands further ahead. Its foot tells the distance, its right end is E_outer. Both come
from where stems stand, so that neither the crop's height nor the camera's side of it matters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from host.vehicle import Vehicle
from host.vision.geometry import Camera
from host.vision.pictures import Mask, u8
from host.vision.view import NAN

Floats = NDArray[np.float32]

BIN_M = 0.005
"""Across the face."""
SPAN_M = (-1.6, 1.0)
"""Of the face that is looked at, from right to left of the vehicle."""
BAND_M = (0.06, 0.34)
"""Heights on the face in which stems are counted: above the stubble's specks, below where the next
crop behind a gap appears to a camera beneath the tops."""
DENSE = 0.10
"""Share of lit pixels that makes a neighbourhood standing crop."""
REACH_M = 12.0
"""Feet further than this from the camera are not told apart from the horizon."""
FAR_M = 2.5
"""Beyond this the right end of what stands there is of no use to a pilot."""
NEAR_SHARE = 0.2
"""Share of the blade's width that must be reached for crop to count as ahead."""


@dataclass(frozen=True, slots=True)
class Face:
    """What was found; NaN and 0 where nothing was."""

    ahead_m: float
    """From the blade's line to the face; inf where none is in reach."""
    ahead_confidence: float
    right_m: float
    """Lateral position of the face's right end in the vehicle frame (left positive)."""
    right_confidence: float
    at_x_m: float
    """Of the face, in the vehicle frame: where `right_m` was measured."""
    standing: NDArray[np.bool_]


@numba.njit(cache=True, nogil=True)
def _profile(
    lit: Mask,
    across: Floats,
    upward: Floats,
    scale: float,
    origin_y: float,
    origin_z: float,
    band: tuple[float, float],
    right: float,
    out: Floats,
    seen: Floats,
) -> None:
    """Lit and all pixels of the face's band, counted by lateral bins from the right end."""
    height, width = lit.shape
    bins = out.shape[0]
    for v in range(height):
        for u in range(width):
            z = origin_z + scale * upward[v, u]
            if z < band[0] or z > band[1]:
                continue
            b = int((origin_y + scale * across[v, u] - right) / BIN_M)
            if 0 <= b < bins:
                seen[b] += 1.0
                if lit[v, u]:
                    out[b] += 1.0


@numba.njit(cache=True, nogil=True)
def _feet(dense: Mask, horizon: int, lowest: NDArray[np.int32]) -> None:
    """Lowest dense row of every column below the horizon; -1 where there is none."""
    height, width = dense.shape
    for u in range(width):
        lowest[u] = -1
    for v in range(height - 1, horizon - 1, -1):
        for u in range(width):
            if lowest[u] < 0 and dense[v, u]:
                lowest[u] = v


@numba.njit(cache=True, nogil=True)
def _step(lit: Floats, seen: Floats, window: int, least_inside: float) -> tuple[int, float, float]:
    """The bin where the crop on the left (higher bins) ends towards the right, and the densities
    on the crop's side and on the other; -1 where there is none.

    It is the division with the greatest two-class variance of windows on either side, or one as
    good that lies wholly right of it: a stand beside the others is the outer one."""
    n = lit.shape[0]
    a = np.zeros(n + 1)
    b = np.zeros(n + 1)
    for i in range(n):
        a[i + 1] = a[i] + lit[i]
        b[i + 1] = b[i] + seen[i]
    score = np.zeros(n)
    inside = np.zeros(n)
    outside = np.zeros(n)
    at = -1
    for i in range(4, n - 4):
        lo, hi = max(0, i - window), min(n, i + window)
        below, above = b[i] - b[lo], b[hi] - b[i]
        if above < 1.0 or below < 1.0:
            continue
        outside[i], inside[i] = (a[i] - a[lo]) / below, (a[hi] - a[i]) / above
        if inside[i] < least_inside or inside[i] <= outside[i]:
            continue
        share = above / (above + below)
        score[i] = (inside[i] - outside[i]) ** 2 * share * (1.0 - share)
        if at < 0 or score[i] > score[at]:
            at = i
    if at < 0:
        return -1, 0.0, 0.0
    further = at
    for i in range(4, at - window):
        if score[i] > 0.5 * score[at] and (further == at or score[i] > score[further]):
            further = i
    return further, inside[further], outside[further]


class FaceFinder:
    """Finds the face in pictures of one mount."""

    def __init__(self, camera: Camera, vehicle: Vehicle) -> None:
        self._camera = camera
        self._vehicle = vehicle
        width, height = camera.size
        u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        rays = camera.rays(np.stack([u, v], -1))
        forward = np.where(rays[..., 0] > 1e-6, rays[..., 0], np.nan)
        far = 1e6
        self._across = np.nan_to_num(rays[..., 1] / forward, nan=far).astype(np.float32)
        self._upward = np.nan_to_num(rays[..., 2] / forward, nan=far).astype(np.float32)
        ground = camera.on_height(np.stack([u, v], -1), 0.0)
        x = np.nan_to_num(ground[..., 0], nan=far)
        self._ground_x = np.minimum(x, far).astype(np.float32)
        within = self._ground_x.min(1) < REACH_M
        self._horizon = int(np.argmax(within)) if within.any() else height
        self._columns = np.arange(width)

    def find(self, upright: Mask, textured: Mask) -> Face:
        """`upright` holds the stems' pixels, `textured` all pixels with a step across (without it
        nothing says that an empty place was seen at all)."""
        vehicle = self._vehicle
        near = cv2.boxFilter(upright, cv2.CV_8U, (17, 9))
        dense = u8(cv2.threshold(near, 255 * DENSE, 255, cv2.THRESH_BINARY)[1])
        lowest = np.empty(upright.shape[1], np.int32)
        _feet(dense, self._horizon, lowest)
        x, y = self._contour(lowest)
        ahead, sight = self._ahead(x, y, textured)
        standing = np.asarray(dense > 0)
        if ahead > FAR_M:
            return Face(ahead, sight, NAN, 0.0, NAN, standing)
        face_x = max(vehicle.blade_x_m, vehicle.blade_x_m + ahead)
        right, sure = self._right_end(upright, face_x)
        return Face(ahead, sight, right, sure, face_x, standing)

    def _contour(self, lowest: NDArray[np.int32]) -> tuple[Floats, Floats]:
        """(x, y) on the ground of each column's foot; inf where there is none."""
        rows = np.maximum(lowest, 0)
        x = np.where(lowest >= 0, self._ground_x[rows, self._columns], np.inf)
        y = self._camera.position[1] + self._across[rows, self._columns] * (
            x - self._camera.position[0]
        )
        return x.astype(np.float32), np.where(np.isfinite(x), y, np.inf).astype(np.float32)

    def _ahead(self, x: Floats, y: Floats, textured: Mask) -> tuple[float, float]:
        """Distance from the blade's line to the nearest face that fills a share of its width."""
        vehicle = self._vehicle
        half = 0.5 * vehicle.blade_width_m
        inside = np.abs(y) < half
        near = x[inside]
        sight = self._sight(textured)
        if near.size == 0:
            return math.inf, sight
        order = np.argsort(near)
        lateral = (near - self._camera.position[0]) / self._camera.matrix[0, 0]
        reached = np.cumsum(lateral[order])
        enough = np.searchsorted(reached, NEAR_SHARE * vehicle.blade_width_m)
        if enough >= len(order):
            return math.inf, sight
        distance = float(near[order][enough]) - vehicle.blade_x_m
        return max(0.0, distance), max(sight, 0.9 if reached[-1] > 0.3 else 0.5)

    def _sight(self, textured: Mask) -> float:
        """How surely the picture shows anything at all: the share of textured pixels below the
        horizon, as a probability."""
        below = textured[self._horizon :]
        share = float(cv2.countNonZero(below)) / max(1, below.size)
        return min(0.95, share / 0.05)

    def _right_end(self, upright: Mask, face_x: float) -> tuple[float, float]:
        """Lateral position of the face's right end on the plane at `face_x`, and confidence."""
        scale = face_x - float(self._camera.position[0])
        bins = round((SPAN_M[1] - SPAN_M[0]) / BIN_M)
        lit, seen = np.zeros(bins, np.float32), np.zeros(bins, np.float32)
        _profile(
            upright,
            self._across,
            self._upward,
            scale,
            float(self._camera.position[1]),
            float(self._camera.position[2]),
            BAND_M,
            SPAN_M[0],
            lit,
            seen,
        )
        at, inside, outside = _step(lit, seen, round(0.3 / BIN_M), DENSE)
        if at < 0:
            return NAN, 0.0
        contrast = (inside - outside) / max(inside + outside, 1e-6)
        return SPAN_M[0] + at * BIN_M, max(0.0, min(0.95, 1.5 * contrast - 0.4))
