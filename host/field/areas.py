"""Three areas kept apart: the crop to be cut, where the machine may be, what it must not touch; and
the geofence that holds the machine inside the second and off the third.

Everything in metres of the field frame. Where to cut is decided by the crop's edge in the picture:
a phone's position cannot place a blade. The geofence only slows and stops.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import shapely
from numpy.typing import NDArray

from host.core.compiled import compiled
from host.core.errors import UserError
from host.core.vehicle import Vehicle
from host.field import sweep

GAP_MARGIN_M = 0.2
"""The permitted area ends this far before the neighbour's crop."""
MAX_GAP_M = 100.0
"""Nobody has measured more to a neighbour's crop: a larger gap is a slip."""
MAX_INSET_M = 20.0
"""Nobody cuts a wider border by hand."""
KEEP_OUT_MARGIN_M = 0.3
"""Around a tree, a well or a pole as it was walked."""
BLADE_DEPTH_M = 0.05
"""How far the blade reaches ahead of its line; twice that behind it."""


@dataclass(frozen=True, slots=True)
class Areas:
    """`permitted` does not leave the keep-outs out: they are told apart where the machine stops."""

    field: shapely.Polygon
    """What the field bears: its edge as walked, less the keep-outs as walked."""
    crop: shapely.Polygon
    """What is to be cut: the field inset, less the keep-outs with their margin."""
    permitted: shapely.Polygon | None
    """Field and gap up to the neighbour's crop less a margin; None where the gap is not known."""
    keep_outs: tuple[shapely.Polygon, ...] = ()
    """With their margin."""
    inset_m: float = 0.0
    """Of the crop, from the field's edge."""

    @property
    def begins(self) -> shapely.Polygon:
        """What the first round goes around: the field as walked, corner by corner; with an inset,
        the crop."""
        return shapely.Polygon((self.crop if self.inset_m > 0.0 else self.field).exterior)

    @property
    def price(self) -> float:
        """Share of the field's crop that stays standing by choice: the inset and the margins."""
        return max(0.0, 1.0 - float(self.crop.area / self.field.area))


def areas_of(
    field: shapely.Polygon,
    gap_m: float | None,
    *,
    inset_m: float = 0.0,
    margin_m: float = GAP_MARGIN_M,
    keep_out_margin_m: float = KEEP_OUT_MARGIN_M,
    nearer: Mapping[int, float] = MappingProxyType({}),
) -> Areas:
    """The areas of a field (its holes the keep-outs) with a gap of gap_m to the neighbours' crop on
    all sides, None where nobody has measured it; beyond some edges, numbered by their first corner,
    something stands `nearer`, m. The inset is the paper's other approach: a boundary "slightly
    inside our target field to cater for the positional errors" (II); `Areas.price` says what it
    costs.

    UserError where a length is negative, the margin exceeds the gap, or what is left to cut is
    nothing or falls apart."""
    lengths = {
        "gap": margin_m if gap_m is None else gap_m,
        "inset": inset_m,
        "margin": margin_m,
        "keep-out margin": keep_out_margin_m,
    }
    for name, length in lengths.items():
        if not (math.isfinite(length) and length >= 0):
            raise UserError(f"the {name} is {length:g} m; it must be 0 or more")
    if gap_m is not None and gap_m > MAX_GAP_M:
        raise UserError(
            f"a gap of {gap_m:g} m to the neighbour's crop is more than {MAX_GAP_M:g} m: give what "
            "was measured, in metres"
        )
    if gap_m is not None and margin_m > gap_m:
        raise UserError(
            f"the gap of {gap_m:g} m is less than the margin of {margin_m:g} m to the neighbour's "
            "crop: there is no room for the machine's wheels"
        )
    outline = shapely.Polygon(field.exterior)
    grown = tuple(
        shapely.Polygon(hole).buffer(keep_out_margin_m, join_style="mitre")
        for hole in field.interiors
    )
    crop = outline.buffer(-inset_m, join_style="mitre").difference(shapely.union_all(grown))
    causes = [f"an inset of {inset_m:g} m"] if inset_m > 0 else []
    causes += [f"the keep-outs with {keep_out_margin_m:g} m around them"] if grown else []
    cause, smaller = " and ".join(causes), ["choose a smaller inset"] if inset_m > 0 else []
    if crop.is_empty:
        remedy = " or ".join([*smaller, *(["correct the keep-outs"] if grown else [])])
        raise UserError(f"with {cause} nothing is left to cut; {remedy}")
    if not isinstance(crop, shapely.Polygon):
        remedy = " or ".join([*smaller, "survey the pieces as fields of their own"])
        raise UserError(f"{cause} part the crop into {len(crop.geoms)} pieces; {remedy}")
    permitted = None
    if gap_m is not None:
        permitted = shapely.Polygon(outline.buffer(gap_m - margin_m, join_style="mitre").exterior)
        beyond = [_beyond(outline, at, max(0.0, m - margin_m), gap_m) for at, m in nearer.items()]
        if beyond:
            left = permitted.difference(shapely.union_all(beyond)).union(outline)
            largest = max(shapely.get_parts(left), key=lambda part: float(part.area))
            permitted = shapely.Polygon(largest.exterior)
    return Areas(field, crop, permitted, grown, inset_m)


def _beyond(outline: shapely.Polygon, edge: int, from_m: float, gap_m: float) -> shapely.Polygon:
    """The gap farther than from_m outside of an edge, and past its ends as far as it is wide."""
    ring = shapely.get_coordinates(outline.exterior)[:-1]
    begin, end = ring[edge], ring[(edge + 1) % len(ring)]
    x, y = (end - begin) / math.dist(begin, end)
    past = gap_m * np.array((x, y))
    out = np.array((y, -x)) if outline.exterior.is_ccw else np.array((-y, x))
    near, far = from_m * out, gap_m * out
    begin, end = begin - past, end + past
    return shapely.Polygon([begin + near, begin + far, end + far, end + near])


def outline_of(vehicle: Vehicle) -> NDArray[np.float64]:
    """(8, 2) corners of body and blade in the vehicle frame, metres, counter-clockwise."""
    rear = -vehicle.rear_overhang_m
    line = vehicle.blade_x_m - 2 * BLADE_DEPTH_M
    front = vehicle.blade_x_m + BLADE_DEPTH_M
    body, blade = vehicle.half_width_m, vehicle.blade_width_m / 2
    right = [(rear, -body), (line, -body), (line, -blade), (front, -blade)]
    return np.array([*right, *((x, -y) for x, y in right[::-1])])


def placed(
    outline: NDArray[np.float64], x_m: float, y_m: float, heading_rad: float
) -> NDArray[np.float64]:
    """An outline of the vehicle frame in the field frame."""
    found = np.empty_like(outline)
    _place(outline, x_m, y_m, heading_rad, found)
    return found


@compiled("(f8[:, ::1], f8, f8, f8, f8[:, ::1])")
def _place(
    outline: NDArray[np.float64], x: float, y: float, heading: float, found: NDArray[np.float64]
) -> None:
    """`placed`; numpy takes five times as long for a handful."""
    c, s = math.cos(heading), math.sin(heading)
    for k in range(len(outline)):
        ahead, left = outline[k]
        found[k, 0] = x + c * ahead - s * left
        found[k, 1] = y + s * ahead + c * left


@compiled("(f8[:, ::1], f8[::1], f8[:, ::1])")
def _nearest(
    sides: NDArray[np.float64], place: NDArray[np.float64], found: NDArray[np.float64]
) -> None:
    """`Geofence.nearest`, asked at every step."""
    for k in range(len(sides)):
        x, y = sides[k, 0], sides[k, 1]
        along_x, along_y = sides[k, 2] - x, sides[k, 3] - y
        share = (place[0] - x) * along_x + (place[1] - y) * along_y
        share /= max(along_x**2 + along_y**2, sweep.NEAR_M**2)
        share = min(1.0, max(0.0, share))
        found[k, 0], found[k, 1] = x + share * along_x, y + share * along_y


class Level(enum.IntEnum):
    """What the geofence asks for."""

    CLEAR = 0
    SLOW = 1
    STOP = 2


@dataclass(frozen=True, slots=True)
class Verdict:
    """The geofence's answer. `clearance_m` is of the outline at the estimated position: to the
    permitted area's border or the nearest keep-out, negative beyond; NaN without a position."""

    level: Level
    reason: str
    clearance_m: float
    at_keep_out: bool = False
    """A keep-out is nearer than the border."""
    elsewhere: bool = False
    """Said of another place at which the machine may be; where it believes to be it may go on."""


CLEAR = Verdict(Level.CLEAR, "", math.nan)


class Geofence:
    """Whether a machine whose position is uncertain stays where it may be.

    The hull of the machine's outline is swept by its travel within a horizon and by the ellipse of
    `sigmas` standard deviations. STOP where the sweep of `stop_s` leaves the permitted area or
    touches a keep-out; SLOW where the sweep of `slow_s`, wider by `slow_m`, does. The nearer sweep
    turns with the machine: on the lock a blade swings to where its axle does not go. The farther
    one goes straight on: nothing stays on the lock for so long. Pure: the same
    question has the same answer."""

    def __init__(
        self,
        areas: Areas,
        *,
        sigmas: float = 2.0,
        stop_s: float = 0.6,
        slow_s: float = 2.0,
        slow_m: float = 0.15,
    ) -> None:
        """`stop_s` covers what passes between the question and standstill. Prepares the areas'
        geometry: ask often, build once. ValueError without a permitted area."""
        if areas.permitted is None:
            raise ValueError("a geofence needs the gap's width")
        self.permitted: shapely.Polygon = areas.permitted
        """Where the machine may be, keep-outs apart."""
        self._border = areas.permitted.exterior
        self._keep_outs = shapely.MultiPolygon(areas.keep_outs)
        self.sigmas = sigmas
        self._stop_s, self._slow_s, self._slow_m = stop_s, slow_s, slow_m
        for geometry in (self.permitted, self._border, self._keep_outs):
            shapely.prepare(geometry)
        rings = [(0, ring) for ring in (self._border, *self.permitted.interiors)]
        for k, keep_out in enumerate(self._keep_outs.geoms):
            rings += [(1 + k, ring) for ring in (keep_out.exterior, *keep_out.interiors)]
        corners = [(of, shapely.get_coordinates(ring)) for of, ring in rings]
        self._sides = np.concatenate([np.hstack([c[:-1], c[1:]]) for _, c in corners])
        self._rings = np.repeat([of for of, _ in corners], [len(c) - 1 for _, c in corners])
        """Of which of them each side is: 0 the border, the keep-outs from 1 on."""
        self._gaps = np.empty(1 + len(self._keep_outs.geoms))

    @property
    def sides(self) -> NDArray[np.float64]:
        """(m, 4), of the permitted area and of the keep-outs: x and y of both ends."""
        return self._sides

    @property
    def normals(self) -> NDArray[np.float64]:
        """(m, 2) a unit vector across each of the sides."""
        along = self._sides[:, 2:] - self._sides[:, :2]
        long = np.maximum(np.hypot(along[:, 0], along[:, 1]), sweep.NEAR_M)
        found: NDArray[np.float64] = np.stack([-along[:, 1], along[:, 0]], 1) / long[:, np.newaxis]
        return found

    def nearest(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """(m, 2) the place on each of the sides that is nearest to one (2,)."""
        found = np.empty((len(self._sides), 2))
        _nearest(self._sides, place, found)
        return found

    def check(
        self,
        outline: NDArray[np.float64],
        covariance: NDArray[np.float64],
        velocity: tuple[float, float] = (0.0, 0.0),
        yaw_rate_radps: float = 0.0,
        axle: tuple[float, float] = (0.0, 0.0),
        shifts: NDArray[np.float64] | None = None,
        planned: NDArray[np.float64] | None = None,
    ) -> Verdict:
        """`outline`: (n, 2) corners of the machine in the field frame, m; their hull counts.
        `covariance`: (2, 2) of the position, m², or (n, 2, 2) of each corner, which a direction
        that is not known moves the more the farther out it is, or (m, n, 2, 2) of each against
        each of the `sides`; NaN or infinite where there is none. `velocity`: of its rear axle,
        which is at `axle`, m/s, field frame; it turns meanwhile. `shifts`: (m, 2), how far each of
        the sides lies from where it is taken to be; then `planned` is the outline where it would
        be if they lay there."""
        each = covariance.reshape((1,) * (4 - covariance.ndim) + covariance.shape)
        if shifts is None:
            shifts = np.zeros((len(self._sides), 2))
        planned = outline if planned is None else planned
        known_m, clear, goes_on = sweep.judged(
            self._sides, shifts, planned, outline, each, self.sigmas, self._slow_m, axle, velocity,
            yaw_rate_radps, (self._slow_s, self._stop_s),
        )  # fmt: skip
        if math.isnan(known_m):
            return Verdict(Level.STOP, "the position is unknown", math.nan)
        if clear and goes_on:
            return CLEAR
        clearance, keep_out = self._clearance(planned)
        where = f"{clearance:.1f} m to" if clearance >= 0 else "beyond"
        nearest = "the permitted area's border" if keep_out is None else f"keep-out {keep_out + 1}"
        reason = f"geofence: {where} {nearest}, position known to {known_m:.1f} m"
        level = Level.SLOW if goes_on else Level.STOP
        return Verdict(level, reason, clearance, keep_out is not None)

    def clearance(self, outline: NDArray[np.float64]) -> float:
        """Metres from an outline to the permitted area's border or the nearest keep-out, negative
        beyond; for choosing between manoeuvres before one is driven."""
        return self._clearance(outline)[0]

    def _clearance(self, outline: NDArray[np.float64]) -> tuple[float, int | None]:
        """Negative: how far the furthest corner is beyond, or how deep in a keep-out. And which
        keep-out the machine would touch first; None where the border is nearer."""
        if not sweep.is_free(self._sides, outline):
            return self._depth(outline)
        sweep.gaps(self._sides, self._rings, outline, self._gaps)
        border, *keep_outs = self._gaps.tolist()
        nearest = min(keep_outs, default=math.inf)
        if nearest <= border:
            return nearest, keep_outs.index(nearest)
        return border, None

    def _depth(self, outline: NDArray[np.float64]) -> tuple[float, int | None]:
        """The same where the outline touches a border or lies beyond."""
        shape = shapely.convex_hull(shapely.linestrings(outline))
        away = clearance = float(self._border.distance(shape))
        if not self.permitted.contains(shape):
            clearance = -float(shapely.distance(self.permitted, shapely.points(outline)).max())
        distances = [float(keep_out.distance(shape)) for keep_out in self._keep_outs.geoms]
        nearest = min(distances, default=math.inf)
        if nearest == 0.0:
            overlap = self._keep_outs.intersection(shape)
            clearance = min(clearance, -math.sqrt(float(overlap.area)))
        clearance = min(clearance, nearest)
        return clearance, distances.index(nearest) if nearest <= away else None
