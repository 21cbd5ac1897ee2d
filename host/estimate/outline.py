"""The field's outline as it is found to lie: the corners of the boundary that was entered are
landmarks of the position, and each side of the plan lies where they now are.

A walked boundary says how many corners a field has and roughly where
(docs/understand/navigation/place.md). What a machine that cuts along an edge learns of its place
beside it, it learns of the edge as well: which of the two it is, their uncertainties decide. Each
corner moves freely, an edge with the two that it lies between, and a side with its edge and with
those that have left the borders at its ends.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from host.core.compiled import compiled
from host.estimate.bow import angles, bow
from host.estimate.kalman import Array
from host.estimate.states import CORNERS, GRADE_X, X
from host.field import sweep
from host.route.boundary_edges import BoundaryEdges
from host.route.side import NO_EDGE, Side

BEYOND: Final = 0.5
"""Of an edge's length: farther beyond a corner its line is taken to move as it does there."""
PARALLEL: Final = 0.2
"""Sine of the angle under which a border must cross a side to move its end."""
STRAYS_M: Final = 0.12
"""Standard deviation of the crop's edge beside a piece of a boundary that was recorded point by
point, between corners that lie on it: what bends was thinned by up to 0.3 m
(`host.field.corners.SIMPLIFY_M`). Smaller: the place is believed to be known better than it is;
larger: the fence keeps farther away."""
STRAIGHT_M: Final = 1.0
"""Outer edge of a side, between its tips, from which on its ends tell its direction. What is
shorter, or a strip that is nothing but tips, turns as the edge does that it lies along."""


@compiled("(f8[:, ::1], f8[:, ::1], f8[::1], i8, f8, f8)")
def _shares(
    corners: Array, directions: Array, lengths: Array, edge: int, x: float, y: float
) -> tuple[float, float]:
    """How much the line of an edge moves, where it is nearest to a place, with the corner that it
    leaves and with the one that it leads to."""
    along = (x - corners[edge, 0]) * directions[edge, 0]
    along += (y - corners[edge, 1]) * directions[edge, 1]
    share = min(1.0 + BEYOND, max(-BEYOND, along / lengths[edge]))
    return 1.0 - share, share


@compiled("(f8[:, ::1], f8[:, ::1], f8[::1], i8, UniTuple(f8, 2), UniTuple(f8, 2), f8[::1])")
def _along(
    corners: Array,
    directions: Array,
    lengths: Array,
    edge: int,
    at: tuple[float, float],
    way: tuple[float, float],
    out: Array,
) -> None:
    """`Outline.along`, into `out` of zeros."""
    first, second = _shares(corners, directions, lengths, edge, at[0], at[1])
    to = (edge + 1) % len(corners)
    for k in range(2):
        out[2 * edge + k] = first * way[k]
        out[2 * to + k] = second * way[k]


@compiled("(f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1])")
def _nearest(places: Array, corners: Array, directions: Array, lengths: Array, out: Array) -> None:
    """`Outline.nearest`, into `out` of zeros."""
    for m in range(len(places)):
        best, edge, part = math.inf, 0, 0.0
        for n in range(len(corners)):
            x, y = places[m, 0] - corners[n, 0], places[m, 1] - corners[n, 1]
            c, s = directions[n, 0], directions[n, 1]
            share = min(1.0, max(0.0, (x * c + y * s) / lengths[n]))
            off = math.hypot(x - share * c * lengths[n], y - share * s * lengths[n])
            if off < best:
                best, edge, part = off, n, share
        out[m, edge] += 1.0 - part
        out[m, (edge + 1) % len(corners)] += part


@compiled("(f8[:, ::1],)")
def _spread(moved: Array) -> float:
    """How far the one of (n, 2) that is farthest from their middle is from it."""
    x, y = moved[:, 0].mean(), moved[:, 1].mean()
    most = 0.0
    for k in range(len(moved)):
        most = max(most, math.hypot(moved[k, 0] - x, moved[k, 1] - y))
    return most


class Outline:
    """(n, 2) corners; without any nothing is ever moved."""

    def __init__(
        self,
        ring: Sequence[tuple[float, float]] = (),
        walked: Array | None = None,
        strays_m: float = 0.0,
    ) -> None:
        """`ring`: the plan's corners; `walked`: (n, 2) where they were entered, if the plan has
        been laid out anew since; `strays_m`: how far the true edge strays from what lies between
        them, as a standard deviation."""
        self._planned = BoundaryEdges(ring)
        self.walked: Array = self._planned.corners if walked is None else walked
        """(n, 2) the corners as they were entered."""
        self._edges = self._planned
        """Where they are found to lie: a derivative against a direction of before would let what is
        seen beside the lane move the corners along it."""
        self.strays_m: Final = strays_m
        bends = strays_m > 0.0 and len(self._planned.corners) > 0
        self._bows = angles(self._planned.headings, self._planned.lengths).tolist() if bends else []
        self.moved_m: Array = np.zeros_like(self._planned.corners)
        """(n, 2) how far each corner lies from where the plan has it."""
        self.at: Final = slice(CORNERS, CORNERS + self.moved_m.size)
        """Where its corners stand among the filter's states."""
        corners = range(self.at.start, self.at.stop, 2)
        self.turning_with: Final = np.array([X, GRADE_X, *corners], np.int64)
        """The states that turn with it, each an x whose y follows."""
        self._moved_any = False
        self._found: dict[int, tuple[Side, Side]] = {}
        """By the identity of a side, which is kept lest another gets its identity: to compare
        sides by all that they hold takes longer than to move one."""
        self._pieces: dict[int, tuple[Side, list[tuple[float, Side]]]] = {}
        self._nearest: tuple[Array, Array] | None = None
        """The last places asked for, and the answer."""
        self.astray_m = 0.0
        """How far a corner has been found from where it was entered, among the others."""

    @property
    def states(self) -> int:
        """How many numbers its corners are."""
        return self.moved_m.size

    def held(self, *, again: bool) -> range:
        """Which of the filter's states a border that is met tells nothing of. `again`: strip after
        strip along one edge has met it; what one errs of it the next errs alike, and a hundred of
        them would move its corners by metres. They tell of the machine alone."""
        return range(self.at.start, self.at.stop) if again else range(0)

    @property
    def as_planned(self) -> bool:
        """Whether every corner lies where the plan has it."""
        return not self._moved_any

    @property
    def corners(self) -> list[tuple[float, float]]:
        """Where they are found to lie."""
        return [(x, y) for x, y in (self._planned.corners + self.moved_m).tolist()]

    def inside_m(self, x_m: float, y_m: float) -> float:
        """How far a place is inside the outline as it is found; 0 outside, or without one."""
        return float(sweep.depth(self._edges.corners, x_m, y_m))

    def move(self, by_m: Array) -> None:
        """Every corner by so much, (states,)."""
        if np.count_nonzero(by_m):
            self.moved_m = self.moved_m + by_m.reshape(-1, 2)
            self._moved_any = bool(np.count_nonzero(self.moved_m))
            found = self._planned.corners + self.moved_m
            self._edges = BoundaryEdges(found)
            self.astray_m = _spread(found - self.walked)
            self._found.clear()
            self._pieces.clear()
            self._nearest = None

    def heading_rad(self, edge: int) -> float:
        """The direction in which an edge is found to run; 0 for none."""
        return 0.0 if edge == NO_EDGE else float(self._edges.headings[edge])

    def bow(self, side: Side, along_m: float) -> tuple[float, float]:
        """(m, 1): how far left of a straight side the edge that it takes for straight lies along_m
        past its beginning, and how it slopes there against the side."""
        edge = side.edge
        if not self._bows or edge == NO_EDGE or side.length_m <= 0.0:
            return 0.0, 0.0
        begin, end = self._bows[edge]
        if begin == 0.0 and end == 0.0:
            return 0.0, 0.0
        # A piece between two bends is the whole of one, however far inside. One that a border cuts
        # off has the rest of its bow beyond that.
        length, first, last = self._planned.lengths.item(edge), 0.0, 1.0
        if side.begins_at != NO_EDGE:
            first = min(0.9, max(0.0, side.places_m[0][0] / length))
        if side.ends_at != NO_EDGE:
            last = min(1.0, max(first + 0.1, first + side.length_m / length))
        return bow(begin, end, side.length_m, first, last, along_m)

    def _planned_rad(self, edge: int) -> float:
        """The same in the plan."""
        return 0.0 if edge == NO_EDGE else float(self._planned.headings[edge])

    # ---- derivatives -----------------------------------------------------------------------------

    def along(
        self,
        edge: int,
        at: tuple[float, float],
        way: tuple[float, float],
        out: Array | None = None,
    ) -> Array:
        """(states,) the derivative of how far, in direction `way`, that place of an edge moves;
        into `out` of zeros where it is given."""
        if out is None:
            out = np.zeros(self.moved_m.size)
        if edge != NO_EDGE and out.size:
            e = self._edges
            _along(e.corners, e.directions, e.lengths, edge, at, way, out)
        return out

    def _planned_moves(self, edge: int, x: float, y: float) -> tuple[float, float]:
        """How far the line of an edge moved where the plan has it nearest to a place."""
        if edge == NO_EDGE or not self.moved_m.size:
            return 0.0, 0.0
        e, moved = self._planned, self.moved_m
        first, second = _shares(e.corners, e.directions, e.lengths, edge, x, y)
        (ax, ay), (bx, by) = moved[edge].tolist(), moved[(edge + 1) % len(moved)].tolist()
        return first * ax + second * bx, first * ay + second * by

    def of_corner(self, edge: int, way: tuple[float, float]) -> Array:
        """(states,) the derivative of how far, in direction `way`, the corner that an edge leaves
        moves."""
        out = np.zeros_like(self.moved_m)
        if edge != NO_EDGE and len(out):
            out[edge] = way
        return out.ravel()

    def turning(self, edge: int) -> Array:
        """(states,) the derivative of an edge's direction, 1/m."""
        out = np.zeros_like(self.moved_m)
        if edge != NO_EDGE and len(out):
            e = self._edges
            c, s = e.directions[edge] / e.lengths[edge]
            out[edge] = s, -c
            out[(edge + 1) % len(out)] = -s, c
        return out.ravel()

    def end(self, side: Side, way: int) -> Array:
        """(states,) the derivative of how far along a side its end (way 1) or beginning (-1) lies,
        seen from a place that stands still; the side where it is found."""
        heading = side.heading_rad if way < 0 else side.end_heading_rad
        u = (math.cos(heading), math.sin(heading))
        border = side.begins_at if way < 0 else side.ends_at
        at = side.pose(side.edge_begin_m if way < 0 else side.length_m - side.edge_end_m)[:2]
        if border == NO_EDGE or not len(self.moved_m):
            # What was cut begins as far past its edge's corner as it did.
            return (
                self.of_corner(side.edge, u)
                if way < 0
                else self.along(side.edges[-1] if side.edges else NO_EDGE, at, u)
            )
        c, s = self._edges.directions[border]
        across = c * u[1] - s * u[0]
        if abs(across) < PARALLEL:
            across = math.copysign(PARALLEL, across)
        return self.along(border, at, (-s / across, c / across))

    def bends(self, side: Side) -> bool:
        """Whether the edge of a side may bend between its points."""
        return self.strays_m > 0.0 and not side.left_over

    def end_strays_m(self, side: Side, way: int) -> float:
        """Standard deviation of a side's end (way 1) or beginning (-1), m along it, by what the
        border there strays from its straight piece: the more, the shallower it is met."""
        border = side.begins_at if way < 0 else side.ends_at
        if self.strays_m == 0.0 or border == NO_EDGE:
            return self.strays_m
        found = self.found(side)
        heading = found.heading_rad if way < 0 else found.end_heading_rad
        return self.strays_m / max(PARALLEL, abs(math.sin(heading - self.heading_rad(border))))

    def nearest(self, places: Array) -> Array:
        """(m, n) how much the border nearest to each of (m, 2) places moves with each corner. Not
        to be written to."""
        if self._nearest is not None and self._nearest[0] is places:
            return self._nearest[1]
        e = self._edges
        out = np.zeros((len(places), len(e.corners)))
        if not self.states:
            return out
        _nearest(places, e.corners, e.directions, e.lengths, out)
        self._nearest = places, out
        return out

    def weights(self, places: Array) -> Array:
        """(m, n) the same of the plan's border, for (m, 2) places beside that as it was planned."""
        e = self._planned
        out = np.zeros((len(places), len(e.corners)))
        if self.states:
            _nearest(places, e.corners, e.directions, e.lengths, out)
        return out

    # ---- sides as they lie -----------------------------------------------------------------------

    def found(self, side: Side) -> Side:
        """A side of the plan where it is found to lie."""
        if not self._moved_any or not side.edges:
            return side
        known = self._found.get(id(side))
        if known is None:
            known = self._found[id(side)] = side, self._moved(side)
        return known[1]

    def pieces(self, side: Side) -> list[tuple[float, Side]]:
        """Its straight pieces (`Side.pieces`) where they are found to lie. Not to be written to."""
        known = self._pieces.get(id(side))
        if known is None:
            pieces = [self.found(piece) for _, piece in side.pieces()]
            starts = itertools.accumulate((piece.length_m for piece in pieces), initial=0.0)
            found = [(float(start), piece) for start, piece in zip(starts, pieces, strict=False)]
            known = self._pieces[id(side)] = side, found
        return known[1]

    def _moved(self, side: Side) -> Side:
        if side.bends:
            pieces = self.pieces(side)
            turns = [
                math.remainder(b.heading_rad - a.heading_rad, math.tau)
                for (_, a), (_, b) in itertools.pairwise(pieces)
            ]
            start, last = pieces[-1]
            length = start + last.length_m
            bends = tuple((at, turn) for (at, _), turn in zip(pieces[1:], turns, strict=True))
            first = pieces[0][1]
            x, y, heading = first.x_m, first.y_m, first.heading_rad
        else:
            bx, by = self._crossing(side, -1)
            ex, ey = self._crossing(side, 1)
            tips_m = side.edge_begin_m + side.edge_end_m
            if side.length_m - tips_m > STRAIGHT_M:
                turned = math.atan2(ey - by, ex - bx) - side.heading_rad
            else:
                turned = self.heading_rad(side.edge) - self._planned_rad(side.edge)
            heading = side.heading_rad + math.remainder(turned, math.tau)
            length = math.cos(heading) * (ex - bx) + math.sin(heading) * (ey - by) + tips_m
            x = bx - side.edge_begin_m * math.cos(heading)
            y = by - side.edge_begin_m * math.sin(heading)
            bends = ()
        longer = length - side.length_m
        return replace(
            side,
            x_m=x,
            y_m=y,
            heading_rad=heading,
            length_m=length,
            fence_m=side.fence_m + longer,
            bends=bends,
        )

    def _crossing(self, side: Side, way: int) -> tuple[float, float]:
        """Where the outer edge of a straight side begins or ends: it has moved aside with its edge,
        and along it to the border there."""
        e, moved = self._planned, self.moved_m
        along = side.edge_begin_m if way < 0 else side.length_m - side.edge_end_m
        x, y, heading = side.pose(along)
        c, s = math.cos(heading), math.sin(heading)
        border = side.begins_at if way < 0 else side.ends_at
        by_edge = self._planned_moves(side.edge, x, y)
        left, ahead = -s * by_edge[0] + c * by_edge[1], c * by_edge[0] + s * by_edge[1]
        if border == NO_EDGE and way < 0 and side.edge != NO_EDGE:
            moved_x, moved_y = moved[side.edge].tolist()
            ahead = c * moved_x + s * moved_y
        if border != NO_EDGE:
            bc, bs = e.directions[border].tolist()
            across = bc * s - bs * c
            if abs(across) > PARALLEL:
                by_border = self._planned_moves(border, x, y)
                out = bc * by_border[1] - bs * by_border[0]
                ahead = (out - left * (bc * c + bs * s)) / across
        return x + c * ahead - s * left, y + s * ahead + c * left
