"""Facts about what a phone's speed and course add to a walked boundary."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from hil.studies.walks import FILTERS, Walked, walked
from host.field.boundary_file import UNKNOWN_SIGMA_M

SEEDS = (9001, 9002, 9005)


def walks(cep_m: float, laps: int, filters: tuple[float, float], velocities: bool) -> list[Walked]:
    tried = [walked(seed, cep_m, laps, *filters, velocities) for seed in SEEDS]
    return [walk for walk in tried if walk is not None]


def rms(found: list[Walked]) -> float:
    return float(np.sqrt(np.mean(np.concatenate([walk.off for walk in found]) ** 2)))


@pytest.mark.parametrize("filters", FILTERS)
def test_speed_and_course_halve_the_error_of_a_poor_phones_corners(
    filters: tuple[float, float],
) -> None:
    by_positions, by_all = (walks(2.5, 1, filters, velocities) for velocities in (False, True))
    assert len(by_all) == len(SEEDS)
    assert rms(by_all) < 0.5 * rms(by_positions)
    assert {walk.sigma_m for walk in by_positions} == {UNKNOWN_SIGMA_M}


def test_the_survey_knows_how_surely_it_knows_the_corners() -> None:
    found = [
        walk
        for (cep, laps), filters in product(((0.5, 2), (2.5, 1)), FILTERS)
        for walk in walks(cep, laps, filters, True)
    ]
    normalised = [walk.normalised for walk in found]
    assert 0.3 < np.mean(normalised) < 1.5
    assert max(normalised) < 6
    one, two = (np.median([w.sigma_m for w in walks(2.5, laps, (0, 0), True)]) for laps in (1, 2))
    assert two < 0.9 * one
