"""Each measurement's derivative is that of its own expectation, the corners of a walked boundary
among the states: held against finite differences, not against another formula."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from host.core.vehicle import Vehicle
from host.estimate.kalman import Array, Measurement
from host.estimate.measurements import begin, edge, end
from host.estimate.outline import Outline
from host.estimate.place import Place
from host.estimate.states import STATES, YAW, X, Y
from host.route.plan import spiral

VEHICLE = Vehicle()
RING = [(0.0, 0.0), (14.0, 1.0), (13.0, 10.0), (1.0, 9.0)]
STEP = 1e-5


def seen(place: Place) -> Measurement:
    return edge.edge(place, 0.1, math.nan, 1.0, (0.0, 0.0), 0.4)


def begun(place: Place) -> Measurement:
    return begin.begin(place, np.eye(len(place.x)), 0.2)


def ended(place: Place) -> Measurement:
    return end.end(place, np.eye(len(place.x)), 0.2, 0.0)


@pytest.mark.parametrize("index", [0, 1, 4, 5])
@pytest.mark.parametrize("take", [seen, begun, ended])
def test_a_measurements_derivative_is_that_of_what_it_expects(
    take: Callable[[Place], Measurement], index: int
) -> None:
    side = spiral(RING, 0, VEHICLE, sigma_m=1.0).sides[index]
    x, y, heading = side.pose(0.7 * side.length_m - VEHICLE.blade_x_m, VEHICLE.inset_m + 0.1)
    state = np.zeros(STATES + 2 * len(RING))
    state[[X, Y, YAW]] = x, y, heading + 0.05

    def innovation(change: Array) -> float:
        outline = Outline(RING)
        outline.move(change[STATES:])
        own = state + np.concatenate([change[:STATES], np.zeros(2 * len(RING))])
        place = Place(own, outline.found(side), VEHICLE.blade_x_m, VEHICLE.inset_m, outline)
        return float(take(place).innovation[0])

    at = Place(state, side, VEHICLE.blade_x_m, VEHICLE.inset_m, Outline(RING))
    stated = take(at).h[0]
    before = innovation(np.zeros(len(state)))
    for k in range(len(state)):
        change = np.zeros(len(state))
        change[k] = STEP
        slope = -(innovation(change) - before) / STEP
        # How a border slants against the strip changes too; that is left out, and small.
        assert stated[k] == pytest.approx(slope, abs=0.06 if take is seen else 0.25), k
