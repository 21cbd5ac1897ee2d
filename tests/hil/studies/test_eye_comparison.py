"""What both eyes say of the same moments, counted by situation."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from hil.commands.eyes import compared_table
from hil.studies.eye_comparison import LEAST, Compared, Said, compared, situation
from hil.studies.eye_fit import save

NAN = math.nan


@pytest.mark.parametrize(
    ("ahead_m", "depth_m", "right_m", "slope", "words"),
    [
        (math.inf, 0.0, NAN, NAN, "clear ground"),
        (0.0, 3.0, -0.5, 0.1, "in the crop: edge along the way"),
        (0.0, 3.0, -0.5, 0.6, "in the crop: border slants left ahead"),
        (0.1, 0.5, -0.5, -0.6, "in the crop: border slants right ahead"),
        (0.0, 3.0, -0.5, NAN, "in the crop: border that ends"),
        (1.2, 3.0, NAN, NAN, "before the crop: no right end"),
    ],
)
def test_a_situation_is_what_stands_ahead_and_where_its_border_runs(
    ahead_m: float, depth_m: float, right_m: float, slope: float, words: str
) -> None:
    assert situation(ahead_m, depth_m, right_m, slope) == words


def test_shares_are_of_all_pictures_and_errors_of_the_sure_ones(tmp_path: Path) -> None:
    """In two files of one mount: the detector is sure of three in four, once wrong by 0.3 m, the
    model of all and right; each once says that nothing stands ahead."""
    about = {"mount": "low", "blade_width_m": 1.0, "overlap_m": 0.1}
    quarter = LEAST // 2
    edge = [0.0, 0.0, 0.3, 0.0] * quarter
    for name in ("both-00001", "both-00002"):
        columns = {
            "ahead_m": [0.0] * len(edge),
            "depth_m": [3.0] * len(edge),
            "right_m": [-0.4] * len(edge),
            "slope": [0.0] * len(edge),
            "read_right_m": [-0.4] * len(edge),
            "confidence": [0.9, 0.9, 0.9, 0.1] * quarter,
            "edge_offset_m": edge,
            "crop_ahead_m": [0.0, 0.0, 0.0, 1.0] * quarter,
            "ahead_confidence": [0.9] * len(edge),
            "model_confidence": [0.9] * len(edge),
            "model_edge_offset_m": [0.02] * len(edge),
            "model_crop_ahead_m": [0.0, 1.0, 1.0, 0.0] * quarter,
            "model_ahead_confidence": [0.9, 0.9, 0.1, 0.9] * quarter,
        }
        save(tmp_path / f"{name}.parquet", columns, about)
    (row,) = compared(sorted(tmp_path.glob("both-*.parquet")))
    assert (row.mount, row.situation) == ("low", "in the crop: edge along the way")
    assert row.pictures == 2 * len(edge)
    assert (row.detector.sure, row.detector.wrong, row.detector.clear) == (0.75, 0.25, 0.25)
    assert row.detector.off_m == pytest.approx((0.0, 0.0, 0.3), abs=1e-6)
    assert (row.model.sure, row.model.wrong, row.model.clear) == (1.0, 0.0, 0.25)
    assert row.model.off_m == pytest.approx((0.02, 0.02, 0.02), abs=1e-6)


def test_what_is_met_too_seldom_is_not_spoken_of(tmp_path: Path) -> None:
    names = ("ahead_m", "depth_m", "right_m", "slope", "read_right_m")
    answers = ("confidence", "edge_offset_m", "crop_ahead_m", "ahead_confidence")
    columns = {name: [0.0] * (LEAST - 1) for name in names}
    columns |= {f"{by}{name}": [0.9] * (LEAST - 1) for by in ("", "model_") for name in answers}
    path = tmp_path / "both-00001.parquet"
    save(path, columns, {"mount": "low", "blade_width_m": 1.0, "overlap_m": 0.1})
    assert compared([path]) == []


def test_the_table_has_the_detector_s_figures_before_the_model_s() -> None:
    detector = Said(0.75, 0.25, (-0.1, 0.0, 0.3), 0.05)
    row = Compared("low", "clear ground", 40, detector, Said(1.0, 0.0, (0.02, 0.02, 0.02), 0.0))
    table = compared_table([row])
    cells = [list(column.cells) for column in table.columns]
    assert cells == [
        ["low"],
        ["clear ground"],
        ["40"],
        ["0.750 / 1.000"],
        ["0.250 / 0.000"],
        ["0.050 / 0.000"],
        ["-0.10 +0.00 +0.30 / +0.02 +0.02 +0.02"],
    ]
