"""The study of wrong beliefs: what it draws, what it calls harm, what it draws as a picture."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from hil.bench.harvest import Harvest
from hil.bench.lockstep import Bench
from hil.bench.wrong_pictures import WrongPictures
from hil.commands.beliefs import beliefs
from hil.firmware import targets
from hil.scenario.scenario import Scenario, changed
from hil.studies.belief_sizes import SIZED, SIZES, draw_sizes
from hil.studies.beliefs import (
    AND,
    CASES,
    COUNTS_PER_DEG,
    FIGURES,
    KINDS,
    OLD_FROM_S,
    ONLY_PICTURES,
    PICTURES,
    harmless,
    merge_all,
    pairs,
    run,
    scenario_of,
)
from host.core.errors import UserError
from host.pilot.phase import Doing

needs_firmware = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="needs the desk firmware: make build"
)


def test_pairs_are_of_different_kinds_drawn_by_a_seed_and_none_twice() -> None:
    drawn = pairs(20, 1)
    assert len(set(drawn)) == 20
    assert drawn == pairs(20, 1) != pairs(20, 2)
    kind = {case: name for name, cases in KINDS.items() for case in cases}
    for pair in drawn:
        one, other = pair.split(AND)
        assert kind[one] != kind[other]
        assert len(scenario_of(pair, "model").plan().sides) > 1


def test_what_two_cases_have_otherwise_is_wrong_at_once_their_faults_as_well() -> None:
    both = merge_all((CASES["pot drifts 5 deg a minute"], CASES["hall loses pulses in a turn"]))
    one = len(CASES["pot drifts 5 deg a minute"]["faults"])
    assert len(both["faults"]) == one + 1
    two = scenario_of(AND.join(("hall 5 %", "gap 1.5, said 2")), "model")
    assert two.field.gap_m == 1.5 and two.told.gap_m == 2.0
    assert two.machine.drive.hall_pulses_per_m == 52.5
    assert two.vehicle.hall_pulses_per_m == 50.0


def test_a_pot_drifts_as_fast_as_its_case_says() -> None:
    faults = scenario_of("pot drifts 12 deg a minute", "model").faults
    at_a_minute = [f.amount for f in faults if f.at.time_s == pytest.approx(60.0)]
    assert at_a_minute == [pytest.approx(12.0 * COUNTS_PER_DEG)]
    assert faults[-1].for_s is None, "what it has drifted stays"


@pytest.mark.parametrize(
    ("outside_m", "put_m", "good"), [(1.25, 1.25, True), (1.3, 1.25, False), (1.25, 0.0, False)]
)
def test_where_the_operator_put_the_machine_is_not_its_harm(
    outside_m: float, put_m: float, good: bool
) -> None:
    row = {"neighbour_cut_m2": 0.0, "outside_m": outside_m, "put_outside_m": put_m}
    assert harmless(row) is good
    assert not harmless(row | {"neighbour_cut_m2": 0.01})


def test_every_case_of_wrong_pictures_is_a_case() -> None:
    assert set(PICTURES) | ONLY_PICTURES <= set(CASES)
    assert {case for case, wrong in PICTURES.items() if wrong.only_pictures} <= ONLY_PICTURES


@pytest.mark.parametrize("case", SIZED)
def test_every_size_is_a_sound_scenario(case: str) -> None:
    assert scenario_of(case, "model", cases=SIZED).plan().sides


def test_sizes_are_drawn(tmp_path: Path) -> None:
    rows: list[dict[str, Any]] = [
        {
            "belief": case,
            "coverage": 1.0,
            "outside_m": 0.0,
            "neighbour_cut_m2": 0.0,
            "outcome": "finished" if k % 2 else "fault",
        }
        for k, case in enumerate(SIZED)
    ]
    draw_sizes(rows, tmp_path / "beliefs.png")
    picture = cv2.imread(str(tmp_path / "beliefs.png"))
    assert picture is not None and picture.std() > 5.0
    assert len(SIZES) == 6


def test_the_command_knows_one_way_of_choosing_and_its_cases() -> None:
    for wrong in (["exact", "--sizes"], ["--sizes", "--pairs", "2"], ["no such case"]):
        done = CliRunner().invoke(beliefs, wrong)
        assert isinstance(done.exception, UserError)


def test_each_case_is_harvested_with_each_seed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def harvested(scenario: Scenario, out: Path, **_: object) -> dict[str, Any]:
        assert out.parent == tmp_path
        return dict.fromkeys(FIGURES, "") | {"coverage": 0.01 * scenario.seed}

    monkeypatch.setattr("hil.studies.beliefs.harvest", harvested)
    rows = run(["exact", "hall 5 %"], tmp_path, "model", "desk", seeds=[3, 4])
    assert [(row["belief"], row["coverage"]) for row in rows] == [
        ("exact, seed 3", 0.03),
        ("exact, seed 4", 0.04),
        ("hall 5 %, seed 3", 0.03),
        ("hall 5 %, seed 4", 0.04),
    ]


def test_rows_come_in_the_order_of_their_cases_whichever_harvest_is_done_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def backwards(drive: Any, tasks: list[Any], *, workers: int) -> Iterator[tuple[Any, Any]]:
        assert workers == 2
        return ((task, drive(task)) for task in reversed(tasks))

    said: dict[str, Any] = dict.fromkeys(FIGURES, 0.0)
    monkeypatch.setattr("hil.studies.beliefs.harvest", lambda *_, **__: said)
    monkeypatch.setattr("hil.studies.beliefs.spread", backwards)
    done: list[str] = []
    rows = run(
        ["exact", "hall 5 %"], tmp_path, "model", "desk", lambda row: done.append(row["belief"]),
        workers=9, seeds=[3],
    )  # fmt: skip
    assert done == ["hall 5 %", "exact"]
    assert [row["belief"] for row in rows] == ["exact", "hall 5 %"]
    assert json.loads((tmp_path / "beliefs.json").read_text()) == rows


def test_model_eyes_leave_out_what_they_cannot_see(tmp_path: Path) -> None:
    args = ["--eyes", "model", "--out", str(tmp_path), "picture mirrored"]
    done = CliRunner().invoke(beliefs, args)
    assert "picture mirrored" in done.output and "left out" in done.output


@needs_firmware
def test_a_mirrored_picture_is_the_other_way_round_in_its_file_too() -> None:
    scenario = scenario_of("exact", "picture")
    honest = WrongPictures().eyes(Bench(scenario))
    mirrored = WrongPictures(flip="mirrored").eyes(Bench(scenario))
    _, as_is = honest.develop(honest.shutter())
    data, over = mirrored.develop(mirrored.shutter())
    assert float(np.abs(over[:, ::-1].astype(int) - as_is).mean()) < 6.0
    assert float(np.abs(over.astype(int) - as_is).mean()) > 12.0
    assert np.array_equal(mirrored.decode(data), over)
    with pytest.raises(UserError, match="mirrored"):
        WrongPictures(flip="mirrored").eyes(Bench(scenario_of("exact", "model")))


@needs_firmware
@pytest.mark.parametrize(("old_s", "sent"), [(0.0, [4, 4, 4, 4]), (0.2, [2, 3, 4, 2])])
def test_an_app_sends_old_pictures_again_with_fresh_noise(old_s: float, sent: list[int]) -> None:
    bench = Bench(scenario_of("exact", "picture"))
    wrong = WrongPictures(old_from_s=0.45, old_s=old_s)
    eyes = wrong.eyes(bench)
    greys = [40.0 * k for k in range(5)]
    bgrs = [np.full((48, 64, 3), grey, np.uint8) for grey in greys]
    for k, bgr in enumerate(bgrs):
        assert eyes._again(0.1 * k, bgr) is bgr
    again = [eyes._again(0.5 + 0.1 * k, bgrs[0]) for k in range(len(sent))]
    assert [round(float(bgr.mean()) / 40.0) for bgr in again] == sent
    assert all(2.0 < float(bgr.std()) < 4.0 for bgr in again)
    if old_s == 0.0:
        assert not np.array_equal(again[0], again[1]), "or a watch for repeated pictures sees it"
    with pytest.raises(UserError, match="old"):
        wrong.eyes(Bench(scenario_of("exact", "model")))


@needs_firmware
@pytest.mark.parametrize("eyes", ["picture", "model"])
def test_a_camera_is_another_from_the_knock_on(eyes: str) -> None:
    """Of crop beside the middle, a camera turned left shows the end farther right."""
    start = {"before_m": 0.5}
    scenario = changed(scenario_of("exact", eyes), {"start": start})
    bench = Bench(scenario)
    knocked = WrongPictures(knocked_at_s=0.2, yaw_deg=5.0).eyes(bench)

    def offset() -> float:
        seen, detector = [], knocked.detector()
        for _ in range(5):
            view = detector.see(knocked.develop(knocked.shutter())[1])
            seen.append(view.edge_offset_m)
        return float(np.nanmedian(seen))

    before_m = offset()
    bench.advance(0.3)
    after_m = offset()
    # 5 degrees at the 2 m from the camera to the crop's face
    assert before_m - after_m == pytest.approx(2.0 * math.tan(math.radians(5.0)), abs=0.12)


@needs_firmware
def test_the_summary_says_where_the_machine_was_put_down() -> None:
    wrong = scenario_of("the wrong way round", "model")
    run = Harvest(changed(wrong, {"limits": {"time_s": 2.0}}))
    run.run()
    found = run.truth.summary()
    run.close()
    assert found["put_outside_m"] == found["outside_m"] == pytest.approx(1.25, abs=0.01)


def are_old(run: Harvest) -> bool:
    """From here on the app sends old pictures."""
    return run.bench.now >= OLD_FROM_S


def turns(run: Harvest) -> bool:
    """The machine turns: along a straight line a mirrored picture moves as a good one does, and so
    does one that comes late."""
    return abs(run.pilot.motion.yaw_rad) > math.radians(5.0)


@needs_firmware
@pytest.mark.parametrize(
    ("case", "known", "why"),
    [
        ("picture frozen, fresh noise", are_old, "stream hangs"),
        ("picture in a loop of 3 s", are_old, "stream hangs"),
        ("picture upside down", lambda _: True, "upside down"),
        ("picture mirrored", turns, "mirrored"),
        ("delay 1.0, said 0.1", turns, "s late, and camera_delay_s says 0.1 s"),
    ],
)
def test_pictures_that_do_not_move_as_the_machine_stop_it_within_2_m_and_name_the_camera(
    case: str, known: Callable[[Harvest], bool], why: str
) -> None:
    # With pictures that jitter, too, one that is upside down is refused before it moves at all.
    steady = {"jitter_s": 0.0, "stall_share": 0.0}
    scenario = changed(scenario_of(case), {"limits": {"time_s": 60.0}, "lens": steady})
    wrong = PICTURES.get(case)
    with closing(Harvest(scenario, eyes=wrong.eyes if wrong is not None else None)) as run:
        run.run(enough=lambda: known(run))
        known_m = run.pilot.motion.distance_m
        run.run()
        found = run.truth.summary()
    assert run.pilot.doing is Doing.FAULT
    assert why in run.pilot.reason and "camera" in run.pilot.reason
    assert run.pilot.motion.distance_m - known_m < 2.0
    assert harmless(found)
