"""The one update of every filter, and the measurements alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from host.core.vehicle import Vehicle
from host.estimate.estimator import Estimator
from host.estimate.kalman import KEPT, Filter, Measurement
from host.estimate.lane import Lane
from host.estimate.measurements import begin, course, edge, end, rest
from host.estimate.motion_model import SIGHT_SIGMA_M
from host.estimate.odometry import Motion
from host.estimate.place import Place
from host.estimate.states import CORNERS, GYRO, LANE_OFFSET, PLAN_YAW, WANDER, YAW, X, Y
from host.route.plan import Plan
from host.route.side import Side
from tests.helpers.places import OnLane

VEHICLE = Vehicle()
SIDE = Side(0.0, 0.0, 0.0, 10.0, VEHICLE.pass_m, 10.0)


def measured(value: float, sigma: float, gate: float = math.inf) -> Measurement:
    h = np.array([[1.0, 0.0]])
    return Measurement("so", h, np.array([value]), np.array([sigma**2]), gate)


def fresh() -> Filter:
    return Filter(np.zeros(2), np.array([[4.0, 2.0], [2.0, 4.0]]))


class Read(Filter):
    """Shows its state."""

    @property
    def state(self) -> tuple[list[float], list[list[float]]]:
        return self._x.tolist(), self._p.tolist()


def read(x: list[float]) -> Read:
    return Read(np.array(x), np.array([[4.0, 2.0], [2.0, 4.0]]))


def test_a_measurement_moves_the_state_by_its_share_of_the_doubt() -> None:
    one = read([0.0, 0.0])
    assert one.fuse(measured(1.0, 2.0))
    x, p = one.state
    assert x == pytest.approx([0.5, 0.25])
    assert np.array(p) == pytest.approx(np.array([[2.0, 1.0], [1.0, 3.5]]))


def test_a_frozen_state_is_considered_and_not_changed() -> None:
    one = read([0.0, 7.0])
    one.fuse(measured(1.0, 2.0), frozen=(1,))
    x, p = one.state
    assert x == pytest.approx([0.5, 7.0])
    assert p[1][1] == pytest.approx(4.0)
    assert p[0][1] == pytest.approx(1.0), "what they have in common shrinks"


def test_a_measurement_beyond_its_gate_is_refused_and_recorded() -> None:
    one = read([0.0, 0.0])
    before = one.state
    assert not one.fuse(measured(10.0, 1.0, gate=9.0))
    assert one.state == before
    [innovation] = one.innovations
    assert (innovation.used, innovation.dimensions, innovation.value) == (False, 1, 10.0)
    assert innovation.sigma == pytest.approx(math.sqrt(5.0))
    assert innovation.nis == pytest.approx(20.0)


def test_innovations_that_nobody_reads_do_not_pile_up() -> None:
    one = fresh()
    for _ in range(2 * KEPT):
        one.fuse(measured(0.0, 1.0))
    assert len(one.innovations) == KEPT


def test_the_estimator_hands_its_innovations_over_once() -> None:
    estimate = Estimator(VEHICLE, Plan())
    estimate.lane.correct(0.0, math.nan, 0.9, (0.0, 0.0))
    assert [one.name for one in estimate.take_innovations()] == ["edge"]
    assert estimate.take_innovations() == []


# ---- the measurements ----------------------------------------------------------------------------


def place(x_m: float, y_m: float, yaw_rad: float = 0.0, side: Side = SIDE) -> Place:
    x = np.zeros(CORNERS)
    x[[X, Y, YAW]] = x_m, y_m + VEHICLE.inset_m, yaw_rad
    return Place(x, side, VEHICLE.blade_x_m, VEHICLE.inset_m)


def test_an_edge_is_expected_beside_the_lane_as_it_lies() -> None:
    here = place(2.0, 0.2, 0.1)
    here.x[[LANE_OFFSET, WANDER]] = 0.03, 0.02
    ahead = VEHICLE.blade_x_m + 0.5
    seen = -(0.2 - 0.05 + ahead * math.sin(0.1)) / math.cos(0.1)
    one = edge.edge(here, seen, -0.1, 1.0, (0.0, 0.0), 0.5)
    assert one.innovation == pytest.approx([0.0, 0.0])
    assert edge.edge(here, seen, math.nan, 1.0, (0.0, 0.0), 0.5).gate == 9.0


def test_an_unsure_edge_and_a_far_one_count_less() -> None:
    def variance(confidence: float, ahead_m: float) -> float:
        one = edge.edge(place(0.0, 0.0), 0.0, math.nan, confidence, (0.0, 0.0), ahead_m)
        return float(one.variances[0])

    assert variance(0.5, 0.0) > 2 * variance(1.0, 0.0)
    assert variance(1.0, 1.0) > 2 * variance(1.0, 0.0)


def test_what_the_gyroscope_shows_at_rest_is_its_offset_besides_what_is_known_of_it() -> None:
    x = np.zeros(CORNERS)
    x[GYRO] = 0.01
    one = rest.rest(x, 0.03, 0.02**2)
    assert one.innovation == pytest.approx([0.02])
    assert one.h[0, GYRO] == 1.0 and np.count_nonzero(one.h) == 1


def test_a_course_tells_of_yaw_and_the_plans_direction() -> None:
    x = np.zeros(CORNERS)
    x[PLAN_YAW] = 0.02
    slow, fast = course.course(x, 0.05, 0.3), course.course(x, 0.05, 1.0)
    assert slow.innovation == pytest.approx([0.03])
    assert slow.variances[0] > fast.variances[0]


def test_a_begin_and_an_end_tell_how_far_along_it_is() -> None:
    at_begin = place(-VEHICLE.blade_x_m, 0.0)
    assert begin.begin(at_begin, 0.0).innovation == pytest.approx([0.0])
    at_end = place(10.0 - VEHICLE.blade_x_m, 0.0)
    told = end.end(at_end, end.EARLY_M, 0.0)
    assert told.innovation == pytest.approx([0.0])
    assert end.end(at_end, end.EARLY_M, 0.5).variances[0] > told.variances[0]


@pytest.mark.parametrize(
    "border", [begin.begin(place(0.0, 0.0), 0.0), end.end(place(0.0, 0.0), 0.0, 0.0)]
)
def test_a_border_that_may_be_something_else_moves_the_place_by_a_part(border: Measurement) -> None:
    """As expected it leaves the place surer; within reason it is taken as it is; where it may be
    either, the place is moved by a part of it and less sure, both meanings taken together; far off
    it is next to nothing."""
    sigma_m, shares, sigmas = 0.3, [], []
    for off_m in (0.0, 0.3, 1.0, 3.0):
        one = Read(np.zeros(CORNERS), np.eye(CORNERS) * sigma_m**2)
        only_x = np.zeros_like(border.h)
        only_x[0, X] = 1.0
        assert one.fuse(replace(border, h=only_x, innovation=np.array([off_m])))
        one.merge()
        x, p = one.state
        shares.append(x[X] / off_m if off_m > 0.0 else 0.0)
        sigmas.append(math.sqrt(p[X][X]))
    assert shares[1] > 0.5
    assert 0.2 < shares[2] < 0.8 * shares[1]
    assert shares[3] < 0.15
    assert sigmas[0] == pytest.approx(sigmas[1])
    assert sigmas[0] < 0.7 * sigma_m
    assert sigmas[2] > 1.1 * sigma_m


def test_a_slanting_border_is_met_earlier_farther_left() -> None:
    slanting = replace(SIDE, edge_begin_m=VEHICLE.pass_m)
    left = place(-VEHICLE.blade_x_m - 0.3, 0.3, side=slanting)
    assert begin.begin(left, 0.0).innovation == pytest.approx([0.0])


def test_a_strip_without_width_has_a_beginning_and_an_end_too() -> None:
    """A plan that is laid out anew leaves such ones (random field 10118)."""
    side = replace(SIDE, width_m=0.0, edge_begin_m=0.4, edge_end_m=0.4)
    at_begin = place(-VEHICLE.blade_x_m, 0.0, side=side)
    assert math.isfinite(begin.begin(at_begin, 0.0).innovation.item())
    assert math.isfinite(end.end(at_begin, 0.0, 0.0).innovation.item())


# ---- what lasts ----------------------------------------------------------------------------------


def at(distance_m: float) -> Motion:
    return Motion(distance_m, 0.5, 0.0, distance_m, 0.0, distance_m, 0.0)


def followed(rng: np.random.Generator, metres: float = 6.0, step_m: float = 0.05) -> Lane:
    """A lane on a straight way whose pictures err as the detector's do, for half a metre
    alike; the truth is 0."""
    machine = OnLane(VEHICLE)
    machine.predict(at(0.0))
    lane = machine.lane
    lane.place(float(rng.normal(0.0, 0.1)), float(rng.normal(0.0, 0.03)), 0.1, 0.03)
    keeps = math.exp(-step_m / 0.5)
    lasting = float(rng.normal(0.0, 0.035))
    for k in range(1, round(metres / step_m)):
        machine.predict(at(k * step_m))
        lasting = keeps * lasting + float(rng.normal(0.0, 0.035 * math.sqrt(1 - keeps**2)))
        seen = lasting + float(rng.normal(0.0, 0.03))
        lane.correct(-seen, math.nan, 1.0, (0.0, 0.0), learn=False)
    return lane


@pytest.mark.parametrize(("modelled", "low", "high"), [(True, 0.3, 1.2), (False, 1.3, 9.0)])
def test_the_lane_knows_its_error_where_what_lasts_is_counted(
    monkeypatch: pytest.MonkeyPatch, modelled: bool, low: float, high: float
) -> None:
    """The normalised squared error of the blade's offset; without it, pictures that err alike would
    each count anew."""
    if not modelled:
        monkeypatch.setattr(edge, "LASTING_SIGMA_M", 0.0)
    rng = np.random.default_rng(5)
    squared = []
    for _ in range(120):
        lane = followed(rng)
        squared.append((lane.blade_offset_m / lane.offset_sigma_m) ** 2)
    assert low < float(np.mean(squared)) < high


def test_against_the_true_edge_a_lane_errs_by_what_all_pictures_err_alike_too() -> None:
    lane = followed(np.random.default_rng(1))
    assert lane.true_offset_sigma_m == pytest.approx(
        math.hypot(lane.offset_sigma_m, SIGHT_SIGMA_M), rel=0.02
    )


def test_a_picture_from_the_same_place_is_hardly_a_second_measurement() -> None:
    machine = OnLane(VEHICLE)
    machine.predict(at(0.0))
    lane = machine.lane
    for _ in range(200):
        lane.correct(0.0, math.nan, 1.0, (0.0, 0.0))
    assert lane.offset_sigma_m >= edge.LASTING_SIGMA_M
