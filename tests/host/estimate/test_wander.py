"""Facts about how an edge wanders beside its lane, and about the lane that is kept of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.estimate import wander
from host.estimate.kalman import Array
from host.estimate.motion_model import move
from host.estimate.odometry import Motion
from host.estimate.states import CORNERS, LANE_OFFSET, LANE_YAW, WANDER, WANDER_YAW, YAW
from host.estimate.wander import BENT, DRILLED, Wander

OF_EDGE = [WANDER, WANDER_YAW]


def at(distance_m: float) -> Motion:
    return Motion(distance_m / 0.3, 0.3, 0.0, distance_m, 0.0, distance_m, 0.0, 0.0)


def went(x: Array, p: Array, ways: list[float], of: Wander) -> tuple[Array, Array]:
    x, p, here = x.copy(), p.copy(), 0.0
    for step in ways:
        move(x, p, at(here), at(here + step), of, cutting=False)
        here += step
    return x, p


def unknown(of: Wander) -> tuple[Array, Array]:
    x, p = np.zeros(CORNERS), np.zeros((CORNERS, CORNERS))
    wander.begin([x], [p], of, goes_on=False)
    return x, p


@pytest.mark.parametrize("step", [0.03, 0.4, -0.3])
@pytest.mark.parametrize("of", [DRILLED, BENT])
def test_what_nobody_sees_is_as_unknown_everywhere(of: Wander, step: float) -> None:
    _, p = went(*unknown(of), [step] * 40, of)
    expected = np.diag([of.sigma_m**2, of.sigma_rad**2])
    assert p[np.ix_(OF_EDGE, OF_EDGE)] == pytest.approx(expected, abs=1e-9)


def test_only_an_edge_that_bends_has_a_direction() -> None:
    assert DRILLED.sigma_rad == 0.0
    assert BENT.sigma_rad == pytest.approx(math.sqrt(3.0) * BENT.sigma_m / BENT.over_m)


@given(st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.integers(1, 8))
def test_it_goes_on_alike_in_one_step_and_in_many(left_m: float, turned: float, parts: int) -> None:
    x, p = unknown(BENT)
    x[OF_EDGE] = left_m, turned
    p[OF_EDGE, OF_EDGE] = 1e-4
    once, many = went(x, p, [1.2], BENT), went(x, p, [1.2 / parts] * parts, BENT)
    assert many[0][OF_EDGE] == pytest.approx(once[0][OF_EDGE], abs=1e-9)
    at_edge = np.ix_(OF_EDGE, OF_EDGE)
    assert many[1][at_edge] == pytest.approx(once[1][at_edge], abs=1e-9)


def test_where_it_bends_to_the_left_it_soon_lies_farther_left() -> None:
    x, p = unknown(BENT)
    x[WANDER_YAW] = 0.1
    forward, back = went(x, p, [0.2], BENT)[0], went(x, p, [-0.2], BENT)[0]
    assert forward[WANDER] == pytest.approx(0.02, rel=0.2)
    assert back[WANDER] == pytest.approx(-forward[WANDER])


def test_past_a_bend_the_edge_goes_on_where_it_was_and_nobody_knows_which_way() -> None:
    x, p = unknown(BENT)
    x[OF_EDGE], p[WANDER, WANDER] = (0.2, 0.1), 1e-4
    wander.begin([x], [p], BENT, goes_on=True)
    assert x[OF_EDGE] == pytest.approx([0.2, 0.0])
    assert p[WANDER, WANDER] == 1e-4
    assert p[WANDER_YAW, WANDER_YAW] == pytest.approx(BENT.sigma_rad**2)


@given(st.floats(0.0, 12.0))
def test_the_lane_that_is_kept_errs_as_the_machine_that_has_seen_its_edge(along_m: float) -> None:
    """Where the blade was by what the machine's place errs, and in direction by what its yaw does:
    from there it leads a machine that is as wrong to the same edge."""
    rng = np.random.default_rng(3)
    a = rng.standard_normal((CORNERS + 2, CORNERS + 2))
    x, p = 0.1 * rng.standard_normal(CORNERS + 2), a @ a.T
    turned = np.zeros(CORNERS + 2)
    turned[[YAW, CORNERS]] = 1.0, -0.2
    edge, direction = np.zeros((2, CORNERS + 2))
    edge[[LANE_OFFSET, LANE_YAW]] = 1.0, along_m
    direction[LANE_YAW] = 1.0
    seen = edge.copy()
    seen[WANDER] = 1.0
    before = np.array([seen, turned])
    at, errs, with_all, runs = seen @ x, before @ p @ before.T, before @ p, x[LANE_YAW]
    wander.into_lane([x], [p], along_m, turned)
    after = np.array([edge, direction])
    assert (edge @ x, x[LANE_YAW]) == (pytest.approx(at), runs)
    assert after @ p @ after.T == pytest.approx(errs, rel=1e-6, abs=1e-6)
    others = [k for k in range(CORNERS + 2) if k not in (LANE_OFFSET, LANE_YAW)]
    assert (after @ p)[:, others] == pytest.approx(with_all[:, others], rel=1e-6, abs=1e-6)
    assert p == pytest.approx(p.T)
