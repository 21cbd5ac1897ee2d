"""A phone's pictures on their way: late by the network's figures, and in order."""

from __future__ import annotations

import numpy as np
import pytest

from sim_plant.camera import MAST, CameraSpec
from sim_plant.network import STALL_S, Stream


def lateness(
    lens: CameraSpec, count: int = 4000, every_s: float = 1.0, seed: int = 3
) -> np.ndarray:
    stream = Stream(lens, seed)
    return np.array([stream.arrives_s(k * every_s) - k * every_s for k in range(count)])


def test_a_steady_network_takes_the_mean_delay_every_time() -> None:
    late = lateness(MAST.model_copy(update={"jitter_s": 0.0, "stall_share": 0.0}))
    assert late == pytest.approx(MAST.delay_s)


def test_what_the_network_adds_has_the_spread_that_is_asked_for_and_leaves_the_mean() -> None:
    lens = MAST.model_copy(update={"delay_s": 0.15, "jitter_s": 0.03, "stall_share": 0.0})
    late = lateness(lens)
    assert late.mean() == pytest.approx(0.15, abs=0.002)
    assert late.std() == pytest.approx(0.03, rel=0.06)
    assert late.min() >= 0.15 - 0.03


def test_a_lost_segment_holds_up_its_picture_and_those_behind_it() -> None:
    lens = MAST.model_copy(update={"jitter_s": 0.0, "stall_share": 0.05})
    far_apart = lateness(lens)
    assert set(np.round(far_apart - lens.delay_s, 6)) == {0.0, STALL_S}
    assert (far_apart > lens.delay_s + 0.1).mean() == pytest.approx(0.05, abs=0.015)
    arrivals = lateness(lens, every_s=0.1) + 0.1 * np.arange(4000)
    assert (np.diff(arrivals) >= 0.0).all()
    assert (np.diff(arrivals) == 0.0).mean() > 0.02, "they come at once"


def test_the_same_seed_gives_the_same_network_and_another_one_another() -> None:
    lens = MAST.model_copy(update={"jitter_s": 0.03})
    assert (lateness(lens, 50) == lateness(lens, 50)).all()
    assert (lateness(lens, 50) != lateness(lens, 50, seed=4)).any()
