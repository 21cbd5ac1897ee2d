"""How the edge that a strip has left lies beside its lane's straight line.

An edge that bends is planned in straight pieces, which lie some decimetres beside it: nobody has
surveyed it better. The machine that has driven along it once knows better, and the next strip finds
that edge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from host.estimate.kalman import Array

STEP_M: Final = 0.25
"""Between two points of a profile."""
SMOOTH_M: Final = 0.5
"""Standard deviation of what smooths it: the machine's own way about an edge, which the next strip
would copy and add to, is shorter; what pieces of some metres leave of a bend is longer."""


class Profile(NamedTuple):
    """`left_m[k]`: how far left of its lane's straight line the edge lies, first_m + k STEP_M past
    the lane's beginning. Before and behind it goes on as it begins and ends."""

    first_m: float
    left_m: Array
    """(n,)"""
    slopes: Array
    """(n,) its derivative."""

    @property
    def known(self) -> bool:
        """Whether anything is."""
        return len(self.left_m) > 0

    def at(self, along_m: float) -> float:
        """m left of the line."""
        return self._read(self.left_m, along_m)

    def slope(self, along_m: float) -> float:
        """The edge's direction there, as a tangent, left of the line's."""
        return self._read(self.slopes, along_m)

    def _read(self, values: Array, along_m: float) -> float:
        last = len(values) - 1
        if last < 0:
            return 0.0
        place = min(max((along_m - self.first_m) / STEP_M, 0.0), float(last))
        k = min(int(place), max(0, last - 1))
        here = values.item(k)
        return here if last == 0 else here + (place - k) * (values.item(k + 1) - here)

    def begun(self, later_m: float) -> Profile:
        """The same of a lane that begins so much later."""
        return self._replace(first_m=self.first_m - later_m)


STRAIGHT: Final = Profile(0.0, np.empty(0), np.empty(0))
"""Nothing is known but the line."""


def profile_of(way: Sequence[tuple[float, float]], offset_m: float) -> Profile:
    """Of what was cut along a lane: (how far along it, how far left of its line), ascending;
    against a line that lies offset_m left of that."""
    if not way:
        return STRAIGHT
    along, left = np.array(way).T
    left = left - offset_m
    points = 1 + math.floor((along[-1] - along[0]) / STEP_M)
    even = np.interp(along[0] + STEP_M * np.arange(points), along, left)
    smooth = gaussian_filter1d(even, SMOOTH_M / STEP_M, mode="nearest")
    slopes = np.gradient(smooth, STEP_M) if points > 1 else np.zeros(1)
    return Profile(float(along[0]), smooth, slopes)
