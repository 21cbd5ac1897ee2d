"""How far the next crop stands, by looks from several places: facts of the estimate."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.vehicle import Vehicle
from host.estimate.crop_beyond import HEIGHT_M, CropBeyond

VEHICLE = Vehicle()


def shown_m(crop_m: float, pitch_rad: float) -> float:
    """How far before the blade a camera shows it that looks so much lower than is believed."""
    below_rad = math.atan2(HEIGHT_M, VEHICLE.blade_x_m + crop_m) + pitch_rad
    return HEIGHT_M / math.tan(below_rad) - VEHICLE.blade_x_m


def seen(crop_m: float, pitch_rad: float, *at_m: float) -> tuple[float, float]:
    beyond = CropBeyond(VEHICLE)
    for at in at_m:
        beyond.see(at, shown_m(crop_m - at, pitch_rad))
    assert beyond.known is not None
    return beyond.known


def test_without_a_look_nothing_is_known() -> None:
    assert CropBeyond(VEHICLE).known is None


@given(st.floats(0.3, 2.5))
def test_one_look_is_taken_as_it_is_and_believed_less_the_farther_it_reaches(crop_m: float) -> None:
    place_m, sigma_m = seen(crop_m, 0.0, 0.0)
    assert place_m == pytest.approx(crop_m, abs=0.01)
    assert sigma_m < seen(crop_m + 0.2, 0.0, 0.0)[1]


def test_two_metres_are_known_to_half_a_metre_at_first() -> None:
    """What looks of picture drives err by (docs/use/thousand_fields.md)."""
    assert seen(2.0, 0.0, 0.0)[1] == pytest.approx(0.5, abs=0.06)


@given(st.floats(1.2, 2.3), st.floats(-2.0, 2.0))
def test_looks_from_nearer_take_more_than_half_of_a_pitch_s_error_away(
    crop_m: float, pitch_deg: float
) -> None:
    pitch = math.radians(pitch_deg)
    once = seen(crop_m, pitch, 0.0)
    often = seen(crop_m, pitch, 0.0, 0.4 * crop_m, 0.6 * crop_m)
    assert abs(often[0] - crop_m) < 0.5 * abs(once[0] - crop_m) + 0.01
    assert often[1] < 0.7 * once[1]
    assert abs(often[0] - crop_m) < 2.0 * often[1]


def test_a_look_that_the_others_contradict_counts_little() -> None:
    """A tuft of grass before the crop, which places behind see past."""
    beyond = CropBeyond(VEHICLE)
    for at, ahead_m in ((0.0, 0.5), (-0.25, 2.25), (-0.5, 2.5), (-0.75, 2.75)):
        beyond.see(at, ahead_m)
    assert beyond.known is not None
    assert beyond.known[0] == pytest.approx(2.0, abs=0.2)


def with_height(pitch_rad: float, higher: float, *at_m: float) -> tuple[float, float]:
    """Looks at crop 1.8 m before the blade, so much higher than the field's."""
    beyond = CropBeyond(VEHICLE)
    for at in at_m:
        ahead_m = 1.8 - at
        by_height_m = (VEHICLE.blade_x_m + ahead_m) / higher - VEHICLE.blade_x_m
        beyond.see(at, shown_m(ahead_m, pitch_rad), by_height_m)
    assert beyond.known is not None
    return beyond.known


@pytest.mark.parametrize("pitch_deg", [-3.0, 3.0])
def test_how_high_it_looks_takes_much_of_a_pitch_s_error_away(pitch_deg: float) -> None:
    """From one place already, where the foot alone errs by 0.8 m and more."""
    pitch = math.radians(pitch_deg)
    once, alone = with_height(pitch, 1.0, 0.0), seen(1.8, pitch, 0.0)
    assert abs(once[0] - 1.8) < 0.6 * abs(alone[0] - 1.8)
    assert once[1] < alone[1]


@pytest.mark.parametrize("higher", [0.8, 1.2])
def test_a_next_crop_of_another_height_is_not_believed_elsewhere_for_that(higher: float) -> None:
    once, often = with_height(0.0, higher, 0.0), with_height(0.0, higher, 0.0, 0.6, 1.1)
    assert once[0] == pytest.approx(1.8, abs=0.5)
    assert once[0] == pytest.approx(1.8, abs=1.5 * once[1])
    assert often[0] == pytest.approx(1.8, abs=0.25)


def test_a_look_that_shows_no_tops_counts_by_its_foot() -> None:
    beyond, alone = CropBeyond(VEHICLE), CropBeyond(VEHICLE)
    beyond.see(0.0, 1.8, 1.6)
    beyond.see(0.5, 1.3)
    alone.see(0.0, 1.8)
    assert beyond.known is not None and alone.known is not None
    assert beyond.known[1] < alone.known[1]


def looked(*looks: tuple[float, float], said_m: float = math.inf) -> tuple[float, float]:
    beyond = CropBeyond(VEHICLE, said_m)
    for at_m, ahead_m in looks:
        beyond.see(at_m, ahead_m)
    assert beyond.known is not None
    return beyond.known


def test_two_tufts_before_the_crop_are_no_crop_where_two_looks_see_past_them() -> None:
    """What stands farther away would have been hidden by crop (model field 11462: the next crop
    stood 1.75 m before the blade)."""
    place_m, _ = looked((0.04, 0.80), (-0.24, 0.66), (-0.49, 2.5), (-0.77, 2.5))
    assert place_m == pytest.approx(1.8, abs=0.3)


@pytest.mark.parametrize("other_m", [0.1, 0.5])
def test_where_two_looks_contradict_each_other_nothing_is_known(other_m: float) -> None:
    for looks in (((0.0, 2.0), (-0.25, other_m)), ((-0.25, other_m), (0.0, 2.0))):
        place_m, sigma_m = looked(*looks)
        assert sigma_m > 1.0
        assert place_m == pytest.approx(2.0, abs=0.2), "crop hides what stands behind it"


REMNANT = (0.0, 0.6), (-0.25, 0.85), (-0.5, 1.1), (-0.75, 2.5)
"""What stands 0.6 m before the blade, in three looks, and what the fourth sees behind it."""


def test_one_look_against_three_leaves_the_place_unknown() -> None:
    """Crop of which one look sees past, or the last tip of what was cut, behind which it stands."""
    assert looked(*REMNANT)[1] > 0.5


@pytest.mark.parametrize(("said_m", "place_m"), [(1.8, 1.8), (0.7, 0.6)])
def test_what_was_said_decides_between_places_that_explain_the_looks_alike(
    said_m: float, place_m: float
) -> None:
    """It had left the turn no room (model field 11476)."""
    assert looked(*REMNANT, said_m=said_m)[0] == pytest.approx(place_m, abs=0.2)


@pytest.mark.parametrize("crop_m", [0.5, 1.2])
def test_what_was_said_does_not_move_crop_that_all_looks_show(crop_m: float) -> None:
    looks = [(-0.25 * k, crop_m + 0.25 * k) for k in range(4)]
    place_m, sigma_m = looked(*looks, said_m=2.0)
    assert place_m == pytest.approx(crop_m, abs=0.05)
    assert sigma_m < 0.3


def test_of_two_looks_against_two_those_that_see_farther_are_believed() -> None:
    place_m, sigma_m = looked((0.0, 2.0), (-0.25, 2.25), (-0.5, 1.0), (-0.75, 1.25))
    assert place_m == pytest.approx(2.0, abs=0.2)
    assert sigma_m < 0.7


def test_a_look_at_a_tuft_tells_nothing_by_how_high_that_is_either() -> None:
    beyond = CropBeyond(VEHICLE, 2.5)
    for at_m, ahead_m, by_height_m in (
        (0.1, 0.5, 0.6), (-0.2, 2.6, 2.6), (-0.45, 1.0, 0.9), (-0.7, 1.3, 1.2),
    ):  # fmt: skip
        beyond.see(at_m, ahead_m, by_height_m)
    assert beyond.known is not None
    assert beyond.known[0] == pytest.approx(2.45, abs=0.1)
