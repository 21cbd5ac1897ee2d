"""`daranti-hil world` writes its sheets, names what is missing, and its figures mean something."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from hil.commands import world
from hil.studies import contact_sheets, realism
from host.core.errors import UserError
from sim_plant import labels
from sim_plant.camera import MAST
from sim_plant.field_spec import FieldSpec
from sim_plant.ground import CROP, STUBBLE


def test_a_sheet_is_written_with_a_row_per_mount(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        contact_sheets, "SHEETS", {"cut": (True, (contact_sheets.View("here", "start"),))}
    )
    result = CliRunner().invoke(world.world, ["--out", str(tmp_path / "new"), "--sheet", "cut"])
    assert result.exit_code == 0, result.output
    picture = cv2.imread(str(tmp_path / "new" / "cut.jpg"))
    # Two mounts, each a view over its labels, and the legend.
    assert picture.shape == (round(4 * 480 * 0.62) + 34, round(640 * 0.62), 3)


def test_an_output_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(UserError, match="taken"):
        world.world.main(
            ["--out", str(tmp_path / "taken" / "x"), "--sheet", "cut"], standalone_mode=False
        )


def test_missing_photographs_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DARANTI_DATA", str(tmp_path))
    with pytest.raises(UserError, match="DARANTI_DATA"):
        world.world.main(["--compare"], standalone_mode=False)


@pytest.mark.parametrize("name", ["first edge", "second ring", "end"])
def test_at_every_stage_the_blade_has_cut_up_to_the_crop_ahead(name: str) -> None:
    crop, (x, y, _) = contact_sheets.stage(FieldSpec(), 1, name)
    blade = x + contact_sheets.BLADE_AHEAD
    assert crop.kind_at(blade - 0.1, y) == STUBBLE
    assert crop.kind_at(blade + 0.3, y) == CROP


def test_every_label_has_its_own_colour() -> None:
    values = np.array([[v for v in vars(labels).values() if isinstance(v, int)]], np.uint8)
    assert len(np.unique(contact_sheets.colour_labels(values)[0], axis=0)) == values.size


def test_overlap_is_the_common_area() -> None:
    a, b = np.array([0.5, 0.5, 0.0]), np.array([0.0, 0.5, 0.5])
    assert realism.overlap(a, a) == 1.0
    assert realism.overlap(a, b) == 0.5


def test_gradients_across_a_vertical_edge_are_horizontal() -> None:
    bgr = np.zeros((64, 64, 3), np.uint8)
    bgr[:, ::8] = 200
    found = realism.histograms(bgr, np.ones((64, 64), bool))["gradient direction"]
    assert found[0] + found[-1] == pytest.approx(1.0)


def test_the_line_by_a_cue_finds_an_edge_that_the_cue_shows_and_not_one_that_it_does_not() -> None:
    standing = np.zeros((200, 300), bool)
    standing[:, :130] = True
    rough = np.random.default_rng(1).normal(0, 1, standing.shape) * np.where(standing, 40, 10)
    bgr = np.clip(128 + np.repeat(rough[..., None], 3, 2), 0, 255).astype(np.uint8)
    sample = realism.Sample(bgr, standing, ~standing, "left", "rough and smooth, equally bright")
    assert realism.divided(sample, "texture") > 0.95
    assert realism.divided(sample, "hue") < 0.9


def test_simulated_samples_hold_crop_and_stubble_and_little_else() -> None:
    samples = realism.simulated(MAST, seed=2, count=3)
    assert samples
    for s in samples:
        assert (s.standing | s.cut).mean() > 0.9
        assert not (s.standing & s.cut).any()
