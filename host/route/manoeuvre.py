"""A way to a lane from wherever the machine stands, to and fro, within the geofence: for a turn
that cannot be driven as it was planned.

A search over short arcs on the lock, on half of it and straight on, forward and back (hybrid A*:
Dolgov et al., "Practical search techniques in path planning for autonomous driving", 2008). From
each place two arcs on the lock that lead onto the lane are tried, which have a closed form.

Frame of the lane: x along it, y left, both m; what the lane's crop begins at is given along it.
"""

from __future__ import annotations

import heapq
import itertools
import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray

from host.core.compiled import compiled
from host.core.frames import Pose2
from host.core.vehicle import Vehicle
from host.field import sweep
from host.field.areas import outline_of
from host.route.turn_legs import Follow, Goal, Leg, turning_radius

Array = NDArray[np.float64]
_Ground = tuple[Array, Array, Array, int, Array]
"""The machine's outline, the sides and margins of the room, how many of these are kept, and an
outline's places for use."""

STEP_M: Final = 0.25
"""Of a piece of way: 16 degrees on the lock, during which a blade's end moves 0.45 m."""
CELLS: Final = (0.1, math.radians(6.0))
"""Places and directions that are taken for one, m and rad."""
AWAY_M: Final = 0.05
"""Of a way that leads away from a side: over more of it, a blade on the lock may swing there first.
"""
REACH_M: Final = 6.0
"""The search goes no farther from where the machine stands, or as far around a lane that is farther
away."""
SLOTS: Final = 1 << 16
"""For the places that were reached: more than twice as many as there can be."""
EXPANDED: Final = 2500
"""Places that are searched at most: what takes a laptop a twentieth of a second."""
REVERSAL_M: Final = 0.5
"""What it costs to go the other way, in metres of way;"""
STEERING_M: Final = 0.2
"""to stand until the wheels are turned;"""
PRESSED: Final = 4.0
"""and to press crop down: share of the wheels that do, times the way."""
GREEDY: Final = 2.0
"""Times what the rest of the way costs at least: more finds one sooner, less a better one."""
SHORT_M: Final = (0.9, 4.0)
"""Of the lane's crop, behind whose beginning there may be no room for the whole machine, so much
may stay; and where there is no such way, rather than all of the strip."""
RUN_IN_M: Final = 0.3
"""From the blade to the crop, where a strip is begun: the camera is to see where that begins."""
ON_M: Final = 2.0
"""That must be free straight on along the lane, where the way is to lead past something."""
MOST_RAD: Final = math.radians(200.0)
"""That the last two arcs turn in all."""


class Lane(NamedTuple):
    """What the way leads to, in the lane's frame, and what stands there."""

    ends_m: float
    """The rear axle comes to the lane at most so far along it: behind the crop's beginning."""
    crop_m: float
    """Along the lane, where its crop begins."""
    border: tuple[float, float]
    """(y, rad) of the old side's swath: its left border at x = 0, and the lane's direction against
    it. Left of that, and from the new lane's right border on, crop stands."""
    past_m: float = -math.inf
    """The rear axle comes to the lane at least so far along it: past what stands beside it. Then
    the way leads on from there, and not back to the crop's beginning."""
    from_m: float = -math.inf
    """The rear axle comes to the lane at least so far along it: from elsewhere, near the crop."""


@dataclass(frozen=True)
class Room:
    """Where the machine may go, in the frame of the lane."""

    sides: Array
    """(m, 4), of the permitted area and the keep-outs."""
    margins: Array
    """(k, m), m: how far off each of them to keep; and less and less, where the machine stands too
    near to one already."""
    kept: int = 1
    """Of the margins so many may be driven within. Where a machine can keep only a later one, the
    geofence lets it do nothing but lead away from the nearest side: each step of its way does."""


def way(
    vehicle: Vehicle, start: Pose2, lane: Lane, room: Room, short_m: float = SHORT_M[0]
) -> tuple[Leg, ...] | None:
    """The legs that lead from `start` onto the lane, no more than `short_m` past where its crop
    begins; None where none was found. Headings and places along the lane count from the lane's."""
    radius, lock = turning_radius(vehicle)
    hull = shapely.convex_hull(shapely.MultiPoint(outline_of(vehicle)))
    outline = shapely.get_coordinates(hull)[:-1]
    half = vehicle.blade_width_m / 2 - vehicle.overlap_m
    wheels = np.array(
        [(0.0, vehicle.half_width_m), (0.0, -vehicle.half_width_m), (vehicle.wheelbase_m, 0.0)]
    )
    there, found = _search(
        np.array(start), radius, outline, wheels, room.sides, room.margins, half,
        lane.ends_m, lane.crop_m, lane.border[0], lane.border[1], short_m, lane.past_m,
        lane.from_m, min(room.kept, len(room.margins)),
    )  # fmt: skip
    if not there:
        return None
    legs: list[Leg] = []
    heading = start.heading_rad
    for (curvature, sense), pieces in itertools.groupby(found.tolist(), lambda p: (p[0], p[1])):
        length = sum(piece[2] for piece in pieces)
        if curvature == 0.0:
            legs.append(Leg(0.0, sense < 0.0, Goal.WAY, length))
            continue
        heading += curvature * sense * length
        steer = math.copysign(lock, curvature)
        if abs(curvature) * radius < 0.99:
            steer = math.atan(vehicle.wheelbase_m * curvature)
        legs.append(Leg(steer, sense < 0.0, Goal.HEADING, heading))
    if math.isinf(lane.past_m):
        legs.append(Leg(0.0, True, Goal.ALONG, lane.ends_m, Follow.NEW_LANE))
    return tuple(legs)


@njit(cache=True, nogil=True)
def _place(at: Array, outline: Array, placed: Array) -> None:
    """An outline (n, 2) of the vehicle frame at (x, y, heading), into `placed`."""
    c, s = math.cos(at[2]), math.sin(at[2])
    for i in range(len(outline)):
        placed[i, 0] = at[0] + c * outline[i, 0] - s * outline[i, 1]
        placed[i, 1] = at[1] + s * outline[i, 0] + c * outline[i, 1]


@njit(cache=True, nogil=True)
def _free(at: Array, outline: Array, sides: Array, margins: Array, placed: Array) -> bool:
    """Whether the machine may be at (x, y, heading), where its outline (n, 2) is off each side by
    its margin: from within the room nothing leads out of it. `placed` is for use."""
    _place(at, outline, placed)
    n = len(outline)
    for k in range(len(sides)):
        ax, ay, bx, by = sides[k]
        long = math.hypot(bx - ax, by - ay)
        if long == 0.0:
            continue
        ux, uy = (bx - ax) / long, (by - ay) / long
        # A box of the outline along and beside the side that is clear of it saves the distances.
        low, high, least, most = math.inf, -math.inf, math.inf, -math.inf
        for i in range(n):
            x, y = placed[i, 0] - ax, placed[i, 1] - ay
            along, beside = x * ux + y * uy, y * ux - x * uy
            low, high = min(low, along), max(high, along)
            least, most = min(least, beside), max(most, beside)
        margin = margins[k]
        if high < -margin or low > long + margin or least > margin or most < -margin:
            continue
        for i in range(n):
            j = (i + 1) % n
            if _crosses_within(
                placed[i, 0], placed[i, 1], placed[j, 0], placed[j, 1], ax, ay, bx, by, margin
            ):
                return False
    return True


@njit(cache=True, nogil=True)
def _crosses_within(
    px: float, py: float, qx: float, qy: float, ax: float, ay: float, bx: float, by: float,
    margin: float,
) -> bool:  # fmt: skip
    """Whether two pieces of lines cross or come nearer than that, m."""
    d1 = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
    d2 = (bx - ax) * (qy - ay) - (by - ay) * (qx - ax)
    d3 = (qx - px) * (ay - py) - (qy - py) * (ax - px)
    d4 = (qx - px) * (by - py) - (qy - py) * (bx - px)
    if d1 * d2 < 0.0 and d3 * d4 < 0.0:
        return True
    nearest = min(sweep.apart(px, py, ax, ay, bx, by), sweep.apart(qx, qy, ax, ay, bx, by))
    nearest = min(nearest, sweep.apart(ax, ay, px, py, qx, qy))
    nearest = min(nearest, sweep.apart(bx, by, px, py, qx, qy))
    return nearest < margin


@njit(cache=True, nogil=True)
def _nearness(
    at: Array, outline: Array, sides: Array, margins: Array, most: int, points: Array
) -> int:
    """The first of the margins that is free there, or `most`."""
    for k in range(most):
        if _free(at, outline, sides, margins[k], points):
            return k
    return most


@njit(cache=True, nogil=True)
def _on(at: Array, curvature: float, way_m: float, to: Array) -> None:
    """Where a way of so long leads, negative: in reverse."""
    turned = curvature * way_m
    if curvature == 0.0:
        to[0] = at[0] + way_m * math.cos(at[2])
        to[1] = at[1] + way_m * math.sin(at[2])
    else:
        to[0] = at[0] + (math.sin(at[2] + turned) - math.sin(at[2])) / curvature
        to[1] = at[1] - (math.cos(at[2] + turned) - math.cos(at[2])) / curvature
    to[2] = at[2] + turned


@njit(cache=True, nogil=True)
def _pressed(
    at: Array, wheels: Array, half: float, crop: float, border_y: float, border_rad: float
) -> float:
    """Share of the wheels that stand in crop."""
    c, s = math.cos(at[2]), math.sin(at[2])
    count = 0.0
    for k in range(len(wheels)):
        x = at[0] + c * wheels[k, 0] - s * wheels[k, 1]
        y = at[1] + s * wheels[k, 0] + c * wheels[k, 1]
        beside = math.sin(border_rad) * x + math.cos(border_rad) * y
        if x > crop and y > -half and beside > border_y:
            count += 1.0 / len(wheels)
    return count


@njit(cache=True, nogil=True)
def _piece(
    at: Array, curvature: float, way_m: float, near: int, ground: _Ground, between: Array
) -> bool:
    """Whether a piece of way is free from a place where the margins from `near` on are kept;
    `between` ends where it does."""
    outline, sides, margins, kept, points = ground
    count = max(1, math.ceil(abs(way_m) / (0.6 * STEP_M)))
    close = near >= kept and not _free(at, outline, sides, margins[kept - 1], points)
    clear = _clear_m(at, ground) if close else 0.0
    if close:
        count = max(count, math.ceil(abs(way_m) / AWAY_M))
    for k in range(count):
        _on(at, curvature, way_m * (k + 1) / count, between)
        if not _free(between, outline, sides, margins[near], points):
            return False
        if close and not _free(between, outline, sides, margins[kept - 1], points):
            before, clear = clear, _clear_m(between, ground)
            if clear <= before:
                return False
        elif close:
            close, near = False, kept - 1
    return True


@njit(cache=True, nogil=True)
def _clear_m(at: Array, ground: _Ground) -> float:
    """How far the machine, where it is free, is from the nearest of the sides that a margin is to
    be kept off."""
    outline, sides, margins, _, points = ground
    _place(at, outline, points)
    rings = np.zeros(len(sides), np.int64)
    for k in range(len(sides)):
        rings[k] = 1 if margins[0, k] == 0.0 else 0
    found = np.empty(2)
    sweep.gaps(sides, rings, points, found)
    return float(found[0])


@njit(cache=True, nogil=True)
def _arcs(at: Array, radius: float, which: int) -> tuple[float, float, float]:
    """Two arcs on the lock that lead onto the lane, of four solutions: the side that the first one
    bends to, 1 for the left, -1 for the right, and the ways along both, m, negative in reverse; NaN
    where there are none. The second bends to the other side."""
    heading = math.atan2(math.sin(at[2]), math.cos(at[2]))
    side = 1.0 if which % 2 == 0 else -1.0
    # The first changes y by side r (cos heading - cos between), the second by side r (1 - cos
    # between), and together they undo y.
    cosine = 0.5 * (math.cos(heading) + 1.0 + side * at[1] / radius)
    if abs(cosine) > 1.0:
        return side, math.nan, math.nan
    between = math.acos(cosine) * (1.0 if which < 2 else -1.0)
    if abs(between - heading) + abs(between) > MOST_RAD:
        return side, math.nan, math.nan
    return side, side * radius * (between - heading), side * radius * between


@njit(cache=True, nogil=True)
def _slot(reached: NDArray[np.int64], place: int) -> int:
    """Where a place is kept, or is to be, among those that were reached; -1 is none."""
    slot = (place * 2654435761) % SLOTS
    while reached[slot] >= 0 and reached[slot] != place:
        slot = (slot + 1) % SLOTS
    return slot


@compiled(
    "(f8[::1], f8, f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], "
    "f8, f8, f8, f8, f8, f8, f8, f8, i8)"
)
def _search(
    start: Array, radius: float, outline: Array, wheels: Array, sides: Array, margins: Array,
    half: float, ends: float, crop: float, border_y: float, border_rad: float, short: float,
    past: float, nearest: float, kept: int,
) -> tuple[bool, Array]:  # fmt: skip
    """Whether there is a way; (n, 3): curvature, 1/m, sense of the way and its length, m, one row a
    piece. When as many places have been searched as may be, it is the best of those found."""
    cell, turn = CELLS
    reach = max(REACH_M, REACH_M / 2 + math.hypot(start[0] - ends, start[1]))
    across = int(2 * reach / cell) + 1
    round_ = round(2 * math.pi / turn)
    reached = np.full(SLOTS, np.int64(-1))
    best = np.empty(SLOTS, np.float32)
    most = 10 * EXPANDED + 1
    places = np.empty((most, 3))
    before = np.empty(most, np.int64)
    cost = np.empty(most)
    done = np.empty((most, 2))  # the piece that led there: curvature, way
    near = np.zeros(most, np.int64)  # which of the margins is free there: no more than before
    goal = np.empty((most, 4))  # of a place on the lane: both arcs' curvatures and ways
    count = 1
    places[0], before[0], cost[0], done[0] = start, -1, 0.0, np.zeros(2)
    heap = [(0.0, 0, False)]
    points = np.empty((len(outline), 2))
    ground = outline, sides, margins, kept, points
    at, to, between = np.empty(3), np.empty(3), np.empty(3)
    near[0] = _nearness(start, outline, sides, margins, len(margins), points)
    if near[0] == len(margins):
        return False, np.empty((0, 3))
    passes = past > -math.inf
    while passes and past < start[0] + REACH_M:
        at[:] = past, 0.0, 0.0
        if _free(at, outline, sides, margins[near[0]], points) and _piece(
            at, 0.0, ON_M, near[0], ground, between
        ):
            break
        past += STEP_M
    expanded, end, cheapest = 0, -1, -1
    while len(heap) > 0 and expanded < EXPANDED:
        _, here, arrives = heapq.heappop(heap)
        if arrives:
            end = here
            break
        at[:] = places[here]
        expanded += 1
        last, last_way = done[here]
        around = near[here]
        # Onto the lane from here.
        for which in range(4):
            side, first, second = _arcs(at, radius, which)
            if not math.isfinite(first):
                continue
            k = side / radius
            _on(at, k, first, to)
            _on(to, -k, second, between)
            if between[0] < past or between[0] < nearest:
                continue
            beyond = 0.0 if passes else max(0.0, between[0] - ends)
            more = abs(first) + abs(second) + beyond + 2 * STEERING_M
            more += REVERSAL_M * ((first * last_way < 0.0) + (first * second < 0.0))
            more += REVERSAL_M * (second > 0.0 and beyond > 0.0)
            if not _piece(at, k, first, around, ground, between):
                continue
            to[:] = between
            if not _piece(to, -k, second, around, ground, between):
                continue
            more += PRESSED * abs(second) * _pressed(to, wheels, half, crop, border_y, border_rad)
            to[:] = between
            if passes and not _piece(to, 0.0, ON_M, around, ground, between):
                continue
            back = beyond
            while back > 0.0 and not _piece(to, 0.0, -back, around, ground, between):
                back = max(0.0, back - 0.5 * STEP_M)
            if beyond - back > short:
                continue
            more += PRESSED * (beyond - back)
            if count < most:
                places[count], before[count], cost[count] = at, here, cost[here] + more
                goal[count, 0], goal[count, 1] = k, first
                goal[count, 2], goal[count, 3] = -k, second
                heapq.heappush(heap, (cost[count], count, True))
                if cheapest < 0 or cost[count] < cost[cheapest]:
                    cheapest = count
                count += 1
        for steer in range(5):
            k = (steer - 2) / (2 * radius)
            for sense in (-1.0, 1.0):
                way_m = sense * STEP_M
                if k == last and way_m * last_way < 0.0:
                    continue
                if not _piece(at, k, way_m, around, ground, to):
                    continue
                i = math.floor((to[0] - start[0] + reach) / cell)
                j = math.floor((to[1] - start[1] + reach) / cell)
                if i < 0 or j < 0 or i >= across or j >= across:
                    continue
                m = math.floor(to[2] / turn) % round_
                g = cost[here] + STEP_M + STEERING_M * (k != last)
                g += REVERSAL_M * (way_m * last_way < 0.0)
                g += PRESSED * STEP_M * _pressed(to, wheels, half, crop, border_y, border_rad)
                slot = _slot(reached, (i * across + j) * round_ + m)
                if (reached[slot] >= 0 and g >= best[slot]) or count >= most:
                    continue
                reached[slot], best[slot] = (i * across + j) * round_ + m, g
                places[count], before[count], cost[count] = to, here, g
                done[count, 0], done[count, 1] = k, way_m
                near[count] = _nearness(to, outline, sides, margins, near[here], points)
                askew = abs(math.atan2(math.sin(to[2]), math.cos(to[2])))
                along = past - to[0] if passes else max(to[0] - ends, nearest - to[0])
                left = max(abs(to[1]), radius * askew, along)
                heapq.heappush(heap, (g + GREEDY * left, count, False))
                count += 1
    if end < 0:
        end = cheapest
    if end < 0:
        return False, np.empty((0, 3))
    pieces = [(goal[end, 2], goal[end, 3]), (goal[end, 0], goal[end, 1])]
    here = before[end]
    while before[here] >= 0:
        pieces.append((done[here, 0], done[here, 1]))
        here = before[here]
    found = np.empty((len(pieces), 3))
    rows = 0
    for n in range(len(pieces) - 1, -1, -1):
        k, way_m = pieces[n]
        if abs(way_m) > 1e-3:
            found[rows, 0], found[rows, 1] = k, math.copysign(1.0, way_m)
            found[rows, 2] = abs(way_m)
            rows += 1
    return True, found[:rows]
