"""Facts about the profile across a face: where what stands on the left ends towards the right."""

from __future__ import annotations

import math

import numpy as np
import pytest

from host.vision.mounted.profile import right_end

WINDOW = 60
"""Bins."""


@pytest.mark.parametrize(("expected", "found"), [(math.nan, 60), (60.0, 60), (140.0, 140)])
def test_of_two_ends_the_outer_one_counts_unless_the_other_was_there_before(
    expected: float, found: int
) -> None:
    sums = np.zeros((200, 4))  # pixels, stems, steps, grey
    sums[:, 0] = 100.0
    sums[60:140, 1], sums[140:, 1] = 45.0, 95.0
    spread = np.array([0.1, 0.1, 20.0])
    assert right_end(sums, WINDOW, 196, expected, spread)[0] == found
