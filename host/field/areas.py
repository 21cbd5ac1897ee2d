"""Three areas kept apart: the crop to be cut, where the machine may be, what it must not touch; and
the geofence that holds the machine inside the second and off the third.

Everything in metres of the field frame. Where to cut is decided by the crop's edge in the picture:
a phone's position cannot place a blade. The geofence only slows and stops.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray

from host.core.errors import UserError
from host.core.vehicle import Vehicle

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
) -> Areas:
    """The areas of a field (its holes the keep-outs) with a gap of gap_m to the neighbours' crop on
    all sides, None where nobody has measured it. The inset is the paper's other approach: a
    boundary "slightly inside our target field to cater for the positional errors" (II);
    `Areas.price` says what it costs.

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
    if crop.is_empty:
        raise UserError(
            f"with an inset of {inset_m:g} m nothing is left to cut; choose a smaller one"
        )
    if not isinstance(crop, shapely.Polygon):
        raise UserError(
            f"an inset of {inset_m:g} m and the keep-outs part the crop into {len(crop.geoms)} "
            "pieces; choose a smaller inset or survey the pieces as fields of their own"
        )
    permitted = None
    if gap_m is not None:
        permitted = shapely.Polygon(outline.buffer(gap_m - margin_m, join_style="mitre").exterior)
    return Areas(field, crop, permitted, grown)


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


@njit(cache=True, nogil=True)
def _place(
    outline: NDArray[np.float64], x: float, y: float, heading: float, found: NDArray[np.float64]
) -> None:
    """`placed`; numpy takes five times as long for a handful."""
    c, s = math.cos(heading), math.sin(heading)
    for k in range(len(outline)):
        ahead, left = outline[k]
        found[k, 0] = x + c * ahead - s * left
        found[k, 1] = y + s * ahead + c * left


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


CLEAR = Verdict(Level.CLEAR, "", math.nan)

_OCTAGON = np.array(
    [
        (math.cos(a) / math.cos(math.pi / 8), math.sin(a) / math.cos(math.pi / 8))
        for a in np.arange(8) * math.tau / 8
    ]
)
"""Around the unit circle, so that what it sweeps holds what the circle sweeps."""


@njit(cache=True, nogil=True)
def _sweep_is_free(
    sides: NDArray[np.float64],
    outline: NDArray[np.float64],
    covariance: NDArray[np.float64],
    octagon: NDArray[np.float64],
    sigmas: float,
    more_m: float,
    way_x: float,
    way_y: float,
) -> bool:
    """Whether the sweep of `Geofence.check` certainly lies where it may: each side of any area
    (n, 4) passes the upright box around it, or has all of it on one side of its line, and the
    permitted area, but no keep-out, is around it. False where only a closer look can tell."""
    corners = octagon.shape[0]
    swept = np.empty((outline.shape[0] * corners, 2))
    low_x, low_y, high_x, high_y = math.inf, math.inf, -math.inf, -math.inf
    for k in range(outline.shape[0]):
        of = min(k, covariance.shape[0] - 1)
        xx, xy, yy = covariance[of, 0, 0], covariance[of, 0, 1], covariance[of, 1, 1]
        root = xx * yy - xy * xy
        if not math.isfinite(root + xx + yy):
            return False
        root = math.sqrt(max(0.0, root))
        spread = math.sqrt(max(0.0, xx + yy + 2.0 * root))
        scale = sigmas / spread if spread > 0.0 else 0.0
        for q in range(octagon.shape[0]):
            ox, oy = octagon[q, 0], octagon[q, 1]
            x = outline[k, 0] + scale * (ox * (xx + root) + oy * xy) + more_m * ox
            y = outline[k, 1] + scale * (ox * xy + oy * (yy + root)) + more_m * oy
            swept[k * corners + q, 0], swept[k * corners + q, 1] = x, y
            low_x, high_x = min(low_x, x, x + way_x), max(high_x, x, x + way_x)
            low_y, high_y = min(low_y, y, y + way_y), max(high_y, y, y + way_y)
    of_x, of_y = swept[0]
    inside = False
    for k in range(sides.shape[0]):
        ax, ay, bx, by = sides[k]
        if (ay > of_y) != (by > of_y) and of_x < ax + (of_y - ay) * (bx - ax) / (by - ay):
            inside = not inside
        beside = max(ax, bx) < low_x or min(ax, bx) > high_x
        if beside or max(ay, by) < low_y or min(ay, by) > high_y:
            continue
        # All corners of the box on one side of the line: it passes by.
        nx, ny = by - ay, ax - bx
        middle = nx * (0.5 * (low_x + high_x) - ax) + ny * (0.5 * (low_y + high_y) - ay)
        reach = 0.5 * (abs(nx) * (high_x - low_x) + abs(ny) * (high_y - low_y))
        if abs(middle) > reach + 1e-9:
            continue
        sense = 1.0 if middle > 0.0 else -1.0
        way = sense * (nx * way_x + ny * way_y)
        least = min(0.0, way) - 1e-9
        for q in range(swept.shape[0]):
            if sense * (nx * (swept[q, 0] - ax) + ny * (swept[q, 1] - ay)) + least <= 0.0:
                return False
    return inside


class Geofence:
    """Whether a machine whose position is uncertain stays where it may be.

    The hull of the machine's outline is swept by its travel within a horizon and by the ellipse of
    `sigmas` standard deviations. STOP where the sweep of `stop_s` leaves the permitted area or
    touches a keep-out; SLOW where the sweep of `slow_s`, wider by `slow_m`, does. Pure: the same
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
        self._permitted = areas.permitted
        self._border = areas.permitted.exterior
        self._keep_outs = shapely.MultiPolygon(areas.keep_outs)
        self.sigmas = sigmas
        self._stop_s, self._slow_s, self._slow_m = stop_s, slow_s, slow_m
        for geometry in (self._permitted, self._border, self._keep_outs):
            shapely.prepare(geometry)
        rings = [self._border, *self._permitted.interiors]
        for keep_out in self._keep_outs.geoms:
            rings += [keep_out.exterior, *keep_out.interiors]
        corners = [shapely.get_coordinates(ring) for ring in rings]
        self._sides = np.concatenate([np.hstack([c[:-1], c[1:]]) for c in corners])

    def check(
        self,
        outline: NDArray[np.float64],
        covariance: NDArray[np.float64],
        velocity: tuple[float, float] = (0.0, 0.0),
    ) -> Verdict:
        """`outline`: (n, 2) corners of the machine in the field frame, m; their hull counts.
        `covariance`: (2, 2) of the position, m², or (n, 2, 2) of each corner, which a direction
        that is not known moves the more the farther out it is; NaN or infinite where there is none.
        `velocity`: m/s, field frame."""
        each = covariance if covariance.ndim == 3 else covariance[np.newaxis]
        if _sweep_is_free(
            self._sides, outline, each, _OCTAGON, self.sigmas, self._slow_m,
            velocity[0] * self._slow_s, velocity[1] * self._slow_s,
        ):  # fmt: skip
            return CLEAR
        xx, xy, yy = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
        root = xx * yy - xy * xy
        if not np.isfinite(root + xx + yy).all():
            return Verdict(Level.STOP, "the position is unknown", math.nan)
        # The symmetric square root of 2x2 matrices in closed form.
        root = np.sqrt(np.maximum(0.0, root))
        spread = np.sqrt(np.maximum(0.0, xx + yy + 2 * root))
        scale = np.divide(self.sigmas, spread, out=np.zeros_like(spread), where=spread > 0)
        half = np.stack([xx + root, xy, xy, yy + root], axis=-1) * scale[..., np.newaxis]
        half = half.reshape(*spread.shape, 2, 2)
        ellipse = _OCTAGON @ half
        wide = ellipse + self._slow_m * _OCTAGON
        if self._inside(outline, wide, velocity, self._slow_s):
            return CLEAR
        clearance = self._clearance(outline)
        level = Level.SLOW
        if not self._inside(outline, ellipse, velocity, self._stop_s):
            level = Level.STOP
        where = f"{clearance:.1f} m to" if clearance >= 0 else "beyond"
        keep_out = self._nearest_keep_out(outline)
        nearest = "the permitted area's border" if keep_out is None else f"keep-out {keep_out + 1}"
        reason = (
            f"geofence: {where} {nearest}, "
            f"position known to {np.linalg.norm(half, 2, axis=(-2, -1)).max():.1f} m"
        )
        return Verdict(level, reason, clearance, keep_out is not None)

    def clearance(self, outline: NDArray[np.float64]) -> float:
        """Metres from an outline to the permitted area's border or the nearest keep-out, negative
        beyond; for choosing between manoeuvres before one is driven."""
        return self._clearance(outline)

    def _inside(
        self,
        outline: NDArray[np.float64],
        around: NDArray[np.float64],
        velocity: tuple[float, float],
        horizon_s: float,
    ) -> bool:
        swept = (outline[:, None, :] + around).reshape(-1, 2)
        if velocity != (0.0, 0.0):
            way = (velocity[0] * horizon_s, velocity[1] * horizon_s)
            swept = np.concatenate([swept, swept + way])
        # The box around the sweep is a tenth of the work, and mostly enough.
        if self._free(shapely.box(*swept.min(axis=0), *swept.max(axis=0))):
            return True
        return self._free(shapely.convex_hull(shapely.linestrings(swept)))

    def _free(self, shape: shapely.Geometry) -> bool:
        return bool(self._permitted.contains_properly(shape)) and not bool(
            self._keep_outs.intersects(shape)
        )

    def _clearance(self, outline: NDArray[np.float64]) -> float:
        """Negative: how far the furthest corner is beyond, or how deep in a keep-out."""
        shape = shapely.convex_hull(shapely.linestrings(outline))
        border = float(self._border.distance(shape))
        if not self._permitted.contains(shape):
            corners = shapely.points(outline)
            beyond = shapely.distance(self._permitted, corners)
            border = -float(beyond.max())
        if self._keep_outs.is_empty:
            return border
        if self._keep_outs.intersects(shape):
            overlap = self._keep_outs.intersection(shape)
            return min(border, -math.sqrt(float(overlap.area)))
        return min(border, float(self._keep_outs.distance(shape)))

    def _nearest_keep_out(self, outline: NDArray[np.float64]) -> int | None:
        """The one that the machine would touch first; None where the border is nearer."""
        shape = shapely.convex_hull(shapely.linestrings(outline))
        distances = [float(keep_out.distance(shape)) for keep_out in self._keep_outs.geoms]
        if distances and min(distances) <= float(self._border.distance(shape)):
            return distances.index(min(distances))
        return None
