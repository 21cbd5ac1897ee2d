"""Pictures are a function of seed, time, pose and field; labels agree with projective geometry."""

from __future__ import annotations

import datetime
import math
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from sim_plant import ground, labels, render, sky
from sim_plant.camera import LOW, MAST, Camera, CameraSpec
from sim_plant.field import Field
from sim_plant.field_spec import FieldSpec, Tree
from sim_plant.sky import WeatherSpec

SPEC = FieldSpec(size_m=(8.0, 6.0), bare=0, thin=0, edge_wobble_m=0, crop_height_sd_m=0)
POSE = (0.0, 1.0, 1.5, 0.0)
PINHOLE = {"k1": 0.0, "k2": 0.0, "vibration_deg": 0.0}


def half_cut(seed: int = 1, spec: FieldSpec = SPEC) -> Field:
    """The crop below y = 1 is cut, and so is everything left of x = 3 below y = 2."""
    field = Field(spec, seed)
    field.clear(((-1, -1), (9, -1), (9, 1), (-1, 1)))
    field.clear(((-1, -1), (3, -1), (3, 2), (-1, 2)))
    return field


@pytest.mark.parametrize("mount", [LOW, MAST])
def test_pictures_do_not_depend_on_the_number_of_threads(mount: CameraSpec) -> None:
    pictures = [Camera(half_cut(), mount, seed=1, threads=n).capture(*POSE) for n in (1, 2, 3)]
    assert pictures[0].shape == (480, 640, 3)
    assert all(np.array_equal(pictures[0], p) for p in pictures[1:])


def bodies(kind: NDArray[np.uint8], narrowest: int) -> NDArray[np.bool_]:
    """Coarse cells with crop that stands `narrowest` fine cells wide, or with a solid thing, by
    OpenCV: an even block reaches a cell further to the lower side, both times."""
    crop = np.isin(kind, (ground.CROP, ground.NEIGHBOUR)).astype(np.uint8)
    block = np.ones((narrowest, narrowest), np.uint8)
    wide = cv2.morphologyEx(crop, cv2.MORPH_OPEN, block, borderType=cv2.BORDER_REPLICATE)
    body = (wide > 0) | np.isin(kind, (ground.OBSTACLE, ground.TRUNK))
    return np.asarray(body[::2, ::2] | body[1::2, ::2] | body[::2, 1::2] | body[1::2, 1::2])


def test_what_is_derived_from_a_field_is_what_its_cells_say() -> None:
    """Bodies by OpenCV, free distances in whole squares, kinds by hand."""
    field = half_cut(spec=SPEC.model_copy(update={"trees": (Tree(x_m=7.0, y_m=5.0),)}))
    # A strip of crop 10 cm wide, which has no body.
    field.clear(((2, 3), (6, 3), (6, 4), (2, 4)))
    field.clear(((2, 4.1), (6, 4.1), (6, 5), (2, 5)))
    scene = Camera(field, MAST, seed=1).scene
    body = bodies(scene.kind, 10)
    assert 0.1 < body.mean() < 0.9
    standing = np.isin(scene.kind, (ground.CROP, ground.OBSTACLE, ground.TRUNK, ground.NEIGHBOUR))
    assert standing[::2, ::2][~body].any()
    assert np.array_equal(scene.stand[..., render.BODY] > 0, body)
    stands = scene.way["next"] >= render.BODY_FROM
    assert np.array_equal(stands, body)
    top = scene.way["next"][stands] - render.BODY_FROM
    assert np.array_equal(top, scene.stand[..., render.HEIGHT][stands])
    at = np.argwhere(body)
    rng = np.random.default_rng(1)
    # Bodies farther away than a metre do not count.
    reach = int(1.0 / field.coarse + 1.4143)
    for j, i in rng.integers(0, body.shape, (500, 2)):
        squared = ((at - (j, i)) ** 2).sum(1).min()
        near = scene.way["next"][j, i]
        assert stands[j, i] or near == squared or near > reach**2 < squared
        kinds = sum(int(scene.kind[2 * j + k // 2, 2 * i + k % 2]) << 4 * k for k in range(4))
        assert int(scene.way["kinds"][j, i]) == kinds
        marks = int(scene.land["marks"][j, i]) & 0xFFFFFFFF
        assert marks == kinds << 16 | int(scene.stand[j, i, render.SUNLIT])


@pytest.mark.parametrize("size", [(48, 64), (3, 5), (47, 33)])
def test_the_lens_blurs_as_opencv_does(size: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    light = rng.integers(0, 256, (*size, 3)).astype(np.uint8)
    vignette = rng.integers(180, 256, size).astype(np.uint8)
    rough = rng.integers(-9, 10, (7, size[1] + render.NOISE_OFFSETS, 3)).astype(np.int8)
    gain = np.array([0.9, 1.0, 1.2], np.float32)
    soft = np.asarray(cv2.GaussianBlur(light, (3, 3), 0), np.uint8)
    given = [render.expose(p, vignette, gain, rough, 5, soft=p is soft) for p in (light, soft)]
    assert np.array_equal(*given)
    seen = soft[::8, ::8] * (vignette[::8, ::8, None] / 255)
    for picture in (light, soft):
        mean = render.mean_light(picture, vignette, soft=picture is soft)
        assert mean == pytest.approx(seen.mean())


def test_the_sensor_bends_highlights_and_adds_noise_of_its_rows() -> None:
    light = np.broadcast_to(np.arange(256, dtype=np.uint8)[None, :, None], (9, 256, 3)).copy()
    vignette = np.full((9, 256), 255, np.uint8)
    silence = np.zeros((2, 256 + render.NOISE_OFFSETS, 3), np.int8)
    plain = render.expose(light, vignette, np.ones(3, np.float32), silence, 1, soft=True)
    assert np.array_equal(plain[0, :200, 0], np.arange(200))
    bent = 200 + 55 * (1 - np.exp(-(np.arange(200, 256) - 200) / 55))
    assert np.abs(plain[0, 200:, 0] - bent).max() < 1.0
    rough = np.random.default_rng(1).normal(0, 3, (40, *silence.shape[1:])).round().astype(np.int8)
    noisy = render.expose(light, vignette, np.ones(3, np.float32), rough, 1, soft=True)
    noise = (noisy[:, 50:150].astype(int) - plain[:, 50:150]).reshape(9, -1)
    assert noise.std() == pytest.approx(3.0, abs=0.2)
    # Rows of a picture are strangers to each other.
    assert np.abs(np.corrcoef(noise) - np.eye(9)).max() < 0.25


def test_a_field_cut_to_the_last_stalk_is_pictured_without_a_number_that_overflows() -> None:
    field = Field(SPEC.model_copy(update={"neighbours": "none"}), 1)
    with np.errstate(over="raise", invalid="raise"):
        camera = Camera(field, LOW, seed=1)
        field.clear(((-1, -1), (9, -1), (9, 7), (-1, 7)))
        assert camera.capture(*POSE).any()


def test_pictures_repeat_and_differ_by_seed_time_and_pose() -> None:
    def shot(seed: int, t: float, x: float) -> bytes:
        return Camera(half_cut(), MAST, seed=seed).capture(t, x, 1.5, 0.1).tobytes()

    assert shot(1, 0.0, 1.0) == shot(1, 0.0, 1.0)
    assert len({shot(1, 0.0, 1.0), shot(2, 0.0, 1.0), shot(1, 0.1, 1.0), shot(1, 0.0, 1.1)}) == 4


def test_a_picture_does_not_depend_on_those_before_it() -> None:
    used, fresh = (Camera(half_cut(), MAST, seed=1) for _ in range(2))
    used.capture(5.0, 3.0, 3.0, 2.0, yaw_rate=0.3)
    assert np.array_equal(used.capture(*POSE), fresh.capture(*POSE))


def test_cutting_after_the_shutter_does_not_change_the_picture_developed_in_another_thread() -> (
    None
):
    field = half_cut()
    camera = Camera(field, MAST, seed=1)
    before = camera.capture(*POSE)
    shot = camera.shutter(*POSE)
    with ThreadPoolExecutor(1) as worker:
        coming = worker.submit(camera.develop, shot)
        for k in range(100):
            field.cut((1.5 + 0.02 * k, 1.5, 0.0), (1.5 + 0.02 * (k + 1), 1.5, 0.0))
        assert np.array_equal(coming.result(), before)
    after = camera.capture(*POSE)
    assert np.count_nonzero(np.abs(after.astype(int) - before).max(2) > 40) > 10_000


def test_incremental_updates_give_the_picture_of_a_camera_that_saw_the_final_field() -> None:
    field = half_cut()
    watching = Camera(field, MAST, seed=1)
    for k in range(40):
        field.cut((1.5 + 0.05 * k, 1.5, 0.0), (1.5 + 0.05 * (k + 1), 1.5, 0.0))
        watching.capture(0.1 * k, 1.5 + 0.05 * k, 1.5, 0.0)
    late = Camera(field, MAST, seed=1)
    assert np.array_equal(watching.scene.kind, late.scene.kind)
    assert np.array_equal(watching.scene.stand, late.scene.stand)
    assert np.array_equal(watching.scene.way, late.scene.way)
    assert np.array_equal(watching.scene.land, late.scene.land)
    pose = (9.0, 2.0, 1.5, 0.0)
    assert np.array_equal(watching.labels(*pose), late.labels(*pose))
    assert np.array_equal(watching.capture(*pose), late.capture(*pose))


@pytest.mark.parametrize("mount", [LOW, MAST])
def test_every_pixel_is_painted(mount: CameraSpec) -> None:
    """Whatever its neighbours meet: what is found and not painted yet has a label of its own."""
    camera = Camera(half_cut(), mount, seed=1)
    for k in range(12):
        label = camera.labels(0.1 * k, 0.3 * k, 0.5 + 0.2 * k, 0.5 * k, 0.05, 0.05)
        assert label.max() <= labels.EDGE


@pytest.mark.parametrize(("hour", "month"), [(6.5, 4), (12.0, 12), (17.5, 4)])
def test_shadows_that_a_cut_leaves_are_those_of_the_cut_field(hour: float, month: int) -> None:
    """Sun in the east, south and west of a patch of crop amid open ground, low enough for shadows
    of a metre and more."""
    field = half_cut()
    for x0, x1, y0, y1 in ((-1, 2.6, -1, 7), (3.5, 9, -1, 7), (-1, 9, -1, 1.2), (-1, 9, 1.8, 7)):
        field.clear(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))
    weather = WeatherSpec(hour=hour, date=datetime.date(2026, month, 21))
    watching = Camera(field, MAST, weather, seed=1)
    whole = watching.scene.stand.copy()
    for k in range(12):
        field.cut((1.0 + 0.1 * k, 1.5, 0.0), (1.1 + 0.1 * k, 1.5, 0.0))
        watching.capture(0.1 * k, 1.0 + 0.1 * k, 1.5, 0.0)
    late = Camera(field, MAST, weather, seed=1)
    assert np.count_nonzero(whole != late.scene.stand) > 300
    assert np.array_equal(watching.scene.stand, late.scene.stand)
    assert np.array_equal(watching.scene.land, late.scene.land)
    # Stalks stand in the light of today, too: from where the patch's shadow falls to each side.
    for x, y, yaw in ((0.0, 1.5, 0.0), (6.0, 1.5, math.pi), (3.0, 4.5, -math.pi / 2)):
        pose = (9.0, x, y, yaw)
        assert np.array_equal(watching.capture(*pose), late.capture(*pose))


def _project(mount: CameraSpec, forward: float, left: float, up: float) -> tuple[float, float]:
    """Pixel of a point of the vehicle frame, by the pinhole model alone."""
    p = math.radians(mount.pitch_deg)
    x, y, z = forward - mount.x_m, left - mount.y_m, up - mount.z_m
    depth = x * math.cos(p) - z * math.sin(p)
    down = -x * math.sin(p) - z * math.cos(p)
    u = mount.width_px / 2 - mount.focal_px * y / depth
    return u, mount.height_px / 2 + mount.focal_px * down / depth


BESIDE = (0.0, 1.0, 0.5, 0.0)
"""On the stubble, the crop's edge 0.5 m to the left from x = 3 on: its foot is in view."""


@pytest.mark.parametrize("mount", [LOW, MAST])
def test_the_crops_edge_is_where_the_pinhole_model_puts_it(mount: CameraSpec) -> None:
    mount = mount.model_copy(update=PINHOLE)
    label = Camera(half_cut(), mount, seed=1).labels(*BESIDE)
    for ahead in (2.6, 3.5, 5.0):
        u, v = _project(mount, ahead, 0.5, 0.0)
        rows = label[round(v) - 2 : round(v) + 3]
        found = np.median(
            [np.flatnonzero(np.isin(r, (labels.STANDING, labels.EDGE))).max() for r in rows]
        )
        # Within 8 cm: stalks lean, and stubble stands before the foot.
        assert found == pytest.approx(u, abs=0.08 * mount.focal_px / ahead + 2)
    u, v = _project(mount, 2.6, 0.3, 0.0)
    assert label[round(v), round(u)] == labels.STUBBLE


@pytest.mark.parametrize("mount", [LOW, MAST])
def test_the_marked_edge_lies_on_the_true_edge(mount: CameraSpec) -> None:
    mount = mount.model_copy(update=PINHOLE)
    label = Camera(half_cut(), mount, seed=1).labels(*BESIDE)
    errors = []
    for ahead in np.linspace(2.6, 6.0, 20):
        eu, ev = _project(mount, ahead, 0.5, 0.0)
        marked = np.flatnonzero(label[round(ev)] == labels.EDGE)
        if marked.size:
            errors.append(np.abs(marked - eu).min() * ahead / mount.focal_px)
    assert len(errors) > 12
    assert np.median(errors) < 0.05


def test_a_pitched_camera_makes_verticals_at_the_side_lean() -> None:
    """Design, point 3: pitched by 14 degrees, a vertical at the picture's side leans by 8.5."""
    mount = MAST.model_copy(update={**PINHOLE, "pitch_deg": 14.0})
    ahead, left = 4.0, 2.4
    low, high = (_project(mount, ahead, left, z) for z in (0.0, 0.9))
    lean = math.degrees(math.atan2(high[0] - low[0], low[1] - high[1]))
    assert abs(lean) == pytest.approx(8.5, abs=0.3)
    camera = Camera(half_cut(), mount, seed=1)
    view = camera.view(camera.shutter(*POSE))
    for (u, v), z in ((low, 0.0), (high, 0.9)):
        p = np.array([POSE[1] + ahead - view.x, POSE[2] + left - view.y, z - view.z])
        right, down, forward = view.axes @ p
        assert view.focal * right / forward + view.cu == pytest.approx(u, abs=0.01)
        assert view.focal * down / forward + view.cv == pytest.approx(v, abs=0.01)


@pytest.mark.parametrize(("roll", "pitch"), [(0.05, 0.0), (-0.05, 0.0), (0.0, 0.06), (0.0, -0.06)])
def test_the_grounds_slope_reaches_the_horizon(roll: float, pitch: float) -> None:
    mount = MAST.model_copy(update={**PINHOLE, "pitch_deg": 5.0})
    field = Field(SPEC.model_copy(update={"neighbours": "none", "size_m": (0.2, 0.2)}))
    label = Camera(field, mount).labels(0.0, -3.0, 0.1, 0.0, roll=roll, pitch=pitch)
    top = [int(np.flatnonzero(label[:, u] != labels.BACKGROUND).min()) for u in (20, 620)]
    level = [int(np.flatnonzero(column != labels.BACKGROUND).min()) for column in
             Camera(field, mount).labels(0.0, -3.0, 0.1, 0.0)[:, [20, 620]].T]  # fmt: skip
    shift = np.subtract(top, level)
    if pitch:
        assert shift == pytest.approx(-mount.focal_px * pitch, abs=4)
    else:
        # Right side down: the horizon drops on the left and rises on the right.
        assert shift[1] - shift[0] == pytest.approx(-600 * roll, abs=4)


@pytest.mark.parametrize("mount", [LOW, MAST])
def test_a_rolling_vehicle_turns_the_picture_about_the_ground_ahead_of_it(
    mount: CameraSpec,
) -> None:
    """About the vehicle's axis, that is, not about that of a camera which looks down."""
    camera = Camera(Field(SPEC, 1), mount.model_copy(update={"vibration_deg": 0.0}))
    pixels = []
    for roll in (0.0, 0.05):
        view = camera.view(camera.shutter(0.0, -3.0, 0.0, 0.0, roll=roll))
        ray = view.axes @ (np.array([-1.5, 0.0, 0.0]) - [view.x, view.y, view.z])
        pixels.append(ray[:2] / ray[2])
    assert pixels[1] == pytest.approx(pixels[0], abs=1e-9)


def test_lens_distortion_moves_the_corner_as_its_polynomial_says() -> None:
    mount = MAST.model_copy(update={"k1": -0.1, "k2": 0.02})
    rays = Camera(half_cut(), mount).rays
    a, b = (float(x) for x in rays[0, 0])
    r = a * a + b * b
    factor = mount.focal_px * (1 + mount.k1 * r + mount.k2 * r * r)
    assert (a * factor + 320, b * factor + 240) == pytest.approx((0.5, 0.5), abs=1e-3)


def test_a_rolling_shutter_shears_a_turning_picture() -> None:
    mount = MAST.model_copy(update={**PINHOLE, "readout_s": 0.05, "shutter_s": 0.0, "noise": 0.0})
    camera = Camera(half_cut(), mount, seed=1)
    still, turning = (camera.capture(*POSE, yaw_rate=w) for w in (0.0, 0.6))
    expected = mount.focal_px * 0.6 * 0.05  # over the whole height
    shifts = []
    for v in (60, 420):
        strip = still[v : v + 8, 100:540]
        found = cv2.matchTemplate(turning[v : v + 8, 60:580], strip, cv2.TM_CCOEFF_NORMED)
        shifts.append(int(found.argmax()) - 40)
    assert shifts[1] - shifts[0] == pytest.approx(expected * 360 / 480, abs=2.5)


def test_the_exposure_control_evens_out_haze_cloud_and_hour() -> None:
    means = [
        Camera(half_cut(), MAST, WeatherSpec(**w), seed=1).capture(*POSE).mean()
        for w in ({"hour": 9}, {"hour": 12}, {"hour": 16.5}, {"cloud": 1.0}, {"haze": 0.05})
    ]
    assert max(means) / min(means) < 1.25


def test_the_sun_rises_in_the_east_and_culminates_at_latitude_less_declination() -> None:
    morning, noon, evening = (sky.sun(WeatherSpec(hour=h)) for h in (9, 12, 15))
    assert morning.east > 0.5 > abs(noon.east)
    assert evening.east == pytest.approx(-morning.east)
    assert noon.north < 0
    # 28 April: declination 14.0 degrees.
    assert math.degrees(noon.elevation) == pytest.approx(90 - 31.5 + 14.0, abs=0.3)


def test_shadows_fall_away_from_the_sun() -> None:
    """At 9 h the sun stands in the east: ground just west of the crop lies in shadow."""
    scenes = {h: Camera(half_cut(), MAST, WeatherSpec(hour=h)).scene for h in (9.0, 15.0)}

    def shaded(hour: float, x: float, y: float) -> bool:
        s = scenes[hour]
        j, i = int((y - s.y0) / s.cell / 2), int((x - s.x0) / s.cell / 2)
        return bool(s.stand[j, i, 0] > 0)

    west, east = (-0.2, 3.0), (8.2, 3.0)
    assert (shaded(9.0, *west), shaded(9.0, *east)) == (True, False)
    assert (shaded(15.0, *west), shaded(15.0, *east)) == (False, True)


def test_low_sun_is_warm() -> None:
    def warmth(hour: float) -> float:
        direct, _ = sky.daylight(WeatherSpec(hour=hour))
        return float(direct[2] / direct[0])

    assert warmth(7.0) > warmth(9.0) > warmth(12.0)


def test_the_tree_line_is_as_ragged_as_it_is_drawn() -> None:
    """Its highest tree stands alone, and below the lowest no sky shows."""
    far = sky.panorama(WeatherSpec(), np.random.default_rng(1))
    tangent = np.linspace(sky.PANORAMA_TOP, sky.PANORAMA_BOTTOM, len(far))
    trees = (far[..., 1] < 150)[tangent > 0.03].mean(1)
    assert 0 < trees[trees > 0][0] < 0.05
    assert (far[(tangent > 0.003) & (tangent < 0.012), :, 1] < 200).mean() > 0.99


def test_wind_moves_the_stalks() -> None:
    mount = MAST.model_copy(update={"vibration_deg": 0.0})
    camera = Camera(half_cut(), mount, WeatherSpec(wind_mps=6), seed=1)
    calm = Camera(half_cut(), mount, WeatherSpec(wind_mps=0), seed=1)

    def change(cam: Camera) -> float:
        a, b = (cam.labels(t, *POSE[1:]) for t in (0.0, 0.4))
        return float((a != b).mean())

    assert change(calm) == 0.0
    assert change(camera) > 0.005


def test_the_engine_shakes_the_mount() -> None:
    mount = MAST.model_copy(update={"vibration_deg": 0.5})
    camera = Camera(half_cut(), mount, seed=1)
    axes = [camera.view(camera.shutter(0.1 * k, *POSE[1:])).axes for k in range(400)]
    pitch = np.degrees([-math.asin(a[2, 2]) for a in axes])
    assert pitch.mean() == pytest.approx(28.0, abs=0.1)
    assert pitch.std() == pytest.approx(0.5, abs=0.06)


def test_the_header_hides_the_ground_behind_it_and_moves_with_the_camera() -> None:
    mount = MAST.model_copy(update={**PINHOLE, "machine_in_view": True})
    field = half_cut()
    camera = Camera(field, mount, seed=1)
    masks = [camera.labels(*p) == labels.MACHINE for p in (POSE, (0.0, 4.0, 4.0, 1.0))]
    assert np.array_equal(masks[0], masks[1])
    u, v = _project(mount, 1.5 - 0.1, 0.0, 0.3)
    assert masks[0][round(v), round(u)]
    bare = Camera(field, MAST.model_copy(update=PINHOLE), seed=1).labels(*POSE)
    assert not (bare == labels.MACHINE).any()


def test_dust_veils_the_blade_and_nothing_far_from_it() -> None:
    camera = Camera(half_cut(), MAST, WeatherSpec(dust=1.0, wind_mps=0.5), seed=1)
    off, on = (camera.capture(*POSE, blade_on=b).astype(int) for b in (False, True))
    veiled = np.abs(on - off).max(2) > 40
    u, v = _project(MAST, 1.5, 0.0, 0.3)
    assert veiled[round(v) - 60 : round(v) + 10, round(u) - 120 : round(u) + 120].mean() > 0.2
    assert veiled[:40].mean() < 0.01


def test_the_jpeg_is_a_jpeg_of_the_picture() -> None:
    camera = Camera(half_cut(), MAST, seed=1)
    picture = camera.capture(*POSE)
    data = camera.encode(picture)
    assert data[:3] == b"\xff\xd8\xff"
    back = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert np.abs(back.astype(int) - picture).mean() < 6
