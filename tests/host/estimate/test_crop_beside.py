"""Crop that goes on beside the blade is a bound on where the edge is."""

from __future__ import annotations

import numpy as np

from host.core.vehicle import Vehicle
from host.estimate.lane import Lane
from host.vision.mounted.profile import BIN_M, PIECE_M, goes_on_to
from tests.helpers.places import OnLane


def lane() -> Lane:
    made = OnLane(Vehicle()).lane
    made.place(0.0, 0.0, 0.1, 0.03)
    return made


def test_a_lane_that_has_the_edge_inside_that_crop_moves_aside_and_does_not_turn() -> None:
    made = lane()
    sure = made.offset_sigma_m
    assert made.lies_right(-0.4, (0.0, 0.0))
    assert 0.05 < made.offset_m < 0.4
    assert made.heading_rad == 0.0
    assert made.offset_sigma_m == sure


def test_a_lane_that_has_the_edge_beyond_that_crop_stays() -> None:
    made = lane()
    assert not made.lies_right(0.2, (0.0, 0.0))
    assert made.offset_m == 0.0


def test_crop_goes_on_to_its_gap_and_not_to_what_stands_behind_it() -> None:
    piece = round(PIECE_M / BIN_M)
    shares = [0.3, 0.3, 0.0, 0.3, 0.3, 0.3, 0.3]  # from right to left; the last two are the way
    sums = np.zeros((len(shares) * piece, 4))
    sums[:, 0] = 10.0
    sums[:, 1] = 10.0 * np.repeat(shares, piece)
    assert goes_on_to(sums, 7 * piece, 5 * piece) == 3 * piece
