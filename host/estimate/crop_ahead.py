"""Where a side's crop begins and ends, by what the pictures show before the blade, and how far they
are to be believed."""

from __future__ import annotations

import math
import statistics
from collections import deque
from dataclasses import dataclass
from typing import Final

from host.estimate.odometry import Motion
from host.vision.view import CropView

CONFIDENT: Final = 0.5
END_CLEAR_M: Final = 0.8
"""Clear ground ahead of the blade that ends a side: less than a gap, more than a thin patch."""
END_PICTURES: Final = 3
AT_BLADE_M: Final = 0.15
"""Crop nearer than this is at the blade."""
AT_BLADE_PICTURES: Final = 3
"""In a row that show crop there, for clear ground to have ended: of crop half a metre before the
blade, one picture in ten takes it for crop at the blade (library of the model eyes)."""
CLEAR_M: Final = 0.3
"""Crop farther than this is not what the blade is cutting."""
NEAR_CROP_M: Final = 0.2
BEGINS_M: Final = (0.05, 1.0)
"""Before the blade, where a machine that backs away from crop sees within a decimetre where it
begins: 0.00 m off in the median, 0.09 m standard deviation from the mast (library of the model
eyes). One that drives up to it takes the last 0.3 m for none."""
BEGIN_PICTURES: Final = 5
BEGUN_EARLY_M: Final = 0.4
"""Before where a machine that backed away from it saw the crop begin: what then seems to stand at
the blade is a last swath, or stalks of the strip before (model field 10334)."""
FAR_PICTURES: Final = 3
"""Sure ones that show the crop far ahead: one of them may overlook what stands close by (155 of
11,043 pictures of standing crop within 0.6 m, 179 of 1,779 of lying crop: the model eyes' library).
"""
EDGE_SURE: Final = (0.7, 10)
"""Dust makes the edge seem too far inside, never too far outside, and most pictures unsure: an edge
that has moved inside counts where at least this share of so many pictures are sure."""
END_SURE: Final = (0.5, 30)
"""And an end without a look; the last half metre of crop shows no edge anyway."""


@dataclass(frozen=True, slots=True)
class EndOfField:
    """Where a side's end was declared: the motion at the first picture that showed it."""

    stamp: float
    motion: Motion


class Ahead:
    """What is known of one side after the other. Motions are those at the pictures."""

    def __init__(self) -> None:
        self.begun_at: Motion | None = None
        """Where the machine began to drive along the side."""
        self.entered_at: Motion | None = None
        """Where the blade met this side's crop."""
        self.crop_at_m = math.inf
        """The travelled distance at which this side's crop begins, by its nearest sight."""
        self._sights: deque[float] = deque(maxlen=FAR_PICTURES)
        """The same by the latest sights."""
        self._begins: list[float] = []
        self._begins_at_m = math.nan
        self.approached = True
        """Whether the turn to it led to before its crop: one that lacked room may end inside."""
        self._stood_off = True
        """Whether a picture has shown its crop some way before the blade since the turn to it. A
        machine that has lost its place may begin a side inside its crop, and meets nothing."""
        self.clear_since: EndOfField | None = None
        """The first of the latest sure pictures without crop before the blade."""
        self.clear_count = 0
        """How many of them there are."""
        self.seems_clear_since: Motion | None = None
        """The first of the latest pictures without crop before the blade, sure or not: what a
        detector doubts until it has stayed was there from the first."""
        self.clear_at_blade_since: Motion | None = None
        """The first of the latest without crop at the blade, whatever stands before that: in dust,
        something always seems to."""
        self._at_blade = 0
        """Pictures in a row that showed crop there."""
        self.sure: deque[bool] = deque(maxlen=END_SURE[1])
        """Whether the latest pictures in the crop showed its edge surely, the newest last."""

    @property
    def entered(self) -> bool:
        """Whether the blade has met this side's crop."""
        return self.entered_at is not None

    @property
    def end(self) -> EndOfField | None:
        """The side's, where so many pictures show no crop."""
        return self.clear_since if self.clear_count >= END_PICTURES else None

    @property
    def begins_at_m(self) -> float:
        """The travelled distance at which the side's crop begins, by what a machine that backed
        away from it saw; NaN where it saw too little of it."""
        return self._begins_at_m

    def begun(self, then: Motion) -> bool:
        """Whether crop at the blade may be the side's."""
        return not then.distance_m < self.begins_at_m - BEGUN_EARLY_M

    def surely_clear_m(self, here: Motion) -> float:
        """So much of the way ahead is clear by each of the latest sights; 0 with fewer of them."""
        whole = len(self._sights) == FAR_PICTURES
        return min(self._sights) - here.distance_m if whole else 0.0

    def turn(self) -> None:
        """To the next side: its crop may be seen already while the machine turns."""
        self.crop_at_m = math.inf
        self._sights.clear()
        self._begins.clear()
        self._begins_at_m = math.nan
        self.approached = True
        self._stood_off = False

    def cut_m(self, motion: Motion) -> float:
        """How far the blade had come at a motion since it met the side's crop, or since the side
        was begun."""
        start = self.entered_at or self.begun_at
        return motion.distance_m - start.distance_m if start is not None else 0.0

    def begin(self, here: Motion) -> None:
        """The side: no crop has been met."""
        self.begun_at = here
        self.entered_at = self.seems_clear_since = self.clear_at_blade_since = None
        self.go_on()

    def go_on(self) -> None:
        """What seemed the side's end is bare ground: what ends it counts anew."""
        self.clear_count, self.clear_since = 0, None

    def in_dust(self, share: float, pictures: int) -> bool:
        """Whether fewer of the latest pictures than this share were sure."""
        latest = list(self.sure)[-pictures:]
        return sum(latest) < share * len(latest)

    def note(self, view: CropView, then: Motion) -> None:
        """Of any picture: whether it shows clear ground, sure or not."""
        if view.crop_ahead_m < END_CLEAR_M:
            self.seems_clear_since = None
        elif view.crop_ahead_m >= END_CLEAR_M:
            self.seems_clear_since = self.seems_clear_since or then
        at_blade = view.crop_ahead_m < AT_BLADE_M
        self._at_blade = self._at_blade + 1 if at_blade else 0
        if self._at_blade >= AT_BLADE_PICTURES:
            self.clear_at_blade_since = None
        elif view.crop_ahead_m > CLEAR_M:
            self.clear_at_blade_since = self.clear_at_blade_since or then

    def sight(self, view: CropView, then: Motion) -> None:
        """Of a sure picture: where the crop begins. Crop that was seen does not recede: where dust
        hides its foot from then on, the way to it says when the blade has met it."""
        at_m = then.distance_m + view.crop_ahead_m
        self.crop_at_m = min(self.crop_at_m, at_m)
        self._sights.append(at_m)
        self._stood_off = self._stood_off or view.crop_ahead_m > AT_BLADE_M

    def back_away(self, view: CropView, then: Motion) -> None:
        """Of a sure picture that a machine took while it backed along the side."""
        if BEGINS_M[0] < view.crop_ahead_m < BEGINS_M[1]:
            self._begins.append(then.distance_m + view.crop_ahead_m)
            if len(self._begins) >= BEGIN_PICTURES:
                self._begins_at_m = statistics.median(self._begins)

    def follow(self, view: CropView, seen: EndOfField) -> bool:
        """Of a sure picture on a side: whether the crop begins at the blade just there. What shows
        no crop any more counts towards the side's end, of which it may be the first that was
        `seen`."""
        begins = not self.entered and self.begun(seen.motion)
        met = begins and view.crop_ahead_m < NEAR_CROP_M
        if met or (begins and seen.motion.distance_m > self.crop_at_m + NEAR_CROP_M):
            self.entered_at = seen.motion
        if view.crop_ahead_m < END_CLEAR_M:
            self.go_on()
        elif self.entered:
            self.clear_count += 1
            self.clear_since = self.clear_since or seen
        return met and self.approached and self._stood_off
