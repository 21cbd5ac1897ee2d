"""Which of the boundary's edges a side of a plan runs along, and which have left its two ends: what
is learned of a place on the way is learned of the field's outline."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from host.core.compiled import compiled
from host.route.side import NO_EDGE, Side

ALONG_RAD: Final = 0.05
"""Between the directions of an edge and of a strip along it: strips beside a bend are rounded."""
OUTSIDE_M: Final = 0.1
BORDER_M: Final = 0.2
"""Between a side's end and the border that the rounds before have left of an edge."""
ACROSS: Final = 0.2
"""Of an edge's outward normal along a side, at least, for the side to end at it."""


@compiled("(f8[:, ::1], f8[::1], f8[::1], f8[:, ::1])")
def _measure(
    corners: NDArray[np.float64],
    lengths: NDArray[np.float64],
    headings: NDArray[np.float64],
    directions: NDArray[np.float64],
) -> None:
    """Of each edge of a ring, compiled: an outline that is being found is another ten times a
    second."""
    for k in range(len(corners)):
        to = (k + 1) % len(corners)
        x, y = corners[to, 0] - corners[k, 0], corners[to, 1] - corners[k, 1]
        lengths[k], headings[k] = math.hypot(x, y), math.atan2(y, x)
        if lengths[k] > 0.0:
            directions[k, 0], directions[k, 1] = x / lengths[k], y / lengths[k]
        else:
            directions[k, 0], directions[k, 1] = math.nan, math.nan


class BoundaryEdges:
    """The edges of a counter-clockwise ring (n, 2) of corners, m; edge k leaves corner k."""

    def __init__(self, ring: Sequence[tuple[float, float]] | NDArray[np.float64]) -> None:
        self.corners: NDArray[np.float64] = np.array(ring, float).reshape(-1, 2)
        count = len(self.corners)
        self.lengths, self.headings = np.empty(count), np.empty(count)
        self.directions = np.empty((count, 2))
        _measure(self.corners, self.lengths, self.headings, self.directions)

    def _against(self, x: float, y: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n,) how far along each edge a place lies, and how far left of it, m."""
        dx, dy = x - self.corners[:, 0], y - self.corners[:, 1]
        c, s = self.directions.T
        return dx * c + dy * s, dy * c - dx * s

    def beside(self, x: float, y: float, heading_rad: float) -> int:
        """The edge that a strip whose middle has this place and direction runs along."""
        along, inside = self._against(x, y)
        askew = np.abs(np.remainder(self.headings - heading_rad + math.pi, math.tau) - math.pi)
        beyond = np.maximum(0.0, np.maximum(-along, along - self.lengths))
        price = np.where((askew < ALONG_RAD) & (inside > -OUTSIDE_M), beyond + 0.1 * inside, np.inf)
        best = int(np.argmin(price))
        return best if np.isfinite(price[best]) else NO_EDGE

    def namer(self) -> Callable[[Side], Side]:
        """What gives the sides of a plan their edges, one after the other in the plan's order."""
        cut_m = np.zeros(len(self.corners))
        """How deep the strips before have cut from each edge."""

        def name(side: Side) -> Side:
            if len(self.corners) < 3:
                return side
            pieces = [piece for _, piece in side.pieces()]
            edges = [self.beside(*piece.pose(piece.length_m / 2)) for piece in pieces]
            begun = [self._against(piece.x_m, piece.y_m) for piece in pieces]
            places = [
                (float(along[edge]), float(inside[edge]))
                for edge, (along, inside) in zip(edges, begun, strict=True)
            ]
            first, last = side.pose(side.edge_begin_m), side.pose(side.length_m - side.edge_end_m)
            named = replace(
                side,
                edges=tuple(edges),
                places_m=tuple(places),
                begins_at=self._border(first, -1, cut_m),
                ends_at=self._border(last, 1, cut_m),
            )
            for edge, (_, inside_m) in zip(edges, places, strict=True):
                if edge != NO_EDGE:
                    cut_m[edge] = max(cut_m[edge], inside_m + side.width_m)
            return named

        return name

    def _border(self, at: tuple[float, float, float], way: int, cut_m: NDArray[np.float64]) -> int:
        """The edge whose border crosses the outer edge at a pose; `way` 1 where the side ends there
        and -1 where it begins."""
        x, y, heading = at
        along, inside = self._against(x, y)
        outward = np.sin(self.headings) * math.cos(heading)
        outward -= np.cos(self.headings) * math.sin(heading)
        off = np.abs(inside - cut_m)
        beyond = np.maximum(0.0, np.maximum(-along, along - self.lengths))
        fits = (way * outward > ACROSS) & (off < BORDER_M)
        price = np.where(fits, beyond + off, np.inf)
        best = int(np.argmin(price))
        return best if np.isfinite(price[best]) else NO_EDGE
