"""The crop's outer edge in a picture: its offset, and its direction where the mount sees one.

An edge is no straight line. What it wanders beside the lane, and what dust, a thin patch and the
detector make of it for half a metre alike, is a state of its own (WANDER, first-order Gauss-Markov
along the way): the machine follows it, but its place in the field is not where it wanders. Dust's
one-sided error is refused before (host.pilot.sight).
"""

from __future__ import annotations

import math

import numpy as np

from host.estimate.kalman import Array, Measurement
from host.estimate.place import Place
from host.estimate.states import LANE_YAW, WANDER

NOISE_M = 0.05
"""Of one sure picture's edge."""
LASTING_SIGMA_M = 0.035
"""Standard deviation of what the detector errs alike for a while: of that nothing tells the edge's
own unevenness. The error of the detector's sure pictures of the cut is 0.03 to 0.045 m, and half of
it is gone after 0.25 to 0.5 m (library of the model eyes). Larger: looks without dust come
sooner."""
AHEAD_NOISE_RAD = 0.15
"""What an edge seen farther ahead errs for each metre: pictures show no direction, and a side's
first crop may have been trimmed by the turn before."""
DIRECTION_NOISE_RAD = math.radians(2.5)
DOUBT = 3.0
"""Noise of a picture without confidence, in times more than a sure one's."""
GATE = (9.0, 11.8)
"""Three sigma of one component (offset) or of two (offset and direction)."""


def edge(
    place: Place,
    edge_offset_m: float,
    edge_heading_rad: float,
    confidence: float,
    since: tuple[float, float],
    ahead_m: float,
) -> Measurement:
    """An edge made ahead_m before the blade's line (NaN heading: not seen). `since` is (distance
    travelled, yaw turned) from the shutter to now."""
    step, turn = since
    at = place.blade_x_m + ahead_m
    now = place.turned_rad
    heading = now - turn
    along = place.blade_m - step + ahead_m
    lane_yaw = place.lane_rad(along)
    offset = place.across_m - step * math.sin((heading + now) / 2)
    doubt = 1.0 + DOUBT * (1.0 - confidence)
    h = place.ahead(at, along)
    h[WANDER] = -1.0
    expected = offset + at * math.sin(heading) - place.lane_at(along) - float(place.x[WANDER])
    z = [-edge_offset_m * math.cos(heading - lane_yaw) - expected]
    variances = [(NOISE_M * doubt) ** 2 + (AHEAD_NOISE_RAD * ahead_m) ** 2]
    rows = [h]
    if math.isfinite(edge_heading_rad):
        turned: Array = place.turned()
        turned[LANE_YAW] = -1.0
        rows.append(turned)
        z.append(-edge_heading_rad - (heading - lane_yaw))
        variances.append((DIRECTION_NOISE_RAD * doubt) ** 2)
    gate = GATE[len(z) - 1]
    return Measurement("edge", np.array(rows), np.array(z), np.array(variances), gate)
