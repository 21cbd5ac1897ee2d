"""Look beyond: stand at the end of a side that ends at the field's boundary, until the dust has
settled, to see how far before the blade the next crop stands. The turn leads there. Where that
contradicts what was said, look again from places behind, on ground that is cut, and come back."""

from __future__ import annotations

import math
from statistics import median
from typing import Final

from host.core.messages import Command
from host.estimate.crop_ahead import CONFIDENT
from host.estimate.gaps import LOOKS
from host.field.areas import Verdict
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.context import FARTHEST_M, Context
from host.pilot.endings import Elsewhere, SideEnd, leave_side
from host.pilot.gaze import Gaze
from host.pilot.phase import Go, Phase

PICTURES: Final = 8
"""That must say it: nearly a second's."""
APART_M: Final = 0.25
"""From one place to the next. More needs a longer strip, less shows the same ground."""


class LookBeyond(Behaviour):
    """See the module."""

    phase = Phase.TURN
    gaze = Gaze(lane=False)
    reasons = (SideEnd, Elsewhere)

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._end_m = context.motion.distance_m
        """The travelled distance at the side's end."""
        self._seen_m: list[float] = []
        """How far before the blade at the side's end the next crop stands, as each place shows."""
        self._to_m: float | None = None
        """The travelled distance that the machine goes to; None where it stands and looks."""
        self._places = 0
        self._stamp = self._since = -math.inf

    def enter(self, now: float) -> None:
        self._look(now)

    def step(self, now: float) -> Step:
        context, sight = self.context, self.context.sight
        if self._to_m is not None:
            return self._go(now, self._to_m)
        if sight.stamp != self._stamp and context.look.settled(sight.stamp):
            self._stamp = sight.stamp
            view = sight.view
            if view is not None and view.usable and view.ahead_confidence >= CONFIDENT:
                self._ahead_m.append(min(view.crop_ahead_m, FARTHEST_M))
        enough = len(self._ahead_m) >= PICTURES
        if not (enough or context.look.over(now)):
            return context.hold(), None
        back_m = self._end_m - context.motion.distance_m
        if enough and context.stands_after(now - self._since):
            self._seen_m.append(median(self._ahead_m) - back_m)
        if self._places < LOOKS and self._doubted():
            self._to_m = self._end_m - self._places * APART_M
        elif self._places > 1:
            self._to_m = self._end_m
        else:
            return context.hold(), self._done(now)
        return context.hold(), None

    def blocked(self, now: float, verdict: Verdict) -> Go | None:
        """What was seen so far must do."""
        del verdict
        return self._done(now)

    def _look(self, now: float) -> None:
        self._to_m = None
        self._since = now
        self._places += 1
        self._stamp = self.context.sight.stamp
        self._ahead_m: list[float] = []
        self.context.look.begin(now, self.context.motion.distance_m)

    def _doubted(self) -> bool:
        """Whether the first look contradicts what was said, and cut ground lies behind. That no
        crop is in view contradicts nothing."""
        context = self.context
        room = context.sight.ahead.entered and context.cut_m > LOOKS * APART_M
        if not (room and self._seen_m and self._seen_m[0] < FARTHEST_M):
            return False
        back_m = self._end_m - context.motion.distance_m
        return context.doubts_beyond(self._seen_m[0] + back_m)

    def _go(self, now: float, to_m: float) -> Step:
        context = self.context
        left_m = to_m - context.motion.distance_m
        back = to_m < self._end_m
        coast_m = abs(context.motion.speed_mps) * context.vehicle.drive_lag_s
        if (-left_m if back else left_m) > coast_m:
            return self._drive(-1.0 if back else 1.0), None
        if not context.standing(now):
            return context.hold(), None
        if not back:
            return context.hold(), self._done(now)
        self._look(now)
        return context.hold(), None

    def _drive(self, way: float) -> Command:
        context = self.context
        speed = way * context.vehicle.manoeuvre_speed_mps
        return context.drive(-context.estimate.odometry.trim_rad, speed, blade=False)

    def _done(self, now: float) -> Go:
        context = self.context
        if self._seen_m:
            back_m = self._end_m - context.motion.distance_m
            context.saw_beyond(median(self._seen_m) + back_m)
        assert context.ended is not None
        return leave_side(context, now, context.ended)
