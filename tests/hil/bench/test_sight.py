"""Facts about the perfect eye."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hil.bench.sight import look
from sim_plant.field import FLAT_RAD, Field
from sim_plant.field_spec import FieldSpec

BLADE_X_M, BLADE_WIDTH_M = 1.5, 1.0
PLAIN = FieldSpec(size_m=(10.0, 10.0), edge_wobble_m=0.0, bare=0.0, thin=0.0, lodged=0.0)


@pytest.fixture(scope="module")
def crop() -> Field:
    return Field(PLAIN, 1)


@pytest.mark.parametrize("inside_m", [0.3, 0.42, 0.5])
@pytest.mark.parametrize("before_m", [0.0, 0.4, 1.5])
def test_the_edge_and_the_crop_ahead_are_where_they_are(
    crop: Field, inside_m: float, before_m: float
) -> None:
    """Northward along the east side, the crop to the left."""
    pose = (10.0 - inside_m, -BLADE_X_M - before_m, math.pi / 2)
    seen = look(crop, pose, BLADE_X_M, BLADE_WIDTH_M)
    assert seen.right_m == pytest.approx(-inside_m, abs=0.02)
    assert seen.ahead_m == pytest.approx(before_m, abs=0.03)
    assert seen.slope == pytest.approx(0.0, abs=0.06)
    assert seen.depth_m > 2.9


@pytest.mark.parametrize(
    ("into_m", "yaw_rad"), [(-0.06, 0.0), (0.02, 0.0), (0.02, 2.0), (3.0, 1.0)]
)
def test_crop_stands_right_before_a_lens_where_its_ground_is_crop(
    crop: Field, into_m: float, yaw_rad: float
) -> None:
    """Of a lens at x 0.3, y 0.1 that is so far across the west side."""
    lens_m = (0.3, 0.1)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    at = (into_m, 5.0)
    pose = (at[0] - lens_m[0] * c + lens_m[1] * s, at[1] - lens_m[0] * s - lens_m[1] * c, yaw_rad)
    before = into_m + 0.05 * c > 0.0
    assert look(crop, pose, BLADE_X_M, BLADE_WIDTH_M, lens_m=lens_m).before_lens is before
    assert not look(crop, pose, BLADE_X_M, BLADE_WIDTH_M).before_lens


@pytest.mark.parametrize(
    ("east_m", "right"),
    [(9.5, False), (9.45, False), (9.2, True), (8.0, True), (11.2, False), (11.4, True)],
)
def test_crop_right_of_the_blade_is_whatever_stands_there(east_m: float, right: bool) -> None:
    """Northward: along the east side at 10 m, inside of it, and in the gap of 2 m, off the next
    field's crop and right beside it."""
    field = Field(PLAIN.model_copy(update={"gap_m": 2.0, "neighbour_depth_m": 4.0}), 1)
    assert look(field, (east_m, 3.0, math.pi / 2), BLADE_X_M, BLADE_WIDTH_M).crop_right is right


def test_a_machine_askew_sees_a_slope(crop: Field) -> None:
    yaw = math.pi / 2 + math.radians(8)
    seen = look(crop, (9.6, -BLADE_X_M - 0.2, yaw), BLADE_X_M, BLADE_WIDTH_M)
    assert seen.slope == pytest.approx(-math.tan(math.radians(8)), abs=0.05)


@pytest.mark.parametrize("left_m", [0.4, 0.9, 1.6])
def test_the_last_of_the_crop_is_as_deep_as_it_is(crop: Field, left_m: float) -> None:
    pose = (9.58, 10.0 - left_m - BLADE_X_M, math.pi / 2)
    seen = look(crop, pose, BLADE_X_M, BLADE_WIDTH_M)
    assert seen.ahead_m < 0.05
    assert seen.depth_m == pytest.approx(left_m, abs=0.1)


def test_beyond_the_end_the_neighbour_is_a_gap_away(crop: Field) -> None:
    seen = look(crop, (9.58, 10.1 - BLADE_X_M, math.pi / 2), BLADE_X_M, BLADE_WIDTH_M)
    assert seen.ahead_m == pytest.approx(PLAIN.gap_m - 0.1, abs=0.05)
    assert math.isnan(seen.right_m)


@pytest.mark.parametrize("off_m", [0.8, 1.0, 1.2])
def test_crop_beside_the_way_is_seen_where_none_stands_ahead(crop: Field, off_m: float) -> None:
    """Northward, the east side's crop so far to the left of the machine's middle."""
    seen = look(crop, (10.0 + off_m, 2.0, math.pi / 2), BLADE_X_M, BLADE_WIDTH_M)
    assert seen.ahead_m > 2.0
    assert seen.beside_m == pytest.approx(off_m, abs=0.05)
    alone = Field(PLAIN.model_copy(update={"neighbours": "none"}), 1)
    past_end = look(alone, (10.0 + off_m, 9.0, math.pi / 2), BLADE_X_M, BLADE_WIDTH_M)
    assert math.isnan(past_end.beside_m)


@pytest.mark.parametrize(
    ("width_m", "right_m", "remnant"), [(0.3, -0.42, True), (0.8, -1.52, False)]
)
def test_what_an_earlier_strip_has_left_is_no_edge_unless_it_is_wide(
    width_m: float, right_m: float, remnant: bool
) -> None:
    """The last strip was cut 0.3 m too far inside, or 0.8 m."""
    crop = Field(PLAIN, 1)
    edge = 8.9 - width_m + 0.8
    crop.clear(((edge - 0.3, -5.0), (edge, -5.0), (edge, 15.0), (edge - 0.3, 15.0)))
    outer = edge + width_m
    crop.clear(((outer, -5.0), (15.0, -5.0), (15.0, 15.0), (outer, 15.0)))
    inner = edge - 0.3
    crop.clear(((inner - 1.0, -5.0), (inner, -5.0), (inner, 5.0), (inner - 1.0, 5.0)))
    middle = inner - 0.42
    seen = look(crop, (middle, 5.0 - BLADE_X_M, math.pi / 2), BLADE_X_M, BLADE_WIDTH_M)
    assert seen.ahead_m < 0.05
    assert seen.right_m == pytest.approx(right_m, abs=0.03)
    assert seen.remnant is remnant


@pytest.mark.parametrize("before_m", [0.0, 1.2])
@pytest.mark.parametrize(
    ("from_m", "to_m", "lying"),
    [(0.0, 0.6, 1.0), (0.0, 0.3, 0.5), (0.7, 3.0, 0.0), (-9.0, 0.0, 0.0)],
)
def test_crop_lies_where_its_first_stalks_do(
    before_m: float, from_m: float, to_m: float, lying: float
) -> None:
    """A field whose crop lies flat so far behind its south side, and nowhere else."""
    crop = Field(PLAIN, 1)
    south = crop.origin[1] + crop.coarse * np.arange(len(crop.lodge))
    crop.lodge[(south >= from_m) & (south < to_m)] = FLAT_RAD
    pose = (9.6, -BLADE_X_M - before_m, math.pi / 2)
    assert look(crop, pose, BLADE_X_M, BLADE_WIDTH_M).lying == pytest.approx(lying, abs=0.12)


def test_where_nothing_stands_nothing_is_ahead() -> None:
    bare = Field(PLAIN.model_copy(update={"neighbours": "none"}), 1)
    seen = look(bare, (9.58, 10.1 - BLADE_X_M, math.pi / 2), BLADE_X_M, BLADE_WIDTH_M)
    assert seen.ahead_m == math.inf
    assert seen.depth_m == 0.0
