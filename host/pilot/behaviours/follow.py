"""Follow: cut along the crop's outer edge until the side ends."""

from __future__ import annotations

import math

from host.core.messages import Command
from host.estimate.crop_ahead import END_CLEAR_M, END_SURE, EndOfField
from host.field.areas import Verdict
from host.pilot import steering_law
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.context import BEGINNING_M, SLOW_AFTER_S, Context
from host.pilot.endings import (
    Beside,
    Elsewhere,
    SideEnd,
    Standing,
    back_in_vain,
    end_by_plan,
    end_side,
    leave_rest,
    leave_strip,
    little_left,
    may_regain,
    or_elsewhere,
)
from host.pilot.gaze import STOP_AFTER_S, Gaze
from host.pilot.phase import Doing, Go, Phase, Reason
from host.pilot.plan_side import NO_CROP_M
from host.pilot.sight import UNSEEN_M
from host.pilot.stop_and_look import LONG_LOOK_S, LOOK_S, LOOKING

LANE_SIGMA_M = 0.3
"""Uncertainty of the edge at the blade beyond which the pilot does not cut on. Over a patch of
weeds or thin crop, or where no edge line shows (short remnants, slanting ends), dead reckoning does
for some metres."""
BEFORE_EDGE_SIGMA_M = 0.6
"""The same where a slanting border lies before the edge, or the strip's crop stands beside the
machine's way: standing there shows no more of it than the corner from which it runs, or the side of
what stands, and the nearer that is, the better. Smaller: it waits there in vain for a clearer view;
larger: it may come off its crop before it sees the edge."""
DUST_SIGMA_M = 0.12
"""From here on it is worth a stop to look without the blade's dust."""
LOOK_AFTER_M = 1.0
"""And so it is after so much way without a picture that tells of the edge, however well the lane is
known: what stands ahead is no better seen than that."""
LOOK_EVERY_M = 1.0
END_LOOK_EVERY_M = 0.3
"""Between looks for an end where the plan has one: crop beyond the last look is cut meanwhile."""
NEARLY_M = 0.8
"""Of the last side: clear ground from here on is its end."""
END_REST_M = 1.0
"""Of a side, before its end: no more than a walked corner errs."""
GONE_REST_M = 2.0
"""The same of a side along which it has been driven in vain, right beside what the machine has cut:
as far as that is surely beside it (host.estimate.swaths)."""
ASTRAY_RAD = math.radians(30.0)
"""From its strip's direction, besides the strip's own bends, no machine turns that follows its
edge: in 250 strips of 14 fields one did by more than 20 deg. Machines that had lost their place by
3 m turned by 40 and 60 deg after the edge of a neighbour's field, and cut 8 and 11 m2 of it. Deep
inside the field a last remnant may lie so, and nobody's crop is near."""
ASTRAY_M, SURELY_ASTRAY_RAD = 1.0, math.radians(45.0)
"""For so long a way, or at once: a machine that finds its edge 1.4 m aside turns by 30 deg to it,
and back."""
SPIN_S = 0.6
"""Before it goes on in crop, for the blade to spin up."""
STARTS_M, STARTS_S = 0.1, 3.0
"""A machine that has come no farther since a picture showed something may be unseeing for so long:
the blade spins up and whirls up dust, and uphill the wheels break away after a second. With less it
stood, saw, spun up its blade and lost its edge again without end (field 10635)."""


def lane_unknown(context: Context) -> bool:
    """Whether the edge at the blade is too unsure to cut on."""
    sigma_m = context.estimate.lane.offset_sigma_m
    if sigma_m <= LANE_SIGMA_M:
        return False
    here = context.motion
    before = context.strip.before_edge(here) or context.sight.beside(here)
    return not before or sigma_m > BEFORE_EDGE_SIGMA_M


class Why(Reason):
    """Out of following, besides the side's end."""

    EDGE_LOST = Doing.BACK_OFF, "the edge is lost: {why}"
    EDGE_UNSURE = Doing.LOOK_AT_EDGE, f"the edge is unsure: {LOOKING}"
    SEEMS_TO_END = Doing.LOOK_AT_END, f"the crop seems to end: {LOOKING}"
    IN_DUST = Doing.LOOK_AT_END, f"the side may end in the dust: {LOOKING}"
    TOO_LONG = Doing.FAULT, "the side is longer than the boundary allows"
    FAR = (
        Doing.FAULT,
        "its strip is believed to lie {off_m} m beside it: the machine has lost its place, put it "
        "on a corner of what stands",
    )
    ASTRAY = (
        Doing.FAULT,
        "it has turned {deg} deg from its strip, after an edge that cannot be that strip's: the "
        "machine has lost its place, put it on a corner of what stands",
    )
    REMNANT_GONE = Doing.FINISH, "nothing found of the plan's last remnant"
    LAST_CLEAR = Doing.FINISH, "no crop left on the last side"
    CLEAR_GROUND = (
        Doing.FAULT,
        "clear ground for {clear} m where the plan has crop{more}: what stands beyond may be the "
        "neighbour's; check the boundary and the corner that the machine was put at",
    )
    NOTHING_SEEN = (
        Doing.FAULT,
        "no picture shows for {clear} m what stands before the blade, and no look without dust "
        "does: {why}",
    )
    LEFT_AT_KEEP_OUT = Doing.FINISH, "what is left stands too near a keep-out"
    CROP_GONE = Doing.FAULT, "the crop that the plan has here is not to be found"


class Follow(Behaviour):
    """See the module."""

    phase = Phase.FOLLOW
    gaze = Gaze(cutting=True, on_side=True, ends=True)
    reasons = (Why, Beside, SideEnd, Elsewhere, Standing)

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._along_at_m = -math.inf
        """Travelled when it last went along its strip. A doubt on the way is no fresh start."""

    def step(self, now: float) -> Step:
        context = self.context
        lane = context.estimate.lane
        # A lane that bends ahead may lie as far beside the machine as well, and is not turned from.
        if abs(lane.heading_rad) > math.pi / 2:
            off_m = abs(lane.driven_off_m)
            if off_m > steering_law.reach_m(context.vehicle):
                return context.stop(), Why.FAR.go(off_m=f"{off_m:.0f}")
        if self._astray():
            return context.stop(), Why.ASTRAY.go(deg=f"{math.degrees(lane.heading_rad):.0f}")
        go = self._left_alone(now) or self._ends(now) or self._needs_a_look(now)
        if go is not None:
            return self._hold(go), go
        stops = self._nothing_to_cut(now)
        if stops is not None:
            return context.stop() if stops.reason in Why else context.hold(), stops
        if context.sight.ahead.entered:
            context.strip.cut()
        elif context.hidden and context.strip.blade_due() and context.goes_unseeing(now):
            context.strip.cut_unseen()
        doubt = self._doubts(now)
        if doubt is not None:
            return self._hold(doubt), doubt
        return self._drive(now), None

    def _astray(self) -> bool:
        """Whether it follows an edge that leads away from its strip."""
        context = self.context
        astray_rad = abs(context.estimate.lane.heading_rad) - context.strip.bends_rad
        if astray_rad <= ASTRAY_RAD:
            self._along_at_m = context.motion.distance_m
        lasts = context.motion.distance_m - self._along_at_m > ASTRAY_M
        astray = (lasts or astray_rad > SURELY_ASTRAY_RAD) and not context.strip.deep_inside
        return astray and context.cut_m > BEGINNING_M

    def blocked(self, now: float, verdict: Verdict) -> Go | None:
        """A side that is about to end, and one beside a keep-out, ends where the geofence has it
        end, which knows how surely the machine knows its place; what is left of it stays, and is
        told when all else is cut. Where only another place at which the machine may be is too near,
        crop at the blade tells against that."""
        context, strip = self.context, self.context.strip
        here_m = context.motion.distance_m
        if verdict.elsewhere and here_m - context.look.at_m > END_LOOK_EVERY_M:
            context.look.begin(now, here_m)
            return Why.IN_DUST.go()
        if verdict.at_keep_out and strip.placed:
            if leave_rest(context):
                return Why.LEFT_AT_KEEP_OUT.go()
            if verdict.clearance_m >= 0.0:
                if context.go_past():
                    return Beside.PAST.go(side=strip.name)
                return leave_strip(context, now)
        rest_m = END_REST_M + strip.tip_m
        ends = strip.placed and strip.left_m() < rest_m and verdict.clearance_m >= 0.0
        go = end_by_plan(context, now) if ends else None
        return go or super().blocked(now, verdict)

    def _hold(self, go: Go) -> Command:
        """On its way to a look the machine still rolls, and what its blade does not cut stays: once
        told to stop, the firmware lets it begin anew only after a while."""
        looks = go.reason in (Why.EDGE_UNSURE, Why.SEEMS_TO_END, Why.IN_DUST)
        return self.context.hold(blade=looks and self.context.strip.blade_due())

    def _left_alone(self, now: float) -> Go | None:
        """Clear ground longer than a patch, after a look: what comes next may be somebody else's.
        The machine looks from farther back as well, and then a person must see. The last side ends
        there if the plan has next to nothing more, and so does any side of a boundary that is still
        to be found, and once one that is all but driven, or is short: the turn leads back into the
        field, and the geofence watches."""
        context, guard = self.context, self.context.estimate.cut
        if not guard.refused:
            return None
        end_m = context.strip.along_m(context.motion) - guard.clear_m
        if context.strip.may_end_at(end_m):
            here = EndOfField(now, context.motion)
            context.strip.ends_at(end_m)
            return end_side(context, now, here, looked=True)
        if may_regain(context):
            return Beside.REGAIN.go()
        left_m = context.strip.left_m()
        if context.strip.last and left_m < NEARLY_M:
            context.remains.nothing_stands()
            return Why.LAST_CLEAR.go()
        if little_left(context):
            context.remains.nothing_stands()
            return Why.REMNANT_GONE.go()
        little = left_m < END_REST_M or context.strip.skippable
        if context.guard.fenced and little:
            go = end_by_plan(context, now)
            if go is not None:
                return go
        clear_m = f"{guard.clear_m:.1f}"
        if back_in_vain(context) == 0 and context.strip.placed:
            return Beside.AGAIN.go(clear=clear_m)
        if guard.unseen and not context.sight.sees_ahead():
            why = context.why_unseen("no sure view")
            return self._not_there(Why.NOTHING_SEEN.go(clear=clear_m, why=why))
        more = f" for another {left_m:.1f} m" if left_m > 0.0 else ""
        return self._not_there(Why.CLEAR_GROUND.go(clear=clear_m, more=more))

    def _not_there(self, go: Go) -> Go:
        """The strip's crop is not where it is believed to stand. One that others have left is laid
        where the machine believes to have cut around it: then it has lost its place, and goes
        nowhere else."""
        return go if self.context.gathering else or_elsewhere(self.context, go)

    def _ends(self, now: float) -> Go | None:
        """An end that pictures show where the plan has it and no dust may feign it."""
        context = self.context
        clear = context.sight.ahead.end
        if clear is None or not context.strip.end_due(clear.motion):
            return None
        if context.strip.placed and context.sight.ahead.in_dust(*END_SURE):
            return None
        context.by_plan = False
        return end_side(context, now, clear)

    def _needs_a_look(self, now: float) -> Go | None:
        """What seems clear ground may be dust before crop, or a bare patch where the plan has
        some."""
        context = self.context
        clear = context.sight.ahead.end
        if clear is None and context.strip.blind() and context.sight.ahead.entered:
            context.look.begin(now, context.motion.distance_m, LONG_LOOK_S)
            return Why.IN_DUST.go()
        if clear is None:
            return None
        due = context.strip.end_due(clear.motion)
        again_m, since_m = END_LOOK_EVERY_M, context.look.at_m
        if not due:
            again_m, since_m = LOOK_EVERY_M, max(since_m, clear.motion.distance_m)
        here_m = context.motion.distance_m
        if here_m - since_m <= again_m:
            return None
        context.look.begin(now, here_m, LOOK_S if due else LONG_LOOK_S)
        context.sight.ahead.clear_count = 0
        return Why.SEEMS_TO_END.go()

    def _nothing_to_cut(self, now: float) -> Go | None:
        """The end that no picture shows, the plan's crop that does not stand, and the boundary."""
        context, strip, ahead = self.context, self.context.strip, self.context.sight.ahead
        here = EndOfField(now, context.motion)
        if strip.to_blind_end_m() <= 0:
            return end_side(context, now, here)
        searched = not ahead.entered and context.cut_m > strip.search_m
        if searched and ahead.crop_at_m - context.motion.distance_m > NO_CROP_M:
            if may_regain(context):
                return Beside.REGAIN.go()
            if little_left(context):
                context.remains.nothing_stands()
                return Why.REMNANT_GONE.go()
            if strip.beside_swath:
                return None  # farther on it may stand
            # A short side may have gone with its neighbours, and so may one along all of them.
            gone = strip.skippable or (strip.placed and strip.left_m() < GONE_REST_M)
            if gone:
                return end_side(context, now, here)
            return self._not_there(Why.CROP_GONE.go())
        if strip.overrun():
            go = end_by_plan(context, now) if context.guard.fenced else None
            return go or self._not_there(Why.TOO_LONG.go())
        return None

    def _doubts(self, now: float) -> Go | None:
        """Whether the edge is too unsure to cut on, or might be seen without the dust."""
        context, sight = self.context, self.context.sight
        if context.creeps(now) or context.moves_aside(now):
            return None
        unknown = not context.estimate.position.beside and lane_unknown(context)
        starts = abs(context.motion.distance_m - sight.seen_at_m) < STARTS_M
        lost = now - sight.seen.stamp > (STARTS_S if starts else STOP_AFTER_S) or unknown
        if lost and not (context.backs > 0 and context.goes_unseeing(now)):
            sight.seen.broken = now
            return Why.EDGE_LOST.go(why=context.why_unseen("no sure view"))
        if not self._worth_a_look():
            return None
        context.look.begin(now, context.motion.distance_m)
        return Why.EDGE_UNSURE.go()

    def _worth_a_look(self) -> bool:
        """Whether the lane has become doubtful where its edge might be seen but for dust."""
        context, strip, sight = self.context, self.context.strip, self.context.sight
        here = context.motion
        if not strip.placed or not sight.ahead.entered or sight.ahead.clear_count > 0:
            return False
        along = strip.along_m(here)
        unseen_m, lane = sight.unseen_m(here), context.estimate.lane
        untold_m = min(unseen_m, abs(here.distance_m - sight.lane_at_m))
        return (
            (
                untold_m > LOOK_AFTER_M
                or (unseen_m > UNSEEN_M and lane.offset_sigma_m > DUST_SIGMA_M)
            )
            and abs(here.distance_m - context.look.at_m) > LOOK_EVERY_M
            and strip.shows_edge(along - UNSEEN_M)
            and strip.shows_edge(along + END_CLEAR_M)
        )

    def _drive(self, now: float) -> Command:
        context, vehicle, ahead = self.context, self.context.vehicle, self.context.sight.ahead
        estimate = context.estimate
        steer = steering_law.follow(estimate.lane, context.motion, vehicle)
        steer -= estimate.odometry.trim_rad
        if ahead.entered and now - context.since < SPIN_S:
            return context.drive(steer, 0.0, blade=True)
        unseen = now - context.sight.seen.stamp > SLOW_AFTER_S
        slow = unseen or not ahead.entered or ahead.clear_count > 0
        speed = vehicle.manoeuvre_speed_mps if slow else vehicle.cutting_speed_mps
        return context.drive(steer, speed, blade=context.strip.blade_due())
