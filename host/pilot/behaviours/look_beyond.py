"""Look beyond: stand at the end of a side that ends at the field's boundary, until the dust has
settled, to see how far before the blade the next crop stands. The turn leads there. While that is
not known well, or contradicts what was said, look again from nearer, the blade off, as far as the
ground is surely clear, else from farther back over ground that is cut; and come back."""

from __future__ import annotations

import math
from statistics import median
from typing import Final

from host.core.messages import Command
from host.estimate.crop_ahead import CONFIDENT
from host.estimate.crop_beyond import CropBeyond
from host.field.areas import Verdict
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.context import FARTHEST_M, Context
from host.pilot.endings import Blind, Elsewhere, SideEnd, blind, leave_side
from host.pilot.gaze import Gaze
from host.pilot.guard import SeenFree
from host.pilot.phase import Doing, Go, Phase, Reason

PICTURES: Final = 8
"""That must say it: nearly a second's."""
PLACES: Final = 4
"""Looked from, at most;"""
OWN_PLACES: Final = 2
"""and at least, for crop to be the side's own: pictures of one place err alike."""
KNOWN_M: Final = 0.35
"""Standard deviation of the next crop's place, within which a look is enough that contradicts
nothing."""
SIGMAS: Final = 2.0
"""Of that, and"""
STAND_M: Final = 0.15
"""more, by which it stays away from where the next crop is seen: by braking and the tape."""
LEAST_M: Final = 0.15
"""Nearer than the last place, for a look to tell more."""
APART_M: Final = 0.25
"""From one place to the next behind it."""


class Why(Reason):
    """Out of the look, besides the turn."""

    END_WAS_NONE = Doing.LOOK_AT_EDGE, "crop stands right before the blade: the side goes on"


class LookBeyond(Behaviour):
    """See the module."""

    phase = Phase.TURN
    gaze = Gaze(lane=False)
    reasons = (Why, SideEnd, Elsewhere, Blind)

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._end_m = context.motion.distance_m
        """The travelled distance at the side's end."""
        self._beyond = CropBeyond(context.vehicle, context.next_crop_m())
        self._to_m: float | None = None
        """The travelled distance that the machine goes to; None where it stands and looks."""
        self._way = 1.0
        """Nearer; -1: back."""
        self._returns = False
        """Whether it goes back to the side's end, and goes on from there."""
        self._places = 0
        self._stamp = self._since = -math.inf

    def enter(self, now: float) -> None:
        self._look(now)

    def step(self, now: float) -> Step:
        context, sight = self.context, self.context.sight
        if self._to_m is not None:
            go = blind(context, now)
            return (context.hold(), go) if go is not None else self._go(now, self._to_m)
        if sight.stamp != self._stamp and context.look.settled(sight.stamp):
            self._stamp = sight.stamp
            view = sight.view
            if view is not None and view.usable and view.ahead_confidence >= CONFIDENT:
                self._ahead_m.append(min(view.crop_ahead_m, FARTHEST_M))
                if math.isfinite(view.ahead_by_height_m):
                    self._by_height_m.append(view.ahead_by_height_m)
        enough = len(self._ahead_m) >= PICTURES
        if not (enough or context.look.over(now)):
            return context.hold(), None
        here_m = context.motion.distance_m
        if enough and context.stands_after(now - self._since):
            known = 2 * len(self._by_height_m) > len(self._ahead_m)
            by_height_m = median(self._by_height_m) if known else math.nan
            self._beyond.see(here_m - self._end_m, median(self._ahead_m), by_height_m)
        way_m = self._way_m() if self._places < PLACES else 0.0
        if way_m != 0.0:
            self._to_m, self._way = here_m + way_m, math.copysign(1.0, way_m)
        elif self._places > 1:
            self._return()
        else:
            return context.hold(), self._done(now)
        return context.hold(), None

    def seen_free(self, now: float) -> SeenFree:
        return self.clear_ahead(now)

    def blocked(self, now: float, verdict: Verdict) -> Go | None:
        """No nearer; and where it cannot go back either, what was seen so far must do."""
        del verdict
        if self._to_m is None or self._returns:
            return self._done(now)
        self._places = PLACES
        self._return()
        return None

    def _look(self, now: float) -> None:
        self._to_m = None
        self._since = now
        self._places += 1
        self._stamp = self.context.sight.stamp
        self._ahead_m: list[float] = []
        self._by_height_m: list[float] = []
        self.context.look.begin(now, self.context.motion.distance_m)

    def _way_m(self) -> float:
        """How far to the place that it is to look from next; 0: what was seen is enough. That no
        crop is in view contradicts nothing."""
        known, context = self._beyond.known, self.context
        if known is None or min(self._ahead_m, default=0.0) >= FARTHEST_M:
            return 0.0
        beyond_m, sigma_m = known
        ahead_m = beyond_m - (context.motion.distance_m - self._end_m)
        doubted = context.doubts_beyond(ahead_m)
        if sigma_m < KNOWN_M and not doubted:
            return 0.0
        nearer_m = ahead_m - SIGMAS * sigma_m - STAND_M
        if nearer_m > LEAST_M and self._way > 0.0:
            return nearer_m
        behind = context.sight.ahead.entered and context.cut_m > PLACES * APART_M
        return -APART_M if doubted and behind else 0.0

    def _return(self) -> None:
        self._to_m, self._returns = self._end_m, True
        self._way = math.copysign(1.0, self._end_m - self.context.motion.distance_m)

    def _go(self, now: float, to_m: float) -> Step:
        context = self.context
        coast_m = abs(context.motion.speed_mps) * context.vehicle.drive_lag_s
        if self._way * (to_m - context.motion.distance_m) > coast_m:
            return self._drive(self._way), None
        if not context.standing(now):
            return context.hold(), None
        if self._returns:
            return context.hold(), self._done(now)
        self._look(now)
        return context.hold(), None

    def _drive(self, way: float) -> Command:
        context = self.context
        speed = way * context.vehicle.manoeuvre_speed_mps
        return context.drive(-context.estimate.odometry.trim_rad, speed, blade=False)

    def _done(self, now: float) -> Go:
        context = self.context
        known = self._beyond.known
        if known is not None:
            ahead_m = known[0] - (context.motion.distance_m - self._end_m)
            if self._places >= OWN_PLACES and context.end_was_none(ahead_m, known[1]):
                return Why.END_WAS_NONE.go()
            context.saw_beyond(ahead_m)
        assert context.ended is not None
        return leave_side(context, now, context.ended)
