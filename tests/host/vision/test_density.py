"""Sums over neighbourhoods are those of OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from host.vision.mounted.density import ACROSS, ALONG, mark_dense, ninths
from host.vision.mounted.face import DENSE, LEAST_LIT


@pytest.mark.parametrize("share", [0.05, 0.1, 0.11, 0.5])
def test_standing_is_where_a_box_filter_says_so(share: float) -> None:
    rng = np.random.default_rng(1)
    lit = np.where(rng.random((61, 83)) < share, 255, 0).astype(np.uint8)
    near = cv2.boxFilter(lit, cv2.CV_8U, (2 * ACROSS + 1, 2 * ALONG + 1))
    found = np.empty_like(lit)
    mark_dense(lit, LEAST_LIT, found)
    assert np.array_equal(found, cv2.threshold(near, 255 * DENSE, 1, cv2.THRESH_BINARY)[1])


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (7, 2), (30, 30), (31, 47), (53, 64), (89, 200)])
def test_ninths_are_a_picture_shrunk_to_three_by_three(size: tuple[int, int]) -> None:
    rng = np.random.default_rng(2)
    lit = np.where(rng.random(size) < 0.3, 255, 0).astype(np.uint8)
    counts = np.empty((3, 3), np.int64)
    ninths(lit, counts)
    assert counts.sum() == 9 * np.count_nonzero(lit)
    # Each pixel in nine: a ninth is then as many whole ones as there are pixels.
    rows, columns = size
    fine = np.repeat(np.repeat(lit > 0, 3, 0), 3, 1).reshape(3, rows, 3, columns)
    assert np.array_equal(counts, fine.sum((1, 3)))
