"""What the plan has left standing: whether it is still gone to, and what of it stays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from host.core.vehicle import Vehicle
from host.route.left_over import Gathering, LeftOver, Ring

ASTRAY_SHARE: Final = 0.08
"""Of the field, for crop that stands where the plan has none: beginnings without room were up to
0.035 of it, swaths beside a boundary that was said 3 m too long 0.055, and 0.12 where the machine
had lost its place by 2 m (model fields 10840 to 10999, `daranti-hil beliefs`)."""
ASTRAY_M2: Final = 4.0
"""And so much of any: what places err by, along the borders of a field of 30 m2."""
GETS_ON_M: Final = 5.0
"""Of crop, that a machine which did not get on must have cut elsewhere to try at another place
again: what a try costs, in time. Smaller: it tries in vain for longer; larger: short strips do not
count."""


class Remains:
    """Of one run. `known`: the blade's way in this run tells of all that was cut."""

    def __init__(self, vehicle: Vehicle, *, known: bool) -> None:
        self.left = LeftOver(vehicle)
        self.ended_by = ""
        """What the harvest would have ended with, but for what is still to be gathered."""
        self._tried_at_m = -math.inf
        """How far the blade had cut when the machine last went elsewhere."""
        self.over = not known
        """Whether nothing is left to go to, or nobody knows where."""
        self.planned_m2 = math.inf
        """What the plan itself has left, when it ended."""
        self._strip: shapely.Polygon | None = None
        """What the present strip is to gather."""

    def gives_up(self, cut_m: float) -> bool:
        """With a doubt for a person to decide, after the blade has cut so far, the machine goes
        elsewhere. False: it has gained too little since it last did."""
        gets_on = cut_m >= self._tried_at_m + GETS_ON_M
        if gets_on:
            self._tried_at_m = cut_m
        return gets_on

    def begins(self, cut_m: float, reason: str, planned_m2: float) -> None:
        """The plan is over, for that reason, and has left so much."""
        self._tried_at_m = max(self._tried_at_m, cut_m)
        self.ended_by, self.planned_m2 = reason, planned_m2

    def take(self, swaths: Sequence[NDArray[np.float64]], most: int) -> bool:
        """Takes that many more of the swaths; False once all are."""
        more = swaths[self.left.swaths : self.left.swaths + most]
        for swath in more:
            self.left.take(swath)
        return bool(more)

    def explained(self, boundary: Ring, keep_outs: Sequence[Ring]) -> bool:
        """Whether no more stands by the blade's way than the plan has left itself, but for what
        places err by: swaths that lie elsewhere in the field were cut by a machine that had lost
        its place."""
        left_m2 = sum(part.area for part in self.left.parts(boundary, keep_outs))
        area_m2 = float(shapely.Polygon(boundary).area)
        return bool(left_m2 <= self.planned_m2 + max(ASTRAY_SHARE * area_m2, ASTRAY_M2))

    def go_to(self, strip: Gathering) -> None:
        """It is the present one."""
        self._strip = strip.area

    def no_way(self) -> None:
        """None leads to the present strip from here."""
        if self._strip is not None:
            self.left.set_aside(self._strip)
        self._strip = None

    def leave(self) -> None:
        """The present strip is over, and no other is laid through it."""
        if self._strip is not None:
            self.left.tried(self._strip)
        self._strip = None

    def nothing_stands(self) -> None:
        """Pictures show no crop of the present strip: if it was to gather what others have left, by
        the blade's way, the places of then were wrong."""
        if self._strip is not None:
            self.left.gone(self._strip)

    def end(self, boundary: Ring, keep_outs: Sequence[Ring]) -> float:
        """Nothing more can be gone to. What stays, m²."""
        self.over = True
        return float(sum(part.area for part in self.left.parts(boundary, keep_outs)))
