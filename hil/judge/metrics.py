"""Figures of merit from the simulated truth; one meaning everywhere.

Nothing here reaches the host."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass, field

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray

from hil.scenario.world import MARGIN_M, World, outline_of, placed
from host.estimate.crop_ahead import EndOfField
from host.pilot.phase import Phase
from host.pilot.pilot import Pilot
from sim_plant.field import Field

OVERLAP_M = 0.08
"""How far outside the crop's edge the blade's right end is to run, so that no sliver stays."""
PROBE_AHEAD_M = 0.1
"""The true edge is read this far before the blade, where the crop still stands."""
GOES_ON_M = 0.2
"""Only an edge that goes on so much farther is one that the blade's end has to keep to. At the
field's end the crop's last row is ragged (`FieldSpec.edge_wobble_m`, some centimetres), and what
stands beside the blade's end there is that row's border: a machine on its lane seemed to be 0.27 m
off the edge."""
FALSE_END_M = 0.5
"""An end was none where the field's crop still stands this far beyond it,"""
FALSE_END_SHARE = 0.1
"""on at least this share of the next half metre: not a sliver that a swath before has left."""


def depth_m(outline: shapely.Polygon, keep_out: shapely.Polygon) -> float:
    """How deep the machine's outline stands in a keep-out, or a smaller keep-out in the machine; 0
    where they do not touch."""
    if not keep_out.intersects(outline):
        return 0.0
    corners = shapely.points(shapely.get_coordinates(outline.intersection(keep_out)))
    borders = (keep_out.exterior, outline.exterior)
    return max(float(shapely.distance(border, corners).max()) for border in borders)


def _rings(area: shapely.Geometry) -> list[shapely.LinearRing]:
    polygons = [area] if isinstance(area, shapely.Polygon) else list(area.geoms)
    return [ring for polygon in polygons for ring in (polygon.exterior, *polygon.interiors)]


def _sides(ring: shapely.LinearRing) -> NDArray[np.float64]:
    """(n, 4) of a ring's sides: x, y, x, y."""
    corners = shapely.get_coordinates(ring)
    return np.hstack([corners[:-1], corners[1:]])


@njit(cache=True, nogil=True)
def room_m(sides: NDArray[np.float64], x: float, y: float) -> float:
    """Distance from a point to the nearest of (n, 4) sides; 0 outside the rings that they form, as
    far as they do not overlap."""
    nearest = math.inf
    inside = False
    for k in range(sides.shape[0]):
        ax, ay, bx, by = sides[k]
        ux, uy = bx - ax, by - ay
        long2 = ux * ux + uy * uy
        share = 0.0
        if long2 > 0.0:
            share = min(1.0, max(0.0, ((x - ax) * ux + (y - ay) * uy) / long2))
        nearest = min(nearest, math.hypot(x - ax - share * ux, y - ay - share * uy))
        if (ay > y) != (by > y) and x < ax + (y - ay) * ux / uy:
            inside = not inside
    return nearest if inside else 0.0


@dataclass
class Truth:
    """Follows one run. Poses are (x, y, yaw) of the rear axle in the field frame."""

    world: World
    crop: Field
    path: list[tuple[float, float, float, float, Phase]] = field(default_factory=list)
    """(t, x, y, yaw, phase)."""
    lateral: list[float] = field(default_factory=list)
    ends: list[float] = field(default_factory=list)
    false_ends: int = 0
    outside_m: float = 0.0
    put_outside_m: float = 0.0
    """How far outside it was already where it was put down."""
    keep_out_m: float = 0.0

    def __post_init__(self) -> None:
        self._permitted = self.crop.permitted(MARGIN_M)
        self._keep_outs = [shapely.Polygon(ring) for ring in self.crop.spec.keep_outs]
        for shape in (self._permitted, *self._keep_outs):
            shapely.prepare(shape)
        self._outline = outline_of(self.world.machine)
        rear, _, front, _ = self._outline.bounds
        self._middle = (rear + front) / 2
        corners = shapely.get_coordinates(self._outline) - (self._middle, 0.0)
        self._radius = float(np.hypot(*corners.T).max())
        rings = [*_rings(self._permitted), *(k.exterior for k in self._keep_outs)]
        self._borders = np.concatenate([_sides(ring) for ring in rings])
        self._travelled = 0.0
        self._last_cut_at = 0.0
        self._travel: list[tuple[float, float, float, float, float, float]] = []
        self._ends_seen = 0

    def step(
        self, t: float, pose: tuple[float, float, float], cut_cells: int, pilot: Pilot
    ) -> None:
        """One look, at the host's rate."""
        x, y, yaw = pose
        if self.path:
            _, px, py, _, _ = self.path[-1]
            along = (x - px) * math.cos(yaw) + (y - py) * math.sin(yaw)
            self._travelled += along
        self.path.append((t, x, y, yaw, pilot.phase))
        if cut_cells:
            self._last_cut_at = self._travelled
        self._travel.append((t, self._travelled, self._last_cut_at, x, y, yaw))
        c, s = math.cos(yaw), math.sin(yaw)
        if room_m(self._borders, x + self._middle * c, y + self._middle * s) < self._radius:
            self._near_border(placed(self._outline, x, y, yaw))
        if len(self.path) == 1:
            self.put_outside_m = self.outside_m
        if pilot.phase is Phase.FOLLOW and cut_cells:
            offset = self.edge_offset(pose)
            if math.isfinite(offset) and math.isfinite(self.edge_offset(pose, GOES_ON_M)):
                self.lateral.append(offset - OVERLAP_M)
        while self._ends_seen < len(pilot.ends):
            self._end(pilot.ends[self._ends_seen])
            self._ends_seen += 1

    def _near_border(self, outline: shapely.Polygon) -> None:
        if not self._permitted.contains(outline):
            beyond = outline.difference(self._permitted)
            if not beyond.is_empty:
                points = shapely.get_coordinates(beyond)
                worst = float(shapely.distance(shapely.points(points), self._permitted).max())
                self.outside_m = max(self.outside_m, worst)
        for keep_out in self._keep_outs:
            self.keep_out_m = max(self.keep_out_m, depth_m(outline, keep_out))

    def edge_offset(self, pose: tuple[float, float, float], farther_m: float = 0.0) -> float:
        """How far the true edge lies left of the blade's right end (the overlap, when on the lane),
        or of where that will be `farther_m` straight on; NaN where there is none."""
        x, y, yaw = pose
        v = self.world.machine
        ahead, right = v.blade_x_m + PROBE_AHEAD_M + farther_m, -v.blade_width_m / 2
        bx = x + ahead * math.cos(yaw) - right * math.sin(yaw)
        by = y + ahead * math.sin(yaw) + right * math.cos(yaw)
        return self.crop.true_edge_offset(bx, by, yaw, 0.6)

    def _end(self, end: EndOfField) -> None:
        """Signed distance from the last crop cut to where the end was declared."""
        index = bisect.bisect_left(self._travel, (end.stamp,))
        before = max(0, index - 1)
        if index == len(self._travel) or end.stamp - self._travel[before][0] <= (
            self._travel[index][0] - end.stamp
        ):
            index = before
        _, travelled, last_cut_then, x, y, yaw = self._travel[index]
        last_cut = max(last_cut_then, self._last_cut_at)
        self.ends.append(travelled - last_cut)
        v = self.world.machine
        beyond = v.blade_x_m + FALSE_END_M
        bx, by = x + beyond * math.cos(yaw), y + beyond * math.sin(yaw)
        share = self.crop.share_ahead(bx, by, yaw, 0.6 * v.blade_width_m, 0.5)
        if share >= FALSE_END_SHARE:
            self.false_ends += 1

    def summary(self) -> dict[str, float | int | None]:
        """The keys of summary.json that the truth decides; None where nothing was measured."""
        lateral = np.array(self.lateral)
        ends = np.array(self.ends)

        def figure(value: float) -> float:
            return round(float(value), 4)

        return {
            "coverage": figure(self.crop.coverage()),
            "missed_m2": figure(self.crop.missed_m2()),
            "neighbour_cut_m2": figure(self.crop.neighbour_cut_m2()),
            "outside_m": figure(self.outside_m),
            "put_outside_m": figure(self.put_outside_m),
            "keep_out_m": figure(self.keep_out_m),
            "lateral_rms_m": figure(np.sqrt(np.mean(lateral**2))) if lateral.size else None,
            "lateral_p95_m": figure(np.percentile(np.abs(lateral), 95)) if lateral.size else None,
            "lateral_mean_m": figure(lateral.mean()) if lateral.size else None,
            "end_of_field_error_median_m": figure(np.median(ends)) if ends.size else None,
            "end_of_field_error_worst_m": figure(ends[np.argmax(np.abs(ends))])
            if ends.size
            else None,
            "false_ends": self.false_ends,
        }
