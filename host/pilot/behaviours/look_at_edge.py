"""Look at the edge: stand until the blade's dust has settled and the edge is in view again."""

from __future__ import annotations

from host.estimate.crop_ahead import CLEAR_M, EndOfField
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.context import STAND_S, Context
from host.pilot.endings import Elsewhere, SideEnd, end_by_plan, end_side
from host.pilot.gaze import Gaze
from host.pilot.phase import Doing, Go, Phase, Reason
from host.pilot.sight import UNSEEN_M

EDGE_KNOWN_M = 2.0
"""Along an edge, to know it: longer than a false end, or a patch beside it, is in view."""


class Why(Reason):
    """Out of the look."""

    SEEN = Doing.FOLLOW, "the edge is in view again"
    LOOKS_AGREE = Doing.FOLLOW, "no look is sure of the edge, but this and the last agree"
    NO_CLEARER = Doing.FOLLOW, "no clearer view: by dead reckoning"
    STILL_TO_FIND = Doing.BACK_OFF, "no clearer view of a side that is still to be found: {why}"


def rolls_on(context: Context, now: float) -> bool:
    """Whether the machine is still on its way to a stand. A blade that stops first pushes the last
    crop over instead of cutting it."""
    return now - context.since < STAND_S and not context.standing(now)


class LookAtEdge(Behaviour):
    """See the module."""

    phase = Phase.HESITATE
    gaze = Gaze(on_side=True, settles=True)
    reasons = (Why, SideEnd, Elsewhere)

    def step(self, now: float) -> Step:
        context = self.context
        if rolls_on(context, now):
            return context.hold(blade=True), None
        seen, over = context.sight.unseen_m(context.motion) < UNSEEN_M, context.look.over(now)
        if seen and (over or not self._to_believe()):
            return context.hold(), Why.SEEN.go()
        return context.hold(), self._go_on(now) if over else None

    def _to_believe(self) -> bool:
        """Whether the lane refuses the edge, and is to come to believe it where that stays in view:
        on an edge that few pictures have shown yet they are as likely to have been wrong. One along
        which the machine has driven for longer outlasts a patch of weeds."""
        context = self.context
        edge_m = context.strip.along_edge_m(context.motion)
        known_m = min(context.sight.agreed_m, edge_m)
        return context.estimate.lane.contradicted and known_m < EDGE_KNOWN_M

    def _go_on(self, now: float) -> Go | None:
        """After a look that showed no edge. Where the side may end, only crop at the blade leads
        on: what stands beyond clear ground is somebody else's. Where nobody has seen its end
        before, that holds anywhere."""
        context = self.context
        view, strip = context.sight.view, context.strip
        if context.sight.take_looks():
            return Why.LOOKS_AGREE.go()
        sees = view is not None and context.sight.sees_ahead()
        clear = sees and view is not None and view.crop_ahead_m >= CLEAR_M
        if clear and context.sight.ahead.entered and strip.end_due(context.motion):
            here = EndOfField(now, context.motion)
            return end_side(context, now, here, looked=True)
        if strip.placed and strip.left_m() <= 0.0 and strip.gap_beyond() is not None:
            # Crop without an edge, past where the plan has the boundary, may be the neighbour's.
            go = end_by_plan(context, now)
            if go is not None:
                return go
        if not strip.new or view is None or (sees and not clear):
            return Why.NO_CLEARER.go()
        if not sees:
            return Why.STILL_TO_FIND.go(why=context.why_unseen("nothing sure"))
        return Why.STILL_TO_FIND.go(why=f"clear ground for {view.crop_ahead_m:.1f} m")
