"""The lane's line, for the position: along a side the machine is where the lane is."""

from __future__ import annotations

import math

import numpy as np

from host.estimate.kalman import Measurement
from host.estimate.place import Place

NOISE_M = 0.03
"""Of the way driven beside the lane's line."""


def line(place: Place, blade_offset_m: float, sigma_m: float) -> Measurement:
    """The blade's middle blade_offset_m left of the present lane, by the lane filter. A lane that
    goes by dead reckoning alone is no measurement of its own: sigma_m is that filter's."""
    ahead, turned = place.blade_x_m, place.turned_rad
    h = place.beside() + ahead * math.cos(turned) * place.turned()
    expected = place.across_m + ahead * math.sin(turned) - place.lane_m
    return Measurement(
        "line",
        h[np.newaxis],
        np.array([blade_offset_m - expected]),
        np.array([NOISE_M**2 + sigma_m**2]),
    )
