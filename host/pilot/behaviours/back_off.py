"""Back off: the edge is lost. Stand until it is in view again; after a while back over the swath,
the blade off: crop that filled the picture is a face again. Once for each time that it is lost, a
few times for each side."""

from __future__ import annotations

from dataclasses import replace

from host.core.messages import Command
from host.estimate.odometry import Motion
from host.field.areas import Verdict
from host.pilot import steering_law
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.behaviours.follow import LANE_SIGMA_M
from host.pilot.context import RESUME_AFTER_S, SLOW_AFTER_S, Context
from host.pilot.endings import Elsewhere, Patience, SideEnd, end_by_plan, gave_up
from host.pilot.gaze import Gaze
from host.pilot.phase import Doing, Go, Phase, Reason

BACK_AFTER_S = 6.0
BACK_M = 0.6
"""Less than clear ground that ends a side."""
LOOKED_S = 12.0
"""After so long without an edge, and having backed off, it goes on at a strip's beginning, and
leaves one that is all but cut."""
END_REST_M = 0.5
"""Of such a one, at most: there the edge is often none, a last tip or an earlier round's rest."""
BACKS = 3
"""At most, on a side."""


class Why(Reason):
    """Out of the doubt."""

    SEEN = Doing.FOLLOW, "the edge is in view again"
    OWN_CROP = Doing.FOLLOW, "no clearer view, in crop that is surely the field's"


class BackOff(Behaviour):
    """See the module."""

    phase = Phase.HESITATE
    gaze = Gaze(on_side=True, hesitates=True)
    reasons = (Why, SideEnd, Elsewhere, Patience)

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._from: Motion | None = None
        """Where the machine began to back; None while it stands."""
        self._backed = False

    def step(self, now: float) -> Step:
        context, seen = self.context, self.context.sight.seen
        go = gave_up(context, now)
        if go is not None:
            return context.stop(), go
        known = context.estimate.lane.offset_sigma_m < LANE_SIGMA_M
        if known and seen.held_s > RESUME_AFTER_S and now - seen.stamp < SLOW_AFTER_S:
            return context.hold(), Why.SEEN.go()
        backed = self._from is None and (self._backed or context.backs >= BACKS)
        if backed and now - context.since > LOOKED_S:
            if context.goes_unseeing(now):
                return context.hold(), Why.OWN_CROP.go()
            if context.strip.placed and context.strip.left_m() < END_REST_M:
                go = end_by_plan(context, now)
                if go is not None:
                    return context.hold(), go
        return self._move(now), None

    def blocked(self, now: float, verdict: Verdict) -> Go | None:
        del now, verdict
        self._from = None
        return None

    def paused(self, now: float) -> None:
        super().paused(now)
        self._backed = False

    def _move(self, now: float) -> Command:
        context, motion = self.context, self.context.motion
        sees = now - context.sight.usable.stamp < SLOW_AFTER_S
        if self._from is None:
            due = now - context.since > BACK_AFTER_S and not self._backed
            cut_m = context.cut_m if context.sight.ahead.entered else 0.0
            clear = cut_m > BACK_M or context.guard.fenced
            if due and sees and context.backs < BACKS and clear:
                self._from, self._backed = motion, True
                context.backs += 1
            return context.hold()
        coast = abs(motion.speed_mps) * context.vehicle.drive_lag_s
        if not sees or self._from.distance_m - motion.distance_m + coast > BACK_M:
            self._from = None
            return context.hold()
        estimate, vehicle = context.estimate, context.vehicle
        steer = steering_law.back(estimate.lane, vehicle)
        steer -= estimate.odometry.trim_rad
        backing = context.drive(steer, -vehicle.manoeuvre_speed_mps, blade=False)
        return replace(backing, reason=f"backing off to look again: {context.reason}")
