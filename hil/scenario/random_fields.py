"""Random fields: what a season may bring, one scenario per seed.

A drawn field is one that its machine can be expected to harvest: its area, sides, corners and
narrowest place lie within the limits below, and a keep-out leaves the machine room on all sides.
What lies beyond them the preview warns of before anything moves. Lengths are for a machine of the
default size, and grow with another's (`machine_size`).
"""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import affinity

from hil.scenario.drawn import Drawn
from hil.scenario.drawn_machine import drawn_gyro, drawn_lens, drawn_machine
from hil.scenario.scenario import Scenario
from hil.scenario.world import Start
from sim_plant.field_spec import FieldSpec, Point, Tree
from sim_plant.gnss import GnssSpec
from sim_plant.machine import MachineSpec
from sim_plant.sky import WeatherSpec

Shape = Literal["rectangle", "trapezoid", "L", "irregular"]
SHAPES: Final[tuple[Shape, ...]] = ("rectangle", "trapezoid", "L", "irregular")
Ring = tuple[Point, ...]

AREA_M2: Final = (100.0, 250.0)
"""Small, so that hundreds run in a night."""
MIN_SIDE_M: Final = 3.0
"""Twice the way from the rear axle to the blade: a shorter side ends before the machine is in line
with it."""
MIN_NECK_M: Final = 3.5
"""Between sides that do not meet."""
CONVEX_DEG: Final = (50.0, 155.0)
"""Inside a corner. A sharper one needs more than a gap of 2 m for the turn, a blunter one bends the
edge by less than the filter takes for the same edge."""
REFLEX_DEG: Final = (205.0, 280.0)
"""Inside angle of a corner that points inwards."""
GAP_M: Final = (1.5, 3.0)
"""To the neighbours' crop. A turn takes up to 1.4 m of it (docs/understand/navigation.md), and with
less than 1.5 m a machine of the default size often cannot be put down at a corner."""
KEEP_OUT_SHARE: Final = 0.5
"""Of the fields that have a pole or a tree."""
NEIGHBOUR_HEIGHT: Final = (0.85, 1.15)
"""Of the neighbours' crop, times the field's: another sort, or sown at another time."""
KEEP_OUT_M: Final = (0.4, 0.8)
"""Across: a pole, a tree with its roots, a well."""
KEEP_OUT_FREE_M: Final = 3.5
"""From a keep-out to the boundary."""
KEEP_OUT_MIN_M2: Final = 190.0
"""In a smaller field, what has to stay standing around a keep-out is too large a part."""


# ---- shapes --------------------------------------------------------------------------------------


def corner_angles_deg(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) angles inside the corners of a counter-clockwise ring (n, 2)."""
    sides = np.roll(ring, -1, axis=0) - ring
    headings = np.arctan2(sides[:, 1], sides[:, 0])
    turns = (headings - np.roll(headings, 1) + math.pi) % math.tau - math.pi
    angles: NDArray[np.float64] = 180.0 - np.degrees(turns)
    return angles


def neck_m(ring: NDArray[np.float64]) -> float:
    """The narrowest place: the least distance between two sides that share no corner."""
    count = len(ring)
    sides = [shapely.LineString([ring[k], ring[(k + 1) % count]]) for k in range(count)]
    apart = [
        sides[a].distance(sides[b])
        for a in range(count)
        for b in range(a + 2, count)
        if (a, b) != (0, count - 1)
    ]
    return min(apart, default=math.inf)


def machine_size(machine: MachineSpec) -> float:
    """The blade's line ahead of the rear axle, as a share of the default machine's, where that is
    longer: turns, sides and passages need so much more."""
    return max(1.0, machine.blade_x_m / MachineSpec().blade_x_m)


def good(ring: NDArray[np.float64], size: float = 1.0) -> bool:
    """Whether a machine of this size can turn at every corner, follow every side and pass
    everywhere."""
    polygon = shapely.Polygon(ring)
    if not polygon.is_valid or not polygon.exterior.is_ccw:
        return False
    lengths = np.hypot(*(np.roll(ring, -1, axis=0) - ring).T)
    angles = corner_angles_deg(ring)
    convex = (angles >= CONVEX_DEG[0]) & (angles <= CONVEX_DEG[1])
    reflex = (angles >= REFLEX_DEG[0]) & (angles <= REFLEX_DEG[1])
    return bool(
        lengths.min() >= MIN_SIDE_M * size
        and (convex | reflex).all()
        and neck_m(ring) >= MIN_NECK_M * size
        and AREA_M2[0] <= polygon.area <= AREA_M2[1]
    )


def _drawn(rng: np.random.Generator, shape: Shape, count: int) -> NDArray[np.float64]:
    """A counter-clockwise ring of the shape, of any size; `count` corners where it is irregular."""
    ratio = rng.uniform(0.5, 2.0)
    if shape == "rectangle":
        return np.array([(0, 0), (ratio, 0), (ratio, 1), (0, 1)], float)
    if shape == "trapezoid":
        left, right = rng.uniform(0.0, 0.3, 2) * ratio
        return np.array([(0, 0), (ratio, 0), (ratio - right, 1), (left, 1)], float)
    if shape == "L":
        across, up = rng.uniform(0.35, 0.65, 2)
        x, y = ratio * across, up
        return np.array([(0, 0), (ratio, 0), (ratio, y), (x, y), (x, 1), (0, 1)], float)
    angles = (np.arange(count) + rng.uniform(-0.4, 0.4, count)) * math.tau / count
    ring = np.column_stack([ratio * np.cos(angles), np.sin(angles)])
    if rng.random() < 0.5:
        dent = int(rng.integers(count))
        ring[dent] *= rng.uniform(0.3, 0.8)
    return ring


def outline(rng: np.random.Generator, shape: Shape, size: float) -> Ring:
    """Corners (m, to the centimetre) of a field for a machine of this size, counter-clockwise,
    lying anyhow."""
    count = int(rng.integers(5, 10))
    while True:
        ring = _drawn(rng, shape, count)
        area = float(shapely.Polygon(ring).area)
        ring *= math.sqrt(rng.uniform(*AREA_M2) / area)
        turn = rng.uniform(0, math.tau)
        c, s = math.cos(turn), math.sin(turn)
        ring = ring @ np.array([[c, s], [-s, c]])
        ring = np.round(ring - ring.min(axis=0), 2)
        if good(ring, size):
            return tuple((float(x), float(y)) for x, y in ring)


def keep_out(rng: np.random.Generator, ring: Ring, size: float) -> Ring | None:
    """Corners of one that stands in a field, as it would be walked; None where there is no room for
    a machine of this size."""
    inside = shapely.Polygon(ring).buffer(-KEEP_OUT_FREE_M * size)
    across = rng.uniform(*KEEP_OUT_M)
    turn = rng.uniform(0, 90)
    places = rng.random((200, 2))
    if inside.is_empty:
        return None
    low_x, low_y, high_x, high_y = inside.bounds
    for u, v in places:
        x, y = low_x + u * (high_x - low_x), low_y + v * (high_y - low_y)
        half = across / 2
        square = affinity.rotate(shapely.box(x - half, y - half, x + half, y + half), turn)
        if inside.contains(square):
            return tuple((round(a, 2), round(b, 2)) for a, b in square.exterior.coords[:-1])
    return None


# ---- the whole scenario --------------------------------------------------------------------------


def _walked_around(drawn: Drawn, ring: Ring, size: float) -> tuple[Ring | None, tuple[Tree, ...]]:
    """A keep-out and what stands in it; the numbers are drawn whether there is one or not."""
    wanted = drawn.likely(KEEP_OUT_SHARE)
    walked = keep_out(drawn.rng, ring, size)
    if not wanted or shapely.Polygon(ring).area < KEEP_OUT_MIN_M2:
        walked = None
    height = drawn.within(3.0, 6.0)
    if not drawn.likely(0.5) or walked is None:
        return walked, ()
    x, y = np.mean(walked, axis=0).round(2).tolist()
    return walked, (Tree(x_m=x, y_m=y, height_m=height, crown_radius_m=0.3 * height),)


def _field(drawn: Drawn, ring: Ring, size: float) -> FieldSpec:
    walked, trees = _walked_around(drawn, ring, size)
    within = drawn.within
    return FieldSpec(
        polygon=ring,
        keep_outs=(walked,) if walked is not None else (),
        trees=trees,
        crop_height_m=within(0.8, 1.0),
        stalks_per_m2=within(250, 500),
        drilled=drawn.likely(0.3),
        edge_wobble_m=within(0.0, 0.03),
        weeds=within(0.0, 0.08),
        lodged=within(0.0, 0.05),
        thin=within(0.0, 0.08),
        green=within(0.0, 0.1),
        bare=within(0.0, 0.005),
        grass=within(0.0, 0.6),
        side_slope_deg=within(-2, 2),
        long_slope_deg=within(-2, 2),
        bump_sd_deg=within(0.2, 1.2),
    )


def _weather(drawn: Drawn) -> WeatherSpec:
    within = drawn.within
    return WeatherSpec(
        hour=within(9, 16),
        haze=within(0.001, 0.01),
        dust=within(0.0, 0.6),
        cloud=within(0.0, 1.0) if drawn.likely(0.5) else 0.0,
        wind_mps=within(0.0, 6.0),
        wind_from_deg=within(0, 360),
    )


def random_field(seed: int) -> Scenario:
    """The scenario of a seed: machine, camera, shape, keep-out, crop, slope, weather, hour,
    positions' error and how well the operator aligned the machine."""
    drawn = Drawn(seed, 0xF1E1D)
    machine = drawn_machine(seed)
    size = machine_size(machine)
    shape = SHAPES[int(drawn.rng.integers(len(SHAPES)))]
    ring = outline(drawn.rng, shape, size)
    field = _field(drawn, ring, size)
    weather = _weather(drawn)
    # Neighbours and phone have numbers of their own: one more changes no field.
    higher = Drawn(seed, 0xBA11E).within(*NEIGHBOUR_HEIGHT)
    gap = round(size * Drawn(seed, 0x6A9).within(*GAP_M), 3)
    field = field.model_copy(update={"neighbour_height": higher, "gap_m": gap})
    kit = Drawn(seed, 0xC0DE)
    camera = "mast" if drawn.likely(0.5) else "low"
    return Scenario(
        name=f"random {shape}" + (" with a keep-out" if field.keep_outs else ""),
        seed=seed,
        camera=camera,
        field=field,
        machine=machine,
        weather=weather,
        lens={
            "delay_s": kit.within(0.05, 0.25),
            **drawn_lens(seed, camera, machine),
            **_drawn_network(seed),
        },
        gnss=GnssSpec(
            cep_m=drawn.within(0.5, 2.5),
            antenna_x_m=kit.within(-0.2, 0.5),
            antenna_y_m=kit.within(-0.3, 0.3),
            smoothing_s=kit.within(0.0, 1.5),
            lag_s=kit.within(0.0, 0.8),
        ),
        gyro=drawn_gyro(kit),
        start=Start(
            corner=int(drawn.rng.integers(len(ring))),
            before_m=drawn.within(0.0, 0.5),
            lateral_error_m=drawn.within(-0.05, 0.05),
            heading_error_deg=drawn.within(-2, 2),
        ),
    )


def _drawn_network(seed: int) -> dict[str, float]:
    """How evenly a phone's pictures come, for `Scenario.lens`: from a phone beside the laptop to
    one on a mast whose Wi-Fi others share."""
    within = Drawn(seed, 0x31F1).within
    return {"jitter_s": within(0.0, 0.05), "stall_share": within(0.0, 0.03)}
