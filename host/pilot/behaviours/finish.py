"""Finish: the field is cut. Nothing more is commanded."""

from __future__ import annotations

from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.gaze import Gaze
from host.pilot.phase import Phase


class Finish(Behaviour):
    """See the module."""

    phase = Phase.FINISHED
    gaze = Gaze(looks=False)
    reasons = ()

    def step(self, now: float) -> Step:
        del now
        return self.context.stop(), None
