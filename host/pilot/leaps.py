"""What an edge must show to be believed that lies far from its lane."""

from __future__ import annotations

import math
from typing import Final

LEAP_M: Final = 0.35
"""An edge that lies farther from the lane has leapt: one picture is not enough to believe it. In
dust, one that has leapt inside, but no farther than the blade is wide, is a patch of weeds' in the
crop's face or the border of the dust. Nearer ones are right: of the detector's sure pictures in
dust 5 % err by 0.06 m inside and 13 % outside (library of the model eyes)."""
LEAP_PICTURES, ALIKE_M = 3, 0.15
"""Sure pictures in a row that must show it, each within so much of the one before. The gate of a
lane that a turn has left known to a third of a metre lets another strip's edge pass, and one
picture in a hundred shows that."""
LEAP_STAYS_S: Final = 2.0
"""It is believed when it stays that long after the blade was last turning."""


class Leaps:
    """Counts the sure pictures in a row that show one."""

    def __init__(self) -> None:
        self._last_m, self._count = math.nan, 0

    def forget(self) -> None:
        """A picture that is not sure, or shows the edge where the lane is."""
        self._last_m, self._count = math.nan, 0

    def confirmed(self, leap_m: float) -> bool:
        """Whether a sure picture's edge, leap_m left of the lane's, is near it, or the pictures
        before show it there, too."""
        if abs(leap_m) <= LEAP_M:
            self.forget()
            return True
        self._count = self._count + 1 if abs(leap_m - self._last_m) < ALIKE_M else 1
        self._last_m = leap_m
        return self._count >= LEAP_PICTURES


def is_dusts(leap_m: float, blade_width_m: float, blade_ago_s: float) -> bool:
    """Whether an edge that lies so far inside is rather a patch of weeds' or the dust's: the blade
    has turned blade_ago_s before."""
    return LEAP_M < leap_m < blade_width_m and blade_ago_s < LEAP_STAYS_S
