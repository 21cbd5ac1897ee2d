"""Facts about doubt: how many pictures that contradict it a lane outlasts."""

from __future__ import annotations

import math

import pytest

from host.core.vehicle import Vehicle
from host.estimate.doubt import Doubt
from host.estimate.odometry import Motion
from host.estimate.states import YAW
from tests.helpers.places import OnLane

VEHICLE = Vehicle()


def until_believed(step_m: float, *, cutting: bool = True) -> int:
    """Pictures of an edge half a metre aside, one each step_m, that a lane refuses which twenty
    pictures had agreed on."""
    machine = OnLane(VEHICLE)
    for k in range(1000):
        run = step_m * k
        machine.position.predict(Motion(0.0, 0.5, 0.0, run, 0.0, run, 0.0), cutting=cutting)
        aside = 0.0 if k < 20 else 0.5
        if machine.lane.correct(aside, 0.0, 1.0, (0.0, 0.0), cutting=cutting) and k >= 20:
            return k - 20
    return 1000


@pytest.mark.parametrize("cutting", [True, False])
def test_a_machine_that_stands_believes_another_edge_after_three_times_as_many_pictures(
    cutting: bool,
) -> None:
    standing, driving = (until_believed(step, cutting=cutting) for step in (0.0, 0.011))
    assert 2.5 < standing / driving < 3.5
    assert driving > 5


def test_a_standing_machine_refuses_what_it_is_shown_for_a_second_and_yields_in_the_end() -> None:
    assert 30 < until_believed(0.0, cutting=False) < 200


def test_backward_is_a_way_too() -> None:
    doubt = Doubt()
    first, second = doubt.growth(1.0, cutting=True), doubt.growth(0.98, cutting=True)
    assert first == second == pytest.approx(1.03)


def test_a_machine_of_which_nothing_shows_whether_it_stands_doubts_as_one_that_drives() -> None:
    doubt = Doubt()
    assert [doubt.growth(math.nan, cutting=False) for _ in range(3)] == pytest.approx([1.06] * 3)


def turned_by_a_step(gyro_noise: float) -> float:
    """How far the steps that an edge makes at every half metre, to and fro, turn a machine that has
    driven along it, rad at most."""
    machine, most = OnLane(VEHICLE), 0.0
    for k in range(400):
        run = 0.02 * k
        way = Motion(k / 25.0, 0.5, 0.0, run, 0.0, run, 0.0, gyro_noise)
        machine.position.predict(way, cutting=True)
        aside = 0.0 if run < 2.0 else 0.6 if run % 1.0 < 0.5 else -0.3
        machine.lane.correct(aside, math.nan, 1.0, (0.0, 0.0))
        most = max(most, abs(float(machine.position.x[YAW])))
    return most


def test_an_edge_in_steps_hardly_turns_a_machine_whose_gyroscope_tells_its_direction() -> None:
    """It had turned one by 8 degrees, which then was off its strip by a metre (field 10578)."""
    assert turned_by_a_step(0.002) < math.radians(4.0)
    assert turned_by_a_step(0.0) > math.radians(6.0)
