"""The position's heading, for the lane: offsets alone, where vision sees no direction, could be
explained by any heading for a while."""

from __future__ import annotations

import numpy as np

from host.estimate.kalman import Array, Measurement
from host.estimate.states import HEADING, LANE_STATES


def heading(x: Array, heading_rad: float, sigma_rad: float) -> Measurement:
    """The vehicle heading_rad left of the lane's direction."""
    h = np.zeros((1, LANE_STATES))
    h[0, HEADING] = 1.0
    return Measurement("heading", h, np.array([heading_rad - x[HEADING]]), np.array([sigma_rad**2]))
