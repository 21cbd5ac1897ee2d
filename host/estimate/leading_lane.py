"""The lane of a strip that others have left: it leads the machine, and tells nothing of its place.

Its edge lies along no border, and where the strips beside it were cut is known by the places of
then. So it is known from the machine, as well as that knows where it is to be found, and what
pictures show of it moves the lane alone. Known in the field instead, it would take no more of what
is seen than its share of what both are unsure of: a place that is known to half a metre left three
quarters of each sure picture's edge untaken (model field 11288).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from host.estimate.kalman import Array
from host.estimate.place import Place
from host.estimate.states import LANE, LANE_OFFSET, LANE_YAW, WANDER

LEADING: Final = (LANE_OFFSET, LANE_YAW, WANDER)
"""What leads the machine along an edge."""


def others(states: int) -> tuple[int, ...]:
    """The rest of so many."""
    return tuple(k for k in range(states) if k not in LEADING)


def tie(p: Array, place: Place) -> None:
    """Ties the lane to the machine that is at `place` beside it, in the covariance `p`, in place:
    how far it lies from there, and how the machine is turned against it, are as sure as before, and
    err by nothing that the machine's place errs by."""
    along_m = place.blade_m
    seen = np.array([place.ahead(place.blade_x_m, along_m), place.turned()])
    seen[1, LANE_YAW] = -1.0
    errs = seen @ p @ seen.T
    place_of = seen.copy()
    place_of[:, LANE] = 0.0
    # Its offset counts from the side's beginning: at the machine it is that and what it has turned.
    to_begin = np.array([[1.0, -along_m], [0.0, 1.0]])
    by_place = to_begin @ place_of
    p[LANE, :] = by_place @ p
    p[:, LANE] = p[LANE, :].T
    p[LANE, LANE] = by_place @ p @ by_place.T + to_begin @ errs @ to_begin.T
