"""The plan of a field: the sides to cut, in order, computed before anything moves.

Paper, II and Fig. 1 (c): along the outer boundary with left turns, then inward by the blade's
width. The field is cut like paper: each side takes a strip off what still stands, along an edge
whose both ends are open ground, so the crop's edge is always in view on the right and every end
can be seen. A convex field becomes the paper's spiral. Where a reflex corner or a keep-out makes
the next edge end inside the crop, the machine shuttles: it backs along the swath and takes the
next strip of the same edge, until the corner is gone.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.affinity import affine_transform

from host.core.errors import UserError
from host.core.vehicle import Vehicle
from host.route.turn_legs import shuttle_length, shuttle_room_m

MIN_STRIP_M2 = 0.02
"""What a side would cut at least; smaller remains are nothing a camera could find."""
SEEN_SHARE = 0.22
"""Vision sees crop where it fills this share of the blade's width."""
SEEN_ROWS = 9
MAX_SIDES = 4000
SAME_RAD = 1e-3
BESIDE_RAD = math.radians(1.0)
BESIDE_WIDTHS = (0.2, 1.5)
"""Of the blade, between the lines of a side and of the one that has left its edge."""
NEAR_M = 1e-3
CONVEX_RAD = 1e-3
MIN_EDGE_M = 0.05
KEEP_OUT_M = 0.75
"""How far the strips stay away from a keep-out: its margin and the position's uncertainty."""
MAX_SHIFT_M = 0.35
"""Beyond it the edge would pass under the machine's body."""
REACH = 2.5
"""Widths from a side's end within which the next must begin, to be reached by a turn."""


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

    @property
    def line(self) -> tuple[float, float]:
        """Where the edge begins, along the side's direction from the field's origin, and how far
        left of that origin it runs."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        return c * self.x_m + s * self.y_m, c * self.y_m - s * self.x_m

    def left_by(self, past: Side, blade_width_m: float) -> bool:
        """Whether cutting `past` has left this side's edge."""
        turned = abs(math.remainder(self.heading_rad - past.heading_rad, math.tau))
        apart = (self.line[1] - past.line[1]) / blade_width_m
        return turned < BESIDE_RAD and BESIDE_WIDTHS[0] < apart < BESIDE_WIDTHS[1]


@dataclass(frozen=True, slots=True)
class Plan:
    """The passes in order; empty when no boundary is known: then only vision ends anything and
    every corner is taken for a right angle. `turn` names the manoeuvre between sides."""

    sides: tuple[Side, ...] = ()
    turn: str = "three_point"
    boundary: tuple[tuple[float, float], ...] = ()
    """Corners of the crop's outer edge, metres of the field frame."""
    gap_m: float | None = None
    """From the boundary to the neighbours' crop; None: unknown, no geofence."""
    keep_outs: tuple[tuple[tuple[float, float], ...], ...] = ()
    leftover_m2: float = 0.0
    """What no side of the plan reaches."""
    done: int = 0
    """Sides of the whole plan that were cut before; `sides` are those that are left."""

    def name(self, index: int) -> str:
        """Which side of the whole plan `sides[index]` is, in words that count from 1."""
        number = self.done + index + 1
        return f"side {number} of {self.done + len(self.sides)}" if self.sides else f"side {number}"

    def corner_rad(self, index: int) -> float:
        """The left turn from side `index` to the next; 0 where the same edge is taken again."""
        if index + 1 >= len(self.sides):
            return math.pi / 2
        turn = self.sides[index + 1].heading_rad - self.sides[index].heading_rad
        turn %= 2 * math.pi
        return 0.0 if min(turn, 2 * math.pi - turn) < SAME_RAD else turn


@dataclass(frozen=True, slots=True)
class _Edge:
    """An edge of what stands, with the interior angles' convexity at both ends."""

    ax: float
    ay: float
    bx: float
    by: float
    open_ends: bool

    @property
    def heading(self) -> float:
        return math.atan2(self.by - self.ay, self.bx - self.ax)

    @property
    def length(self) -> float:
        return math.hypot(self.bx - self.ax, self.by - self.ay)


def _turned(shape: shapely.Geometry, heading: float) -> shapely.Geometry:
    """The shape turned so that `heading` points along x."""
    c, s = math.cos(heading), math.sin(heading)
    return affine_transform(shape, [c, s, -s, c, 0, 0])


def _edges(standing: shapely.Polygon) -> list[_Edge]:
    """Of the outer ring, counter-clockwise."""
    ring = shapely.geometry.polygon.orient(standing).exterior
    points = list(ring.coords[:-1])
    count = len(points)

    def turn(k: int) -> float:
        (ax, ay), (bx, by), (cx, cy) = points[k - 1], points[k], points[(k + 1) % count]
        first, second = math.atan2(by - ay, bx - ax), math.atan2(cy - by, cx - bx)
        return math.remainder(second - first, 2 * math.pi)

    convex = [turn(k) > CONVEX_RAD for k in range(count)]
    return [
        _Edge(a[0], a[1], b[0], b[1], convex[k] and convex[(k + 1) % count])
        for k, (a, b) in enumerate(zip(points, points[1:] + points[:1], strict=True))
    ]


def _clean(shape: shapely.Geometry) -> shapely.Polygon:
    """The largest part, its collinear and nearly doubled points removed."""
    parts = [g for g in getattr(shape, "geoms", [shape]) if isinstance(g, shapely.Polygon)]
    if not parts:
        return shapely.Polygon()
    largest = max(parts, key=lambda g: g.area)
    simple = shapely.simplify(largest.buffer(0), 0.01)
    return simple if isinstance(simple, shapely.Polygon) else largest


def _depth_of_reflex(turned: shapely.Polygon, low: float) -> float:
    """How far inside the edge at y = low the nearest reflex corner or keep-out lies; inf."""
    best = math.inf
    oriented = shapely.geometry.polygon.orient(turned)
    for ring, hole in [(oriented.exterior, False), *((r, True) for r in oriented.interiors)]:
        points = ring.coords[:-1]
        for k, (x, y) in enumerate(points):
            (ax, ay), (cx, cy) = points[k - 1], points[(k + 1) % len(points)]
            cross = (x - ax) * (cy - y) - (y - ay) * (cx - x)
            if (hole or cross < 0) and y - low > MIN_EDGE_M:
                best = min(best, y - low)
    return best


def _cut(
    standing: shapely.Polygon, field: shapely.Polygon, edge: _Edge, width_m: float
) -> tuple[Side, shapely.Polygon, float] | None:
    """The side along an edge, what stands after it, and the area it cut; None for a sliver."""
    heading = edge.heading
    turned = _turned(standing, heading)
    line = _turned(shapely.LineString([(edge.ax, edge.ay), (edge.bx, edge.by)]), heading)
    low = (line.coords[0][1] + line.coords[-1][1]) / 2
    depth = _depth_of_reflex(turned, low)
    # A strip ends exactly where a reflex corner begins, so that no strip ends inside the crop.
    width = depth / math.ceil(depth / width_m - 1e-9) if depth < 20 * width_m else width_m
    lo_x, _, hi_x, _ = turned.bounds
    band = turned.intersection(shapely.box(lo_x, low, hi_x, low + width))
    parts = [g for g in getattr(band, "geoms", [band]) if isinstance(g, shapely.Polygon)]
    near = [g for g in parts if g.distance(line) < NEAR_M]
    if not near:
        return None
    strip = max(near, key=lambda g: g.area)
    if strip.area < MIN_STRIP_M2:
        return None
    begin, _, end, top = strip.bounds
    room = _turned(field, heading).intersection(shapely.box(begin, low, hi_x + 1e3, top))
    rooms = [g for g in getattr(room, "geoms", [room]) if g.intersects(strip)]
    fence = max(g.bounds[2] for g in rooms) - begin
    room = _turned(field, heading).intersection(shapely.box(lo_x - 1e3, low, end, top))
    rooms = [g for g in getattr(room, "geoms", [room]) if g.intersects(strip)]
    back = begin - min(g.bounds[0] for g in rooms)
    c, s = math.cos(heading), math.sin(heading)
    side = Side(
        c * begin - s * low,
        s * begin + c * low,
        heading,
        end - begin,
        min(width, top - low),
        fence,
        back,
        min(width_m - width, MAX_SHIFT_M),
        _ends_at_hole(strip, _turned(field, heading)),
        *_slants(strip),
    )
    rest = turned.difference(strip.buffer(1e-4, join_style="mitre"))
    return side, _clean(_turned(rest, -heading)), strip.area


def _slants(strip: shapely.Polygon) -> tuple[float, float, float, float]:
    """begin_seen_m to edge_end_m of a side along x."""
    begin, low, end, top = strip.bounds
    begins, ends = [], []
    for y in np.linspace(low + NEAR_M, top - NEAR_M, SEEN_ROWS):
        row = strip.intersection(shapely.LineString([(begin - 1.0, y), (end + 1.0, y)])).bounds
        begins.append(row[0] - begin)
        ends.append(end - row[2])
    seen = [float(np.quantile(row, SEEN_SHARE)) for row in (begins, ends)]
    return seen[0], seen[1], begins[0], ends[0]


def _ends_at_hole(strip: shapely.Polygon, field: shapely.Polygon) -> bool:
    """Whether a strip along x ends at a keep-out."""
    _, low, end, top = strip.bounds
    last = shapely.LineString([(end, low + MIN_EDGE_M), (end, top - MIN_EDGE_M)])
    return any(ring.distance(last) < NEAR_M for ring in field.interiors)


def _follow(edges: list[_Edge], heading: float, x: float, y: float) -> _Edge | None:
    """The edge of the given direction that passes nearest to a point."""
    same = [
        e
        for e in edges
        if abs(math.remainder(e.heading - heading, 2 * math.pi)) < 0.02 and e.length > MIN_EDGE_M
    ]
    point = shapely.Point(x, y)
    return min(
        same,
        key=lambda e: shapely.LineString([(e.ax, e.ay), (e.bx, e.by)]).distance(point),
        default=None,
    )


def _strip(side: Side) -> shapely.Polygon:
    """What a side takes off, its slanting ends filled up."""
    c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
    length, width = side.length_m, side.width_m
    corners = ((0.0, 0.0), (length, 0.0), (length, width), (0.0, width))
    return shapely.Polygon(
        [(side.x_m + c * u - s * v, side.y_m + s * u + c * v) for u, v in corners]
    )


class _Rounds:
    """How many strips each edge gives in a round, so that all edges of a convex field reach the
    keep-outs inside together and every strip's ends stay open ground. A far edge gives more, by
    shuttles."""

    def __init__(
        self, holes: list[shapely.Polygon], width_m: float, fits: Callable[[float], bool]
    ) -> None:
        self._holes = holes
        self._fits = fits
        self._width = width_m
        self._left = 0
        """Rounds; 0 while the field is not convex yet."""
        self._strips = 0
        """That the present edge still gives."""
        self._heading = math.nan
        self._turned = 0.0

    def _need(self, edge: _Edge) -> int:
        """Strips from an edge to the nearest keep-out."""
        low = float(_turned(shapely.Point(edge.ax, edge.ay), edge.heading).y)
        near = min(float(_turned(hole, edge.heading).bounds[1]) for hole in self._holes)
        return max(0, math.ceil((near - low - MIN_EDGE_M) / self._width))

    def arrive(self, edge: _Edge, edges: list[_Edge]) -> bool:
        """Before a strip is taken off an edge; False where the keep-outs are reached."""
        if self._left == 0 and all(e.open_ends for e in edges):
            self._left = min(self._need(e) for e in edges)
            self._heading, self._turned = math.nan, 0.0
        if self._left == 0:
            return True
        step = (edge.heading - self._heading) % (2 * math.pi)
        if not min(step, 2 * math.pi - step) < SAME_RAD:
            self._turned += 0.0 if math.isnan(step) else step
            if self._turned > 2 * math.pi - SAME_RAD:
                self._turned -= 2 * math.pi
                self._left = max(1, self._left - 1)
            self._heading = edge.heading
            self._strips = math.ceil(self._need(edge) / self._left)
        self._strips -= 1
        return self._strips >= 0

    def again(self, edges: list[_Edge], back_m: float) -> bool:
        """Whether the next strip is to be taken off the same edge, whose crop begins back_m from
        the boundary. Without the room for a shuttle there, later rounds take more."""
        if self._left == 0:
            return any(not e.open_ends for e in edges)
        return self._strips > 0 and self._fits(back_m)


def _walk(
    field: shapely.Polygon, first: int, width_m: float, shuttle: bool, rounds: _Rounds | None = None
) -> list[Side]:
    """Sides from the edge that leaves corner `first`. With `shuttle` an edge is taken again and
    again while a reflex corner lies inside it, otherwise the next edge is preferred; `rounds` says
    what is preferred where keep-outs lie inside."""
    standing = field
    edges = _edges(standing)
    edge: _Edge | None = edges[first % len(edges)]
    sides: list[Side] = []
    idle = 0
    while edge is not None and len(sides) < MAX_SIDES and idle < len(edges):
        if rounds is not None and not rounds.arrive(edge, edges):
            break
        following = edges[(edges.index(edge) + 1) % len(edges)]
        done = _cut(standing, field, edge, width_m) if edge.open_ends else None
        idle += 1
        if done is not None:
            side, standing, _ = done
            sides.append(side)
            idle = 0
        if standing.area < MIN_STRIP_M2:
            break
        edges = _edges(standing)
        x, y = following.ax, following.ay
        onward = _follow(edges, following.heading, x, y)
        if onward is not None and math.hypot(onward.ax - x, onward.ay - y) > REACH * width_m:
            onward = None
        if onward is None and rounds is not None:  # the next edge is used up: the one after it
            near = [e for e in edges if math.hypot(e.ax - x, e.ay - y) <= REACH * width_m]
            left = [e for e in near if SAME_RAD < (e.heading - edge.heading) % math.tau < math.pi]
            onward = min(left, key=lambda e: math.hypot(e.ax - x, e.ay - y), default=None)
        again = _follow(edges, edge.heading, edge.ax, edge.ay)
        reflex = any(not e.open_ends for e in edges)
        if done is not None and rounds is not None:
            repeat = rounds.again(edges, done[0].back_m)
        else:
            repeat = done is not None and shuttle and reflex
        choices = [again, onward] if repeat else [onward, again]
        edge = next((e for e in choices if e is not None and e.open_ends), None)
    return sides


def spiral(
    boundary: list[tuple[float, float]],
    start: int,
    vehicle: Vehicle,
    turn: str = "three_point",
    gap_m: float | None = None,
    keep_outs: list[list[tuple[float, float]]] | None = None,
) -> Plan:
    """The sides of a simple boundary (corners in metres, either orientation), beginning with the
    side that leaves corner `start`, or the next that can be begun with. Of the ways to cut the
    field it is one that leaves least standing, then one whose shuttles have room. UserError where
    the boundary's sides cross."""
    width_m = vehicle.pass_m
    least_m = shuttle_length(vehicle, width_m, 0.0)
    ring = shapely.geometry.polygon.orient(shapely.Polygon(boundary))
    if not ring.is_valid or ring.area <= 0:
        raise UserError("boundary: its sides cross; walk it again or correct its corners")
    corners = list(ring.exterior.coords)[:-1]
    holes = [shapely.Polygon(k) for k in keep_outs or []]
    away = [hole.buffer(KEEP_OUT_M, join_style="mitre") for hole in holes]
    field = ring.difference(shapely.unary_union(away)) if holes else ring
    if not isinstance(field, shapely.Polygon):
        raise UserError("boundary: the keep-outs part the field; survey its parts as fields")
    best: tuple[tuple[float, int, int, int], list[Side], float] | None = None

    def fits(back_m: float) -> bool:
        return shuttle_room_m(vehicle, back_m, gap_m) >= least_m

    edges = _edges(field)
    corner = boundary[start % len(boundary)]
    first = min(range(len(edges)), key=lambda k: math.dist((edges[k].ax, edges[k].ay), corner))
    ways = ("onward", "shuttle", "rounds") if away else ("onward", "shuttle")
    for ahead, way in itertools.product(range(len(edges)), ways):
        if not edges[(first + ahead) % len(edges)].open_ends:
            continue
        rounds = _Rounds(away, width_m, fits) if way == "rounds" else None
        sides = _walk(field, first + ahead, width_m, way == "shuttle", rounds)
        left_m2 = field.difference(shapely.union_all([_strip(s) for s in sides])).area
        cramped = sum(
            abs(b.heading_rad - a.heading_rad) < SAME_RAD and not fits(b.back_m)
            for a, b in itertools.pairwise(sides)
        )
        rank = (round(2 * left_m2) / 2, cramped, ahead, len(sides))
        if best is None or rank < best[0]:
            best = (rank, sides, left_m2)
        if rank[:3] == (0.0, 0, 0):
            break
    if best is None:
        raise UserError("boundary: no side of it has open ground at both ends; split the field")
    outs = tuple(tuple((x, y) for x, y in k.exterior.coords[:-1]) for k in holes)
    return Plan(tuple(best[1]), turn, tuple(corners), gap_m, outs, best[2])
