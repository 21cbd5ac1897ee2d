"""Facts about a place that measurements have moved."""

from __future__ import annotations

import math

import pytest

from host.core.messages import State
from host.estimate.moved_place import WAY_M, MovedPlace
from host.estimate.odometry import Motion
from host.pilot.guard import Watched, watch
from tests.helpers.behaving import is_for, on_side

STEP_M = 0.025


def driven(moves: dict[int, float], steps: int, *, radius_m: float = math.inf) -> MovedPlace:
    """Along a straight line or a circle, with what measurements move the place by, along x, before
    a step."""
    watched, moved_m = MovedPlace(), 0.0
    for k in range(steps):
        run = STEP_M * k
        yaw = run / radius_m
        moved_m += moves.get(k, 0.0)
        x = radius_m * math.sin(yaw) if math.isfinite(radius_m) else run
        y = radius_m * (1.0 - math.cos(yaw)) if math.isfinite(radius_m) else 0.0
        watched.take((x + moved_m, y, yaw), Motion(0.05 * k, 0.5, 0.0, run, yaw, run, 0.0))
    return watched


@pytest.mark.parametrize("radius_m", [math.inf, 2.0])
def test_what_the_wheels_have_driven_has_not_moved_the_place(radius_m: float) -> None:
    assert driven({}, 300, radius_m=radius_m).moved_m < 0.01


def test_moves_add_up_over_five_metres_and_are_over_then() -> None:
    within = round(WAY_M / STEP_M)
    assert driven({10: 1.5, 60: 1.0}, within).moved_m == pytest.approx(2.5, abs=0.01)
    assert driven({10: 1.5, 60: -1.0}, within).moved_m == pytest.approx(0.5, abs=0.01)
    assert driven({10: 1.5, 60: 1.0}, within + 30).moved_m == pytest.approx(1.0, abs=0.01)


def test_what_moved_while_it_stood_counts_with_the_way_that_follows() -> None:
    watched = MovedPlace()
    for x, run in ((0.0, 0.0), (1.2, 0.0), (2.4, 0.0), (2.4 + STEP_M, STEP_M)):
        watched.take((x, 0.0, 0.0), Motion(0.0, 0.0, 0.0, run, 0.0, run, 0.0))
    assert watched.moved_m == pytest.approx(2.4)


def test_a_place_that_is_given_is_no_move() -> None:
    watched, still = MovedPlace(), Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for pose in ((0.0, 0.0, 0.0), (3.0, 0.0, 0.0), None, (9.0, 0.0, 0.0), (9.5, 0.0, 0.0)):
        watched.take(pose, still)
    assert watched.moved_m == pytest.approx(0.5)
    watched.take((5.0, 0.0, 0.0), still, placed=1)
    assert watched.moved_m == 0.0


@pytest.mark.parametrize(("by_m", "stops"), [(1.8, False), (2.2, True)])
def test_a_machine_whose_place_has_moved_by_metres_has_lost_it(by_m: float, stops: bool) -> None:
    """It had moved by 3.4 m within 5 m, and the machine went 2.9 m out of its field (model field
    12442)."""
    context = on_side(cut_m=3.0)
    context.estimate.moved = driven({50: by_m}, 100)
    go = watch(State.RUNNING, context.estimate)
    assert is_for(go, Watched.MOVED if stops else None)
