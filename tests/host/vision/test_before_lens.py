"""Stems right before the lens of a camera below the tops, and what only looks alike."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from host.core.vehicle import LOW, MAST, Mount, Vehicle
from host.vision.mounted.before_lens import before_lens
from host.vision.mounted.detector import make_detector

ROWS, COLUMNS = 480, 640
Grey = NDArray[np.uint8]


def noisy(grey: NDArray[np.float64], sd: float = 1.0) -> Grey:
    rng = np.random.default_rng(3)
    return np.clip(grey + rng.normal(0.0, sd, grey.shape), 0, 255).astype(np.uint8)


def stems(wide_px: int = 60) -> NDArray[np.float64]:
    """Upright bands, dark and bright, over all of the picture."""
    bands = 40.0 + 70.0 * (np.arange(COLUMNS) // wide_px % 3)
    return np.tile(bands, (ROWS, 1))


def test_wide_bands_without_any_grain_stand_right_before_the_lens() -> None:
    assert before_lens(noisy(stems()))


@pytest.mark.parametrize(
    "grey",
    [
        noisy(stems(), sd=6.0),
        noisy(stems(wide_px=5)),
        noisy(np.full((ROWS, COLUMNS), 120.0)),
        noisy(np.where(np.arange(ROWS)[:, None] < 240, stems(), 120.0)),
        np.where(np.arange(COLUMNS) < COLUMNS // 2, noisy(stems()), noisy(stems(), sd=6.0)),
        noisy(np.zeros((3, COLUMNS))),
    ],
    ids=[
        "grain",
        "stems farther away",
        "dust",
        "smooth ground before crop",
        "stems before half of the lens",
        "next to no picture",
    ],
)
def test_what_shows_ground_or_nothing_does_not(grey: Grey) -> None:
    assert not before_lens(grey)


@pytest.mark.parametrize(("mount", "hidden"), [(LOW, True), (MAST, False)])
def test_a_camera_below_the_tops_says_that_they_hide_all_else(mount: Mount, hidden: bool) -> None:
    """And nothing of what stands ahead: they may be the neighbour's (random field 10167)."""
    picture = np.dstack([noisy(stems())] * 3)
    view = make_detector("robust", Vehicle(), mount).see(picture)
    assert view.hidden is hidden
    if hidden:
        assert (view.confidence, view.ahead_confidence) == (0.0, 0.0)
        assert math.isnan(view.crop_ahead_m)
        assert "before the lens" in view.reason
