"""What a picture tells: the edge to the lane, crop or clear ground before the blade to the
account of the side's beginning and end.

What a picture can tell depends on what the machine is doing: each behaviour has its `Gaze`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from host.core.messages import Frame
from host.core.vehicle import Vehicle
from host.estimate import steady_looks
from host.estimate.crop_ahead import (
    AT_BLADE_M,
    CONFIDENT,
    END_CLEAR_M,
    NEAR_CROP_M,
    Ahead,
    EndOfField,
)
from host.estimate.edges_together import CONFIDENCE, EdgesTogether
from host.estimate.estimator import Estimator
from host.estimate.odometry import Motion
from host.estimate.steady_looks import SteadyLooks
from host.pilot.gaze import Gaze, Steady
from host.pilot.in_crop import InCrop
from host.pilot.leaps import LEAP_M, LEAP_STAYS_S, Leaps, is_dusts
from host.pilot.strip import Strip
from host.pilot.turn_progress import ACROSS_RAD, Turning
from host.pilot.whose_edge import WhoseEdge
from host.vision.view import BESIDE_AHEAD_M, BESIDE_M, CropView, Detector

LOST_M = 1.0
"""Way without a sure edge, and of the strip, from which on crop beside the blade tells where the
edge is not: at a strip's beginning the turns have left some standing."""
ASIDE_M = 6.0
"""Of such way at most the machine moves aside to the edge without stopping to look for it."""
LATELY_M = 10.0
"""Of way, in which a sure picture was seen: a turn's, in which none is looked at, and more."""
UNSEEN_M = 0.3
"""Travelled without an edge: not a puff that is gone at the next picture."""
MOVED_M = 0.01
"""The same view again from the same place is no second measurement."""
MOVING_MPS = 0.03
BESIDE_SURE, BESIDE_LASTS_M = 0.6, 0.5
"""How sure the edge of crop beside the machine is, and the way for which that is there."""
MOWN_M = 0.1
"""By which what the blade has left beside its way may seem to stand farther off: twice what such an
edge errs (docs/understand/vision.md)."""
IN_THE_WAY_M = 0.1
"""Of the blade that is before a strip beside which the machine backs, at least, for its crop's
right end to be seen as any other: rendered pictures of a way back had it 0.04 m too near then, give
or take 0.05 m, and the edge beside the way 0.2 to 0.6 m too far. Of crop that stands farther left
the detector takes its picture's border for the end."""
FAR_M = 1.5
"""Before the blade, from where on an edge tells nothing of the lane. Of sure ones beyond, one in
five errs by more than 0.4 m, nearer one in fifteen (library of the model eyes), and each in every
picture on the way there alike. They turned a machine by 16 degrees against its gyroscope (model
field 12345). Larger: such edges turn it; smaller: a machine finds its lane later after a turn."""
CORNER_SIGMA_M = 0.15
"""Uncertainty of the lane from which on the corner at a slanting border is taken for what it
tells."""
CORNER_SIGMAS = 3.0
"""How far beside the lane a corner may be, in the lane's own uncertainty."""
LEARN_AFTER_M = 2.0
"""Of a side, until what the turn left askew is straightened: then the steering's bias shows."""


class Sight:
    """The pictures of a run."""

    def __init__(self, vehicle: Vehicle, detector: Detector, estimate: Estimator) -> None:
        self._vehicle = vehicle
        self._detector = detector
        self._estimate = estimate
        self._dusty, self._beside = EdgesTogether(), EdgesTogether()
        self._looks = SteadyLooks()
        self._in_crop = InCrop()
        self._leap = Leaps()
        self.view: CropView | None = None
        """What the last picture shows;"""
        self.to_guard: CropView | None = None
        """and what of it the guard of the blade is told."""
        self.stamp = -math.inf
        """Of its shutter."""
        self.seen = Steady()
        """The edge, or what stands ahead, is in view."""
        self.seen_at_m = -math.inf
        """The travelled distance then."""
        self.usable = Steady()
        """Pictures are to be believed."""
        self.ahead = Ahead()
        self._whose = WhoseEdge(estimate, self.ahead, vehicle.blade_x_m)
        self._doubtful: Strip | None = None
        """The strip whose lane was so when its corner was in view."""
        self.beside_at_m = -math.inf
        """The travelled distance at the last picture of crop beside the way, and none ahead."""
        self.agreed_m = 0.0
        """Way on the present strip over which edges have agreed with the lane."""
        self.edge_at_m = math.inf
        """The travelled distance at the last picture whose edge corrected the lane."""
        self.lane_at_m = math.inf
        """The same of pictures in the dust that told of it together."""

    def next_crop(self, gap_m: float) -> None:
        """Behind the crop that is being cut the next stands no nearer."""
        self._detector.next_crop(gap_m)

    def begin(self, here: Motion) -> None:
        """Along a strip, from here on: no crop of it has been met."""
        self.ahead.begin(here)
        self._looks.begin()
        self._in_crop.forget()
        self.beside_at_m = -math.inf
        self.agreed_m = 0.0

    def unseen_m(self, motion: Motion) -> float:
        """Way since an edge corrected the lane."""
        return abs(motion.distance_m - self.edge_at_m)

    def saw_lately(self, here: Motion) -> bool:
        """Whether the camera is as good as it was a turn ago."""
        return abs(here.distance_m - self.seen_at_m) < LATELY_M

    def beside(self, here: Motion) -> bool:
        """Whether the strip's crop stands beside the machine's way."""
        return abs(here.distance_m - self.beside_at_m) < BESIDE_LASTS_M

    def sees_ahead(self) -> bool:
        """Whether the last picture says surely what stands before the blade."""
        return self.view is not None and self.view.ahead_confidence >= CONFIDENT

    def glances(self, strip: Strip, turning: Turning | None) -> bool:
        """Whether pictures are only glanced at: a turn is driven by dead reckoning until it backs
        along the next side; but round a corner that was found just now, and on a way elsewhere,
        the machine looks where it goes."""
        if turning is None or turning.leg is None:
            return False
        return not (turning.backing or turning.beside or turning.elsewhere or strip.new)

    def take(
        self,
        frame: Frame,
        gaze: Gaze,
        strip: Strip,
        turning: Turning | None,
        settled: Callable[[float], bool],
    ) -> None:
        """A new picture. `settled` says of a stamp whether the dust has settled by then."""
        if not gaze.looks:
            return
        estimate = self._estimate
        then = estimate.odometry.at(frame.stamp)
        if not gaze.cutting or strip.past_end(then):
            # Nothing is being cut, or soon nothing will be: what seems clear is not dust.
            self._detector.restart(turned=not gaze.on_side)
        in_leg = turning is not None and turning.leg is not None
        beside = turning is not None and turning.beside
        glances = self.glances(strip, turning)
        # After a leg the machine may stand across the next lane.
        askew_rad = 0.0 if turning is None or in_leg else turning.against_lane(then)[1]
        view = self._detector.glance(frame.bgr) if glances else self._detector.see(frame.bgr)
        estimate.pictures.take(view, then)
        # Elsewhere swath may lie across. Through a gap neither must lead the blade.
        shown, lying = view, view.with_lying() if strip.lies_its_crop else view
        view = self._of_lane(lying, strip, then, beside=beside)
        self.view, self.stamp = view, frame.stamp
        self.to_guard = view if lying is shown or strip.surely_crop else shown
        self.usable.note(frame.stamp, view.usable)
        sure = view.confidence >= CONFIDENT
        seen = sure or view.ahead_confidence >= CONFIDENT
        self.seen.note(frame.stamp, seen)
        self.seen_at_m = then.distance_m if seen else self.seen_at_m
        cutting = gaze.cutting and then.speed_mps > MOVING_MPS
        in_crop = not view.crop_ahead_m >= END_CLEAR_M
        if cutting and in_crop and strip.shows_edge(strip.along_m(then)):
            self.ahead.sure.append(sure)
        here = estimate.motion
        since_shutter = (here.distance_m - then.distance_m, here.yaw_rad - then.yaw_rad)
        moved = self.unseen_m(then) > MOVED_M
        # A contradiction that lasts while the machine stands is believed in the end.
        due = moved or estimate.lane.contradicted
        ago_s = then.stamp - estimate.cut.blade_stamp
        shows_lane = gaze.lane and abs(askew_rad) <= ACROSS_RAD and not beside
        self._take_beside(view, strip, turning, then)
        if shows_lane and sure and due and (not gaze.settles or settled(frame.stamp)):
            if self._whose.is_lanes(view, strip, turning, then):
                edge_m = strip.edge_m(view, then)
                leap_m = edge_m + estimate.lane.blade_offset_m
                dusts = strip.placed and is_dusts(leap_m, self._vehicle.blade_width_m, ago_s)
                if self._leap.confirmed(leap_m) and not dusts:
                    # Crop that stands elsewhere passes before a machine that turns.
                    self._take_edge(
                        view, edge_m, strip, then, since_shutter, gaze, not in_leg, moved=moved
                    )
            elif not in_leg:
                dusty = gaze.cutting or ago_s < LEAP_STAYS_S
                self._take_corner(view, strip, then, since_shutter, dusty=dusty)
        if not sure:
            self._leap.forget()
        if gaze.lane and cutting and not in_leg:
            if sure:
                self._in_crop.forget()
            else:
                self._take_bound(view, strip, then, since_shutter)
        self._take_dusty_edge(view, strip, turning, gaze, then)
        if gaze.lane and gaze.settles and settled(frame.stamp):
            edge_m = strip.edge_m(view, then)
            near = view.edge_ahead_m <= NEAR_CROP_M and strip.shows_edge(strip.along_m(then))
            if near and math.isfinite(edge_m):
                self._looks.note(edge_m + estimate.lane.blade_offset_m)
        self.ahead.note(view, then)
        if view.ahead_confidence >= CONFIDENT:
            ends = gaze.ends and (not gaze.settles or settled(frame.stamp))
            if turning is not None and self._backs_away(turning, then):
                self.ahead.back_away(view, then)
            self._watch_ahead(view, strip, gaze, EndOfField(frame.stamp, then), ends)

    def _of_lane(self, view: CropView, strip: Strip, then: Motion, *, beside: bool) -> CropView:
        """Where nothing stands right ahead of the blade, or the machine backs `beside` the lane,
        the edge of what stands beside its way is the lane's. What stands across the way, without a
        right end, is another field's."""
        seen = math.isfinite(view.edge_beside_m)
        if beside and view.crop_ahead_m < BESIDE_M[0]:
            ends_left = strip.edge_m(view, then) < self._vehicle.pass_m - IN_THE_WAY_M
            in_the_way = ends_left and view.crop_ahead_m < AT_BLADE_M
            return view if in_the_way else replace(view, confidence=0.0)
        if not beside:
            across = view.crop_ahead_m < BESIDE_M[1] and not math.isfinite(view.edge_offset_m)
            clear = view.ahead_confidence >= CONFIDENT and view.crop_ahead_m >= END_CLEAR_M
            if across or not (clear and strip.placed and seen):
                return view
            if min(strip.along_m(then), strip.left_m() - BESIDE_AHEAD_M) <= 0.0:
                return view
            # Beside what was cut it is the next strip's, and beside the blade's way anybody's.
            cut, left_m = self._estimate.cut, self._vehicle.blade_width_m + MOWN_M
            mown = cut.over_mown_m > BESIDE_AHEAD_M and view.edge_beside_m < left_m
            if mown or cut.over_cut_m > BESIDE_AHEAD_M:
                return view
            self.beside_at_m = then.distance_m
            if view.confidence >= CONFIDENT and view.crop_ahead_m < BESIDE_M[1]:
                return view
        edge_m, sure = view.edge_beside_m, BESIDE_SURE if seen else 0.0
        return replace(view, edge_offset_m=edge_m, edge_ahead_m=BESIDE_AHEAD_M, confidence=sure)

    def take_looks(self) -> bool:
        """A look without a sure edge is over. Whether it and the one before it have the edge in one
        line: that is the lane's."""
        lane, at_m = self._estimate.lane, self._estimate.motion.distance_m
        edge_m = self._looks.over(at_m)
        if edge_m is None:
            return False
        here = edge_m - lane.blade_offset_m
        self.lane_at_m = at_m
        return lane.correct(here, math.nan, steady_looks.CONFIDENCE, (0.0, 0.0), cutting=False)

    def _backs_away(self, turning: Turning, then: Motion) -> bool:
        """Whether crop before the blade is where the next side begins."""
        expected = turning.crop_expected_m(then, self._vehicle.blade_x_m)
        backs = turning.backing and then.speed_mps < -MOVING_MPS
        return backs and turning.turn.pressed_m == 0.0 and expected > 0.0

    def _take_bound(
        self, view: CropView, strip: Strip, then: Motion, since_shutter: tuple[float, float]
    ) -> None:
        """The edge is lost: crop on both sides tells where it is not."""
        most_m = self._in_crop.note(view)
        lost = self._lost_m(then) > LOST_M and strip.shows_edge(strip.along_m(then))
        if lost and self._in_crop.surely and math.isfinite(most_m):
            bound = replace(view, edge_offset_m=most_m, edge_ahead_m=0.0)
            self._estimate.lane.lies_right(strip.edge_m(bound, then), since_shutter)

    def _lost_m(self, then: Motion) -> float:
        """Way of the strip's since an edge was seen."""
        return min(self.ahead.cut_m(then) if self.ahead.entered else 0.0, self.unseen_m(then))

    def moves_aside(self, here: Motion) -> bool:
        """Whether the machine is on its way out of the crop that stands on both sides of it."""
        return self._in_crop.surely and LOST_M < self._lost_m(here) < LOST_M + ASIDE_M

    def _take_edge(
        self,
        view: CropView,
        edge_m: float,
        strip: Strip,
        then: Motion,
        since_shutter: tuple[float, float],
        gaze: Gaze,
        stays: bool,
        *,
        moved: bool,
    ) -> None:
        if view.edge_ahead_m > FAR_M:
            if abs(edge_m + self._estimate.lane.blade_offset_m) < LEAP_M:
                strip.seen_beside(view, then)
            return
        since_m, self.edge_at_m = self.unseen_m(then), then.distance_m
        lane, ahead = self._estimate.lane, self.ahead
        cut_m = ahead.cut_m(then) if ahead.entered else 0.0
        seen = edge_m, strip.edge_heading_rad(view), view.confidence, since_shutter
        learn = strip.teaches and cut_m > LEARN_AFTER_M
        ahead_m, cutting = view.edge_ahead_m, gaze.cutting
        lane.correct(*seen, ahead_m=ahead_m, learn=learn, cutting=cutting, stays=stays)
        self._estimate.learn_curve()
        if not lane.contradicted:
            self.agreed_m += since_m if since_m < UNSEEN_M else 0.0
            if moved and not self.beside(then):
                strip.seen_beside(view, then)

    def _take_corner(
        self,
        view: CropView,
        strip: Strip,
        then: Motion,
        since_shutter: tuple[float, float],
        *,
        dusty: bool,
    ) -> None:
        """Where the crop's border slants across the strip, the right end that a picture shows is
        the corner from which the outer edge runs. It tells a lane that is doubtful more than dead
        reckoning does. `dusty`: at the blade the dust may hide it."""
        lane, corner = self._estimate.lane, strip.corner(view, then)
        if corner is None or (dusty and view.edge_ahead_m < NEAR_CROP_M):
            return
        if strip is not self._doubtful:
            if lane.offset_sigma_m < CORNER_SIGMA_M:
                return
            self._doubtful = strip
        edge, ahead_m = corner
        if abs(edge + lane.blade_offset_m) > CORNER_SIGMAS * lane.offset_sigma_m:
            return  # another corner's: of what a round before has left, or of the next crop
        self.edge_at_m = then.distance_m
        lane.correct(edge, math.nan, CONFIDENT, since_shutter, ahead_m=ahead_m, learn=False)

    def _take_dusty_edge(
        self, view: CropView, strip: Strip, turning: Turning | None, gaze: Gaze, then: Motion
    ) -> None:
        """Where no picture is sure for a while, what many show together."""
        if not gaze.cutting or not self.ahead.entered or not self.unseen_m(then) > UNSEEN_M:
            self._dusty.clear()
            return
        lane, edge = self._estimate.lane, strip.edge_m(view, then)
        seen = math.isfinite(edge) and view.confidence > 0.0
        near = view.edge_ahead_m <= NEAR_CROP_M
        if not seen or not near or not self._whose.is_lanes(view, strip, turning, then):
            return
        self._dusty.note(then.stamp, edge + lane.blade_offset_m)
        line = self._dusty.take()
        if line is None:
            return
        self.lane_at_m = then.distance_m
        here = line - lane.blade_offset_m
        lane.correct(here, math.nan, CONFIDENCE, (0.0, 0.0), learn=strip.teaches)

    def _take_beside(
        self, view: CropView, strip: Strip, turning: Turning | None, then: Motion
    ) -> None:
        """What pictures together show of the edge beside which the machine backs."""
        if turning is None or not turning.beside:
            self._beside.clear()
            return
        if view.confidence < CONFIDENT or not self._whose.is_lanes(view, strip, turning, then):
            return
        lane = self._estimate.lane
        aside_m = view.edge_ahead_m * math.sin(lane.heading_rad)
        self._beside.note(then.stamp, strip.edge_m(view, then) + lane.blade_offset_m + aside_m)
        line = self._beside.take()
        if line is not None:
            self.edge_at_m = then.distance_m
            here = line - lane.blade_offset_m
            # Where rates are learnt from edges, what these err alike would turn the machine.
            rates = not self._estimate.position.outline.bends(strip.plan.sides[strip.index])
            sure = CONFIDENCE if rates else 1.0
            lane.correct(here, math.nan, sure, (0.0, 0.0), learn=False, cutting=False)

    def _watch_ahead(
        self, view: CropView, strip: Strip, gaze: Gaze, seen: EndOfField, ends: bool
    ) -> None:
        """Of a sure picture: where the side's crop begins and where it ends."""
        if gaze.begins or ends:
            self.ahead.sight(view, seen.motion)
        if ends and self.ahead.follow(view, seen):
            ago = self._estimate.motion.distance_m - seen.motion.distance_m
            strip.met_begin(ago - view.crop_ahead_m)
        # In dust before the blade, which shows no edge either, crop seems to stand for ever.
        clear = view.confidence >= CONFIDENT or not gaze.cutting
        if ends and clear and self.ahead.entered and view.crop_ahead_m < NEAR_CROP_M:
            strip.goes_on(seen.motion)
