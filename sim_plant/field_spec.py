"""What a field is like: its outline, its crop, what stands about it, how uneven its ground is."""

from __future__ import annotations

from typing import Annotated, Literal

import shapely
from pydantic import Field as Limits
from pydantic import model_validator

from sim_plant.strict import NotNegative, Positive, Share, Strict

Point = tuple[float, float]
Channel = Annotated[float, Limits(ge=0, le=255)]
Colour = tuple[Channel, Channel, Channel]
Side = Literal["south", "east", "north", "west"]


class Tree(Strict):
    """A tree: a trunk that stands in the way under a crown."""

    x_m: float
    y_m: float
    height_m: Positive = 6.0
    crown_radius_m: Positive = 1.8
    trunk_radius_m: Positive = 0.2


class House(Strict):
    """A house: a box with its centre at (x, y)."""

    x_m: float
    y_m: float
    width_m: Positive = 6.0
    depth_m: Positive = 4.0
    height_m: Positive = 3.0
    yaw_deg: float = 0.0


class FieldSpec(Strict):
    """What a field is like. Either `polygon` (counter-clockwise or not, metres) or `size_m`, a
    rectangle with its lower left corner at (0, 0). Shares are of the crop's area."""

    size_m: tuple[Positive, Positive] = (10.0, 10.0)
    polygon: tuple[Point, ...] | None = None
    gap_m: NotNegative = 2.0
    """Between the field's boundary and the neighbours' crop."""
    neighbours: Literal["all", "none"] | tuple[Side, ...] = "all"
    """Sides (by the outward normal of the nearest edge) with a neighbour's crop behind the gap."""
    neighbour_depth_m: Positive = 6.0
    neighbour_height: Annotated[float, Limits(ge=0.3, le=2.0)] = 1.0
    """Times the field's own crop's height."""
    cell_m: Annotated[float, Limits(ge=0.01, le=0.05)] = 0.025
    crop_height_m: Positive = 0.9
    crop_height_sd_m: NotNegative = 0.05
    """Of the height over the field; single stalks vary by 6 % besides."""
    stalks_per_m2: Annotated[float, Limits(ge=20, le=1500)] = 400.0
    drilled: bool = False
    """Rows 0.17 m apart along x instead of the broadcast crop of the paper."""
    edge_wobble_m: NotNegative = 0.02
    """Standard deviation of the crop's outline about the polygon."""
    weeds: Share = 0.02
    lodged: Share = 0.0
    thin: Share = 0.03
    green: Share = 0.03
    bare: Share = 0.002
    grass: Share = 0.3
    """Of the ground outside the crop."""
    crop_bgr: Colour = (92.0, 142.0, 196.0)
    """Of the ripe crop in daylight, display-referred; likewise below."""
    straw_bgr: Colour = (98.0, 150.0, 200.0)
    soil_bgr: Colour = (82.0, 110.0, 142.0)
    patch_m: Positive = 1.5
    """Wavelength of the patches."""
    windrow_m: tuple[float, NotNegative] = (0.1, 0.45)
    """Where the reaper lays the straw: distance right of the blade's right end, and width."""
    trees: tuple[Tree, ...] = ()
    houses: tuple[House, ...] = ()
    keep_outs: tuple[tuple[Point, ...], ...] = ()
    side_slope_deg: float = 0.0
    """The plane's slope: positive where the ground rises to the north."""
    long_slope_deg: float = 0.0
    """Positive where the ground rises to the east."""
    bump_sd_deg: NotNegative = 0.6
    """Of the vehicle's roll and pitch from uneven ground."""
    bump_m: Positive = 1.2
    """Wavelength of the unevenness."""

    @model_validator(mode="after")
    def _polygon_is_simple(self) -> FieldSpec:
        for name, ring in (("polygon", self.polygon), *(("keep_outs", k) for k in self.keep_outs)):
            if ring is None:
                continue
            if len(ring) < 3 or not shapely.Polygon(ring).is_valid:
                raise ValueError(
                    f"{name}: needs at least three corners and sides that do not cross"
                )
        return self

    @property
    def boundary(self) -> shapely.Polygon:
        """The crop's nominal outline, counter-clockwise."""
        if self.polygon is None:
            w, h = self.size_m
            return shapely.box(0, 0, w, h, ccw=True)
        return shapely.geometry.polygon.orient(shapely.Polygon(self.polygon))

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """Of that outline, counter-clockwise; a rectangle's from its lower left."""
        if self.polygon is None:
            width, height = self.size_m
            return ((0.0, 0.0), (width, 0.0), (width, height), (0.0, height))
        return tuple((x, y) for x, y in list(self.boundary.exterior.coords)[:-1])
