"""Gather: at the plan's end, go to what it has left standing, strip by strip, over ground that is
cut. One such strip is chosen while the machine stands."""

from __future__ import annotations

from host.core.frames import Pose2
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.gaze import Gaze
from host.pilot.phase import Doing, Phase, Reason

SWATHS = 3
"""Taken at each step: each took 5 ms of its 50 in the median, and 8 in 99 of 100, of a field of
51 ha with 120 corners, on one core of a server; the choice of a strip took 47 ms."""


class Why(Reason):
    """Out of gathering."""

    STRIP = Doing.TURN, "{side}: on to what was left standing there, some {area} m2"
    NOTHING = Doing.FINISH, "{reason}"


class Gather(Behaviour):
    """See the module."""

    phase = Phase.TURN
    gaze = Gaze(lane=False)
    reasons = (Why,)

    def enter(self, now: float) -> None:
        del now
        self.context.estimate.swaths.end()
        self.context.remains.leave()
        self.context.reckon_with_gap()

    def step(self, now: float) -> Step:
        context, remains = self.context, self.context.remains
        if not context.standing(now):
            return context.hold(), None
        if remains.take(context.estimate.swaths.past, SWATHS):
            return context.hold(), None
        corners, outs = context.as_found
        here, permitted = Pose2(*context.estimate.position.pose), context.guard.permitted
        sure = context.place_known and (context.gathering or remains.explained(corners, outs))
        if not (sure or context.gathering):
            # Where its swaths lie is not known: what stands is as the plan has it.
            remains.over = True
            return context.hold(), Why.NOTHING.go(reason=remains.ended_by)
        strips = remains.left.strips(corners, outs, here, permitted) if sure else []
        if strips:
            context.go_gather(now, strips[0])
            area = f"{strips[0].area.area:.1f}"
            return context.hold(), Why.STRIP.go(side=context.strip.name, area=area)
        context.end_gathering()
        return context.hold(), Why.NOTHING.go(reason=remains.ended_by)
