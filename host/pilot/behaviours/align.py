"""Align: the operator has put the blade at the crop's edge; stand until pictures show it and the
gyroscope's offset is known.

Without that offset the yaw of the first side is as good as the pot's middle. Of what pictures show
meanwhile the middle one counts: the machine takes its place from it as it sets off, and one of many
has the crop a third of a metre farther ahead than it stands.
"""

from __future__ import annotations

import math
from typing import Final

from host.estimate.crop_ahead import CONFIDENT, EndOfField
from host.estimate.prior import START_SIGMA
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.context import Context
from host.pilot.endings import Elsewhere, Patience, SideEnd, Standing, end_side, gave_up
from host.pilot.leaps import LEAP_M
from host.pilot.phase import Doing, Go, Phase, Reason
from host.pilot.plan_side import NO_CROP_M
from host.pilot.planned_strip import PlannedStrip
from host.pilot.strip import Strip
from host.vision.view import CropView

TRUST_AFTER_S = 3.0
"""An edge that stays hidden is where the operator has put the blade; where the crop's border slants
across the strip, what is seen is not the edge, and that holds at once."""
NO_END: Final = 0.05
"""Confidence of an edge that is made up: the crop goes on to the right."""
SURE_COUNTS: Final = 5
"""Pictures without one that a sure picture of the crop's right end outweighs. A machine that faces
the neighbour's crop sees faint ends in a quarter of its pictures, and no sure one."""
SHOWN: Final = 3
"""Pictures by which sure ones must outnumber those without an end, to set off by them; one that is
as sure as this counts so many:"""
SURELY: Final = 0.9
SEEN_SIGMA = (0.15, math.radians(8))
"""Of the operator's alignment, m and rad, where the picture then says more."""
ASKEW_RAD: Final = 2.0 * SEEN_SIGMA[1]
"""By which no operator puts the machine down askew of its side."""
ASIDE_M: Final = 3.0 * SEEN_SIGMA[0]
"""By which none puts the blade's end down beside the edge."""
TRUSTED_SIGMA = (0.05, math.radians(2))
"""Where it does not: a machine that believes less would not set off."""
SETTLED: Final = math.radians(0.03)
"""How surely the gyroscope's offset is known before the machine moves, rad/s: a first side of a
minute then turns by 2 degrees (one sigma). A machine that stands still shows it in some two
seconds; half a second shows it to 0.2 degrees/s, with which the gyroscope is not used."""
SETTLE_S: Final = 5.0
"""The longest that is stood for it: one that is shaken at rest shows no more by waiting."""
CREPT_M: Final = 0.03
"""On a slope the brake lets the machine creep; once it has come so far it stands no longer. It was
put down at the border, and by then the offset is known well enough to be used."""


class Why(Reason):
    """Out of aligning."""

    SEEN = Doing.FOLLOW, "the edge is in view"
    TRUSTED = Doing.FOLLOW, "on the operator's alignment"


class Wait(Reason):
    """Why it does not set off."""

    NO_END = (
        Doing.ALIGN,
        "the crop ahead has no end to the right, so this is not the corner, or not the direction, "
        "of the plan: put the machine at the field's corner, facing along its side, the blade's "
        "right end on the crop's edge; if it stands so, the camera is turned, or its picture is "
        "upside down",
    )
    ASKEW = (
        Doing.ALIGN,
        "pictures show the crop's edge {deg} deg askew of the machine: put it in line with its "
        "side; if it is, the pictures are mirrored or upside down, or the camera is turned",
    )
    ASIDE = (
        Doing.ALIGN,
        "pictures show the crop's edge {m} m beside the blade's right end: put that on the edge; "
        "if it is, put the machine a little farther along its side, where pictures show it",
    )
    NOTHING_AHEAD = (
        Doing.ALIGN,
        "nothing stands before the blade, and the plan has {left} m more of this side: put the "
        "machine where the crop begins",
    )


class Align(Behaviour):
    """See the module."""

    phase = Phase.ALIGN
    reasons = (Why, Wait, SideEnd, Elsewhere, Patience, Standing)

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._judged = -math.inf
        """The stamp of the last picture that was judged."""
        self._askew = 0
        """Pictures that showed the machine askew, less those that showed it in line."""
        self._aside = 0
        """The same of sure pictures that showed the edge elsewhere than at the blade's end."""
        self._shown = 0
        """Sure pictures of the edge, less those without one."""
        self._endless = 0
        """Pictures that showed crop without a right end, less those that showed one, of which a
        sure one counts more, and a faint one elsewhere than at the blade's nothing."""
        self._views: list[CropView] = []
        """Pictures that showed crop with a right end, sure or not."""
        self._stood_at_m = context.motion.distance_m
        """How far it had come when it began to stand."""

    def step(self, now: float) -> Step:
        context = self.context
        go = gave_up(context, now)
        if go is not None:
            return context.hold(), go
        view = context.sight.view
        if view is None or not context.sight.sees_ahead():
            return context.hold(), None
        strip = context.planned(0)
        if isinstance(strip, PlannedStrip) and strip.resumed and view.crop_ahead_m > NO_CROP_M:
            return context.hold(), self._nothing_ahead(now, strip)
        slanting = strip.begins_slanting
        fresh = context.sight.stamp > self._judged
        self._judged = context.sight.stamp
        endless = not (slanting or view.confidence > NO_END)
        if fresh:
            certain = view.confidence >= CONFIDENT
            elsewhere = not certain and abs(strip.edge_m(view, context.motion)) > LEAP_M
            shows = 0 if elsewhere else SURE_COUNTS if certain else 1
            self._endless = max(-SURE_COUNTS, self._endless + (1 if endless else -shows))
            sure = 0 if view.confidence < CONFIDENT else SHOWN if view.confidence >= SURELY else 1
            self._shown = max(0, self._shown - 1) if endless else self._shown + sure
            if not endless:
                self._views.append(view)
        if endless and self._shown < SHOWN:
            # So it looks to a machine that faces the neighbour's crop, or the middle of its own.
            if now - context.since >= TRUST_AFTER_S:
                context.reason = Wait.NO_END.go().text
            return context.hold(), None
        seen = self._shown >= SHOWN and not slanting
        trusted = isinstance(strip, PlannedStrip) and now - context.since >= TRUST_AFTER_S
        trusted = trusted and self._endless <= 0 and self._aside <= 0
        if not (seen or slanting or trusted):
            return context.hold(), None
        lane = context.estimate.lane
        if seen and view.confidence >= CONFIDENT:
            edge_m = self._place_by(view, strip)
            if self._shows_askew(lane.heading_rad, fresh=fresh):
                deg = f"{math.degrees(abs(lane.heading_rad)):.0f}"
                context.reason = Wait.ASKEW.go(deg=deg).text
                return context.hold(), None
            if self._shows_aside(edge_m, fresh=fresh):
                context.reason = Wait.ASIDE.go(m=f"{abs(edge_m):.1f}").text
                return context.hold(), None
        if (seen and (self._askew > 0 or self._aside > 0)) or self._settles(now):
            return context.hold(), None
        view = self._middle(strip, sure=seen) or view
        if seen:
            self._place_by(view, strip)
        else:
            lane.place(0.0, 0.0, *TRUSTED_SIGMA)
        if isinstance(strip, PlannedStrip):
            along_m, along_sigma_m = strip.put_down(view.crop_ahead_m)
            beside_sigma_m = START_SIGMA[1] if seen else TRUSTED_SIGMA[0]
            strip.place(along_m, beside_sigma_m, along_sigma_m)
        context.strip = strip
        context.begin_strip()
        return context.hold(), (Why.SEEN if seen else Why.TRUSTED).go()

    def _settles(self, now: float) -> bool:
        """Whether the gyroscope speaks, and its offset is still to be found."""
        context = self.context
        gyroscope = context.estimate.odometry.gyroscope
        speaks = math.isfinite(gyroscope.stamp) and not gyroscope.contradicted
        unknown = gyroscope.offset_sigma > SETTLED
        stands = abs(context.motion.distance_m - self._stood_at_m) < CREPT_M
        return speaks and unknown and stands and now - context.since < SETTLE_S

    def _place_by(self, view: CropView, strip: Strip) -> float:
        """Puts the machine beside the lane by a picture alone. Returns where that has the edge, m
        left of the blade's end."""
        context = self.context
        context.estimate.lane.place(0.0, 0.0, *SEEN_SIGMA)
        edge_m, ahead_m = strip.edge_m(view, context.motion), view.edge_ahead_m
        context.estimate.lane.correct(
            edge_m, view.edge_heading_rad, view.confidence, (0.0, 0.0), ahead_m=ahead_m
        )
        return edge_m

    def _middle(self, strip: Strip, *, sure: bool) -> CropView | None:
        """Of the pictures, or of the sure ones with the edge at the blade's end, that with as many
        showing the crop nearer as farther."""
        views = [view for view in self._views if not sure or self._at_the_blade(view, strip)]
        return sorted(views, key=lambda view: view.crop_ahead_m)[len(views) // 2] if views else None

    def _at_the_blade(self, view: CropView, strip: Strip) -> bool:
        edge_m = strip.edge_m(view, self.context.motion)
        return view.confidence >= CONFIDENT and abs(edge_m) <= ASIDE_M

    def _shows_askew(self, heading_rad: float, *, fresh: bool) -> bool:
        """Whether most pictures so far show the machine askew of the edge, as this one."""
        if fresh:
            askew = abs(heading_rad) > ASKEW_RAD
            self._askew = max(-1, self._askew + (1 if askew else -1))
        return self._askew > 0

    def _shows_aside(self, edge_m: float, *, fresh: bool) -> bool:
        """The same of the blade's end beside the edge."""
        if fresh:
            aside = abs(edge_m) > ASIDE_M
            self._aside = max(-1, self._aside + (1 if aside else -1))
        return self._aside > 0

    def _nothing_ahead(self, now: float, strip: PlannedStrip) -> Go | None:
        """Of a side that was begun before: where it may end it has been cut to its end."""
        context = self.context
        if now - context.since < TRUST_AFTER_S:
            return None
        context.estimate.lane.place(0.0, 0.0, *TRUSTED_SIGMA)
        strip.place(0.0, TRUSTED_SIGMA[0])
        if not strip.may_be_cut():
            context.reason = Wait.NOTHING_AHEAD.go(left=f"{strip.left_m():.1f}").text
            return None
        strip.was_cut()
        context.strip = strip
        context.begin_strip()
        return end_side(context, now, EndOfField(now, context.motion))
