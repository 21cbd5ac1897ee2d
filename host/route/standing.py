"""What still stands of a field, the edges of it that can be followed, and the strip along one of
them.

An edge is a chain of straight pieces between two corners. Where it bends by no more than the
steering follows in passing, the chain goes on: a field as farm programs export it has edges of many
such bends, and only its corners are worth a turn.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.affinity import affine_transform

Point = tuple[float, float]
Points = NDArray[np.float64]
"""(n, 2), metres of the field frame."""

BEND_RAD: Final = (math.radians(22.0), math.radians(45.0))
"""Largest change of an edge's direction, to the left and to the right, that is followed in passing.
At a bend to the left the blade leaves the crop until the steering has followed, at one to the
right it leaves a wedge beside the lane; 1.5 m ahead of the axle, it moves 60 deg askew of the
machine on the lock. A corner to the left costs a turn, one to the right many shuttles, hence the
two values."""
MIN_STRIP_M2: Final = 0.02
"""What a strip must hold; smaller remains are nothing a camera could find."""
NEAR_M: Final = 1e-3
"""Two shapes that touch but for rounding."""
DOUBLED_M: Final = 1e-6
"""Nearer points of a ring are one."""
MIN_EDGE_M: Final = 0.05
"""Shorter edges are what rounding leaves of a cut."""
SIMPLIFY_M: Final = 0.01
"""Points that lie so near to the line between their neighbours are rounding of the cutting."""
OVERHANG: Final = 4.0
"""Widths of a strip that it may reach beyond its edge at a slanting corner: one that is no bend
slants over 2.5 of them at most."""
FAR_WIDTHS: Final = 20
"""Strips beyond which their number need not come out even: a part of a per cent each."""
AT_TIP_M: Final = 2.5
"""A strip's last piece, which shows its rows there: a bent strip's other end lies elsewhere."""
SEEN_ROWS: Final = 9
"""Rows of a strip that are looked at for where its crop begins and ends."""


@dataclass(frozen=True, eq=False)
class Edge:
    """An edge of what stands, counter-clockwise: what stands lies left of it."""

    points: tuple[Point, ...]
    open_ends: bool
    """Both corners turn left, so both ends of a strip along it are open ground."""

    @functools.cached_property
    def line(self) -> shapely.LineString:
        """The chain."""
        return _line(self.points)

    @functools.cached_property
    def heading(self) -> float:
        """Direction in which it begins (rad)."""
        (ax, ay), (bx, by) = self.points[:2]
        return math.atan2(by - ay, bx - ax)

    @functools.cached_property
    def end_heading(self) -> float:
        """Direction in which it ends (rad)."""
        (ax, ay), (bx, by) = self.points[-2:]
        return math.atan2(by - ay, bx - ax)

    @property
    def begin(self) -> Point:
        """Its first corner."""
        return self.points[0]

    @property
    def bent(self) -> bool:
        """Whether it has a bend at all."""
        return len(self.points) > 2

    def prolonged(self, by_m: float) -> shapely.LineString:
        """The chain, straight on at both ends."""
        (ax, ay), (bx, by) = self.points[0], self.points[-1]
        back, on = self.heading + math.pi, self.end_heading
        first = (ax + by_m * math.cos(back), ay + by_m * math.sin(back))
        last = (bx + by_m * math.cos(on), by + by_m * math.sin(on))
        return _line([first, *self.points, last])

    def depths_of(self, places: Points) -> NDArray[np.float64]:
        """(n,) how far left of the prolonged chain places (n, 2) lie, m; negative right of it."""
        line = self.prolonged(1e4)
        points = shapely.points(places)
        along = shapely.line_locate_point(line, points)
        chain = shapely.get_coordinates(line)
        ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(chain, axis=0).T))])
        a, b = (
            np.column_stack([np.interp(along + d, ends, chain[:, k]) for k in (0, 1)])
            for d in (-0.05, 0.05)
        )
        way, to = b - a, places - a
        left = way[:, 0] * to[:, 1] - way[:, 1] * to[:, 0]
        depths: NDArray[np.float64] = np.copysign(shapely.distance(line, points), left)
        return depths


def _line(points: Sequence[Point]) -> shapely.LineString:
    """A chain: made so, it takes a quarter of the time that its class takes."""
    line: shapely.LineString = shapely.linestrings(points)
    return line


def _directions(ring: shapely.LinearRing) -> tuple[Points, NDArray[np.float64]]:
    """(points (n, 2), how far the ring turns left at each (n,), rad)."""
    points = np.array(shapely.remove_repeated_points(ring, DOUBLED_M).coords)[:-1]
    ways = np.concatenate([points[1:], points[:1]]) - points
    headings = np.arctan2(ways[:, 1], ways[:, 0])
    before = np.concatenate([headings[-1:], headings[:-1]])
    turns = (headings - before + math.pi) % math.tau - math.pi
    return points, turns


def edges_of(standing: shapely.Polygon) -> list[Edge]:
    """Of the outer ring, counter-clockwise. A ring without corners has one edge, which begins where
    it bends most to the left."""
    points, turns = _directions(shapely.geometry.polygon.orient(standing).exterior)
    corners = np.flatnonzero((turns > BEND_RAD[0]) | (turns < -BEND_RAD[1]))
    if len(corners) == 0:
        corners = np.array([int(np.argmax(turns))])
    edges = []
    for k, first in enumerate(corners):
        last = corners[(k + 1) % len(corners)]
        count = (last - first - 1) % len(points) + 2
        chain = tuple(
            (float(x), float(y)) for x, y in points[(first + np.arange(count)) % len(points)]
        )
        edges.append(Edge(chain, bool(turns[first] > 0 and turns[last] > 0)))
    return edges


def inner_corners(standing: shapely.Polygon) -> Points:
    """Those of the outer ring that no machine follows, and every corner of the holes."""
    oriented = shapely.geometry.polygon.orient(standing)
    points, turns = _directions(oriented.exterior)
    holes = (shapely.get_coordinates(ring)[:-1] for ring in oriented.interiors)
    return np.concatenate([points[turns < -BEND_RAD[1]], *holes])


def parts_of(shape: shapely.Geometry) -> list[shapely.Polygon]:
    """Its parts, the largest first, their collinear and nearly doubled points removed."""
    clean = []
    for part in sorted(_polygons(shape), key=lambda g: -g.area):
        simple = shapely.simplify(part.buffer(0), SIMPLIFY_M)
        clean.append(simple if isinstance(simple, shapely.Polygon) else part)
    return clean


def _polygons(shape: shapely.Geometry) -> list[shapely.Polygon]:
    return [g for g in getattr(shape, "geoms", [shape]) if isinstance(g, shapely.Polygon)]


def turned(shape: shapely.Geometry, heading: float) -> shapely.Geometry:
    """The shape turned so that `heading` points along x. Where its outline all but touches itself
    the turned coordinates, rounded, may cross."""
    c, s = math.cos(heading), math.sin(heading)
    found = affine_transform(shape, [c, s, -s, c, 0, 0])
    return found if found.is_valid else shapely.make_valid(found)


def corridor(line: shapely.LineString, width_m: float) -> shapely.Polygon:
    """What lies within width_m left of a line."""
    inner = line.offset_curve(width_m, join_style="mitre")
    if not isinstance(inner, shapely.LineString) or inner.is_empty:
        return shapely.Polygon()
    shape = shapely.Polygon([*line.coords, *list(inner.coords)[::-1]])
    return shape if shape.is_valid else parts_of(shape.buffer(0))[0]


@dataclass(frozen=True)
class Strip:
    """What one pass along an edge takes off. Lengths are metres along the edge, from the crop's
    first tip."""

    area: shapely.Polygon
    begin: Point
    """On the edge (prolonged), abreast of the crop's first tip."""
    length_m: float
    width_m: float
    narrow_m: float
    """By how much it is narrower than a pass, so that an inner corner begins where it ends."""
    bends: tuple[tuple[float, float], ...]
    """(where, how far to the left in rad) the edge bends."""
    fence_m: float
    back_m: float
    blind_end: bool
    begins_m: tuple[float, ...]
    ends_m: tuple[float, ...]
    """How far inside the first and the last tip the crop of each of SEEN_ROWS rows begins and ends,
    the edge's first."""


def strip_along(
    standing: shapely.Polygon, field: shapely.Polygon, edge: Edge, width_m: float
) -> Strip | None:
    """The strip along an edge of what stands; None for a sliver."""
    depths = edge.depths_of(inner_corners(standing))
    depth = float(depths[depths > MIN_EDGE_M].min(initial=math.inf))
    # A strip ends exactly where an inner corner begins, so that no strip ends inside the crop.
    width = depth / math.ceil(depth / width_m - 1e-9) if depth < FAR_WIDTHS * width_m else width_m
    over_m = OVERHANG * width_m
    line = edge.prolonged(over_m)
    near = [
        g
        for g in _polygons(standing.intersection(corridor(line, width)))
        if g.distance(edge.line) < NEAR_M
    ]
    if not near:
        return None
    area = max(near, key=lambda g: g.area)
    if area.area < MIN_STRIP_M2:
        return None
    alongs = shapely.line_locate_point(line, shapely.points(area.exterior.coords))
    first, last = float(alongs.min()), float(alongs.max())
    (x, y) = line.interpolate(first).coords[0]
    reach = shapely.distance(line, shapely.points(area.exterior.coords))
    begins, ends = _rows(line, area, first, last, min(width, float(reach.max())))
    laid_along = functools.cache(lambda heading: (turned(field, heading), turned(area, heading)))
    return Strip(
        area,
        (float(x), float(y)),
        last - first,
        min(width, float(reach.max())),
        width_m - width,
        _bends(edge, over_m - first),
        last - first + _room(*laid_along(edge.end_heading), 1),
        _room(*laid_along(edge.heading), -1),
        _ends_at_hole(*laid_along(edge.end_heading)),
        begins,
        ends,
    )


def _bends(edge: Edge, begins_m: float) -> tuple[tuple[float, float], ...]:
    """Of an edge whose first corner lies begins_m along its strip."""
    bends = []
    along = begins_m
    for (ax, ay), (bx, by), (cx, cy) in zip(
        edge.points, edge.points[1:], edge.points[2:], strict=False
    ):
        along += math.hypot(bx - ax, by - ay)
        turn = math.atan2(cy - by, cx - bx) - math.atan2(by - ay, bx - ax)
        bends.append((along, math.remainder(turn, math.tau)))
    return tuple(bends)


def _room(ahead: shapely.Geometry, along: shapely.Geometry, way: int) -> float:
    """From the strip's last (way 1) or first (-1) tip on along its heading there to the field's
    boundary or a keep-out, m: on inner sides, what has been cut lies between. Field (`ahead`) and
    strip (`along`) are turned by that heading."""
    low_x, _, high_x, _ = along.bounds
    tip = high_x if way > 0 else low_x
    near = along.intersection(shapely.box(tip - AT_TIP_M, -1e6, tip + AT_TIP_M, 1e6)).bounds
    band = shapely.box(min(tip, tip + way * 1e3), near[1], max(tip, tip + way * 1e3), near[3])
    rooms = [g for g in _polygons(ahead.intersection(band)) if g.distance(along) < NEAR_M]
    ends = [g.bounds[2] if way > 0 else g.bounds[0] for g in rooms]
    return max([way * (end - tip) for end in ends], default=0.0)


def _rows(
    line: shapely.LineString, strip: shapely.Polygon, first: float, last: float, width: float
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """begins_m and ends_m."""
    lefts = np.linspace(NEAR_M, width - NEAR_M, SEEN_ROWS)
    rows = shapely.intersection(strip, shapely.offset_curve(line, lefts, join_style="mitre"))
    points, row = shapely.get_coordinates(rows, return_index=True)
    alongs = shapely.line_locate_point(line, shapely.points(points))
    begins, ends = np.full(SEEN_ROWS, first), np.full(SEEN_ROWS, first)
    present, at = np.unique(row, return_index=True)
    if present.size:
        begins[present] = np.minimum.reduceat(alongs, at)
        ends[present] = np.maximum.reduceat(alongs, at)
    return tuple((begins - first).tolist()), tuple((last - ends).tolist())


def _ends_at_hole(ahead: shapely.Geometry, along: shapely.Geometry) -> bool:
    """Whether a strip ends at a keep-out. Field and strip as for `_room`."""
    if not ahead.interiors:
        return False
    _, _, end, _ = along.bounds
    near = along.intersection(shapely.box(end - AT_TIP_M, -1e6, end + AT_TIP_M, 1e6)).bounds
    last = shapely.LineString([(end, near[1] + MIN_EDGE_M), (end, near[3] - MIN_EDGE_M)])
    return any(ring.distance(last) < NEAR_M for ring in ahead.interiors)
