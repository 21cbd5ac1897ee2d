"""The drives along edges: their truth, their end rule, their figures, and that they go on."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from hil.commands.vision import vision
from hil.scenario.belief import Belief
from hil.scenario.scenario import Scenario
from hil.studies import camera_troubles, vision_drives
from hil.studies.vision_drives import (
    Drive,
    Outcome,
    PhotoOnMount,
    curve,
    declared_end,
    drive_along,
    prepared,
    run,
    summary,
)
from hil.studies.vision_photographs import off_by
from host.estimate.crop_ahead import Ahead
from host.estimate.odometry import Motion
from host.vision.geometry import Camera
from host.vision.photo.detector import RobustPhoto
from host.vision.view import CropView
from sim_plant.camera import LOW, MAST, CameraSpec

NEAR, CLEAR = (CropView(0.9, crop_ahead_m=x, ahead_confidence=0.9) for x in (0.0, 3.0))
UNSURE = CropView(0.9, crop_ahead_m=3.0, ahead_confidence=0.2)
OUTCOME = Outcome("", 0.01, [0.02, None, -0.04], [None] * 3, [0.0] * 3, [0.0] * 3, 0.1, 0)


def declared(views: list[CropView]) -> list[float]:
    ahead, way = Ahead(), [Motion(0.2 * k, 0.5, 0, 0.1 * k, 0, 0, 0) for k in range(len(views))]
    ends = [declared_end(ahead, view, motion) for view, motion in zip(views, way, strict=True)]
    return [end.distance_m for end in ends if end is not None]


def test_an_end_is_declared_by_three_clear_pictures_where_the_first_was_taken() -> None:
    assert declared([NEAR, CLEAR, CLEAR]) == []
    assert declared([NEAR, NEAR, CLEAR, CLEAR, CLEAR]) == [pytest.approx(0.2)]
    assert declared([NEAR, CLEAR, CLEAR, NEAR, CLEAR, CLEAR]) == []


def test_pictures_that_show_nothing_neither_count_nor_interrupt() -> None:
    assert declared([NEAR, CLEAR, UNSURE, CLEAR, CLEAR]) == [pytest.approx(0.1)]


def test_no_end_before_the_crop_was_reached() -> None:
    assert declared([CLEAR] * 5) == []


def test_figures_count_confident_pictures_only() -> None:
    figures = summary([OUTCOME])
    assert figures["availability"] == pytest.approx(2 / 3, abs=1e-4)
    assert figures["offset_rmse_m"] == pytest.approx(math.sqrt((0.02**2 + 0.04**2) / 2), abs=1e-5)
    assert figures["offset_bias_m"] == pytest.approx(-0.01)
    assert figures["heading_rmse_deg"] is None


def test_an_end_that_was_not_declared_was_missed() -> None:
    figures = summary([OUTCOME, replace(OUTCOME, end_error_m=None), replace(OUTCOME, false_ends=2)])
    assert (figures["ends"], figures["missed_ends"], figures["false_ends"]) == (3, 1, 2)
    assert figures["end_of_field_error_worst_m"] == pytest.approx(0.1)


def test_drives_with_machines_of_their_own_have_mounts_that_no_drawing_has(tmp_path: Path) -> None:
    drives = [
        Drive(5, n, mount, "robust", 5.0, str(tmp_path), own_machine=True)
        for n in range(3)
        for mount in ("low", "mast")
    ]
    edges = [prepared(drive) for drive in drives]
    lenses = [edge.scenario.world.lens for edge in edges]
    assert len({(lens.z_m, lens.pitch_deg, lens.hfov_deg) for lens in lenses}) == len(lenses)
    assert all(lens.z_m not in (LOW.z_m, MAST.z_m) for lens in lenses)
    assert [edge.vehicle.blade_x_m for edge in edges] == pytest.approx(
        [edge.scenario.world.machine.blade_x_m for edge in edges]
    )
    usual = replace(drives[0], own_machine=False)
    assert prepared(usual).scenario.world.lens == LOW
    assert usual.path != drives[0].path


def test_a_drive_cuts_along_the_edge_to_its_end(tmp_path: Path) -> None:
    edge = prepared(Drive(5, 0, "mast", "robust", 5.0, str(tmp_path)))
    seen = list(drive_along(edge))
    cutting = [s for s in seen if s.cutting]
    assert len(cutting) > 10
    assert all(abs(s.offset_m) < 0.3 for s in cutting[:-6] if math.isfinite(s.offset_m))
    assert math.isnan(cutting[-1].offset_m)
    assert not seen[-1].cutting
    assert not seen[-1].crop_beyond
    assert cutting[0].crop_beyond


def test_a_drive_that_was_done_is_read_not_driven(tmp_path: Path) -> None:
    drive = Drive(5, 1, "low", "robust", 5.0, str(tmp_path))
    first = run(drive)

    assert run(drive) == first
    found = json.loads(drive.path.read_text())
    drive.path.write_text(json.dumps(found | {"km": 7.0}))
    assert run(drive) == replace(first, km=7.0)


def test_dust_that_is_asked_for_changes_nothing_else(tmp_path: Path) -> None:
    drawn = Drive(5, 1, "low", "robust", 5.0, str(tmp_path))
    clean = replace(drawn, dust=0.0)
    assert clean.path != drawn.path
    a, b = prepared(drawn), prepared(clean)
    assert b.scenario.weather == a.scenario.weather.model_copy(update={"dust": 0.0})
    assert (b.scenario.seed, b.depth_m, b.weave) == (a.scenario.seed, a.depth_m, a.weave)


@pytest.mark.parametrize("offset_m", [-0.2, 0.0, 0.25])
def test_the_photographs_edge_is_read_where_the_truth_is(
    offset_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Everything left of an upright plane along the vehicle stands."""
    scenario = Scenario(camera="mast", belief=Belief.model_validate("exact"))
    v, camera = scenario.vehicle, Camera(scenario.mount)
    width, height = camera.size
    pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), -1)
    y = camera.on_height(pixels, vision_drives.PROBE_HEIGHT_M)[..., 1]
    view = CropView(0.8, standing=y > offset_m - v.inset_m)
    monkeypatch.setattr(RobustPhoto, "see", lambda _self, _bgr: view)
    seen = PhotoOnMount(v, scenario.mount).see(np.zeros((height, width, 3), np.uint8))
    assert seen.edge_offset_m == pytest.approx(offset_m, abs=0.01)
    assert seen.confidence == 0.8


def test_what_is_wrong_with_the_camera_changes_its_lens_alone(tmp_path: Path) -> None:
    drive = Drive(5, 1, "low", "robust", 5.0, str(tmp_path))
    sound, muddy = prepared(drive), prepared(replace(drive, trouble="mud"))
    assert replace(drive, trouble="mud").path != drive.path
    assert muddy.scenario.world.lens.disturbance.mud > 0
    assert muddy.scenario.model_copy(update={"lens": {}}) == sound.scenario
    assert (muddy.depth_m, muddy.weave) == (sound.depth_m, sound.weave)


@pytest.mark.parametrize("name", camera_troubles.TROUBLES)
def test_every_trouble_makes_a_sound_scenario_of_every_drive(name: str) -> None:
    trouble = camera_troubles.TROUBLES[name]
    for number in range(5):
        scenario = Scenario(lens=trouble.lens((1, number)))
        lens = scenario.world.lens
        assert (scenario.mount.width_px, scenario.mount.height_px) == (
            lens.width_px,
            lens.height_px,
        )
        if name in camera_troubles.FORMATS:
            assert f"{lens.width_px}x{lens.height_px}" == name


def test_an_upright_picture_sees_as_far_up_and_down_as_a_lying_one_to_the_sides() -> None:
    focal = CameraSpec.model_validate(camera_troubles.of_size(480, 640).camera).focal_px
    assert focal == pytest.approx(CameraSpec().focal_px)


def test_the_curve_counts_what_was_said_at_each_confidence() -> None:
    said = [(0.95, 0.01), (0.75, 0.2), (0.55, -0.2), (0.35, None), (0.1, 0.0)]
    rows = {row["confidence"]: row for row in curve(said)}
    assert rows[0.3]["sure"] == pytest.approx(0.8)
    assert rows[0.3]["sure_and_wrong"] == pytest.approx(0.6)
    assert rows[0.7]["sure_and_wrong"] == pytest.approx(0.2)
    assert rows[0.9]["sure_and_wrong"] == 0.0
    assert curve([]) == []


def test_an_unknown_trouble_is_refused_with_the_known_ones(tmp_path: Path) -> None:
    result = CliRunner().invoke(vision, ["--out", str(tmp_path), "--trouble", "fog"])
    assert "--trouble fog: no such trouble" in str(result.exception)
    assert "white balance" in str(result.exception)


def test_an_edge_is_off_where_rows_have_one_true_edge() -> None:
    standing = np.zeros((40, 100), np.bool_)
    standing[:20, :50] = True
    points = np.array([[60, 5], [60, 15], [90, 30], [60, -3]], np.float32)
    assert off_by(CropView(0.9, edge_px=points), standing) == pytest.approx(0.1)
    assert off_by(CropView(0.9, edge_px=points[2:]), standing) is None
    assert off_by(CropView(0.9), standing) is None


def test_a_run_of_no_length_is_refused(tmp_path: Path) -> None:
    result = CliRunner().invoke(vision, ["--out", str(tmp_path), "--km", "0"])
    assert result.exit_code == 2
    assert "--km" in result.output


def test_the_rear_axle_rolls_where_it_looks(tmp_path: Path) -> None:
    """A drive that slips sideways would be none that dead reckoning can follow."""
    edge = prepared(Drive(5, 0, "mast", "robust", 5.0, str(tmp_path)))
    poses = [edge.pose(0.02 * k) for k in range(200)]
    for (x0, y0, yaw0), (x1, y1, yaw1) in pairwise(poses):
        middle = 0.5 * (yaw0 + yaw1)
        aside = (y1 - y0) * math.cos(middle) - (x1 - x0) * math.sin(middle)
        assert abs(aside) < 1e-4
    assert max(abs(yaw) for _, _, yaw in poses) > math.radians(0.5)
