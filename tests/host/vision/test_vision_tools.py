"""Profiles, tuning, calibration and the commands around the detectors."""

from __future__ import annotations

import datetime
import json
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from host.commands.bench_vision import bench_vision
from host.commands.calibrate_camera import calibrate_camera
from host.commands.see import see
from host.commands.tune_confidence import tune_confidence
from host.commands.tune_vision import tune_vision
from host.core.errors import UserError
from host.core.vehicle import LOW, Mount, Vehicle
from host.core.vehicle_file import load_vehicle
from host.runs.pictures import frames
from host.runs.record import Recorder
from host.tune.checkerboard import Board, Lens, calibrate_lens, calibrate_mount, corners
from host.vision.geometry import Camera
from host.vision.mounted.detector import MountedDetector, make_detector
from host.vision.mounted.paper import PaperParams
from host.vision.pictures import read_photo, to_bgr
from host.vision.tuning.profiles import Circumstance, Profiles
from host.vision.tuning.search import first_params, mounted_contrast, tune
from tests.helpers.scenery import field, halves

NOW = datetime.datetime(2026, 4, 28, 9, tzinfo=datetime.UTC)
RIPE = PaperParams(phi1_deg=25, phi2_deg=60)


# ---- profiles ------------------------------------------------------------------------------------


def test_the_nearest_profile_is_of_the_nearest_hour_on_the_same_mount(tmp_path: Path) -> None:
    with Profiles(tmp_path / "p.sqlite") as profiles:
        assert profiles.nearest(Circumstance(9)) is None
        profiles.save(Circumstance(9, mount="mast"), PaperParams(), 0.9, NOW)
        profiles.save(Circumstance(12), RIPE, 0.5, NOW)
        profiles.save(Circumstance(16), PaperParams(gap_px=4), 0.5, NOW)
        near = profiles.nearest(Circumstance(10))
        assert near is not None
        assert near.params == RIPE


def test_of_equal_profiles_the_one_of_better_contrast_is_chosen(tmp_path: Path) -> None:
    with Profiles(tmp_path / "p.sqlite") as profiles:
        profiles.save(Circumstance(9), RIPE, 0.8, NOW)
        profiles.save(Circumstance(9), PaperParams(), 0.3, NOW)
    with Profiles(tmp_path / "p.sqlite") as again:
        near = again.nearest(Circumstance(9))
        assert near is not None
        assert (near.params, near.contrast) == (RIPE, 0.8)


def test_a_file_that_is_no_database_gives_one_clear_message(tmp_path: Path) -> None:
    path = tmp_path / "p.sqlite"
    path.write_bytes(b"not a database, but long enough to be looked at" * 40)
    with pytest.raises(UserError, match=r"not a database of profiles.*--db"):
        Profiles(path)


def test_what_tells_nothing_apart_is_no_profile(tmp_path: Path) -> None:
    with Profiles(tmp_path / "p.sqlite") as profiles:
        for contrast in (0.0, 0.09, float("nan")):
            with pytest.raises(UserError, match="nothing was saved"):
                profiles.save(Circumstance(9), RIPE, contrast, NOW)
        assert list(profiles.all()) == []


CIRCUMSTANCES = st.builds(
    Circumstance, st.floats(0, 24), st.sampled_from("ab"), st.sampled_from("ab")
)


@given(CIRCUMSTANCES, CIRCUMSTANCES)
def test_distance_is_symmetric_and_zero_only_for_the_same(a: Circumstance, b: Circumstance) -> None:
    assert a.distance(b) == b.distance(a) >= 0
    assert (a.distance(b) == 0) == (a == b)


def test_the_tuner_repairs_parameters_that_see_nothing() -> None:
    blind = PaperParams(phi1_deg=0, phi2_deg=20)
    vehicle = Vehicle()
    contrast = mounted_contrast(
        [field(LOW)], lambda params: make_detector("paper", vehicle, LOW, params=params)
    )
    params, reached = tune(contrast, blind, rounds=1)
    assert contrast(blind) < 0.5 <= reached == contrast(params)


def low_detector(params: PaperParams) -> MountedDetector:
    return make_detector("paper", Vehicle(), LOW, params=params)


def test_a_drive_starts_with_the_nearest_profile_where_it_shows_the_crop(tmp_path: Path) -> None:
    db = tmp_path / "p.sqlite"
    fitting = PaperParams(phi1_deg=25)
    with Profiles(db) as profiles:
        profiles.save(Circumstance(9), fitting, 0.9, NOW)
        profiles.save(Circumstance(16), PaperParams(phi2_deg=48), 0.9, NOW)
    params, said = first_params(db, Circumstance(10), field(LOW), low_detector)
    assert params == fitting
    assert "09.0 h" in said


def test_a_drive_tunes_a_profile_that_shows_nothing_on_the_first_picture(tmp_path: Path) -> None:
    db = tmp_path / "p.sqlite"
    blind = PaperParams(phi1_deg=0, phi2_deg=20)
    with Profiles(db) as profiles:
        profiles.save(Circumstance(9), blind, 0.9, NOW)
    params, said = first_params(db, Circumstance(9), field(LOW), low_detector)
    assert params != blind
    assert low_detector(params).see(field(LOW)).confidence >= 0.5
    assert "tuned on the first picture" in said


def test_a_drive_without_a_database_makes_none(tmp_path: Path) -> None:
    db = tmp_path / "p.sqlite"
    params, said = first_params(db, Circumstance(9), field(LOW), low_detector)
    assert params == PaperParams()
    assert "built-in" in said
    assert not db.exists()


# ---- checkerboard --------------------------------------------------------------------------------

BOARD = Board(9, 6, 0.05)
LENS = Lens((640, 480), 532.6, (322.0, 238.0), (-0.06, 0.01, 0.0, 0.0, 0.0), 0.0)
TRUE = Mount(
    x_m=0.05,
    y_m=0.02,
    z_m=1.5,
    pitch_deg=27.0,
    yaw_deg=1.5,
    roll_deg=-2.0,
    focal_px=LENS.focal_px,
    centre_px=LENS.centre_px,
    distortion=LENS.distortion,
)


def on_ground(mount: Mount, ahead_m: float) -> NDArray[np.float32]:
    """The board's corners as a camera at `mount` sees them."""
    flat = BOARD.points()[:, :2].astype(np.float64)
    middle = flat.mean(0)
    ground = np.column_stack(
        [ahead_m - (flat[:, 1] - middle[1]), -(flat[:, 0] - middle[0]), np.zeros(len(flat))]
    )
    return Camera(mount).project(ground).astype(np.float32)


@pytest.mark.parametrize("turned", [False, True])
def test_the_mount_is_found_from_a_board_on_the_ground(turned: bool) -> None:
    seen = on_ground(TRUE, 2.0)
    found = calibrate_mount(seen[::-1] if turned else seen, LENS, BOARD, 2.0)
    assert (found.x_m, found.y_m, found.z_m) == pytest.approx((0.05, 0.02, 1.5), abs=0.005)
    angles = (found.pitch_deg, found.yaw_deg, found.roll_deg)
    assert angles == pytest.approx((27.0, 1.5, -2.0), abs=0.2)


def test_a_square_in_other_units_is_said_and_no_camera_in_the_sky() -> None:
    squares_10_times_too_large = Board(BOARD.columns, BOARD.rows, 10 * BOARD.square_m)
    with pytest.raises(UserError, match=r"1\d\.\d\d m above the ground.*--square"):
        calibrate_mount(on_ground(TRUE, 2.0), LENS, squares_10_times_too_large, 2.0)


@pytest.mark.parametrize("value", ["nan", "inf", "2000"])
@pytest.mark.parametrize("option", ["--ahead", "--left"])
def test_a_board_on_the_ground_lies_somewhere(photo: Path, option: str, value: str) -> None:
    result = run(calibrate_camera, photo, option, value)
    assert (result.exit_code, option in result.output) == (2, True)


def printed(turn: tuple[float, float, float]) -> NDArray[np.uint8]:
    """A picture of the board held before the camera, turned about its middle (radians)."""
    square = 40
    paper = np.full(((BOARD.rows + 3) * square, (BOARD.columns + 3) * square), 255, np.uint8)
    for i in range(BOARD.rows + 1):
        for j in range(BOARD.columns + 1):
            if (i + j) % 2:
                paper[(i + 1) * square : (i + 2) * square, (j + 1) * square : (j + 2) * square] = 0
    h, w = paper.shape
    px = np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float32)
    metres = (px - [w / 2, h / 2]) * BOARD.square_m / square
    rotation, _ = cv2.Rodrigues(np.array(turn))
    eye = np.column_stack([metres, np.zeros(4)]) @ rotation.T + [0, 0, 0.75]
    seen = (eye[:, :2] / eye[:, 2:] * LENS.focal_px + LENS.centre_px).astype(np.float32)
    flat = cv2.warpPerspective(
        paper, cv2.getPerspectiveTransform(px, seen), (640, 480), borderValue=200
    )
    return to_bgr(np.asarray(cv2.GaussianBlur(flat, (0, 0), 0.7), np.uint8))


TURNS = [(0.5, 0.1, 0.0), (-0.5, 0.2, 0.1), (0.1, 0.6, -0.1), (0.2, -0.6, 0.0), (0.4, 0.4, 0.3),
         (-0.4, -0.3, 0.2)]  # fmt: skip


def test_the_lens_is_found_from_printed_boards() -> None:
    seen = [corners(printed(turn), BOARD) for turn in TURNS]
    lens = calibrate_lens([s for s in seen if s is not None], (640, 480), BOARD)
    assert lens.focal_px == pytest.approx(LENS.focal_px, rel=0.02)
    assert lens.error_px < 0.5


def test_a_board_whose_rows_are_a_few_pixels_high_is_found() -> None:
    """As it lies on the ground before a low camera: 40 by 6 pixels a square."""
    square, wide, high = 80, 40, 6
    table = np.indices((BOARD.rows + 5, BOARD.columns + 5)).sum(0) % 2
    inside = np.pad(table[2:-2, 2:-2], 2, constant_values=1)
    large = np.kron(inside, np.ones((square, square))) * 190 + 30
    size = ((BOARD.columns + 5) * wide, (BOARD.rows + 5) * high)
    small = cv2.resize(large.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    picture = np.full((480, 640), 120.0, np.float32)
    picture[200 : 200 + size[1], 20 : 20 + size[0]] = small
    seen = corners(np.repeat(picture.astype(np.uint8)[..., None], 3, axis=2), BOARD)
    assert seen is not None
    across, down = np.meshgrid(np.arange(BOARD.columns), np.arange(BOARD.rows))
    true = np.stack([20 + wide * (3 + across) - 0.5, 200 + high * (3 + down) - 0.5], axis=-1)
    found = np.sort(seen.reshape(-1, 2), axis=0)
    assert np.abs(found - np.sort(true.reshape(-1, 2), axis=0)).max() < 0.3


def test_too_few_boards_say_how_many_are_needed() -> None:
    with pytest.raises(UserError, match="2 pictures, 5 are needed"):
        calibrate_lens([on_ground(TRUE, 2.0)] * 2, (640, 480), BOARD)


# ---- commands ------------------------------------------------------------------------------------


def run(command: object, *args: str | Path) -> Result:
    return CliRunner().invoke(command, [str(a) for a in args])  # type: ignore[arg-type]


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    path = tmp_path / "wheat.jpg"
    cv2.imwrite(str(path), field(LOW))
    return path


@pytest.mark.parametrize("mode", ["robust", "paper"])
def test_see_writes_mask_edge_and_stages(photo: Path, tmp_path: Path, mode: str) -> None:
    out = tmp_path / "out"
    result = run(see, photo, "--mode", mode, "--side", "left", "--out", out, "--stages")
    assert result.exit_code == 0, result.output
    mask = cv2.imread(str(out / "wheat.mask.png"), cv2.IMREAD_UNCHANGED)
    assert mask is not None
    assert mask.shape == (480, 640)
    assert set(np.unique(mask)) <= {0, 255}
    record = json.loads((out / "wheat.json").read_text())
    assert set(record) == {"edge_px", "heading_deg", "confidence", "reason", "ms"}
    assert 0 <= record["confidence"] <= 1
    assert (out / "wheat.stages.png").exists()


def test_see_does_not_guess_on_which_side_the_crop_stands(photo: Path, tmp_path: Path) -> None:
    result = run(see, photo, "--out", tmp_path / "out")
    assert isinstance(result.exception, UserError)
    assert "--side" in str(result.exception)
    assert not (tmp_path / "out").exists()


def test_see_takes_the_side_from_a_manifest(photo: Path, tmp_path: Path) -> None:
    cv2.imwrite(str(photo), halves("right")[0])
    manifest = tmp_path / "manifest.csv"
    manifest.write_text("file,standing_side\nwheat,right\n")
    out = tmp_path / "out"
    assert run(see, photo, "--manifest", manifest, "--out", out).exit_code == 0
    mask = cv2.imread(str(out / "wheat.mask.png"), cv2.IMREAD_UNCHANGED)
    assert mask is not None
    assert mask[150, 5] == 255
    assert mask[150, -5] == 0


def test_two_photographs_of_one_name_do_not_write_over_each_other(
    photo: Path, tmp_path: Path
) -> None:
    (other := tmp_path / "yesterday").mkdir()
    cv2.imwrite(str(other / photo.name), halves("left")[0])
    out = tmp_path / "out"
    result = run(see, photo, other, "--side", "left", "--out", out, "--no-stages")
    assert result.exit_code == 0, result.output
    both = [np.array(cv2.imread(str(out / f"{name}.mask.png"))) for name in ("wheat", "wheat-2")]
    assert both[0].shape != both[1].shape or (both[0] != both[1]).any()
    assert "wheat-2: confidence" in result.output


def test_one_unreadable_photo_is_named_and_the_others_are_done(photo: Path, tmp_path: Path) -> None:
    torn = tmp_path / "torn.jpg"
    torn.write_bytes(photo.read_bytes()[:200])
    out = tmp_path / "out"
    result = run(see, torn, photo, "--side", "left", "--out", out)
    assert isinstance(result.exception, UserError)
    assert "torn.jpg" in result.output
    assert (out / "wheat.json").exists()


@pytest.mark.parametrize("given", ["IMG_0001.HEIC", "."])
def test_a_phones_heic_is_named_and_not_passed_over(
    photo: Path, tmp_path: Path, given: str
) -> None:
    (photo.parent / "IMG_0001.HEIC").write_bytes(b"\0\0\0\x18ftypheic" + bytes(100))
    result = run(see, photo.parent / given, "--side", "left", "--out", tmp_path / "out")
    assert isinstance(result.exception, UserError)
    assert "IMG_0001.HEIC: not a picture that can be decoded; give a whole JPEG" in result.output
    assert (tmp_path / "out" / "wheat.json").exists() == (given == ".")


@pytest.mark.parametrize("share", [0.05, 0.5, 0.9, 0.99])
def test_a_truncated_photograph_is_refused(tmp_path: Path, share: float) -> None:
    whole = cv2.imencode(".jpg", halves("left")[0])[1].tobytes()
    path = tmp_path / "torn.jpg"
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(UserError, match="give a whole JPEG"):
        read_photo(path)


@pytest.mark.parametrize(
    ("content", "says"),
    [(b"", "not a picture"), (b"GIF89a nonsense", "not a picture")],
)
def test_what_is_no_picture_gives_one_clear_message(
    tmp_path: Path, content: bytes, says: str
) -> None:
    path = tmp_path / "x.jpg"
    path.write_bytes(content)
    with pytest.raises(UserError, match=says):
        read_photo(path)


def test_a_manifest_without_its_columns_is_refused(photo: Path, tmp_path: Path) -> None:
    manifest = tmp_path / "m.csv"
    manifest.write_text("name,side\nwheat,left\n")
    result = run(see, photo, "--manifest", manifest, "--out", tmp_path)
    assert isinstance(result.exception, UserError)
    assert "line 2" in str(result.exception)


@pytest.mark.parametrize(
    "content", [b"file,standing_side\n" + b"x" * 200_000 + b",left\n", b"\xe9,left\n"]
)
def test_a_manifest_that_is_no_table_is_refused(
    photo: Path, tmp_path: Path, content: bytes
) -> None:
    (manifest := tmp_path / "manifest.csv").write_bytes(content)
    for result in (
        run(see, photo, "--manifest", manifest, "--out", tmp_path / "out"),
        run(bench_vision, "--data", tmp_path, "--out", tmp_path / "out"),
    ):
        assert isinstance(result.exception, UserError)
        assert str(manifest) in str(result.exception)


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ("", "0 photographs of 0 scenes"),
        ("a,3,left,0.9,ok\nb,3,left,0.9,ok\n", "2 photographs of 1 scenes"),
        ("a,field,left,0.9,ok\n", "line 2 is not a labelled photograph"),
        ("a,3,left\n", "line 2 is not a labelled photograph"),
    ],
)
@pytest.mark.parametrize("command", [bench_vision, tune_confidence])
def test_labels_that_teach_nothing_are_refused(
    tmp_path: Path, command: object, rows: str, says: str
) -> None:
    (tmp_path / "manifest.csv").write_text(
        f"file,scene,standing_side,single_transition_rows,label\n{rows}"
    )
    result = run(command, "--data", tmp_path, "--out", tmp_path / "out")
    assert isinstance(result.exception, UserError)
    assert says in str(result.exception)


def turned(jpeg: bytes, orientation: int) -> bytes:
    """A JPEG with the EXIF orientation tag (0x0112, of TIFF 6.0 in an APP1 segment)."""
    entry = struct.pack(">HHIHH", 0x0112, 3, 1, orientation, 0)
    exif = b"Exif\0\0MM\0*" + struct.pack(">IH", 8, 1) + entry + bytes(4)
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + jpeg[2:]


@pytest.mark.parametrize(
    ("orientation", "stored"),
    [
        (1, None),
        (3, cv2.ROTATE_180),
        (6, cv2.ROTATE_90_COUNTERCLOCKWISE),
        (8, cv2.ROTATE_90_CLOCKWISE),
    ],
)
def test_a_photograph_stands_as_the_phone_was_held(
    tmp_path: Path, orientation: int, stored: int | None
) -> None:
    shown = halves("left")[0]
    sensor = shown if stored is None else cv2.rotate(shown, stored)
    path = tmp_path / "portrait.jpg"
    path.write_bytes(turned(cv2.imencode(".jpg", sensor)[1].tobytes(), orientation))
    read = read_photo(path)
    assert read.shape == shown.shape
    assert np.abs(read.astype(int) - shown.astype(int)).mean() < 3


def test_a_photograph_of_16_bits_is_as_bright_as_of_8(tmp_path: Path) -> None:
    shown = halves("left")[0]
    path = tmp_path / "deep.png"
    path.write_bytes(cv2.imencode(".png", shown.astype(np.uint16) * 257)[1].tobytes())
    assert np.array_equal(read_photo(path), shown)


@pytest.mark.parametrize("shape", [(20, 20), (20, 20, 1), (20, 20, 3), (20, 20, 4)])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_every_decoded_picture_becomes_8_bit_colour(
    shape: tuple[int, ...], kind: type[np.generic]
) -> None:
    bgr = to_bgr(np.ones(shape, kind))
    assert bgr.shape == (20, 20, 3)
    assert bgr.dtype == np.uint8


def test_tune_vision_saves_what_it_found_and_shows_before_and_after(
    photo: Path, tmp_path: Path
) -> None:
    db, out = tmp_path / "p.sqlite", tmp_path / "out"
    result = run(tune_vision, photo, "--mount", "low", "--hour", "9", "--db", db, "--out", out)
    assert result.exit_code == 0, result.output
    with Profiles(db) as profiles:
        (saved,) = profiles.all()
    assert saved.circumstance == Circumstance(9.0)
    assert saved.contrast >= 0.5
    assert {p.name for p in out.iterdir()} == {"wheat.before.png", "wheat.after.png"}


def test_tune_vision_on_black_masks_saves_nothing(tmp_path: Path) -> None:
    path, db = tmp_path / "mask.png", tmp_path / "p.sqlite"
    cv2.imwrite(str(path), np.zeros((60, 80, 3), np.uint8))
    args = ("--side", "left", "--db", db, "--out", tmp_path / "out")
    result = run(tune_vision, path, *args)
    assert isinstance(result.exception, UserError)
    assert "nothing was saved" in str(result.exception)
    with Profiles(db) as profiles:
        assert list(profiles.all()) == []


def recorded(
    path: Path, pictures: list[NDArray[np.uint8]], about: dict[str, str] | None = None
) -> None:
    with Recorder(path, about) as recorder:
        for number, bgr in enumerate(pictures):
            recorder.picture(0.1 * number, cv2.imencode(".jpg", bgr)[1].tobytes())


def test_tune_vision_takes_the_pictures_of_a_record(tmp_path: Path) -> None:
    recorded(tmp_path / "drive.mcap", [field(LOW), field(LOW, seed=2)])
    db, out = tmp_path / "p.sqlite", tmp_path / "out"
    args = ("--mount", "low", "--hour", "9", "--pictures", "1", "--db", db, "--out", out)
    result = run(tune_vision, tmp_path / "drive.mcap", *args)
    assert result.exit_code == 0, result.output
    names = {p.name for p in out.iterdir()}
    assert names == {"drive-00000.00.before.png", "drive-00000.00.after.png"}


def test_see_shows_a_record_to_the_detector_that_drove(tmp_path: Path) -> None:
    """The right ends that the mounted detector finds are not what a photograph's would be."""
    about = {"vehicle": Vehicle().model_dump_json(), "mount": "low", "mode": "robust"}
    recorded(tmp_path / "drive.mcap", [field(LOW), field(LOW)], about)
    result = run(see, tmp_path / "drive.mcap", "--out", tmp_path / "out", "--no-stages")
    assert result.exit_code == 0, result.output
    seen = json.loads((tmp_path / "out" / "drive-00000.10.json").read_text())
    driver = make_detector("robust", Vehicle(), LOW)
    coded = [cv2.imencode(".jpg", field(LOW))[1]] * 2
    views = [driver.see(np.asarray(cv2.imdecode(c, cv2.IMREAD_COLOR), np.uint8)) for c in coded]
    assert views[-1].confidence >= 0.5
    assert seen["confidence"] == pytest.approx(views[-1].confidence, abs=1e-3)


def test_see_refuses_a_record_of_an_unknown_vehicle(tmp_path: Path) -> None:
    recorded(tmp_path / "drive.mcap", [field(LOW)])
    result = run(see, tmp_path / "drive.mcap", "--out", tmp_path / "out")
    assert isinstance(result.exception, UserError)
    assert "vehicle" in str(result.exception)


def test_a_record_without_pictures_says_so(tmp_path: Path) -> None:
    recorded(tmp_path / "drive.mcap", [])
    with pytest.raises(UserError, match="keeps no pictures"):
        list(frames(str(tmp_path / "drive.mcap")))


def test_tune_vision_refuses_pictures_of_another_size_for_a_mount(tmp_path: Path) -> None:
    path = tmp_path / "small.jpg"
    cv2.imwrite(str(path), np.zeros((100, 100, 3), np.uint8))
    result = run(tune_vision, path, "--mount", "low", "--db", tmp_path / "p.sqlite")
    assert isinstance(result.exception, UserError)
    assert "100x100" in str(result.exception)


def test_calibrate_camera_writes_a_lens_for_the_vehicle_file(tmp_path: Path) -> None:
    for number, turn in enumerate(TURNS):
        cv2.imwrite(str(tmp_path / f"board{number}.png"), printed(turn))
    out = tmp_path / "mount.yaml"
    result = run(calibrate_camera, tmp_path, "--square", "0.05", "--out", out)
    assert result.exit_code == 0, result.output
    assert "focal_px" in out.read_text()


@pytest.mark.parametrize("there", [False, True])
def test_calibrate_camera_writes_the_mount_into_the_machines_file(
    tmp_path: Path, there: bool
) -> None:
    boards = tmp_path / "board"
    boards.mkdir()
    for number, turn in enumerate(TURNS):
        cv2.imwrite(str(boards / f"{number}.png"), printed(turn))
    path = tmp_path / "machine.yaml"
    if there:
        path.write_text("wheelbase_m: 1.07\n")
    before = load_vehicle(path if there else None)
    result = run(calibrate_camera, boards, "--square", "0.05", "--vehicle", path, "--mount", "low")
    assert result.exit_code == 0, result.output
    after = load_vehicle(path)
    assert after.mounts["low"].focal_px == pytest.approx(LENS.focal_px, rel=0.02)
    assert after.mounts["low"].z_m == before.mounts["low"].z_m
    assert "still said to be 0.6 m high" in result.output
    assert after.mounts["mast"] == before.mounts["mast"]
    assert after.model_copy(update={"mounts": {}}) == before.model_copy(update={"mounts": {}})


def test_calibrate_camera_names_the_mounts_before_it_looks_at_pictures(tmp_path: Path) -> None:
    result = run(calibrate_camera, tmp_path, "--vehicle", tmp_path / "m.yaml", "--mount", "roof")
    assert isinstance(result.exception, UserError)
    assert "it has low, mast" in str(result.exception)


def test_a_damaged_picture_of_a_record_is_left_out_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    jpeg = cv2.imencode(".jpg", field(LOW))[1].tobytes()
    with Recorder(path, {}) as recorder:
        for number, data in enumerate([jpeg, jpeg[:4000], jpeg]):
            recorder.picture(0.1 * number, data)
    found = frames(str(path))
    assert [next(found)[0], next(found)[0]] == ["drive-00000.00", "drive-00000.20"]
    with pytest.raises(UserError, match="1 of 3 pictures are damaged"):
        next(found)


def test_a_bad_photograph_costs_none_of_a_folders_others(photo: Path, tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "a.jpg").write_bytes(b"junk")
    (folder / "b.jpg").write_bytes(photo.read_bytes())
    result = run(see, folder, "--side", "left", "--out", tmp_path / "out")
    assert isinstance(result.exception, UserError)
    assert "a.jpg" in result.output
    assert (tmp_path / "out" / "b.mask.png").exists()
