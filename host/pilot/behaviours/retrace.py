"""Retrace: back along a side whose edge bends, beside whose beginning the next strip begins, as far
as to its first bend: a shuttle's turn knows straight lines only, and begins there."""

from __future__ import annotations

from host.pilot import steering_law
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.context import Context
from host.pilot.endings import SideEnd, turn_on
from host.pilot.gaze import Gaze
from host.pilot.phase import Phase
from host.pilot.planned_strip import PlannedStrip


class Retrace(Behaviour):
    """See the module."""

    phase = Phase.TURN
    gaze = Gaze(lane=False)
    reasons = (SideEnd,)

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._backs = False
        """Whether the machine has stood before it."""

    def step(self, now: float) -> Step:
        context, strip = self.context, self.context.strip
        assert isinstance(strip, PlannedStrip)
        assert context.ended is not None
        self._backs = self._backs or context.standing(now)
        back = strip.back_along()
        if back is None:
            return context.hold(), turn_on(context, now, context.ended, retraced=True)
        steer = steering_law.reverse(*back, context.vehicle) - context.estimate.odometry.trim_rad
        speed = -context.vehicle.manoeuvre_speed_mps if self._backs else 0.0
        return context.drive(steer, speed, blade=False), None
