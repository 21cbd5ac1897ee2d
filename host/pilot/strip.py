"""The strip that is being cut: where on it the machine is, and what the plan says of it.

`Strip` answers for a machine without a plan, or that does not know its place in it yet: pictures
alone begin and end anything. `PlannedStrip` answers for a side of the plan.
"""

from __future__ import annotations

import math
from dataclasses import replace

from host.core.vehicle import Vehicle
from host.estimate.crop_ahead import NEAR_CROP_M, Ahead, EndOfField
from host.estimate.estimator import Estimator
from host.estimate.odometry import Motion
from host.pilot.turn_progress import Turning
from host.route.plan import SEEN_SHARE, Plan, Side
from host.vision.view import CropView

END_PAST_M = 0.15
"""Beyond the plan's end of a side, from where on clear ground is more likely than dust."""
DOUBTED_M = 0.3
"""Before the first sure picture without crop, at most: what a detector waits for, at full speed."""
EARLY_M = 0.8
LATE_M = 0.9
"""How far before or after the plan's end of a side vision may end it; less than a gap."""
LAST_EARLY_M = 0.3
"""On the last side: no turn needs the room, and what seemed clear is cut on the way to its end."""
BLADE_ON_M = 0.6
"""Before the crop of a side."""
SKIP_SIDE_M = 3.0
"""A side up to this long without any crop is driven along to the next."""
NO_CROP_M = 1.2
"""Crop this much farther after a turn than the plan says is somebody else's, or none."""
REMNANT = 0.015
"""Share of the plan that may be given up as done where nothing shows it."""
ANCHOR_EVERY_M = 0.5
HEADING_SIGMA_RAD = math.radians(4)
CORNER_M = 0.3
"""How far along a side a slanting border's corner may lie from where dead reckoning has it."""
SQUARE_M = 0.1
"""A border that crosses the strip over less is no slanting one."""
TURN_KNOWN_M = 4.0
"""Distance along a side after which the lane filter's direction is trusted."""
TURN_LEAST_RAD = 0.5
"""A smaller turn says little of how much more or less than its steering the machine turns."""
SHUTTLE_LEARN_M = 6.0
"""A shorter strip of a shuttle ends while it is being straightened still, and the next is begun by
the same turn: strip after strip would teach the bias what that leaves."""
SURE_M = 3.0
"""Of a side that is left, by which crop before the blade is the field's own: three times what a
corner of a walked boundary errs;"""
SURE_SHARE = 0.4
"""and the share of it, for an odometer that loses half of its pulses: at the true end it still has
0.38 of the side to go."""
BEND_AHEAD_M = 0.15
"""Before a bend of the edge the steering begins to follow it: half of what it takes to turn at
cutting speed."""
PLACE_SIGMA_M = 0.12
PLACE_SIGMA_RAD = math.radians(2.5)
"""Of the pose after a turn by dead reckoning, besides what a wrong speed adds."""


class Strip:
    """A strip of which nothing is known but what the pictures show. `index` counts the plan's sides
    that are left, or the turns."""

    last = False
    """Whether the plan has no side after it."""
    remnant = False
    """Whether what the plan has left is next to nothing."""
    blind_end = False
    """Whether it ends in standing crop, where no picture shows it."""
    begins_slanting = False
    """Whether the crop's border slants across its beginning: no edge is seen there at first."""
    placed = False
    """Whether the machine knows its place in the plan."""
    skippable = False
    """Whether it is driven along to the next where its crop is not found."""
    search_reach_m = 0.0
    """How far beyond its expected beginning crop is looked for that is not in view; 0: not."""
    teaches = True
    """Whether driving along it shows the steering's bias."""
    clear_end_m = 0.0
    """How far its blade may run over clear ground: over a last tip that is too narrow to be seen,
    and over what earlier rounds have cut between its end and the boundary."""
    back_m = 0.0
    """From the beginning of the crop back to the boundary or a keep-out."""
    bent = False
    """Whether its edge bends on the way."""
    shift_m = 0.0
    """How far right of its usual place the lane lies."""

    def __init__(
        self, plan: Plan, index: int, vehicle: Vehicle, estimate: Estimator, ahead: Ahead
    ) -> None:
        self.plan = plan
        self.index = index
        self.vehicle = vehicle
        self.estimate = estimate
        self.ahead = ahead
        self.search_m = math.inf
        """How far along the strip its crop is looked for where it was not in view."""

    @property
    def name(self) -> str:
        """In words that count from 1."""
        return self.plan.name(self.index)

    def along_m(self, motion: Motion) -> float:
        """How far the blade had come past the strip's beginning at a motion."""
        return self.ahead.cut_m(motion)

    def past_end(self, motion: Motion) -> bool:
        """Whether clear ground is to be expected there."""
        return False

    def end_due(self, motion: Motion) -> bool:
        """Whether the strip may end there."""
        return True

    def overrun(self) -> bool:
        """Whether the blade has passed the field's boundary, whatever vision says."""
        return False

    def left_m(self) -> float:
        """What the plan still has of it before the blade; 0 where it has nothing."""
        return 0.0

    @property
    def surely_own(self) -> bool:
        """Whether the plan has crop before the blade by more than any belief errs."""
        return False

    def to_blind_end_m(self) -> float:
        """From where the blade will stop to where the strip ends before a keep-out; inf: it does
        not."""
        return math.inf

    def shows_edge(self, along_m: float) -> bool:
        """Whether the strip's outer edge, and no slanting border, is what a picture shows there."""
        return True

    def edge_m(self, view: CropView, then: Motion) -> float:
        """The edge's offset from its place beside this strip's lane in a picture taken then."""
        return view.edge_offset_m

    def corner(self, view: CropView, then: Motion) -> tuple[float, float] | None:
        """Where the border slants across the strip: the outer edge's offset by the corner that a
        picture shows, m, and how far before the blade that corner is; None where none is."""
        return None

    def seen_beside(self, view: CropView, then: Motion) -> None:
        """Its edge was seen beside the lane: so far at least it is looked for."""

    def blade_due(self) -> bool:
        """Whether the blade must turn. On the way to a side's crop it would only raise dust, just
        where the edge is to be found."""
        return True

    def met_begin(self, ago_m: float) -> None:
        """The blade met the crop, and has travelled ago_m since."""

    def met_end(self, end: EndOfField, view: CropView | None, *, looked: bool) -> None:
        """Vision saw the end; `looked`: after the machine had stopped to look."""

    def believe_heading(self) -> None:
        """The position's heading, for the lane filter where vision sees no direction."""

    def cut(self) -> None:
        """The blade is cutting: what the way along the strip teaches."""

    def begin_leg(self, turning: Turning) -> None:
        """A turn backs along this strip from now on: the lane filter speaks of it."""
        offset, turned = turning.against_lane(self.estimate.motion)
        offset_sigma, heading_sigma = self._place_sigmas(turning)
        self.estimate.lane.place(offset, turned, offset_sigma, heading_sigma)

    def leave(self, following: Strip, end: EndOfField) -> tuple[float, float, float]:
        """Ends this strip. The frame of the turn to the next, in dead reckoning's (x, y,
        direction): the rear axle's place on the lane when the blade stands at the strip's end."""
        here = self.estimate.motion
        # The lane's direction, not the vehicle's momentary heading, is what the corner adds to.
        return end.motion.x_m, end.motion.y_m, here.yaw_rad - self.estimate.lane.heading_rad

    def end_pose(self) -> tuple[float, float, float] | None:
        """(x, y, heading) of the rear axle on the lane at the strip's end, in the field frame."""
        return None

    def _place_sigmas(self, turning: Turning) -> tuple[float, float]:
        scale = self.estimate.odometry.scale_sigma
        return PLACE_SIGMA_M + 2 * scale, PLACE_SIGMA_RAD + turning.turn.lane_rad * scale


class PlannedStrip(Strip):
    """A side of the plan, on which the machine knows its place."""

    placed = True

    def __init__(
        self, plan: Plan, index: int, vehicle: Vehicle, estimate: Estimator, ahead: Ahead
    ) -> None:
        super().__init__(plan, index, vehicle, estimate, ahead)
        self.side: Side = plan.sides[index]
        side, areas = self.side, [side.length_m * side.width_m for side in plan.sides]
        self.last = index + 1 >= len(plan.sides)
        self.remnant = sum(areas[index:]) < REMNANT * sum(areas)
        self.blind_end = side.blind_end
        self.begins_slanting = side.edge_begin_m > SQUARE_M
        self.skippable = side.length_m < SKIP_SIDE_M
        self.search_reach_m = 0.0
        if not self.remnant:
            self.search_reach_m = side.length_m if self.skippable else NO_CROP_M
        first_of_edge = index == 0 or plan.corner_rad(index - 1) != 0.0
        self.teaches = side.length_m > SHUTTLE_LEARN_M or first_of_edge
        self.back_m, self.shift_m = side.back_m, side.shift_m
        self.clear_end_m = side.end_seen_m + max(0.0, side.fence_m - side.length_m)
        self.bent = bool(side.bends)
        self._pieces = side.pieces()
        self._at = 0
        """Which of them the blade is at."""
        self._anchored: Motion | None = None
        self._turned_from: tuple[float, float] | None = None

    @property
    def piece(self) -> Side:
        """The straight piece of the side that the blade is at."""
        return self._pieces[self._at][1]

    def place(self, along_m: float) -> None:
        """The machine stands with the blade along_m past where vision sees the beginning."""
        lane = self.estimate.lane
        self._at = max(k for k, (start, _) in enumerate(self._pieces) if k == 0 or start <= along_m)
        start, piece = self._pieces[self._at]
        self.estimate.position.place(piece, along_m - start, lane.offset_m, lane.heading_rad)

    def along_m(self, motion: Motion) -> float:
        """By the position, in which what was seen of the beginning has its part."""
        travelled = self.estimate.motion.distance_m - motion.distance_m
        start, piece = self._pieces[self._at]
        return start + self.estimate.position.along(piece) - travelled

    def past_end(self, motion: Motion) -> bool:
        return self.along_m(motion) > self.side.length_m + END_PAST_M

    def end_due(self, motion: Motion) -> bool:
        """Clear ground well before the plan's end is a bare patch: the machine creeps on over it. A
        slanting border's tip is too narrow to be seen. A side that is shorter than that allows does
        not end before it begins."""
        doubt = 2 * self.estimate.odometry.scale_sigma
        early = LAST_EARLY_M if self.last else EARLY_M + 2 * self.side.end_seen_m
        return self.along_m(motion) > max(0.0, (1 - doubt) * self.side.length_m - early)

    @property
    def surely_own(self) -> bool:
        return self.left_m() > max(SURE_M, SURE_SHARE * self.side.length_m)

    def left_m(self) -> float:
        return max(0.0, self.side.length_m - self.along_m(self.estimate.motion))

    def overrun(self) -> bool:
        farthest = 1 + self.estimate.odometry.scale_sigma
        farthest *= self.along_m(self.estimate.motion)
        return farthest > self.side.fence_m + LATE_M

    def to_blind_end_m(self) -> float:
        if not self.blind_end:
            return math.inf
        here = self.estimate.motion
        coast = here.speed_mps * self.vehicle.drive_lag_s
        return self.side.length_m - self.along_m(here) - coast

    def shows_edge(self, along_m: float) -> bool:
        side = self.side
        begin, end = side.edge_begin_m + CORNER_M, side.length_m - side.edge_end_m - CORNER_M
        return (side.edge_begin_m <= SQUARE_M or along_m >= begin) and (
            side.edge_end_m <= SQUARE_M or along_m <= end
        )

    def edge_m(self, view: CropView, then: Motion) -> float:
        """Its bends taken off: those that the machine itself has driven a round earlier."""
        at = self.along_m(then) + view.edge_ahead_m
        bend = self.estimate.trails.bend_m(at - self._pieces[self._at][0], self.piece)
        return view.edge_offset_m - self.side.shift_m - bend

    def corner(self, view: CropView, then: Motion) -> tuple[float, float] | None:
        """The outer edge runs from it: a line of sight from the rear axle, near which the cameras
        sit."""
        corner = self.side.edge_begin_m - self.along_m(then)
        if corner <= view.edge_ahead_m:
            return None
        blade, inset = self.vehicle.blade_x_m, self.vehicle.inset_m
        edge = (view.edge_offset_m - inset) * (blade + corner) / (blade + view.edge_ahead_m) + inset
        return edge - self.side.shift_m, corner

    def seen_beside(self, view: CropView, then: Motion) -> None:
        """A side whose first metres have gone with its neighbours."""
        if self.along_m(then) + view.crop_ahead_m < self.side.length_m:
            seen_m = self.ahead.cut_m(then) + view.crop_ahead_m + NEAR_CROP_M
            self.search_m = max(self.search_m, seen_m)

    def blade_due(self) -> bool:
        if self.ahead.entered:
            return True
        here = self.estimate.motion
        seen = self.ahead.crop_at_m - here.distance_m
        return min(seen, -self.along_m(here)) < BLADE_ON_M

    def met_begin(self, ago_m: float) -> None:
        self.estimate.position.at_begin(self._pieces[0][1], ago_m)

    def met_end(self, end: EndOfField, view: CropView | None, *, looked: bool) -> None:
        here = self.estimate.motion
        first = self.ahead.seems_clear_since or end.motion
        ended_m = max(first.distance_m, end.motion.distance_m - DOUBTED_M)
        doubt = 0.0
        if looked:
            # Somewhere between where dust began to look like clear ground and here.
            doubt = (here.distance_m - ended_m) / 2
        ago = here.distance_m - ended_m - doubt
        drift = self.estimate.odometry.scale_sigma * self.ahead.cut_m(end.motion)
        share = view.tip_share if view is not None else math.nan
        share = share / SEEN_SHARE if math.isfinite(share) else 1.0
        last = self._pieces[-1][1]
        as_seen = replace(last, end_seen_m=share * last.end_seen_m)
        self.estimate.position.at_end(as_seen, ago, drift, doubt)

    def believe_heading(self) -> None:
        _, heading, _, sigma = self.estimate.position.against_lane()
        sigma = max(HEADING_SIGMA_RAD, sigma)
        self.estimate.lane.correct_heading(heading, sigma, learn=self.teaches)

    def cut(self) -> None:
        """Its line is a known place, once per ANCHOR_EVERY_M; its way is the next round's edge; and
        once, where the lane is known again, it tells how far the turn to it has turned."""
        here = self.estimate.motion
        since = self._anchored
        if since is None or abs(here.distance_m - since.distance_m) >= ANCHOR_EVERY_M:
            self._anchored = here
            lane = self.estimate.lane
            self.estimate.position.follow(lane.blade_offset_m, lane.offset_sigma_m)
        self.estimate.trails.note(self.along_m(here) - self._pieces[self._at][0], here)
        bends = [start for start, _ in self._pieces[self._at + 1 : self._at + 2]]
        if bends and self.along_m(here) > bends[0] - BEND_AHEAD_M:
            self._pass_bend()
        if self._turned_from is not None and self.ahead.cut_m(here) >= TURN_KNOWN_M:
            yaw, direction = self._turned_from
            self._turned_from = None
            reckoned = here.yaw_rad - yaw
            true = self._direction_rad() - direction
            true = reckoned + math.remainder(true - reckoned, math.tau)
            if abs(reckoned) > TURN_LEAST_RAD:
                self.estimate.odometry.turned(reckoned, true)

    def begin_leg(self, turning: Turning) -> None:
        offset, turned, *sigmas = self.estimate.position.against_lane()
        known = zip(self._place_sigmas(turning), sigmas, strict=True)
        self.estimate.lane.place(offset, turned, *(max(pair) for pair in known))

    def leave(self, following: Strip, end: EndOfField) -> tuple[float, float, float]:
        """By the position, in which the end that was seen has its part."""
        while self._at + 1 < len(self._pieces):
            self._pass_bend()
        origin = self._origin()
        self.estimate.trails.end(self.piece)
        if isinstance(following, PlannedStrip):
            here, turned_from = self.estimate.motion, None
            if self.ahead.entered and self.ahead.cut_m(here) > TURN_KNOWN_M:
                turned_from = here.yaw_rad, self._direction_rad()
            following.arrive(turned_from, self._anchored)
        return origin

    def arrive(self, turned_from: tuple[float, float] | None, anchored: Motion | None) -> None:
        """The turn to this strip begins: dead reckoning's yaw and the vehicle's direction in the
        field before it, where that is well known, and where the position was anchored last."""
        self._turned_from, self._anchored = turned_from, anchored
        self._at = 0
        self.estimate.trails.begin(self.piece)
        self.estimate.position.begin(self.piece)

    def _pass_bend(self) -> None:
        """The blade comes to the next bend: what is known goes on, against the line beyond."""
        past = self.piece
        self._at += 1
        behind_m = self.vehicle.blade_x_m - BEND_AHEAD_M
        turn = math.remainder(self.piece.heading_rad - past.heading_rad, math.tau)
        self.estimate.lane.bend(turn, behind_m)
        self.estimate.trails.end(past)
        self.estimate.trails.begin(self.piece)
        self.estimate.position.begin(self.piece)
        self._turned_from = None

    def end_pose(self) -> tuple[float, float, float] | None:
        side = self._pieces[-1][1]
        c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
        along = side.length_m - self.vehicle.blade_x_m
        inside = self.vehicle.inset_m - side.shift_m
        x, y = side.x_m + c * along - s * inside, side.y_m + s * along + c * inside
        return x, y, side.heading_rad

    def _origin(self) -> tuple[float, float, float]:
        here, side = self.estimate.motion, self.piece
        x, y, yaw = self.estimate.position.pose
        c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
        dx, dy = x - side.x_m, y - side.y_m
        along = c * dx + s * dy + self.vehicle.blade_x_m - side.length_m
        across = c * dy - s * dx - self.vehicle.inset_m + side.shift_m
        direction = here.yaw_rad - math.remainder(yaw - side.heading_rad, math.tau)
        c, s = math.cos(direction), math.sin(direction)
        x0 = here.x_m - c * along + s * across
        return x0, here.y_m - s * along - c * across, direction

    def _direction_rad(self) -> float:
        """The vehicle's in the field frame, by the lane that it follows."""
        return self.piece.heading_rad + self.estimate.lane.heading_rad
