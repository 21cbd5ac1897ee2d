"""Facts about campaigns by model eyes: what is looked at again, and what they leave."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner

from hil.commands.campaign import campaign
from hil.firmware import targets
from hil.judge.causes import went_wrong
from hil.scenario.scenario import Scenario
from hil.studies.campaign import badness, jobs_of, picked, with_files, with_pictures

TINY = """
field: {size_m: [4.0, 3.0], neighbour_depth_m: 2.0}
lens: {x_m: 0.0, z_m: 1.6, pitch_deg: 28.0, width_px: 64, height_px: 48}
belief: exact
limits: {time_s: 0.3}
"""


def summaries(*coverages: float) -> list[dict[str, object]]:
    return [
        {"outcome": "finished" if c > 0.5 else "fault", "coverage": c, "neighbour_cut_m2": 0.0}
        for c in coverages
    ]


def test_the_worst_are_harmful_then_unfinished_then_patchy() -> None:
    harmful = {"outcome": "finished", "coverage": 1.0, "neighbour_cut_m2": 0.01}
    order = [harmful, *summaries(0.3, 0.4, 0.9, 0.99)]
    assert sorted(order, key=lambda s: -badness(s)) == order
    assert [went_wrong(s | {"reason": ""}) for s in order] == [
        "neighbour cut", "fault", "fault", "crop left", "",
    ]  # fmt: skip


def test_the_worst_and_a_sample_are_picked_the_same_each_time(tmp_path: Path) -> None:
    chosen = [Scenario(seed=k, eyes="model") for k in range(8)]
    jobs = jobs_of(chosen, tmp_path, False)
    found = summaries(0.9, 0.2, 0.99, 0.98, 0.97, 0.3, 0.96, 0.95)
    once, again = (picked(jobs, found, 2, 3) for _ in range(2))
    assert once == again and len({job.key for job in once}) == 5
    assert once[:2] == [jobs[1], jobs[5]]


def test_a_run_of_figures_comes_again_with_all_its_files_or_with_pictures(tmp_path: Path) -> None:
    (job,) = jobs_of([Scenario(eyes="model")], tmp_path, False)
    lean, full, seen = (
        Scenario.model_validate_json(j.scenario)
        for j in (job, with_files(job, tmp_path), with_pictures(job, tmp_path))
    )
    assert (lean.record.files, full.record.files, seen.record.files) == ("figures", "all", "all")
    assert (lean.eyes, full.eyes, seen.eyes) == ("model", "model", "picture")


@pytest.mark.skipif(not targets.DESK_LIBRARY.exists(), reason="make build")
def test_the_command_drives_tabulates_and_looks_again(tmp_path: Path) -> None:
    (tmp_path / "tiny.yaml").write_text(TINY, encoding="utf-8")
    out = tmp_path / "out"
    done = CliRunner().invoke(
        campaign,
        ["--scenario", str(tmp_path / "tiny.yaml"), "--seeds", "1-3", "--eyes", "model", "--out",
         str(out), "--workers", "1", "--worst", "1", "--sample", "1", "--maps", "1"],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    runs = pd.read_parquet(out / "runs.parquet")
    assert sorted(runs.seed) == [1, 2, 3] and set(runs.eyes) == {"model"}
    assert {"world_dust", "world_mount", "coverage", "reason"} <= set(runs.columns)
    assert len(pd.read_parquet(out / "pictures" / "runs.parquet")) == 2
    assert len(list((out / "maps" / "runs").glob("*/map.png"))) == 1
    assert not list((out / "runs").glob("*/record.mcap"))
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "What went wrong" in page and "By the model and by pictures" in page
