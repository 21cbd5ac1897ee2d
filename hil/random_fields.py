"""Random fields: what a season may bring, one scenario per seed."""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np
import shapely

from hil.scenario import Scenario, Start
from sim_plant.field import FieldSpec
from sim_plant.gnss import GnssSpec
from sim_plant.sky import WeatherSpec

Shape = Literal["rectangle", "trapezoid", "irregular"]
SHAPES: Final[tuple[Shape, ...]] = ("rectangle", "trapezoid", "irregular")
SIZE_M: Final = (8.0, 20.0)
MIN_SIDE_M: Final = 3.0
MIN_CORNER_RAD: Final = math.radians(50)
MAX_CORNER_RAD: Final = math.radians(155)
Ring = tuple[tuple[float, float], ...]


def _good(ring: Ring) -> bool:
    """Whether a machine can turn at every corner and cut along every side."""
    points = np.array(ring)
    sides = np.roll(points, -1, axis=0) - points
    lengths = np.hypot(*sides.T)
    headings = np.arctan2(sides[:, 1], sides[:, 0])
    inside = math.pi - (np.roll(headings, -1) - headings) % (2 * math.pi)
    return bool(
        lengths.min() >= MIN_SIDE_M
        and inside.min() >= MIN_CORNER_RAD
        and inside.max() <= MAX_CORNER_RAD
    )


def outline(rng: np.random.Generator, shape: Shape) -> Ring:
    """Corners (m) of a convex field, counter-clockwise from the lower left of its bounds at 0."""
    while True:
        width, height = rng.uniform(*SIZE_M, 2)
        if shape == "rectangle":
            ring: Ring = ((0.0, 0.0), (width, 0.0), (width, height), (0.0, height))
        elif shape == "trapezoid":
            left, right = rng.uniform(0.0, 0.25, 2) * width
            ring = ((0.0, 0.0), (width, 0.0), (width - right, height), (left, height))
        else:
            count = int(rng.integers(5, 10))
            angles = np.sort(rng.uniform(0, 2 * math.pi, count))
            x, y = 0.5 * width * np.cos(angles), 0.5 * height * np.sin(angles)
            hull = shapely.geometry.polygon.orient(
                shapely.MultiPoint(np.column_stack([x, y])).convex_hull
            )
            if hull.geom_type != "Polygon" or len(hull.exterior.coords) < 6:
                continue
            points = np.array(hull.exterior.coords[:-1])
            points -= points.min(axis=0)
            first = int(np.argmin(points.sum(axis=1)))
            ring = tuple((float(a), float(b)) for a, b in np.roll(points, -first, axis=0))
        if _good(ring):
            return tuple((round(float(a), 2), round(float(b), 2)) for a, b in ring)


def random_field(seed: int) -> Scenario:
    """The scenario of a seed: shape, crop, slope, weather, hour, camera mount, positions' error and
    how well the operator aligned the machine."""
    rng = np.random.default_rng([seed, 0xF1E1D])
    shape = SHAPES[int(rng.integers(len(SHAPES)))]
    ring = outline(rng, shape)

    def within(low: float, high: float) -> float:
        return round(float(rng.uniform(low, high)), 3)

    field = FieldSpec(
        polygon=ring,
        gap_m=2.0,
        crop_height_m=within(0.8, 1.0),
        stalks_per_m2=within(250, 500),
        drilled=bool(rng.random() < 0.3),
        edge_wobble_m=within(0.0, 0.03),
        weeds=within(0.0, 0.08),
        lodged=within(0.0, 0.05),
        thin=within(0.0, 0.08),
        green=within(0.0, 0.1),
        bare=within(0.0, 0.005),
        grass=within(0.0, 0.6),
        side_slope_deg=within(-4, 4),
        long_slope_deg=within(-4, 4),
        bump_sd_deg=within(0.2, 1.2),
    )
    weather = WeatherSpec(
        hour=within(9, 16),
        haze=within(0.001, 0.01),
        dust=within(0.0, 0.6),
        cloud=within(0.0, 1.0) if rng.random() < 0.5 else 0.0,
        wind_mps=within(0.0, 6.0),
        wind_from_deg=within(0, 360),
    )
    return Scenario(
        name=f"random {shape}",
        seed=seed,
        camera="mast" if rng.random() < 0.5 else "low",
        field=field,
        weather=weather,
        gnss=GnssSpec(cep_m=within(0.5, 2.5)),
        start=Start(
            corner=int(rng.integers(len(ring))),
            before_m=within(0.0, 0.5),
            lateral_error_m=within(-0.05, 0.05),
            heading_error_deg=within(-2, 2),
        ),
    )
