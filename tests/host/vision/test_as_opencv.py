"""What is compiled here because OpenCV takes long for little is what OpenCV makes of it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from host.core.vehicle import MAST
from host.vision.geometry import Camera
from host.vision.mounted.grain import REACH, squared_steps
from host.vision.mounted.lens import CELL_PX, LensWatch


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.3, 0.1, 0.001, -0.002, 0.02)])
def test_points_are_projected_as_by_opencv(distortion: tuple[float, ...]) -> None:
    camera = Camera(MAST.model_copy(update={"distortion": distortion, "roll_deg": 1.3}))
    points = np.random.default_rng(1).uniform(-3.0, 8.0, (1000, 3))
    seen = (points - camera.position) @ camera.rotation.T
    before, none = seen[:, 2] > 1e-6, np.zeros(3)
    pixels = np.full((len(points), 2), np.nan)
    pixels[before] = cv2.projectPoints(
        seen[before][:, None], none, none, camera.matrix, camera.distortion
    )[0].reshape(-1, 2)
    assert np.array_equal(camera.project(points), pixels, equal_nan=True)


@pytest.mark.parametrize("size", [(5, 7), (40, 61)])
def test_steps_are_those_of_blurred_edges(size: tuple[int, int]) -> None:
    rng = np.random.default_rng(2)
    grey = rng.integers(0, 256, size).astype(np.uint8)
    inside = np.where(rng.random((size[0] - 2, size[1] - 2)) < 0.6, 255, 0).astype(np.uint8)
    upright, level = (
        cv2.blur(grey, k).astype(int) for k in ((1, 2 * REACH + 1), (2 * REACH + 1, 1))
    )
    across = (upright[1:-1, 2:] - upright[1:-1, :-2])[inside > 0]
    along = (level[2:, 1:-1] - level[:-2, 1:-1])[inside > 0]
    assert squared_steps(grey, inside) == ((across**2).mean(), (along**2).mean())


def test_cells_of_the_lens_are_a_picture_shrunk() -> None:
    cells = np.random.default_rng(3).integers(0, 256, (6, 8, CELL_PX, CELL_PX))
    grey = cells.transpose(0, 2, 1, 3).reshape(6 * CELL_PX, 8 * CELL_PX).astype(np.uint8)
    grey[:CELL_PX, :CELL_PX] = 0
    grey[0, :CELL_PX] = 4  # 32 of 64: half a grey level
    watch = LensWatch((grey.shape[1], grey.shape[0]), 0)
    shrunk = cv2.resize(grey, (8, 6), interpolation=cv2.INTER_AREA)
    assert np.array_equal(watch._shrunk(grey), shrunk)
