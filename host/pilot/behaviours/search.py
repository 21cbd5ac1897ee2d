"""Search: standing after the turn, is there crop where it should be?"""

from __future__ import annotations

import math

from host.estimate.crop_ahead import CONFIDENT
from host.pilot.behaviours.base import Behaviour, Step
from host.pilot.context import Context
from host.pilot.endings import (
    Blind,
    Elsewhere,
    SideEnd,
    Standing,
    blind,
    leave_rest,
    leave_strip,
    or_gather,
)
from host.pilot.gaze import Gaze
from host.pilot.phase import Doing, Go, Phase, Reason
from host.pilot.plan_side import NO_CROP_M
from host.pilot.strip import little_m2

PICTURES = 5
"""That show no crop, for there to be none; or an edge beside which the lane is not, to go on."""
CONTRADICTED_PICTURES = 15
"""The same where the lane refuses that edge: standing, it comes to believe it."""
EMPTY_SHARE = 0.75
"""Of a side, from its beginning on, that is seen without crop for it to have gone."""
MOST_PICTURES = 50
"""Without anything to be made out."""


class Why(Reason):
    """Out of the search."""

    CROP_AHEAD = Doing.FOLLOW, "{side}: crop {ahead_m} m ahead"
    NOT_IN_VIEW = Doing.FOLLOW, "{side}: no crop in view, looking for it"
    OWN_CROP = Doing.FOLLOW, "{side}: nothing to be made out, in crop that is surely the field's"
    NO_CROP_LEFT = Doing.FINISH, "no crop left beside the last swath"
    REMNANT = Doing.FINISH, "the last remnant shows nothing after the turn"
    FARTHER_BACK = Doing.TURN, "nothing to be made out after the turn; looking from farther back"
    NOTHING_TO_SEE = Doing.FAULT, "nothing to be made out after the turn"


class Search(Behaviour):
    """See the module."""

    phase = Phase.SEARCH
    gaze = Gaze(begins=True)
    reasons = (Why, Blind, SideEnd, Elsewhere, Standing)

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._tries = self._empty = 0
        self._judged = -math.inf
        """The stamp of the last picture that was judged."""

    def enter(self, now: float) -> None:
        self._judged = now

    def step(self, now: float) -> Step:
        context = self.context
        go = blind(context, now)
        if go is None and context.standing(now) and context.sight.stamp > self._judged:
            self._judged = context.sight.stamp
            go = self._judge(now)
        return context.hold(), go

    def paused(self, now: float) -> None:
        super().paused(now)
        self._judged = now

    def _judge(self, now: float) -> Go | None:
        """By one more picture. Stems right before the lens are no empty ground."""
        context, view = self.context, self.context.sight.view
        assert context.turning is not None
        self._tries += 1
        if view is not None and view.hidden:
            self._empty = 0
        if view is None or not context.sight.sees_ahead():
            return self._nothing_seen(now) if self._tries > MOST_PICTURES else None
        expected = context.turning.crop_expected_m(context.motion, context.vehicle.blade_x_m)
        if view.crop_ahead_m > expected + NO_CROP_M:
            self._empty += 1
            seen_m = view.crop_ahead_m - expected
            return self._nothing_there(expected, seen_m) if self._empty >= PICTURES else None
        # What the lane does not believe at once it learns here, where no dust is in the air.
        contradicted = context.estimate.lane.contradicted
        agreed = view.confidence >= CONFIDENT and not contradicted
        if not agreed and self._tries < (CONTRADICTED_PICTURES if contradicted else PICTURES):
            return None
        context.begin_strip()
        return Why.CROP_AHEAD.go(side=context.strip.name, ahead_m=f"{view.crop_ahead_m:.1f}")

    def _nothing_seen(self, now: float) -> Go:
        """Something that stands ahead at no sure distance, or right before the lens, may be seen
        better from another place, and so may whatever lies right beside what the machine has cut.
        Past what stands beside a strip, what is left of it stays. From one place pictures err
        alike, so it looks once more from farther back. Else a person must see, unless next to
        nothing of the plan is left, or it is this place, and not the camera, that shows nothing:
        then it may go elsewhere first."""
        context, view = self.context, self.context.sight.view
        stands = view is not None and (view.hidden or math.isfinite(view.crop_ahead_m))
        if (stands or context.strip.beside_swath) and context.goes_unseeing(now):
            context.begin_strip()
            return Why.OWN_CROP.go(side=context.strip.name)
        if leave_rest(context):
            return Why.REMNANT.go()
        if context.turning is not None and context.turning.passes:
            context.begin_strip()
            return leave_strip(context, now)
        if context.turning is not None and context.turning.looks_from_farther_back(now):
            return Why.FARTHER_BACK.go()
        go = Why.NOTHING_TO_SEE.go()
        here = context.hidden or context.sight.saw_lately(context.motion)
        return or_gather(context, go) if here else go

    def _nothing_there(self, expected_m: float, seen_m: float) -> Go:
        """No crop in view after a turn: the end, unless the plan still has a long side here that is
        not seen to be empty, or more after it. Then the machine may be out of line, and looks for
        it along the lane."""
        context, strip = self.context, self.context.strip
        empty = strip.may_be_gone and seen_m > EMPTY_SHARE * strip.left_m()
        if strip.search_reach_m <= 0.0 or (empty and strip.rest_m2 < little_m2(context.plan)):
            context.remains.nothing_stands()
            return Why.NO_CROP_LEFT.go()
        # A tight turn may end past where the crop begins: then all of the way is still to go.
        strip.search_m = max(0.0, expected_m) + strip.search_reach_m
        context.begin_strip()
        return Why.NOT_IN_VIEW.go(side=strip.name)
