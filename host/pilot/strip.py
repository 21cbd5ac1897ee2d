"""A strip of which nothing is known but what the pictures show: that of a machine without a plan,
or that does not know its place in it yet. Pictures alone begin and end anything.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from host.core.vehicle import Vehicle
from host.estimate.crop_ahead import Ahead, EndOfField
from host.estimate.estimator import Estimator
from host.estimate.odometry import Motion
from host.pilot.turn_progress import Turning
from host.route.plan import Plan
from host.vision.view import CropView

PLACE_SIGMA_M = 0.12
PLACE_SIGMA_RAD = math.radians(2.5)
"""Of the pose after a turn by dead reckoning, besides what a wrong speed adds."""
TURN_M = 3.2
"""Way of a turn (docs/understand/navigation.md, a corner of 90 degrees)."""

LITTLE_SHARE, LITTLE_M2 = 0.03, 8.0
"""Of the field, and at most: once no more than that is left, and it shows nowhere, or the machine
cannot get there, the harvest is over."""


def little_m2(plan: Plan) -> float:
    """As much of a plan's field."""
    return min(LITTLE_SHARE * plan.area_m2, LITTLE_M2)


class Beyond(NamedTuple):
    """The boundary at a strip's end."""

    edge: int
    """Of the boundary, which the end lies at."""
    askew_rad: float
    """Of the strip's direction against that edge's outward normal."""
    ago_m: float
    """How far the blade has come since it met the end, by pictures;"""
    past_m: float
    """and how far past the edge it is by the place that is believed."""
    edges: tuple[int, ...]
    """Of the boundary, between which the turn from here leads."""


class Strip:
    """A strip of which nothing is known but what the pictures show. `index` counts the plan's sides
    that are left, or the turns."""

    last = False
    """Whether the plan has no side after it."""
    resumed = False
    """Whether it was begun in an earlier run."""
    blind_end = False
    """Whether it ends in standing crop, where no picture shows it."""
    begins_slanting = False
    """Whether the crop's border slants across its beginning: no edge is seen there at first."""
    placed = False
    """Whether the machine knows its place in the plan."""
    skippable = False
    """Whether it is driven along to the next where its crop is not found."""
    may_be_gone = False
    """Whether crop of it that is not there has gone with the strips before: it lies inside of them,
    or most of the field is cut."""
    outermost = False
    """Whether the gap to the neighbour's crop lies beside it."""
    search_reach_m = 0.0
    """How far beyond its expected beginning crop is looked for that is not in view; 0: not."""
    teaches = True
    """Whether driving along it shows the steering's bias."""
    tip_m = 0.0
    """From where the crop's border meets its outer edge to its last tip, at an end that slants."""
    clear_end_m = 0.0
    """How far its blade may run over clear ground: over a last tip that is too narrow to be seen,
    and over what earlier rounds have cut between its end and the boundary."""
    back_m = 0.0
    """From the beginning of the crop back to the boundary or a keep-out."""
    bends_rad = 0.0
    """By how much its edge bends at most, at one place on the way."""
    sought = False
    """Whether the machine has lost its crop, and takes for its edge whatever edge is seen."""
    shift_m = 0.0
    """How far right of its usual place the lane lies."""
    width_m = 0.0
    """Of its crop, as planned."""

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
    def bent(self) -> bool:
        """Whether its edge bends on the way."""
        return self.bends_rad > 0.0

    @property
    def name(self) -> str:
        """In words that count from 1."""
        return self.plan.name(self.index)

    def along_m(self, motion: Motion) -> float:
        """How far the blade had come past the strip's beginning at a motion."""
        return self.ahead.cut_m(motion)

    def straight_m(self, motion: Motion) -> float:
        """The same past the beginning of the straight piece that the blade is at."""
        return self.along_m(motion)

    def past_end(self, motion: Motion) -> bool:
        """Whether clear ground is to be expected there."""
        return False

    def end_due(self, motion: Motion) -> bool:
        """Whether the strip may end there."""
        return True

    def may_end_at(self, along_m: float) -> bool:
        """Whether its end may lie there, of a boundary that is still to be found."""
        return False

    def ends_at(self, along_m: float) -> None:
        """A look without dust has shown that its crop ends there, wherever that was expected."""

    def overrun(self) -> bool:
        """Whether the blade has passed the field's boundary, whatever vision says."""
        return False

    @property
    def begin_doubt_m(self) -> float:
        """By how much the place against its beginning may be wrong."""
        return 0.0

    def goes_on(self, motion: Motion) -> None:
        """Crop that goes on from what is being cut stood at the blade at a motion."""

    def blind(self) -> bool:
        """Whether its end, which nobody has seen before, may have been passed in the dust."""
        return False

    def sure_ahead_m(self) -> float:
        """How far before the last crop that was seen at the blade the strip's end is taken to be,
        where nothing has been seen of it yet; inf: it is known."""
        return math.inf

    @property
    def new(self) -> bool:
        """Whether nobody has seen it yet, nor where it begins and ends."""
        return False

    @property
    def outward_m(self) -> float:
        """How far outside of its lane a turn is to lead, as nobody has seen its edge yet."""
        return 0.0

    def left_m(self) -> float:
        """What the plan still has of it before the blade; 0 where it has nothing."""
        return 0.0

    @property
    def left_m2(self) -> float:
        """The same as an area."""
        return 0.0

    @property
    def rest_m2(self) -> float:
        """What the plan has after it."""
        return 0.0

    @property
    def surely_crop(self) -> bool:
        """Whether the plan has crop before the blade by more than any belief errs."""
        return False

    @property
    def lies_its_crop(self) -> bool:
        """Whether what seems to lie before the blade is crop of its own, and no swath."""
        return self.surely_crop

    @property
    def lying_m(self) -> float:
        """How much longer than a patch ground may be on which crop of its own seems to lie, and
        none stands."""
        return 0.0

    @property
    def surely_own(self) -> bool:
        """Whether crop before the blade is the field's own by more than any belief errs: the strip
        goes on, or the field does beyond it."""
        return False

    @property
    def deep_inside(self) -> bool:
        """Whether the blade is farther inside the boundary than any belief errs."""
        return False

    @property
    def beside_swath(self) -> bool:
        """Whether what stands before the blade stands right beside what the machine has cut."""
        return False

    def to_blind_end_m(self) -> float:
        """From where the blade will stop to where the strip ends before a keep-out; inf: it does
        not."""
        return math.inf

    def shows_edge(self, along_m: float) -> bool:
        """Whether the strip's outer edge, and no slanting border, is what a picture shows there."""
        return True

    def along_edge_m(self, motion: Motion) -> float:
        """How far the blade had come at a motion along the border that is the outer edge there."""
        return self.along_m(motion)

    def before_edge(self, here: Motion) -> bool:
        """Whether a slanting border lies before the strip's outer edge still, at its beginning."""
        return False

    def edge_m(self, view: CropView, then: Motion) -> float:
        """The edge's offset from its place beside this strip's lane in a picture taken then."""
        return view.edge_offset_m

    def edge_heading_rad(self, view: CropView) -> float:
        """The edge's direction in a picture against this strip's lane."""
        return view.edge_heading_rad

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

    def saw_begin(self) -> None:
        """The machine stands where it is to drive along the strip, and has seen what it can of its
        beginning."""

    def met_begin(self, ago_m: float) -> None:
        """The blade met the crop, and has travelled ago_m since."""

    def met_end(self, end: EndOfField, view: CropView | None, *, looked: bool) -> None:
        """Vision saw the end; `looked`: after the machine had stopped to look."""

    def gap_beyond(self) -> Beyond | None:
        """What lies beyond its end, where that is the field's boundary and has just been seen."""
        return None

    def end_was_one(self) -> None:
        """What was taken for its end is one."""

    def end_was_none(self, ahead_m: float) -> bool:
        """The same is none: its crop goes on ahead_m before the blade. False where that was said
        before: what the blade does not cut is no crop."""
        return False

    def met_end_surely(self) -> None:
        """What stands beyond its end stands where it should: that was its end, wherever the machine
        was believed to be."""

    def cut_unseen(self) -> None:
        """The blade cuts what is the field's own beyond doubt, before any picture has shown it:
        what stands beside that is, too."""

    def cut(self) -> None:
        """The blade is cutting: what the way along the strip teaches."""

    def begin_leg(self, turning: Turning) -> None:
        """A turn backs along this strip from now on: the lane is its."""
        offset, turned = turning.against_lane(self.estimate.motion)
        place_m, turned_rad = self.turn_sigmas(turning)
        sigmas = PLACE_SIGMA_M + place_m, PLACE_SIGMA_RAD + turned_rad
        self.estimate.lane.place(offset, turned, *sigmas)

    def begin_lane(self) -> None:
        """The present lane is its own from now on, if it is not yet."""

    def leave(
        self, following: Strip, end: EndOfField, *, shuttles: bool = False
    ) -> tuple[float, float, float]:
        """Ends this strip. The frame of the turn to the next, in dead reckoning's (x, y,
        direction): the rear axle's place on the lane when the blade stands at the strip's end. A
        turn that `shuttles` counts a strip that bends as if it ran straight on from its
        beginning."""
        here = self.estimate.motion
        # The lane's direction, not the vehicle's momentary heading, is what the corner adds to.
        return end.motion.x_m, end.motion.y_m, here.yaw_rad - self.estimate.lane.heading_rad

    def end_pose(self, *, shuttles: bool) -> tuple[float, float, float] | None:
        """(x, y, heading) of the rear axle on the lane at the strip's end, in the field frame, as
        `leave` has it: of a corner's turn, which must find room there, as far on as that may be."""
        return None

    def turn_sigmas(self, turning: Turning) -> tuple[float, float]:
        """What a wrong speed does in a turn, to the place, m, and to the direction, rad."""
        scale = self.estimate.odometry.scale_sigma
        return TURN_M * scale, turning.turn.lane_rad * scale
