"""Crop that goes on from what is being cut is the field's own: its end lies farther on.

No measurement of where, but a bound: of the normal distribution of the end's distance what lies
before the bound is cut off, and the mean is that of the rest (moments of the truncated normal
distribution; Simon and Simon, Int. J. Systems Science 41(2), 2010). A boundary that was walked
short gives way to crop that stands, one that was walked long waits for the end that is seen.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from host.estimate.kalman import Array
from host.estimate.place import Place
from host.estimate.states import X, Y

LIKELY: Final = -2.0
"""The bound in standard deviations from the mean: farther before it cuts off next to nothing."""
FARTHEST: Final = 6.0
"""And after it: nothing is left of the distribution but its bound."""


def to_border(place: Place, way: int) -> Array:
    """(states,) the derivative of how far the blade is before the side's end (way 1) or its
    beginning (-1)."""
    c, s = place.direction
    h = np.zeros(len(place.x))
    h[X], h[Y] = -c, -s
    h[place.outline.at] = place.outline.end(place.side, way)
    return h


def goes_on(bound_m: float, mean_m: float, sigma_m: float) -> tuple[float, float] | None:
    """Mean (m) and variance (m²) of where a side ends that was taken to end at mean_m, give or take
    sigma_m, before anything was seen of it, now that crop was seen to go on to bound_m along it;
    None where that changes nothing. Each time from what was taken first: cut off step by step, the
    normal distribution loses its tail."""
    bound = (bound_m - mean_m) / sigma_m
    if bound < LIKELY:
        return None
    bound = min(bound, FARTHEST)
    density = math.exp(-bound * bound / 2) / math.sqrt(math.tau)
    hazard = density / (math.erfc(bound / math.sqrt(2)) / 2)
    mean = max(bound_m, mean_m + sigma_m * hazard)
    return mean, sigma_m**2 * (1.0 - hazard * (hazard - bound))
