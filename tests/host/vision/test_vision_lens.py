"""What lies on the lens, on pictures that pass by and on pictures that stand."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from host.core.vehicle import LOW, MAST, Mount, Vehicle
from host.vision.mounted.detector import make_detector
from host.vision.mounted.lens import KNOWN, LensWatch
from host.vision.view import CropView
from tests.helpers.scenery import field

SIZE = (320, 240)
MUD = (slice(120, 184), slice(80, 160))
CELLS = (slice(16, 22), slice(11, 19))
"""Those of `MUD`, but for its border."""


def passing(count: int, moves: float = 20.0) -> list[NDArray[np.uint8]]:
    """Ground that shows something else in every picture."""
    rng = np.random.default_rng(0)
    still = 120 + rng.normal(0, 20, (SIZE[1] // 8, SIZE[0] // 8))
    out = []
    for _ in range(count):
        now = still + rng.normal(0, moves, still.shape)
        grown = cv2.resize(now, SIZE, interpolation=cv2.INTER_NEAREST)
        out.append(np.clip(grown + rng.normal(0, 4, grown.shape), 0, 255).astype(np.uint8))
    return out


def watched(pictures: list[NDArray[np.uint8]]) -> LensWatch:
    watch = LensWatch(SIZE, 40)
    for picture in pictures:
        watch.see(picture)
    return watch


def muddy(pictures: list[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
    rng = np.random.default_rng(1)
    out = [p.copy() for p in pictures]
    for p in out:
        p[MUD] = np.clip(60 + rng.normal(0, 4, p[MUD].shape), 0, 255)
    return out


def test_what_stays_while_the_ground_passes_lies_on_the_lens() -> None:
    watch = watched(muddy(passing(2 * KNOWN)))
    assert watch.covered[CELLS].all()
    watch.covered[CELLS] = False
    assert watch.covered.mean() < 0.02


def test_the_share_is_that_of_the_asked_pixels() -> None:
    watch = watched(muddy(passing(2 * KNOWN)))
    inside, beside, outside = [120.0, 150.0], [240.0, 150.0], [-50.0, 900.0]
    assert watch.share(np.array([inside, inside])) == 1.0
    assert watch.share(np.array([inside, beside, outside, outside])) == 0.25


def test_clean_ground_that_passes_shows_nothing_on_the_lens() -> None:
    assert not watched(passing(3 * KNOWN)).covered.any()


def test_a_machine_that_stands_tells_nothing_of_its_lens() -> None:
    assert not watched(muddy(passing(3 * KNOWN, moves=0.0))).covered.any()


def test_what_was_found_on_the_lens_stays_known_at_rest() -> None:
    watch = watched(muddy(passing(2 * KNOWN) + passing(100, moves=0.0)))
    assert watch.covered[CELLS].all()


def test_even_ground_that_is_bright_does_not_lie_on_the_lens() -> None:
    pictures = passing(2 * KNOWN)
    for p in pictures:
        p[MUD] = 180
    assert not watched(pictures).covered.any()


def uneven(picture: NDArray[np.uint8], seed: int) -> NDArray[np.uint8]:
    """The drawn ground is as even as mud; no real one is."""
    swell = np.random.default_rng(seed).normal(0, 25, (20, 27)).astype(np.float32)
    grown = cv2.resize(swell, picture.shape[1::-1], interpolation=cv2.INTER_CUBIC)
    return np.clip(picture + grown[..., None], 0, 255).astype(np.uint8)


def seen(mount: Mount, mud: bool) -> CropView:
    """The last view of a drive along crop, whose end lies behind mud or not."""
    eye = make_detector("robust", Vehicle(), mount)
    view = eye.see(field(mount))
    left = round(view.e_outer_px) - 8
    for seed in range(1, 2 * KNOWN):
        picture = uneven(field(mount, seed=seed), seed)
        if mud:
            picture[40:470, left : left + 80] = (15, 20, 25)
        view = eye.see(picture)
    return view


@pytest.mark.parametrize("mount", [LOW, MAST], ids=["low", "mast"])
def test_an_end_of_crop_at_the_border_of_mud_is_doubted(mount: Mount) -> None:
    clean, hidden = seen(mount, mud=False), seen(mount, mud=True)
    assert clean.confidence >= 0.5
    assert hidden.confidence < 0.5
    assert "lens" in hidden.reason
