"""What a perfect eye would say of the crop before the blade: from the field's grid and the true
pose at the shutter. Both fidelities of the camera are measured against it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from hil.bench.misread import Misreading
from sim_plant.field import Field
from sim_plant.ground import CROP, NEIGHBOUR, kind_at

CUTTING_M: Final = 0.3
"""Crop nearer than this is being cut."""
NEAR_SHARE: Final = 0.2
"""Of the blade's width that must be filled for crop to count as ahead."""
REACH_M: Final = 8.0
"""What lies farther ahead no detector tells apart."""
COLUMNS: Final = 20
"""Across the blade's width."""
SPAN_M: Final = (-1.6, 1.0)
"""Beside the vehicle's middle, right to left, where the face's right end is looked for."""
RUN_M: Final = 0.1
"""What is narrower is no end of a face."""
DEPTH_M: Final = 3.0
"""No more of the crop behind its face is looked at."""


@dataclass(frozen=True, slots=True)
class Sight:
    """The world as one picture has it. NaN where there is no such thing."""

    ahead_m: float
    """From the blade's line to the nearest crop that fills a share of its width; inf without."""
    depth_m: float
    """How far that crop goes on."""
    right_m: float
    """The face's right end in the vehicle frame, left positive."""
    slope: float
    """Of the right end, left per metre ahead."""
    density: float
    """Of the crop at the right end, 1 where it stands as sown."""
    speed_mps: float
    blade: bool
    x_m: float
    y_m: float
    yaw_rad: float
    read_ahead_m: float
    """`ahead_m` and `right_m` as the host would read them from where it believes the camera and the
    blade to be (hil/bench/misread.py)."""
    read_right_m: float


@njit(cache=True, nogil=True)
def _standing(
    kind: NDArray[np.uint8], x0: float, y0: float, cell: float, x: float, y: float
) -> bool:
    here = kind_at(kind, x0, y0, cell, x, y)
    return here in (CROP, NEIGHBOUR)


@njit(cache=True, nogil=True)
def _right(
    kind: NDArray[np.uint8],
    x0: float,
    y0: float,
    cell: float,
    x: float,
    y: float,
    yaw: float,
    first_m: float,
) -> float:
    """Lateral place of the right end of what stands within a quarter metre behind `first_m`."""
    c = math.cos(yaw)
    s = math.sin(yaw)
    run = 0
    step = 0.01
    n = int((SPAN_M[1] - SPAN_M[0]) / step)
    for k in range(n):
        left = SPAN_M[0] + (k + 0.5) * step
        count = 0
        for q in range(5):
            ahead = first_m + 0.04 + 0.05 * q
            if _standing(kind, x0, y0, cell, x + ahead * c - left * s, y + ahead * s + left * c):
                count += 1
        if count >= 2:
            run += 1
            if run * step >= RUN_M:
                # crop up to the border of what is looked at has no end there
                return left - (run - 0.5) * step if k >= run else math.nan
        else:
            run = 0
    return math.nan


@njit(cache=True, nogil=True)
def _look(
    kind: NDArray[np.uint8],
    x0: float,
    y0: float,
    cell: float,
    x: float,
    y: float,
    yaw: float,
    blade_x: float,
    width: float,
    out: NDArray[np.float64],
) -> None:
    c = math.cos(yaw)
    s = math.sin(yaw)
    enough = max(1, round(NEAR_SHARE * COLUMNS))
    ahead = math.inf
    depth = 0.0
    hit = np.zeros(COLUMNS, np.bool_)
    count = 0
    gap = 0.0
    step = cell
    d = 0.01
    while d < REACH_M:
        here = 0
        for k in range(COLUMNS):
            if ahead == math.inf and hit[k]:
                continue
            left = width * ((k + 0.5) / COLUMNS - 0.5)
            fx = blade_x + d
            if _standing(kind, x0, y0, cell, x + fx * c - left * s, y + fx * s + left * c):
                here += 1
                if not hit[k]:
                    hit[k] = True
                    count += 1
        if ahead == math.inf:
            if count >= enough:
                ahead = d
                step = 2.0 * cell
        else:
            if here >= enough:
                depth = d - ahead
                gap = 0.0
            else:
                gap += step
            if gap > 0.3 or d - ahead > DEPTH_M:
                break
        d += step
    out[0] = ahead if ahead > 0.02 else 0.0
    out[1] = depth
    out[2] = math.nan
    out[3] = math.nan
    if ahead < math.inf:
        out[2] = _right(kind, x0, y0, cell, x, y, yaw, blade_x + ahead)
        behind = _right(kind, x0, y0, cell, x, y, yaw, blade_x + ahead + 0.4)
        out[3] = (behind - out[2]) / 0.4


def look(
    field: Field,
    pose: tuple[float, float, float],
    blade_x_m: float,
    blade_width_m: float,
    speed_mps: float = 0.0,
    blade: bool = False,
    misreading: Misreading | None = None,
) -> Sight:
    """The sight from a pose (x, y, yaw of the rear axle)."""
    x, y, yaw = pose
    out = np.empty(4)
    _look(field.kind, *field.origin, field.cell, x, y, yaw, blade_x_m, blade_width_m, out)
    ahead, depth, right, slope = out.tolist()
    density = 1.0
    if math.isfinite(right):
        fx, left = blade_x_m + ahead + 0.1, right + 0.1
        px = x + fx * math.cos(yaw) - left * math.sin(yaw)
        py = y + fx * math.sin(yaw) + left * math.cos(yaw)
        i = math.floor((px - field.origin[0]) / field.coarse)
        j = math.floor((py - field.origin[1]) / field.coarse)
        rows, columns = field.density.shape
        if 0 <= i < columns and 0 <= j < rows:
            density = float(field.density[j, i] * (1.0 - field.lodge[j, i] / 1.2))
    read = ahead, right
    if misreading is not None:
        read = misreading.of(ahead, right, cutting=ahead < CUTTING_M)
    return Sight(ahead, depth, right, slope, density, speed_mps, blade, x, y, yaw, *read)
