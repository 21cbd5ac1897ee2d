"""Look beyond: stand at the end of a side that ends at the field's boundary, until the dust has
settled, to see how far before the blade the next crop stands. The turn leads there."""

from __future__ import annotations

from statistics import median

from host.estimate.crop_ahead import CONFIDENT
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.context import FARTHEST_M
from host.pilot.endings import Elsewhere, SideEnd, leave_side
from host.pilot.phase import Phase
from host.pilot.sight import Gaze

PICTURES = 8
"""That must say it: nearly a second's."""


class LookBeyond(Behaviour):
    """See the module."""

    phase = Phase.TURN
    gaze = Gaze(lane=False)
    reasons = (SideEnd, Elsewhere)

    def enter(self, now: float) -> None:
        self.context.look.begin(now, self.context.motion.distance_m)
        self._stamp = self.context.sight.stamp
        self._ahead_m: list[float] = []

    def step(self, now: float) -> Step:
        context, sight = self.context, self.context.sight
        if sight.stamp != self._stamp and context.look.settled(sight.stamp):
            self._stamp = sight.stamp
            view = sight.view
            if view is not None and view.usable and view.ahead_confidence >= CONFIDENT:
                self._ahead_m.append(min(view.crop_ahead_m, FARTHEST_M))
        enough = len(self._ahead_m) >= PICTURES
        if not (enough or context.look.over(now)):
            return context.hold(), None
        if enough and context.standing(now):
            context.saw_beyond(median(self._ahead_m))
        assert context.ended is not None
        return context.hold(), leave_side(context, now, context.ended)
