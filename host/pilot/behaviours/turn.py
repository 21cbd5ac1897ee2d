"""Turn: drive the turn's legs, by dead reckoning, the last one back along the next side."""

from __future__ import annotations

import math
from dataclasses import replace

import shapely

from host.core.frames import Pose2
from host.estimate.crop_ahead import AT_BLADE_M
from host.field.areas import Verdict
from host.pilot import steering_law
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.context import SLOW_AFTER_S, Context
from host.pilot.endings import Blind, Standing, blind, leave_rest, or_elsewhere
from host.pilot.guard import INTO_CROP_M, NEARER, SeenFree
from host.pilot.phase import Doing, Go, Phase, Reason
from host.pilot.turn_progress import ACROSS_RAD, Turning
from host.route.manoeuvre import RUN_IN_M, SHORT_M, Lane, way
from host.route.turn_legs import Follow as Along
from host.route.turn_legs import Leg

STEER_READY_RAD = math.radians(6.0)
"""So near to its leg's angle the wheel must be before the machine moves."""
STEER_TIMEOUT_S = 7.0
"""For that: the slowest actuator of the design, 20 degrees a second (docs/build/README.md), takes
5 s from one lock to the other. Shorter: a sound machine with such a steering stops in a turn."""
ALIGNED = (0.03, math.radians(3.0))
"""Offset of the blade, m, and heading, rad, with which a side is begun."""
ASKEW_RAD = math.radians(20.0)
"""Against the new lane, with which a turn that was broken off is over: less than what a camera of
60 degrees needs to see the crop's right end, and within what following straightens."""
ASIDE_M = 0.3
"""Beside the new lane, with which a turn is over: what following makes good within a strip's first
metres."""
AT_M = 0.3
"""Along the lane, by which a way past something may end short."""
SEARCHES = 6
"""So often another way is looked for, in one turn."""
ROOMS = sum(share == 1.0 for share, _ in NEARER)
"""That it is looked for in: behind the beginning of the crop, and then in line at least."""
INSIDE_M = 0.1
"""Beyond where a known side's crop should begin, a blade stands inside it."""
ARRIVES_M = 1.5
"""Farther back, at most, a way from elsewhere comes to the lane: what a camera sees of it."""
IN_THE_WAY_M = 0.5
"""Through what pictures surely show as crop, on a way elsewhere that is to lead over what was cut:
more than a remnant's width, and little of a gap."""
OPEN = (math.inf, 0.0)
"""Nothing that is pressed down counts: what stands is given as what is in the way."""
SEEN_BACK_M = (0.8, 1.2)
"""Before the crop as it is seen, so far back is far enough for a machine that is in line, and for
any: more than is planned by what a look errs."""
ALIGN_ROOM_M = (0.5, 1.0)
"""How much farther than planned the vehicle may back to get into line with the edge: into the gap,
and at most, over what has been cut."""


class Why(Reason):
    """Out of the turn."""

    TURNED = Doing.SEARCH, "turned; looking for the crop's edge"
    STEERING_STUCK = Doing.FAULT, "the steering did not reach its angle"
    NO_ROOM = (
        Doing.FAULT,
        "no room to turn {deg} deg more: drive it to where it has, or to a corner of what stands",
    )
    NO_ROOM_BACK = (
        Doing.FAULT,
        "no room to back to where its strip begins, {behind} m behind it: drive it to a corner of "
        "what stands",
    )
    NO_WAY = Doing.GATHER, "{side}: no way leads there"
    IN_THE_WAY = (
        Doing.FAULT,
        "crop stands where none was left: the machine has lost its place, put it on a corner of "
        "what stands",
    )
    LEFT_NO_ROOM = Doing.FINISH, "there is no room to turn to what is left"
    ROLLS = Doing.FAULT, "told to stand, it rolls: the slope is too steep for its brake"


class DriveTurn(Behaviour):
    """See the module."""

    phase = Phase.TURN
    reasons = (Why, Blind, Standing)

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._tried: int | None = None
        """In how many rooms another way has been looked for; None: none is."""
        self._standing: list[shapely.Polygon] = []
        """What it is not to lead through."""
        self._free_at_m = context.motion.distance_m
        """Travelled when nothing was last in the way."""
        self._doubt_m = context.strip.begin_doubt_m
        """How much farther back the next side may begin; pictures on the way make it surer."""

    @property
    def turning(self) -> Turning:
        """The turn that the end of the side has laid out."""
        assert self.context.turning is not None
        return self.context.turning

    def enter(self, now: float) -> None:
        """Each leg begins with the steering at its angle, and so does one that was broken off."""
        self.turning.wait(now)

    def step(self, now: float) -> Step:
        context, turning = self.context, self.turning
        go = blind(context, now)
        if go is not None:
            return context.hold(), go
        if self._tried is not None:
            self._search(now)
            return context.hold(), None
        if turning.leg is None and self._goes_elsewhere():
            if self._begin_search():
                return context.hold(), None
            if turning.elsewhere:
                context.remains.no_way()
                return context.hold(), Why.NO_WAY.go(side=context.strip.name)
        if turning.leg is None:
            expected_m = turning.crop_expected_m(context.motion, context.vehicle.blade_x_m)
            go = self._missed(-expected_m)
            if go is not None:
                if leave_rest(context):
                    return context.hold(), Why.LEFT_NO_ROOM.go()
                return context.hold(), or_elsewhere(context, go)
            context.sight.ahead.approached = context.strip.new or expected_m > -INSIDE_M
            return context.hold(), Why.TURNED.go()
        leg = turning.leg
        assert leg is not None
        if self._in_the_way(now, leg):
            return context.hold(), Why.IN_THE_WAY.go()
        if self.leg_done(now):
            self._next(now)
            return context.drive(leg.steer_rad, 0.0, blade=False), None
        steer = self._steer(leg)
        if not turning.running:
            assert context.telemetry is not None
            told_s = now - turning.since
            stands = context.stands_after(told_s)
            if not stands or abs(context.telemetry.angle_rad - steer) >= STEER_READY_RAD:
                why = Why.STEERING_STUCK if stands else Why.ROLLS
                go = why.go() if told_s > STEER_TIMEOUT_S else None
                return context.drive(steer, 0.0, blade=False), go
            turning.running = True
        speed = context.vehicle.manoeuvre_speed_mps
        return context.drive(steer, -speed if leg.reverse else speed, blade=False), None

    def seen_free(self, now: float) -> SeenFree:
        return self.clear_ahead(now)

    def paused(self, now: float) -> None:
        super().paused(now)
        self.turning.since = now

    def blocked(self, now: float, verdict: Verdict) -> Go | None:
        """Another way from here; where there is none, what is left of the turn goes the other
        way."""
        del verdict
        turning = self.turning
        turning.broken_off = True
        if (turning.backing and not self._off_lane()) or not self._begin_search():
            self._next(now)
        return None

    def _missed(self, behind_m: float) -> Go | None:
        """Where a turn that was broken off has not led to its strip: across it still, or beside it
        so far beyond its beginning that what it would cut there is another's."""
        turning = self.turning
        if turning.passes or not (turning.broken_off and self.context.strip.placed):
            return None
        _, turned = turning.against_lane(self.context.motion)
        if abs(turned) > ACROSS_RAD:
            return Why.NO_ROOM.go(deg=f"{math.degrees(abs(turned)):.0f}")
        if self._off_lane() and behind_m > SHORT_M[-1]:
            return Why.NO_ROOM_BACK.go(behind=f"{behind_m:.0f}")
        return None

    def _goes_elsewhere(self) -> bool:
        """Whether the turn is to lead elsewhere than to where the machine stands."""
        here_m = self.turning.beside_lane(self.context.motion).x_m
        return self._off_lane() or here_m < self.turning.past_m - AT_M

    def _off_lane(self) -> bool:
        """Whether the machine is not where a side can be begun."""
        offset, turned = self.turning.against_lane(self.context.motion)
        return self.context.strip.placed and (abs(turned) > ASKEW_RAD or abs(offset) > ASIDE_M)

    def _begin_search(self) -> bool:
        """Whether another way is looked for from the next step on."""
        if self.turning.searches >= SEARCHES or not self.context.strip.placed:
            return False
        self.turning.searches += 1
        self._tried = 0
        if self.turning.elsewhere:
            self._standing = self.context.remains.left.parts(*self.context.as_found)
        return True

    def _search(self, now: float) -> None:
        """Looks for another way to the lane within the geofence: at each step, which the firmware
        waits for, with less room kept than at the one before, and at last with more of the crop
        behind the machine."""
        context, turning = self.context, self.turning
        assert self._tried is not None
        if turning.beside:
            turning.anchor(context.motion, *context.estimate.lane.backwards)
        start = turning.beside_lane(context.motion)
        stays, wary = divmod(self._tried, ROOMS)
        # Where the machine stands in what it takes for crop, no way leads out of it.
        standing = self._standing if turning.elsewhere and stays == 0 else ()
        room = context.guard.room_around(start, standing)
        legs = None
        if room is not None:
            turn, vehicle = turning.turn, context.vehicle
            border = vehicle.blade_width_m / 2 - turn.lane_y_m, turn.lane_rad
            ends_m = turn.crop_begins_m - RUN_IN_M - vehicle.blade_x_m
            lane = Lane(ends_m, turn.crop_begins_m, border, turning.past_m)
            if turning.elsewhere:
                lane = lane._replace(border=OPEN, from_m=ends_m - ARRIVES_M)
            kept = replace(room, margins=room.margins[wary:], kept=ROOMS - wary)
            legs = way(vehicle, start, lane, kept, SHORT_M[stays])
        self._tried += 1
        if legs is not None:
            self._tried = None
            turning.lay_anew(legs, now)
            if turning.backing:
                context.strip.begin_leg(turning)
        elif room is None or self._tried >= ROOMS * len(SHORT_M):
            self._tried = None
            if turning.elsewhere:
                turning.searches = SEARCHES  # from the same place none will be found either
            if turning.leg is not None:
                self._next(now)

    def leg_done(self, now: float) -> bool:
        """Whether the goal is reached, or will be by coasting on. Backing along the new side goes
        on for a while until the machine is in line with it, and as far as its beginning may lie
        farther back while crop stands at the blade; it ends sooner where that is seen to lie
        nearer."""
        context, turning = self.context, self.turning
        to_go = turning.to_go(context.motion, context.vehicle.drive_lag_s)
        if not turning.backing:
            return to_go <= 0
        lane = context.estimate.lane
        aligned = abs(lane.off_m) < ALIGNED[0] and abs(lane.heading_rad) < ALIGNED[1]
        if to_go > 0:
            before_m = context.sight.ahead.begins_at_m - context.motion.distance_m
            return before_m > SEEN_BACK_M[0 if aligned else 1]
        if -to_go < self._doubt_m and self._inside(now):
            return False
        room = min(ALIGN_ROOM_M[0] + context.strip.back_m, ALIGN_ROOM_M[1])
        return aligned or -to_go >= room

    def _inside(self, now: float) -> bool:
        """Whether a picture of now surely shows crop at the blade."""
        sight = self.context.sight
        at_blade = sight.view is not None and sight.view.crop_ahead_m < AT_BLADE_M
        return at_blade and sight.sees_ahead() and now - sight.stamp < SLOW_AFTER_S

    def _in_the_way(self, now: float, leg: Leg) -> bool:
        """Whether a machine that gathers drives through crop where it believes to have cut it:
        wherever that is, it is not where it believes to be."""
        context = self.context
        here_m = context.motion.distance_m
        if not self.turning.elsewhere or leg.reverse or not self._inside(now) or self._left_here():
            self._free_at_m = here_m
        return here_m - self._free_at_m > IN_THE_WAY_M

    def _left_here(self) -> bool:
        """Whether the blade is where crop is believed to stand."""
        blade = Pose2(*self.context.estimate.position.pose).ahead(self.context.vehicle.blade_x_m)
        at = shapely.Point(blade[:2])
        return any(part.distance(at) < INTO_CROP_M for part in self._standing)

    def _next(self, now: float) -> None:
        turning, lane = self.turning, self.context.estimate.lane
        if turning.beside:
            turning.anchor(self.context.motion, *lane.backwards)
        turning.next(now)
        if turning.backing:
            self.context.strip.begin_leg(turning)

    def _steer(self, leg: Leg) -> float:
        """A leg along a lane is steered; the others hold their angle."""
        if leg.follow is Along.NOTHING:
            return leg.steer_rad
        estimate, vehicle = self.context.estimate, self.context.vehicle
        steer = steering_law.back(estimate.lane, vehicle)
        return steer - estimate.odometry.trim_rad
