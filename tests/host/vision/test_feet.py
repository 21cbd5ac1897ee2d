"""Where the stems' feet are, by what is above and what is below."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from host.vision.mounted.feet import BLOCK_PX, block_sums, feet_of
from host.vision.mounted.grain import uprightness

ROWS, BLOCKS, FOOT = 80, 3, 45
SPREAD = np.array([0.1, 0.1, 20.0])


def feet(
    *, grey: tuple[int, int], steps: tuple[bool, bool] = (False, False), lowest: int = ROWS - 1
) -> list[int]:
    """Of a picture that is alike above the foot and alike below it: (above, below)."""
    size = (ROWS, BLOCKS * BLOCK_PX)
    levels, marks = np.empty(size, np.uint8), np.empty(size, np.uint8)
    for part, level, mark in zip((slice(FOOT), slice(FOOT, None)), grey, steps, strict=True):
        levels[part], marks[part] = level, 255 * mark
    sums = np.zeros((2, ROWS + 1, BLOCKS), np.int32)
    block_sums(marks, levels, sums)
    dense = np.zeros(size, np.uint8)
    dense[: FOOT + 2] = 255
    limit, windows = np.full(ROWS, ROWS, np.int32), np.full(ROWS, 12, np.int32)
    found = np.full(BLOCKS, FOOT + 20, np.int32)
    feet_of(dense, sums, 0, limit, windows, SPREAD, np.full(BLOCKS, lowest, np.int32), found)
    return [int(one) for one in found]


@pytest.mark.parametrize("grey", [(200, 90), (90, 200)], ids=["brighter", "darker"])
def test_a_foot_divides_bright_from_dark_whichever_is_above(grey: tuple[int, int]) -> None:
    assert feet(grey=grey) == [FOOT] * BLOCKS


def test_a_foot_has_its_steps_above() -> None:
    assert feet(grey=(120, 120), steps=(True, False)) == [FOOT] * BLOCKS
    assert feet(grey=(120, 120), steps=(False, True)) != [FOOT] * BLOCKS


def test_sums_run_from_the_top_block_by_block() -> None:
    rng = np.random.default_rng(1)
    marks = np.where(rng.random((ROWS, 70)) < 0.5, 255, 0).astype(np.uint8)
    levels = rng.integers(0, 256, (ROWS, 70)).astype(np.uint8)
    blocks = 70 // BLOCK_PX
    sums = np.full((2, ROWS + 1, blocks), -1, np.int32)
    block_sums(marks, levels, sums)
    for found, plane in zip(sums, (marks & 1, levels), strict=True):
        each = plane[:, : blocks * BLOCK_PX].reshape(ROWS, blocks, BLOCK_PX).sum(2)
        assert np.array_equal(found[1:], each.cumsum(0))
        assert not found[0].any()


def test_a_foot_is_looked_for_above_what_was_looked_past_alone() -> None:
    assert max(feet(grey=(200, 90), lowest=FOOT - 10)) <= FOOT - 10
    assert feet(grey=(200, 90), lowest=-1) == [FOOT + 20] * BLOCKS, "nothing was"


def runs(picture: NDArray[np.uint8], top: int = 20, bottom: int = 70) -> list[float]:
    """Of its blocks."""
    blocks = picture.shape[1] // BLOCK_PX
    rows = (np.full(blocks, row, np.int32) for row in (top, bottom))
    found = np.empty(blocks)
    uprightness(picture, *rows, BLOCK_PX, found)
    return [float(one) for one in found]


@pytest.mark.parametrize(("lean_deg", "least", "most"), [(0, 9, 1e9), (30, 2.2, 9), (60, 0, 0.5)])
def test_stalks_that_lean_run_less_upright(lean_deg: float, least: float, most: float) -> None:
    """Waves of 8 px whose crests lean so far."""
    v, u = np.mgrid[:96, :64]
    across = u * math.cos(math.radians(lean_deg)) + v * math.sin(math.radians(lean_deg))
    picture = (120 + 60 * np.sin(across * math.tau / 8)).astype(np.uint8)
    assert all(least < one < most for one in runs(picture))


def test_of_noise_and_of_few_rows_nothing_is_said() -> None:
    rng = np.random.default_rng(0)
    noise = np.clip(rng.normal(120, 2, (96, 64)), 0, 255).astype(np.uint8)
    assert runs(noise) == [0.0] * 4
    stems = np.tile(np.repeat(np.array([60, 180], np.uint8), 4), (96, 8))
    assert runs(stems, 20, 27) == [0.0] * 4
    assert min(runs(stems, 20, 28)) > 9.0
