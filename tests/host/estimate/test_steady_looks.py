"""Facts about looks that are not sure: two in one line are believed, and nothing less."""

from __future__ import annotations

import numpy as np
import pytest

from host.estimate.steady_looks import APART_M, ASKEW, OFF_M, PICTURES, SPREAD_M, SteadyLooks


def look(looks: SteadyLooks, at_m: float, edge_m: float, spread_m: float = 0.0,
         pictures: int = PICTURES) -> float | None:  # fmt: skip
    for off in np.linspace(-0.5, 0.5, pictures) * spread_m:
        looks.note(edge_m + float(off))
    return looks.over(at_m)


def test_one_look_is_not_believed_and_the_next_in_line_is() -> None:
    looks = SteadyLooks()
    assert look(looks, 2.0, 0.13) is None
    assert look(looks, 3.0, 0.25) == pytest.approx(0.25)
    assert look(looks, 4.0, 0.08) == pytest.approx(0.08), "against the line as it was moved"


@pytest.mark.parametrize("apart_m", [APART_M[0] - 0.05, APART_M[1] + 0.05])
def test_the_same_patch_twice_and_another_edge_are_no_line(apart_m: float) -> None:
    looks = SteadyLooks()
    look(looks, 2.0, 0.2)
    assert look(looks, 2.0 + apart_m, 0.2) is None


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize(("turn", "believed"), [(0.95, True), (1.05, False)])
def test_a_line_that_leads_away_from_the_lane_too_much_is_none(
    turn: float, sense: float, believed: bool
) -> None:
    looks = SteadyLooks()
    look(looks, 2.0, 0.0)
    found = look(looks, 3.0, sense * turn * (ASKEW + OFF_M))
    assert (found is not None) is believed


def test_pictures_that_disagree_and_too_few_say_nothing() -> None:
    for bad in ({"spread_m": 1.3 * SPREAD_M}, {"pictures": PICTURES - 1}):
        looks = SteadyLooks()
        look(looks, 2.0, 0.2)
        assert look(looks, 3.0, 0.2, **bad) is None
        assert look(looks, 4.0, 0.2) is None, "what came before is forgotten with it"


def test_another_line_begins_without_memory() -> None:
    looks = SteadyLooks()
    look(looks, 2.0, 0.2)
    looks.begin()
    assert look(looks, 3.0, 0.2) is None
