"""The field: what stands where on a grid, and what of it has been cut.

Field frame: x east, y north, metres; grids are indexed [row j along y, column i along x] with cell
(0, 0) at `Field.origin`. The cut is judged by cell centres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray

from sim_plant import ground, noise
from sim_plant.blade import cut_between
from sim_plant.field_spec import FieldSpec, Point, Side
from sim_plant.ground import CROP, GRASS, NEIGHBOUR, OBSTACLE, SOIL, STUBBLE, TRUNK

FLAT_RAD = 1.2
"""Tilt of crop that lies: stalks rest on each other and never lie quite flat."""


class Figures(NamedTuple):
    """What compiled loops need of a field besides its grid: lengths in m, angles in degrees."""

    seed: int
    x_m: float
    """Of the grid's origin."""
    y_m: float
    cell_m: float
    bumps_1pm: float
    bump_deg: float
    side_slope_deg: float
    long_slope_deg: float
    beside_m: float
    """Where the straw is laid: so far beside the blade,"""
    straw_m: float
    """and so wide."""


@dataclass(slots=True)
class Box:
    """Half-open range of cells [j0, j1) x [i0, i1); empty while j0 >= j1."""

    j0: int = 1 << 30
    j1: int = 0
    i0: int = 1 << 30
    i1: int = 0

    def add(self, j0: int, j1: int, i0: int, i1: int) -> None:
        """Grows to hold another range."""
        self.j0 = min(self.j0, j0)
        self.j1 = max(self.j1, j1)
        self.i0 = min(self.i0, i0)
        self.i1 = max(self.i1, i1)

    @property
    def empty(self) -> bool:
        """Whether it holds no cell."""
        return self.j0 >= self.j1 or self.i0 >= self.i1


class Watch:
    """What has changed in a field since the watcher last asked; see `Field.watch`."""

    def __init__(self, kind: NDArray[np.uint8]) -> None:
        self._kind = kind
        self.box = Box()

    def take(self) -> tuple[int, int, NDArray[np.uint8]] | None:
        """(j0, i0, copy of the changed cells' kinds), or None where nothing changed."""
        box, self.box = self.box, Box()
        if box.empty:
            return None
        return box.j0, box.i0, self._kind[box.j0 : box.j1, box.i0 : box.i1].copy()


@njit(cache=True, nogil=True)
def _nearest_edges(
    corners: NDArray[np.float64],
    rows: int,
    columns: int,
    x0: float,
    y0: float,
    cell: float,
    wobble_m: float,
    seed: int,
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Signed distance of every cell centre to the polygon (positive inside) and its nearest edge.

    `corners` is (n, 2), counter-clockwise. The wobble displaces the outline along its normal."""
    n = corners.shape[0]
    distance = np.empty((rows, columns), np.float32)
    edge = np.empty((rows, columns), np.uint8)
    for j in range(rows):
        y = y0 + (j + 0.5) * cell
        for i in range(columns):
            x = x0 + (i + 0.5) * cell
            best = 1e30
            inside = False
            for k in range(n):
                ax, ay = corners[k]
                bx, by = corners[(k + 1) % n]
                ux = bx - ax
                uy = by - ay
                t = ((x - ax) * ux + (y - ay) * uy) / (ux * ux + uy * uy)
                t = min(1.0, max(0.0, t))
                d = (x - ax - t * ux) ** 2 + (y - ay - t * uy) ** 2
                if d < best:
                    best = d
                    edge[j, i] = k
                if (ay > y) != (by > y) and x < ax + (y - ay) * ux / uy:
                    inside = not inside
            s = math.sqrt(best)
            if not inside:
                s = -s
            if wobble_m > 0.0 and abs(s) < 0.5:
                wave = noise.smooth(seed, x * 1.7, y * 1.7) + noise.smooth(seed + 1, x * 6, y * 6)
                s += wobble_m * (wave - 1.0) / 0.3
            distance[j, i] = s
    return distance, edge


@njit(cache=True, nogil=True)
def _lateral_edge(
    kind: NDArray[np.uint8],
    x0: float,
    y0: float,
    cell: float,
    x: float,
    y: float,
    yaw: float,
    reach: float,
    run: float,
) -> float:
    step = 0.2 * cell
    lx = -math.sin(yaw)
    ly = math.cos(yaw)
    standing = ground.kind_at(kind, x0, y0, cell, x, y) == CROP
    sign = -1.0 if standing else 1.0
    found = -1.0
    s = 0.0
    while s <= reach + run:
        px = x + sign * s * lx
        py = y + sign * s * ly
        here = ground.kind_at(kind, x0, y0, cell, px, py) == CROP
        if here != standing:
            if found < 0.0:
                found = s
            if s - found >= run:
                return sign * found
        else:
            found = -1.0
        s += step
    return math.nan


def _patches(
    seed: int, shape: tuple[int, int], cell_m: float, wave_m: float, share: float
) -> NDArray[np.float32]:
    """0..1, soft-edged blobs that cover about `share` of the area."""
    if share <= 0:
        return np.zeros(shape, np.float32)
    g = noise.smooth_grid(seed, shape[0], shape[1], cell_m, wave_m)
    threshold = np.quantile(g, 1.0 - share)
    return np.asarray(np.clip((g - threshold) * 12.0 + 0.5, 0.0, 1.0), np.float32)


class Field:
    """The grids of one field. Deterministic by (spec, seed); changed by `cut` alone.

    `kind` (rows, columns) uint8 at `cell` metres; the attributes at `coarse` = 2 cells: `height`
    (standing crop's height, m), `green`, `density`, `tone` (0..1), `lodge` (tilt, rad).
    """

    def __init__(self, spec: FieldSpec, seed: int = 0) -> None:
        self.spec = spec
        self.seed = seed
        self.cell = spec.cell_m
        boundary = spec.boundary
        margin = spec.gap_m + spec.neighbour_depth_m
        lo_x, lo_y, hi_x, hi_y = boundary.bounds
        block = 2 * self.cell
        columns = 2 * math.ceil((hi_x - lo_x + 2 * margin) / block)
        rows = 2 * math.ceil((hi_y - lo_y + 2 * margin) / block)
        self.origin: Point = (lo_x - margin, lo_y - margin)
        self.coarse = block
        half = (rows // 2, columns // 2)

        corners = np.array(boundary.exterior.coords[:-1], np.float64)
        x0, y0 = self.origin
        inward, edge = _nearest_edges(
            corners, rows, columns, x0, y0, self.cell, spec.edge_wobble_m, seed + 11
        )
        ground = _patches(seed + 23, half, block, 0.8, spec.grass) > 0.5
        self.kind: NDArray[np.uint8] = np.where(
            np.repeat(np.repeat(ground, 2, 0), 2, 1), np.uint8(GRASS), np.uint8(SOIL)
        )
        self.kind[inward > 0] = CROP
        beyond = inward < -spec.gap_m
        if spec.neighbours == "none":
            beyond[:] = False
        elif spec.neighbours != "all":
            sides = [self._side(corners, k) for k in range(len(corners))]
            beyond &= np.isin(edge, [k for k, s in enumerate(sides) if s in spec.neighbours])
        self.kind[beyond] = NEIGHBOUR

        wave = spec.patch_m
        level = noise.smooth_grid(seed + 31, *half, block, 2.5) - np.float32(0.5)
        self.height: NDArray[np.float32] = (
            spec.crop_height_m + spec.crop_height_sd_m * level / np.float32(0.16)
        ).astype(np.float32)
        self.height[beyond[::2, ::2]] *= np.float32(spec.neighbour_height)
        self.green = _patches(seed + 41, half, block, wave, spec.green)
        self.density = 1 - 0.65 * _patches(seed + 51, half, block, wave, spec.thin)
        lodged = _patches(seed + 61, half, block, 1.6 * wave, spec.lodged)
        self.lodge: NDArray[np.float32] = (FLAT_RAD * lodged).astype(np.float32)
        self.height *= np.cos(self.lodge)
        self.weed = _patches(seed + 71, half, block, 0.35 * wave, spec.weeds)
        self.tone = noise.smooth_grid(seed + 81, *half, block, 1.1)
        bare = _patches(seed + 91, half, block, 0.4 * wave, spec.bare) > 0.5
        self.kind[np.repeat(np.repeat(bare, 2, 0), 2, 1) & (self.kind == CROP)] = SOIL
        self.tallest_crop_m = float(self.height.max())
        self.obstacles = self._place_obstacles()

        self.figures = Figures(
            seed, float(x0), float(y0), self.cell, 1.0 / spec.bump_m, spec.bump_sd_deg / 0.18,
            spec.side_slope_deg, spec.long_slope_deg, *spec.windrow_m,
        )  # fmt: skip
        self._initial = int(np.count_nonzero(self.kind == CROP))
        self.counts: NDArray[np.int64] = np.zeros(2, np.int64)
        """Cells cut of the field's own crop, and of the neighbours'."""
        self._box = np.zeros(4, np.int64)
        self._watches: list[Watch] = []

    @staticmethod
    def _side(corners: NDArray[np.float64], k: int) -> Side:
        dx, dy = corners[(k + 1) % len(corners)] - corners[k]
        if abs(dx) >= abs(dy):
            return "south" if dx > 0 else "north"
        return "east" if dy > 0 else "west"

    def _place_obstacles(self) -> tuple[shapely.Polygon, ...]:
        """Marks houses, trunks and keep-outs in `kind` and their heights in `height`."""
        placed = [(shapely.Polygon(k), OBSTACLE, 0.0) for k in self.spec.keep_outs]
        for t in self.spec.trees:
            trunk = shapely.Point(t.x_m, t.y_m).buffer(max(t.trunk_radius_m, self.coarse))
            placed.append((trunk, TRUNK, t.height_m - t.crown_radius_m))
        for h in self.spec.houses:
            box = shapely.box(-h.width_m / 2, -h.depth_m / 2, h.width_m / 2, h.depth_m / 2)
            box = shapely.affinity.rotate(box, h.yaw_deg, origin=(0, 0))
            placed.append((shapely.affinity.translate(box, h.x_m, h.y_m), OBSTACLE, h.height_m))
        rows, columns = self.kind.shape
        for shape, kind, height in placed:
            lo_x, lo_y, hi_x, hi_y = shape.bounds
            j0, i0 = (max(k, 0) for k in self._index(lo_x, lo_y))
            j1, i1 = self._index(hi_x, hi_y)
            # What stands beyond the grid is seen, and marks nothing.
            j, i = np.mgrid[j0 : max(j0, min(j1 + 1, rows)), i0 : max(i0, min(i1 + 1, columns))]
            x = self.origin[0] + (i + 0.5) * self.cell
            y = self.origin[1] + (j + 0.5) * self.cell
            hit = shapely.contains_xy(shape, x, y)
            self.kind[j[hit], i[hit]] = kind
            self.height[j[hit] // 2, i[hit] // 2] = height
        return tuple(shape for shape, _, _ in placed)

    def _index(self, x: float, y: float) -> tuple[int, int]:
        return (
            math.floor((y - self.origin[1]) / self.cell),
            math.floor((x - self.origin[0]) / self.cell),
        )

    def watch(self) -> Watch:
        """A new watcher, which sees every change from now on."""
        watch = Watch(self.kind)
        self._watches.append(watch)
        return watch

    def kind_at(self, x: float, y: float) -> int:
        """Kind of the cell that holds the point; SOIL outside the grid."""
        return ground.kind_at(self.kind, *self.origin, self.cell, x, y)

    # ---- the blade ------------------------------------------------------------------------------

    def cut(
        self,
        old: tuple[float, float, float],
        new: tuple[float, float, float],
        *,
        ahead_m: float = 1.5,
        width_m: float = 1.0,
    ) -> int:
        """The blade spins while the vehicle moves between two poses (x, y, yaw of the rear axle).

        `ahead_m` is the blade's line ahead of the rear axle. Poses further apart than a few
        centimetres or degrees should be split by the caller: the path between is taken as straight.
        Returns the number of cells cut, the neighbours' included.
        """
        cut = mow(self.figures, self.kind, old, new, ahead_m, width_m, self.counts, self._box)
        self.changed(*self._box.tolist())
        return int(cut)

    def changed(self, j0: int, j1: int, i0: int, i1: int) -> None:
        """Tells the watchers of a range of cells, half-open; of none where j0 >= j1."""
        if j0 < j1:
            for w in self._watches:
                w.box.add(j0, j1, i0, i1)

    def clear(self, polygon: tuple[Point, ...]) -> None:
        """Cuts everything of the field's own crop within a polygon, as an earlier job left it."""
        shape = shapely.Polygon(polygon)
        rows, columns = self.kind.shape
        x = self.origin[0] + (np.arange(columns) + 0.5) * self.cell
        y = self.origin[1] + (np.arange(rows) + 0.5) * self.cell
        hit = shapely.contains_xy(shape, *np.meshgrid(x, y)) & (self.kind == CROP)
        self.kind[hit] = STUBBLE
        self.counts[0] += int(np.count_nonzero(hit))
        self.changed(0, rows, 0, columns)

    # ---- truth ----------------------------------------------------------------------------------

    def coverage(self) -> float:
        """Share of the crop's area that was cut."""
        return float(self.counts[0] / self._initial) if self._initial else 1.0

    def missed_m2(self) -> float:
        """The field's own crop that still stands."""
        return float((self._initial - self.counts[0]) * self.cell**2)

    def neighbour_cut_m2(self) -> float:
        """The neighbours' crop that was cut."""
        return float(self.counts[1] * self.cell**2)

    def true_edge_offset(self, x: float, y: float, yaw: float, reach_m: float = 3.0) -> float:
        """Signed distance (m) from a point along its lateral direction (left positive) to the edge
        of the field's own standing crop, the crop being on the left.

        Positive where the point is off the crop and the edge lies to its left; negative where the
        point is in the crop and the edge lies to its right. Interruptions under 0.2 m do not count.
        NaN where there is no edge within `reach_m`.
        """
        return float(_lateral_edge(self.kind, *self.origin, self.cell, x, y, yaw, reach_m, 0.2))

    def crop_ahead(
        self, x: float, y: float, yaw: float, width_m: float = 1.0, reach_m: float = 20.0
    ) -> float:
        """Distance (m) from a point straight ahead to the field's own standing crop, seen over the
        width by nine probes; inf where none stands within `reach_m`."""
        ahead, standing = self._probe(x, y, yaw, width_m, reach_m)
        first = np.flatnonzero(standing.any(axis=0))
        return float(ahead[first[0]]) if first.size else math.inf

    def share_ahead(self, x: float, y: float, yaw: float, width_m: float, reach_m: float) -> float:
        """Share of a rectangle before a point that the field's own standing crop takes."""
        return float(self._probe(x, y, yaw, width_m, reach_m)[1].mean())

    def _probe(
        self, x: float, y: float, yaw: float, width_m: float, reach_m: float
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """(n,) distances ahead and (9, n) whether the field's own crop stands there."""
        ahead = np.arange(0.0, reach_m, 0.5 * self.cell)
        lateral = np.linspace(-width_m / 2, width_m / 2, 9)[:, None]
        px = x + ahead * math.cos(yaw) - lateral * math.sin(yaw)
        py = y + ahead * math.sin(yaw) + lateral * math.cos(yaw)
        i = np.floor((px - self.origin[0]) / self.cell).astype(int)
        j = np.floor((py - self.origin[1]) / self.cell).astype(int)
        ok = (i >= 0) & (j >= 0) & (i < self.kind.shape[1]) & (j < self.kind.shape[0])
        return ahead, ok & (self.kind[j * ok, i * ok] == CROP)

    def permitted(self, margin_m: float = 0.0) -> shapely.Polygon:
        """Where any part of the vehicle may be: field and gap up to the neighbours' crop less a
        margin, without the obstacles. (Sides without a neighbour count alike.)"""
        area = self.spec.boundary.buffer(self.spec.gap_m - margin_m, join_style="mitre")
        return area.difference(shapely.unary_union(self.obstacles)) if self.obstacles else area

    def under_trees(self, x: float, y: float) -> bool:
        """Whether a tree's crown covers a point: what takes GNSS fixes away."""
        return any(math.hypot(x - t.x_m, y - t.y_m) < t.crown_radius_m for t in self.spec.trees)

    def slopes(self, x: float, y: float, yaw: float) -> tuple[float, float]:
        """(roll, pitch) of the vehicle on this ground against the vertical, radians: roll positive
        clockwise seen from behind, pitch positive nose down."""
        return slopes_at(self.figures, x, y, yaw)

    def bumps(self, x: float, y: float, yaw: float) -> tuple[float, float]:
        """The same against the field's plane: what a camera sees of it. On a slope the ground
        before the vehicle slopes, too."""
        return bumps_at(self.figures, x, y, yaw)


@njit(cache=True, nogil=True)
def slopes_at(f: Figures, x: float, y: float, yaw: float) -> tuple[float, float]:
    """`Field.slopes`."""
    side, long = _bumps(f, x, y)
    return _tipped(f.side_slope_deg + side, f.long_slope_deg + long, yaw)


@njit(cache=True, nogil=True)
def bumps_at(f: Figures, x: float, y: float, yaw: float) -> tuple[float, float]:
    """`Field.bumps`."""
    side, long = _bumps(f, x, y)
    return _tipped(side, long, yaw)


@njit(cache=True, nogil=True)
def _bumps(f: Figures, x: float, y: float) -> tuple[float, float]:
    """How much more than the plane the ground rises there to the north and to the east, degrees."""
    k, sd = f.bumps_1pm, f.bump_deg
    side = sd * (noise.smooth(f.seed + 101, x * k, y * k) - 0.5)
    return side, sd * (noise.smooth(f.seed + 102, x * k, y * k) - 0.5)


@njit(cache=True, nogil=True)
def _tipped(side: float, long: float, yaw: float) -> tuple[float, float]:
    """(roll, pitch), radians, of a vehicle on ground that rises by so many degrees to the north and
    to the east."""
    c, s = math.cos(yaw), math.sin(yaw)
    up = math.radians(long) * c + math.radians(side) * s
    left_up = -math.radians(long) * s + math.radians(side) * c
    return left_up, -up


@njit(cache=True, nogil=True)
def mow(
    f: Figures,
    kind: NDArray[np.uint8],
    old: tuple[float, float, float],
    new: tuple[float, float, float],
    ahead_m: float,
    width_m: float,
    counts: NDArray[np.int64],
    box: NDArray[np.int64],
) -> int:
    """`Field.cut`; `box` (4,) becomes the cells that changed: j0, j1, i0, i1, half-open."""
    return cut_between(
        kind, f.x_m, f.y_m, f.cell_m, old, new, ahead_m, width_m, f.beside_m, f.straw_m, f.seed,
        counts, box,
    )  # fmt: skip
