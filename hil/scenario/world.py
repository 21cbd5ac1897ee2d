"""The world's half of a scenario: what is. Plant and judge read this and nothing else."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import shapely
from pydantic import Field
from shapely import affinity

from hil.firmware.wiring import Wiring
from host.core.strict import Strict
from sim_plant.camera import CameraSpec
from sim_plant.field_spec import FieldSpec, Point
from sim_plant.gnss import GnssSpec
from sim_plant.gyro import GyroSpec
from sim_plant.machine import MachineSpec
from sim_plant.sky import WeatherSpec

MARGIN_M = 0.2
"""The permitted area ends this far before the neighbour's crop."""
BLADE_REACH_M = (0.1, 0.05)
"""How far the blade's bar reaches behind and ahead of its line."""
NEARER_M = 1.0
"""How far an operator moves the machine up at most, where there is no room behind it."""
NEARER_STEP_M = 0.01
"""How finely."""
ALONG_M = 3.0
"""Of an edge along which an operator puts a machine, at least: the machine's own length. Nobody
takes a direction from a piece of a decimetre."""
CORNER_RAD = math.radians(45.0)
"""Where an edge turns by more, an operator sees a corner, and another edge behind it."""
STRIP_LOW_M = 1e-3
"""Kept off the edge itself, where the strip's crop is looked for."""


class Start(Strict):
    """How the operator puts the machine down: at a corner, the blade's right end just outside the
    crop's outer edge."""

    corner: Annotated[int, Field(ge=0)] = 1
    """Index into the true boundary (counter-clockwise from the lower left); the first side runs on
    from it. Where no plan can begin there, the operator takes the corner that the plan shows."""
    before_m: Annotated[float, Field(ge=0)] = 0.0
    """The blade's line before the crop, at most."""
    overlap_m: float = 0.08
    """How far outside the edge the operator puts the blade's right end."""
    lateral_error_m: float = 0.0
    heading_error_deg: float = 0.0


def outline_of(machine: MachineSpec) -> shapely.Polygon:
    """Body and blade in the vehicle frame."""
    half, wide, blade = machine.half_width_m, machine.blade_width_m / 2, machine.blade_x_m
    body = shapely.box(-machine.rear_overhang_m, -half, blade, half)
    bar = shapely.box(blade - BLADE_REACH_M[0], -wide, blade + BLADE_REACH_M[1], wide)
    whole = body.union(bar)
    assert isinstance(whole, shapely.Polygon)
    return whole


def placed(outline: shapely.Polygon, x: float, y: float, yaw: float) -> shapely.Polygon:
    """An outline of the vehicle frame in the field frame; metres, radians."""
    c, s = math.cos(yaw), math.sin(yaw)
    return affinity.affine_transform(outline, [c, -s, s, c, x, y])


@dataclass(frozen=True, slots=True)
class World:
    """Everything that is so, whatever the host believes."""

    seed: int
    field: FieldSpec
    machine: MachineSpec
    wiring: Wiring
    lens: CameraSpec
    weather: WeatherSpec
    gnss: GnssSpec
    gyro: GyroSpec
    start: Start

    @property
    def corners(self) -> tuple[Point, ...]:
        """Of the crop's nominal outline, as the field numbers them."""
        return self.field.corners

    def side(self, corner: int, least_m: float = 0.0) -> tuple[Point, float, float]:
        """(corner, heading_rad, length_m) of the side that leaves a corner; of an edge that bends,
        of its first least_m together."""
        n = len(self.corners)
        ring = np.array([self.corners[(corner + k) % n] for k in range(n + 1)])
        ways = np.diff(ring, axis=0)
        headings = np.arctan2(ways[:, 1], ways[:, 0])
        last = 1
        while last < n and math.dist(ring[0], ring[last]) < least_m:
            if abs(math.remainder(headings[last] - headings[last - 1], math.tau)) > CORNER_RAD:
                break
            last += 1
        (ax, ay), (bx, by) = ring[0].tolist(), ring[last].tolist()
        return (ax, ay), math.atan2(by - ay, bx - ax), math.hypot(bx - ax, by - ay)

    def stood_at(
        self, corner: int, shift_m: float = 0.0, *, in_crop: bool = False
    ) -> tuple[float, float, float]:
        """(x, y, yaw) of the rear axle of a machine that was put down at a corner as `start` says,
        the blade before the crop that stands in its way; nearer than `start.before_m` where it
        would stand outside the permitted area. `shift_m`: so much farther right. `in_crop`: the
        blade at the corner, where that is one point of many of an edge that bends."""
        m, start = self.machine, self.start
        (ax, ay), along, _ = self.side(corner, 0.0 if in_crop else ALONG_M)
        c, s = math.cos(along), math.sin(along)
        inside = m.blade_width_m / 2 - start.overlap_m - shift_m + start.lateral_error_m
        heading = along + math.radians(start.heading_error_deg)
        room = max(0.0, self.field.gap_m - MARGIN_M)
        permitted = self.field.boundary.buffer(room, join_style="mitre")
        outline = outline_of(m)
        begin = start.before_m if in_crop else self._crop_begins_m(corner)

        def pose(nearer_m: float) -> tuple[float, float, float]:
            back = m.blade_x_m + start.before_m - nearer_m - begin
            return ax - back * c - inside * s, ay - back * s + inside * c, heading

        tries = (pose(k * NEARER_STEP_M) for k in range(1 + round(NEARER_M / NEARER_STEP_M)))
        fits = (at for at in tries if permitted.contains(placed(outline, *at)))
        return next(fits, pose(0.0))

    def _crop_begins_m(self, corner: int) -> float:
        """Along the side, from the corner to the first crop in the blade's way: behind the corner
        where that is blunt."""
        (ax, ay), along, length = self.side(corner, ALONG_M)
        c, s = math.cos(along), math.sin(along)
        turned = affinity.affine_transform(
            self.field.boundary, [c, s, -s, c, -c * ax - s * ay, s * ax - c * ay]
        )
        wide = self.machine.blade_width_m - self.start.overlap_m
        reach = float(turned.bounds[0]) - 1.0
        way = turned.intersection(shapely.box(reach, STRIP_LOW_M, length / 2, wide))
        parts = [part for part in shapely.get_parts(way) if isinstance(part, shapely.Polygon)]
        mine = shapely.Point(length / 4, STRIP_LOW_M)
        near = [part for part in parts if part.distance(mine) < 0.01] or parts
        return min((float(part.bounds[0]) for part in near), default=0.0)
