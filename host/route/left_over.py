"""What still stands of a field by the way that the blade has gone, and the strips that gather it.

A plan leaves crop that it never meant to: beginnings behind which there was no room for the whole
machine, strips that were ended beside a keep-out, one whose edge was not to be made out. Where that
lies is known from the blade's way, and from all around it is reached over ground that is cut.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from host.core.frames import Pose2
from host.core.vehicle import Vehicle
from host.field.areas import KEEP_OUT_MARGIN_M, outline_of, placed
from host.route.cuts import Cuts
from host.route.manoeuvre import RUN_IN_M, SHORT_M
from host.route.plan import KEEP_OUT_M
from host.route.side import Side
from host.route.standing import edges_of, parts_of

Ring = Sequence[tuple[float, float]]

HALF_SLIVER_M: Final = 0.2
"""Half of the width below which what seems to stand is the error of the places at which two strips
were cut: they lie beside each other to 0.1 m, and overlap by as much."""
AROUND_M: Final = 0.05
"""A strip that was gone to takes what touches it with it."""
SIMPLIFY_M: Final = 0.3
"""What strips of a shuttle leave is jagged by how differently they begin. An edge beside the lane
by less is still seen for the lane's."""
GATHER_SHARE: Final = 0.002
GATHER_M2: Final = (1.0, 8.0)
"""Of the field, and no less or more than that: a smaller piece is not worth the minute that it
costs."""
GAIN_M2: Final = 0.5
"""The same of one strip."""
APPROACH_M: Final = 8.0
"""What a strip costs besides its own way and that to it, in metres: turns and looks."""
SHORTS: Final = 4
"""Beginnings that are tried, from a strip's own to `SHORT_M` later."""
PLACES: Final = 40
"""Along a strip, at most, where room for the machine is looked for;"""
PLACES_M: Final = 0.5
"""and how far apart at least."""
BEYOND_M: Final = 0.25
"""A swath goes on beyond its first and last point, by as much as two of them are apart at most."""
STRAIGHT_M: Final = 0.02
"""Points of a swath that lie so near to the line between their neighbours are none."""
CURVE_POINTS: Final = 4
"""Of a quarter of a circle, where swaths bend."""


class Gathering(NamedTuple):
    """A strip through what is left."""

    side: Side
    area: shapely.Polygon
    """What it is to take off."""


class LeftOver:
    """What has been cut, swath by swath."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._cut: shapely.Geometry = shapely.Polygon()
        self._tried: shapely.Geometry = shapely.Polygon()
        self._aside: shapely.Geometry = shapely.Polygon()
        self.swaths = 0
        """How many have been taken."""

    def take(self, swath: NDArray[np.float64]) -> None:
        """(n, 2) the way of the blade's middle through crop, m, two points or more."""
        self.swaths += 1
        (bx, by), (ex, ey) = (_beyond(*ends) for ends in (swath[1::-1], swath[-2:]))
        line = shapely.LineString([(bx, by), *swath[1:-1], (ex, ey)])
        half_m = self._vehicle.blade_width_m / 2
        wide = shapely.simplify(line, STRAIGHT_M).buffer(
            half_m, cap_style="flat", quad_segs=CURVE_POINTS
        )
        self._cut = self._cut.union(wide)

    def tried(self, area: shapely.Polygon) -> None:
        """A strip was gathered, as far as that could be: what is left there stays. From where it
        ends, ways may lead to those that were set aside."""
        self._tried = self._tried.union(area.buffer(AROUND_M, join_style="mitre"))
        self._aside = shapely.Polygon()

    def set_aside(self, area: shapely.Polygon) -> None:
        """No way leads to a strip from where the machine stands."""
        self._aside = self._aside.union(area.buffer(AROUND_M, join_style="mitre"))

    def gone(self, area: shapely.Polygon) -> None:
        """Pictures show that nothing stands there."""
        self._cut = self._cut.union(area.buffer(AROUND_M, join_style="mitre"))

    def parts(
        self, boundary: Ring, keep_outs: Sequence[Ring], *, tried: bool = True
    ) -> list[shapely.Polygon]:
        """What stands, the largest part first, but for slivers and what is too small to gather;
        `tried`: with what was tried before or set aside. The area around keep-outs that no plan
        cuts is none."""
        field = _field(boundary, keep_outs)
        standing = field.difference(self._cut)
        if not tried:
            standing = standing.difference(self._tried.union(self._aside))
        core = standing.buffer(-HALF_SLIVER_M, join_style="mitre")
        opened = core.buffer(HALF_SLIVER_M, join_style="mitre").intersection(standing)
        least_m2 = min(max(GATHER_SHARE * field.area, GATHER_M2[0]), GATHER_M2[1])
        return [part for part in parts_of(opened) if part.area >= least_m2]

    def strips(
        self,
        boundary: Ring,
        keep_outs: Sequence[Ring],
        here: Pose2,
        permitted: shapely.Polygon | None,
    ) -> list[Gathering]:
        """The strips that what stands may be gathered by, the best first for a machine that is
        `here`: they have room for it, in `permitted` and off the keep-outs."""
        field, width_m = _field(boundary, keep_outs), self._vehicle.pass_m
        known = Cuts(field, width_m)
        outs = [shapely.Polygon(ring).buffer(KEEP_OUT_MARGIN_M) for ring in keep_outs]
        found: list[tuple[float, Gathering]] = []
        for part in self.parts(boundary, keep_outs, tried=False):
            for shape in _shapes(part):
                for edge in edges_of(shape):
                    done = known.cut(shape, edge) if edge.open_ends else None
                    if done is None:
                        continue
                    side, rest = done
                    area = part.difference(shapely.union_all(rest))
                    short_m = self._short_m(side, permitted, outs)
                    if short_m is None:
                        continue
                    gain_m2 = area.area - short_m * side.width_m
                    if gain_m2 < GAIN_M2:
                        continue
                    way_m = math.dist(here[:2], (side.x_m, side.y_m)) + side.length_m
                    strip = Gathering(replace(side, left_over=True), area)
                    found.append((gain_m2 / (APPROACH_M + way_m), strip))
        return [strip for _, strip in sorted(found, key=lambda pair: -pair[0])]

    def _short_m(
        self, side: Side, permitted: shapely.Polygon | None, outs: Sequence[shapely.Polygon]
    ) -> float | None:
        """How much of a strip's beginning stays for want of room; None where too much would, or
        where there is none on the way along it."""
        left_m = self._vehicle.inset_m - side.shift_m
        outline = outline_of(self._vehicle)

        def free(along_m: float) -> bool:
            lane = Pose2(*side.pose(along_m, left_m)).ahead(-self._vehicle.blade_x_m)
            there = shapely.Polygon(placed(outline, *lane))
            inside = permitted is None or permitted.contains(there)
            return inside and not any(out.intersects(there) for out in outs)

        count = min(PLACES, max(2, math.ceil(side.length_m / PLACES_M)))
        if not all(map(free, np.linspace(SHORT_M[0], side.length_m, count).tolist())):
            return None
        shorts_m = np.linspace(0.0, SHORT_M[0], SHORTS).tolist()
        return next((short_m for short_m in shorts_m if free(short_m - RUN_IN_M)), None)


def _beyond(before: NDArray[np.float64], at: NDArray[np.float64]) -> tuple[float, float]:
    """BEYOND_M on from `at`, straight away from another place."""
    way = at - before
    x, y = at + way * (BEYOND_M / max(1e-9, float(np.hypot(*way))))
    return float(x), float(y)


def _field(boundary: Ring, keep_outs: Sequence[Ring]) -> shapely.Geometry:
    """What a plan cuts of a field."""
    away = [shapely.Polygon(ring).buffer(KEEP_OUT_M, join_style="mitre") for ring in keep_outs]
    return shapely.Polygon(boundary).buffer(0).difference(shapely.union_all(away))


def _shapes(part: shapely.Polygon) -> Iterator[shapely.Polygon]:
    """What a part is taken for: as it is, but for small steps, and its hull, of which every edge
    ends on open ground."""
    for shape in (part, part.convex_hull):
        simple = shapely.simplify(shape, SIMPLIFY_M)
        if isinstance(simple, shapely.Polygon) and simple.is_valid and not simple.is_empty:
            yield simple
