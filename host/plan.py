"""The plan of a field: the sides of the inward spiral, computed before anything moves.

Paper, II and Fig. 1 (c): along the outer boundary with left turns, then inward by the blade's
width. A convex field is cut like paper: each side takes a strip of the effective width off what
still stands, so lengths, corner angles and the last leftover strip all come out of the geometry.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import shapely
from shapely.affinity import affine_transform

from host.errors import UserError

MIN_STRIP_M2 = 0.02
"""What a side would cut at least; smaller remains are nothing a camera could find."""
MAX_SIDES = 4000


@dataclass(frozen=True, slots=True)
class Side:
    """One pass. The crop's outer edge runs from (x_m, y_m) in direction heading_rad (field frame)
    for length_m; the strip is width_m wide, left of it. From the beginning of the crop it is
    fence_m to the field's boundary: on inner sides, what has been cut lies between."""

    x_m: float
    y_m: float
    heading_rad: float
    length_m: float
    width_m: float
    fence_m: float


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

    def corner_rad(self, index: int) -> float:
        """The left turn from side `index` to the next."""
        if index + 1 >= len(self.sides):
            return math.pi / 2
        turn = self.sides[index + 1].heading_rad - self.sides[index].heading_rad
        return turn % (2 * math.pi)


def _along(polygon: shapely.Polygon, heading: float) -> shapely.Polygon:
    """The polygon turned so that `heading` points along x."""
    c, s = math.cos(heading), math.sin(heading)
    return affine_transform(polygon, [c, s, -s, c, 0, 0])


def spiral(
    boundary: list[tuple[float, float]],
    start: int,
    width_m: float,
    turn: str = "three_point",
    gap_m: float | None = None,
) -> Plan:
    """The inward spiral of left turns through a convex boundary (corners in metres, either
    orientation), beginning with the side that leaves corner `start`; `width_m` is the blade's
    width less the overlap. UserError where the boundary is not a convex polygon."""
    ring = shapely.geometry.polygon.orient(shapely.Polygon(boundary))
    if not ring.is_valid or ring.area <= 0:
        raise UserError("boundary: its sides cross; walk it again or correct its corners")
    if ring.area < 0.99 * ring.convex_hull.area:
        raise UserError("boundary: it is not convex; split the field into convex parts")
    corners = list(ring.exterior.coords)[:-1]
    count = len(corners)
    headings = []
    for k in range(count):
        (ax, ay), (bx, by) = corners[(start + k) % count], corners[(start + k + 1) % count]
        headings.append(math.atan2(by - ay, bx - ax))
    standing: shapely.Geometry = ring
    sides: list[Side] = []
    empty = 0
    k = 0
    while empty < count and len(sides) < MAX_SIDES:
        heading = headings[k % count]
        k += 1
        turned, ring_turned = _along(standing, heading), _along(ring, heading)
        if turned.is_empty:
            break
        lo_x, lo_y, hi_x, hi_y = turned.bounds
        strip = turned.intersection(shapely.box(lo_x, lo_y, hi_x, lo_y + width_m))
        if strip.area < MIN_STRIP_M2:
            empty += 1
            continue
        empty = 0
        begin, _, end, _ = strip.bounds
        c, s = math.cos(heading), math.sin(heading)
        x, y = c * begin - s * lo_y, s * begin + c * lo_y
        path = shapely.box(lo_x, lo_y, ring_turned.bounds[2], min(hi_y, lo_y + width_m))
        fence = ring_turned.intersection(path).bounds[2] - begin
        sides.append(Side(x, y, heading, end - begin, min(width_m, hi_y - lo_y), fence))
        rest = turned.intersection(
            shapely.box(lo_x, lo_y + width_m, hi_x, max(hi_y, lo_y + width_m))
        )
        standing = _along(rest, -heading)
    return Plan(tuple(sides), turn, tuple(corners), gap_m)
