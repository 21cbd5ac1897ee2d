"""Facts about the motion that pictures show: level ground, looked at from both mounts."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from host.core.vehicle import LOW, MAST, Mount
from host.vision.geometry import Camera
from host.vision.shown_motion import Shown, ShownMotion

SMALL = (160, 120)
PX_PER_M = 40.0
"""Of the ground's picture; it covers 30 m ahead and 15 m to either side."""
GROUND = cv2.resize(
    np.random.default_rng(3).integers(40, 200, (300, 300), dtype=np.uint8), (1200, 1200)
)


def seen(mount: Mount, x_m: float, yaw_rad: float, seed: int = 0) -> NDArray[np.uint8]:
    """The small picture from there on the ground, with a sensor's noise."""
    camera = Camera(mount)
    corners = np.array([[2.0, -0.7], [2.0, 0.7], [5.0, 1.5], [5.0, -1.5]])
    pixels = camera.project(np.column_stack([corners, np.zeros(4)])) / (mount.width_px / SMALL[0])
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    there = corners @ np.array([[c, s], [-s, c]]) + (x_m, 0.0)
    on_map = np.column_stack([there[:, 0] * PX_PER_M, (15.0 - there[:, 1]) * PX_PER_M])
    turn = cv2.getPerspectiveTransform(on_map.astype(np.float32), pixels.astype(np.float32))
    picture = cv2.warpPerspective(GROUND, turn, SMALL).astype(np.float64)
    noise = np.random.default_rng(seed).normal(0, 1, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def shown(
    mount: Mount, way_m: float, turn_rad: float, flip: int | None = None, steps: int = 5
) -> Shown:
    """What so many pictures show together of so much way and turn a picture."""
    made, way, turn = ShownMotion(mount, *SMALL), 0.0, 0.0
    for k in range(steps + 1):
        picture = seen(mount, 1.0 + k * way_m, k * turn_rad, k)
        one = made.take(picture if flip is None else np.asarray(cv2.flip(picture, flip), np.uint8))
        if k:
            way, turn = way + one.way_m, turn + one.turn_rad
    return Shown(turn / steps, way / steps)


@pytest.mark.parametrize("mount", [MAST, LOW], ids=["mast", "low"])
@pytest.mark.parametrize("way_m", [0.05, -0.03])
def test_on_bare_ground_the_way_is_shown(mount: Mount, way_m: float) -> None:
    found = shown(mount, way_m, 0.0)
    assert found.way_m == pytest.approx(way_m, rel=0.35)
    assert abs(found.turn_rad) < math.radians(0.2)


@pytest.mark.parametrize("mount", [MAST, LOW], ids=["mast", "low"])
@pytest.mark.parametrize("deg", [1.5, -1.5, 3.0])
def test_a_turn_is_shown_with_its_side(mount: Mount, deg: float) -> None:
    assert math.degrees(shown(mount, 0.0, math.radians(deg)).turn_rad) == pytest.approx(
        deg, rel=0.35
    )


@pytest.mark.parametrize("flip", [1, -1])
def test_a_picture_that_is_turned_over_shows_a_turn_to_the_other_side(flip: int) -> None:
    assert math.degrees(shown(MAST, 0.0, math.radians(2.0), flip).turn_rad) < -1.0


def test_a_picture_that_is_upside_down_shows_the_machine_going_back() -> None:
    assert shown(MAST, 0.05, 0.0, -1).way_m < 0.0


def test_a_stand_shows_none_and_another_place_nothing() -> None:
    made = ShownMotion(MAST, *SMALL)
    assert all(math.isnan(value) for value in made.take(seen(MAST, 1.0, 0.0)))
    stand = made.take(seen(MAST, 1.0, 0.0, 1))
    assert abs(stand.way_m) < 0.002 and abs(stand.turn_rad) < math.radians(0.05)
    rng = np.random.default_rng(9)
    elsewhere = np.asarray(cv2.blur(rng.integers(0, 255, SMALL[::-1], dtype=np.uint8), (5, 5)))
    assert all(math.isnan(value) for value in made.take(elsewhere))


def test_pictures_of_other_sizes_show_the_same() -> None:
    wide = MAST.model_copy(update={"width_px": 1280, "height_px": 720})
    made = ShownMotion(wide, 160, 90)
    for k in range(2):
        found = made.take(seen(wide, 1.0 + 0.05 * k, 0.0)[:90])
    assert found.way_m == pytest.approx(0.05, rel=0.5)
