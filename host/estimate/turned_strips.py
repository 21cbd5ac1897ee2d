"""Strips that have turned, and the machine's place with them.

Each strip is cut along what the one before has left there, so strips turn round after round by what
each of them errs, and the plan's sides are found where they are: pictures, dead reckoning and lanes
agree. The boundary does not turn, and it tells little of direction once the last strip along it is
some rounds ago. That all of them may have turned by one angle is a way to err of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from host.estimate.kalman import Array
from host.estimate.outline import Outline
from host.estimate.states import YAW, X, Y
from host.route.side import Side


def as_one(x: Array, outline: Outline, lanes: Sequence[tuple[Side, int]]) -> Array:
    """(states,) how the place in the state `x` moves, and each lane (its side, the first of its two
    states), where all turn left by a radian about the middle of the outline's corners; without any,
    about the machine."""
    middle_x, middle_y = np.mean(outline.corners or [(x[X], x[Y])], axis=0).tolist()
    by = np.zeros(len(x))
    by[X], by[Y], by[YAW] = middle_y - x[Y], x[X] - middle_x, 1.0
    for side, at in lanes:
        found = outline.found(side)
        c, s = math.cos(found.heading_rad), math.sin(found.heading_rad)
        by[at] = c * (found.x_m - middle_x) + s * (found.y_m - middle_y)
        by[at + 1] = 1.0
    return by
