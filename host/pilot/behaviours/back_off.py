"""Back off: the edge is lost. Stand until it is in view again; after a while back over the swath,
the blade off: crop that filled the picture is a face again. Once for each time that it is lost, and
again while stems stand right before the lens, a few times for each side.

If that is in vain, a machine inside its crop goes on by half a metre, and looks again: crop stood
at its blade in a look without dust, and no gap is so narrow that it lies between two such looks.
Where stems right before the lens hide that, a look from farther back counts: lodged crop leans over
a low camera, which sees where it stands only from before it.
"""

from __future__ import annotations

import math
import statistics

from host.core.messages import Command
from host.estimate.crop_ahead import AT_BLADE_M
from host.estimate.odometry import Motion
from host.field.areas import Verdict
from host.pilot import steering_law
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.behaviours.follow import lane_unknown
from host.pilot.context import RESUME_AFTER_S, SLOW_AFTER_S, Context
from host.pilot.endings import Elsewhere, Patience, SideEnd, Standing, end_by_plan, gave_up
from host.pilot.gaze import Gaze
from host.pilot.phase import Doing, Go, Phase, Reason

BACK_AFTER_S = 6.0
BACK_M = 0.6
"""Less than clear ground that ends a side."""
LOOKED_S = 12.0
"""After so long without an edge, and having backed off, it goes on at a strip's beginning, and
leaves one that is all but cut."""
END_REST_M = 0.5
"""Of such a one, at most: there the edge is often none, a last tip or an earlier round's rest."""
BACKS = 3
"""At most, on a side, and one more for each time that it went on unseeing."""
CREEP_M = 0.5
"""From where the edge was lost, with the neighbour's crop no nearer than a gap of a metre."""
CREEPS = 8
"""At most, on a side: what is cut unseen may leave a sliver beside it."""
BLIND_GOES, BLIND_M = 4, 1.5
"""Times, at most, that it goes on by dead reckoning from places no farther apart: one that backs as
far as it gets on does so without end, its place drifts, and what it is in is no more surely the
field's (model field 12411: 2.7 m outside, and 1.3 m2 of the neighbour's crop cut)."""
CREEP_SIGMA_M = 0.6
"""Of the lane at the blade, at most."""
SETTLE_S = 2.0
"""Until the dust has settled, and the pictures count."""
AT_BLADE_SHARE = 1 / 3
"""Of the sure ones, that show crop right at the blade, the others hardly before it: of crop that a
machine has just stopped in every other one shows the foot 0.31 m ahead, and of crop that stands off
one in ten shows it at the blade."""
STANDS_M, CLEAR_SHARE = 0.35, 0.2
"""What is hardly before it, and the share of those, at most, that show it farther off."""
LEAST_PICTURES = 10
"""Sure ones, a second's."""
FROM_BEHIND_PICTURES = 5
"""The same from farther back, where most are sure and the edge is in view again after half a
second."""
LEAST_ON_M = 0.1
"""Of way that a look from farther back leaves: less is not worth the start."""


class Why(Reason):
    """Out of the doubt."""

    SEEN = Doing.FOLLOW, "the edge is in view again"
    OWN_CROP = Doing.FOLLOW, "no clearer view, in crop that is surely the field's"
    GOES_ON = Doing.FOLLOW, f"no clearer view, but crop stands at the blade: on by {CREEP_M} m"


class BackOff(Behaviour):
    """See the module."""

    phase = Phase.HESITATE
    gaze = Gaze(on_side=True)
    reasons = (Why, SideEnd, Elsewhere, Patience, Standing)

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._from: Motion | None = None
        """Where the machine began to back; None while it stands."""
        self._backed = False
        self._stood_at = -math.inf
        """Since when it has stood again."""
        self._lost_at_m = context.motion.distance_m
        """The travelled distance where the edge was lost."""
        self._judged = -math.inf
        """The stamp of the last picture that was judged."""
        self._pictures = self._at_blade = self._clear = 0
        """Sure ones without dust from where the edge was lost, those that show crop right at the
        blade, and those that show none there."""
        self._faces_m: list[float] = []
        """The travelled distances at which crop stands, by sure pictures from farther back."""

    def step(self, now: float) -> Step:
        context, seen = self.context, self.context.sight.seen
        go = gave_up(context, now)
        if go is not None:
            return self.gives_way(go)
        known = not lane_unknown(context)
        if known and seen.held_s > RESUME_AFTER_S and now - seen.stamp < SLOW_AFTER_S:
            return context.hold(), Why.SEEN.go()
        self._look(now)
        if self._hidden_before_crop(now):
            context.creep(context.stands_at_m + CREEP_M)
            return context.hold(), Why.GOES_ON.go()
        backed = self._from is None and (self._backed or not self._may_back)
        if backed and now - context.since > LOOKED_S:
            if context.goes_unseeing(now) and self._gets_on():
                context.blind_from_m.append(context.motion.distance_m)
                return context.hold(), Why.OWN_CROP.go()
            strip, backed_m = context.strip, self._lost_at_m - context.motion.distance_m
            if strip.placed and strip.left_m() - backed_m < END_REST_M + strip.tip_m:
                go = end_by_plan(context, now)
                if go is not None:
                    return context.hold(), go
            if self._crop_goes_on():
                context.creep(self._lost_at_m + CREEP_M)
                return context.hold(), Why.GOES_ON.go()
        return self._move(now), None

    def _look(self, now: float) -> None:
        """Takes a sure picture. Before the machine has backed it counts, by whether crop stands at
        the blade; after that it says where the crop stands."""
        context, view = self.context, self.context.sight.view
        stamp = context.sight.stamp
        settled = stamp > max(self._judged, context.since + SETTLE_S)
        if view is None or not settled or not (self._backed or context.standing(now)):
            return
        self._judged = stamp
        if not context.sight.sees_ahead() or math.isnan(view.crop_ahead_m):
            return
        if self._backed:
            shot = context.estimate.odometry.at(stamp)
            self._faces_m.append(shot.distance_m + view.crop_ahead_m)
            if len(self._faces_m) >= FROM_BEHIND_PICTURES:
                context.stands_at_m = statistics.median(self._faces_m)
        else:
            self._pictures += 1
            self._at_blade += view.crop_ahead_m < AT_BLADE_M
            self._clear += view.crop_ahead_m >= STANDS_M

    def _hidden_before_crop(self, now: float) -> bool:
        """Whether the stems before the lens are of crop that stands at the blade, by a look from
        farther back."""
        context = self.context
        stood = self._from is None and context.standing(now) and now - context.since > SETTLE_S
        on_m = context.stands_at_m + CREEP_M - context.motion.distance_m
        shown = LEAST_ON_M < on_m < CREEP_M + STANDS_M
        return stood and context.hidden and shown and self._may_creep()

    @property
    def _may_back(self) -> bool:
        """Whether it has not backed too often on this side."""
        return self.context.backs < BACKS + self.context.crept

    def _may_creep(self) -> bool:
        """Whether the machine may go on unseeing in crop that it has met, once it knows of some."""
        context = self.context
        known = context.estimate.lane.offset_sigma_m < CREEP_SIGMA_M
        return context.sight.ahead.entered and context.crept < CREEPS and known

    def _gets_on(self) -> bool:
        """Whether it has not gone on by dead reckoning in vain, again and again from hereabouts."""
        here_m = self.context.motion.distance_m
        near = sum(abs(at_m - here_m) < BLIND_M for at_m in self.context.blind_from_m)
        return near < BLIND_GOES

    def _crop_goes_on(self) -> bool:
        """Whether the crop that the blade has met stands at it still, by that look."""
        stands = self._pictures >= LEAST_PICTURES and (
            self._at_blade >= AT_BLADE_SHARE * self._pictures
            and self._clear <= CLEAR_SHARE * self._pictures
        )
        return stands and self._may_creep()

    def blocked(self, now: float, verdict: Verdict) -> Go | None:
        del verdict
        self._from, self._stood_at = None, now
        return None

    def paused(self, now: float) -> None:
        """A person may have moved the machine, or what stands before it."""
        super().paused(now)
        self._backed = False
        self._lost_at_m = self.context.motion.distance_m
        self._pictures = self._at_blade = self._clear = 0
        self._faces_m.clear()
        self.context.stands_at_m = -math.inf

    def _move(self, now: float) -> Command:
        context, motion = self.context, self.context.motion
        sees = now - context.sight.usable.stamp < SLOW_AFTER_S
        if self._from is None:
            again = self._backed and context.hidden
            due = now - max(context.since, self._stood_at) > BACK_AFTER_S
            due = due and (again or not self._backed)
            cut_m = context.cut_m if context.sight.ahead.entered else 0.0
            clear = cut_m > BACK_M or context.guard.fenced
            if due and sees and self._may_back and clear:
                self._from, self._backed = motion, True
                context.backs += 1
            return context.hold()
        coast = abs(motion.speed_mps) * context.vehicle.drive_lag_s
        if not sees or self._from.distance_m - motion.distance_m + coast > BACK_M:
            self._from, self._stood_at = None, now
            return context.hold()
        estimate, vehicle = context.estimate, context.vehicle
        steer = steering_law.back(estimate.lane, vehicle)
        steer -= estimate.odometry.trim_rad
        backing = context.drive(steer, -vehicle.manoeuvre_speed_mps, blade=False)
        return backing.because(f"backing off to look again: {context.reason}")
