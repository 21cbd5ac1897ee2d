"""A side of the plan: where it is found to lie, and where it may end."""

from __future__ import annotations

import math

from host.core.frames import Pose2
from host.core.vehicle import Vehicle
from host.estimate.crop_ahead import AT_BLADE_M, Ahead
from host.estimate.estimator import Estimator
from host.estimate.gaps import TAPE_M
from host.estimate.measurements.goes_on import goes_on
from host.estimate.odometry import Motion
from host.estimate.prior import START_SIGMA
from host.pilot.strip import Strip, little_m2
from host.route.plan import Plan
from host.route.put_down import moved_up_m
from host.route.side import NO_EDGE, Side

END_PAST_M = 0.15
"""Beyond the plan's end of a side, from where on clear ground is more likely than dust."""
EARLY_M = 0.8
LATE_M = 0.9
"""How far before or after the plan's end of a side vision may end it; less than a gap."""
LAST_EARLY_M = 0.3
"""On the last side: no turn needs the room, and what seemed clear is cut on the way to its end."""
SKIP_SIDE_M = 3.0
"""A side up to this long without any crop is driven along to its end, and so is one that is next to
nothing."""
LATE_SHARE = 0.3
"""Of the plan that is left, up to which strips have shown that the field is this one."""
NO_CROP_M = 1.2
"""Crop this much farther after a turn than the plan says is somebody else's, or none."""
CORNER_M = 0.3
"""How far along a side a slanting border's corner may lie from where dead reckoning has it."""
SQUARE_M = 0.1
"""A border that crosses the strip over less is no slanting one."""
SLANTS = 4.0
"""Widths of a strip over which a border crosses it that slants: by 14 degrees. One that takes
longer is an edge to be followed, as an inner corner's other side is, wherever the corner lies."""
SHUTTLE_LEARN_M = 6.0
"""A shorter strip of a shuttle ends while it is being straightened still, and the next is begun by
the same turn: strip after strip would teach the bias what that leaves."""
SURE_M = 3.0
"""Of the field that lies ahead, by which crop before the blade is its own: three times what a
corner of a walked boundary errs;"""
SURE_SHARE = 0.4
"""and the share of the way across it, from where the side begins, for an odometer that loses half
of its pulses: at the true border it still has 0.38 of that to go."""
DEEP_M = 3.5
"""Inside the boundary what stands is the field's: no side is said so much too long."""
DEEP_SIGMAS = 10.0
"""Or so many of what corners and place err, if that is more."""
SIGMAS = 2.0
"""Of an end that was never seen: clear ground within so many of its standard deviations may be it,
crop beyond as many may be the neighbour's."""
END_SIGMAS = 4.0
"""Within so many of where a side was taken to end a look may find its end, and crop that goes on
moves it; more is another error. Where the boundary is said to be known exactly it cannot give way:
there it is SIGMAS, or the machine would take its own place to be wrong instead."""
FOUND_SIGMA_M = 0.3
"""Of an end that was found elsewhere, before its own measurement is taken."""
UNKNOWN_M = 0.3
"""Standard deviation of a side's end from which on it is found by cutting towards it."""
GOES_ON_M = 0.05
"""By which an end must give way at least, for the plan's sides to be moved."""
BLIND_M = 0.6
"""Where a new side may end, the way in dust after which it is looked for: half of the narrowest
gap that is harvested beside."""
OUTWARD_M = 0.4
"""Most by which a turn leads the machine outside of an edge that it has not seen: from outside the
crop's right end is in view, from inside nothing but crop."""
UNSURE_SHARE = 0.5
"""Of a side, at most, in which clear ground may be its end for that."""
LEFT_OVER_M = 1.0
"""Beyond a side's end, on ground that is cut: what stands there for longer is another side's."""
LATE_SIGMAS = 3.0
"""A side that is longer by more than so many is not that side: something else is wrong."""
INSIDE_SIGMA = (1.0, math.radians(4))
"""Of where along an edge that bends its owner finds the place again at which his walk began, and of
the machine's direction against the edge there, m and rad."""
CUT_BEFORE_M = 0.4
"""Half of the way in which the end of a side lies that was cut to it in an earlier run: what the
progress errs, and what a person puts the machine wrong."""


class PlanSide(Strip):
    """A side of the plan, on which the machine knows its place."""

    placed = True

    def __init__(
        self, plan: Plan, index: int, vehicle: Vehicle, estimate: Estimator, ahead: Ahead
    ) -> None:
        super().__init__(plan, index, vehicle, estimate, ahead)
        side, areas = plan.sides[index], [side.length_m * side.width_m for side in plan.sides]
        self._planned = side
        self.last = index + 1 >= len(plan.sides)
        self.blind_end = side.blind_end
        self.tip_m = side.edge_end_m
        self.begins_slanting = side.edge_begin_m > SQUARE_M
        self.skippable = side.length_m < SKIP_SIDE_M or areas[index] < little_m2(plan)
        late = sum(areas[index:]) < LATE_SHARE * sum(areas)
        self.outermost = side.inside_m <= vehicle.blade_width_m / 2
        self.may_be_gone = late or not self.outermost
        self.search_reach_m = 0.0
        if sum(areas[index:]) >= little_m2(plan):
            self.search_reach_m = side.length_m if self.skippable else NO_CROP_M
        self._first_of_edge = index == 0 or plan.corner_rad(index - 1) != 0.0
        self.teaches = side.length_m > SHUTTLE_LEARN_M or self._first_of_edge
        self._beyond_m = max(0.0, side.fence_m - side.length_m)
        """How far the field goes on beyond its end, over ground that is cut."""
        self.back_m, self.shift_m, self.width_m = side.back_m, side.shift_m, side.width_m
        self.clear_end_m = side.end_seen_m + self._beyond_m
        self.resumed = index == 0 and side.begins_at == NO_EDGE
        self._edge_runs = plan.begins_along if index == 0 else (0.0, 0.0)
        """How it runs where the operator puts the machine down inside its crop."""
        self._ends_in_arc = plan.goes_round(side)
        self._begun_sigma_m = INSIDE_SIGMA[0] if plan.closes(side) else 0.0
        """Of its end, where that is no border but where the first side began inside the crop."""
        self.bends_rad = max((abs(turn) for _, turn in side.bends), default=0.0)
        at_end, before = side.ends_at, plan.sides[:index]
        self._border_met = at_end != NO_EDGE and any(
            at_end == past.ends_at or at_end in past.edges for past in before
        )
        """Whether a side before has ended at the same border or run along it."""
        self._begun_again = any(past.begins_as(side) for past in before)
        self._ended_again = any(past.ends_as(side) for past in before)
        self._straight = [piece for _, piece in side.pieces()]
        """As planned."""
        self._at = 0
        """Which of them the blade is at."""
        self._on_lane = False
        """Whether the present lane is its own, and no more the last strip's."""
        self._crop_at_m = -math.inf
        """The travelled distance up to which crop has been seen to go on from what was cut."""
        self._expected_m, self._doubt_m = side.length_m, 0.0
        """Where the side was taken to end before anything was seen of it, and how surely."""
        self._found_off_m = 0.0
        """How far from where it was expected a look has found its end."""

    @property
    def side(self) -> Side:
        """Where it is found to lie."""
        return self.estimate.position.outline.found(self._planned)

    @property
    def _pieces(self) -> list[tuple[float, Side]]:
        """(where along the side it begins, it) of each straight piece, where they are found."""
        return self.estimate.position.outline.pieces(self._planned)

    @property
    def planned_piece(self) -> Side:
        """The straight piece of the side that the blade is at, as planned: what the position takes
        for a side."""
        return self._straight[self._at]

    @property
    def piece(self) -> Side:
        """The same where it is found to lie."""
        return self.estimate.position.outline.found(self.planned_piece)

    def place(
        self,
        along_m: float,
        sigma_m: float = START_SIGMA[1],
        along_sigma_m: float = START_SIGMA[0],
    ) -> None:
        """The machine stands with the blade along_m past where vision sees the beginning, give or
        take along_sigma_m; sigma_m: how surely it is known beside the edge."""
        lane = self.estimate.lane
        self._at = max(k for k, (start, _) in enumerate(self._pieces) if k == 0 or start <= along_m)
        start = self._pieces[self._at][0]
        position, piece = self.estimate.position, self.planned_piece
        askew_rad, bend_1pm = self._edge_runs
        sigmas = (along_sigma_m, sigma_m, INSIDE_SIGMA[1] if bend_1pm else START_SIGMA[2])
        # With its blade at the edge's beginning the axle lies behind it along the edge.
        offset_m = lane.offset_m - self.vehicle.blade_x_m * math.sin(askew_rad)
        heading_rad = lane.heading_rad + askew_rad
        position.place(piece, along_m - start, offset_m, heading_rad, sigmas, bend_1pm)
        self._on_lane = True
        self._note_doubt()

    def put_down(self, crop_ahead_m: float) -> tuple[float, float]:
        """How far past its beginning the operator has put the blade, m, and how surely, where the
        camera sees crop so far ahead of it. A machine that has no room for its length in the gap
        stands so much farther in its crop, and no picture shows where that begins."""
        if self._edge_runs != (0.0, 0.0):
            return -crop_ahead_m, INSIDE_SIGMA[0]
        if crop_ahead_m >= AT_BLADE_M or self.plan.gap_m is None or self.resumed:
            return -crop_ahead_m, START_SIGMA[0]
        lacks_m = moved_up_m(self.plan, self.side, self.vehicle) - self.side.begin_seen_m
        least_m, most_m = max(0.0, lacks_m - TAPE_M), max(0.0, lacks_m + TAPE_M)
        return max(0.0, lacks_m), math.hypot(START_SIGMA[0], (most_m - least_m) / math.sqrt(12.0))

    def _note_doubt(self) -> None:
        position = self.estimate.position
        self._doubt_m = self._end_sigma_m if position.outline.states else 0.0
        self._expected_m = self.side.length_m

    def along_m(self, motion: Motion) -> float:
        """By the position, in which what was seen of the beginning has its part."""
        travelled = self.estimate.odometry.now.distance_m - motion.distance_m
        start = self._pieces[self._at][0] if self._at else 0.0
        return start + self.estimate.position.along(self._straight[self._at]) - travelled

    def straight_m(self, motion: Motion) -> float:
        return self.along_m(motion) - (self._pieces[self._at][0] if self._at else 0.0)

    @property
    def _crop_to_m(self) -> float:
        """How far along the side crop goes on from what was cut."""
        here = self.estimate.motion
        return max(0.0, self.along_m(here) - (here.distance_m - self._crop_at_m))

    def past_end(self, motion: Motion) -> bool:
        return self.along_m(motion) > self.side.length_m + END_PAST_M

    def end_due(self, motion: Motion) -> bool:
        """Clear ground well before the plan's end is a bare patch: the machine creeps on over it. A
        slanting border's tip is too narrow to be seen. A side that is shorter than that allows does
        not end before it begins."""
        return self.along_m(motion) > max(0.0, self._end_from_m())

    def _end_from_m(self) -> float:
        """Along the side, from where on clear ground may be its end; negative: before it begins."""
        doubt = 2 * self.estimate.odometry.scale_sigma
        early = LAST_EARLY_M if self.last else EARLY_M + 2 * self.side.end_seen_m
        length = self.side.length_m
        early += min(SIGMAS * self._doubt_m, UNSURE_SHARE * length)
        return (1 - doubt) * length - early

    def may_be_cut(self) -> bool:
        """Whether a side that was begun in an earlier run may have been cut to its end by then."""
        return self.resumed and self._end_from_m() < 0.0

    def was_cut(self) -> None:
        """It was: its end is hereabouts."""
        if self.new:
            self.estimate.position.at_end(self._straight[-1], 0.0, 0.0, CUT_BEFORE_M)

    def may_end_at(self, along_m: float) -> bool:
        doubt_m = max(self._doubt_m, self._end_sigma_m)
        early_m = EARLY_M + SIGMAS * doubt_m
        if self.estimate.position.outline.states:
            early_m = EARLY_M + END_SIGMAS * max(doubt_m, UNKNOWN_M)
        return along_m > max(0.0, self.side.length_m - early_m)

    def ends_at(self, along_m: float) -> None:
        off_m = abs(along_m - self.side.length_m)
        last, position = self._straight[-1], self.estimate.position
        if off_m <= SIGMAS * max(self._doubt_m, 0.0 if self.new else self._end_sigma_m):
            return
        if self._may_lie_elsewhere:
            position.ends_at(last, along_m - self._pieces[-1][0], FOUND_SIGMA_M**2)
        else:
            self._found_off_m = off_m

    @property
    def _end_sigma_m(self) -> float:
        border_m = self.estimate.position.end_sigma_m(self._straight[-1])
        return math.hypot(border_m, self._begun_sigma_m)

    @property
    def surely_crop(self) -> bool:
        return self._beyond_doubt(0.0)

    @property
    def surely_own(self) -> bool:
        if self.estimate.position.likely > 0.0:
            # where the strip ends is what the two places disagree on: nothing beyond it counts
            return self.surely_crop
        # how surely the end is known is asked only where it decides: it takes long
        if self._beyond_doubt(self._beyond_m):
            along_m = self.along_m(self.estimate.motion)
            if self._beyond_doubt(0.0) or not self.may_end_at(along_m):
                return True
        return self.deep_inside

    @property
    def deep_inside(self) -> bool:
        """Whether the blade is farther inside the boundary, as that was found, than any belief
        errs."""
        position = self.estimate.position
        if not position.known:
            return False
        blade = Pose2(*position.pose).ahead(self.vehicle.blade_x_m)
        inside_m = position.outline.inside_m(blade.x_m, blade.y_m)
        return inside_m > DEEP_M and inside_m > DEEP_SIGMAS * position.corners_sigma_m

    def _beyond_doubt(self, more_m: float) -> bool:
        """Whether what is left of the side, and so much more, is more than any belief errs,
        wherever the machine is of two places at which it may be."""
        left = self.left_m() + more_m - SIGMAS * self._doubt_m - self.estimate.position.apart_m
        return left > max(SURE_M, SURE_SHARE * (self.side.length_m + more_m))

    def left_m(self) -> float:
        return max(0.0, self.side.length_m - self.along_m(self.estimate.odometry.now))

    @property
    def left_m2(self) -> float:
        return self.left_m() * self.width_m

    @property
    def rest_m2(self) -> float:
        rest = self.plan.sides[self.index + 1 :]
        return sum(side.length_m * side.width_m for side in rest)

    def overrun(self) -> bool:
        farthest = 1 + self.estimate.odometry.scale_sigma
        farthest *= self.along_m(self.estimate.motion)
        last_m = min(self._planned.fence_m, self.side.length_m + LEFT_OVER_M) + LATE_M
        if farthest <= last_m:
            return False
        doubt_m = self._doubt_m
        if self.plan.gap_m is not None:  # a geofence watches
            doubt_m = max(doubt_m, self.estimate.position.end_sigma_m(self._straight[-1]))
        return farthest > last_m + LATE_SIGMAS * doubt_m

    def _cut_m(self, motion: Motion) -> float:
        """How far the side's crop has been cut, by the wheels alone. By the place the way to an end
        that gives way to crop would not grow: the place goes along with the end."""
        return self.ahead.cut_m(motion) if self.ahead.entered else 0.0

    def goes_on(self, motion: Motion) -> None:
        """Crop stood at the blade then: a side whose end is not known yet does not end before."""
        self._crop_at_m = max(self._crop_at_m, motion.distance_m)
        if self.side.left_over:
            return
        ago_m = self.estimate.motion.distance_m - motion.distance_m
        self.estimate.position.crop_at(self._straight[-1], ago_m)
        late_m = max(self._crop_to_m, self._cut_m(motion)) - self._expected_m
        if not self._may_lie_elsewhere or late_m > END_SIGMAS * self._doubt_m:
            return
        start, last = self._pieces[-1]
        known = goes_on(self._crop_to_m, self._expected_m, self._doubt_m)
        if known is not None and known[0] > start + last.length_m + GOES_ON_M:
            self.estimate.position.ends_at(self._straight[-1], known[0] - start, known[1])

    def blind(self) -> bool:
        here = self.estimate.motion
        return self.new and self.along_m(here) - self._crop_to_m > BLIND_M and self.end_due(here)

    def sure_ahead_m(self) -> float:
        return max(0.0, self.side.length_m - self._crop_to_m)

    def to_blind_end_m(self) -> float:
        if not self.blind_end and self._begun_sigma_m == 0.0:
            return math.inf
        here = self.estimate.motion
        coast = here.speed_mps * self.vehicle.drive_lag_s
        return self.side.length_m - self.along_m(here) - coast

    def shows_edge(self, along_m: float) -> bool:
        side = self.side
        # Where the first side began, a machine that followed the crop would drive the next round.
        if along_m > side.length_m - SIGMAS * self._begun_sigma_m and self._begun_sigma_m > 0.0:
            return False
        begin, end = side.edge_begin_m + CORNER_M, side.length_m - side.edge_end_m - CORNER_M
        slants_m = SLANTS * side.width_m
        # A machine that followed it round the arc would drive the next side for this one.
        behind_m = math.inf if self._ends_in_arc else slants_m
        return (not SQUARE_M < side.edge_begin_m < slants_m or along_m >= begin) and (
            not SQUARE_M < side.edge_end_m < behind_m or along_m <= end
        )

    def along_edge_m(self, motion: Motion) -> float:
        """From an inner corner on that is another border, which nobody has driven along."""
        side, along_m = self.side, self.along_m(motion)
        corner_m = side.length_m - side.edge_end_m
        past = side.edge_end_m > SLANTS * side.width_m and along_m > corner_m
        return along_m - corner_m if past else along_m

    def before_edge(self, here: Motion) -> bool:
        along_m = self.along_m(here)
        begins = along_m < self.side.length_m / 2
        return self.begins_slanting and begins and not self.shows_edge(along_m)

    @property
    def new(self) -> bool:
        return self._doubt_m >= UNKNOWN_M

    @property
    def _may_lie_elsewhere(self) -> bool:
        """Whether an end elsewhere than expected tells where the border lies, and not the
        machine. What strips have left ends at no border."""
        return self.new and not self._border_met and not self.side.left_over

    @property
    def outward_m(self) -> float:
        if not (self.new and self._first_of_edge):
            return 0.0  # what is beside the last strip lies where the blade has left it
        return min(OUTWARD_M, self.estimate.position.beside_sigma_m(self.planned_piece))

    @property
    def begin_doubt_m(self) -> float:
        position = self.estimate.position
        back_m = max(0.0, self.along_m(self.estimate.motion))
        return SIGMAS * position.end_sigma_m(self._straight[0], -1, back_m)
