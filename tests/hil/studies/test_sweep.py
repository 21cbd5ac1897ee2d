"""The sweep: what it tries, that nobody's number of workers shows, and what it concludes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from hil.commands.sweep import sweep
from hil.studies import sweep as sweeps
from hil.studies.sweep import Axis, Space, Sweep, candidate_cost, candidates_of, load_space, pareto
from host.core.errors import UserError

SPACE = Space(
    parameters={
        "steer_kp": Axis(low=20, high=80, points=2, log=True),
        "steer_kd": Axis(low=0, high=4, points=3),
    },
    plants={"slew_degps": (50, 60)},
    steps_deg=(30.0,),
)


@pytest.mark.parametrize("method", ["grid", "random", "optuna"])
def test_the_same_seed_gives_the_same_table(method: sweeps.Method) -> None:
    one = Sweep(SPACE, method, trials=6, plant_count=2, seed=1)
    table = one.run()
    pd.testing.assert_frame_equal(table, one.run(), check_exact=True)
    assert len(table) == one.responses() == 12


def test_the_table_does_not_depend_on_the_workers() -> None:
    one = Sweep(SPACE, "random", trials=5, plant_count=2, seed=2)
    here = one.run()
    with sweeps.dask(2) as spread:
        there = one.run(spread)
    pd.testing.assert_frame_equal(here, there, check_exact=True)


def test_a_grid_holds_every_combination_once() -> None:
    table = Sweep(SPACE, "grid", plant_count=1).run()
    tried = {tuple(row) for row in table[["steer_kp", "steer_kd"]].to_numpy()}
    assert tried == {(kp, kd) for kp in (20.0, 80.0) for kd in (0.0, 2.0, 4.0)}


def test_better_gains_cost_less() -> None:
    space = SPACE.model_copy(update={"fixed": {"steer_ki": 55.0}})
    ranked = candidates_of(Sweep(space, "grid", plant_count=3).run(), ["steer_kp", "steer_kd"])
    assert ranked.iloc[0]["steer_kp"] == 80.0
    assert ranked.iloc[0]["meets"] > ranked.iloc[-1]["meets"]


def test_the_worst_responses_weigh_twice() -> None:
    assert candidate_cost([1.0] * 10) == pytest.approx(2.0)
    assert candidate_cost([1.0] * 9 + [2.0]) == pytest.approx(1.1 + 2.0)


def test_the_pareto_front_holds_what_nothing_beats() -> None:
    points = pd.DataFrame({"a": [1.0, 2.0, 3.0, 2.5], "b": [3.0, 2.0, 1.0, 2.5]})
    assert sorted(pareto(points, ("a", "b")).index) == [0, 1, 2]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("parameters: {steer_magic: {low: 0, high: 1}}", "no parameter 'steer_magic'"),
        ("parameters: {steer_kp: {low: 5, high: 1}}", "low < high"),
        ("parameters: {steer_kp: {low: 5, high: 500}}", "steer_kp must be 0 to 100"),
        ("parameters: {}\nplants: {colour: [0, 1]}", "no property 'colour'"),
        ("parameters: {}\nplants: {slew_degps: [60, 20]}", "slew_degps ends before it begins"),
        ("parameters: {}\nsteps_deg: []", "steps_deg"),
        ("parameters: {}\nsteps_deg: [30, 0]", "a step of 0 degrees"),
        ("parameters: {steer_kp: {low: 1, high: 9, points: 99999999}}", "give fewer points"),
        ("parameters: {}\nstep: 3", "step"),
        ("parameters: [", "not YAML"),
    ],
)
def test_a_wrong_space_is_one_message(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "space.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(UserError, match=message):
        load_space(file)


def test_the_command_writes_a_table_that_a_data_frame_opens(tmp_path: Path) -> None:
    space = tmp_path / "space.yaml"
    space.write_text(json.dumps(SPACE.model_dump()), encoding="utf-8")
    arguments = ["--space", str(space), "--method", "grid", "--plants", "2", "--workers", "0"]
    result = CliRunner().invoke(sweep, [*arguments, "--out", str(tmp_path)], catch_exceptions=False)
    assert result.exit_code == 0
    table = pd.read_parquet(tmp_path / "responses.parquet")
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert len(table) == summary["responses"] == 12
    assert summary["chosen"]["steer_kp"] in (20.0, 80.0)
    own = table[table["candidate"] == summary["chosen_candidate"]]
    assert summary["worst_case"]["cost"] == pytest.approx(float(own["cost"].max()))
    assert np.isfinite(table["cost"]).all()
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert 'src="http' not in page
    assert page.count("data:image/png") == 3
