"""Pixels and metres."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.vehicle import LOW, MAST, Mount
from host.vision.geometry import Camera

MOUNTS = st.builds(
    Mount,
    x_m=st.floats(-0.5, 0.5),
    y_m=st.floats(-0.5, 0.5),
    z_m=st.floats(0.4, 2.5),
    pitch_deg=st.floats(-5, 45),
    yaw_deg=st.floats(-20, 20),
    roll_deg=st.floats(-10, 10),
    hfov_deg=st.floats(40, 80),
    distortion=st.sampled_from([(0.0,) * 5, (-0.06, 0.01, 0.0, 0.0, 0.0)]),
)
PIXELS = st.tuples(st.floats(0, 640), st.floats(0, 480))


@given(MOUNTS, PIXELS, st.sampled_from([0.0, 0.3]))
def test_a_pixel_on_a_horizontal_plane_projects_back_onto_itself(
    mount: Mount, pixel: tuple[float, float], height: float
) -> None:
    camera = Camera(mount)
    xy = camera.on_height([pixel], height)
    if not np.isfinite(xy).all() or np.abs(xy).max() > 1e4:
        return
    back = camera.project([[*xy[0], height]])
    assert back[0] == pytest.approx(pixel, abs=0.05)


def test_left_of_the_vehicle_is_left_in_the_picture_and_higher_is_higher() -> None:
    camera = Camera(LOW)
    left, right, high = camera.project([[3, 0.5, 0.3], [3, -0.5, 0.3], [3, 0.5, 0.6]])
    assert left[0] < 320 < right[0]
    assert high[1] < left[1]


def test_what_is_behind_the_lens_has_no_pixel() -> None:
    assert np.isnan(Camera(LOW).project([[-1.0, 0.0, 0.0]])).all()


def test_above_the_horizon_there_is_no_ground() -> None:
    assert np.isnan(Camera(LOW).on_height([[320.0, 20.0]], 0.0)).all()


def test_a_camera_pitched_by_14_degrees_makes_a_true_vertical_at_the_side_lean_8_degrees() -> None:
    camera = Camera(Mount(x_m=0, z_m=1, pitch_deg=14, hfov_deg=62))
    lean = math.degrees(float(camera.lean_rad([[640.0, 240.0]])[0]))
    assert lean == pytest.approx(8.5, abs=0.3)
    assert math.degrees(float(camera.lean_rad([[320.0, 240.0]])[0])) == pytest.approx(0, abs=1e-6)


@given(MOUNTS.filter(lambda m: not any(m.distortion)), st.floats(1.5, 6), st.floats(-1.5, 1.5))
def test_the_lean_is_the_direction_of_a_projected_stem(mount: Mount, x: float, y: float) -> None:
    camera = Camera(mount)
    foot, top = camera.project([[x, y, 0.3], [x, y, 0.31]])
    if not np.isfinite([*foot, *top]).all():
        return
    seen = math.atan2(top[0] - foot[0], foot[1] - top[1])
    assert float(camera.lean_rad([foot])[0]) == pytest.approx(seen, abs=2e-3)


@pytest.mark.parametrize("mount", [LOW, MAST])
def test_the_blades_height_covers_more_rows_the_nearer_its_foot(mount: Mount) -> None:
    rows = Camera(mount).stem_rows_px(0.12)
    ground = rows[rows > 0]
    assert (np.diff(ground) > 0).all()
    assert ground[-1] > 2 * ground[len(ground) // 4]
