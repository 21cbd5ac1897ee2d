"""Wait for the camera: a turn, or a look beyond a side's end, was broken off as nothing is seen; it
goes on where it stopped."""

from __future__ import annotations

from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.context import RESUME_AFTER_S, SLOW_AFTER_S
from host.pilot.endings import Patience, Standing, gave_up
from host.pilot.gaze import Gaze
from host.pilot.phase import Doing, Phase, Reason


class Why(Reason):
    """Out of waiting."""

    SEES_AGAIN = Doing.TURN, "the camera sees again"
    LOOKS_AGAIN = Doing.LOOK_BEYOND, "the camera sees again, and looks how far the next crop stands"


class WaitForCamera(Behaviour):
    """See the module."""

    phase = Phase.HESITATE
    gaze = Gaze()
    reasons = (Why, Patience, Standing)

    def step(self, now: float) -> Step:
        context, usable = self.context, self.context.sight.usable
        go = gave_up(context, now)
        if go is not None:
            return self.gives_way(go)
        if usable.held_s > RESUME_AFTER_S and now - usable.stamp < SLOW_AFTER_S:
            turns = context.turning is not None
            return context.hold(), (Why.SEES_AGAIN if turns else Why.LOOKS_AGAIN).go()
        return context.hold(), None
