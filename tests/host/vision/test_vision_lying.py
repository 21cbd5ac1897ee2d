"""Crop that lies before the blade, on drawn pictures: told from bare ground by how rough it is."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from host.core.vehicle import LOW, MAST, Mount, Vehicle
from host.vision.geometry import Camera
from host.vision.mounted.detector import MountedDetector, make_detector
from host.vision.mounted.lying import LEAST_LEARNT, LyingCrop
from host.vision.view import CropView
from tests.helpers.scenery import field

MOUNTS = {"low": LOW, "mast": MAST}
each_mount = pytest.mark.parametrize("mount", MOUNTS.values(), ids=MOUNTS)

Picture = NDArray[np.uint8]


def bare(mount: Mount, seed: int = 20) -> Picture:
    """The crop has ended; the next stands behind a gap."""
    return field(mount, right_m=-2.99, face_x_m=30, next_crop_m=1.5 + 2.5, seed=seed)


def flattened(
    mount: Mount, picture: Picture | None = None, seed: int = 20, far_m: float = 1.2
) -> Picture:
    """A picture, or `bare`, and crop lies on the ground, far_m from the blade on: its stalks as
    long as those that stand and of their colours, gaps in their shade between them."""
    picture = (bare(mount, seed) if picture is None else picture).copy()
    rng, camera = np.random.default_rng(seed), Camera(mount)
    far = 1.5 + far_m
    ground = np.array([[1.5, -0.45, 0], [far, -0.45, 0], [far, 3.0, 0], [1.5, 3.0, 0]])
    shade = np.rint(camera.project(ground)).astype(np.int32)
    cv2.fillPoly(picture, [shade], (30, 45, 60))
    n = 1800
    x, y = np.sort(rng.uniform(1.5, far, n))[::-1], rng.uniform(-0.45, 3.0, n)
    low, high = rng.uniform(0.0, 0.1, n), rng.uniform(0.02, 0.12, n)
    there = x + rng.normal(0.0, 0.05, n)
    feet = camera.project(np.column_stack([x, y, low]))
    tops = camera.project(np.column_stack([there, np.maximum(y - 0.8, -0.45), high]))
    for a, b, tone in zip(feet, tops, rng.uniform(0.35, 1.1, n), strict=True):
        if max(abs(a).max(), abs(b).max()) < 4000:
            colour = tuple(float(min(255, c * tone)) for c in (90, 165, 205))
            cv2.line(picture, (int(a[0]), int(a[1])), (int(b[0]), int(b[1])), colour, 1)
    return picture


def veiled(picture: Picture, thick: float) -> Picture:
    """The blade's dust over its way; it has a fifth of the colour of straw."""
    veil = np.zeros(picture.shape[:2])
    veil[240:470, 100:510] = thick
    veil = cv2.GaussianBlur(veil, (0, 0), 12)[..., None]
    dust = np.array((165, 178, 190))
    return np.clip(picture * (1 - veil) + dust * veil, 0, 255).astype(np.uint8)


def shaded(picture: Picture, light: float) -> Picture:
    """A shadow over the blade's way and not beside it."""
    dark = np.ones(picture.shape[:2])
    dark[:, 100:510] = light
    dark = cv2.GaussianBlur(dark, (0, 0), 5)[..., None]
    return np.clip(picture * dark, 0, 255).astype(np.uint8)


def cutting(mount: Mount, dust: float = 0.0, pictures: int = 10) -> MountedDetector:
    """A detector that has seen crop at the blade in so many pictures."""
    eye = make_detector("robust", Vehicle(), mount)
    for seed in range(pictures):
        eye.see(veiled(field(mount, seed=seed), dust))
    return eye


@each_mount
@pytest.mark.parametrize("seed", [20, 21, 22])
def test_crop_that_lies_at_the_blade_is_no_clear_ground(mount: Mount, seed: int) -> None:
    eye, fresh = cutting(mount), make_detector("robust", Vehicle(), mount)
    lies = flattened(mount, seed=seed)
    assert fresh.see(lies).with_lying().crop_ahead_m > 1.0  # no stems are seen there
    views = [eye.see(lies).with_lying() for _ in range(6)]
    assert [v.crop_ahead_m for v in views] == [0.0] * 6
    assert min(v.ahead_confidence for v in views) >= 0.5
    assert "crop that lies" in views[0].reason


@each_mount
@pytest.mark.parametrize("seed", [20, 21, 22])
def test_crop_lies_before_crop_that_stands_0_7_m_ahead(mount: Mount, seed: int) -> None:
    """The blade has what lies before it still to cut: it was a side's end, 2.6 m early (field
    10555)."""
    eye = cutting(mount)
    stands = field(mount, face_x_m=1.5 + 0.68, next_crop_m=None, seed=seed)
    view = eye.see(flattened(mount, stands, seed, far_m=0.55))
    assert 0.6 < view.crop_ahead_m < 1.0
    assert view.lies_confidence >= 0.5
    eye = cutting(mount)
    assert eye.see(stands).lies_confidence < 0.5


@each_mount
def test_its_right_end_is_doubted(mount: Mount) -> None:
    eye, lies = cutting(mount), flattened(mount)
    views = [eye.see(lies).with_lying() for _ in range(20)]
    assert max(v.confidence for v in views) < 0.5
    assert all(math.isnan(v.edge_offset_most_m) for v in views)


@each_mount
@pytest.mark.parametrize("dust", [0.0, 0.3])
@pytest.mark.parametrize("light", [1.0, 0.6])
def test_an_end_is_clear_in_dust_and_in_shadow(mount: Mount, dust: float, light: float) -> None:
    eye = cutting(mount, dust)
    views = [
        eye.see(shaded(veiled(bare(mount, s), dust), light)).with_lying() for s in range(20, 28)
    ]
    assert all(v.crop_ahead_m > 1.0 for v in views)
    assert views[-1].ahead_confidence >= 0.5


@each_mount
def test_crop_that_lies_is_told_in_dust_too(mount: Mount) -> None:
    eye = cutting(mount, 0.3)
    views = [eye.see(veiled(flattened(mount, seed=s), 0.3)).with_lying() for s in range(20, 24)]
    assert all(v.crop_ahead_m == 0.0 for v in views)


@each_mount
def test_nothing_lies_there_before_crop_was_seen_to_stand(mount: Mount) -> None:
    eye = cutting(mount, pictures=3)
    assert eye.see(flattened(mount)).with_lying().crop_ahead_m > 1.0


@each_mount
def test_a_look_with_the_blade_out_still_shows_it_and_a_turn_ends_it(mount: Mount) -> None:
    eye, lies = cutting(mount), flattened(mount)
    eye.restart(turned=False)
    assert eye.see(lies).with_lying().crop_ahead_m == 0.0
    eye.restart(turned=True)
    assert eye.see(lies).with_lying().crop_ahead_m > 1.0


@each_mount
def test_pictures_without_crop_count_anew_after_crop_that_lies(mount: Mount) -> None:
    """What ends a side is ground that stays clear."""
    eye = cutting(mount)
    clear = [eye.see(bare(mount)).with_lying() for _ in range(4)]
    assert clear[-1].ahead_confidence >= 0.5
    eye.see(flattened(mount)).with_lying()
    assert eye.see(bare(mount)).with_lying().ahead_confidence < 0.5


@pytest.mark.parametrize(("lies", "ahead_m", "sure"), [(0.5, 0.0, 0.45), (0.49, 2.0, 0.9)])
def test_who_takes_it_for_crop_is_unsure_of_its_end(
    lies: float, ahead_m: float, sure: float
) -> None:
    view = CropView(0.9, edge_offset_m=0.1, crop_ahead_m=2.0, lies_confidence=lies)
    assert view.with_lying().crop_ahead_m == ahead_m
    assert view.with_lying().confidence == pytest.approx(sure)
    assert view.crop_ahead_m == 2.0


def test_without_ground_beside_the_crop_nothing_is_said() -> None:
    """Crop on both sides: an opening cut."""
    camera, vehicle = Camera(MAST), Vehicle()
    lying = LyingCrop(camera, vehicle)
    for seed in range(LEAST_LEARNT):
        lying.learn(field(MAST, seed=seed), -0.45)
    lies = flattened(MAST)
    assert lying.confidence(lies, -0.45) >= 0.5
    assert lying.confidence(lies, -1.25) == 0.0
    assert math.isnan(lying.rougher(lies, -1.25))
    assert math.isnan(lying.rougher(lies, -1.15)), "a few cells of it are no ground"


@each_mount
def test_a_shadow_on_the_way_makes_it_hardly_rougher(mount: Mount) -> None:
    lying, lies = LyingCrop(Camera(mount), Vehicle()), flattened(mount)
    rough = lying.rougher(lies, -0.45)
    assert lying.rougher(shaded(lies, 0.6), -0.45) == pytest.approx(rough, rel=0.15)
    assert abs(lying.rougher(shaded(bare(mount), 0.6), -0.45)) < 0.15 * rough


@each_mount
def test_dust_that_hides_texture_and_colour_hides_little_of_it(mount: Mount) -> None:
    lying, lies = LyingCrop(Camera(mount), Vehicle()), flattened(mount)
    rough = lying.rougher(lies, -0.45)
    assert lying.rougher(veiled(lies, 0.4), -0.45) > 0.85 * rough
    assert abs(lying.rougher(veiled(bare(mount), 0.4), -0.45)) < 0.2 * rough
