"""One pass of a plan, and which of the boundary's edges it belongs to."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from host.core.frames import Pose2
from host.core.vehicle import Vehicle
from host.route.standing import BEND_RAD

BENT_RAD = BEND_RAD[0] + math.radians(3.0)
"""Between a side that bends and the next along the same edge: what the first may have lost with its
first piece, and what its pieces turn besides."""
AGAIN_RAD = math.radians(3.0)
"""Between strips to which no turn leads: one by so little would take many metres straight on. Edges
that are found bend by some tenths of a degree against each other."""
BESIDE_RAD = math.radians(1.0)
BESIDE_WIDTHS = (0.2, 1.5)
"""Of the blade, between the lines of a side and of the one that has left its edge."""
NO_EDGE = -1
"""Index for "none of the boundary's edges"."""


@dataclass(frozen=True, slots=True)
class Side:
    """One pass. The crop's outer edge runs from (x_m, y_m) in direction heading_rad (field frame)
    for length_m; the strip is width_m wide, left of it. From the beginning of the crop it is
    fence_m to the field's boundary or a keep-out: on inner sides, what has been cut lies
    between."""

    x_m: float
    y_m: float
    heading_rad: float
    length_m: float
    width_m: float
    fence_m: float
    back_m: float = 0.0
    """From the beginning of the crop back to the boundary or a keep-out."""
    shift_m: float = 0.0
    """How far right of its usual place the lane lies, so that the blade's left end does not reach
    over a strip that is narrow for the sake of a corner or a keep-out beside it."""
    blind_end: bool = False
    """The side ends in standing crop, before a keep-out: no picture shows where."""
    begin_seen_m: float = 0.0
    end_seen_m: float = 0.0
    """From the crop's first and to its last tip, at slanting corners: where it fills enough of the
    strip's width to be seen."""
    edge_begin_m: float = 0.0
    edge_end_m: float = 0.0
    """From there the outer edge runs; what is seen before and behind it is a slanting border."""
    bends: tuple[tuple[float, float], ...] = ()
    """(how far along the side, by how much to the left in rad) its edge bends; `heading_rad` is the
    direction in which it begins."""
    edges: tuple[int, ...] = ()
    """The boundary's edges that its pieces run along, by the corner that each begins at, NO_EDGE
    for none; empty where nothing is known of it."""
    places_m: tuple[tuple[float, float], ...] = ()
    """(how far along its edge, how far inside it) each piece begins."""
    begins_at: int = NO_EDGE
    """The boundary's edge that has left the border at which the outer edge begins,"""
    ends_at: int = NO_EDGE
    """and that at which it ends."""
    left_over: bool = False
    """Whether it is cut through what others have left: its edge lies along none of the boundary's,
    and it begins and ends where these happened to end."""

    @property
    def edge(self) -> int:
        """The boundary's edge that it begins along."""
        return self.edges[0] if self.edges else NO_EDGE

    @property
    def inside_m(self) -> float:
        """How far inside of its edge of the boundary it begins; 0 beside none."""
        return self.places_m[0][1] if self.places_m else 0.0

    @property
    def line(self) -> tuple[float, float]:
        """Where the edge begins, along the side's direction from the field's origin, and how far
        left of that origin it runs."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        return c * self.x_m + s * self.y_m, c * self.y_m - s * self.x_m

    def edge_line(self) -> list[tuple[float, float]]:
        """Where its outer edge runs: from the crop's first tip through the bends to the last."""
        x, y, heading = self.x_m, self.y_m, self.heading_rad
        points, past = [(x, y)], 0.0
        for along, turn in (*self.bends, (self.length_m, 0.0)):
            x += (along - past) * math.cos(heading)
            y += (along - past) * math.sin(heading)
            points.append((x, y))
            past, heading = along, heading + turn
        return points

    @property
    def end_heading_rad(self) -> float:
        """The direction in which it ends."""
        return self.heading_rad + sum(turn for _, turn in self.bends)

    def pose(self, along_m: float, left_m: float = 0.0) -> tuple[float, float, float]:
        """(x, y, direction) along_m along the edge and left_m left of it; straight on before the
        beginning and beyond the end."""
        x, y, heading, past = self.x_m, self.y_m, self.heading_rad, 0.0
        for bend, turn in self.bends:
            if along_m <= bend:
                break
            x += (bend - past) * math.cos(heading)
            y += (bend - past) * math.sin(heading)
            past, heading = bend, heading + turn
        ahead = along_m - past
        c, s = math.cos(heading), math.sin(heading)
        return x + c * ahead - s * left_m, y + s * ahead + c * left_m, heading

    def takes_again(self, past: Side) -> bool:
        """Whether this is the next strip of the edge that `past` was cut along: a shuttle leads to
        it, not a turn."""
        turned = abs(math.remainder(self.heading_rad - past.heading_rad, math.tau))
        if turned < AGAIN_RAD and not (self.bends or past.bends):
            return True
        here = (self.x_m, self.y_m)
        beside = math.dist(here, past.pose(0.0)[:2]) < math.dist(here, past.pose(past.length_m)[:2])
        return turned < BENT_RAD and beside

    def pieces(self) -> list[tuple[float, Side]]:
        """(where along the side it begins, the straight side) of each piece between its bends; the
        first has the side's beginning, the last its end."""
        if not self.bends:
            return [(0.0, self)]
        starts = [0.0, *(along for along, _ in self.bends)]
        ends = [*starts[1:], self.length_m]
        found = []
        for k, (start, end) in enumerate(zip(starts, ends, strict=True)):
            # A bend's own place counts to the piece before it.
            x, y, heading = self.pose(start) if k == 0 else self.pose(start + 1e-9)
            piece = replace(self, x_m=x, y_m=y, heading_rad=heading, length_m=end - start, bends=())
            if k > 0:
                piece = replace(piece, begin_seen_m=0.0, edge_begin_m=0.0, begins_at=NO_EDGE)
            if k + 1 < len(starts):
                piece = replace(piece, end_seen_m=0.0, edge_end_m=0.0, ends_at=NO_EDGE)
            of = slice(k, k + 1)
            piece = replace(piece, edges=self.edges[of], places_m=self.places_m[of])
            found.append((start, piece))
        return found

    def begins_as(self, other: Side) -> bool:
        """Whether both run along the same edge of the boundary from the same border."""
        return NO_EDGE not in (self.edge, self.begins_at) and (self.edge, self.begins_at) == (
            other.edge,
            other.begins_at,
        )

    def ends_as(self, other: Side) -> bool:
        """Whether both run along the same edge of the boundary to the same border."""
        mine, its = (side.edges[-1] if side.edges else NO_EDGE for side in (self, other))
        return NO_EDGE not in (mine, self.ends_at) and (mine, self.ends_at) == (its, other.ends_at)

    def left_by(self, past: Side, blade_width_m: float) -> bool:
        """Whether cutting `past` has left this side's edge."""
        turned = abs(math.remainder(self.heading_rad - past.heading_rad, math.tau))
        along_one = turned < BESIDE_RAD
        apart_m = self.line[1] - past.line[1]
        if self._along_edge_of(past):
            along_one, apart_m = True, self.places_m[0][1] - past.places_m[0][1]
        return along_one and BESIDE_WIDTHS[0] < apart_m / blade_width_m < BESIDE_WIDTHS[1]

    def begins_past(self, past: Side) -> float:
        """How far along the line of `past`, beside which it lies, it begins past its beginning."""
        if self._along_edge_of(past):
            return self.places_m[0][0] - past.places_m[0][0]
        return self.line[0] - past.line[0]

    def _along_edge_of(self, past: Side) -> bool:
        """Of plans that were laid out anew only this tells."""
        return self.edge != NO_EDGE and self.edge == past.edge


def lane_pose(side: Side, along_m: float, vehicle: Vehicle) -> Pose2:
    """Of the rear axle when the blade's line is along_m past the side's beginning; in a bend the
    machine is taken to stand as the edge abreast of its blade runs."""
    return Pose2(*side.pose(along_m, vehicle.inset_m - side.shift_m)).ahead(-vehicle.blade_x_m)
