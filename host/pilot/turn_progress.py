"""A turn under way: which of its legs, since when, and where in its frame, by dead reckoning."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

from host.core.frames import Pose2
from host.core.vehicle import Vehicle
from host.estimate.odometry import Motion
from host.route.side import Side
from host.route.turn_legs import Follow, Goal, Leg, Turn

ACROSS_RAD: Final = math.radians(60.0)
"""Askew of the new lane by more, no edge that the machine sees can be that lane's."""

LOOK_BACK_M: Final = 0.6
"""Straight back, for pictures that err otherwise."""
PAST_M: Final = 0.5
"""Farther along its lane, at least, the way past something leads to it again."""


class Turning:
    """`origin` is the turn's frame in dead reckoning's (x, y, direction)."""

    def __init__(self, now: float, turn: Turn, origin: tuple[float, float, float]) -> None:
        self.turn = turn
        self._origin = origin
        self._index = 0
        self._begun_at: Motion | None = None
        self.since = now
        """When the leg, or what follows the last, was begun or taken up again."""
        self.running = False
        """Whether the steering has reached the leg's angle and the machine may move."""
        self.broken_off = False
        """Whether the geofence has ended one of its legs."""
        self.searches = 0
        """How often another way was looked for from where it stood."""
        self._looked_back = False
        """Whether it has backed after its last leg, to look once more."""
        self.elsewhere = False
        """Whether it leads over ground that is cut to what others have left, from anywhere."""
        self.past_m = -math.inf
        """Along the new lane, from where on the rear axle is to come to it: past what stands beside
        it."""

    @property
    def leg(self) -> Leg | None:
        """The present one; None after the last."""
        return self.turn.legs[self._index] if self._index < len(self.turn.legs) else None

    @property
    def passes(self) -> bool:
        """Whether it leads past something to the lane that it has come to before."""
        return math.isfinite(self.past_m)

    def go_past(self, motion: Motion, offset_m: float, turned_rad: float) -> None:
        """From a lane that it has come to, offset_m left of it and turned_rad left of its
        direction: past what stands beside it, and to the same lane again."""
        self.anchor(motion, offset_m, turned_rad)
        self.past_m = self.beside_lane(motion).x_m + PAST_M
        self.searches, self.broken_off = 0, True

    def lay_anew(self, legs: tuple[Leg, ...], now: float) -> None:
        """Another way to the same lane, from here; its headings, and places along, are the
        lane's."""
        lane_rad = self.turn.lane_rad
        turned = (
            replace(leg, value=leg.value + lane_rad) if leg.goal is Goal.HEADING else leg
            for leg in legs
        )
        self.turn = replace(self.turn, legs=tuple(turned))
        self._index = -1
        self.next(now)

    def looks_from_farther_back(self, now: float) -> bool:
        """Begins a leg straight back, to look once more from there; False if that was done."""
        if self._looked_back:
            return False
        self._looked_back = True
        self.lay_anew((Leg(0.0, True, Goal.WAY, LOOK_BACK_M),), now)
        return True

    def beside_lane(self, motion: Motion) -> Pose2:
        """The rear axle's place and direction in the new lane's frame."""
        x, y, heading = self._place(motion)
        return Pose2(self.turn.along(x, y), self.turn.offset(x, y), heading - self.turn.lane_rad)

    def driven_m(self, motion: Motion) -> float:
        """Along the present leg."""
        self._begun_at = self._begun_at or motion
        return abs(motion.distance_m - self._begun_at.distance_m)

    @property
    def backing(self) -> bool:
        """Whether the present leg leads back along the new side."""
        return self.leg is not None and self.leg.follow is Follow.NEW_LANE

    @property
    def beside(self) -> bool:
        """Whether the present leg leads back along the old side's lane, beside the new one's."""
        return self.leg is not None and self.leg.follow is Follow.OLD_LANE

    @property
    def beside_m(self) -> float:
        """How far left of the new lane the old one lies; negative: right of it."""
        return self.turn.offset(0.0, 0.0)

    def anchor(self, motion: Motion, offset_m: float, turned_rad: float) -> None:
        """The rear axle is offset_m left of the new lane and the vehicle turned_rad left of it:
        what is left of the turn is driven from there."""
        x, y, _ = self._place(motion)
        at, lane = self.turn.along(x, y), self.turn.lane_rad
        c, s = math.cos(lane), math.sin(lane)
        x = self.turn.lane_x_m + c * at - s * offset_m
        y = self.turn.lane_y_m + s * at + c * offset_m
        direction = motion.yaw_rad - lane - turned_rad
        c, s = math.cos(direction), math.sin(direction)
        self._origin = motion.x_m - c * x + s * y, motion.y_m - s * x - c * y, direction

    def next(self, now: float) -> None:
        """On to the leg after this one."""
        self._index += 1
        self._begun_at = None
        self.wait(now)

    def wait(self, now: float) -> None:
        """Stands until the steering is ready (again)."""
        self.running = False
        self.since = now

    def to_go(self, motion: Motion, lag_s: float) -> float:
        """What is left of the present leg, m or rad of its goal, once the drive, switched off now,
        has coasted out; not above 0 where the goal is reached."""
        leg = self.leg
        assert leg is not None
        x, y, heading = self._place(motion)
        coast = motion.speed_mps * lag_s
        if leg.goal is Goal.HEADING:
            left = leg.value - heading - coast * motion.curvature_1pm
        else:
            place = x if leg.goal is Goal.X else self.turn.along(x, y)
            if leg.goal is Goal.WAY:
                place, coast = self.driven_m(motion), abs(coast)
            left = leg.value - place - coast
        return left if leg.rises else -left

    def against_lane(self, motion: Motion) -> tuple[float, float]:
        """How far left of the new lane the rear axle is, m, and how far turned left of it, rad."""
        x, y, heading = self._place(motion)
        return self.turn.offset(x, y), math.remainder(heading - self.turn.lane_rad, math.tau)

    def crop_expected_m(self, motion: Motion, blade_x_m: float) -> float:
        """From the blade to where the new side's crop should begin."""
        x, y, _ = self._place(motion)
        return self.turn.crop_begins_m - self.turn.along(x, y) - blade_x_m

    def _place(self, motion: Motion) -> tuple[float, float, float]:
        """The rear axle's (x, y, heading) in the turn's frame; x runs along the old lane."""
        x0, y0, direction = self._origin
        c, s = math.cos(direction), math.sin(direction)
        dx, dy = motion.x_m - x0, motion.y_m - y0
        return c * dx + s * dy, c * dy - s * dx, motion.yaw_rad - direction


def turn_from_anywhere(
    now: float, side: Side, vehicle: Vehicle, motion: Motion, at: Pose2
) -> Turning:
    """To the beginning of a side's lane, by a way that is still to be found; `at`: the machine's
    pose in the field."""
    lane = Pose2(*side.pose(0.0, vehicle.inset_m - side.shift_m))
    turned = math.remainder(lane.heading_rad - at.heading_rad, math.tau)
    begins = Pose2(motion.x_m, motion.y_m, motion.yaw_rad).ahead(*at.seen_from(*lane[:2]))
    origin = begins.x_m, begins.y_m, motion.yaw_rad + turned
    turning = Turning(now, Turn((), 0.0, 0.0, 0.0, 0.0), origin)
    turning.elsewhere = True
    return turning
