"""Baked tiles of ground and crop, with their mip levels, in display-referred BGR."""

from __future__ import annotations

import functools
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

SIDE: Final = 1024
"""Pixels of a texture, which repeats."""
SOIL, STUBBLE, STRAW, GRASS, TOP, WALL = range(6)

Tile = NDArray[np.uint8]
Colour = tuple[float, float, float]


def _noise(rng: np.random.Generator, *octaves: tuple[int, float]) -> NDArray[np.float32]:
    """Periodic noise of the tile's size, zero mean: sum of (wavelength in texels, amplitude)."""
    total = np.zeros((SIDE, SIDE), np.float32)
    for wave, amplitude in octaves:
        n = SIDE // wave
        grid = rng.standard_normal((n, n)).astype(np.float32)
        wrapped = np.pad(grid, ((0, 1), (0, 1)), mode="wrap")
        big = cv2.resize(wrapped, None, fx=wave, fy=wave, interpolation=cv2.INTER_LINEAR)
        total += amplitude * big[:SIDE, :SIDE]
    return total


def _strokes(
    tile: Tile,
    rng: np.random.Generator,
    count: int,
    length: tuple[int, int],
    colour: Colour,
    *,
    thick: int = 1,
    shade: float = 0.45,
    upright: bool = False,
    spread: tuple[float, float] = (0.6, 1.1),
) -> None:
    """Draws periodic strokes, each with its shadow beside it."""
    xy = rng.integers(0, SIDE, (count, 2))
    reach = rng.integers(*length, count)
    angle = rng.normal(np.pi / 2, 0.12, count) if upright else rng.random(count) * np.pi
    tone = rng.uniform(*spread, count)
    # Straws differ in hue and saturation, not in brightness alone.
    tint = rng.normal(1, 0.06, (count, 3))
    paint = tone[:, None] * tint * np.array(colour)
    step = np.stack([reach * np.cos(angle), reach * np.sin(angle)], 1).astype(int)
    # Columns: a list for every stroke would keep the garbage collector busy.
    lit_bgr, dark_bgr = np.minimum(255.0, paint).T.tolist(), (shade * paint).T.tolist()
    columns = (
        *xy.T.tolist(),
        *step.T.tolist(),
        zip(*lit_bgr, strict=True),
        zip(*dark_bgr, strict=True),
    )
    for x, y, dx, dy, lit, dark in zip(*columns, strict=True):
        for ox in (0, -SIDE if x + dx >= SIDE else SIDE if x + dx < 0 else 0):
            for oy in (0, -SIDE if y + dy >= SIDE else 0):
                a, b = (x + ox, y + oy), (x + ox + dx, y + oy + dy)
                cv2.line(tile, (a[0] + thick, a[1] + 1), (b[0] + thick, b[1] + 1), dark, thick)
                cv2.line(tile, a, b, lit, thick)
                if oy == 0 and y + dy < SIDE:
                    break
            if ox == 0 and 0 <= x + dx < SIDE:
                break


def _spread() -> NDArray[np.int32]:
    n = np.arange(SIDE)
    return np.asarray(sum((n >> bit & 1) << 2 * bit for bit in range(10)), np.int32)


SPREAD: Final = _spread()
"""Texel (row, column) lies at SPREAD[column] + 2 * SPREAD[row] of its level (Z-order), so that the
neighbours of a pixel's texel share its cache line in whatever direction the picture runs."""


def _mips(tile: Tile) -> NDArray[np.int32]:
    levels = [tile]
    while levels[-1].shape[0] > 4:
        n = levels[-1].shape[0] // 2
        levels.append(cv2.resize(levels[-1], (n, n), interpolation=cv2.INTER_AREA).astype(np.uint8))
    offsets = np.cumsum([0] + [m.shape[0] ** 2 for m in levels[:-1]]).astype(np.int32)
    packed = np.empty(sum(m.shape[0] ** 2 for m in levels), np.int32)
    for offset, level in zip(offsets, levels, strict=True):
        z_order = SPREAD[: len(level)] + 2 * SPREAD[: len(level), None]
        packed[offset + z_order] = level.astype(np.int32) @ (1, 1 << 8, 1 << 16)
    return packed


@functools.lru_cache(maxsize=4)
def bake(seed: int, soil: Colour, straw: Colour, crop: Colour) -> NDArray[np.int32]:
    """All tiles: (6, texels of all levels), blue in a texel's lowest byte, then green and red, in
    the order of `SPREAD`, larger levels first. Not to be written to: equal calls share them."""
    rng = np.random.default_rng([seed, 0x7E])
    base = 1 + _noise(rng, (1, 0.05), (2, 0.06), (8, 0.07), (32, 0.06), (128, 0.05))
    cast = 1 + np.stack([_noise(rng, (4, 0.03), (64, 0.012)) for _ in range(3)], -1)
    ground = np.asarray(np.clip(np.array(soil) * base[..., None] * cast, 0, 255), np.uint8)

    stubble = ground.copy()
    _strokes(stubble, rng, 20000, (8, 50), straw, spread=(0.6, 1.1), shade=0.6)
    swath = stubble.copy()
    _strokes(swath, rng, 26000, (25, 110), straw, spread=(0.65, 1.15), shade=0.5)
    grass = ground.copy()
    _strokes(grass, rng, 9000, (5, 20), (58, 122, 98), spread=(0.5, 1.1))
    dark = tuple(0.6 * c for c in crop)
    top = np.empty((SIDE, SIDE, 3), np.uint8)
    top[:] = np.array(dark, np.uint8)
    _strokes(top, rng, 26000, (10, 22), crop, thick=2, spread=(0.6, 1.1), shade=0.6)
    wall = np.empty((SIDE, SIDE, 3), np.uint8)
    wall[:] = np.array([0.5 * c for c in crop], np.uint8)
    _strokes(wall, rng, 5200, (160, 420), crop, upright=True, spread=(0.4, 0.95), shade=0.6)

    packed = [_mips(t) for t in (ground, stubble, swath, grass, top, wall)]
    return np.stack(packed)
