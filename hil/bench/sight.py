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
from host.vision.view import BESIDE_AHEAD_M
from sim_plant.field import FLAT_RAD, Field
from sim_plant.ground import CROP, NEIGHBOUR, kind_at

CUTTING_M: Final = 0.3
"""Crop nearer than this is being cut."""
NEAR_SHARE: Final = 0.2
"""Of the blade's width that must be filled for crop to count as ahead."""
FARTHEST_M: Final = 8.0
"""What lies farther ahead no detector tells apart."""
COLUMNS: Final = 20
"""Across the blade's width."""
SPAN_M: Final = (-1.6, 1.0)
"""Beside the vehicle's middle, right to left, where the face's right end is looked for."""
RUN_M: Final = 0.1
"""What is narrower is no end of a face."""
BESIDE_FROM_M: Final = (0.4, 2.0)
"""Ahead of the blade, where crop is looked for that stands beside the machine's way,"""
BESIDE_LEFT_M: Final = (0.2, 1.5)
"""and how far left of its middle. What the detector takes is its own affair: where the two differ,
`daranti-hil vision --beside` shows it."""
BESIDE_WIDE_M: Final = 0.2
"""What is narrower beside the way is no crop."""
REMNANT_M: Final = 0.45
"""What is narrower, and has more crop to its left, is no strip's edge but an earlier one's rest."""
LENS_M: Final = (0.05, 0.03)
"""Before a camera's lens and to either side of its axis: crop that stands there hides all else
(docs/use/thousand_fields.md)."""
WALL_AHEAD_M: Final = (-0.4, -0.1)
"""Before the blade's line, where crop stands beside what the machine has just cut,"""
WALL_ASIDE_M: Final = 0.3
"""and so far right of the blade's end."""
WALL_SHARE: Final = 0.3
"""Of that ground with crop on it, for it to be a wall."""
PLACES: Final = 9
"""Along such ground and across it that are looked at."""
DEPTH_M: Final = 3.0
"""No more of the crop behind its face is looked at."""
LIES_M: Final = 0.6
"""So much of the crop ahead, from its face on, is looked at for how flat it lies,"""
LIES_SHARE: Final = 0.4
"""and of the blade's width, to either side of its middle."""


@dataclass(frozen=True, slots=True)
class Sight:
    """The world as one picture has it. NaN where there is no such thing."""

    ahead_m: float
    """From the blade's line to the nearest crop that fills a share of its width; inf without."""
    depth_m: float
    """How far that crop goes on."""
    right_m: float
    """The face's right end in the vehicle frame, left positive."""
    remnant: bool
    """Whether something narrow stands right of that end, behind clear ground."""
    beside_m: float
    """The right end of what stands beside the machine's way, left of it, a little ahead."""
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
    """`ahead_m`, `right_m` and `beside_m` as the host would read them from where it believes the
    camera and the blade to be (hil/bench/misread.py)."""
    read_right_m: float
    read_beside_m: float
    before_lens: bool = False
    """Whether crop stands right before the camera's lens."""
    crop_right: bool = False
    """Whether crop stands beside the blade, right of its end."""
    lying: float = 0.0
    """How flat the crop ahead lies at its face, 0 (as sown, or none) to 1."""


@njit(cache=True, nogil=True)
def _standing(
    kind: NDArray[np.uint8], x0: float, y0: float, cell: float, x: float, y: float
) -> bool:
    here = kind_at(kind, x0, y0, cell, x, y)
    return here in (CROP, NEIGHBOUR)


@njit(cache=True, nogil=True)
def _rows(
    kind: NDArray[np.uint8],
    x0: float,
    y0: float,
    cell: float,
    place: tuple[float, float],
    way: tuple[float, float],
    first_m: float,
    apart_m: float,
    rows: int,
    enough: int,
) -> bool:
    """Whether crop stands at `enough` of so many places, from `first_m` ahead of one on."""
    count = 0
    for q in range(rows):
        if count + rows - q < enough:
            return False
        ahead = first_m + apart_m * q
        if _standing(kind, x0, y0, cell, place[0] + ahead * way[0], place[1] + ahead * way[1]):
            count += 1
            if count == enough:
                return True
    return False


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
) -> tuple[float, float]:
    """Lateral place of the right end of what stands within a quarter metre behind `first_m`; and
    1 where something narrower stands right of it, behind clear ground, which is what an earlier
    strip has left and no edge to the detector, 0 without."""
    c = math.cos(yaw)
    s = math.sin(yaw)
    step = 0.01
    n = int((SPAN_M[1] - SPAN_M[0]) / step)
    narrow = math.nan
    begin = clear = run = 0
    for k in range(n):
        left = SPAN_M[0] + (k + 0.5) * step
        place = (x - left * s, y + left * c)
        if _rows(kind, x0, y0, cell, place, (c, s), first_m + 0.04, 0.05, 5, 2):
            if clear * step >= RUN_M or run == 0:
                begin = k
            clear = 0
            run = k + 1 - begin
            if run * step >= REMNANT_M:
                if begin == 0:
                    # crop up to the border of what is looked at has no end there
                    return math.nan, 0.0
                end = SPAN_M[0] + (begin + 0.5) * step
                return end, 0.0 if math.isnan(narrow) else 1.0
        else:
            clear += 1
            if clear * step >= RUN_M and run * step >= RUN_M:
                if begin > 0 and math.isnan(narrow):
                    narrow = SPAN_M[0] + (begin + 0.5) * step
                run = 0
            elif run * step < RUN_M:
                run = 0
    if run * step >= RUN_M and begin > 0:
        return SPAN_M[0] + (begin + 0.5) * step, 0.0 if math.isnan(narrow) else 1.0
    return narrow, 0.0


@njit(cache=True, nogil=True)
def _beside(
    kind: NDArray[np.uint8],
    x0: float,
    y0: float,
    cell: float,
    x: float,
    y: float,
    yaw: float,
    blade_x: float,
) -> float:
    """Lateral place from which on crop stands along `BESIDE_FROM_M`, left of the machine's way."""
    c, s = math.cos(yaw), math.sin(yaw)
    run, step, rows = 0, 0.02, 6
    apart = (BESIDE_FROM_M[1] - BESIDE_FROM_M[0]) / (rows - 1)
    for k in range(int((BESIDE_LEFT_M[1] - BESIDE_LEFT_M[0]) / step)):
        left = BESIDE_LEFT_M[0] + k * step
        place = (x - left * s, y + left * c)
        first = blade_x + BESIDE_FROM_M[0]
        full = _rows(kind, x0, y0, cell, place, (c, s), first, apart, rows, rows // 2)
        run = run + 1 if full else 0
        if run * step >= BESIDE_WIDE_M:
            return left - (run - 1) * step
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
    left_s, left_c = np.empty(COLUMNS), np.empty(COLUMNS)
    for k in range(COLUMNS):
        left = width * ((k + 0.5) / COLUMNS - 0.5)
        left_s[k], left_c[k] = left * s, left * c
    while d < FARTHEST_M:
        here = 0
        fx = blade_x + d
        px, py = x + fx * c, y + fx * s
        for k in range(COLUMNS):
            if ahead == math.inf and hit[k]:
                continue
            if _standing(kind, x0, y0, cell, px - left_s[k], py + left_c[k]):
                here += 1
                if ahead < math.inf:
                    if here == enough:
                        break
                elif not hit[k]:
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
    out[2:] = math.nan
    if ahead < math.inf:
        out[2], out[3] = _right(kind, x0, y0, cell, x, y, yaw, blade_x + ahead)
        behind, _ = _right(kind, x0, y0, cell, x, y, yaw, blade_x + ahead + 0.4)
        out[4] = (behind - out[2]) / 0.4
    out[5] = _beside(kind, x0, y0, cell, x, y, yaw, blade_x)


@njit(cache=True, nogil=True)
def _crop_on(
    kind: NDArray[np.uint8],
    lodge: NDArray[np.float32],
    x0: float,
    y0: float,
    cell: float,
    coarse: float,
    pose: tuple[float, float, float],
    ahead_m: tuple[float, float],
    left_m: tuple[float, float],
) -> tuple[float, float]:
    """Of the ground before and beside a pose (x, y, yaw), from and to, the share on which crop
    stands, and how far that is tilted on average, rad (0 without): at places evenly spread over
    it."""
    x, y, yaw = pose
    c, s, count, tilt = math.cos(yaw), math.sin(yaw), 0, 0.0
    for i in range(PLACES):
        ahead = ahead_m[0] + (ahead_m[1] - ahead_m[0]) * i / (PLACES - 1)
        for k in range(PLACES):
            left = left_m[0] + (left_m[1] - left_m[0]) * k / (PLACES - 1)
            px, py = x + ahead * c - left * s, y + ahead * s + left * c
            if _standing(kind, x0, y0, cell, px, py):
                tilt += lodge[int((py - y0) / coarse), int((px - x0) / coarse)]
                count += 1
    return count / PLACES**2, tilt / max(1, count)


def look(
    field: Field,
    pose: tuple[float, float, float],
    blade_x_m: float,
    blade_width_m: float,
    speed_mps: float = 0.0,
    blade: bool = False,
    misreading: Misreading | None = None,
    lens_m: tuple[float, float] | None = None,
) -> Sight:
    """The sight from a pose (x, y, yaw of the rear axle). `lens_m`: the camera's lens in the
    vehicle frame."""
    x, y, yaw = pose
    out = np.empty(6)
    _look(field.kind, *field.origin, field.cell, x, y, yaw, blade_x_m, blade_width_m, out)
    ahead, depth, right, remnant, slope, beside = out.tolist()
    density = 1.0
    if math.isfinite(right):
        fx, left = blade_x_m + ahead + 0.1, right + 0.1
        px = x + fx * math.cos(yaw) - left * math.sin(yaw)
        py = y + fx * math.sin(yaw) + left * math.cos(yaw)
        i = math.floor((px - field.origin[0]) / field.coarse)
        j = math.floor((py - field.origin[1]) / field.coarse)
        rows, columns = field.density.shape
        if 0 <= i < columns and 0 <= j < rows:
            density = float(field.density[j, i] * (1.0 - field.lodge[j, i] / FLAT_RAD))
    read, read_beside = (ahead, right), beside
    if misreading is not None:
        read = misreading.of(ahead, right, cutting=ahead < CUTTING_M)
        _, read_beside = misreading.of(BESIDE_AHEAD_M, beside, cutting=False)
    before_lens = False
    ground = field.kind, field.lodge, *field.origin, field.cell, field.coarse
    if lens_m is not None:
        c, s = math.cos(yaw), math.sin(yaw)
        at = x + lens_m[0] * c - lens_m[1] * s, y + lens_m[0] * s + lens_m[1] * c
        before, aside = (LENS_M[0], LENS_M[0]), (-LENS_M[1], LENS_M[1])
        before_lens = _crop_on(*ground, (*at, yaw), before, aside)[0] > 0.5
    end_m = -0.5 * blade_width_m
    wall = blade_x_m + WALL_AHEAD_M[0], blade_x_m + WALL_AHEAD_M[1]
    crop_right = _crop_on(*ground, pose, wall, (end_m - WALL_ASIDE_M, end_m))[0] >= WALL_SHARE
    tilt_rad = 0.0
    if ahead < math.inf:
        face = blade_x_m + ahead, blade_x_m + ahead + LIES_M
        aside_m = LIES_SHARE * blade_width_m
        _, tilt_rad = _crop_on(*ground, pose, face, (-aside_m, aside_m))
    return Sight(
        ahead,
        depth,
        right,
        remnant > 0.0,
        beside,
        slope,
        density,
        speed_mps,
        blade,
        x,
        y,
        yaw,
        *read,
        read_beside,
        before_lens,
        crop_right,
        tilt_rad / FLAT_RAD,
    )
