"""How doubtful the lane becomes by pictures that contradict it, until it yields to what they show.

A lane that a turn has left askew yields within half a metre; one that many pictures agreed on
outlasts a patch of weeds or thin crop, whose border looks like the edge.
"""

from __future__ import annotations

import math
from typing import Final

from host.estimate.states import LANE_OFFSET, LANE_YAW, YAW, X, Y

GROWTH: Final = {True: 1.03, False: 1.06}
"""Of the standard deviation of what was seen, with each contradiction, by whether the blade cuts
and its dust is in the air."""
STANDING_M: Final = 0.01
"""Two pictures taken no farther apart show one place, and err alike."""
STANDING_SHARE: Final = 0.33
"""Of that growth, for the second of them. All: a machine that waits believes within a second what
it is shown from there (model field 11435). None: it waits for an edge that has long come back."""
YAW_RAD: Final = math.radians(6.0)
"""Standard deviation of the machine's direction, up to which it is doubted too: what a turn by the
steering angle leaves. More would let edges of other strips turn a machine that has lost its own, by
40 degrees against gyroscope and courses (model field 10215)."""


def states(yaw_variance: float, *, by_gyro: bool) -> list[int]:
    """What a contradiction takes back: the machine's place, and its lane's. Its direction as well,
    unless a gyroscope tells that (`by_gyro`): an edge in steps, 0.4 m to and fro, had turned such a
    machine by 8 degrees, and off its strip (field 10578)."""
    place = [X, Y] if by_gyro or yaw_variance > YAW_RAD**2 else [X, Y, YAW]
    return [*place, LANE_OFFSET, LANE_YAW]


class Doubt:
    """Grows with the way on which pictures contradict, rather than with their number."""

    def __init__(self) -> None:
        self._at_m = math.nan

    def growth(self, distance_m: float, *, cutting: bool) -> float:
        """Of a standard deviation, by one more picture that contradicts. `distance_m`: that the
        machine has travelled; NaN: nothing shows whether it stands."""
        stands = abs(distance_m - self._at_m) < STANDING_M
        self._at_m = distance_m
        return math.pow(GROWTH[cutting], STANDING_SHARE if stands else 1.0)
