"""Look at the end: stand until the blade's dust has settled, to see whether the side ends here.

Without dust, no crop before the blade is the side's end, and so is what shows none in all the time
of a look. Where the plan has no end it is a bare patch, or no lane at all.
"""

from __future__ import annotations

from host.estimate.crop_ahead import EndOfField
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.behaviours.look_at_edge import rolls_on
from host.pilot.endings import Beside, Elsewhere, SideEnd, end_side, little_left, may_regain
from host.pilot.gaze import Gaze
from host.pilot.phase import Doing, Go, Phase, Reason
from host.pilot.stop_and_look import LOOKING

BARE_LOOKS = 2
"""Looks in a row at bare ground where the plan has crop, after which the next is one too many."""


class Why(Reason):
    """Out of the look, besides the side's end."""

    CROP_GOES_ON = Doing.LOOK_AT_EDGE, f"the crop goes on: {LOOKING}"
    EDGE_SEEN = Doing.FOLLOW, "the edge is in view again"
    BARE_GROUND = Doing.FOLLOW, "bare ground"
    NO_CROP_LEFT = Doing.FINISH, "no crop left on the last side"
    CROP_GONE = Doing.FAULT, "the crop that the plan has here is not to be found"


class LookAtEnd(Behaviour):
    """See the module."""

    phase = Phase.HESITATE
    gaze = Gaze(on_side=True, ends=True, settles=True)
    reasons = (Why, Beside, SideEnd, Elsewhere)

    def step(self, now: float) -> Step:
        context = self.context
        if rolls_on(context, now):
            return context.hold(blade=True), None
        return context.hold(), self._judge(now)

    def _judge(self, now: float) -> Go | None:
        context, ahead = self.context, self.context.sight.ahead
        over = context.look.over(now)
        if ahead.clear_since is None and context.strip.blind():
            # Nothing is believed of a new side's end but what shows without dust.
            here = EndOfField(now, context.motion)
            return end_side(context, now, here, looked=True) if over else None
        if ahead.clear_since is None:
            context.bare = 0
            return Why.CROP_GOES_ON.go()
        if not over and ahead.end is None:
            return None
        if context.strip.end_due(ahead.clear_since.motion):
            return end_side(context, now, ahead.clear_since, looked=True)
        if over or not context.estimate.lane.contradicted:
            return self._go_on_beyond(now)
        return None

    def _go_on_beyond(self, now: float) -> Go:
        """After a look that showed no crop where the plan has some. An edge beside the lane that
        stayed in view is the lane's."""
        context, ahead = self.context, self.context.sight.ahead
        clear, here = ahead.end is not None, ahead.clear_since
        ahead.go_on()
        seen = context.sight.edge_at_m > context.look.at_m
        context.bare = 0 if seen else context.bare + clear
        if context.bare > BARE_LOOKS:
            if context.strip.last or little_left(context):
                context.remains.nothing_stands()
                return Why.NO_CROP_LEFT.go()
            here = here or EndOfField(now, context.motion)
            end_m = context.strip.along_m(here.motion)
            if context.strip.may_end_at(end_m):
                context.strip.ends_at(end_m)
                return end_side(context, now, here, looked=True)
            if may_regain(context):
                return Beside.REGAIN.go()
            if not context.strip.beside_swath:
                return Why.CROP_GONE.go()
            # Right beside what the machine has cut it drives to the strip's end.
        return (Why.EDGE_SEEN if seen else Why.BARE_GROUND).go()
