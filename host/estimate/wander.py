"""How an edge lies beside its lane's straight line: what the filter's states WANDER and WANDER_YAW
hold."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from host.estimate.kalman import Array
from host.estimate.states import LANE_OFFSET, LANE_YAW, WANDER, WANDER_YAW

SQRT_3: Final = math.sqrt(3.0)
"""Over the length scale, the rate at which such a process forgets."""


class Wander(NamedTuple):
    """How an edge, and what the detector makes of it, lie beside the lane's straight line: a
    first-order Gauss-Markov process along the way. Longer waves are the lane's."""

    sigma_m: float
    over_m: float
    """The way over which it is another's."""
    smooth: bool = False
    """Whether the edge bends: then the process is of the second order (Matern's with 3/2,
    Rasmussen and Williams 2006, 4.2.1), and over_m its length scale. An edge has a direction then,
    and not only a place."""

    @property
    def sigma_rad(self) -> float:
        """Of that direction."""
        return SQRT_3 * self.sigma_m / self.over_m if self.smooth else 0.0


DRILLED = Wander(0.02, 0.5)
"""Of a straight edge, the detector's error alone: RMSE in clean air (docs/understand/vision.md).
What dust adds is judged before (host.pilot.sight)."""
CUT = Wander(0.035, 0.7)
"""Of an edge that the machine has left, its way too: 0.03 m RMS beside the straight line (81 strips
of 8 random fields, from the fourth metre on)."""
BENT = Wander(0.12, 3.0, smooth=True)
"""Of an edge that bends beside the straight pieces of its plan. A boundary that was recorded point
by point is thinned to 0.3 m (host.field.survey, host.field.corners): 0.12 m RMS."""
TRIMMED = Wander(0.2, 10.0)
"""Of a side's first crop, which the turn before may have trimmed, by up to 0.35 m (model field
11335): what pictures show of it errs alike all the way there. Narrower: they turn a machine that
knows better; wider: one that a turn has left askew finds its lane later."""
BESIDE = Wander(0.12, 2.0)
"""Of the next strip's edge as a machine sees it that backs beside it: an edge that the machine has
left, and what the detector errs of crop beside its way (docs/understand/vision.md)."""
PRESSED = Wander(0.3, 10.0)
"""Of an edge where wheels have pressed down the crop: the detector looks for the right end of what
stands before the blade, and what it then takes of an edge at the picture's border is 0.2 to 0.3 m
off, all along."""


def begin(
    states: Sequence[Array], covariances: Sequence[Array], wander: Wander, *, goes_on: bool
) -> None:
    """Nothing is known of an edge that wanders so; where it `goes_on` from one that was seen, only
    of its direction. `states` are written to, and `covariances`."""
    sigmas = {WANDER_YAW: wander.sigma_rad}
    if not goes_on:
        sigmas[WANDER] = wander.sigma_m
    for state, sigma in sigmas.items():
        for x in states:
            x[state] = 0.0
        for p in covariances:
            p[state, :] = p[:, state] = 0.0
            p[state, state] = sigma**2


def into_lane(
    states: Sequence[Array], covariances: Sequence[Array], along_m: float, turned: Array
) -> None:
    """The lane goes through where its edge was seen along_m past its beginning, and runs as before.
    It errs as the machine did that has seen it: there by what the machine's place errs, and in
    direction by what its yaw does. `turned`: (states,) the derivative of how far the machine is
    turned against the lane as the plan has it."""
    for x in states:
        x[LANE_OFFSET] += x[WANDER]
    for p in covariances:
        for q in (p, p.T):
            lane_yaw = turned @ q
            q[LANE_OFFSET] += q[WANDER] + along_m * (q[LANE_YAW] - lane_yaw)
            q[LANE_YAW] = lane_yaw
