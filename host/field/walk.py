"""A walk around a field as a receiver recorded it: cleaned, and the closed loops found in it.

Pure geometry in metres. A walk goes to the field, around it once or several times, around what
stands in it, and home again; only the loops matter.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from host.core.errors import UserError
from host.core.frames import LocalFrame
from host.core.messages import Fix
from host.sensors.nmea import Receiver

Points = NDArray[np.float64]
"""(n, 2), metres, field frame."""

JUMP_M = 3.0
"""Further than its own speed takes it, a position does not go from one fix to the next."""
WALKING_MPS = 2.0
"""Taken for the speed where the receiver does not say it."""
STANDING_MPS = 0.3
"""A course means nothing at a lower speed."""
PAUSE_S = 3.0
"""What was walked while the receiver was silent for longer is not known: it counts as a jump."""
MOST_TORN = 0.2
"""Share of steps that may be jumps where the receiver speaks less often than that."""
SPIKE_FIXES = 10
"""A jump that another one undoes within so many fixes was a spike."""
POOR_HDOP = 5.0
"""Horizontal dilution of precision above which a fix is dropped: its error may be 10 m."""
STEP_M = 0.5
"""Loops are looked for among points at least so far apart."""
MAX_POINTS = 4000
"""Among which loops are looked for: every pair is compared, so that time grows with the square."""
MIN_COMPACT = 0.05
"""Area over that of a circle of the same length: a way there and back is below."""
KEEP_OUT_COMPACT = 0.3
"""A keep-out's loop is rounder than a boundary's may be: a walk there and back is none."""
KEEP_OUT_M2 = 3.0
"""Smaller loops are a receiver's wandering while the walker stands."""
KEEP_OUT_AROUND_M = 8.0
"""Shorter loops are a walker's turning on the spot."""
SAME_SCORE = 0.8
"""Share of the best loop's score above which another counts as a lap of the same field."""
AS_GOOD = 0.97
"""Share of the best later lap's score that a lap must reach to be taken instead of it."""
SAME_PLACE = 0.6
"""Laps of one field overlap at least so much (intersection over union)."""
GAP_PRICE = 3.0
"""What is not walked counts so many times its length, or cutting corners would pay."""


@dataclass(frozen=True)
class Track:
    """What is left of a walk: positions in order, with jumps between some of them."""

    frame: LocalFrame
    xy: Points
    jumps_m: NDArray[np.float64]
    """(n,): the jump that leads to each point; 0 where it was walked."""
    rejected: Points = field(default_factory=lambda: np.empty((0, 2)))
    dropped: Counter[str] = field(default_factory=Counter)
    """Fixes left out, by reason."""
    stamps: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    """(n,), seconds."""
    velocities: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 2)))
    """(n, 2), m/s, by the receiver's speed and course over ground; NaN where it said none."""

    @property
    def length_m(self) -> float:
        """The way walked, jumps left out."""
        steps = np.hypot(*np.diff(self.xy, axis=0).T)
        return float(steps[self.jumps_m[1:] == 0].sum())


def read_fixes(lines: Iterable[bytes], receiver: Receiver) -> list[Fix]:
    """Fixes of a recorded stream, stamped with the seconds of their own time of day; the receiver
    counts what is good and bad in it. The day may change once."""
    fixes: list[Fix] = []
    now = 0.0
    for line in lines:
        found = re.search(rb"\$..(?:GGA|RMC),(\d\d)(\d\d)(\d\d(?:\.\d+)?),", line)
        if found:
            hours, minutes, seconds = map(float, found.groups())
            time = 3600 * hours + 60 * minutes + seconds
            now = time + 86400 * (time < now - 43200)
        fixes += receiver.feed(now, line)
    return fixes + receiver.flush()


def track_of(fixes: Iterable[Fix]) -> Track | None:
    """Leaves out what has no position, a poor one, or is a spike; marks the jumps that stay. None
    where nothing is left; UserError where the receiver spoke so seldom that a walk is jumps.
    """
    dropped: Counter[str] = Counter()
    good: list[Fix] = []
    for fix in fixes:
        if fix.quality == 0:
            dropped["without a fix"] += 1
        elif fix.hdop > POOR_HDOP:
            dropped[f"HDOP above {POOR_HDOP:g}"] += 1
        else:
            good.append(fix)
    if not good:
        return None
    frame = LocalFrame(good[0].lat_deg, good[0].lon_deg)
    xy = np.array([frame.to_local(fix.lat_deg, fix.lon_deg) for fix in good])
    apart_s = float(np.median(np.diff([fix.stamp for fix in good]))) if len(good) > 1 else 0.0
    torn = sum(_jumps(good, xy, k - 1, k) for k in range(1, len(good)))
    if apart_s > PAUSE_S and torn > MOST_TORN * len(good):
        raise UserError(
            f"its positions are {apart_s:.0f} s apart, and the way between them is not known; set "
            "the app to one a second and walk again"
        )
    kept, jumps = [0], [0.0]
    spikes: list[int] = []
    k = 1
    while k < len(good):
        last = kept[-1]
        if not _jumps(good, xy, last, k):
            kept.append(k)
            jumps.append(0.0)
            k += 1
            continue
        ahead = range(k + 1, min(k + 1 + SPIKE_FIXES, len(good)))
        back = next(
            (
                j
                for j in ahead
                if _jumps(good, xy, j - 1, j)
                and not _jumps(good, xy, last, j, SPIKE_FIXES + PAUSE_S)
            ),
            None,
        )
        if back is None:
            kept.append(k)
            jumps.append(math.dist(xy[last], xy[k]))
            k += 1
        else:
            spikes += range(k, back)
            kept.append(back)
            jumps.append(0.0)
            k = back + 1
    if spikes:
        dropped["spike"] += len(spikes)
    stamps = np.array([fix.stamp for fix in good])[kept]
    velocities = np.array([_velocity(fix) for fix in good])[kept]
    return Track(frame, xy[kept], np.array(jumps), xy[spikes], dropped, stamps, velocities)


def _velocity(fix: Fix) -> tuple[float, float]:
    """East and north (m/s). Who stands needs no course."""
    if fix.speed_mps is None:
        return math.nan, math.nan
    if fix.course_rad is None:
        return (0.0, 0.0) if fix.speed_mps < STANDING_MPS else (math.nan, math.nan)
    return fix.speed_mps * math.cos(fix.course_rad), fix.speed_mps * math.sin(fix.course_rad)


def _jumps(fixes: list[Fix], xy: Points, a: int, b: int, pause_s: float = PAUSE_S) -> bool:
    speeds = [s for fix in (fixes[a], fixes[b]) if (s := fix.speed_mps) is not None]
    seconds = max(0.0, fixes[b].stamp - fixes[a].stamp)
    reach = max(speeds, default=WALKING_MPS) * min(seconds, pause_s)
    return math.dist(xy[a], xy[b]) > reach + JUMP_M


# ---- loops ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Loop:
    """Points first..last of a track, closed by the gap between the two."""

    first: int
    last: int
    xy: Points
    """(n, 2), counter-clockwise, not closed."""
    gap_m: float
    jumps_m: float
    begin: Points
    """(2,): where the walker began it."""

    @property
    def polygon(self) -> shapely.Geometry:
        """What it encloses, valid even where the track crosses itself."""
        return shapely.Polygon(self.xy).buffer(0)


@dataclass(frozen=True)
class Loops:
    """The laps around the field, the loops inside it, and how many others were left aside."""

    laps: list[Loop]
    keep_outs: list[Loop]
    others: int


@dataclass(frozen=True)
class _Candidates:
    """Pairs of points of a thinned track that come near each other."""

    index: NDArray[np.intp]
    """Of the thinned points in the track."""
    pairs: NDArray[np.intp]
    """(m, 2) into `index`, earlier first."""
    area: NDArray[np.float64]
    around: NDArray[np.float64]
    """Length with gap and jumps at their price."""
    walked: NDArray[np.float64]

    @property
    def compact(self) -> NDArray[np.float64]:
        """1 for a circle, about 0 for a way there and back."""
        found: NDArray[np.float64] = 4 * math.pi * self.area / np.maximum(self.around, 1e-9) ** 2
        return found

    @property
    def score(self) -> NDArray[np.float64]:
        """Grows with the area; going around twice or including the way there lowers it."""
        found: NDArray[np.float64] = self.area**1.5 / np.maximum(self.around, 1e-9) ** 2
        return found


def _candidates(track: Track, close_m: float) -> _Candidates:
    xy, jumps = track.xy, track.jumps_m
    steps = np.hypot(*np.diff(xy, axis=0).T)
    step_m = max(STEP_M, float(steps.sum()) / MAX_POINTS)
    kept = [0]
    for k in range(1, len(xy)):
        if jumps[k] > 0 or math.dist(xy[kept[-1]], xy[k]) >= step_m:
            kept.append(k)
    index = np.array(kept)
    points = xy[index]
    jumped = np.cumsum(jumps)[index]
    pairs = np.sort(cKDTree(points).query_pairs(close_m, output_type="ndarray"), axis=1)
    i, j = pairs[:, 0], pairs[:, 1]
    cross = points[:-1, 0] * points[1:, 1] - points[:-1, 1] * points[1:, 0]
    swept = np.concatenate([[0.0], np.cumsum(cross)])
    closing = points[j, 0] * points[i, 1] - points[j, 1] * points[i, 0]
    path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    gap = np.hypot(*(points[j] - points[i]).T)
    unwalked = jumped[j] - jumped[i]
    walked = path[j] - path[i] - unwalked
    around = walked + GAP_PRICE * (gap + unwalked)
    area = np.abs(swept[j] - swept[i] + closing) / 2
    whole = 3 * GAP_PRICE * (gap + unwalked) < around
    return _Candidates(index, pairs[whole], area[whole], around[whole], walked[whole])


def _loop(track: Track, first: int, last: int) -> Loop:
    xy = track.xy[first : last + 1]
    # The sign of the area, not LinearRing.is_ccw: that is undefined where a ring crosses itself.
    x, y = (xy - xy[0]).T
    ccw = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) > 0
    gap = float(math.dist(xy[0], xy[-1]))
    jumps = float(track.jumps_m[first + 1 : last + 1].sum())
    return Loop(first, last, xy if ccw else xy[::-1], gap, jumps, xy[0])


def _best(found: _Candidates, ok: NDArray[np.bool_]) -> int | None:
    if not ok.any():
        return None
    return int(np.where(ok, found.score, -1.0).argmax())


def find_loops(track: Track, close_m: float) -> Loops | None:
    """The laps around the largest compact loop, then smaller loops inside it. Ends that come
    within close_m of each other close a loop. None where there is no loop."""
    if len(track.xy) < 4:
        return None
    found = _candidates(track, close_m)
    if not len(found.pairs):
        return None
    first, last = found.index[found.pairs].T
    ok = found.compact > MIN_COMPACT
    best = _best(found, ok)
    if best is None:
        return None
    field_ = _loop(track, int(first[best]), int(last[best])).polygon
    similar = ok & (found.score > SAME_SCORE * found.score[best])
    laps, others = [], 0
    begin = 0
    while (later := similar & (first >= begin)).any():
        # Ending earliest gives the most laps; a little later may close better.
        soonest = int(np.where(later, last, len(track.xy)).argmin())
        later &= last <= last[soonest] + (last[soonest] - first[soonest]) // 8
        later &= found.score >= AS_GOOD * found.score[later].max()
        lap = int(np.where(later, last, len(track.xy)).argmin())
        loop = _loop(track, int(first[lap]), int(last[lap]))
        shape = loop.polygon
        if shape.intersection(field_).area > SAME_PLACE * shape.union(field_).area:
            laps.append(loop)
        else:
            others += 1
        begin = loop.last
    if not laps:  # each of them overlaps too little with the best, which does with itself
        laps = [_loop(track, int(first[best]), int(last[best]))]
    spans = [(loop.first, loop.last) for loop in laps]
    keep_outs: list[Loop] = []
    small = (
        (found.compact > KEEP_OUT_COMPACT)
        & (found.area > KEEP_OUT_M2)
        & (found.area < field_.area / 2)
        & (found.walked > KEEP_OUT_AROUND_M)
    )
    while True:
        for a, b in spans:
            small &= (last <= a) | (first >= b)
        k = _best(found, small)
        if k is None:
            break
        loop = _loop(track, int(first[k]), int(last[k]))
        spans = [(loop.first, loop.last)]
        if loop.polygon.within(field_):
            keep_outs += [] if _seen(loop, keep_outs) else [loop]
        else:
            others += 1
    return Loops(laps, keep_outs, others)


def _seen(loop: Loop, others: list[Loop]) -> bool:
    return any(loop.polygon.intersects(other.polygon) for other in others)


def pieces(track: Track) -> Iterator[Points]:
    """The track between its jumps, for drawing."""
    for part in np.split(track.xy, np.flatnonzero(track.jumps_m > 0)):
        if len(part):
            yield part
