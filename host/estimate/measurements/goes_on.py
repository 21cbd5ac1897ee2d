"""Crop that goes on from what is being cut is the field's own: its end lies farther on.

No measurement of where, but a bound: of the normal distribution of the end's distance what lies
before the bound is cut off, and the rest is taken for normal again (moments of the truncated normal
distribution; Simon and Simon, Int. J. Systems Science 41(2), 2010). A boundary that was walked
short gives way to crop that stands, one that was walked long waits for the end that is seen.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from host.estimate.kalman import Array
from host.estimate.place import Place
from host.estimate.states import STATES, YAW

KNOWN_M: Final = 0.15
"""Standard deviation of the end's distance below which nothing is to be learned."""
LIKELY: Final = -2.0
"""The bound in standard deviations from the mean: farther before it cuts off next to nothing."""


def to_end(place: Place) -> Array:
    """(states,) the derivative of how far the blade is before the side's end."""
    c, s = place.direction
    h = np.zeros(len(place.x))
    h[:YAW] = -c, -s
    h[STATES:] = place.outline.end(place.side, 1)
    return h


def goes_on(place: Place, p: Array, seen_m: float) -> tuple[Array, float, float] | None:
    """The end lies at least seen_m before the blade: (the derivative of its distance, by how much
    that is more than was thought, its variance then); None where nothing is learned of it."""
    h = to_end(place)
    sigma = math.sqrt(h @ p @ h)
    if sigma < KNOWN_M:
        return None
    bound = (seen_m - (place.side.length_m - place.blade_m)) / sigma
    if bound < LIKELY:
        return None
    density = math.exp(-bound * bound / 2) / math.sqrt(math.tau)
    beyond = max(math.erfc(bound / math.sqrt(2)) / 2, 1e-6)
    hazard = max(density / beyond, bound)
    return h, sigma * hazard, sigma**2 * max(0.05, 1.0 - hazard * (hazard - bound))
