"""The detectors that drive, on drawn pictures whose truth is known."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from host.core.vehicle import LOW, MAST, Mount, Vehicle
from host.vision.geometry import Camera
from host.vision.mounted.detector import (
    BELIEVED,
    CLEAR,
    CLEAR_VEILED,
    TRACK,
    Mode,
    MountedDetector,
    RobustSource,
    make_detector,
)
from host.vision.mounted.face import FaceFinder
from host.vision.mounted.paper import l_height
from host.vision.mounted.scale import scale_of
from host.vision.view import CropView
from tests.helpers.scenery import field, stems

MODES: tuple[Mode, ...] = ("robust", "paper")
MOUNTS = {"low": LOW, "mast": MAST}


def detector(mode: Mode, mount: Mount) -> MountedDetector:
    return make_detector(mode, Vehicle(), mount)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("mount", MOUNTS.values(), ids=MOUNTS)
@pytest.mark.parametrize("offset", [-0.2, 0.0, 0.2])
def test_the_edge_is_found_where_it_is(mode: Mode, mount: Mount, offset: float) -> None:
    view = detector(mode, mount).see(field(mount, right_m=-0.45 + offset))
    assert view.confidence >= 0.5
    assert view.edge_offset_m == pytest.approx(offset, abs=0.05)
    assert view.crop_ahead_m == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("mount", MOUNTS.values(), ids=MOUNTS)
def test_an_edge_left_of_where_it_should_be_is_a_positive_offset(mount: Mount) -> None:
    """The paper's sign would turn the vehicle away from the crop: a forward camera sees the edge on
    the left when the vehicle is too far right."""
    view = detector("robust", mount).see(field(mount, right_m=-0.15))
    assert view.e_outer_px < view.o_map_px
    assert view.edge_offset_m > 0.2


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("mount", MOUNTS.values(), ids=MOUNTS)
@pytest.mark.parametrize("ahead", [0.5, 1.0, 1.8])
def test_crop_further_ahead_is_measured_from_the_blade(
    mode: Mode, mount: Mount, ahead: float
) -> None:
    view = detector(mode, mount).see(field(mount, face_x_m=1.5 + ahead, next_crop_m=7))
    assert view.ahead_confidence >= 0.5
    assert view.crop_ahead_m == pytest.approx(ahead, abs=0.25)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("mount", MOUNTS.values(), ids=MOUNTS)
def test_the_next_crop_behind_a_gap_is_not_crop_ahead(mode: Mode, mount: Mount) -> None:
    picture = field(mount, right_m=-2.99, face_x_m=30, next_crop_m=1.5 + 2.0)
    view = detector(mode, mount).see(picture)
    assert view.crop_ahead_m > 1.6
    assert view.ahead_confidence >= 0.5


@pytest.mark.parametrize("mount", MOUNTS.values(), ids=MOUNTS)
@pytest.mark.parametrize("gap_m", [0.8, 1.0])
def test_crop_beside_a_gap_as_wide_as_was_told_leaves_the_edge_clear(
    mount: Mount, gap_m: float
) -> None:
    picture, rng = field(mount).copy(), np.random.default_rng(0)
    right = -0.45 - gap_m - 2.0 * rng.random(5000) ** 2
    stems(picture, Camera(mount), np.column_stack([rng.uniform(0.8, 6.0, 5000), right]), 0.9, rng)
    for told_m, sure in ((gap_m, True), (2.0, False)):
        eye = detector("robust", mount)
        eye.next_crop(told_m)
        assert (eye.see(picture).confidence >= 0.5) is sure


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("mount", MOUNTS.values(), ids=MOUNTS)
@pytest.mark.parametrize("level", [0, 90, 255])
def test_a_picture_without_anything_in_it_says_so(mode: Mode, mount: Mount, level: int) -> None:
    rng = np.random.default_rng(0)
    picture = np.clip(level + rng.normal(0, 2, (480, 640, 3)), 0, 255).astype(np.uint8)
    view = detector(mode, mount).see(picture)
    assert view.confidence < 0.5
    assert view.ahead_confidence < 0.5
    assert view.reason


@pytest.mark.parametrize(("mount", "next_is_lower"), [(LOW, True), (MAST, False)])
def test_the_next_crop_appears_lower_only_below_the_tops(mount: Mount, next_is_lower: bool) -> None:
    """The paper's l_height rule has its sense from a camera below the crop's top."""
    eye = detector("paper", mount)
    first = eye.see(field(mount, next_crop_m=None))
    end = eye.see(field(mount, right_m=-2.99, face_x_m=30, next_crop_m=4.5))
    assert first.l_reference_px == end.l_reference_px
    assert (end.l_height_px > first.l_height_px) == next_is_lower
    assert first.end_of_field < 0.5 <= end.end_of_field


def dusty(picture: NDArray[np.uint8], first_row: int) -> NDArray[np.uint8]:
    """Hides what lies below a row, as a puff before the crop's foot does."""
    rows = np.arange(picture.shape[0])
    thick = 0.97 * np.clip((rows - first_row) / 30, 0, 1)[:, None, None]
    return np.clip(picture * (1 - thick) + 150 * thick, 0, 255).astype(np.uint8)


def by_its_foot() -> MountedDetector:
    """Has met nothing, and is told of so high a crop that tops of 0.9 m tell it nothing."""
    return make_detector("robust", Vehicle(crop_height_m=1.2), LOW)


def test_dust_before_the_foot_of_crop_that_is_being_cut_is_not_its_end() -> None:
    eye = detector("robust", LOW)
    assert eye.see(field(LOW, next_crop_m=None)).crop_ahead_m == pytest.approx(0, abs=0.1)
    hidden = dusty(field(LOW, next_crop_m=None, seed=2), 230)
    view = eye.see(hidden)
    assert view.crop_ahead_m < 0.3
    assert view.edge_offset_m == pytest.approx(0, abs=0.1)
    assert by_its_foot().see(hidden).crop_ahead_m > 0.3


def test_a_face_that_dust_veils_is_no_end() -> None:
    """Its stems are too faint to be steps, but their direction is that of stems."""
    eye, veiled = following(), field(MAST, seed=5)
    thick = np.zeros(veiled.shape[:2])
    thick[150:, 60:560] = 0.8
    thick = cv2.GaussianBlur(thick, (0, 0), 12)[..., None]
    veiled = np.clip(veiled * (1 - thick) + 150 * thick, 0, 255).astype(np.uint8)
    assert detector("robust", MAST).see(veiled).crop_ahead_m > 1.0
    assert [eye.see(veiled).crop_ahead_m for _ in range(5)] == [0.0] * 5
    end = field(MAST, right_m=-2.99, face_x_m=30, next_crop_m=1.5 + 2.0)
    assert eye.see(end).crop_ahead_m > 1.0


def half_veiled(picture: NDArray[np.uint8], thick: float) -> NDArray[np.uint8]:
    """A puff lies over what is right of the picture's middle."""
    veil = np.zeros(picture.shape[:2])
    veil[:, picture.shape[1] // 2 :] = thick
    veil = cv2.GaussianBlur(veil, (0, 0), 12)[..., None]
    return np.clip(picture * (1 - veil) + 200 * veil, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("thick", [0.2, 0.25, 0.3])
def test_an_end_beyond_which_crop_shows_through_the_dust_is_none(
    thick: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By its steps alone, where no stem of it can be told."""
    monkeypatch.setattr("host.vision.mounted.face.stems_beyond", lambda sums, at: 0.0 * sums[at, 0])
    camera, vehicle = Camera(MAST), Vehicle()
    source, finder = RobustSource(camera, vehicle), FaceFinder(camera, vehicle)
    dim = half_veiled(field(MAST, right_m=-2.9, seed=9), thick)
    found = finder.find(source.look(dim, False, False)[0], stands_m=0.0)
    assert found.right_m > 0.0, "in the middle of the crop"
    assert found.right_confidence < 0.5
    inside = field(MAST, right_m=-0.25, seed=9)
    found = finder.find(source.look(inside, False, False)[0], stands_m=0.0)
    assert found.right_m == pytest.approx(-0.25, abs=0.05)
    assert found.right_confidence >= 0.5


def test_an_end_shows_above_the_dust_by_how_low_the_next_crop_is() -> None:
    eye = detector("robust", LOW)
    for seed in range(4):
        eye.see(field(LOW, seed=seed))
    assert eye.see(dusty(field(LOW, seed=5), 230)).crop_ahead_m < 0.3
    end = dusty(field(LOW, right_m=-2.99, face_x_m=30, next_crop_m=1.5 + 1.8), 200)
    assert eye.see(end).crop_ahead_m > 1.0


def beside_the_swath(offset: float) -> NDArray[np.uint8]:
    """The crop's face ends at `offset`, faint in its own shade; left of the machine's swath crop
    stands nearer and bright."""
    rng = np.random.default_rng(3)
    camera = Camera(LOW)
    picture = field(LOW, right_m=-2.99, face_x_m=30, next_crop_m=6.0).copy()
    n = 450
    face = np.column_stack([rng.uniform(1.5, 2.5, n), rng.uniform(-0.45 + offset, 0.5, n)])
    stems(picture, camera, face, 0.9, rng, (0.45, 0.58))
    near = np.column_stack([rng.uniform(0.7, 1.5, 1500), rng.uniform(0.5, 2.5, 1500)])
    stems(picture, camera, near, 0.9, rng, (0.3, 1.2))
    return picture


def test_the_border_of_the_own_swath_is_not_the_crops_edge() -> None:
    picture = beside_the_swath(0.1)
    assert detector("robust", LOW).see(picture).edge_offset_m > 0.6
    eye = detector("robust", LOW)
    eye.see(field(LOW))
    assert eye.see(picture).edge_offset_m == pytest.approx(0.1, abs=0.05)


def following(offset_m: float = 0.0) -> MountedDetector:
    """A detector that has seen the edge at `offset_m` four times, crop being cut."""
    eye = detector("robust", MAST)
    for seed in range(4):
        eye.see(field(MAST, right_m=offset_m - 0.45, seed=seed))
    return eye


def test_an_edge_that_jumps_is_doubted_until_it_stays() -> None:
    eye, elsewhere = following(), field(MAST, right_m=-0.3)
    assert eye.see(elsewhere).confidence < 0.5
    views = [eye.see(elsewhere) for _ in range(TRACK)]
    assert views[-1].edge_offset_m == pytest.approx(0.15, abs=0.05)
    assert views[-1].confidence > 0.5


def test_an_edge_that_leaps_further_than_a_machine_can_is_believed_only_after_seconds() -> None:
    eye, elsewhere = following(), field(MAST, right_m=-0.05)
    views = [eye.see(elsewhere) for _ in range(BELIEVED + 2)]
    assert max(v.confidence for v in views[:BELIEVED]) < 0.5
    assert min(v.confidence for v in views[BELIEVED:]) > 0.5


def test_an_edge_that_appears_further_right_is_believed_as_soon_as_it_stays() -> None:
    """Dust hides the end of the crop and never shows more of it."""
    eye, outer = following(0.25), field(MAST, right_m=-0.55)
    views = [eye.see(outer) for _ in range(TRACK)]
    assert views[0].confidence < 0.5 < views[-1].confidence
    assert views[-1].edge_offset_m == pytest.approx(-0.1, abs=0.05)


def test_a_face_further_ahead_tells_nothing_of_the_edge_that_is_being_cut() -> None:
    eye = following()
    view = eye.see(field(MAST, face_x_m=1.5 + 1.7, next_crop_m=None))
    assert view.crop_ahead_m > 1.0
    assert view.confidence < 0.5


def test_no_track_begins_far_from_the_blades_end_while_crop_is_being_cut() -> None:
    eye, dust = detector("robust", MAST), field(MAST, right_m=-0.05)
    eye.see(field(MAST))
    for _ in range(5):
        assert eye.see(dust).confidence < 0.5
    assert eye.see(field(MAST)).confidence > 0.5


def test_an_edge_far_from_the_blades_end_is_believed_where_the_first_pictures_show_it() -> None:
    """Beside an edge that nobody has seen a turn ends outside of it; the blade's dust comes later
    (random field 10133)."""
    eye = detector("robust", MAST)
    for seed in range(4):
        assert eye.see(field(MAST, right_m=-0.1, seed=seed)).confidence >= 0.5


def test_out_of_the_crop_an_edge_far_from_the_blades_end_is_believed_at_once() -> None:
    """A machine that stands, its blade off, to see where it is: each picture begins anew."""
    eye = detector("robust", MAST)
    for seed in range(3):
        eye.restart()
        view = eye.see(field(MAST, right_m=-0.05, seed=seed))
        assert view.confidence >= 0.5
        assert view.edge_offset_m == pytest.approx(0.4, abs=0.05)


def test_an_end_is_no_whim_of_dust() -> None:
    """While cutting, one picture without crop says nothing yet; more where dust lies before it."""
    end = field(MAST, right_m=-2.99, face_x_m=30, next_crop_m=None)
    eye = following()
    views = [eye.see(end) for _ in range(CLEAR + 1)]
    assert all(v.crop_ahead_m > 1.0 for v in views)
    assert [v.ahead_confidence >= 0.5 for v in views] == [False] * CLEAR + [True]
    eye = following()
    veiled = end.copy()
    veiled[360:430, 270:370] = (150, 180, 200)
    views = [eye.see(veiled) for _ in range(CLEAR_VEILED + 1)]
    assert [v.ahead_confidence >= 0.5 for v in views] == [False] * CLEAR_VEILED + [True]


def test_a_restart_forgets_where_the_edge_was() -> None:
    eye = detector("robust", MAST)
    for seed in range(4):
        eye.see(field(MAST, seed=seed))
    eye.restart()
    elsewhere = field(MAST, right_m=-0.15)
    assert eye.see(elsewhere).confidence == detector("robust", MAST).see(elsewhere).confidence


def after_cutting(mount: Mount = LOW, *, turned: bool) -> MountedDetector:
    """Its blade was in the crop, and is out of it."""
    eye = detector("robust", mount)
    eye.see(field(mount))
    eye.restart(turned=turned)
    return eye


def faded(picture: NDArray[np.uint8], share: float) -> NDArray[np.uint8]:
    """All contrast below the horizon, but for a share of it, in the haze."""
    hazy = picture.astype(float)
    hazy[200:] = 140 + share * (hazy[200:] - 140)
    return hazy.astype(np.uint8)


def test_where_it_was_cut_fainter_stems_are_crop() -> None:
    """Until the machine has turned: then stubble before it must not be."""
    faint = faded(field(LOW, next_crop_m=None), 0.3)
    assert after_cutting(turned=False).see(faint).crop_ahead_m < 0.3
    assert after_cutting(turned=True).see(faint).crop_ahead_m > 0.8


def test_a_camera_above_the_tops_takes_no_fainter_stems_for_crop() -> None:
    """From there the crop's foot shows."""
    faint = faded(field(MAST, next_crop_m=None), 0.25)
    assert after_cutting(MAST, turned=False).see(faint).crop_ahead_m > 0.8


@pytest.mark.parametrize("lateral", [-0.3, 0.0, 0.3])
def test_the_last_stalks_before_the_blade_show_by_their_ears(lateral: float) -> None:
    """Their feet in the last of the dust; no crop beyond a gap reaches so high in the picture."""
    end = field(LOW, right_m=-2.99, face_x_m=30, next_crop_m=1.5 + 2.0)
    last, rng = end.copy(), np.random.default_rng(7)
    feet = np.column_stack([rng.uniform(2.0, 2.2, 30), rng.uniform(-0.1, 0.1, 30) + lateral])
    stems(last, Camera(LOW), feet, 1.0, rng)
    end, last = dusty(end, 215), dusty(last, 215)
    assert after_cutting(turned=False).see(end).crop_ahead_m > 0.8
    view = after_cutting(turned=False).see(last)
    assert view.crop_ahead_m == pytest.approx(0.5, abs=0.1)
    assert view.ahead_confidence >= 0.5
    assert after_cutting(turned=True).see(last).crop_ahead_m > 0.8


@pytest.mark.parametrize(("told_m", "pitch_deg"), [(0.9, 0.0), (0.74, 0.0), (0.8, -1.5)])
@pytest.mark.parametrize("gap_m", [1.5, 1.7, 2.0])
def test_what_the_file_errs_of_crop_and_mount_makes_no_ears_of_the_next_crop(
    told_m: float, pitch_deg: float, gap_m: float
) -> None:
    """0.9 m of crop, a camera that looks higher than it is told: how high the tops reach was seen
    while the crop was cut."""
    mount = LOW.model_copy(update={"pitch_deg": LOW.pitch_deg + pitch_deg})
    eye = make_detector("robust", Vehicle(crop_height_m=told_m), mount)
    for seed in range(TRACK + 1):
        eye.see(field(LOW, next_crop_m=None, seed=seed))
    eye.restart(turned=False)
    view = eye.see(field(LOW, right_m=-2.99, face_x_m=30, next_crop_m=1.5 + gap_m))
    assert view.ahead_confidence >= 0.5
    assert view.crop_ahead_m == pytest.approx(gap_m, abs=0.65)


@pytest.mark.parametrize("pitch_deg", [-2.0, 0.0, 2.0])
def test_how_far_the_next_crop_is_shows_by_its_height_however_the_camera_is_pitched(
    pitch_deg: float,
) -> None:
    """Once the field's own has been seen at the blade; the foot alone then errs by 0.6 m."""
    mount = LOW.model_copy(update={"pitch_deg": LOW.pitch_deg + pitch_deg})
    eye = make_detector("robust", Vehicle(crop_height_m=0.9), mount)
    next_one = field(LOW, right_m=-2.99, face_x_m=30, next_crop_m=1.5 + 1.7)
    assert math.isnan(eye.see(next_one).ahead_by_height_m)
    for seed in range(TRACK + 1):
        eye.see(field(LOW, next_crop_m=None, seed=seed))
    eye.restart(turned=False)
    assert eye.see(next_one).ahead_by_height_m == pytest.approx(1.7, abs=0.35)


@pytest.mark.parametrize("lodged", [False, True])
def test_crop_that_looks_too_high_for_where_its_foot_seems_to_be_is_no_clear_ground(
    lodged: bool,
) -> None:
    """Lodged stalks lie before its foot, which seems farther off (random field 10167)."""
    eye = make_detector("robust", Vehicle(crop_height_m=0.9), LOW)
    for seed in range(TRACK + 1):
        eye.see(field(LOW, next_crop_m=None, seed=seed))
    eye.restart(turned=False)
    picture = field(LOW, right_m=-2.99, face_x_m=30, next_crop_m=1.5 + 3.2).copy()
    if lodged:
        level_row = int(Camera(LOW).project([[1000.0, 0.0, 0.6]])[0, 1])
        near = field(LOW, right_m=-2.99, face_x_m=30, next_crop_m=1.5 + 0.5)
        picture[:level_row] = near[:level_row]
    view = eye.see(picture)
    assert view.crop_ahead_m > 2.0
    assert (view.ahead_confidence >= 0.5) is not lodged


def behind_lodged(ahead_m: float, right_m: float, hidden_m: float = 2.4) -> NDArray[np.uint8]:
    """Crop from LOW before whose foot stalks lie, of its colours, up to where it seems to stand
    hidden_m farther off."""
    camera, rng = Camera(LOW), np.random.default_rng(3)
    picture = field(LOW, right_m=right_m, face_x_m=1.5 + ahead_m, next_crop_m=None).copy()
    to_row = int(camera.project([[1.5 + ahead_m + hidden_m, 0.0, 0.0]])[0, 1])
    left = int(camera.project([[1.5 + ahead_m, right_m, 0.0]])[0, 0])
    picture[to_row:, :left] = (30, 45, 60)
    for _ in range(3000):
        u, v = rng.integers(0, max(1, left - 40)), rng.integers(to_row + 26, 504)
        colour = tuple(float(min(255, c * rng.uniform(0.35, 1.1))) for c in (90, 165, 205))
        cv2.line(picture, (int(u), int(v)), (int(u) + 35, int(v) - 25), colour, 1)
    return picture


@pytest.mark.parametrize("right_m", [-0.45, -0.15])
@pytest.mark.parametrize("told_m", [0.87, 0.9, 0.95])
def test_crop_that_is_to_be_met_stands_where_its_tops_show_it_if_stalks_lie_before_its_foot(
    right_m: float, told_m: float
) -> None:
    """Taken for as far off as its foot seemed, its edge was a third of a metre aside, and the blade
    stood still as it met the crop (field 10578)."""
    eye = make_detector("robust", Vehicle(crop_height_m=told_m), LOW)
    view = eye.see(behind_lodged(0.4, right_m))
    assert view.ahead_confidence >= 0.5
    assert view.crop_ahead_m == pytest.approx(0.4, abs=0.4)
    assert view.edge_offset_m == pytest.approx(right_m + 0.45, abs=0.2)


@pytest.mark.parametrize("told_m", [0.8, 1.0])
@pytest.mark.parametrize("ahead_m", [1.2, 1.8, 2.4])
def test_crop_that_is_to_be_met_stands_where_its_foot_shows_it_whatever_was_told_of_its_height(
    ahead_m: float, told_m: float
) -> None:
    """Though stalks lie up to there."""
    eye = make_detector("robust", Vehicle(crop_height_m=told_m), LOW)
    view = eye.see(behind_lodged(ahead_m, -0.45, hidden_m=0.0))
    assert view.crop_ahead_m == pytest.approx(ahead_m, abs=0.25)


def with_swath(picture: NDArray[np.uint8], ahead_m: float) -> NDArray[np.uint8]:
    """Straw that lies across the way of a machine with a mast, half a metre of it."""
    camera, rng, picture = Camera(MAST), np.random.default_rng(5), picture.copy()
    first = np.column_stack([1.5 + ahead_m + 0.45 * rng.random(9000), rng.uniform(-2, 2, 9000)])
    turned = rng.uniform(0, 2 * np.pi, 9000)
    second = first + 0.12 * np.column_stack([np.cos(turned), np.sin(turned)])
    ends = [camera.project(np.column_stack([xy, np.full(9000, 0.03)])) for xy in (first, second)]
    for one, other in zip(*(np.round(end).astype(int) for end in ends), strict=True):
        colour = tuple(float(c * rng.uniform(0.5, 1.15)) for c in (110, 175, 215))
        cv2.line(picture, tuple(one), tuple(other), colour, 1)
    return picture


@pytest.mark.parametrize("ahead_m", [0.0, 0.15, 0.3])
@pytest.mark.parametrize("gap_m", [1.6, 2.2])
@pytest.mark.parametrize("looks", [False, True])
def test_a_swath_before_a_mast_is_no_crop_at_the_blade(
    ahead_m: float, gap_m: float, looks: bool
) -> None:
    """Neither with the blade at work nor in a look without its dust: taken for crop, it led a
    machine out of its field at the end of a strip (field 10594)."""
    eye = detector("robust", MAST)
    eye.next_crop(gap_m)
    for seed in range(TRACK + 1):
        eye.see(field(MAST, next_crop_m=None, seed=seed))
    if looks:
        eye.restart(turned=False)
    bare = field(MAST, right_m=-2.99, face_x_m=30, next_crop_m=1.5 + gap_m)
    views = [eye.see(with_swath(bare, ahead_m)) for _ in range(CLEAR_VEILED + 1)]
    assert views[-1].ahead_confidence >= 0.5
    assert views[-1].crop_ahead_m == pytest.approx(gap_m, abs=0.3)


@pytest.mark.parametrize("height_m", [0.3, 0.4, 0.5])
@pytest.mark.parametrize("ahead_m", [0.0, 0.3])
def test_crop_that_is_much_lower_than_was_told_is_no_swath(ahead_m: float, height_m: float) -> None:
    """It is upright, though no more of it stands than a swath is wide."""
    picture = field(MAST, right_m=-2.99, face_x_m=30, next_crop_m=None).copy()
    rng = np.random.default_rng(0)
    feet = np.column_stack([1.5 + ahead_m + 0.2 * rng.random(4000), rng.uniform(-0.45, 3, 4000)])
    stems(picture, Camera(MAST), feet, height_m, rng)
    view = make_detector("robust", Vehicle(crop_height_m=0.9), MAST).see(picture)
    assert view.ahead_confidence >= 0.5
    assert view.crop_ahead_m == pytest.approx(ahead_m, abs=0.25)


@pytest.mark.parametrize("ahead_m", [0.0, 0.3])
def test_crop_right_behind_a_swath_is_not_looked_past(ahead_m: float) -> None:
    eye = detector("robust", MAST)
    picture = field(MAST, face_x_m=1.5 + ahead_m + 0.45, next_crop_m=None)
    view = eye.see(with_swath(picture, ahead_m))
    assert view.ahead_confidence >= 0.5
    assert view.crop_ahead_m < ahead_m + 0.45 + 0.1


@pytest.mark.parametrize("height_m", [1.2, 1.5, 2.0])
@pytest.mark.parametrize("gap_m", [2.0, 3.0])
def test_taller_crop_beyond_a_bare_gap_stands_where_its_foot_is(
    height_m: float, gap_m: float
) -> None:
    """The neighbour grows maize: taken for the field's own by its height, it stood at the blade."""
    picture = field(LOW, right_m=-2.99, face_x_m=30, next_crop_m=None).copy()
    rng = np.random.default_rng(0)
    feet = np.column_stack([1.5 + gap_m + 0.3 * rng.random(3000), rng.uniform(-8, 8, 3000)])
    stems(picture, Camera(LOW), feet, height_m, rng)
    eye = make_detector("robust", Vehicle(crop_height_m=0.9), LOW)
    assert eye.see(picture).crop_ahead_m == pytest.approx(gap_m, abs=0.25)


@pytest.mark.parametrize(("tops_m", "clear"), [(0.8, False), (2.8, True)])
def test_crop_that_stands_far_by_how_high_it_looks_too_leaves_the_ground_clear(
    tops_m: float, clear: bool
) -> None:
    """However far its foot seems: the machine stood for a minute before crop 4 m away, whose foot
    seemed to be much farther (random field 10203)."""
    eye = make_detector("robust", Vehicle(crop_height_m=0.9), LOW)
    for seed in range(TRACK + 1):
        eye.see(field(LOW, next_crop_m=None, seed=seed))
    eye.restart(turned=False)
    picture = field(LOW, right_m=-2.99, face_x_m=30, next_crop_m=1.5 + 10.0).copy()
    level_row = int(Camera(LOW).project([[1000.0, 0.0, 0.6]])[0, 1])
    tops = field(LOW, right_m=-2.99, face_x_m=30, next_crop_m=1.5 + tops_m)
    picture[:level_row] = tops[:level_row]
    view = eye.see(picture)
    assert view.crop_ahead_m > 4.0
    assert (view.ahead_confidence >= 0.5) is clear


def test_crop_does_not_recede_before_a_machine_that_follows_it() -> None:
    near = field(LOW, face_x_m=1.5 + 0.5, next_crop_m=None)
    hidden = dusty(near, 225)
    assert by_its_foot().see(hidden).crop_ahead_m > 0.9
    eye = detector("robust", LOW)
    eye.see(near)
    assert eye.see(hidden).crop_ahead_m == pytest.approx(0.5, abs=0.15)


@pytest.mark.parametrize("mount", MOUNTS.values(), ids=MOUNTS)
def test_crop_that_comes_nearer_is_believed_and_crop_that_comes_and_goes_is_not(
    mount: Mount,
) -> None:
    """Blur and glare hide a foot now here and now there; a machine only comes nearer."""

    def seen(places_m: list[float]) -> list[CropView]:
        eye = detector("robust", mount)
        faces = {m: field(mount, face_x_m=1.5 + m, next_crop_m=None) for m in places_m}
        return [eye.see(faces[m]) for m in places_m]

    steady = seen([1.5, 1.4, 1.3, 1.2, 1.1, 1.0])
    assert min(v.confidence for v in steady) >= 0.5
    fickle = seen([1.2, 1.8, 1.0, 1.8, 1.2, 1.8, 1.0])
    assert max(v.confidence for v in fickle[4:]) < 0.5
    assert max(v.ahead_confidence for v in fickle[4:]) < 0.5
    assert "come and go" in fickle[-1].reason


def test_a_crop_that_came_and_went_is_believed_at_the_blade() -> None:
    eye = detector("robust", MAST)
    for ahead in (1.2, 1.8, 1.0, 1.8, 1.2, 1.8):
        eye.see(field(MAST, face_x_m=1.5 + ahead, next_crop_m=None))
    assert eye.see(field(MAST)).confidence >= 0.5


@pytest.mark.parametrize("mount", MOUNTS.values(), ids=MOUNTS)
@pytest.mark.parametrize("times", [0.5, 1.5, 3.0])
def test_a_picture_of_another_size_shows_the_same_edge(mount: Mount, times: float) -> None:
    """Larger and smaller ones of the same view, whose pixels come back as they were given."""
    usual = field(mount, right_m=-0.35)
    size = (round(640 * times), round(480 * times))
    other = mount.model_copy(update={"width_px": size[0], "height_px": size[1]})
    picture = np.asarray(cv2.resize(usual, size, interpolation=cv2.INTER_AREA), np.uint8)
    view, plain = detector("robust", other).see(picture), detector("robust", mount).see(usual)
    assert view.confidence >= 0.5
    assert view.edge_offset_m == pytest.approx(0.1, abs=0.05)
    assert view.crop_ahead_m == pytest.approx(plain.crop_ahead_m, abs=0.1)
    assert view.standing is not None
    assert view.standing.shape == picture.shape[:2]
    assert view.e_outer_px == pytest.approx(times * plain.e_outer_px, abs=12 * times)


def test_an_upright_picture_of_the_same_phone_is_taken_as_it_is() -> None:
    upright = LOW.model_copy(update={"width_px": 480, "height_px": 640, "hfov_deg": 48.5})
    assert scale_of(upright).mount is upright
    large = LOW.model_copy(update={"width_px": 1080, "height_px": 1920, "hfov_deg": 37.4})
    assert scale_of(large).mount.width_px == pytest.approx(360, abs=5)
    assert scale_of(large).mount.focal == pytest.approx(532, abs=4)


def test_the_next_crop_is_no_dust_though_a_nodding_machine_sees_it_near() -> None:
    eye = detector("robust", LOW)
    eye.see(field(LOW, next_crop_m=None))
    end = field(LOW, right_m=-2.99, face_x_m=30, next_crop_m=1.5 + 1.4)
    assert eye.see(end).crop_ahead_m > 0.8


@pytest.mark.parametrize("mount", [LOW, MAST])
@pytest.mark.parametrize("gap_m", [0.9, 1.2, 1.9])
@pytest.mark.parametrize("said_m", [None, 0.9, 2.0])
def test_the_next_crop_behind_a_narrow_gap_is_no_dust_whatever_was_said_of_it(
    mount: Mount, gap_m: float, said_m: float | None
) -> None:
    """With 2 m taken for granted, crop behind a gap of 1 m stood at the blade, 0.95 sure, for as
    long as the machine would have driven on."""
    eye = detector("robust", mount)
    if said_m is not None:
        eye.next_crop(said_m)
    for seed in range(4):
        eye.see(field(mount, next_crop_m=1.5 + 1.0 + gap_m, seed=seed))
    end = [
        eye.see(field(mount, right_m=-2.99, face_x_m=30, next_crop_m=1.5 + gap_m, seed=seed))
        for seed in range(4)
    ][-1]
    assert end.crop_ahead_m == pytest.approx(gap_m, abs=0.1)
    assert end.ahead_confidence > 0.8


def test_no_gap_that_is_told_makes_the_crop_at_the_blade_another_fields() -> None:
    """A turn may have been left hardly any room: so narrow is no gap between two fields."""
    eye = detector("robust", LOW)
    eye.next_crop(0.0)
    view = eye.see(field(LOW, next_crop_m=None))
    assert view.confidence > 0.8
    assert view.edge_offset_m == pytest.approx(0.0, abs=0.08)


def test_the_references_outlive_a_restart() -> None:
    eye = detector("paper", LOW)
    reference = eye.see(field(LOW)).l_reference_px
    eye.restart()
    assert eye.see(field(LOW, right_m=-0.3, seed=3)).l_reference_px == reference


def test_the_same_pictures_give_the_same_views() -> None:
    picture = field(MAST)
    a, b = (detector("robust", MAST).see(picture) for _ in range(2))
    assert (a.edge_offset_m, a.confidence, a.crop_ahead_m) == (
        b.edge_offset_m,
        b.confidence,
        b.crop_ahead_m,
    )


def test_four_fifths_of_the_crop_pixels_lie_below_l_height() -> None:
    upright = np.zeros((100, 10), np.uint8)
    upright[50:] = 255
    assert l_height(upright) == pytest.approx(60, abs=1)
    assert math.isnan(l_height(np.zeros((100, 10), np.uint8)))


@pytest.mark.parametrize("mode", MODES)
def test_the_stages_are_there_when_asked_for(mode: Mode) -> None:
    eye, picture = detector(mode, LOW), field(LOW)
    assert not eye.see(picture).stages
    stages = eye.see(picture, stages=True).stages
    assert set(stages) >= ({"SY", "TSY", "VTSY"} if mode == "paper" else {"steps", "stems"})
    assert all(p.shape == picture.shape and p.dtype == np.uint8 for p in stages.values())


def test_only_the_left_side_drives() -> None:
    with pytest.raises(ValueError, match="left"):
        make_detector("robust", Vehicle(), LOW, side="right")  # type: ignore[arg-type]


def behind_a_puff(middle: int) -> NDArray[np.uint8]:
    """Crop from a mast, and dust that hides its face from top to bottom around a column."""
    picture = field(MAST, right_m=-0.45).astype(np.float64)
    column = np.abs(np.arange(picture.shape[1]) - middle)
    hides = 0.95 * np.clip((75.0 - column) / 25.0, 0.0, 1.0)[None, :, None]
    return np.asarray((1 - hides) * picture + hides * 200.0, np.uint8)


@pytest.mark.parametrize("middle", [320, 350, 380])
def test_a_face_that_goes_on_behind_dust_has_no_end_there_however_long_it_lies(middle: int) -> None:
    eye = detector("robust", MAST)
    assert eye.see(field(MAST, right_m=-0.45)).confidence >= 0.5
    hidden = behind_a_puff(middle)
    for _ in range(BELIEVED + 5):
        view = eye.see(hidden)
        assert view.confidence < 0.5 or abs(view.edge_offset_m) < 0.05


def test_crop_that_reaches_the_pictures_border_has_no_right_end() -> None:
    """The picture ends 0.84 m right of the middle at the blade."""
    assert detector("robust", LOW).see(field(LOW, right_m=-0.75)).confidence > 0.5
    assert detector("robust", LOW).see(field(LOW, right_m=-0.84)).confidence == 0.0
