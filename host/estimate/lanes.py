"""The lanes that were cut: where each was found to lie, for the one whose edge it has left."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from host.estimate.kalman import Array
from host.estimate.measurements.border import BOUNDARY, Across
from host.estimate.outline import PARALLEL, Outline
from host.estimate.states import SIGHT
from host.route.side import NO_EDGE, Side

LANE_SIGMA = (0.06, math.radians(0.5))
"""Of the outer edge's line against the plan's, m and rad."""
LEFT_SIGMA = (0.3, math.radians(5.0))
"""The same of what strips have left: its edges are no straight lines, and where these strips were
cut is known by the places of then."""
RING_SIGMA = (0.02, math.radians(0.2))
RING_ENDS_M = 0.08
"""What a strip adds to that, m and rad; its direction the more, the shorter it is: both ends err by
so much."""
STRAIGHTEN_M = 0.1
"""By which a lane overlaps what is cut at most, at one of its ends, to lie less askew than the edge
beside it."""
NOWHERE = -1
"""Among the states."""
LEAST_KEPT, SPARE = 16, 8
"""Lanes that were cut, in the state: one or two for each edge of a field without bends, and one for
each piece of an edge that bends, and some. A lane that is kept there no more errs alone: nine
rounds along 48 pieces with 16 lanes, and the place was 0.7 m off and said 0.15."""
TINY = 1e-12
"""Keeps a variance of nothing from being divided by, m²."""
CATCH_UP_M = 0.05
"""Of a plan's overlap, by which a lane that lies outside of its plan takes a wider strip: without
it the strips fall behind the plan by what the detector errs, until one of them is not there."""


class Known(NamedTuple):
    """A lane, its offset at the side's beginning, m left of the plan's, and its direction, rad, by
    the filter's state x: at + by x, and what errs besides."""

    at: Array
    """(2,)"""
    by: Array
    """(2, states)"""
    noise: Array
    """(2, 2) the covariance of that."""

    def covariance(self, p: Array) -> Array:
        """(2, 2) of the lane, where `p` is the filter's covariance."""
        found: Array = self.by @ p @ self.by.T + self.noise
        return found


class Kept(NamedTuple):
    """A lane that was cut, and what is known of it."""

    side: Side
    state: int
    """Where among the filter's states it is kept; NOWHERE: it is no more."""
    lane: Known


class Aside(NamedTuple):
    """How far right of its usual place beside the edge a lane is laid, over ground that is cut."""

    begin_m: float = 0.0
    """At the side's beginning."""
    slope: float = 0.0
    """More with each metre, as a tangent."""


def straightened(askew_rad: float, sigma_rad: float, length_m: float) -> Aside:
    """Beside an edge that is turned left of the plan by askew_rad, give or take sigma_rad: what is
    surely askew of it is taken off, as far as STRAIGHTEN_M allows. The blade never leaves crop
    standing beside its edge, it overlaps at the one end or at the other."""
    sure = max(0.0, abs(askew_rad) - sigma_rad)
    turn = min(math.tan(sure), STRAIGHTEN_M / max(length_m, 1.0))
    return Aside(0.0, turn) if askew_rad > 0.0 else Aside(turn * length_m, -turn)


def caught_up(aside: Aside, left_m: float, sigma_m: float) -> Aside:
    """The same of a lane that begins left_m left of the plan's, give or take sigma_m: what is
    surely outside of it is taken back."""
    behind = max(0.0, -left_m - sigma_m)
    return aside._replace(begin_m=aside.begin_m - min(behind, CATCH_UP_M))


def _alone(kept: Kept, x: Array, p: Array) -> Kept:
    """A lane that is kept among the states x with the covariance `p` no more: how it errs as all
    pictures do, and besides alone."""
    at = slice(kept.state, kept.state + 2)
    by_sight = p[at, SIGHT] / max(p[SIGHT, SIGHT], TINY)
    by = np.zeros((2, len(x)))
    by[:, SIGHT] = by_sight
    rest = p[at, at] - np.outer(by_sight, p[SIGHT, at])
    return Kept(kept.side, NOWHERE, Known(x[at] - by_sight * x[SIGHT], by, rest))


def _askew_rad(side: Side) -> float:
    """Standard deviation of the angle between a strip and the one that it leaves."""
    return math.hypot(RING_SIGMA[1], RING_ENDS_M / max(1.0, side.length_m))


def kept_for(edges: int) -> int:
    """For how many lanes there is room among the states, beside a boundary of so many edges."""
    return max(LEAST_KEPT, edges + SPARE)


class Lanes:
    """Remembers the last lane along every edge. `width_m`: of the blade; `states`: where each lane
    that is kept has its two, one after the other."""

    def __init__(self, width_m: float, states: range) -> None:
        self._width, self._states = width_m, states
        self._kept: list[Kept] = []

    def keep(self, side: Side, x: Array, p: Array) -> int:
        """It is cut; the one along the same edge whose crop it has taken is forgotten. One along
        another edge may be longer, and have left more than that. Returns the state that its lane is
        to be kept in. With it stays how it errs as the machine's place and other lanes do: what is
        found of one is found of all. Of the oldest of too many, only how it errs as all pictures
        do."""
        self._kept = [
            k for k in self._kept if k.side.edge != side.edge or not self._left_by(side, k.side)
        ]
        taken = [k.state for k in self._kept if k.state != NOWHERE]
        if len(taken) == len(self._states):
            oldest = next(n for n, k in enumerate(self._kept) if k.state != NOWHERE)
            self._kept[oldest] = _alone(self._kept[oldest], x, p)
            taken.remove(taken[0])
        state = min(set(self._states).difference(taken))
        by = np.zeros((2, len(x)))
        by[0, state] = by[1, state + 1] = 1.0
        self._kept.append(Kept(side, state, Known(np.zeros(2), by, np.zeros((2, 2)))))
        return state

    def beside(self, side: Side, states: int) -> Known:
        """What is known of a side's lane before anything is seen of it: as it will be seen, beside
        where the machine has driven along the last."""
        last = None if side.left_over else self._last(side)
        if last is None:
            lane = Known(np.zeros(2), np.zeros((2, states)), np.diag(self._unknown(side)) ** 2)
        else:
            moved = np.array([[1.0, side.begins_past(last.side)], [0.0, 1.0]])
            grown = np.diag([RING_SIGMA[0] ** 2, _askew_rad(last.side) ** 2])
            at, by, noise = last.lane
            lane = Known(moved @ at, moved @ by, moved @ noise @ moved.T + grown)
        lane.by[0, SIGHT] += 1.0
        return lane

    def _unknown(self, side: Side) -> tuple[float, float]:
        """Standard deviations of a side's lane, m and rad, whose edge no lane that is known has
        left: it is the boundary itself, or a strip along another edge has left it, which runs with
        the plan."""
        if side.left_over:
            return LEFT_SIGMA
        if side.inside_m < self._width / 2:
            return LANE_SIGMA
        return LEFT_SIGMA[0], _askew_rad(side)

    def inside(self) -> list[tuple[Side, int]]:
        """(side, state) of each lane inside the field that is kept among the states."""
        return [
            (kept.side, kept.state)
            for kept in self._kept
            if kept.state != NOWHERE and kept.side.inside_m > self._width / 2
        ]

    def knows(self, side: Side) -> bool:
        """Whether a lane has left its edge."""
        return self._last(side) is not None

    def across(self, outline: Outline, side: Side, way: int) -> Across:
        """What has left the border at a side's end (way 1) or beginning (-1): the last lane along
        that edge of the boundary, where there is one. It matters where the boundary is still to be
        found: what that lane is off must not pass for what the corners are."""
        edge = side.begins_at if way < 0 else side.ends_at
        last = next((k for k in reversed(self._kept) if k.side.edge == edge != NO_EDGE), None)
        if not outline.states:
            return BOUNDARY
        strays = outline.end_strays_m(side, way)
        border = BOUNDARY._replace(sigma_m=strays)
        if last is None:
            return border
        across, along = outline.found(last.side), outline.found(side)
        c, s = math.cos(across.heading_rad), math.sin(across.heading_rad)
        heading = along.heading_rad if way < 0 else along.end_heading_rad
        sine = abs(math.sin(heading - across.heading_rad))
        at = along.pose(along.edge_begin_m if way < 0 else along.length_m - along.edge_end_m)
        met_m = (at[0] - across.x_m) * c + (at[1] - across.y_m) * s
        if sine < PARALLEL or not -self._width < met_m < across.length_m + self._width:
            return border
        # What lies left of a lane lies farther inside.
        h = np.array([1.0, met_m]) * (-way / sine)
        lane = last.lane
        sigma = math.hypot(math.sqrt(h @ lane.noise @ h), strays)
        return Across(float(h @ lane.at), sigma, h @ lane.by)

    def _last(self, side: Side) -> Kept | None:
        """The lane whose cutting has left a side's edge. Where the strips between were laid out
        otherwise, the last along the same edge of the boundary: an inner strip is turned as that
        is, it does not lie along the boundary again."""
        left = [kept for kept in self._kept if self._left_by(side, kept.side)]
        if left:
            return left[-1]
        same = [k for k in self._kept if side.edge != NO_EDGE and k.side.edge == side.edge]
        return same[-1] if same and side.inside_m > same[-1].side.inside_m else None

    def _left_by(self, side: Side, cut: Side) -> bool:
        return side.left_by(cut, self._width)
