"""The end of a side's crop, for the position along it."""

from __future__ import annotations

import math

from host.estimate.kalman import Measurement
from host.estimate.measurements.border import BOUNDARY, SLANT_SHARE, Across, border, slant
from host.estimate.place import Place

SIGMA_M = 0.15
"""Where it slants, a border that lies a little askew is met elsewhere by the square of 1/cos as
much, and dust hides its last tip."""
EARLY_M = 0.1
"""The last crop before the blade is too shallow a strip to look like crop: vision loses it 0.14 m
before its end from the mast, at 0.05 m from the low camera; docs/understand/vision/measured.md has
figures of more edges."""


def end(place: Place, ago_m: float, doubt_m: float, across: Across = BOUNDARY) -> Measurement:
    """The blade met it, and has travelled ago_m since, give or take doubt_m."""
    side = place.side
    slope = slant(side.edge_end_m, side.width_m)
    sigma = math.hypot(SIGMA_M * (1 + slope**2), SLANT_SHARE * side.end_seen_m, doubt_m)
    seen = side.length_m - side.end_seen_m - EARLY_M
    return border("end", place, seen + ago_m, sigma, -slope, across, way=1)
