"""What still stands of a field, the edges of it that can be followed, and the strip along one of
them.

An edge is a chain of straight pieces between two corners. Where it bends by no more than the
steering follows in passing, the chain goes on: a field as farm programs export it has edges of many
such bends, and only its corners are worth a turn. A corner may be rounded: what counts is how far
an edge turns within SPAN_M. An edge that turns further in all than TURN_RAD is divided where it
turns most, so a field without any corner has some all the same.
"""

from __future__ import annotations

import functools
import itertools
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

BEND_RAD: Final = (math.radians(35.0), math.radians(45.0))
"""Largest change of an edge's direction, to the left and to the right, that is followed in passing.
At a bend to the left the blade leaves the crop until the steering has followed, at one to the
right it leaves a wedge beside the lane; 1.5 m ahead of the axle, it moves 60 deg askew of the
machine on the lock. A corner to the left costs a turn, one to the right many shuttles, hence the
two values."""
SPAN_M: Final = 3.0
"""Way within which that change counts, two of a machine's lengths from axle to blade: bends that
follow each other sooner are one to it. An edge that bends on a radius of more than 5 m is followed;
driven on one of 4 m, the machine lost its edge. With 22 degrees, which is 8 m, it turned in such
bends, where nothing ends: it stood 1 to 2 m beside the next lane, and often found no room."""
ROUNDED_RAD: Final = math.radians(60.0)
"""Most that an edge may lose to the rounded corner at one of its ends."""
ROUNDED_M: Final = 8.0
"""So far before its edge a strip may begin at a rounded corner."""
TURN_RAD: Final = math.radians(200.0)
"""Most that one edge turns to the left in all. Less: where nothing ends the machine turns, and an
arc's turns and tips are where it loses its place. A strip all around the field would end where it
began, and nobody could get from there to the next: that stands on all sides."""
PEAK_M: Final = 10.0
"""Way over which an edge is asked where it turns most."""
MIN_WIDTH_M: Final = 0.05
"""A strip that is nowhere wider was cut by the blade's overlap."""
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
OVERHANG: Final = (4.0, 40.0)
"""Widths of a strip that it may reach beyond its edge: at a sharp corner, which slants over 2.5 of
them at most, and where a gentle curve is divided: on a radius of r widths crop goes on straight
ahead for the root of 2 r."""
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
    sharp: tuple[bool, bool] = (True, True)
    """Whether it begins and ends at a sharp corner: what stands then ends soon beyond it."""

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

    def prolonged(self, back_m: float, on_m: float) -> shapely.LineString:
        """The chain, straight on by back_m before its beginning and on_m beyond its end."""
        (ax, ay), (bx, by) = self.points[0], self.points[-1]
        back, on = self.heading + math.pi, self.end_heading
        first = (ax + back_m * math.cos(back), ay + back_m * math.sin(back))
        last = (bx + on_m * math.cos(on), by + on_m * math.sin(on))
        return _line([first, *self.points, last])

    def apart_m(self, here: Point) -> float:
        """How far a place lies from where a strip along it may begin."""
        if self.sharp[0]:
            return math.dist(self.begin, here)
        back = self.heading + math.pi
        (x, y) = self.begin
        tip = (x + ROUNDED_M * math.cos(back), y + ROUNDED_M * math.sin(back))
        return float(shapely.LineString([tip, self.begin]).distance(shapely.Point(here)))

    def depths_of(self, places: Points) -> NDArray[np.float64]:
        """(n,) how far left of the prolonged chain places (n, 2) lie, m; negative right of it."""
        line = self.prolonged(1e4, 1e4)
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


@dataclass(frozen=True)
class _Ring:
    """A ring, counter-clockwise, and how it turns."""

    points: Points
    turns: NDArray[np.float64]
    """(n,) how far it turns left at each point, rad."""
    along: NDArray[np.float64]
    """(n + 1,) way around to each point, m; the last is the whole way."""

    @staticmethod
    def of(ring: shapely.LinearRing) -> _Ring:
        """Of a ring that is oriented already; points that are one count once."""
        points = np.array(shapely.remove_repeated_points(ring, DOUBLED_M).coords)[:-1]
        ways = np.roll(points, -1, axis=0) - points
        headings = np.arctan2(ways[:, 1], ways[:, 0])
        turns = (headings - np.roll(headings, 1) + math.pi) % math.tau - math.pi
        return _Ring(points, turns, np.concatenate([[0.0], np.cumsum(np.hypot(*ways.T))]))

    def within(self, span_m: float) -> NDArray[np.float64]:
        """(n,) how far the ring turns left in all within half of span_m before and after each
        point, rad."""
        around = float(self.along[-1])
        half = min(span_m, 0.999 * around) / 2
        at = np.concatenate([self.along[:-1] + lap * around for lap in (-1, 0, 1)])
        total = np.concatenate([[0.0], np.cumsum(np.tile(self.turns, 3))])
        here = self.along[:-1]
        first = np.searchsorted(at, here - half, side="left")
        last = np.searchsorted(at, here + half, side="right")
        found: NDArray[np.float64] = total[last] - total[first]
        return found

    @functools.cached_property
    def sharp(self) -> NDArray[np.bool_]:
        """(n,) where a single point turns by more than a machine follows in passing."""
        return np.asarray((self.turns > BEND_RAD[0]) | (self.turns < -BEND_RAD[1]))

    @functools.cached_property
    def tight(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Where bends that are none each turn so far within SPAN_M, (n,) to the left, to the
        right."""
        count, around = len(self.points), float(self.along[-1])
        span = min(SPAN_M, 0.999 * around)
        here, laps = self.along[:-1], (-around, 0.0, around)
        at = np.concatenate([here + lap for lap in laps])
        # An arc is recorded as pieces: what it turns at a point it has turned by the middles of the
        # pieces beside, where these are short.
        half = np.minimum(np.diff(self.along), span) / 2
        from_m, to_m = here - np.roll(half, 1), here + half
        turns = np.where(self.sharp, 0.0, self.turns)
        steps = np.column_stack([np.zeros(count), turns]).ravel()
        ramps = np.column_stack([from_m, to_m]).ravel()
        knots = np.concatenate([ramps + lap for lap in laps])
        total = np.cumsum(np.tile(steps, 3))
        begin = np.concatenate([from_m, here, here - span, to_m - span])
        turned = np.interp(begin + span, knots, total) - np.interp(begin, knots, total)
        first = np.searchsorted(at, begin, side="left")
        behind = np.searchsorted(at, begin + span, side="right")
        found = []
        for far in (turned > BEND_RAD[0], turned < -BEND_RAD[1]):
            marks = np.zeros(3 * count + 1, np.int64)
            np.add.at(marks, first[far], 1)
            np.add.at(marks, behind[far], -1)
            inside = np.cumsum(marks)[:-1].reshape(3, count).any(0)
            found.append(inside & ~self.sharp)
        return found[0], found[1]

    @functools.cached_property
    def corners(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(points at which it turns to the left by more than a machine follows in passing, those at
        which it turns so to the right). Of the points of a rounded corner it is the middle one."""
        left, right = (self._middles(tight) for tight in self.tight)
        return (
            np.union1d(np.flatnonzero(self.sharp & (self.turns > 0.0)), left),
            np.union1d(np.flatnonzero(self.sharp & (self.turns < 0.0)), right),
        )

    def _middles(self, tight: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Of each run of points that `tight` marks, without a sharp one beside it, the point at
        which half of its turn is done; none where they go on all around."""
        count = len(tight)
        apart = np.diff(self.along) > SPAN_M
        ends = np.flatnonzero(~(tight & np.roll(tight, -1)) | apart)
        if ends.size == 0:
            return np.zeros(0, np.int64)
        order = (np.arange(count) + ends[0] + 1) % count
        found = []
        for run in np.split(order, (ends[1:] - ends[0]).tolist()):
            if tight[run[0]] and not self._beside_sharp(run):
                half = np.cumsum(self.turns[run])
                found.append(run[int(np.argmax(np.abs(half) >= abs(half[-1]) / 2))])
        return np.array(found, np.int64)

    def _beside_sharp(self, run: NDArray[np.int64]) -> bool:
        """Whether a sharp corner lies within SPAN_M of a run's ends, next to it."""
        count, around = len(self.points), float(self.along[-1])
        for end, other in ((run[0], (run[0] - 1) % count), (run[-1], (run[-1] + 1) % count)):
            apart = abs(self.along[end] - self.along[other])
            if self.sharp[other] and min(apart, around - apart) <= SPAN_M:
                return True
        return False

    def trimmed(self, chain: NDArray[np.int64]) -> NDArray[np.int64]:
        """The points of an edge without the tight bends of the rounded corners at its ends: along
        these the machine goes straight on."""
        first = self._rounded(chain)
        last = len(chain) - self._rounded(chain[::-1])
        return chain[first:last] if last - first > 1 else chain

    def _rounded(self, chain: NDArray[np.int64]) -> int:
        """How many of its first points belong to a rounded corner, but for the last of these."""
        around, left = float(self.along[-1]), self.tight[0]
        turned = 0.0
        for k, (one, following) in enumerate(itertools.pairwise(chain)):
            apart = abs(self.along[one] - self.along[following])
            if not left[following] or min(apart, around - apart) > SPAN_M:
                return k
            turned += float(self.turns[following])
            if turned > ROUNDED_RAD:
                return 0
        return 0

    def beside(self, here: Point, reach_m: float) -> list[int]:
        """The point that turns to the left and lies nearest to `here`, if within reach_m."""
        apart = np.where(self.turns > 0.0, np.hypot(*(self.points - here).T), math.inf)
        nearest = int(np.argmin(apart))
        return [nearest] if apart[nearest] <= reach_m else []

    def divided(self, corners: list[int]) -> NDArray[np.int64]:
        """The corners, and those that divide what turns to the left by more than TURN_RAD between
        two of them. A ring without any begins where it turns most."""
        count, peak = len(self.points), self.within(PEAK_M)
        found = sorted(set(corners)) or [int(np.argmax(np.round(peak, 3)))]
        k = 0
        while k < len(found):
            length = (found[(k + 1) % len(found)] - found[k] - 1) % count + 1
            inner = (found[k] + np.arange(1, length)) % count
            turned = np.cumsum(self.turns[inner])
            whole = float(turned[-1]) if turned.size else 0.0
            # Either part is to have its share, whatever turns most.
            off = np.abs(turned - whole / 2)
            may = (self.turns[inner] > 0.0) & (off <= whole / 4)
            if whole > TURN_RAD and may.any():
                most = np.round(np.where(may, peak[inner], -math.inf), 3)
                found.insert(k + 1, int(inner[np.lexsort((off, -most))[0]]))
            else:
                k += 1
        return np.array(found, np.int64)


@functools.lru_cache(maxsize=4)
def _outer(standing: shapely.Polygon) -> _Ring:
    """The outer ring. Of what stands first the edges are asked for, and then, along one of them,
    the inner corners."""
    return _Ring.of(shapely.geometry.polygon.orient(standing).exterior)


def edges_of(
    standing: shapely.Polygon, here: Point | None = None, reach_m: float = 0.0
) -> list[Edge]:
    """Of the outer ring, counter-clockwise. Where the machine stands an edge begins, however little
    the ring turns there: at what is nearest to `here`, if within reach_m."""
    ring = _outer(standing)
    lefts, rights = ring.corners
    corners = ring.divided(
        [*lefts, *rights, *(ring.beside(here, reach_m) if here else [])]
    ).tolist()
    inner, edges = set(rights.tolist()), []
    for k, first in enumerate(corners):
        last = corners[(k + 1) % len(corners)]
        count = (last - first - 1) % len(ring.points) + 2
        chain = ring.trimmed((first + np.arange(count)) % len(ring.points))
        places = tuple((x, y) for x, y in ring.points[chain].tolist())
        sharp = ring.sharp[chain[0]], ring.sharp[chain[-1]]
        open_ends = first not in inner and last not in inner
        edges.append(Edge(places, open_ends, (bool(sharp[0]), bool(sharp[1]))))
    return edges


def edge_goes_on(standing: shapely.Polygon, place: Point) -> bool:
    """Whether the outer ring turns so little to the left, at its point nearest to a place, that a
    machine follows it in passing: no corner, at which an edge begins."""
    ring = _outer(standing)
    at = int(np.argmin(np.hypot(*(ring.points - place).T)))
    lefts, rights = ring.corners
    return bool(ring.turns[at] > 0.0) and at not in lefts and at not in rights


def inner_corners(standing: shapely.Polygon) -> Points:
    """Those of the outer ring that no machine follows, and every corner of the holes."""
    ring, oriented = _outer(standing), shapely.geometry.polygon.orient(standing)
    holes = (shapely.get_coordinates(hole)[:-1] for hole in oriented.interiors)
    return np.concatenate([ring.points[ring.corners[1]], *holes])


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
    standing: shapely.Polygon,
    field: shapely.Polygon,
    edge: Edge,
    width_m: float,
    *,
    inside: bool = False,
) -> Strip | None:
    """The strip along an edge of what stands; None for a sliver. `inside`: it begins abreast of the
    edge's first point, however far what stands goes back from there."""
    depths = edge.depths_of(inner_corners(standing))
    depth = float(depths[depths > MIN_EDGE_M].min(initial=math.inf))
    # A strip ends exactly where an inner corner begins, so that no strip ends inside the crop.
    width = depth / math.ceil(depth / width_m - 1e-9) if depth < FAR_WIDTHS * width_m else width_m
    over_m = [OVERHANG[0 if sharp else 1] * width_m for sharp in edge.sharp]
    if inside:
        over_m[0] = 0.0
    line = edge.prolonged(*over_m)
    near = [
        g
        for g in _polygons(standing.intersection(corridor(line, width)))
        if g.distance(edge.line) < NEAR_M
    ]
    if not near:
        return None
    area = max(near, key=lambda g: g.area)
    reach_m = float(shapely.distance(line, shapely.points(shapely.get_coordinates(area))).max())
    if area.area < MIN_STRIP_M2 or reach_m < MIN_WIDTH_M:
        return None
    alongs = shapely.line_locate_point(line, shapely.points(area.exterior.coords))
    first, last = float(alongs.min()), float(alongs.max())
    (x, y) = line.interpolate(first).coords[0]
    begins, ends = _rows(line, area, first, last, min(width, reach_m))
    laid_along = functools.cache(lambda heading: (turned(field, heading), turned(area, heading)))
    return Strip(
        area,
        (float(x), float(y)),
        last - first,
        min(width, reach_m),
        width_m - width,
        _bends(edge, over_m[0] - first),
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
