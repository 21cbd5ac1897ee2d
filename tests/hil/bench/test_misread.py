"""Facts about what a host makes of a picture from where it does not believe the camera to be."""

from __future__ import annotations

import math
from typing import Any

import pytest

from hil.bench.misread import Misreading
from hil.scenario.scenario import Scenario


def misreading(camera: str, blade_m: float = 0.0, **mount: Any) -> Misreading:
    """Of a host that is wrong in nothing but the mount's fields that are named, and in how far
    ahead its blade is."""
    exact = Scenario(camera=camera, belief={"errors": "exact"})
    told, lens = exact.told, exact.world.lens
    believed = told.mount.model_copy(update=mount)
    ahead = told.vehicle.blade_ahead_m + blade_m
    vehicle = told.vehicle.model_copy(update={"blade_ahead_m": ahead})
    return Misreading(lens, exact.machine.blade_x_m, believed, vehicle)


@pytest.mark.parametrize("camera", ["low", "mast"])
@pytest.mark.parametrize("ahead_m", [0.0, 0.2, 0.8, 2.0])
def test_who_knows_the_truth_reads_the_truth(camera: str, ahead_m: float) -> None:
    read = misreading(camera).of(ahead_m, -0.42, cutting=ahead_m < 0.3)
    assert read == pytest.approx((ahead_m, -0.42), abs=1e-3)


@pytest.mark.parametrize("camera", ["low", "mast"])
def test_a_camera_that_looks_further_left_than_believed_moves_the_edge_right(camera: str) -> None:
    """The believed yaw is 1 deg to the right of the true one: 1 deg of the way to the blade."""
    _, right = misreading(camera, yaw_deg=-1.0).of(0.0, -0.42, cutting=True)
    assert right == pytest.approx(-0.42 - 1.5 * math.radians(1.0), abs=0.01)


def test_a_camera_that_looks_lower_than_believed_sees_the_crop_further_away() -> None:
    near, far = (misreading("low", pitch_deg=5.0 + d).of(1.0, -0.42, cutting=False)[0]
                 for d in (0.5, -0.5))  # fmt: skip
    assert near < 1.0 < far


@pytest.mark.parametrize("camera", ["low", "mast"])
def test_a_blade_believed_further_ahead_has_less_way_to_the_crop(camera: str) -> None:
    assert misreading(camera, 0.2).of(1.0, -0.42, cutting=False)[0] == pytest.approx(0.8, abs=1e-3)
    assert misreading(camera, 0.2).of(0.1, -0.42, cutting=True)[0] == 0.1


def test_a_camera_believed_further_left_reads_all_further_left() -> None:
    _, right = misreading("mast", y_m=0.03).of(0.0, -0.42, cutting=True)
    assert right == pytest.approx(-0.39, abs=1e-3)


def test_without_crop_nothing_is_misread() -> None:
    ahead, right = misreading("mast", yaw_deg=2.0).of(math.inf, math.nan, cutting=False)
    assert ahead == math.inf and math.isnan(right)
