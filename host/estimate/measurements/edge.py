"""The crop's outer edge in a picture, for the lane: its offset, and its direction where the mount
sees one.

What one picture errs, the next errs alike for half a metre: dust, a thin patch, the border's own
unevenness. As a state of the filter (first-order Gauss-Markov along the way) that part made the
lane follow the edge more slowly: four model fields of six were cut less straight. So it is not
estimated; what the lane says of its own uncertainty has it (`Lane.offset_sigma_m`). Dust's
one-sided error is refused before (host.pilot.sight).
"""

from __future__ import annotations

import math

import numpy as np

from host.estimate.kalman import Array, Measurement
from host.estimate.states import HEADING, LANE_STATES, OFFSET

NOISE_M = 0.05
"""Of one sure picture's edge."""
LASTING_SIGMA_M = 0.035
"""Standard deviation of what lasts. The error of the detector's sure pictures of the cut is 0.03 to
0.045 m, and half of it is gone after 0.25 to 0.5 m (library of the model eyes). Larger: the
position leans less on the lane, and looks without dust come sooner."""
AHEAD_NOISE_RAD = 0.15
"""What an edge seen farther ahead errs for each metre: pictures show no direction, and a side's
first crop may have been trimmed by the turn before."""
DIRECTION_NOISE_RAD = math.radians(2.5)
DOUBT = 3.0
"""Noise of a picture without confidence, in times more than a sure one's."""
GATE = (9.0, 11.8)
"""Three sigma of one component (offset) or of two (offset and direction)."""


def edge(
    x: Array,
    blade_x_m: float,
    edge_offset_m: float,
    edge_heading_rad: float,
    confidence: float,
    since: tuple[float, float],
    ahead_m: float,
) -> Measurement:
    """An edge made ahead_m before the blade's line (NaN heading: not seen). `since` is (distance
    travelled, yaw turned) from the shutter to now."""
    step, turn = since
    at = blade_x_m + ahead_m
    heading = x[HEADING] - turn
    offset = x[OFFSET] - step * math.sin((heading + x[HEADING]) / 2)
    doubt = 1.0 + DOUBT * (1.0 - confidence)
    h = np.zeros((1, LANE_STATES))
    h[0, [OFFSET, HEADING]] = 1.0, at * math.cos(heading)
    expected = offset + at * math.sin(heading)
    z = [-edge_offset_m * math.cos(heading) - expected]
    variances = [(NOISE_M * doubt) ** 2 + (AHEAD_NOISE_RAD * ahead_m) ** 2]
    if math.isfinite(edge_heading_rad):
        h = np.vstack([h, np.zeros(LANE_STATES)])
        h[1, HEADING] = 1.0
        z.append(-edge_heading_rad - heading)
        variances.append((DIRECTION_NOISE_RAD * doubt) ** 2)
    gate = GATE[len(z) - 1]
    return Measurement("edge", h, np.array(z), np.array(variances), gate)
