"""Facts about what many runs say of why they went wrong."""

from __future__ import annotations

from typing import Any

from hil.judge.causes import causes, circumstances, disagreements, general, hesitations
from hil.scenario.random_fields import random_field


def run(number: int, outcome: str = "finished", **more: Any) -> dict[str, Any]:
    events = [
        {"t": 0.0, "phase": "follow", "reason": "", "x_m": 0.0, "y_m": 0.0},
        {"t": 10.0, "phase": "hesitate", "reason": "the edge is lost: dust", "x_m": 1.0, "y_m": 0},
        {"t": 16.0, "phase": outcome, "reason": "", "x_m": 1.0, "y_m": 0.0},
    ]
    figures: dict[str, Any] = {
        "run": f"r{number}", "scenario": "s", "seed": number, "outcome": outcome, "coverage": 0.99,
        "missed_m2": 1.0, "reason": f"gave up after {number} s", "events": events,
    }  # fmt: skip
    return figures | more


def world(dust: float, mount: str = "low") -> dict[str, float | str | bool]:
    return {"dust": dust, "mount": mount}


def test_the_same_reason_with_other_numbers_is_one_cause() -> None:
    assert general("gave up after 60 s: 1.5 m") == general("gave up after 7 s: -0.25 m")
    found = causes([run(1, "fault"), run(2, "fault"), run(3)], [world(0.1)] * 3)
    assert [(c.runs, c.state, c.outcome) for c in found] == [(2, "hesitate", "fault")]


def test_harm_comes_first_whatever_its_number() -> None:
    runs = [run(1, "fault"), run(2, "fault"), run(3, neighbour_cut_m2=0.1)]
    assert causes(runs, [world(0.1)] * 3)[0].outcome == "neighbour cut"


def test_a_finished_field_with_crop_left_has_gone_wrong() -> None:
    found = causes([run(1, coverage=0.9), run(2)], [world(0.1)] * 2)
    assert [c.outcome for c in found] == ["crop left"]


def test_the_circumstance_is_found_that_makes_a_cause_frequent() -> None:
    """Runs 0 to 29 are dusty, and fail; the mount is by the way."""
    runs = [run(k, "fault" if k < 30 else "finished") for k in range(60)]
    worlds = [world(0.5 if k < 30 else 0.1, "low" if k % 2 else "mast") for k in range(60)]
    told = causes(runs, worlds)[0].circumstance
    assert told.startswith("dust > 0.3") and "30 of 30 (2.0 times" in told


def test_a_circumstance_that_chance_explains_is_not_named() -> None:
    runs = [run(k, "fault" if k % 2 else "finished") for k in range(12)]
    assert causes(runs, [world(0.1 * (k % 3)) for k in range(12)])[0].circumstance == ""


def test_hesitations_count_their_time() -> None:
    assert hesitations([run(1), run(2)]) == [("the edge is lost: dust", 2, 2, 12.0)]


def test_fields_driven_both_ways_are_laid_side_by_side() -> None:
    rows = disagreements([run(1), run(2), run(3)], [run(1), run(2, coverage=0.8), run(4)])
    assert [row["disagree"] for row in rows] == [False, True]


def test_a_world_is_told_in_plain_values() -> None:
    values = circumstances(random_field(1)).values()
    assert all(isinstance(value, int | float | str | bool) for value in values)
