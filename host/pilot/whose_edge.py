"""Whether the edge in a picture is the lane's, or that of something else that stands near it."""

from __future__ import annotations

from host.estimate.crop_ahead import Ahead
from host.estimate.estimator import Estimator
from host.estimate.odometry import Motion
from host.pilot.leaps import LEAP_M
from host.pilot.strip import Strip
from host.pilot.turn_progress import Turning
from host.vision.view import CropView

CROP_SEEN_M = 0.1
"""Before the blade the new side's crop must begin for a picture taken while a turn backs along it
to show the lane's edge."""
ALONG_M = 0.5
"""From both ends of the next strip, beside which a shuttle backs, for what is seen at the blade to
be its edge."""
BEFORE_M = 1.0
"""By which borders and swath are ragged: an edge farther before a strip's crop is another's."""
IN_VIEW_M, IN_VIEW_SIGMAS = 1.3, 3.0
"""Beside the blade's middle, and of the lane's uncertainty besides, the lane's edge may lie in a
picture: pictures show 1.45 m to the left of where it should be and 1.15 m to the right. An edge
that a picture shows while the lane lies farther away is another one's."""
TIP_M = 1.0
"""Of a strip that is begun inside, at whose right the last one's tip may stand: what a turn leaves
of its beginning at most, twice."""
TIP_SIGMAS = 3.0
"""Of the lane, beyond which even a strip that is begun outside has such a tip at its right."""
OWN_SWATH_M = 0.3
"""Nearer than the end of its own swath by more, a machine that has backed over it sees crop beside
it, and no edge of its lane: every face's foot is known to a decimetre or two."""


class WhoseEdge:
    """Of one run's pictures."""

    def __init__(self, estimate: Estimator, ahead: Ahead, blade_x_m: float) -> None:
        self._lane = estimate.lane
        self._odometry = estimate.odometry
        self._ahead = ahead
        self._cut = estimate.cut
        self._blade_x = blade_x_m

    def is_lanes(self, view: CropView, strip: Strip, turning: Turning | None, then: Motion) -> bool:
        """Whether the edge in the picture taken then is the lane's: on a side, or backing along the
        next once the crop begins ahead of the blade, or beside it all the way. Else the picture
        shows the crop's flank; and so it does where the crop's border slants across the strip, or a
        tip stayed where the strip before it was begun. Of a strip that is sought any edge is."""
        if turning is not None and turning.leg is not None:
            expected = turning.crop_expected_m(self._odometry.now, self._blade_x)
            along = turning.beside and min(-expected, strip.left_m()) > ALONG_M
            leap_m = abs(strip.edge_m(view, then) + self._lane.blade_offset_m) if along else 0.0
            if leap_m > LEAP_M and leap_m > IN_VIEW_SIGMAS * self._lane.offset_sigma_m:
                return False
            if not along and not (turning.backing and expected > CROP_SEEN_M):
                return False
        lane = self._lane
        off_m = abs(lane.blade_offset_m)
        # the lane's standard deviation, which takes long, is asked only where it decides
        far = strip.placed and off_m > IN_VIEW_M
        if far and off_m > IN_VIEW_M + IN_VIEW_SIGMAS * lane.offset_sigma_m:
            return False
        if self._before_begin(view, strip, then) or self._beside_swath(view):
            return False
        shows = strip.sought or strip.shows_edge(strip.along_m(then))
        return shows and not self._tip(view, strip, then)

    def _before_begin(self, view: CropView, strip: Strip, then: Motion) -> bool:
        """Whether what stands in the picture taken then stands before any crop of the strip."""
        if not strip.placed:
            return False
        before_m = -(strip.along_m(then) + view.edge_ahead_m)
        # how surely the beginning is known, which takes long, is asked only where it decides
        return before_m > BEFORE_M and before_m > BEFORE_M + strip.begin_doubt_m

    def _beside_swath(self, view: CropView) -> bool:
        """Whether what the machine has just cut lies between the blade and what stands there."""
        return view.edge_ahead_m < self._cut.over_cut_m - OWN_SWATH_M

    def _tip(self, view: CropView, strip: Strip, then: Motion) -> bool:
        """Whether the right end of the crop at the blade may be what the strip before has left
        beside this one: turns that lack room end with the blade inside a strip's beginning."""
        begun_m = self._ahead.cut_m(then) if self._ahead.entered else 0.0
        if begun_m >= TIP_M or strip.new or strip.sought:
            return False
        lane = self._lane
        outside_m = -(strip.edge_m(view, then) + lane.blade_offset_m)
        if not outside_m > LEAP_M:
            return False
        return not self._ahead.approached or outside_m > TIP_SIGMAS * lane.offset_sigma_m
