"""Corners of a boundary that was recorded point by point, by a walker or by a tractor.

Who walks around a corner, and what smooths the walk, round it over some metres; crop that was
drilled has it. Each rounded corner is three or four short edges, whose directions nobody knows to
ten degrees, and at whose ends no side ends: no strip that ends there shows where the next edge
lies. So it is with points that lie nearer to each other than they are known: a machine that finds
the corners as landmarks cannot tell them apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from host.field.walk import Points

Values = NDArray[np.float64]
"""(n,)."""

MAX_CORNERS: Final = 12
"""Where nobody has said it, a boundary of no more was drawn or fitted corner by corner; one of more
runs as it was recorded."""
SIMPLIFY_M: Final = 0.3
"""By which a recorded ring is left, at most: a walker strays by as much. With 0.15 m it has up to
twice the corners, and is as far from the true edge (0.2 m RMS over 17 simulated walks)."""
SIGMAS: Final = (0.5, 2.0)
"""By so many of the corners' standard deviations at most a ring is simplified, and a corner put
beyond it."""
THIN_SHARE: Final = 0.67
"""Of a ring's points that thinning leaves, from which on it was thinned before: a survey's was. To
thin it again would make corners of its arcs. Smaller: rings of other programs keep points that lie
near to each other."""
CORNER_RAD: Final = math.radians(25.0)
"""What turns by less is a bend, which the machine follows."""
MOST_RAD: Final = math.radians(150.0)
"""The edges beside a corner that turns by more meet far away, or nowhere."""
OVER_M: Final = 6.0
"""Way along the edge over which a corner may be rounded: what SMOOTH_M of the survey makes of one
(5 m), and the walker's own arc. Longer: an edge that bends becomes a polygon."""
CUT_OFF_M: Final = 0.8
"""What may lie between a corner and the rounded edge. A tractor's track with a radius of 2 m leaves
as much at a right angle, of a larger radius it leaves more: that stays round."""
EDGE_M: Final = 2.0
"""Of the edges beside a corner, at least: shorter ones do not tell their direction,"""
EDGE_SHARE: Final = 1.5
"""and so many times the way over which it is rounded: an edge that bends all along has no corner.
"""

ARC_M: Final = 6.0
"""Way before and behind what may be a corner,"""
ARC_SHARE: Final = 0.6
"""and share of all that the ring turns there and in it that a corner turns at least; beside it,
where it turns less: another corner may be near. Along an arc it is half or less: made a corner, it
lies outside of the edge, and a side ends where nothing does."""

BEND_RAD: Final = math.radians(18.0)
"""Where a thinned ring turns by more, and lies inside an arc,"""
BULGE_M: Final = 0.08
"""by so much in the mean of the pieces beside, these are halved: on a radius of 15 m what is
thinned by SIMPLIFY_M turns by 23 degrees at once, and there a plan has a corner."""
BULGE_SHARE: Final = 0.3
"""Of the bulge of an arc that turns as much as the piece does at its end where it turns less: a
straight side between two corners that is walked 0.1 m beside is no arc."""
PIECE_M: Final = 3.0
"""Shorter pieces stay."""
PLACES: Final = 9
"""Of a piece, at which the ring beside it is looked at."""


class _Rounded(NamedTuple):
    """Points of a ring that are one corner."""

    first: int
    points: int
    corner: Points
    """(2,)"""


def was_recorded(ring: Sequence[tuple[float, float]], said: bool | None) -> bool:
    """Whether a boundary was recorded point by point, as was `said` of it, or by its points."""
    return len(ring) > MAX_CORNERS if said is None else said


def steerable(
    ring: Sequence[tuple[float, float]], start: int, sigma_m: float, recorded: bool | None = None
) -> tuple[list[tuple[float, float]], int]:
    """The corners of a recorded boundary that a machine can tell apart where each is known to
    sigma_m, and which of them its point `start` is. The boundary itself where it is known exactly,
    or was drawn corner by corner. `recorded`: what was said of that (`was_recorded`)."""
    if sigma_m == 0.0 or not was_recorded(ring, recorded):
        return list(ring), start
    begun = [*ring[start:], *ring[:start]]
    by_m, cut_off_m = min(SIMPLIFY_M, SIGMAS[0] * sigma_m), min(CUT_OFF_M, SIGMAS[1] * sigma_m)
    corners = thinned(np.array(begun), by_m, cut_off_m)
    thinned_before = len(ring) > MAX_CORNERS and len(corners) > THIN_SHARE * len(ring)
    if len(corners) < 3 or thinned_before or not shapely.LinearRing(corners).is_simple:
        return list(ring), start
    nearest = int(np.hypot(*(corners - begun[0]).T).argmin())
    return [(x, y) for x, y in corners.tolist()], nearest


def thinned(ring: Points, by_m: float = SIMPLIFY_M, cut_off_m: float = CUT_OFF_M) -> Points:
    """(n, 2) of a closed ring of points: those from which it strays by no more than by_m, its
    corners sharpened. Along an arc more are left: there straying goes to one side."""
    line = shapely.LineString([*ring, ring[0]])
    corners = sharpened(shapely.get_coordinates(line.simplify(by_m))[:-1], cut_off_m)
    ways = np.roll(corners, -1, axis=0) - corners
    lengths, headings = np.hypot(*ways.T), np.arctan2(ways[:, 1], ways[:, 0])
    turns = np.remainder(headings - np.roll(headings, 1) + math.pi, math.tau) - math.pi
    at = shapely.line_locate_point(line, shapely.points(corners))
    places: list[Points] = []
    for k, corner in enumerate(corners):
        places.append(corner)
        one, other = float(turns[k]), float(turns[(k + 1) % len(corners)])
        if one * other <= 0.0 or max(abs(one), abs(other)) < BEND_RAD or lengths[k] < PIECE_M:
            continue
        on_m = (float(at[(k + 1) % len(corners)]) - float(at[k])) % line.length
        along = np.remainder(at[k] + on_m * np.linspace(0.0, 1.0, PLACES), line.length)
        beside = shapely.get_coordinates(line.interpolate(along))
        c, s = ways[k] / lengths[k]
        right_m = (beside - corner) @ (s, -c)
        # An arc's chord of length l, which turns by t from the one end to the other, bulges by
        # l t / 8 in its middle and by two thirds of that in the mean.
        of_arc_m = float(lengths[k]) * min(abs(one), abs(other)) / 12
        if math.copysign(1.0, one) * float(right_m.mean()) > max(BULGE_M, BULGE_SHARE * of_arc_m):
            places.append(beside[PLACES // 2])
    return np.array(places)


def sharpened(ring: Points, cut_off_m: float = CUT_OFF_M) -> Points:
    """(n, 2) of a closed ring of points: what rounds a corner is replaced by the place where the
    edges beside it meet, no farther than cut_off_m from there."""
    while (found := _most_rounded(ring, cut_off_m)) is not None:
        begun = np.roll(ring, -found.first, axis=0)
        fewer = np.vstack([found.corner, begun[found.points :]])
        if not shapely.LinearRing(fewer).is_simple:
            break
        ring = fewer
    return ring


def _most_rounded(ring: Points, cut_off_m: float) -> _Rounded | None:
    """The corner that is rounded by most points; of those the one that turns most."""
    ways = np.roll(ring, -1, axis=0) - ring
    lengths = np.hypot(*ways.T)
    headings = np.arctan2(ways[:, 1], ways[:, 0])
    turns = np.remainder(headings - np.roll(headings, 1) + math.pi, math.tau) - math.pi
    count, best, rank = len(ring), None, (0, 0.0)
    for first in range(count):
        turned, way_m = float(turns[first]), 0.0
        for more in range(1, count - 3):
            last = (first + more) % count
            way_m += float(lengths[last - 1])
            if way_m > OVER_M or turns[last] * turns[first] <= 0.0:
                break
            turned += float(turns[last])
            beside_m = min(lengths[first - 1], lengths[last])
            turns_enough = CORNER_RAD < abs(turned) < MOST_RAD
            if (
                not turns_enough
                or beside_m < max(EDGE_M, EDGE_SHARE * way_m)
                or (more, abs(turned)) <= rank
                or abs(turned) < ARC_SHARE * _turned_about(turns, lengths, first, more)
            ):
                continue
            corner = _meeting(ring[first], ways[first - 1], ring[last], ways[last])
            at = [(first + k) % count for k in range(more + 1)]
            if shapely.LineString(ring[at]).distance(shapely.Point(corner)) < cut_off_m:
                best, rank = _Rounded(first, more + 1, corner), (more, abs(turned))
    return best


def _turned_about(turns: Values, lengths: Values, first: int, more: int) -> float:
    """How far a ring turns, rad, the way that it turns there, at its points first to first + more
    and within ARC_M of them: twice what it does on the side where that is less."""
    count = len(turns)
    beside = []
    for end, step in ((first, -1), (first + more, 1)):
        way_m, turned = 0.0, 0.0
        for k in range(1, count - more - 1):
            at = (end + step * k) % count
            way_m += float(lengths[at if step < 0 else at - 1])
            if way_m > ARC_M:
                break
            turned += abs(float(turns[at])) if turns[at] * turns[first] > 0.0 else 0.0
        beside.append(turned)
    here = float(turns[np.arange(first, first + more + 1) % count].sum())
    return abs(here) + 2 * min(beside)


def _meeting(one: Points, its_way: Points, other: Points, others_way: Points) -> Points:
    """(2,) where two lines meet, each through a place and along a direction (2,)."""
    across = its_way[0] * others_way[1] - its_way[1] * others_way[0]
    off = other - one
    found: Points = one + its_way * ((off[0] * others_way[1] - off[1] * others_way[0]) / across)
    return found
