"""The beginning of a side's crop, for the position along it."""

from __future__ import annotations

import math

from host.estimate.kalman import Array, Measurement
from host.estimate.measurements.border import SLANT_SHARE, SLOPE_MOST, border
from host.estimate.place import Place

SIGMA_M = 0.25
"""Of the beginning by the first picture that shows crop at the blade: the detector's own promise
(`CropView.ahead_confidence`)."""


def begin(place: Place, p: Array, ago_m: float) -> Measurement:
    """The blade met it, and has travelled ago_m since."""
    side = place.side
    sigma = math.hypot(SIGMA_M, SLANT_SHARE * side.begin_seen_m)
    slope = min(SLOPE_MOST, side.edge_begin_m / side.width_m)
    return border("begin", place, p, side.begin_seen_m + ago_m, sigma, slope, way=-1)
