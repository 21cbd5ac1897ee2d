"""A stop to look without the blade's dust, for the edge or for the end of a side."""

from __future__ import annotations

import math
from typing import Final

LOOKING: Final = "looking without the blade's dust"
LOOK_S: Final = 3.0
LONG_LOOK_S: Final = 5.0
SETTLE_S: Final = 1.0
"""Of a look, until most of the dust has settled; of a long one all but as much as of the other is
for that: where the plan has crop, and no wind takes the dust away."""


class Look:
    """The present look, or the last."""

    def __init__(self) -> None:
        self._until = math.inf
        self.at_m = -math.inf
        """The travelled distance where it was begun."""

    def begin(self, now: float, at_m: float, time_s: float = LOOK_S) -> None:
        """From now on, for time_s at most."""
        self._until, self.at_m = now + time_s, at_m

    def settled(self, stamp: float) -> bool:
        """Whether the dust has had its time to settle."""
        return self._until - stamp <= LOOK_S - SETTLE_S

    def over(self, now: float) -> bool:
        """Whether that was long enough."""
        return now > self._until
