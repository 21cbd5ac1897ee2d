"""Regain: the machine has come off its crop, which stands beside it, or has clear ground before it
where the plan has crop. Back along its own way, the blade off, to before where it came off, and on
along the edge as it has been seen from there.

It drives over no ground that it has not been on along this strip: forward again, clear ground is
allowed as far as it was before (host.estimate.cut_guard).
"""

from __future__ import annotations

import math

from host.field.areas import Verdict
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.context import Context
from host.pilot.gaze import Gaze
from host.pilot.phase import Doing, Go, Phase, Reason

RUN_UP_M = 2.0
"""Before where the machine came off: the way in which it moves aside by most of a blade's width."""
MOST_M = 5.0
"""Of the way back."""


class Why(Reason):
    """Out of it."""

    BACK = Doing.FOLLOW, "back beside the crop: along its edge"


class Regain(Behaviour):
    """See the module."""

    phase = Phase.HESITATE
    gaze = Gaze(on_side=True)
    reasons = (Why,)

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._to_m = -math.inf
        """The travelled distance to go back to."""
        self._backs = False

    def enter(self, now: float) -> None:
        del now
        context = self.context
        back_m = min(MOST_M, context.estimate.cut.clear_m + RUN_UP_M)
        begun_at = context.sight.ahead.begun_at
        least_m = begun_at.distance_m if begun_at is not None else -math.inf
        self._to_m = max(least_m, context.motion.distance_m - back_m)
        context.regained.append(context.estimate.cut.cut_m)
        # Edges that led off the crop agreed with the lane, and do not speak for it.
        context.sight.agreed_m = 0.0
        context.strip.sought = True
        context.bare = 0

    def step(self, now: float) -> Step:
        context = self.context
        self._backs = self._backs or context.standing(now)
        coast = abs(context.motion.speed_mps) * context.vehicle.drive_lag_s
        if context.motion.distance_m - coast < self._to_m:
            return self._over()
        speed = -context.vehicle.manoeuvre_speed_mps if self._backs else 0.0
        return context.drive(-context.estimate.odometry.trim_rad, speed, blade=False), None

    def blocked(self, now: float, verdict: Verdict) -> Go | None:
        """No farther back than the geofence lets it."""
        del now, verdict
        return self._over()[1]

    def _over(self) -> Step:
        self.context.estimate.cut.go_back()
        self.context.sight.ahead.go_on()
        return self.context.hold(), Why.BACK.go()
