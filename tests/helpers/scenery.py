"""Pictures drawn by the geometry under test's own inverse: stems as lines from foot to top."""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import Mount
from host.vision.geometry import Camera
from host.vision.photo.split import TOWARDS_CROP, Line, Side

STUBBLE_M = 0.12
CROP_M = 0.9


def stems(
    picture: NDArray[np.uint8],
    camera: Camera,
    feet: NDArray[np.float64],
    height_m: float,
    rng: np.random.Generator,
    shades: tuple[float, float] = (0.35, 1.1),
) -> None:
    """Draws stems in ripe colours, the farthest first."""
    feet = feet[np.argsort(-feet[:, 0])]
    tops = np.column_stack([feet, np.full(len(feet), height_m)])
    tops[:, 1] += rng.normal(0, 0.015 * height_m, len(feet))
    foot = camera.project(np.column_stack([feet, np.zeros(len(feet))]))
    top = camera.project(tops)
    for a, b, shade in zip(foot, top, rng.uniform(*shades, len(feet)), strict=True):
        if np.isfinite([*a, *b]).all() and max(abs(a).max(), abs(b).max()) < 4000:
            colour = tuple(float(min(255, c * shade)) for c in (90, 165, 205))
            cv2.line(picture, tuple(int(c) for c in a), tuple(int(c) for c in b), colour, 1)


@lru_cache(maxsize=64)
def field(
    mount: Mount,
    *,
    right_m: float = -0.45,
    face_x_m: float = 1.5,
    depth_m: float = 1.0,
    next_crop_m: float | None = 6.0,
    seed: int = 0,
) -> NDArray[np.uint8]:
    """A picture from `mount`: ground with stubble, crop whose face stands across the way at
    `face_x_m` with its right end at `right_m`, and the next crop behind. Not to be drawn on: it is
    drawn once for all who ask for the same."""
    rng = np.random.default_rng(seed)
    camera = Camera(mount)
    w, h = camera.size
    v = np.arange(h)
    sky = ~np.isfinite(camera.on_height(np.column_stack([np.full(h, w / 2), v]), 0.0)[:, 0])
    picture = np.where(sky[:, None, None], (225, 200, 170), (70, 105, 128)) * np.ones((h, w, 1))
    picture = np.clip(picture + rng.normal(0, 4, (h, w, 1)), 0, 255).astype(np.uint8)
    if next_crop_m is not None:
        y = rng.uniform(-8, 8, 3000)
        stems(
            picture, camera, np.column_stack([next_crop_m + 0.3 * rng.random(3000), y]), CROP_M, rng
        )
    ground = np.column_stack([rng.uniform(0.9, 6, 1200), rng.uniform(-4, 4, 1200)])
    stems(picture, camera, ground, STUBBLE_M * 0.6, rng, (0.55, 0.75))
    n = int(900 * depth_m * (right_m + 3.0))
    crop = np.column_stack([face_x_m + depth_m * rng.random(n) ** 2, rng.uniform(right_m, 3.0, n)])
    stems(picture, camera, crop[crop[:, 0] > 0.6], CROP_M, rng)
    picture.setflags(write=False)
    return picture


def halves(
    side: Side, lean_deg: float = 0.0, shift: float = 0.0, seed: int = 1
) -> tuple[NDArray[np.uint8], Line]:
    """A picture of rough, darker crop on `side` and smooth, brighter stubble, and the line."""
    rng = np.random.default_rng(seed)
    h, w = 300, 400
    angle = math.radians(TOWARDS_CROP[side] + lean_deg)
    middle = 0.5 * w * math.cos(angle) + 0.5 * h * math.sin(angle)
    line = Line(angle, middle + shift)
    u, v = np.meshgrid(np.arange(w) + 0.5, np.arange(h) + 0.5)
    crop = line.signed(u, v) > 0
    grain = cv2.GaussianBlur(rng.normal(0, 60, (h, w)), (0, 0), 1.2)
    light = np.where(crop, 120 + grain, 165 + 0.15 * grain)
    tone = np.where(crop[..., None], (0.45, 0.75, 1.0), (0.62, 0.86, 1.0))
    return np.clip(light[..., None] * tone, 0, 255).astype(np.uint8), line
