"""Fault: it needs a person. Nothing more is commanded."""

from __future__ import annotations

from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.phase import Phase
from host.pilot.sight import Gaze


class Fault(Behaviour):
    """See the module."""

    phase = Phase.FAULT
    gaze = Gaze(looks=False)
    reasons = ()

    def step(self, now: float) -> Step:
        del now
        return self.context.stop(), None
