"""Crop beside the machine's way: a machine that has come off its strip still sees its edge."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from host.core.vehicle import LOW, MAST, Mount, Vehicle
from host.vision.mounted.beside import (
    BLOCKS,
    OUTSIDE_M,
    REACH_M,
    WALL_AHEAD_M,
    WALL_ASIDE_M,
    WALL_BLOCKS,
    right_end_beside,
    stands_right,
)
from host.vision.mounted.detector import make_detector
from host.vision.view import BESIDE_M
from tests.helpers.scenery import field

BLADE_X_M = 1.5
MOUNTS = {"low": LOW, "mast": MAST}


def feet(
    at_m: float, ahead_m: tuple[float, float] = BESIDE_M, blocks: int = 6
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Blocks of columns whose feet stand along a line beside the machine."""
    x = np.linspace(ahead_m[0] + 0.1, ahead_m[1] - 0.1, blocks) + BLADE_X_M
    return x.astype(np.float32), np.full(blocks, at_m, np.float32)


def test_the_feet_beside_the_way_say_where_the_crop_ends() -> None:
    x, y = feet(0.9)
    y[2] = 1.3  # a gap in the crop, through which more is seen
    assert right_end_beside(x, y, BLADE_X_M) == pytest.approx(0.9)


def test_stalks_that_are_seen_behind_the_first_ones_do_not_move_the_right_end() -> None:
    """From low down most of the blocks look between the stalks."""
    x, y = feet(0.5, blocks=12)
    y[5:] = np.linspace(0.75, 1.45, 7)
    assert right_end_beside(x, y, BLADE_X_M) == pytest.approx(0.5, abs=0.01)


def test_feet_that_stand_in_no_line_tell_no_right_end() -> None:
    x, y = feet(0.3, blocks=BLOCKS)
    y[1:] = 0.7, 1.2
    assert math.isnan(right_end_beside(x, y, BLADE_X_M))


@pytest.mark.parametrize("at_m", [OUTSIDE_M - 0.1, REACH_M + 0.1])
def test_neither_what_stands_in_the_way_nor_what_is_far_off_stands_beside_it(at_m: float) -> None:
    assert math.isnan(right_end_beside(*feet(at_m), BLADE_X_M))


def test_one_foot_or_two_are_weeds() -> None:
    assert math.isnan(right_end_beside(*feet(0.9, blocks=BLOCKS - 1), BLADE_X_M))
    assert math.isfinite(right_end_beside(*feet(0.9, blocks=BLOCKS), BLADE_X_M))


def test_what_stands_behind_the_blade_or_far_ahead_does_not_count() -> None:
    assert math.isnan(right_end_beside(*feet(0.9, (-0.5, BESIDE_M[0])), BLADE_X_M))
    assert math.isnan(right_end_beside(*feet(0.9, (BESIDE_M[1], 4.0)), BLADE_X_M))


@pytest.mark.parametrize("mount", MOUNTS.values(), ids=MOUNTS)
@pytest.mark.parametrize("off_m", [0.3, 0.6])
def test_a_picture_shows_the_edge_of_crop_beside_a_machine_that_has_come_off_it(
    mount: Mount, off_m: float
) -> None:
    vehicle = Vehicle()
    right_m = vehicle.blade_width_m / 2 + off_m
    picture = field(mount, right_m=right_m, face_x_m=0.8, depth_m=5.0, next_crop_m=None)
    view = make_detector("robust", vehicle, mount).see(picture)
    assert view.crop_ahead_m > 0.8
    assert view.edge_beside_m == pytest.approx(right_m + vehicle.inset_m, abs=0.12)


# ---- crop right of the blade ---------------------------------------------------------------------

EDGE_M = -0.4
"""Where the crop's edge should be."""


def wall(
    right_m: float, ahead_m: tuple[float, float] = WALL_AHEAD_M, blocks: int = WALL_BLOCKS
) -> bool:
    """Whether feet in a line so far right of the edge are taken for crop there."""
    return bool(stands_right(*feet(EDGE_M - right_m, ahead_m, blocks), BLADE_X_M, EDGE_M))


def test_feet_right_of_the_blade_are_crop_on_the_right() -> None:
    assert wall(0.2)
    assert not wall(0.2, blocks=WALL_BLOCKS - 1), "weeds"


@pytest.mark.parametrize(
    ("right_m", "stands"),
    [(WALL_ASIDE_M[0] - 0.01, False), (WALL_ASIDE_M[0] + 0.01, True),
     (WALL_ASIDE_M[1] - 0.01, True), (WALL_ASIDE_M[1] + 0.01, False)],
)  # fmt: skip
def test_neither_the_face_that_is_cut_nor_the_next_field_is_crop_on_the_right(
    right_m: float, stands: bool
) -> None:
    assert wall(right_m) is stands


def test_what_stands_ahead_on_the_right_is_not_beside_the_blade() -> None:
    assert not wall(0.2, (WALL_AHEAD_M[1], 1.0))
    assert not wall(0.2, (-1.5, WALL_AHEAD_M[0]))
