"""A strip of the plan as the machine drives along it: what pictures show of its edge, its beginning
and its end, and what the way along it teaches."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from host.core.frames import Pose2
from host.core.vehicle import Vehicle
from host.estimate.crop_ahead import END_SURE, NEAR_CROP_M, Ahead, EndOfField
from host.estimate.cut_guard import PATCH_M
from host.estimate.estimator import Estimator
from host.estimate.gaps import SQUARE_RAD
from host.estimate.measurements import begin, end
from host.estimate.motion_model import BESIDE, PRESSED
from host.estimate.odometry import Motion
from host.pilot.plan_side import SIGMAS, PlanSide
from host.pilot.strip import Beyond, Strip
from host.pilot.turn_progress import Turning
from host.route.boundary_edges import BoundaryEdges
from host.route.cuts import SEEN_SHARE
from host.route.plan import Plan
from host.route.side import NO_EDGE, Side
from host.vision.view import CropView

AT_BOUNDARY_M = 0.3
"""Of ground that was cut before beyond a side's end, at most, where the boundary is said to be
there: what a corner is rounded by."""
DOUBTED_M = 0.3
"""Before the first sure picture without crop, at most: what a detector waits for, at full speed."""
DUSTY_END_SIGMA_M = 0.35
"""Of an end that only a look has shown: 0.4 m from both mounts (model eyes, 38 such ends)."""
WENT_ON_SIGMA_M = 0.3
"""Which an end that was none has moved the machine by: such ends were 0.2 to 0.4 m early."""
BLADE_ON_M = 0.6
"""Before the crop of a side."""
CLEAR_M = 1.2
"""Of ground that pictures show to be clear, against the plan that has crop there: what stands
farther off may seem half as far again."""
LYING_M, STOPS_M = 0.5, 0.8
"""Of ground on which crop seems to lie, besides a patch, that the blade may cross: most patches of
lodged crop end, or show crop that stands, within so much. And of the gap what is left for the
machine to stop in before the neighbour's crop: half a metre and what was said too much of it.
Ground in a gap passed for crop that lies for half a metre (belief "said 2 m longer, surely")."""
TURN_KNOWN_M = 4.0
"""Distance along a side after which the lane's direction is trusted."""
TURN_LEAST_RAD = 0.5
"""A smaller turn says little of how much more or less than its steering the machine turns."""
BEND_AHEAD_M = 0.15
"""Before a bend of the edge the steering begins to follow it: half of what it takes to turn at
cutting speed."""


class _Before(NamedTuple):
    """Of a turn's beginning: dead reckoning's yaw, the vehicle's direction in the field, and the
    piece of the plan that it had followed."""

    yaw_rad: float
    direction_rad: float
    piece: Side


class PlannedStrip(PlanSide):
    """A side of the plan that is cut, or turned to."""

    def __init__(
        self, plan: Plan, index: int, vehicle: Vehicle, estimate: Estimator, ahead: Ahead
    ) -> None:
        super().__init__(plan, index, vehicle, estimate, ahead)
        self._pressed_m = 0.0
        """So much of its beginning is pressed down: no edge of it tells where it lies."""
        self._turned_from: _Before | None = None
        self._end_at_m = math.nan
        """The travelled distance at which the blade met its end."""
        self._goes_on_to_m = -math.inf
        """The travelled distance up to which its crop goes on, where an end was found to be none.
        """
        self._begun = False
        """Whether the machine drives along it, and no more to it."""

    @property
    def beside_swath(self) -> bool:
        estimate = self.estimate
        placed = (self._blade(borders.pose) for borders in estimate.position.all_borders)
        farther_m, begun_at = 0.0, self.ahead.begun_at
        if self._begun and begun_at is not None:
            counted_m = estimate.motion.distance_m - begun_at.distance_m
            farther_m = max(0.0, estimate.cut.driven_m - counted_m)
        return estimate.swaths.beside(self._blade(self._reckoned), placed, farther_m)

    @property
    def lies_its_crop(self) -> bool:
        if not self.outermost or self._border_met:
            return self.surely_crop
        # no strip has been cut across its end, so no swath lies there
        doubt_m = max(self._doubt_m, self._end_sigma_m)
        return self.along_m(self.estimate.motion) < self.side.length_m + SIGMAS * doubt_m

    @property
    def lying_m(self) -> float:
        gap_m = self.plan.gap_m
        if gap_m is None or not self.lies_its_crop:
            return 0.0
        return min(LYING_M, max(0.0, gap_m - PATCH_M - STOPS_M))

    @property
    def _reckoned(self) -> tuple[float, float, float]:
        here = self.estimate.motion
        return here.x_m, here.y_m, here.yaw_rad

    def _blade(self, pose: tuple[float, float, float]) -> Pose2:
        """Its middle, where the rear axle is at a pose."""
        return Pose2(*pose).ahead(self.vehicle.blade_x_m)

    def edge_m(self, view: CropView, then: Motion) -> float:
        """Its bends taken off: those that the machine itself has driven a round earlier."""
        at = self.along_m(then) + view.edge_ahead_m - self._pieces[self._at][0]
        bend = self.estimate.trails.bend_m(at, self.planned_piece)
        begin_m, slope = self.estimate.position.aside
        return view.edge_offset_m - self.side.shift_m - bend - begin_m - slope * at

    def edge_heading_rad(self, view: CropView) -> float:
        return view.edge_heading_rad - self.estimate.position.aside.slope

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
        if self.ahead.crop_at_m - here.distance_m < BLADE_ON_M:
            return True
        # By the plan alone the machine may stand beyond its field's end.
        due = -self.along_m(here) < BLADE_ON_M
        return due and self.ahead.surely_clear_m(here) < CLEAR_M

    @property
    def _begin_seen(self) -> bool:
        """Whether the turn to it has shown where its crop begins. Where the border slants, what is
        seen from afar is another of its rows."""
        return math.isfinite(self.ahead.begins_at_m) and not self.begins_slanting

    def _look_from_lane(self) -> None:
        """It is no more seen from beside, but where its edge is pressed down."""
        pressed = PRESSED if self._pressed_m > 0.0 else None
        self.estimate.position.look(self.planned_piece, pressed)

    def saw_begin(self) -> None:
        self._begun = True
        self._look_from_lane()  # a turn that was broken off has not led along it
        if self._begin_seen and not self.side.left_over:
            ago_m = self.estimate.motion.distance_m - self.ahead.begins_at_m
            self.estimate.position.at_begin(
                self._straight[0], ago_m, begin.SEEN_SIGMA_M, again=self._begun_again
            )

    def met_begin(self, ago_m: float) -> None:
        # Where the turn has pressed the crop down, what is met is not where it began. Where the
        # operator has put the machine inside its crop, nothing begins.
        in_crop = self._edge_runs != (0.0, 0.0)
        if not (self._begin_seen or self._pressed_m or self.side.left_over or in_crop):
            early_m = begin.EARLY_M if self.index > 0 else 0.0
            self.estimate.position.at_begin(
                self._straight[0], ago_m - early_m, again=self._begun_again
            )

    def met_end(self, end: EndOfField, view: CropView | None, *, looked: bool) -> None:
        if self.side.left_over:
            return
        here = self.estimate.motion
        sure_m, doubt = end.motion.distance_m, 0.0
        if looked and self.ahead.in_dust(*END_SURE):
            # Somewhere between where dust first let clear ground through and the first sure sight.
            first = self.ahead.clear_at_blade_since or end.motion
            half = max(0.0, sure_m - first.distance_m) / 2
            ended_m, doubt = sure_m - half, math.hypot(half, DUSTY_END_SIGMA_M)
        else:
            first = self.ahead.seems_clear_since or end.motion
            ended_m = max(first.distance_m, sure_m - DOUBTED_M)
        self._end_at_m = ended_m
        ago = here.distance_m - ended_m
        drift = self.estimate.odometry.scale_sigma * self.ahead.cut_m(end.motion)
        doubt = math.hypot(doubt, self._begun_sigma_m)
        share = view.tip_share if view is not None else math.nan
        share = share / SEEN_SHARE if math.isfinite(share) else 1.0
        last = self._straight[-1]
        as_seen = replace(last, end_seen_m=share * last.end_seen_m)
        self.estimate.position.at_end(
            as_seen, ago, drift, doubt, self._found_off_m, again=self._ended_again
        )
        self._found_off_m = 0.0

    def gap_beyond(self) -> Beyond | None:
        last = self._straight[-1]
        edge = last.ends_at
        if self.plan.gap_m is None or edge == NO_EDGE or self._beyond_m > AT_BOUNDARY_M:
            return None
        normal = BoundaryEdges(self.plan.boundary).headings[edge] - math.pi / 2
        askew = math.remainder(normal - last.heading_rad, math.tau)
        if abs(askew) > SQUARE_RAD:
            return None
        here = self.estimate.motion
        past = self.along_m(here) - self.side.length_m
        ago = here.distance_m - self._end_at_m - end.EARLY_M
        return Beyond(edge, askew, ago, past, (edge, last.edge))

    def end_due(self, motion: Motion) -> bool:
        return motion.distance_m > self._goes_on_to_m and super().end_due(motion)

    def end_was_one(self) -> None:
        ago_m = self.estimate.motion.distance_m - self._end_at_m
        self.estimate.position.ended(self._straight[-1], ago_m)

    def end_was_none(self, ahead_m: float) -> bool:
        if math.isfinite(self._goes_on_to_m):
            return False
        self._goes_on_to_m = self.estimate.motion.distance_m + ahead_m + NEAR_CROP_M
        self.estimate.position.less_sure_along(self._straight[-1], WENT_ON_SIGMA_M)
        self.ahead.go_on()
        self.estimate.cut.go_on()
        return True

    def met_end_surely(self) -> None:
        last, position = self._straight[-1], self.estimate.position
        ago = self.estimate.motion.distance_m - self._end_at_m
        position.less_sure_along(last, abs(self.along_m(self.estimate.motion) - self.side.length_m))
        position.at_end(last, ago, again=self._ended_again)

    def cut_unseen(self) -> None:
        here = self.estimate.motion
        if self.estimate.cut.clear_m == 0.0:
            at = self._blade(self._reckoned), self._blade(self.estimate.position.pose)
            self.estimate.swaths.note(here.distance_m, *at)

    def cut(self) -> None:
        """Its way is the next round's edge, and what stands beside it the field's; and once, where
        the lane is known again, it tells how far the turn to it has turned."""
        here = self.estimate.motion
        self.cut_unseen()
        if self.estimate.position.beside and self.along_m(here) > self._pressed_m:
            self.estimate.position.look(self.planned_piece, None)
        left_end = self.estimate.lane.left_end(self.vehicle.blade_width_m / 2)
        self.estimate.trails.note(*left_end, here)
        bends = [start for start, _ in self._pieces[self._at + 1 : self._at + 2]]
        if bends and self.along_m(here) > bends[0] - BEND_AHEAD_M:
            self._pass_bend()
        if self._turned_from is not None and self.ahead.cut_m(here) >= TURN_KNOWN_M:
            before = self._turned_from
            self._turned_from = None
            reckoned = here.yaw_rad - before.yaw_rad
            true = self._direction_rad() - before.direction_rad
            true = reckoned + math.remainder(true - reckoned, math.tau)
            if abs(reckoned) > TURN_LEAST_RAD:
                askew = self.estimate.position.corner_sigma_rad(before.piece, self.planned_piece)
                self.estimate.odometry.turned(reckoned, true, askew)

    def begin_leg(self, turning: Turning) -> None:
        self._pressed_m = turning.turn.pressed_m
        if turning.beside:
            # Its edge is in view all the way back.
            self.begin_lane()
            self.estimate.position.look(self.planned_piece, BESIDE)
            self.estimate.lane.begin(turning.beside_m)
            return
        self.estimate.position.less_sure(*self.turn_sigmas(turning))
        outward_m = self.outward_m
        self.begin_lane()
        self._look_from_lane()
        self.estimate.lane.begin(-outward_m, until_seen=True)

    def begin_lane(self) -> None:
        if not self._on_lane:
            self._on_lane = True
            self.estimate.position.begin(self.planned_piece, straight=not self.bent)

    def back_along(self) -> tuple[float, float] | None:
        """Where the rear axle is beside the way on which the machine has cut the strip, m and rad
        left of it; None once the blade is back before the first bend. Where the plan has the strip
        that way may lie a metre beside it."""
        place = self.estimate.position.at(self._straight[0])
        if place.blade_m < self._pieces[1][0]:
            return None
        blade, axle_m = self._blade(self._reckoned), self.vehicle.blade_x_m
        return self.estimate.swaths.back(blade, axle_m) or (0.0, 0.0)

    def leave(
        self, following: Strip, end: EndOfField, *, shuttles: bool = False
    ) -> tuple[float, float, float]:
        """By the position, in which the end that was seen has its part."""
        while self._at + 1 < len(self._straight):
            self._pass_bend()
        origin = self._origin(self.side if shuttles else self.piece)
        self.estimate.trails.end(self.planned_piece)
        self.estimate.swaths.end()
        if isinstance(following, PlannedStrip):
            here, before = self.estimate.motion, None
            if self.ahead.entered and self.ahead.cut_m(here) > TURN_KNOWN_M:
                before = _Before(here.yaw_rad, self._direction_rad(), self.planned_piece)
            following.arrive(before)
        return origin

    def arrive(self, before: _Before | None) -> None:
        """The turn to this strip begins: what was `before` it, where that is well known."""
        self._turned_from = before
        self._at = 0
        self.estimate.trails.begin(self.planned_piece)
        self._note_doubt()

    def laid_anew(self, plan: Plan) -> PlannedStrip:
        """The same strip in the plan as it has been laid out anew around what was found."""
        strip = PlannedStrip(plan, self.index, self.vehicle, self.estimate, self.ahead)
        strip.search_m = self.search_m
        strip._at = min(self._at, len(strip._straight) - 1)
        strip._turned_from, strip._on_lane = self._turned_from, self._on_lane
        strip._begun = self._begun
        strip._pressed_m = self._pressed_m
        strip._crop_at_m, strip._doubt_m = self._crop_at_m, self._doubt_m
        strip._expected_m = self._expected_m
        self.estimate.position.laid_anew(plan.boundary, strip.planned_piece)
        return strip

    def _pass_bend(self) -> None:
        """The blade comes to the next bend: what is known goes on, against the line beyond."""
        past = self.planned_piece
        _, left_rad = self.side.bends[self._at]
        self.estimate.lane.bends(left_rad)
        self._at += 1
        self.estimate.trails.end(past)
        self.estimate.trails.begin(self.planned_piece)
        self.estimate.position.begin(self.planned_piece, straight=False)
        self._turned_from = None

    def end_pose(self, *, shuttles: bool) -> tuple[float, float, float] | None:
        position = self.estimate.position
        side = self.side if shuttles else self._pieces[-1][1]
        c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
        along = side.length_m - self.vehicle.blade_x_m
        if not shuttles and position.outline.states:
            along += SIGMAS * position.end_sigma_m(self._straight[-1])
        inside = self.vehicle.inset_m - side.shift_m
        x, y = side.x_m + c * along - s * inside, side.y_m + s * along + c * inside
        return x, y, side.heading_rad

    def _origin(self, side: Side) -> tuple[float, float, float]:
        here = self.estimate.motion
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
