"""Facts about the profile across a face: where what stands on the left ends towards the right."""

from __future__ import annotations

import math

import numpy as np
import pytest

from host.vision.mounted.profile import BIN_M, profile, right_end, stems_beyond

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


@pytest.mark.parametrize(("from_m", "share"), [(0.3, 0.5), (0.5, 0.5), (0.75, 0.0)])
def test_stems_count_right_of_an_end_as_far_as_dust_hides_a_face(
    from_m: float, share: float
) -> None:
    """That is 0.6 m. Farther right a machine that stands askew sees the next crop, 0.8 m beside its
    own in "corners 1.0 m" (`daranti-hil beliefs`)."""
    at = 300
    sums = np.zeros((400, 4))
    sums[:, 0] = 100.0
    sums[at:, 1] = 60.0
    sums[: at - round(from_m / BIN_M), 1] = 50.0
    assert stems_beyond(sums, at) == pytest.approx(share)


def test_a_bin_holds_what_its_pixels_are_however_many() -> None:
    """A picture of which every column is a bin, but for those that share one."""
    rows, columns = 480, 200
    rng = np.random.default_rng(1)
    stems, steps = (np.where(rng.random((rows, columns)) < p, 255, 0) for p in (0.3, 0.9))
    grey = rng.integers(200, 256, (rows, columns))
    lateral = np.minimum(np.arange(columns), 30) * BIN_M + BIN_M / 2
    across = np.broadcast_to(lateral, (rows, columns)).astype(np.float32)
    upward = np.broadcast_to(np.linspace(1.0, 0.0, rows)[:, None], (rows, columns))
    upward = np.ascontiguousarray(upward, np.float32)
    reach = np.stack([upward.min(1), upward.max(1)], 1)
    sums = np.full((40, 4), -1.0)
    planes = [np.asarray(p, np.uint8) for p in (stems, steps, grey)]
    profile(*planes, across, upward, reach, 1.0, (0.0, 0.0), (0.2, 0.3, 0.5, 0.9), 0.0, sums)
    inside = ((upward >= 0.2) & (upward <= 0.3)) | ((upward >= 0.5) & (upward <= 0.9))
    place = np.minimum(np.arange(columns), 30)
    for k, weight in enumerate((np.ones_like(grey), stems > 0, steps > 0, grey)):
        plain = np.bincount(place, (inside * weight).sum(0), minlength=40)
        assert np.array_equal(sums[:, k], plain)
