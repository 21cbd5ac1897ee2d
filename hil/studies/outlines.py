"""Outlines as farm programs export them: what the planner makes of shapes that nobody tuned it on.

The random fields of `hil.scenario.random_fields` have few corners and straight edges. An exported
outline has up to 160 points: edges that bend, corners that a tractor's track has rounded, tracks
that jitter, fields without any corner.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import affinity

from hil.scenario.random_fields import corner_angles_deg, neck_m, random_field
from hil.scenario.scenario import Scenario, changed
from host.core.errors import UserError
from host.core.vehicle import Vehicle
from host.field.areas import areas_of
from host.route.plan import Plan, spiral
from host.route.preview import preview

Kind = Literal["bent", "rounded", "jittered", "curved", "inner"]
KINDS: Final[tuple[Kind, ...]] = ("bent", "rounded", "jittered", "curved", "inner")
"""Edges that bend between real corners; corners rounded by the track of a tractor; points that err
by some decimetres; no corner at all; a real inner corner besides."""
Points = NDArray[np.float64]
"""(n, 2), metres."""

POINTS: Final = (10, 160)
AREA_HA: Final = (0.1, 60.0)
"""Drawn evenly by its logarithm."""
NECK_M: Final = 12.0
"""Least distance between edges that share no corner: room for a machine and its turns."""
CORNER_DEG: Final = (60.0, 150.0)
"""Inside a real corner."""
INNER_DEG: Final = (220.0, 280.0)
"""Inside a real inner corner."""
ROUND_M: Final = (2.0, 15.0)
"""Radius of a rounded corner: what a tractor with an implement drives."""
ROUND_STEP_DEG: Final = 15.0
"""Between the points of a rounded corner."""
JITTER_M: Final = 0.3
"""Standard deviation of a recorded point, along and across."""
JITTER_STEP_M: Final = 12.0
"""Least distance between recorded points: by less a jitter of this size is a corner."""
WANDER_DEG: Final = 4.0
"""Standard deviation of an edge's bend at a point, without what brings it back."""
GAP_M: Final = 2.0
"""To the neighbour's crop: the usual one."""
SMALL_M2: Final = (400.0, 900.0)
"""Of an outline that is driven: about an hour's work."""
TIME_S: Final = 7200.0
"""After which such a harvest is broken off: twice what it usually takes."""


@dataclass(frozen=True, slots=True)
class Outline:
    """A drawn outline."""

    seed: int
    kind: Kind
    ring: tuple[tuple[float, float], ...]
    """Counter-clockwise, metres, not closed."""

    @property
    def area_ha(self) -> float:
        """Hectares."""
        return float(shapely.Polygon(self.ring).area) / 1e4


@dataclass(frozen=True, slots=True)
class Planned:
    """What the planner made of one."""

    outline: Outline
    error: str
    """What it said instead of a plan; "" for a plan."""
    processor_s: float
    """To plan it, without the preview."""
    sides: int = 0
    shuttles: int = 0
    cutting_m: float = 0.0
    turning_m: float = 0.0
    stays: float = 0.0
    """Share of the field that the driven plan leaves."""

    @property
    def turning(self) -> float:
        """Metres of turning for each of cutting."""
        return self.turning_m / self.cutting_m if self.cutting_m else math.inf


def outline(seed: int) -> Outline:
    """The outline of a seed; kinds go by turns."""
    rng = np.random.default_rng([seed, 5])
    kind = KINDS[seed % len(KINDS)]
    while True:
        count = int(rng.integers(POINTS[0], POINTS[1] + 1))
        area_m2 = 1e4 * math.exp(rng.uniform(*np.log(AREA_HA)))
        ring = _curved(rng, count, area_m2) if kind == "curved" else _cornered(rng, kind, area_m2)
        if ring is None:
            continue
        if kind in ("bent", "inner"):
            ring = _bending(rng, ring, count)
        elif kind == "rounded":
            ring = _rounded(rng, ring)
        elif kind == "jittered":
            ring = _jittered(rng, ring, count)
        polygon = shapely.Polygon(ring)
        if (
            polygon.is_valid
            and len(ring) <= POINTS[1]
            and not polygon.buffer(-NECK_M / 2).is_empty
            and isinstance(polygon.buffer(-NECK_M / 2), shapely.Polygon)
        ):
            return Outline(seed, kind, tuple((float(x), float(y)) for x, y in ring))


def _scaled(ring: Points, area_m2: float) -> Points:
    return np.asarray(ring * math.sqrt(area_m2 / shapely.Polygon(ring).area))


def _cornered(rng: np.random.Generator, kind: Kind, area_m2: float) -> Points | None:
    """Four to seven real corners, one of them an inner one where the kind has it; None where the
    draw has others."""
    count = int(rng.integers(4, 8))
    angles = (np.arange(count) + rng.uniform(-0.3, 0.3, count)) * math.tau / count
    ring = np.column_stack([rng.uniform(1.0, 2.0) * np.cos(angles), np.sin(angles)])
    if kind == "inner":
        ring[int(rng.integers(count))] *= rng.uniform(0.2, 0.5)
    ring = _scaled(ring, area_m2)
    inside = corner_angles_deg(ring)
    convex = (inside > CORNER_DEG[0]) & (inside < CORNER_DEG[1])
    inner = (inside > INNER_DEG[0]) & (inside < INNER_DEG[1])
    wanted = int(kind == "inner")
    if not (convex | inner).all() or inner.sum() != wanted or neck_m(ring) < NECK_M:
        return None
    turned = affinity.rotate(shapely.Polygon(ring), rng.uniform(0, 360), origin=(0, 0))
    return np.asarray(shapely.get_coordinates(turned.exterior)[:-1])


def _edges(ring: Points, count: int) -> list[tuple[Points, Points, int]]:
    """(begin, end, points between) of each edge, by its share of the length around."""
    ends = np.roll(ring, -1, axis=0)
    lengths = np.hypot(*(ends - ring).T)
    between = np.floor((count - len(ring)) * lengths / lengths.sum()).astype(int)
    return list(zip(ring, ends, np.maximum(between, 0).tolist(), strict=True))


def _bending(rng: np.random.Generator, ring: Points, count: int) -> Points:
    """Edges that wander to one side and the other, and meet at the same corners."""
    points: list[Points] = []
    for begin, end, between in _edges(ring, count):
        points.append(begin)
        if between == 0:
            continue
        headings = np.cumsum(np.radians(rng.normal(0, WANDER_DEG, between + 1)))
        aside = np.cumsum(np.tan(np.clip(headings - headings.mean(), -0.5, 0.5)))
        aside = (aside - aside[-1] * np.arange(1, between + 2) / (between + 1))[:-1]
        step = (end - begin) / (between + 1)
        left = np.array([-step[1], step[0]])
        places = np.arange(1, between + 1)[:, None]
        points.extend(begin + places * step + aside[:, None] * left)
    return np.array(points)


def _rounded(rng: np.random.Generator, ring: Points) -> Points:
    """Each corner as an arc of points."""
    radius = rng.uniform(*ROUND_M)
    quarter = max(1, round(90.0 / ROUND_STEP_DEG))
    smooth = (
        shapely.Polygon(ring)
        .buffer(-radius, join_style="mitre")
        .buffer(radius, quad_segs=quarter)
        .simplify(1e-3)
    )
    ring = shapely.geometry.polygon.orient(smooth).exterior
    return np.asarray(shapely.get_coordinates(ring)[:-1])


def _jittered(rng: np.random.Generator, ring: Points, count: int) -> Points:
    """Points recorded along the edges, each a little off."""
    around = float(shapely.Polygon(ring).exterior.length)
    points: list[Points] = []
    for begin, end, between in _edges(ring, min(count, int(around / JITTER_STEP_M))):
        points.append(begin)
        step = (end - begin) / (between + 1)
        points.extend(begin + k * step for k in range(1, between + 1))
    return np.array(points) + rng.normal(0, JITTER_M, (len(points), 2))


def _curved(rng: np.random.Generator, count: int, area_m2: float) -> Points:
    """A smooth outline; every fourth one a circle, as under a pivot."""
    angles = np.arange(count) * math.tau / count
    radius = np.ones(count)
    if rng.random() > 0.25:
        for wave in range(2, 5):
            radius += rng.normal(0, 0.12 / wave) * np.cos(wave * angles + rng.uniform(0, math.tau))
        stretch = rng.uniform(1.0, 1.8)
    else:
        stretch = 1.0
    ring = np.column_stack([stretch * radius * np.cos(angles), radius * np.sin(angles)])
    return _scaled(ring, area_m2)


def outline_field(seed: int) -> Scenario:
    """The outline of a seed as a small field, with machine, crop, weather and neighbours of the
    random field of that seed; its owner walks it."""
    drawn, world = outline(seed), random_field(seed)
    area_m2 = np.random.default_rng([seed, 6]).uniform(*SMALL_M2)
    ring = _scaled(np.array(drawn.ring), area_m2).round(3).tolist()
    field = {"polygon": ring, "keep_outs": []}
    name = f"outline {drawn.kind}"
    rest = {"start": {"corner": 0}, "limits": {"time_s": TIME_S}}
    return changed(world, {"name": name, "field": field, **rest})


def planned(drawn: Outline, vehicle: Vehicle | None = None) -> Planned:
    """Plans an outline and drives the plan on paper. What is no UserError is a defect, and is kept
    in words too, so that the other outlines are tried."""
    machine = vehicle or Vehicle()
    begun = time.process_time()
    try:
        plan = spiral(list(drawn.ring), 0, machine, gap_m=GAP_M)
        spent = time.process_time() - begun
        shown = preview(plan, areas_of(shapely.Polygon(drawn.ring), GAP_M), machine)
    except UserError as error:
        return Planned(drawn, str(error), time.process_time() - begun)
    except Exception as error:
        return Planned(drawn, f"defect: {error!r}", time.process_time() - begun)
    return Planned(
        drawn,
        "",
        spent,
        len(plan.sides),
        shuttles_of(plan),
        shown.cutting_m,
        shown.turning_m,
        1.0 - shown.coverage,
    )


def shuttles_of(plan: Plan) -> int:
    """Ends of sides from which a shuttle leads to the next."""
    return sum(plan.corner_rad(k) == 0.0 for k in range(len(plan.sides) - 1))
