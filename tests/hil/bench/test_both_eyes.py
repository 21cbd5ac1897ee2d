"""A detector that looks on while the model drives."""

from __future__ import annotations

from typing import Any

import pytest

from hil.bench.both_eyes import BothEyes
from hil.bench.eyes import Eyes, WitnessedEyes
from hil.bench.harvest import Harvest
from hil.bench.lockstep import Bench
from hil.bench.model_eyes import ModelEyes
from hil.firmware import targets
from hil.scenario.scenario import Scenario
from host.core.vehicle import Vehicle

VEHICLE = Vehicle()

pytestmark = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="the desk firmware is not built: make build"
)


def scenario() -> Scenario:
    values: dict[str, Any] = {
        "eyes": "model",
        "field": {"size_m": (12.0, 6.0), "neighbour_depth_m": 3.0, "edge_wobble_m": 0.0},
        "limits": {"time_s": 4.0},
    }
    return Scenario.model_validate(values)


def test_who_looks_on_changes_nothing_and_is_shown_what_the_model_answers_to() -> None:
    kept: list[BothEyes] = []

    def both(bench: Bench) -> Eyes:
        kept.append(BothEyes(ModelEyes(bench), WitnessedEyes(bench)))
        return kept[0]

    paths = []
    for eyes in (ModelEyes, both):
        run = Harvest(scenario(), eyes=eyes)
        run.run()
        paths.append(list(run.truth.path))
        run.close()
    assert paths[0] == paths[1]
    seen, answers = kept[0].witness.seen, kept[0].answers
    assert len(seen) == len(answers) > 30
    expected = -(VEHICLE.blade_width_m / 2 - VEHICLE.overlap_m)
    for _, truth, view, _ in seen[-20:]:
        assert view.edge_offset_m == pytest.approx(truth.right_m - expected, abs=0.1)


def test_a_picture_that_stands_in_for_those_that_nobody_reads_counts_once() -> None:
    kept: list[WitnessedEyes] = []

    def eyes(bench: Bench) -> Eyes:
        kept.append(WitnessedEyes(bench))
        kept[0].looks = lambda: bench.now < 1.0
        return kept[0]

    run = Harvest(scenario(), eyes=eyes)
    run.run()
    run.close()
    stamps = [stamp for stamp, *_ in kept[0].seen]
    assert 5 < len(stamps) == len(set(stamps))
    assert max(stamps) < 1.0
