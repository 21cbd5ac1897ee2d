"""Look at the edge: stand until the blade's dust has settled and the edge is in view again."""

from __future__ import annotations

from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.context import STAND_S, Context
from host.pilot.phase import Doing, Phase, Reason
from host.pilot.sight import UNSEEN_M, Gaze


class Why(Reason):
    """Out of the look."""

    SEEN = Doing.FOLLOW, "the edge is in view again"
    NO_CLEARER = Doing.FOLLOW, "no clearer view: by dead reckoning"


def rolls_on(context: Context, now: float) -> bool:
    """Whether the machine is still on its way to a stand. A blade that stops first pushes the last
    crop over instead of cutting it."""
    return now - context.since < STAND_S and not context.standing(now)


class LookAtEdge(Behaviour):
    """See the module."""

    phase = Phase.HESITATE
    gaze = Gaze(on_side=True, hesitates=True, settles=True)
    reasons = (Why,)

    def step(self, now: float) -> Step:
        context = self.context
        if rolls_on(context, now):
            return context.hold(blade=True), None
        if context.sight.unseen_m(context.motion) < UNSEEN_M:
            return context.hold(), Why.SEEN.go()
        return context.hold(), Why.NO_CLEARER.go() if context.look.over(now) else None
