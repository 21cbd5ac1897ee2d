"""What the behaviours share: the estimate, the plan, the vehicle, what is seen, and the account of
the side that is being cut."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from host.core.frames import Pose2
from host.core.messages import Command, Request, Telemetry
from host.core.vehicle import Vehicle
from host.estimate.crop_ahead import END_CLEAR_M, EndOfField
from host.estimate.estimator import Estimator
from host.estimate.gaps import TELLS_M, Gaps, across, along
from host.estimate.odometry import Motion
from host.pilot.gaze import STOP_AFTER_S
from host.pilot.guard import Guard
from host.pilot.planned_strip import PlannedStrip
from host.pilot.remains import Remains
from host.pilot.sight import Sight
from host.pilot.stop_and_look import Look
from host.pilot.strip import Strip
from host.pilot.turn_progress import Turning, turn_from_anywhere
from host.route.anew import Anew, moved_with
from host.route.left_over import Gathering
from host.route.manoeuvre import SHORT_M
from host.route.plan import Plan
from host.vision.view import Detector

FARTHEST_M = 2.5
"""Crop farther before the blade is not surely seen."""
MOVED_M = 0.02
"""Corners that are found to lie no farther from the plan's leave the plan as it is."""
SLOW_AFTER_S = 0.4
"""Without the edge for so long the machine drives slowly, and no sight counts as one of now."""
RESUME_AFTER_S = 0.5
"""For so long pictures must be good without a break before it goes on."""
STOPPED_MPS = 0.03
CREEPING_MPS = 0.2
"""A braked machine on a slope of 7 degrees: it cannot stand better than that."""
BEGINNING_M = 3.0
"""Of a strip, or behind a bend of it: what the turn has left askew is straightened by then."""
PLACE_KNOWN = 0.5, 1.0
"""Standard deviation of the corner that is known least: so much of the narrowest gap, by what was
said and seen, and no more than that, m."""
BLIND_ON_M = 1.5
"""What a turn leaves of a strip's beginning at most."""
PAST_LEFT_M = 3.0
"""Of a strip, for which it is worth while to go past what stands beside it."""
STAND_S = 1.5
"""After so long told to stand, creeping counts as standing."""


class Ended(NamedTuple):
    """A side that has ended."""

    end: EndOfField
    seen: bool
    """Whether a picture showed it."""
    refused: bool = False
    """Whether the geofence ended it beside a keep-out."""


class Context:
    """Of one run. Behaviours read it, and write what their successors need."""

    def __init__(self, vehicle: Vehicle, detector: Detector, plan: Plan) -> None:
        self.vehicle = vehicle
        self.plan = plan
        self.estimate = Estimator(vehicle, plan)
        self.sight = Sight(vehicle, detector, self.estimate)
        self.guard = Guard(plan, vehicle, self.estimate.position)
        self.gaps = Gaps(math.inf if plan.gap_m is None else plan.gap_m)
        self._tell_gap()
        self.telemetry: Telemetry | None = None
        """The latest."""
        self.reason = "waiting for the firmware's telemetry"
        self.since = -math.inf
        """When the present phase began, or went on after a pause."""
        self.strip = Strip(plan, 0, vehicle, self.estimate, self.sight.ahead)
        self.turning: Turning | None = None
        """The turn that is being driven, or whose end is being looked at."""
        self._led_by: Turning | None = None
        """The one that has led to the present strip."""
        self._passes_m2: float | None = None
        """Of the strip, what was left of it when the machine began to go past what stands beside
        it."""
        self.anew: Anew | None = None
        """The plan around what was found of the boundary, while not all of it is laid out."""
        self.ended: Ended | None = None
        """The side at whose end the machine stands while that is done."""
        self.look = Look()
        self.ends: list[EndOfField] = []
        """Where sides were declared ended, by pictures."""
        self.by_plan = False
        """Whether the last end was the plan's alone: twice in a row it is none."""
        self._shown_m2 = plan.unreached_m2
        self.left_standing_m2 = 0.0
        """Of sides that were ended before the plan's end: beside keep-outs, and where no edge was
        to be found."""
        self.backs = 0
        """How often the machine has backed off on this side."""
        self.regained: list[float] = []
        """How far it had cut each time it went back on this side to crop beside it, m."""
        self.blind_from_m: list[float] = []
        """Travelled distances from which it has gone on by dead reckoning, after a look in vain."""
        self.crept = 0
        """How often it has gone on unseeing on this side by what a look had shown."""
        self._creeps_to_m = -math.inf
        """The travelled distance up to which it does."""
        self.stands_at_m = -math.inf
        """The travelled distance at which this side's crop stands, by a look from farther back."""
        self.bare = 0
        """Looks in a row that showed bare ground where the plan has crop."""
        known = bool(plan.sides) and plan.done == 0 and not self.planned(0).resumed
        self.remains = Remains(vehicle, known=known)
        """What the plan has left standing."""

    @property
    def left_m2(self) -> float:
        """What stays standing besides what the plan had shown at first."""
        return self.plan.unreached_m2 - self._shown_m2 + self.left_standing_m2

    @property
    def motion(self) -> Motion:
        """Dead reckoning since the start."""
        return self.estimate.motion

    def planned(self, index: int) -> Strip:
        """The strip of the plan's side `index`; without a plan one that only pictures know."""
        kind = PlannedStrip if self.plan.sides else Strip
        return kind(self.plan, index, self.vehicle, self.estimate, self.sight.ahead)

    def to_lay_anew(self) -> bool:
        """Whether the rest of the plan is to be laid out around the corners as they have been found
        to lie, or on from where that has got to, before the machine leaves the present side."""
        strip, outline = self.strip, self.estimate.position.outline
        if isinstance(strip, PlannedStrip) and np.abs(outline.moved_m).max(initial=0.0) > MOVED_M:
            cut = self.plan.cut_along(strip.index + 1)
            self.anew = Anew(self.plan, outline.corners, cut, self.vehicle)
        return self.anew is not None and not self.anew.enough(self.plan, strip.index)

    def take_anew(self) -> None:
        """Drives by what has been laid out. Where no plan has the sides that were cut, the old one
        stays, each side where its edges are found."""
        strip, anew = self.strip, self.anew
        assert anew is not None and isinstance(strip, PlannedStrip)
        plan = anew.plan(self.plan, strip.index)
        if plan is not None:
            plan = replace(plan, gap_m=self.plan.gap_m)
            if not anew.taken:
                nearer = self.guard.nearer
                self.guard = Guard(plan, self.vehicle, self.estimate.position, nearer)
            self.plan, self.strip = plan, strip.laid_anew(plan)
        anew.taken = True
        if anew.over:
            self.anew = None

    # ---- what the plan has left standing ---------------------------------------------------------

    @property
    def as_found(self) -> tuple[list[tuple[float, float]], list[list[tuple[float, float]]]]:
        """The boundary's corners where they are found to lie, and the keep-outs that go with
        them."""
        believed = list(self.plan.boundary)
        found = self.estimate.position.outline.corners or believed
        return found, [moved_with(believed, found, ring) for ring in self.plan.keep_outs]

    @property
    def gathering(self) -> bool:
        """Whether the plan is at its end, and the machine goes to what it has left standing."""
        return self.plan.gathered > 0 and not self.remains.over

    @property
    def place_known(self) -> bool:
        """Whether the first round, or the walk, has shown well enough where the field lies to drive
        across it: the neighbours' crop is then two standard deviations away."""
        share, most_m = PLACE_KNOWN
        sigma_m = self.estimate.position.corners_sigma_m
        return sigma_m < min(share * self.gaps.least_m, most_m)

    def go_gather(self, now: float, strip: Gathering) -> None:
        """Drives to a strip that none of the plan's sides has cut: from wherever the machine stands
        the turn finds its way."""
        self.remains.go_to(strip)
        index, position = self.strip.index, self.estimate.position
        corners, outs = self.as_found
        self.plan = replace(
            self.plan,
            sides=(*self.plan.sides[: index + 1], strip.side),
            gathered=self.plan.gathered + 1,
            boundary=tuple(corners),
            keep_outs=tuple(map(tuple, outs)),
        )
        self.guard = Guard(self.plan, self.vehicle, position)
        following = self.planned(index + 1)
        assert isinstance(following, PlannedStrip)
        if position.outline.states:
            position.laid_anew(corners, following.planned_piece)
        self.anew, self.by_plan = None, False
        self.turning = turn_from_anywhere(
            now, strip.side, self.vehicle, self.motion, Pose2(*position.pose)
        )
        self.strip = following
        following.arrive(None)
        self.sight.ahead.turn()

    def end_gathering(self) -> None:
        """Nothing more of it can be gone to: what still stands by the blade's way, stays."""
        swaths = self.estimate.swaths
        swaths.end()
        self.remains.take(swaths.past, len(swaths.past))
        stays_m2 = self.remains.end(*self.as_found)
        self.left_standing_m2 = max(0.0, stays_m2 - self.plan.unreached_m2)

    def saw_beyond(self, ahead_m: float) -> None:
        """The machine stands at the end of a side at the boundary, and the next crop ahead_m before
        its blade. Crop that is seen beyond clear ground shows that the end was one, whatever wheels
        and start say. If it stands nearer than was said, the gap is narrower. Less clear ground
        than ends a side proves neither, but the turn has no more room than that; unless the
        pictures that ended the side contradict it."""
        beyond = self.strip.gap_beyond()
        if beyond is None:
            return
        gaps, wide_m = self.gaps, self.vehicle.blade_width_m
        gap_m = across(beyond.ago_m + ahead_m, beyond.askew_rad, wide_m)
        sure = gap_m >= END_CLEAR_M
        if not sure and self.sight.ahead.end is not None and gap_m < END_CLEAR_M - TELLS_M:
            return
        if not sure and self.estimate.position.likely > 0.0:
            return  # the end may be none, and what stands there the side's own
        if sure:
            gaps.note(beyond.edge, gap_m)
        if sure and ahead_m < FARTHEST_M:
            self.strip.end_was_one()
            if abs(beyond.past_m - beyond.ago_m) > TELLS_M:
                self.strip.met_end_surely()
            beyond = self.strip.gap_beyond() or beyond
        room_m = across(beyond.past_m + ahead_m, beyond.askew_rad, wide_m)
        room_m = min(gap_m, room_m) if sure else room_m
        self._reckon_with(gaps.at_end(beyond.edges, room_m, sure=sure))

    def doubts_beyond(self, ahead_m: float) -> bool:
        """Whether crop ahead_m before the blade contradicts what was said of the gap."""
        beyond = self.strip.gap_beyond()
        if beyond is None:
            return False
        way_m = beyond.ago_m + ahead_m
        return self.gaps.contradicts(across(way_m, beyond.askew_rad, self.vehicle.blade_width_m))

    def next_crop_m(self) -> float:
        """How far before the blade the next crop should stand, by what was said of the gap; inf:
        nothing lies beyond."""
        beyond = self.strip.gap_beyond()
        if beyond is None:
            return math.inf
        wide_m = self.vehicle.blade_width_m
        return along(self.gaps.said_m, beyond.askew_rad, wide_m) - beyond.ago_m

    def end_was_none(self, ahead_m: float, sigma_m: float) -> bool:
        """Whether crop ahead_m before the blade, give or take sigma_m, stands nearer than any next
        crop. Then the side goes on."""
        beyond = self.strip.gap_beyond()
        if beyond is None:
            return False
        cleared_m = max(beyond.ago_m, self.estimate.cut.clear_m)
        way_m = across(cleared_m + ahead_m, beyond.askew_rad, self.vehicle.blade_width_m)
        return self.gaps.too_narrow(way_m, sigma_m) and self.strip.end_was_none(ahead_m)

    def reckon_with_gap(self) -> None:
        """On a strip the gap is what is known of it, whatever was seen at the last one's end."""
        self.gaps.gathers = bool(self.remains.ended_by)
        self._reckon_with(self.gaps.gathering_m if self.gaps.gathers else self.gaps.field_m)

    def _reckon_with(self, gap_m: float) -> None:
        """So wide the gap is from here on."""
        known, nearer = self.plan.gap_m is not None, self.gaps.nearer
        if known and (gap_m, nearer) != (self.plan.gap_m, self.guard.nearer):
            self.plan = replace(self.plan, gap_m=gap_m)
            self.guard = Guard(self.plan, self.vehicle, self.estimate.position, nearer)

    def _tell_gap(self) -> None:
        """Vision tells by it what dust hides from what stands beyond."""
        if self.plan.gap_m is not None:
            self.sight.next_crop(self.gaps.least_m)

    # ---- what is known of the present side -------------------------------------------------------

    @property
    def cut_m(self) -> float:
        """How far the blade has come along the side since it met its crop, or was begun."""
        return self.sight.ahead.cut_m(self.motion)

    def standing(self, now: float) -> bool:
        """Whether the machine stands, as far as it can, since it was told to with the phase."""
        return self.stands_after(now - self.since)

    def stands_after(self, told_s: float) -> bool:
        """Whether the machine stands, as far as it can, told_s after it was told to."""
        return abs(self.motion.speed_mps) < (STOPPED_MPS if told_s < STAND_S else CREEPING_MPS)

    def begin_strip(self) -> None:
        """Along the strip from here on."""
        if self.turning is not None:
            self._led_by = None if self.turning.passes else self.turning
            behind_m = -self.turning.crop_expected_m(self.motion, self.vehicle.blade_x_m)
            if self._led_by is not None and behind_m > SHORT_M[0]:
                self.left_standing_m2 += behind_m * self.strip.width_m
        if self._passes_m2 is not None:
            self.left_standing_m2 += max(0.0, self._passes_m2 - self.strip.left_m2)
            self._passes_m2 = None
        self.turning = None
        self.gaps.leave()
        self.reckon_with_gap()
        self._tell_gap()
        self.strip.begin_lane()
        self.strip.saw_begin()
        self.estimate.cut.begin(self.strip.clear_end_m)
        self.sight.begin(self.motion)
        self.look = Look()  # shuttles drive the same way again: the last look's place says nothing
        self.backs = self.bare = self.crept = 0
        self.regained.clear()
        self.blind_from_m.clear()
        self._creeps_to_m = self.stands_at_m = -math.inf

    def why_unseen(self, otherwise: str) -> str:
        """What the last picture says of why it shows nothing."""
        view = self.sight.view
        return view.reason if view is not None and view.reason else otherwise

    @property
    def hidden(self) -> bool:
        """Whether stems right before the lens hide all else."""
        return self.sight.view is not None and self.sight.view.hidden

    def blind(self, now: float) -> bool:
        """Whether pictures are missing or show nothing of the world of now, for too long."""
        return now - self.sight.usable.stamp > STOP_AFTER_S

    def go_past(self) -> bool:
        """Begins the turn past what stands beside the strip, to where that goes on, once for each
        strip; False where too little is left behind it."""
        turning = self._led_by
        if turning is None or self.strip.left_m() < PAST_LEFT_M:
            return False
        self._led_by, self.turning = None, turning
        self._passes_m2 = self.strip.left_m2
        turning.go_past(self.motion, *self.estimate.lane.backwards)
        return True

    def creep(self, to_m: float) -> None:
        """On without an edge, up to that travelled distance."""
        self.crept += 1
        self._creeps_to_m = to_m

    def creeps(self, now: float) -> bool:
        """Whether it does, with eyes open."""
        return self.motion.distance_m < self._creeps_to_m and not self.blind(now)

    def moves_aside(self, now: float) -> bool:
        """Whether it leaves the crop that stands on both sides of it, with eyes open."""
        return self.sight.moves_aside(self.motion) and not self.blind(now)

    def goes_unseeing(self, now: float) -> bool:
        """Whether the machine may drive on by dead reckoning that has lost the edge at a strip's
        beginning, or behind a bend, and looked for it in vain: a low camera among stalks that the
        turn has left beside the blade shows no more, a machine inside of the edge sees crop on both
        sides, and an edge that bends to the right leaves the picture.
        Only in crop that is the field's beyond doubt, and without any sight of it no farther than
        such stalks can stand."""
        beside = self.strip.beside_swath
        begins = beside or self.strip.straight_m(self.motion) < BEGINNING_M
        begins = begins and self.motion.distance_m - self.sight.seen_at_m < BLIND_ON_M
        ahead = self.sight.ahead
        # Elsewhere, nobody knows whose stems those are before the blade has met the strip's own.
        met = ahead.entered and self.turning is None
        hidden = self.hidden and not (met or beside)
        own = beside or self.strip.surely_own
        return begins and own and not (hidden or self.blind(now))

    # ---- commands --------------------------------------------------------------------------------

    def drive(self, steer_rad: float, speed_mps: float, *, blade: bool) -> Command:
        """Motion."""
        return Command(Request.DRIVE, steer_rad, speed_mps, blade)

    def hold(self, *, blade: bool = False) -> Command:
        """Stands with the steering as it is."""
        return self.drive(self.telemetry.angle_rad if self.telemetry else 0.0, 0.0, blade=blade)

    def stop(self) -> Command:
        """All outputs off, disarmed."""
        return Command(Request.STOP)
