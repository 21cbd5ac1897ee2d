"""Facts about what the machine has cut: crop right beside it is the same field's."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.frames import Pose2
from host.estimate.swaths import ALONG_RAD, ASIDE_M, BEFORE_BEGIN_M, BEFORE_END_M, STEP_M, Swaths

LONG_M = 10.0
STRIP_M = 0.8
AWAY = Pose2(0.0, 500.0, 0.0)
"""From everything that was cut."""


def cut(swaths: Swaths, aside_m: float = 0.0, long_m: float = LONG_M) -> None:
    """A strip along x, reckoned and placed alike."""
    for k in range(round(long_m / STEP_M) + 1):
        at = Pose2(STEP_M * k, aside_m, 0.0)
        swaths.note(at.x_m, at, at)
    swaths.end()


def one() -> Swaths:
    swaths = Swaths()
    cut(swaths)
    return swaths


@pytest.mark.parametrize(
    ("x_m", "left_m", "turned_rad", "beside"),
    [
        (5.0, STRIP_M, 0.0, True),
        (5.0, ASIDE_M[0] - 0.05, 0.0, False),
        (5.0, ASIDE_M[1] + 0.05, 0.0, False),
        (5.0, -STRIP_M, 0.0, False),
        (5.0, STRIP_M, ALONG_RAD - 0.05, True),
        (5.0, STRIP_M, ALONG_RAD + 0.05, False),
        (5.0, STRIP_M, math.pi, False),
        (-BEFORE_BEGIN_M + 0.05, STRIP_M, 0.0, True),
        (-BEFORE_BEGIN_M - 0.05, STRIP_M, 0.0, False),
        (LONG_M - BEFORE_END_M - 0.05, STRIP_M, 0.0, True),
        (LONG_M - BEFORE_END_M + 0.05, STRIP_M, 0.0, False),
    ],
)
def test_it_is_beside_a_swath_that_lies_right_of_the_blade_and_goes_on(
    x_m: float, left_m: float, turned_rad: float, beside: bool
) -> None:
    assert one().beside(Pose2(x_m, left_m, turned_rad), [AWAY]) is beside


@given(
    x_m=st.floats(-50.0, 50.0), y_m=st.floats(-50.0, 50.0), yaw=st.floats(-math.pi, math.pi),
    along_m=st.floats(-3.0, 13.0), left_m=st.floats(-3.0, 3.0),
)  # fmt: skip
def test_wherever_a_swath_lies_the_same_is_beside_it(
    x_m: float, y_m: float, yaw: float, along_m: float, left_m: float
) -> None:
    start, swaths = Pose2(x_m, y_m, yaw), Swaths()
    for k in range(round(LONG_M / STEP_M) + 1):
        at = start.ahead(STEP_M * k)
        swaths.note(STEP_M * k, at, at)
    swaths.end()
    margin = min(abs(along_m + BEFORE_BEGIN_M), abs(along_m - LONG_M + BEFORE_END_M))
    if min(margin, abs(left_m - ASIDE_M[0]), abs(left_m - ASIDE_M[1])) < 1e-6:
        return
    inside = -BEFORE_BEGIN_M < along_m < LONG_M - BEFORE_END_M
    beside = inside and ASIDE_M[0] < left_m < ASIDE_M[1]
    assert swaths.beside(start.ahead(along_m, left_m), [AWAY]) is beside


@pytest.mark.parametrize(("farther_m", "beside"), [(3.9, True), (4.1, False)])
def test_a_machine_that_may_have_come_farther_may_be_past_its_end(
    farther_m: float, beside: bool
) -> None:
    at = Pose2(LONG_M - BEFORE_END_M - 4.0, STRIP_M, 0.0)
    assert one().beside(at, [AWAY], farther_m) is beside
    assert one().beside(AWAY, [at], farther_m) is beside


def test_across_the_narrowest_gap_from_it_nothing_is_beside_it() -> None:
    """A blade of 0.9 m that reaches over a gap of 1.2 m from where a blade has cut."""
    assert not one().beside(Pose2(5.0, 0.45 + 1.2 - 0.45 + 0.01, 0.0), [AWAY])


def test_the_strip_that_is_being_cut_is_none_yet() -> None:
    swaths = Swaths()
    for k in range(40):
        at = Pose2(STEP_M * k, 0.0, 0.0)
        swaths.note(at.x_m, at, at)
    beside = Pose2(5.0, STRIP_M, 0.0)
    assert not swaths.beside(beside, [AWAY])
    swaths.end()
    assert swaths.beside(beside, [AWAY])


def test_the_latest_is_known_by_dead_reckoning_wherever_the_machine_is_placed_since() -> None:
    """At a strip's end the place is often found elsewhere."""
    swaths = Swaths()
    for k in range(40):
        reckoned = Pose2(STEP_M * k, 0.0, 0.0)
        swaths.note(reckoned.x_m, reckoned, reckoned.ahead(0.0, 90.0))
    swaths.end()
    assert swaths.beside(Pose2(5.0, STRIP_M, 0.0), [AWAY])


def test_beside_an_earlier_one_the_machine_is_at_every_place_where_it_may_be() -> None:
    swaths = one()
    cut(swaths, aside_m=300.0)
    beside = Pose2(5.0, STRIP_M, 0.0)
    assert swaths.beside(AWAY, [beside])
    assert not swaths.beside(AWAY, []), "a machine that knows no place is beside none"
    assert swaths.beside(AWAY, [beside, Pose2(6.0, STRIP_M, 0.0)])
    assert not swaths.beside(AWAY, [beside, Pose2(5.0, STRIP_M + 1.0, 0.0)])


@pytest.mark.parametrize("at", [0, 1, 2])
def test_each_earlier_one_ends_where_it_ended_whatever_was_cut_after_it(at: int) -> None:
    swaths = Swaths()
    for k in range(3):
        cut(swaths, 5.0 * k)
    for x_m, beside in (
        (LONG_M - BEFORE_END_M - 0.05, True),
        (LONG_M - BEFORE_END_M + 0.05, False),
    ):
        here = Pose2(x_m, 5.0 * at + STRIP_M, 0.0)
        assert swaths.beside(AWAY, [here]) is beside


def test_going_back_and_on_again_adds_nothing() -> None:
    """Else the swath would run to and fro, and have no direction there."""
    swaths = Swaths()
    for travelled in [*range(8), 3, 4, 5, *range(8, 16)]:
        at = Pose2(float(travelled), 0.0, 0.0)
        swaths.note(at.x_m, at, at)
    swaths.end()
    assert swaths.beside(Pose2(4.4, STRIP_M, 0.0), [AWAY])


def test_without_any_nothing_is_beside_one() -> None:
    swaths = Swaths()
    swaths.end()
    assert not swaths.beside(Pose2(0.0, 0.0, 0.0), [Pose2(0.0, 0.0, 0.0)])
