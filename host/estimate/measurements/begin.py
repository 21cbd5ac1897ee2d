"""The beginning of a side's crop, for the position along it."""

from __future__ import annotations

import math

from host.estimate.kalman import Measurement
from host.estimate.measurements.border import BOUNDARY, SLANT_SHARE, Across, border, slant
from host.estimate.place import Place

SEEN_SIGMA_M = 0.15
"""Of the beginning as a machine sees it that backs away from it: 0.1 m for one picture, and the
first stems stand a little inside."""
MET_SIGMA_M = 0.25
EARLY_M = 0.2
"""Of the beginning by the first picture that shows crop at the blade of a machine that drives up to
it: the detector's own promise (`CropView.ahead_confidence`); it takes crop for met so long before.
"""


def begin(
    place: Place,
    ago_m: float,
    sigma_m: float = MET_SIGMA_M,
    across: Across = BOUNDARY,
) -> Measurement:
    """The blade met it, and has travelled ago_m since."""
    side = place.side
    sigma = math.hypot(sigma_m, SLANT_SHARE * side.begin_seen_m)
    slope = slant(side.edge_begin_m, side.width_m)
    met_m = side.begin_seen_m + ago_m
    return border("begin", place, met_m, sigma, slope, across, way=-1)
