"""What pictures may tell while a behaviour is active, and since when they tell it."""

from __future__ import annotations

import math
from dataclasses import dataclass

STOP_AFTER_S = 0.8
"""Without a picture to be believed, or without the edge, the machine stops."""


class Steady:
    """Since when something holds. After a gap of STOP_AFTER_S it has to prove itself anew."""

    def __init__(self) -> None:
        self.stamp = -math.inf
        """When it last held."""
        self.broken = -math.inf

    @property
    def held_s(self) -> float:
        """For how long without a break."""
        return self.stamp - self.broken

    def note(self, stamp: float, holds: bool) -> None:
        """What a picture says of it."""
        if not holds or stamp - self.stamp > STOP_AFTER_S:
            self.broken = stamp
        if holds:
            self.stamp = stamp


@dataclass(frozen=True, slots=True)
class Gaze:
    """What pictures may tell while a behaviour is active."""

    looks: bool = True
    """Pictures are looked at at all."""
    lane: bool = True
    """An edge may be the lane's."""
    cutting: bool = False
    """The machine drives along a side, its blade's dust in the air."""
    on_side: bool = False
    """The crop ahead is the side's that is being cut."""
    begins: bool = False
    """Crop before the blade is where the side begins."""
    ends: bool = False
    """Clear ground before the blade counts towards the side's end."""
    settles: bool = False
    """Nothing is believed before the dust has settled."""
