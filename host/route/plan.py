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
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np
import shapely

from host.core.errors import UserError
from host.core.vehicle import Vehicle
from host.field.corners import steerable, was_recorded
from host.route.boundary_edges import BoundaryEdges
from host.route.cuts import Cuts
from host.route.side import BENT_RAD, NO_EDGE, Side
from host.route.standing import (
    MIN_EDGE_M,
    MIN_STRIP_M2,
    NEAR_M,
    Edge,
    Point,
    edge_goes_on,
)
from host.route.turn_legs import shuttle_length, shuttle_room_m

Result = TypeVar("Result")
Tell = Callable[[int, int], None]
"""Is told how many strips have been laid out, and how many it will be at most or little more."""
MAX_SIDES = 4000
MAX_WALKED = 6000
"""Sides after which no further way to cut a field is tried,"""
WAYS_SHARE = 1 / 3
"""and the share of them after which none of WAYS is tried that is not yet."""
USUAL_POINTS = 500
"""Corners of field and keep-outs; of more, each strip takes longer, and so much fewer are tried."""
APART_M2 = 25.0
"""A part that the field falls into, or that no turn leads to, is worth a harvest of its own from
this size on."""
LARGE_M2, LEFT_SHARE = 1000.0, 0.005
"""Of a field larger than that, remains that differ by less than this share are alike."""
STRAIGHT_RAD = 0.02
SAME_RAD = 1e-3
KEEP_OUT_M = 0.75
"""How far the strips stay away from a keep-out: its margin and the position's uncertainty."""
WAYS = ("onward", "shuttle", "rounds")
"""What is preferred where there is a choice: the next edge, the same one again while an inner
corner lies inside it, or what brings all edges to the keep-outs together."""
SEARCH_SHARE = 0.01
"""Of a field: where the best of the ways leaves more, others than these are looked for."""
ARC_RAD = math.radians(45.0)
"""What turns by less on the way is taken for one edge, by pictures too."""
CLOSES_M = 1.0
"""Between a side's end and the beginning of the first, for the round to close there."""
REACH = 2.75
"""Widths from a side's end within which the next must begin, to be reached by a turn."""


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
    parts: tuple[tuple[tuple[float, float], ...], ...] = ()
    """Outlines of what the field falls into on the way and no turn leads to: fields of their own,
    to be harvested after this one."""
    done: int = 0
    """Sides of the whole plan that were cut before; `sides` are those that are left."""
    sigma_m: float = 0.0
    """Standard deviation of each corner's place against the others, along x and along y."""
    recorded: bool = False
    """Whether the boundary was recorded point by point: the edge may bend between its corners."""
    gathered: int = 0
    """How many of the last sides gather what the others have left."""
    before: tuple[int, ...] = ()
    """The boundary's edges of the sides that were cut before."""
    begins_inside: int = NO_EDGE
    """The point of the boundary at which the whole plan's first side begins in standing crop: the
    edge goes on there, and no corner shows where it is. The crop behind the machine is cut when the
    first round comes back to it. NO_EDGE where it begins at a corner."""
    way: str = "onward"
    """Which of WAYS the field is cut in,"""
    otherwise: tuple[int, ...] = ()
    """but after so many strips of it the other edge is taken than that way prefers."""

    @property
    def area_m2(self) -> float:
        """Of the field, its keep-outs with it."""
        return float(shapely.Polygon(self.boundary).area)

    @property
    def unreached_m2(self) -> float:
        """What stays standing once all sides are cut, its `parts` with it."""
        return self.leftover_m2 + sum(float(shapely.Polygon(part).area) for part in self.parts)

    def name(self, index: int) -> str:
        """Which side of the whole plan `sides[index]` is, in words that count from 1."""
        number = self.done + index + 1
        return f"side {number} of {self.done + len(self.sides)}" if self.sides else f"side {number}"

    def cut_along(self, count: int) -> tuple[int, ...]:
        """The boundary's edges of all that is cut once `count` of `sides` are."""
        return (*self.before, *(side.edge for side in self.sides[:count]))

    @property
    def begins_along(self) -> tuple[float, float]:
        """(rad, 1/m): how far left of its first side the edge runs where that begins in standing
        crop, and how the edge bends on: a circle through three of the boundary's points. 0 where it
        begins at a corner, or was begun in an earlier run."""
        ring, at = self.boundary, self.begins_inside
        begun = [(side.x_m, side.y_m) for side in self.sides[:1]]
        if at == NO_EDGE or not begun or math.dist(ring[at], begun[0]) > NEAR_M:
            return 0.0, 0.0
        (ax, ay), (bx, by), (cx, cy) = ring[at - 1], ring[at], ring[(at + 1) % len(ring)]
        turn = math.remainder(math.atan2(cy - by, cx - bx) - math.atan2(by - ay, bx - ax), math.tau)
        on_m = math.hypot(cx - bx, cy - by)
        both_m = on_m + math.hypot(bx - ax, by - ay)
        return -turn * on_m / both_m, 2 * turn / both_m

    def goes_round(self, side: Side) -> bool:
        """Whether the border at which a side ends goes on from its edge, to the left by less than
        ARC_RAD: a picture shows both as one edge."""
        headings = BoundaryEdges(self.boundary).headings
        border, edge = side.ends_at, side.edges[-1] if side.edges else NO_EDGE
        if border == NO_EDGE and edge != NO_EDGE and len(headings):
            border = (edge + 1) % len(headings)
        if border == NO_EDGE or not len(headings):
            return False
        turn_rad = math.remainder(float(headings[border]) - side.end_heading_rad, math.tau)
        return 0.0 < turn_rad < ARC_RAD

    def closes(self, side: Side) -> bool:
        """Whether a side ends where the first one was begun in standing crop: at no border."""
        begun, ended = self.sides[0], side.pose(side.length_m)[:2]
        inside = self.begins_inside != NO_EDGE and side.ends_at == NO_EDGE
        return inside and math.dist((begun.x_m, begun.y_m), ended) < CLOSES_M

    def corner_rad(self, index: int) -> float:
        """The left turn from side `index` to the next; 0 where the same edge is taken again."""
        if index + 1 >= len(self.sides):
            return math.pi / 2
        this, following = self.sides[index], self.sides[index + 1]
        if following.takes_again(this):
            return 0.0
        return (following.heading_rad - this.end_heading_rad) % math.tau


class _Rank(NamedTuple):
    """Of a way to cut a field: the lowest is the best."""

    left: int
    """What stays, its parts with it, in units of what is alike."""
    cramped: int
    """Shuttles that lack room."""
    ahead: int
    """Edges by which it begins after the corner that was asked for."""
    sides: int


class _Begun(NamedTuple):
    """A way that was tried: begun so many edges ahead, with the choices that were made otherwise
    than it prefers, by the strips before each."""

    rank: _Rank
    ahead: int
    way: str
    otherwise: frozenset[int]


def _follow(edges: list[Edge], past: Edge, x: float, y: float) -> Edge | None:
    """The edge beside `past` that passes nearest to a point. Straight ones stay parallel; of a bent
    one the cutting may have taken the first piece."""
    askew = BENT_RAD if past.bent else STRAIGHT_RAD
    same = [
        e
        for e in edges
        if abs(math.remainder(e.heading - past.heading, math.tau)) < askew
        and e.line.length > MIN_EDGE_M
    ]
    if len(same) < 2:
        return same[0] if same else None
    point = shapely.points(x, y)
    return min(same, key=lambda e: float(e.line.distance(point)))


class _Rounds:
    """How many strips each edge gives in a round, so that all edges of a convex field reach the
    keep-outs inside together and every strip's ends stay open ground. A far edge gives more, by
    shuttles."""

    def __init__(
        self, holes: list[shapely.Polygon], width_m: float, fits: Callable[[float], bool]
    ) -> None:
        self._places = np.concatenate([shapely.get_coordinates(hole.exterior) for hole in holes])
        self._fits = fits
        self._width = width_m
        self._left = 0
        """Rounds; 0 while the field is not convex yet."""
        self._strips = 0
        """That the present edge still gives."""
        self._heading = math.nan
        self._turned = 0.0

    def _need(self, edge: Edge) -> int:
        """Strips from an edge to the nearest keep-out."""
        near = float(edge.depths_of(self._places).min())
        return max(0, math.ceil((near - MIN_EDGE_M) / self._width))

    def arrive(self, edge: Edge, edges: list[Edge]) -> bool:
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

    def again(self, edges: list[Edge], back_m: float) -> bool:
        """Whether the next strip is to be taken off the same edge, whose crop begins back_m from
        the boundary. Without the room for a shuttle there, later rounds take more."""
        if self._left == 0:
            return any(not e.open_ends for e in edges)
        return self._strips > 0 and self._fits(back_m)


def _walk(
    field: shapely.Polygon,
    first: int,
    width_m: float,
    shuttle: bool,
    rounds: _Rounds | None,
    names: BoundaryEdges,
    cut: Sequence[int],
    known: Cuts,
    otherwise: frozenset[int] = frozenset(),
    inside: tuple[float, float] | None = None,
    cut_to: Sequence[int] = (),
) -> Generator[list[Side], None, tuple[list[Side], list[shapely.Polygon], float]]:
    """Sides from the edge that leaves corner `first`, the parts that the field falls into on the
    way and that no turn leads to, and what no side reaches, m². With `shuttle` an edge is taken
    again and again while an inner corner lies inside it, otherwise the next edge is preferred;
    `rounds` says what is preferred where keep-outs lie inside. The first sides are along those
    edges of the boundary that `cut` names, and end along those that `cut_to` does; no sides where
    they cannot be. After the strips that `otherwise` counts, the other edge is preferred. `inside`:
    the place at which the first side begins in standing crop. Yields after each strip the sides so
    far: as much work as is done at a time."""
    standing = field
    dropped_m2 = 0.0
    name = names.namer()
    apart: list[shapely.Polygon] = []
    edges = known.edges(standing, inside)
    edge: Edge | None = edges[first % len(edges)]
    if cut_to and (as_cut := _as_cut(edges, cut[0], cut_to[0], names)) is not None:
        edges, edge = as_cut
    sides: list[Side] = []
    idle = 0
    while edge is not None and len(sides) < MAX_SIDES and idle < len(edges):
        if rounds is not None and not rounds.arrive(edge, edges):
            break
        following = edges[(edges.index(edge) + 1) % len(edges)]
        # Where the first side began in standing crop, what follows may be no more than its end.
        anyhow = rounds is not None or inside is not None
        here = following.begin
        begins_inside = inside is not None and not sides
        done = known.cut(standing, edge, inside=begins_inside) if edge.open_ends else None
        idle += 1
        if done is not None:
            side, parts = done
            # Straight on from a curve a strip ends far beyond its edge.
            here = side.pose(side.length_m)[:2]
            # Of what the strip has parted, the machine goes on with what it stands at.
            if len(parts) > 1:
                ends = shapely.MultiPoint([following.begin, here, edge.begin])
                parts = sorted(parts, key=lambda part: part.distance(ends) > REACH * width_m)
            standing = parts[0] if parts else shapely.Polygon()
            apart += [part for part in parts[1:] if part.area > APART_M2]
            dropped_m2 += sum(part.area for part in parts[1:] if part.area <= APART_M2)
            named = name(side)
            if begins_inside:
                named = replace(named, begins_at=NO_EDGE)
            elif inside is not None and math.dist(here, inside) < width_m:
                # Where the first side has begun, no border is met.
                named = replace(named, ends_at=NO_EDGE)
            sides.append(named)
            idle = 0
        yield sides
        if standing.area < MIN_STRIP_M2:
            break
        edges = known.edges(standing, here)
        if done is not None and rounds is not None:
            repeat = rounds.again(edges, done[0].back_m)
        else:
            repeat = done is not None and shuttle and any(not e.open_ends for e in edges)
        if len(sides) < len(cut):
            wanted, to = cut[len(sides)], cut_to[len(sides)] if cut_to else NO_EDGE
            choices: list[Edge | None] = [e for e in edges if _edge_of(e, names) == wanted]
            if (as_cut := _as_cut(edges, wanted, to, names)) is not None:
                edges, choices = as_cut[0], [as_cut[1]]
        else:
            choices = [
                _onward(edges, edge, following, here, width_m, anyhow),
                _again(edges, edge, width_m),
            ]
            if repeat is not (len(sides) in otherwise):
                choices.reverse()
        edge = next((e for e in choices if e is not None and e.open_ends), None)
    if len(sides) < len(cut):
        return [], [], field.area
    if standing.area > APART_M2:
        return sides, [*apart, standing], dropped_m2
    return sides, apart, standing.area + dropped_m2


def _onward(
    edges: list[Edge],
    edge: Edge,
    following: Edge,
    here: tuple[float, float],
    width_m: float,
    anyhow: bool,
) -> Edge | None:
    """What has become of the edge `following` the one that a strip was taken off, which has ended
    `here`, or with `anyhow`, or where one of the two is bent, the one after it; None where a turn
    does not lead to it."""
    onward = _follow(edges, following, *here)
    if onward is not None and onward.apart_m(here) <= REACH * width_m:
        return onward
    if not (anyhow or edge.bent or following.bent):
        return None
    near = [e for e in edges if e.apart_m(here) <= REACH * width_m]
    left = [e for e in near if SAME_RAD < (e.heading - edge.end_heading) % math.tau < math.pi]
    return min(left, key=lambda e: e.apart_m(here), default=None)


def _again(edges: list[Edge], edge: Edge, width_m: float) -> Edge | None:
    """What has become of the edge that a strip was taken off."""
    again = _follow(edges, edge, *edge.begin)
    if again is not None and again.bent:
        beside_m = again.line.distance(shapely.points(*edge.begin))
        return again if beside_m <= REACH * width_m else None
    return again


def _as_cut(
    edges: list[Edge], first: int, last: int, names: BoundaryEdges
) -> tuple[list[Edge], Edge] | None:
    """The edges around what stands, divided so that one of them, the second that is returned, is
    what a strip was cut along from the boundary's edge `first` to `last`; None where they do not
    come along these, or where that is not known. An arc has no corners: where it is divided changes
    as the boundary is found, and where a strip was cut does not."""
    if NO_EDGE in (first, last):
        return None
    pieces = [
        (edge, k, _along(piece, names))
        for edge in edges
        for k, piece in enumerate(itertools.pairwise(edge.points))
    ]
    count = len(names.corners)
    off = [(name - first) % count if name != NO_EDGE else count for _, _, name in pieces]
    along = [each <= (last - first) % count for each in off]
    begins = [k for k in range(len(pieces)) if along[k] and not along[k - 1]]
    if not begins:
        return None
    # What lay straight ahead of the strip before may have gone with it.
    begin = min(begins, key=lambda k: off[k])
    pieces = [*pieces[begin:], *pieces[:begin]]
    end = [*along[begin:], *along[:begin]].index(False)
    if end == len(pieces[0][0].points) - 1 and len({edge for edge, _, _ in pieces[:end]}) == 1:
        return edges, pieces[0][0]
    whole = [
        replace(edge, points=points, sharp=(edge.sharp[0] and opens, edge.sharp[1] and closes))
        for edge, points, opens, closes in _runs(pieces[end:])
    ]
    cut = list(_runs(pieces[:end]))
    (one, begun, opens, _), (other, _, _, closes) = cut[0], cut[-1]
    chain = list(begun)
    for _, points, _, _ in cut[1:]:
        chain += points if points[0] != chain[-1] else points[1:]
    found = replace(
        one,
        points=tuple(chain),
        open_ends=all(edge.open_ends for edge, _, _, _ in cut),
        sharp=(one.sharp[0] and opens, other.sharp[1] and closes),
    )
    return [found, *whole], found


def _runs(
    pieces: Sequence[tuple[Edge, int, int]],
) -> Generator[tuple[Edge, tuple[Point, ...], bool, bool], None, None]:
    """Of straight pieces in order, each the k-th of an edge: (the edge, the points of those of it
    that follow each other, whether they begin and end with it)."""
    for edge, run in itertools.groupby(pieces, key=lambda piece: piece[0]):
        at = [k for _, k, _ in run]
        points = edge.points[at[0] : at[-1] + 2]
        yield edge, points, at[0] == 0, at[-1] + 2 == len(edge.points)


def _along(piece: tuple[Point, Point], names: BoundaryEdges) -> int:
    """Which of the boundary's edges a straight piece lies along."""
    (ax, ay), (bx, by) = piece
    return names.beside((ax + bx) / 2, (ay + by) / 2, math.atan2(by - ay, bx - ax))


def _edge_of(edge: Edge, names: BoundaryEdges) -> int:
    """Which of the boundary's edges an edge of what stands lies along."""
    return _along((edge.points[0], edge.points[1]), names)


def most_strips(
    boundary: Sequence[tuple[float, float]], keep_outs: Sequence[Sequence[tuple[float, float]]]
) -> int:
    """Sides after which no further way to cut a field is tried."""
    points = len(boundary) + sum(map(len, keep_outs))
    return math.ceil(MAX_WALKED / max(1.0, points / USUAL_POINTS))


def spiral(
    boundary: list[tuple[float, float]],
    start: int,
    vehicle: Vehicle,
    turn: str = "three_point",
    gap_m: float | None = None,
    keep_outs: list[list[tuple[float, float]]] | None = None,
    sigma_m: float = 0.0,
    tell: Tell | None = None,
    recorded: bool | None = None,
) -> Plan:
    """The sides of a simple boundary (corners in metres, either orientation), beginning with the
    side that leaves corner `start`, or the next that can be begun with. Of the ways to cut the
    field it is one that leaves least standing, then one whose shuttles have room. UserError where
    the boundary's sides cross. sigma_m: how surely its corners are known (`Plan.sigma_m`); of one
    that was recorded point by point those are left that the machine can tell apart. `recorded`:
    what was said of that (`host.field.corners.was_recorded`)."""
    recorded = was_recorded(boundary, recorded)
    boundary, start = steerable(boundary, start, sigma_m, recorded)
    blank = Plan((), turn, gap_m=gap_m, sigma_m=sigma_m, recorded=recorded)
    steps = strip_by_strip(boundary, start, vehicle, blank, keep_outs or [])
    most = most_strips(boundary, keep_outs or [])
    strips = 0
    while True:
        try:
            next(steps)
        except StopIteration as whole:
            plan: Plan = whole.value
            return plan
        strips += 1
        if tell is not None:
            tell(strips, most)


def strip_by_strip(
    boundary: list[tuple[float, float]],
    start: int,
    vehicle: Vehicle,
    like: Plan,
    keep_outs: Sequence[Sequence[tuple[float, float]]],
    cut: Sequence[int] = (),
    cut_to: Sequence[int] = (),
) -> Generator[list[Side], None, Plan]:
    """`spiral`, which yields after each strip the sides so far of the first way that is tried, of
    the others none, and returns the plan. Turn, gap, and how the boundary is known are those of
    `like`, whose way is tried first. `cut`: the boundary's edges, by the corner that each leaves,
    along which the first strips have been cut already; UserError where these cannot have been.
    `cut_to`: those along which they have ended, where that is known."""
    width_m, gap_m = vehicle.pass_m, like.gap_m
    least_m = shuttle_length(vehicle, width_m, 0.0)
    ring = shapely.geometry.polygon.orient(shapely.Polygon(boundary))
    if not ring.is_valid or ring.area <= 0:
        raise UserError("boundary: its sides cross; walk it again or correct its corners")
    corners = list(ring.exterior.coords)[:-1]
    holes = [shapely.Polygon(k) for k in keep_outs]
    away = [hole.buffer(KEEP_OUT_M, join_style="mitre") for hole in holes]
    field = ring.difference(shapely.unary_union(away)) if holes else ring
    if not isinstance(field, shapely.Polygon):
        raise UserError("boundary: the keep-outs part the field; survey its parts as fields")
    if holes and field.area < MIN_STRIP_M2:
        raise UserError(
            f"boundary: the keep-outs, {KEEP_OUT_M:g} m around them too, leave nothing to cut; "
            "check what is marked as a keep-out"
        )
    best: tuple[_Rank, Plan] | None = None

    def fits(back_m: float) -> bool:
        return shuttle_room_m(vehicle, back_m, gap_m) >= least_m

    names = BoundaryEdges(corners)
    known = Cuts(field, width_m)
    corner = boundary[(like.begins_inside if cut else start) % len(boundary)]
    if cut:
        goes_on = like.begins_inside != NO_EDGE
    else:
        goes_on = like.recorded and edge_goes_on(field, corner)
    edges = known.edges(field, corner if goes_on else None)
    first = min(range(len(edges)), key=lambda k: math.dist(edges[k].begin, corner))
    walked, most = 0, most_strips(boundary, keep_outs)
    outs = tuple(tuple((x, y) for x, y in k.exterior.coords[:-1]) for k in holes)
    alike_m2 = LEFT_SHARE * field.area if field.area > LARGE_M2 else 0.5

    def tried(
        ahead: int, way: str, otherwise: frozenset[int]
    ) -> Generator[list[Side], None, _Rank | None]:
        """One way, which becomes the best if it is better; None where it cannot be begun."""
        nonlocal best, walked
        rounds = _Rounds(away, width_m, fits) if way == "rounds" else None
        inside = corner if goes_on and ahead == 0 else None
        steps = _walk(
            field,
            first + ahead,
            width_m,
            way == "shuttle",
            rounds,
            names,
            cut,
            known,
            otherwise,
            inside,
            cut_to,
        )
        sides, apart, left_m2 = yield from (steps if best is None else _quietly(steps))
        if cut and not sides:
            return None
        cramped = sum(b.takes_again(a) and not fits(b.back_m) for a, b in itertools.pairwise(sides))
        all_m2 = left_m2 + sum(part.area for part in apart)
        rank = _Rank(max(0, round(all_m2 / alike_m2)), cramped, ahead, len(sides))
        if best is None or rank < best[0]:
            parts = tuple(tuple((x, y) for x, y in p.exterior.coords[:-1]) for p in apart)
            plan = Plan(tuple(sides), like.turn, tuple(corners), gap_m, outs, left_m2, parts)
            order = tuple(sorted(otherwise))
            plan = replace(plan, sigma_m=like.sigma_m, recorded=like.recorded)
            at = NO_EDGE if inside is None else corners.index(inside)
            plan = replace(plan, begins_inside=at)
            best = rank, replace(plan, way=way, otherwise=order)
        walked += len(sides)
        return rank

    ways = [(way, frozenset[int]()) for way in (WAYS if away else WAYS[:2])]
    was = like.way, frozenset(like.otherwise)
    begun: list[_Begun] = []
    for ahead, (way, otherwise) in itertools.product(
        range(len(edges)), [was, *(each for each in ways if each != was)]
    ):
        edge = edges[(first + ahead) % len(edges)]
        if not edge.open_ends or (cut and _edge_of(edge, names) != cut[0]):
            continue
        rank = yield from tried(ahead, way, otherwise)
        if rank is not None and not otherwise:
            begun.append(_Begun(rank, ahead, way, otherwise))
        if (best is not None and best[0][:3] == (0, 0, 0)) or walked > WAYS_SHARE * most:
            break
    # A way is a rule for all its strips. Often one choice of it is wrong, early on.
    enough = SEARCH_SHARE * field.area / alike_m2
    while begun and not cut:
        better: list[_Begun] = []
        for one in sorted(begun, key=lambda each: each.rank):
            found = []
            for k in range(1, one.rank.sides + 1):
                if best is None or best[0].left <= enough or walked > most:
                    break
                otherwise = one.otherwise ^ {k}
                rank = yield from tried(one.ahead, one.way, otherwise)
                if rank is not None and rank.left < one.rank.left:
                    found.append(_Begun(rank, one.ahead, one.way, otherwise))
            better += [min(found, key=lambda each: each.rank)] if found else []
        begun = better
    if best is None or not best[1].sides:
        why = "the strips that were cut do not fit it" if cut else "split the field"
        raise UserError(
            f"boundary: along no side of it a strip can be cut that ends on open ground; {why}"
        )
    return best[1]


def _quietly(steps: Generator[list[Side], None, Result]) -> Generator[list[Side], None, Result]:
    """The same steps, which show no sides."""
    while True:
        try:
            next(steps)
        except StopIteration as stop:
            found: Result = stop.value
            return found
        yield []
