"""The field's boundary from a walk around it with the phone's positions.

Straight-edged fields need their corners only (paper, II): each side is a robust line through what
was walked along it, corners are where lines meet, averaged over the laps. Irregular fields keep all
of the edge, averaged and smoothed. What stands in the field (a tree, a well) is a smaller loop in
the same walk, or a walk of its own; there the hull of what was walked counts, nothing is smoothed
away.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import shapely
import shapely.affinity
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from host.core.errors import UserError
from host.core.input_file import check_input
from host.core.whole_file import saved
from host.field import gpx_file
from host.field.boundary_file import UNKNOWN_SIGMA_M, Boundary, boundary_of
from host.field.corners import MAX_CORNERS
from host.field.rings import any_edge, closing, mean_ring, resampled
from host.field.shapes import Shape, chosen
from host.field.smoothing import Smoother, relative_sigma_m, smoothable
from host.field.walk import (
    Loop,
    Loops,
    Points,
    Track,
    find_loops,
    pieces,
    read_fixes,
    track_of,
)
from host.sensors.newest import SourceLostError
from host.sensors.nmea import Receiver, gnss_feed

mpl.use("Agg")

CLOSE_M = 6.0
"""How far a phone's position drifts during a lap."""
RING_POINTS = 240
"""Of the ring that sides are fitted to, whatever the walk's length."""
MIN_SIDE = 0.03
"""A side is at least this share of the way around,"""
MIN_SIDE_M = 1.5
"""and at least so long."""
UNSURE_M = 1.0
"""Of a boundary's corners: walks with a phone leave 0.1 to 0.8 m. With more a machine neither keeps
off the neighbour's crop nor gathers what it has left (`host.pilot.context.PLACE_KNOWN`)."""
MIN_TURN_RAD = math.radians(12)
"""Lines that differ less meet nowhere in particular."""
SIDE_ENDS = 0.12
"""Share of a side at each end, where the walker rounds the corner, that its line does not see."""
DECORRELATION_M = 5.0
"""A walker's and a receiver's wobble over so much way counts as one observation."""
WOBBLE_M = 0.3
"""Nobody walks straighter, and no phone would know."""
STRAIGHT_M = 1.0
"""Where the walk leaves the straight sides by more (rms), the field is rather irregular."""
BULGE_M = 0.5
"""By so much the walk lies farther out in the middle of neighbouring sides than at their ends, or
farther in, and by more than their corners are known: what was walked is an arc. Straight-edged
fields came to 0.3 m, circles with radii of 10 to 40 m to 0.9 m and more (simulated walks with
speed and course), and"""
BULGE_SIGMAS = 5.0
"""so surely: those came to 3 standard deviations of what a walker wobbles, these to 6 and more."""
LEAST_SHARE = 0.1
"""Of a walk, that the laps around the field are: where it is less, the walk may never have closed,
and something small on the way was taken for the field. A real walk of 3.5 km with one lap of 0.8 km
has 0.23, an open one of 0.3 km 0.03."""
LEAST_WOBBLE_M = 0.1
"""Nobody is believed to have walked straighter, standard deviation."""
LINES_TOLD = 2000
"""Of a walk, after which it is told how far it is read: a tenth of a second or two."""
EDGE_POINTS = 16
"""Places along a lap whose error against each other is that of an irregular edge, but for"""
STRAYED_M = 0.2
"""how far the walker strays from it, and what smoothing and thinning leave. Of the corners of 60
simulated walks the squared error is then 0.8 times what is said, on average; 2.6 times without it.
"""
LAP_COLOURS = (4, 0, 1, 5)
"""Of matplotlib's cycle: those unlike the boundary's green and the keep-outs' red."""
HUBER = 1.345
"""Huber's constant: 95 % efficient where errors are normal (Huber, Robust Statistics, 1981)."""


@dataclass(frozen=True)
class Survey:
    """What was understood. Lengths in metres of the track's frame."""

    track: Track
    loops: Loops
    polygon: shapely.Polygon
    """The field, its holes the keep-outs."""
    corners: int | None
    """None where the field is irregular."""
    residual_m: float
    """rms distance of the walk from the boundary."""
    laps_apart_m: float
    """rms distance of the laps from their average; 0 for one lap."""
    sigma_m: float
    """Standard deviation per axis of a corner (of the edge, where the field is irregular) against
    the others; a common shift is none. By phones in general where the receiver said no velocity."""
    warnings: list[str] = field(default_factory=list)
    bulges: bool = False
    """Whether the walk surely follows arcs where the sides are straight."""

    @property
    def leaves_its_sides(self) -> bool:
        """Whether the walk leaves the straight sides, as a whole or in their middle."""
        return self.corners is not None and (self.residual_m > STRAIGHT_M or self.bulges)

    @property
    def seems_to_bend(self) -> bool:
        """Whether straight sides hardly fit: the walk leaves them, or they are as many as are
        looked for."""
        return self.leaves_its_sides or (self.corners or 0) >= MAX_CORNERS

    def boundary(self, name: str) -> Boundary:
        """As it goes into a file."""
        return boundary_of(
            self.polygon, self.track.frame, name, self.sigma_m, recorded=self.corners is None
        )


# ---- straight sides ------------------------------------------------------------------------------


def _residuals(ring: Points) -> NDArray[np.float64]:
    """(n, n + 1): the sum of squared distances of points a..b (b may run into the next round, at
    b - n) from the best line through them; infinite where b <= a."""
    n = len(ring)
    twice = np.vstack([ring, ring[:1]]) - ring.mean(0)
    x, y = twice.T
    sums = [
        np.concatenate([[0.0], np.cumsum(values)])
        for values in (np.ones(n + 1), x, y, x * x, y * y, x * y)
    ]
    a, b = np.arange(n)[:, None], np.arange(n + 1)[None, :]
    count, sx, sy, sxx, syy, sxy = (total[b + 1] - total[a] for total in sums)
    with np.errstate(divide="ignore", invalid="ignore"):
        cxx, cyy, cxy = sxx - sx * sx / count, syy - sy * sy / count, sxy - sx * sy / count
        least = (cxx + cyy) / 2 - np.sqrt(((cxx - cyy) / 2) ** 2 + cxy**2)
    return np.where(b > a, np.maximum(least, 0.0), np.inf)


def _breaks(ring: Points, most: int) -> dict[int, tuple[list[int], float]]:
    """For every number of sides from 3 to `most`: where a ring that begins at a corner is best
    broken into so many, and the sum of squared distances (dynamic programming)."""
    n = len(ring)
    around = shapely.LinearRing(ring).length
    shortest = max(2, math.ceil(n * max(MIN_SIDE, MIN_SIDE_M / around)))
    cost = _residuals(ring)
    a, b = np.arange(n)[:, None], np.arange(n + 1)[None, :]
    cost = np.where(b - a >= shortest, cost, np.inf)
    best = cost[0]
    came: list[NDArray[np.intp]] = []
    found = {}
    for sides in range(2, most + 1):
        total = best[:n, None] + cost
        came.append(total.argmin(0))
        best = total.min(0)
        if sides >= 3 and math.isfinite(best[n]):
            ends = [n]
            for step in came[::-1]:
                ends.append(int(step[ends[-1]]))
            found[sides] = (ends[:0:-1], float(best[n]))
    return {sides: ([0, *ends], rss) for sides, (ends, rss) in found.items()}


def _line(points: Points) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(centre, unit direction) by total least squares with Huber's weights."""
    weights = np.ones(len(points))
    for _ in range(8):
        centre = (points * weights[:, None]).sum(0) / weights.sum()
        away = points - centre
        direction = np.linalg.eigh((away * weights[:, None]).T @ away)[1][:, 1]
        distance = np.abs(away @ (-direction[1], direction[0]))
        scale = 1.4826 * float(np.median(distance)) + 1e-6
        weights = np.minimum(1.0, HUBER * scale / np.maximum(distance, 1e-12))
    along = points[-1] - points[0]
    return centre, direction * math.copysign(1.0, float(direction @ along))


def _meet(
    a: tuple[NDArray[np.float64], NDArray[np.float64]],
    b: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> NDArray[np.float64] | None:
    """Where two lines cross; None where they hardly differ in direction."""
    (p, u), (q, v) = a, b
    sine = float(u[0] * v[1] - u[1] * v[0])
    if abs(sine) < math.sin(MIN_TURN_RAD):
        return None
    t = float((q - p)[0] * v[1] - (q - p)[1] * v[0]) / sine
    meeting: NDArray[np.float64] = p + t * u
    return meeting


def _fit_corners(ring: Points, breaks: list[int]) -> Points | None:
    """Corners from robust lines through the sides, the sides' ends moved to where the lines meet
    until they stay. None where neighbouring sides do not meet or the corners make no polygon."""
    n = len(ring)
    for _ in range(5):
        lines = []
        for begin, end in zip(breaks, [*breaks[1:], breaks[0] + n], strict=True):
            ends = int(SIDE_ENDS * (end - begin))
            lines.append(_line(ring[np.arange(begin + ends, end - ends + 1) % n]))
        meetings = [_meet(lines[k - 1], lines[k]) for k in range(len(lines))]
        corners = [meeting for meeting in meetings if meeting is not None]
        if len(corners) < len(meetings):
            return None
        found = np.array(corners)
        moved = sorted(int(((ring - corner) ** 2).sum(1).argmin()) for corner in found)
        if len(set(moved)) < len(moved) or min(np.diff([*moved, moved[0] + n])) < 3:
            return None
        if moved == breaks:
            break
        breaks = moved
    return found if shapely.LinearRing(found).is_simple else None


def straight_sides(rings: list[Points], corners: int | None) -> Points:
    """(n, 2) corners, averaged over the rings (each one lap). Their number, where it is not given,
    is the one that the Bayesian information criterion prefers. UserError where nothing fits."""
    around = shapely.LinearRing(rings[0]).length
    observations = max(8.0, around / DECORRELATION_M)
    most = min(MAX_CORNERS, int(1 / MIN_SIDE)) if corners is None else corners
    fits: dict[int, list[Points]] = {}
    badness: dict[int, float] = {}
    for xy in rings:
        ring = resampled(xy, RING_POINTS)
        apart = ((ring - ring.mean(0)) ** 2).sum(1)
        ring = np.roll(ring, -int(apart.argmax()), axis=0)
        for sides, (breaks, rss) in _breaks(ring, most).items():
            fit = _fit_corners(ring, breaks)
            if fit is not None:
                fits.setdefault(sides, []).append(fit)
                variance = rss / RING_POINTS + WOBBLE_M**2
                # A side is a line of two unknowns.
                price = 2 * sides * math.log(observations)
                badness[sides] = badness.get(sides, 0.0) + observations * math.log(variance) + price
    usable = [sides for sides, found in fits.items() if len(found) == len(rings)]
    if corners is not None:
        usable = [sides for sides in usable if sides == corners]
    if not usable:
        what = "straight sides" if corners is None else f"{corners} straight sides"
        raise UserError(
            f"what was walked does not consist of {what} that meet in corners; give another "
            "--corners, or --irregular"
        )
    chosen = fits[min(usable, key=lambda sides: badness[sides])]
    reference = chosen[0]
    aligned = [reference]
    for other in chosen[1:]:
        turned = [np.roll(other, k, axis=0) for k in range(len(other))]
        aligned.append(min(turned, key=lambda t: float(((t - reference) ** 2).sum())))
    mean: Points = np.mean(aligned, axis=0)
    return mean


def _sagittas(outline: Points, rings: list[Points]) -> tuple[Points, Points]:
    """(n,) of each side of an outline how much farther out the walk lies in its middle than at its
    ends, as a parabola has it (m), and the standard deviation of that; infinite where too little
    was walked along it."""
    ends = np.roll(outline, -1, axis=0)
    sides = [shapely.LineString(side) for side in np.stack([outline, ends], axis=1)]
    walked = np.concatenate([resampled(ring, _even(ring)) for ring in rings])
    nearest = np.array([shapely.distance(s, shapely.points(walked)) for s in sides]).argmin(0)
    found, sigma = np.zeros(len(sides)), np.full(len(sides), math.inf)
    for k, (begin, way) in enumerate(zip(outline, ends - outline, strict=True)):
        length_m = float(np.hypot(*way))
        off = walked[nearest == k] - begin
        along = 2 * (off @ way) / length_m**2 - 1
        inner = np.abs(along) < 1 - 2 * SIDE_ENDS
        u, out = along[inner], (off @ (way[1], -way[0]) / length_m)[inner]
        if len(u) < 4 or not (bow := float(np.std(u**2))) > 0.0:
            continue
        parabola = np.polyfit(u, out, 2)
        left_m = float(np.std(out - np.polyval(parabola, u)))
        observations = max(1.0, (1 - 2 * SIDE_ENDS) * length_m * len(rings) / DECORRELATION_M)
        found[k] = -parabola[0]
        sigma[k] = max(left_m, LEAST_WOBBLE_M) / bow / math.sqrt(observations)
    return found, sigma


def bulging(outline: Points, rings: list[Points], known_to_m: float) -> bool:
    """Whether the walk surely lies farther out (or in) in the middle of some neighbouring sides
    than at their ends: by more than the corners are known to."""
    sagittas, sigmas = _sagittas(outline, rings)
    count = len(outline)
    for first in range(count):
        for many in range(1, count + 1):
            some = np.arange(first, first + many) % count
            weights = sigmas[some] ** -2.0
            if not (total := float(weights.sum())) > 0.0:
                continue
            mean_m = abs(float(weights @ sagittas[some])) / total
            if mean_m > max(BULGE_M, known_to_m) and mean_m * math.sqrt(total) > BULGE_SIGMAS:
                return True
    return False


def _even(xy: Points) -> int:
    """How many points describe a ring: two a metre."""
    return max(60, math.ceil(2 * float(shapely.LinearRing(xy).length)))


def _from(ring: Points, place: Points) -> Points:
    """The ring begun at its corner nearest to a place: where the walk began is corner 0."""
    nearest = int(((ring - place) ** 2).sum(1).argmin())
    return np.roll(ring, -nearest, axis=0)


def _begin(track: Track, lap: Loop, outline: Points, close_m: float) -> Points:
    """(2,) where the walker began: at the edge, or else, who came from elsewhere, where the first
    lap began. Of several laps the first that closes well may begin anywhere on the way."""
    first: Points = track.xy[0]
    at_edge = shapely.distance(shapely.LinearRing(outline), shapely.Point(first)) < close_m
    return first if at_edge else lap.begin


def _silent(_: str) -> None:
    """Where nobody asks how far it is."""


# ---- the whole -----------------------------------------------------------------------------------


def survey_track(
    track: Track,
    *,
    corners: int | None = None,
    irregular: bool = False,
    lap: int | None = None,
    close_m: float = CLOSE_M,
    tell: Callable[[str], None] = _silent,
) -> Survey:
    """The boundary from a walk. `lap` (from 1): take only this one; `tell` is told what it is at.
    UserError where the walk does not close a loop or the loop does not have the form that was asked
    for."""
    tell(f"smoothing {len(track.xy)} positions")
    smoother = Smoother(track) if smoothable(track) else None
    if smoother is not None:
        track = smoother.smoothed()
    tell("looking for laps")
    loops = find_loops(track, close_m)
    if loops is None:
        raise UserError(
            f"no closed loop in {track.length_m:.0f} m of walk: its ways never come within "
            f"{close_m:g} m of each other around an area; walk around the field back to where you "
            "began, or allow more with --close"
        )
    laps, warnings = _laps_of(loops, lap)
    rings = [closing(loop.xy) if irregular else loop.xy for loop in laps]
    tell(f"looking for the edge in {len(laps)} laps")
    mean, apart = mean_ring(rings, _even(rings[0]))
    outline = any_edge(mean) if irregular else straight_sides(rings, corners)
    sigma_m = UNKNOWN_SIGMA_M
    if smoother is not None:
        tell("how surely it is known")
        sigma_m = smoother.sigma_m(
            np.linspace(laps[0].first, laps[0].last, EDGE_POINTS, endpoint=False).astype(int)
        )
        sigma_m = math.hypot(sigma_m, STRAYED_M) if irregular else sigma_m
        sides = None if irregular else smoother.sides(outline, [(k.first, k.last) for k in laps])
        if sides is not None and _same_form(outline, sides.corners):
            outline, sigma_m = sides.corners, relative_sigma_m(sides.covariance)
    outline = _from(outline, _begin(track, laps[0], outline, close_m))
    line = shapely.LinearRing(outline)
    away = np.concatenate([shapely.distance(line, shapely.points(ring)) for ring in rings])
    residual = float(np.sqrt((away**2).mean()))
    holes, crossing = _keep_outs_in(shapely.Polygon(outline), loops)
    number_of = None if irregular else len(outline)
    polygon = shapely.Polygon(outline, holes)
    bulges = number_of is not None and bulging(outline, rings, sigma_m)
    found = Survey(track, loops, polygon, number_of, residual, apart, sigma_m, warnings, bulges)
    if found.leaves_its_sides or (corners is None and found.seems_to_bend):
        warnings.append(
            f"the walk leaves {number_of} straight sides by {away.max():.1f} m (rms "
            f"{residual:.1f} m); --irregular keeps the edge as it was walked"
        )
    walked_m, around_m = track.length_m, sum(float(shapely.LinearRing(r).length) for r in rings)
    if around_m < LEAST_SHARE * walked_m:
        warnings.append(
            f"the field takes only {around_m:.0f} m of {walked_m:.0f} m of walk: if it is larger, "
            "the walk did not come back to where it began; walk on to there, or allow more with "
            "--close"
        )
    if sigma_m > UNSURE_M:
        warnings.append(
            f"its corners are known to {sigma_m:.1f} m only: the receiver wandered; walk again, "
            "twice around, with a free view of the sky"
        )
    warnings += crossing
    return found


def _laps_of(loops: Loops, lap: int | None) -> tuple[list[Loop], list[str]]:
    """The laps that count, number `lap` (from 1) alone where it is given, and what was left aside,
    in words."""
    warnings = []
    laps = loops.laps
    if lap is not None:
        if lap > len(laps):
            raise UserError(f"--lap {lap}: the walk has {len(laps)} laps around the field")
        laps = [laps[lap - 1]]
    whole = [loop for loop in laps if loop.jumps_m == 0]
    if len(whole) < len(laps):
        jumps = ", ".join(f"{loop.jumps_m:.1f}" for loop in laps if loop.jumps_m > 0)
        what = "laps with jumps left aside" if whole else "every lap jumps, walk it again"
        warnings.append(f"{what}: {jumps} m")
        laps = whole or laps
    if loops.others:
        warnings.append(f"other loops outside the field, left aside: {loops.others}")
    return laps, warnings


def _keep_outs_in(
    field: shapely.Polygon, loops: Loops
) -> tuple[list[shapely.LinearRing], list[str]]:
    """The walked keep-outs inside a field, and what was left aside, in words."""
    holes, warnings = [], []
    for loop in loops.keep_outs:
        hole = shapely.convex_hull(loop.polygon)
        if field.contains(hole):
            holes.append(hole.exterior)
        else:
            warnings.append("a loop that crosses the field's edge was left aside")
    return holes, warnings


def _same_form(before: Points, after: Points) -> bool:
    """Whether corners that moved still make the same field."""
    near = float(np.hypot(*(after - before).T).max()) < CLOSE_M
    return near and bool(shapely.LinearRing(after).is_simple)


def with_keep_out(survey: Survey, track: Track, name: str, close_m: float = CLOSE_M) -> Survey:
    """The survey with one more hole, walked by itself. UserError names the walk where it closes no
    loop or does not lie inside the field."""
    if smoothable(track):
        track = Smoother(track).smoothed()
    loops = find_loops(track, close_m)
    if loops is None:
        raise UserError(f"{name}: no closed loop; walk around the keep-out back to where you began")
    walked = np.concatenate([loop.xy for loop in loops.laps]).tolist()
    frame = survey.track.frame
    places = [frame.to_local(*track.frame.to_wgs84(x, y)) for x, y in walked]
    keep_out = shapely.convex_hull(shapely.MultiPoint(places))
    field_ = shapely.Polygon(survey.polygon.exterior)
    if not field_.contains(keep_out):
        raise UserError(f"{name}: the keep-out does not lie inside the field")
    holes = [shapely.Polygon(hole) for hole in survey.polygon.interiors]
    together = shapely.union_all([*holes, keep_out])
    whole = shapely.Polygon(
        field_.exterior, [part.exterior for part in shapely.get_parts(together)]
    )
    return replace(survey, polygon=whole)


def with_marks(boundary: Boundary, walks: Iterable[Path]) -> Boundary:
    """The boundary, and what lies in it of the places that the walks mark in their GPX: a place is
    no keep-out, and its file says so to whoever plans with it."""
    marks = [mark for walk in walks if _is_gpx(walk) for mark in gpx_file.read_marks(walk)]
    rings = [[(lon, lat) for lat, lon in ring] for ring in (boundary.crop, *boundary.keep_outs)]
    field = Shape(shapely.Polygon(rings[0], rings[1:]))
    return replace(boundary, left_out=chosen([field, *marks]).left_out)


def _is_gpx(path: Path) -> bool:
    return path.suffix.lower() == ".gpx"


# ---- from a receiver ----------------------------------------------------------------------------


def read_walk(path: Path, tell: Callable[[str], None] = _silent) -> tuple[Track, Receiver]:
    """The walk in a recorded NMEA file or in the GPX of a phone's app, and what was understood of
    it; `tell` is told how far it is. UserError where there is no position in it."""
    check_input(path, "the walk")
    receiver = Receiver()
    try:
        if _is_gpx(path):
            fixes, receiver.sentences["GPX point"] = gpx_file.read_fixes(path)
        else:
            with path.open("rb") as lines:
                fixes = read_fixes(_told(lines, path.stat().st_size, tell), receiver)
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
    except OSError as error:
        raise UserError(f"cannot read the walk {path}: {error.strerror}") from error
    heard = ", ".join(f"{count} {kind}" for kind, count in receiver.sentences.items() if count)
    bad = ", ".join(f"{count} {reason}" for reason, count in receiver.bad.items())
    understood = f"(understood: {heard or 'nothing'}; bad: {bad or 'none'})"
    try:
        track = track_of(fixes)
    except UserError as error:
        raise UserError(f"{path}: {error} {understood}") from error
    if track is None:
        raise UserError(f"{path}: not one position in it {understood}; {_remedy(receiver)}")
    return track, receiver


def _remedy(receiver: Receiver) -> str:
    """What to do where no sentence told a position."""
    if not receiver.sentences and receiver.bad["checksum"]:
        return (
            "the checksum at a sentence's end is missing or wrong; record the sentences as the "
            "receiver sends them"
        )
    if not receiver.sentences:
        return "it is no NMEA text; name the file that the phone's NMEA app has recorded, or a .gpx"
    return (
        "wait under open sky until the app shows a position, and record NMEA with GGA or RMC "
        "sentences"
    )


def _told(lines: Iterable[bytes], size: int, tell: Callable[[str], None]) -> Iterator[bytes]:
    """The lines; `tell` is told, now and then, how much of `size` bytes they have been."""
    done = 0
    for number, line in enumerate(lines):
        if number % LINES_TOLD == 0:
            tell(f"reading, {100 * done / size:.0f} %" if size else "reading")
        done += len(line)
        yield line


def record_walk(url: str, path: Path, say: Callable[[str], None]) -> None:
    """Writes what a receiver sends until Ctrl-C, every byte as it comes: a walk is not repeated
    because a laptop's battery went flat. UserError where it cannot be written, later on too."""
    begun = time.monotonic()

    def clock() -> float:
        return time.monotonic() - begun

    full: list[OSError] = []

    def keep(data: bytes) -> None:
        try:
            file.write(data)
        except OSError as error:
            full.append(error)
            raise SourceLostError("what it sends cannot be written", final=True) from error

    feed, _ = gnss_feed(url, clock, say, tap=keep)
    nothing_yet = path.is_file() and path.stat().st_size == 0
    try:
        file = path.open("wb" if nothing_yet else "xb", buffering=0)
    except FileExistsError as error:
        raise UserError(
            f"{path} is there already; name it as the source, or move it away to walk again"
        ) from error
    except OSError as error:
        raise UserError(f"cannot write the recording {path}: {error.strerror}") from error
    with file:
        say(f"recording {url} to {path}; walk around the field, then press Ctrl-C")
        feed.start()
        fixes = lost = 0
        try:
            while not feed.stopping:
                fix = feed.take() if feed.wait(1.0) else None
                if fix is not None:
                    fixes += fix.quality > 0
                    lost += fix.quality == 0
                    if (fixes + lost) % 10 == 1:
                        say(f"{clock():6.0f} s  {fixes} positions, {lost} without a fix")
        except KeyboardInterrupt:
            say("recorded")
        finally:
            feed.close()
    if full:
        raise UserError(
            f"the recording {path} ends after {fixes} positions: {full[0].strerror}. Make room and "
            "walk again; to use what it has, name it as the source"
        )


def report(survey: Survey, receiver: Receiver) -> list[str]:
    """What was understood, line by line; warnings last."""
    track = survey.track
    understood = ", ".join(f"{n} {kind}" for kind, n in sorted(receiver.sentences.items()) if n)
    bad = ", ".join(f"{n} {reason}" for reason, n in sorted(receiver.bad.items()))
    dropped = ", ".join(f"{n} {reason}" for reason, n in sorted(track.dropped.items()))
    jumps = track.jumps_m[track.jumps_m > 0]
    lengths = ", ".join(f"{jump:.1f}" for jump in jumps)
    laps = survey.loops.laps
    form = "irregular" if survey.corners is None else f"{survey.corners} corners"
    lines = [
        f"sentences: {understood}; bad: {bad or 'none'}",
        f"positions: {len(track.xy)} used, left out: {dropped or 'none'}",
        f"jumps and unseen ways: {len(jumps)}" + (f" ({lengths} m)" if len(jumps) else ""),
        f"walk: {track.length_m:.0f} m; laps: {len(laps)}, closed to "
        + ", ".join(f"{loop.gap_m:.1f}" for loop in laps)
        + " m"
        + (f", {survey.laps_apart_m:.2f} m rms apart" if len(laps) > 1 else ""),
        f"boundary: {form}, {survey.polygon.exterior.length:.1f} m around, "
        f"{survey.polygon.area:.0f} m2, {len(survey.polygon.interiors)} keep-outs; the walk lies "
        f"{survey.residual_m:.2f} m rms from it; its corners are known to {survey.sigma_m:.2f} m "
        "(standard deviation along each axis, against each other)",
    ]
    return lines + [f"warning: {text}" for text in survey.warnings]


# ---- the picture ---------------------------------------------------------------------------------


def draw_survey(path: Path, survey: Survey, title: str) -> None:
    """Left the whole walk, right the field: raw track, rejected points, laps, boundary, corners.
    Distances count from corner 0, as in the plan's picture."""
    survey = _from_corner_0(survey)
    figure = Figure(figsize=(15, 8), layout="constrained")
    whole, close = figure.subplots(1, 2)
    for axes in (whole, close):
        _draw(axes, survey)
    lo_x, lo_y, hi_x, hi_y = survey.polygon.bounds
    room = 0.12 * max(hi_x - lo_x, hi_y - lo_y)
    close.set(xlim=(lo_x - room, hi_x + room), ylim=(lo_y - room, hi_y + room))
    for number, (x, y) in enumerate(survey.polygon.exterior.coords[:-1]):
        if survey.corners is not None:
            close.annotate(
                str(number), (x, y), (5, 5), textcoords="offset points", weight="bold", size=12
            )
    length = 10 ** math.floor(math.log10((hi_x - lo_x) / 2))
    left, low = lo_x - room * 0.8, lo_y - room * 0.7
    close.plot([left, left + length], [low, low], color="black", lw=4)
    close.text(left, low + room * 0.15, f"{length:g} m")
    whole.set_title("the walk")
    close.set_title("the field")
    close.legend(loc="upper right", fontsize=8)
    figure.suptitle(title)
    with saved(path) as fresh:
        figure.savefig(fresh, dpi=110)


def _from_corner_0(survey: Survey) -> Survey:
    """The same, its metres counted from the boundary's first corner."""
    zero = np.array(survey.polygon.exterior.coords[0])
    track = replace(survey.track, xy=survey.track.xy - zero, rejected=survey.track.rejected - zero)
    laps = [replace(lap, xy=lap.xy - zero) for lap in survey.loops.laps]
    polygon = shapely.affinity.translate(survey.polygon, *-zero)
    return replace(survey, track=track, loops=replace(survey.loops, laps=laps), polygon=polygon)


def _draw(axes: Axes, survey: Survey) -> None:
    for number, piece in enumerate(pieces(survey.track)):
        label = "walked" if number == 0 else ""
        axes.plot(*piece.T, color="0.6", lw=0.8, marker=".", ms=2, label=label)
    if len(survey.track.rejected):
        axes.plot(*survey.track.rejected.T, "rx", ms=6, label="rejected")
    jumps = np.flatnonzero(survey.track.jumps_m > 0)
    for number, k in enumerate(jumps):
        label = "jump" if number == 0 else ""
        axes.plot(*survey.track.xy[k - 1 : k + 1].T, "r:", lw=1, label=label)
    for number, loop in enumerate(survey.loops.laps, start=1):
        ring = np.vstack([loop.xy, loop.xy[:1]])
        axes.plot(*ring.T, lw=1.0, color=f"C{LAP_COLOURS[number % 4]}", label=f"lap {number}")
    outer = np.array(survey.polygon.exterior.coords)
    axes.plot(*outer.T, color="tab:green", lw=2.5, label="boundary")
    axes.fill(*outer.T, color="tab:green", alpha=0.12)
    if survey.corners is not None:
        axes.plot(*outer.T, "o", color="tab:green", ms=7)
    for number, hole in enumerate(survey.polygon.interiors):
        label = "keep-out" if number == 0 else ""
        axes.fill(*np.array(hole.coords).T, color="tab:red", alpha=0.6, label=label)
    axes.set_aspect("equal")
    axes.set(xlabel="east of corner 0 (m)", ylabel="north of corner 0 (m)")
    axes.grid(alpha=0.3)
