"""How the crop's edge bends between the points at which a boundary was recorded: no polygon grows.

Along an arc an edge looks the same everywhere, and only the receiver's courses tell where on it the
machine is. Taken for straight pieces, each with its own direction, it would tell: so the machine
would believe of its direction what is true of another place, and the surer, the longer it follows.
Between its points the edge is a cubic (Hermite) with one direction at each: a ring that was thinned
strays from all of its pieces by the same, so of what it turns at a point the shorter piece beside
has the larger share. Where a corner ends it, it has no curvature.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from host.core.compiled import compiled
from host.estimate.kalman import Array
from host.route.standing import BEND_RAD

BEYOND: Final = 0.5
"""Of a recorded piece's length: so far before and behind it the edge bends on as it does at its
ends. A strip in an arc begins and ends there."""
CORNER_RAD: Final = BEND_RAD[0]
"""Points at which a boundary turns by more, to either side, are corners."""


def angles(headings: Array, lengths: Array) -> Array:
    """(n, 2) how far left of each straight piece of a ring its edge runs where it begins and where
    it ends, rad; of n directions, rad, and lengths, m."""
    count = len(headings)
    found = np.zeros((count, 2))
    turns = np.remainder(headings - np.roll(headings, 1) + math.pi, math.tau) - math.pi
    smooth = np.abs(turns) < CORNER_RAD
    before = np.roll(lengths, 1)
    found[:, 0] = np.where(smooth, -turns * before / (before + lengths), 0.0)
    found[:, 1] = np.roll(np.where(smooth, turns * lengths / (before + lengths), 0.0), -1)
    ends = np.roll(smooth, -1)
    begins_free, ends_free = ~smooth & ends, smooth & ~ends
    found[begins_free, 0] = -found[begins_free, 1] / 2
    found[ends_free, 1] = -found[ends_free, 0] / 2
    return found


@compiled("(f8, f8, f8, f8, f8, f8)")
def bow(
    begin_rad: float, end_rad: float, length_m: float, first: float, last: float, along_m: float
) -> tuple[float, float]:
    """(m, 1): how far left of its straight piece an edge lies along_m past the piece's beginning,
    and how it slopes there. The piece is what lies between two shares of a recorded one."""
    share = first + (last - first) * along_m / length_m
    t = min(1.0 + BEYOND, max(-BEYOND, share))
    whole_m = length_m / (last - first)
    left = ((t - 2.0) * t + 1.0) * t * begin_rad + (t - 1.0) * t * t * end_rad
    slope = ((3.0 * t - 4.0) * t + 1.0) * begin_rad + (3.0 * t - 2.0) * t * end_rad
    return whole_m * (left + slope * (share - t)), slope
