"""The phone's picture of the field.

A ray per pixel finds ground, canopy top or the face of the standing crop on the field's grids;
z-buffered stalks are drawn over that, front to back. Both read counter-based randomness only, and
every column strip draws the same stalks in the same order, so that a picture depends on (seed,
time, pose, field) and on nothing else, the number of threads least of all.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Annotated, Any, Final, NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import Field as Limits

from sim_plant import field as f
from sim_plant import noise, sky, texture
from sim_plant.field import NotNegative, Positive, Share, Strict
from sim_plant.sky import WeatherSpec

BACKGROUND: Final = 0
"""Labels of `Camera.labels`."""
STANDING: Final = 1
STUBBLE: Final = 2
STRAW: Final = 3
SOIL: Final = 4
NEIGHBOUR: Final = 5
WEEDS: Final = 6
MACHINE: Final = 7
EDGE: Final = 8
"""The border of the field's own standing crop with open ground to its right."""

_BLOCK_M: Final = 0.5
"""Side of a block of stalks."""
_PACKS: Final = 64
"""Different blocks; which one stands where is drawn per block."""
_SUNLIT, _HEIGHT, _GREEN, _DENSITY, _WEED, _LODGE, _TONE, _BODY = range(8)
_SKY, _CANOPY, _FACE, _GROUND = range(100, 104)
"""Pixels that are found but not painted yet, among the labels."""
_FLAT: Final = -1
"""Instead of a tile: no texture."""
_CANOPY_BACK_M: Final = 0.25
_FACE_BACK_M: Final = 0.30
"""How far behind its front the body of the crop lies: stalks fill the space between."""
_SEGMENTS: Final = 48
"""Changes of height along an azimuth that a profile holds."""
_STRIPS: Final = 8
"""The picture is drawn in so many strips of columns, whatever the number of threads."""
_REACH_M: Final = 24.0
"""Stalks are drawn up to here; the canopy's texture beyond."""


class CameraSpec(Strict):
    """Where the camera sits in the vehicle frame, how it looks, its lens, sensor and file format.

    Pitch is positive downward, yaw to the left, roll clockwise as seen from behind."""

    x_m: float = 0.1
    y_m: float = 0.0
    z_m: Positive = 0.6
    pitch_deg: float = 5.0
    yaw_deg: float = 0.0
    roll_deg: float = 0.0
    width_px: Annotated[int, Limits(ge=32, le=4096)] = 640
    height_px: Annotated[int, Limits(ge=32, le=4096)] = 480
    hfov_deg: Annotated[float, Limits(gt=10, lt=150)] = 62.0
    k1: float = -0.06
    """Radial distortion as in OpenCV."""
    k2: float = 0.01
    fps: Positive = 10.0
    shutter_s: NotNegative = 0.004
    """Exposure time: motion blur."""
    readout_s: NotNegative = 0.020
    """From the first to the last row: rolling shutter."""
    noise: NotNegative = 3.0
    """Standard deviation of the sensor noise in counts of 255."""
    exposure: Share = 0.8
    """How much of the scene's brightness the exposure control evens out."""
    target: Annotated[float, Limits(gt=0, lt=255)] = 118.0
    """Mean brightness that the exposure control aims at."""
    jpeg_quality: Annotated[int, Limits(ge=1, le=100)] = 80

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.width_px / 2 / math.tan(math.radians(self.hfov_deg) / 2)


LOW = CameraSpec(x_m=0.1, z_m=0.6, pitch_deg=5.0)
MAST = CameraSpec(x_m=0.0, z_m=1.6, pitch_deg=28.0)


class Scene(NamedTuple):
    """The grids as the renderer reads them; coarse ones have half of `kind`'s rows and columns."""

    kind: NDArray[np.uint8]
    clear: NDArray[np.float32]
    """Coarse: a lower bound of the distance to standing crop, m."""
    stand: NDArray[np.float32]
    """Coarse, (rows, columns, 8): `_SUNLIT` (above this height in m the sun reaches) and the
    field's attributes; together, because a lookup costs a cache line."""
    x0: float
    y0: float
    cell: float
    beyond_is_crop: bool
    canopy: float
    """Height of the canopy's body below the ears, m, at the field's tallest."""


class View(NamedTuple):
    """Pinhole with radial distortion. `axes` rows: right, down, forward in field coordinates."""

    x: float
    y: float
    z: float
    axes: NDArray[np.float64]
    focal: float
    cu: float
    cv: float
    k1: float
    k2: float
    shear: float
    """Rolling shutter: horizontal shift in px from first to last row."""
    rays: NDArray[np.float32]
    """(rows, columns, 2): undistorted normalised image coordinates."""
    tangent: float
    """Of the largest azimuth that the profiles hold, either side of the heading."""
    stretch: NDArray[np.float64]
    """Per azimuth bin: distance per distance ahead."""


class Paint(NamedTuple):
    """Colours: tiles, background, light and haze, all BGR."""

    tiles: NDArray[np.uint8]
    levels: NDArray[np.int32]
    panorama: NDArray[np.uint8]
    light: NDArray[np.float32]
    sky_gain: float
    haze: float
    haze_bgr: NDArray[np.float32]
    crop_bgr: NDArray[np.float32]
    green_bgr: NDArray[np.float32]
    straw_bgr: NDArray[np.float32]


@njit(cache=True, nogil=True)
def _standing(kind: int) -> bool:
    return kind in (f.CROP, f.NEIGHBOUR)


@njit(cache=True, nogil=True)
def _solid(kind: int) -> bool:
    return kind in (f.OBSTACLE, f.TRUNK)


@njit(cache=True, nogil=True, error_model="numpy")
def _shade(
    stand: NDArray[np.float32],
    coarse: float,
    east: float,
    north: float,
    up: float,
    crowns: NDArray[np.float64],
    j0: int,
    j1: int,
    i0: int,
    i1: int,
) -> None:
    """Fills _SUNLIT in a range of coarse cells: how high the shadow of what stands sunward reaches.

    `crowns` (n, 4): x, y, z and radius of the trees' crowns in coarse cells from the grid's corner.
    """
    rows, columns = stand.shape[:2]
    flat = math.hypot(east, north)
    tangent = up / max(flat, 1e-6)
    dx = east / max(flat, 1e-6)
    dy = north / max(flat, 1e-6)
    tallest = 0.0
    for j in range(rows):
        for i in range(columns):
            tallest = max(tallest, stand[j, i, _HEIGHT])
    for j in range(j0, j1):
        for i in range(i0, i1):
            highest = 0.0
            for k in range(crowns.shape[0]):
                # Distance of the crown's centre from the ray towards the sun.
                cx = crowns[k, 0] - i - 0.5
                cy = crowns[k, 1] - j - 0.5
                cz = crowns[k, 2]
                along = cx * east + cy * north + cz * up
                if cx * cx + cy * cy + cz * cz - along * along < crowns[k, 3] ** 2:
                    highest = max(highest, cz * coarse)
            s = 0.15
            while s * tangent < tallest:
                p = int(i + 0.5 + dx * s / coarse)
                q = int(j + 0.5 + dy * s / coarse)
                if p < 0 or q < 0 or p >= columns or q >= rows:
                    break
                if stand[q, p, _BODY] > 0.0:
                    h = stand[q, p, _HEIGHT] - s * tangent
                    highest = max(highest, h)
                s += 0.05
            stand[j, i, _SUNLIT] = highest


@njit(cache=True, nogil=True, error_model="numpy")
def _profile(
    scene: Scene,
    view: View,
    b0: int,
    b1: int,
    start: NDArray[np.float32],
    top: NDArray[np.float32],
    count: NDArray[np.int32],
) -> None:
    """Heights that azimuths b0..b1 cross: from `start[b, k]` (m, horizontal) on, the crop's body is
    `top[b, k]` high (0: ground), `count[b]` of them.

    The azimuth of bin b is atan(_bin_tangent(b)) to the left of the view's heading. Free ground is
    crossed by leaps of the clear distance, crop by steps of 8 cm and more with the distance.
    """
    n_j, n_i = scene.clear.shape
    inv = 0.5 / scene.cell
    hx = view.axes[2, 0]
    hy = view.axes[2, 1]
    norm = math.sqrt(hx * hx + hy * hy)
    hx /= norm
    hy /= norm
    bins, most = start.shape
    for b in range(b0, b1):
        lateral = _bin_tangent(b, bins, view.tangent)
        stretch = math.sqrt(1.0 + lateral * lateral)
        dx = (hx - lateral * hy) / stretch * inv
        dy = (hy + lateral * hx) / stretch * inv
        px0 = (view.x - scene.x0) * inv
        py0 = (view.y - scene.y0) * inv
        n = 0
        r = 0.0
        now = -1.0
        rough = 0.0
        while n < most - 1 and r < 80.0:
            px = px0 + r * dx
            py = py0 + r * dy
            if px < 0.0 or py < 0.0 or px >= n_i or py >= n_j:
                break
            i = int(px)
            j = int(py)
            height = 0.0
            leap = scene.clear[j, i]
            stands = scene.stand[j, i, _BODY] > 0.0
            if leap > 0.0:
                leap += 0.005
            elif stands and _standing(scene.kind[int(2.0 * py), int(2.0 * px)]):
                height = 0.8 * scene.stand[j, i, _HEIGHT]
                leap = 0.08 + 0.02 * r
                rough = 0.16 * noise.uniform(5, int(30.0 * px), int(30.0 * py)) - 0.10
            elif stands and _solid(scene.kind[int(2.0 * py), int(2.0 * px)]):
                height = scene.stand[j, i, _HEIGHT]
                leap = 0.5 * scene.cell
                rough = 0.0
            else:
                leap = 0.5 * scene.cell
            entered = (height > 0.0) != (now > 0.0)
            if now < 0.0 or entered or abs(height - now) > 0.06:
                start[b, n] = r
                top[b, n] = height
                if entered and height > 0.0:
                    # The crop's upper border is ragged.
                    top[b, n] += rough
                n += 1
                now = height
            r += leap
        start[b, n] = r
        top[b, n] = scene.canopy if scene.beyond_is_crop else 0.0
        count[b] = n + 1


@njit(cache=True, nogil=True)
def _bin_tangent(b: float, bins: int, tangent: float) -> float:
    return ((b + 0.5) / bins * 2.0 - 1.0) * tangent


@njit(cache=True, nogil=True)
def _direction(view: View, u: int, v: int) -> tuple[float, float, float]:
    """The ray of a pixel in the field frame, 1 long along the optical axis."""
    R = view.axes
    a = view.rays[v, u, 0] - view.shear * ((v + 0.5) / view.rays.shape[0] - 0.5) / view.focal
    b = view.rays[v, u, 1]
    return (
        a * R[0, 0] + b * R[1, 0] + R[2, 0],
        a * R[0, 1] + b * R[1, 1] + R[2, 1],
        a * R[0, 2] + b * R[1, 2] + R[2, 2],
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _find(
    depth: NDArray[np.float32],
    label: NDArray[np.uint8],
    left: int,
    right: int,
    view: View,
    start: NDArray[np.float32],
    top: NDArray[np.float32],
    count: NDArray[np.int32],
) -> None:
    """Where the rays of columns [left, right) end, from the profile of each one's azimuth.

    `depth` becomes the distance along the optical axis, a little behind canopy and face so that the
    foremost stalks stand out; `label` becomes what was met: _SKY, _CANOPY, _FACE or _GROUND."""
    rows = depth.shape[0]
    bins = start.shape[0]
    hx = view.axes[2, 0]
    hy = view.axes[2, 1]
    norm = math.sqrt(hx * hx + hy * hy)
    hx /= norm
    hy /= norm
    to_bin = 0.5 * bins / view.tangent
    for v in range(rows):
        for u in range(left, right):
            dx, dy, dz = _direction(view, u, v)
            ahead = max(1e-6, dx * hx + dy * hy)
            lateral = (dy * hx - dx * hy) / ahead
            which = min(max(int((lateral + view.tangent) * to_bin), 0), bins - 1)
            flat = ahead * view.stretch[which]
            slope = dz / flat
            hit = _SKY
            r = 1e9
            last = count[which] - 1
            for k in range(last + 1):
                high = top[which, k]
                near = start[which, k]
                if view.z + slope * near < high:
                    hit = _FACE
                    r = near + _FACE_BACK_M
                    break
                if slope < 0.0:
                    reach = (high - view.z) / slope
                    if k == last or reach < start[which, k + 1]:
                        if reach < 240.0:
                            hit = _CANOPY if high > 0.0 else _GROUND
                            r = reach + _CANOPY_BACK_M if high > 0.0 else reach
                        break
            depth[v, u] = r / flat
            label[v, u] = hit


@njit(cache=True, nogil=True)
def _masonry(kind: int, hit: int, x: float, y: float, z: float, channel: int) -> float:
    """BGR of a trunk's bark, a house's roof, or its wall with windows."""
    if kind == f.TRUNK:
        return (38.0, 52.0, 66.0)[channel]
    if hit == _CANOPY:
        return (70.0, 84.0, 150.0)[channel]
    along = 0.6 * (x + y)
    window = along - math.floor(along) < 0.3 and 0.9 < z < 1.9
    return (62.0, 66.0, 70.0)[channel] if window else (160.0, 186.0, 198.0)[channel]


@njit(cache=True, nogil=True)
def _between(grids: NDArray[np.float32], x: float, y: float, channel: int) -> float:
    """Bilinear interpolation between cells, clamped at the border."""
    rows, columns = grids.shape[:2]
    i = min(max(int(x), 0), columns - 2)
    j = min(max(int(y), 0), rows - 2)
    fx = min(1.0, max(0.0, x - i))
    fy = min(1.0, max(0.0, y - j))
    low = grids[j, i, channel] * (1.0 - fx) + grids[j, i + 1, channel] * fx
    high = grids[j + 1, i, channel] * (1.0 - fx) + grids[j + 1, i + 1, channel] * fx
    return float(low * (1.0 - fy) + high * fy)


@njit(cache=True, nogil=True, error_model="numpy")
def _fill(
    image: NDArray[np.uint8],
    depth: NDArray[np.float32],
    label: NDArray[np.uint8],
    left: int,
    right: int,
    scene: Scene,
    view: View,
    paint: Paint,
) -> None:
    """Paints what `_find` met in columns [left, right) and no stalk hides, and labels it."""
    rows = depth.shape[0]
    n_j, n_i = scene.clear.shape
    inv = 0.5 / scene.cell
    slab = scene.canopy
    side = texture.SIDE
    per_row = paint.panorama.shape[0] / (sky.PANORAMA_TOP - sky.PANORAMA_BOTTOM)
    per_column = paint.panorama.shape[1] / (2 * math.pi)
    for v in range(rows):
        for u in range(left, right):
            hit = label[v, u]
            if hit < _SKY:
                continue
            dx, dy, dz = _direction(view, u, v)
            flat = math.sqrt(dx * dx + dy * dy)
            if hit == _SKY:
                p = int((sky.PANORAMA_TOP - dz / flat) * per_row)
                p = min(max(p, 0), paint.panorama.shape[0] - 1)
                c = int((math.atan2(dy, dx) + math.pi) * per_column)
                c = min(max(c, 0), paint.panorama.shape[1] - 1)
                label[v, u] = BACKGROUND
                for q in range(3):
                    image[v, u, q] = int(min(255.0, paint.panorama[p, c, q] * paint.sky_gain))
                continue

            t = float(depth[v, u])
            if hit == _CANOPY:
                t -= _CANOPY_BACK_M / flat
            elif hit == _FACE:
                t -= (_FACE_BACK_M - 0.01) / flat
            px = (view.x + t * dx - scene.x0) * inv
            py = (view.y + t * dy - scene.y0) * inv
            outside = px < 0.0 or py < 0.0 or px >= n_i or py >= n_j
            wx = view.x + t * dx
            wy = view.y + t * dy
            wz = view.z + t * dz
            sx = wx
            sy = wy
            ao = 1.0
            green = 0.0
            if outside:
                # Fields beyond the grid: blocks of some 40 m, ripe or grass.
                far = noise.mix(77, math.floor(wx * 0.025), math.floor(wy * 0.04))
                tile = texture.TOP if hit != _GROUND or far & 3 else texture.GRASS
                here = NEIGHBOUR if hit != _GROUND else BACKGROUND
                seen = 0.85
            else:
                i = int(px)
                j = int(py)
                kind = scene.kind[int(2 * py), int(2 * px)]
                shadow = scene.stand[j, i, _SUNLIT]
                ao = 0.8 + 0.4 * scene.stand[j, i, _TONE]
                if hit == _GROUND:
                    shadow = _between(scene.stand, px - 0.5, py - 0.5, _SUNLIT)
                    seen = 1.0 - 0.88 * min(1.0, shadow * 8.0)
                    if kind in (f.STUBBLE, f.NEIGHBOUR_STUBBLE):
                        tile = texture.STUBBLE
                        here = STUBBLE
                    elif kind == f.WINDROW:
                        tile = texture.STRAW
                        here = STRAW
                    elif kind == f.GRASS:
                        tile = texture.GRASS
                        here = WEEDS
                    else:
                        tile = texture.SOIL
                        here = SOIL
                elif _solid(kind):
                    here = BACKGROUND
                    tile = _FLAT
                    seen = min(1.0, max(0.0, (wz - shadow) * 3.0 + 0.3))
                else:
                    here = STANDING if kind == f.CROP else NEIGHBOUR
                    green = scene.stand[j, i, _GREEN]
                    if hit == _CANOPY:
                        tile = texture.TOP
                        far_lit = min(0.9, 0.25 + 0.035 * t)
                        seen = max(far_lit, min(1.0, (wz - shadow) * 4.0 + 0.3))
                        ao *= min(1.0, 0.85 + 0.01 * t)
                    else:
                        tile = texture.WALL
                        near = 3.0 if t < 2.0 else 1.0
                        sx = 1.5 * near * (0.83 * wx + 0.57 * wy)
                        sy = -near * wz
                        seen = min(0.9, max(0.12, (wz - shadow) * 3.0 + 0.5))
                        ao *= min(1.0, 0.6 + 0.4 * wz / slab)
            foot = t / view.focal / texture.TEXEL_M
            if hit != _FACE:
                foot /= 0.3 + 0.7 * min(1.0, abs(dz) * 2.0)
            level = 0
            m = side
            while foot > 1.4 and m > 8:
                foot *= 0.5
                level += 1
                m >>= 1
            scale = m / (side * texture.TEXEL_M)
            ti = math.floor(sx * scale) & (m - 1)
            tj = math.floor(sy * scale) & (m - 1)
            texel = paint.levels[level] + tj * m + ti
            seen_i = int(255.0 * min(1.0, max(0.0, seen)))
            fog = paint.haze * t / (1.0 + paint.haze * t)
            label[v, u] = here
            for q in range(3):
                tint = ao * paint.light[seen_i, q]
                if green > 0.0:
                    tint *= 1.0 - green + green * paint.green_bgr[q] / paint.crop_bgr[q]
                albedo = (
                    paint.tiles[tile, texel, q] if tile >= 0 else _masonry(kind, hit, wx, wy, wz, q)
                )
                x = albedo * tint
                image[v, u, q] = int(min(255.0, x + fog * (paint.haze_bgr[q] - x)))


@njit(cache=True, nogil=True, error_model="numpy")
def _blocks_in_view(
    view: View, half_fov: float, scene: Scene, found: NDArray[np.int32], away: NDArray[np.float32]
) -> int:
    """Blocks of stalks within the view's wedge: their (row, column) and distance; how many."""
    rows, columns = scene.kind.shape
    width = columns * scene.cell
    height = rows * scene.cell
    hx = view.axes[2, 0]
    hy = view.axes[2, 1]
    norm = math.sqrt(hx * hx + hy * hy)
    hx /= norm
    hy /= norm
    cos = math.cos(half_fov)
    sin = math.sin(half_fov)
    i0 = max(0, int((view.x - scene.x0 - _REACH_M) / _BLOCK_M))
    i1 = min(int(width / _BLOCK_M), int((view.x - scene.x0 + _REACH_M) / _BLOCK_M) + 1)
    j0 = max(0, int((view.y - scene.y0 - _REACH_M) / _BLOCK_M))
    j1 = min(int(height / _BLOCK_M), int((view.y - scene.y0 + _REACH_M) / _BLOCK_M) + 1)
    count = 0
    for j in range(j0, j1):
        for i in range(i0, i1):
            ax = scene.x0 + (i + 0.5) * _BLOCK_M - view.x
            ay = scene.y0 + (j + 0.5) * _BLOCK_M - view.y
            ahead = ax * hx + ay * hy
            aside = abs(ax * hy - ay * hx)
            d = math.sqrt(ax * ax + ay * ay)
            if d > _REACH_M or ahead < -0.4 or aside * cos - ahead * sin > 0.6:
                continue
            found[count, 0] = j
            found[count, 1] = i
            away[count] = d
            count += 1
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def _project(
    blocks: NDArray[np.int32],
    packs: NDArray[np.float32],
    first: NDArray[np.int64],
    scene: Scene,
    view: View,
    paint: Paint,
    seed: int,
    t: float,
    sway_x: float,
    sway_y: float,
    gust: float,
    k0: int,
    k1: int,
    out: NDArray[np.float32],
    drawn: NDArray[np.int64],
) -> None:
    """Projects the stalks of blocks k0..k1 into `out` (see `_draw`); `drawn[k]` says how many."""
    R = view.axes
    n_j, n_i = scene.kind.shape
    inv = 1.0 / scene.cell
    rows, columns = view.rays.shape[:2]
    F = view.focal
    for k in range(k0, k1):
        bj = blocks[k, 0]
        bi = blocks[k, 1]
        pack = noise.mix(seed, bi, bj) & (_PACKS - 1)
        x_block = scene.x0 + bi * _BLOCK_M
        y_block = scene.y0 + bj * _BLOCK_M
        shown = first[k + 1] - first[k]
        wider = min(3.0, packs.shape[1] / max(1, shown))
        wave = 0.55 + 0.45 * math.sin(1.3 * x_block + 0.7 * y_block - 2.2 * t)
        n = 0
        for q in range(shown):
            s = packs[pack, q]
            x = x_block + s[0]
            y = y_block + s[1]
            i = int((x - scene.x0) * inv)
            j = int((y - scene.y0) * inv)
            if i >= n_i or j >= n_j:
                continue
            kind = scene.kind[j, i]
            ci = i >> 1
            cj = j >> 1
            if kind == f.SOIL or _solid(kind) or s[8] > scene.stand[cj, ci, _DENSITY]:
                continue
            tall = _standing(kind)
            lean_x = s[3]
            lean_y = s[4]
            head = 0.0
            if tall:
                lodge = scene.stand[cj, ci, _LODGE]
                height = scene.stand[cj, ci, _HEIGHT] * s[2]
                phase = 1.1 * t + 37.0 * s[8]
                flutter = 4.0 * abs(phase - math.floor(phase) - 0.5) - 1.0
                bend = wave + gust * flutter
                lean_x += sway_x * bend
                lean_y += sway_y * bend
                if lodge > 0.05:
                    lean = math.tan(lodge)
                    way = 6.28 * scene.stand[cj, ci, _TONE]
                    lean_x += lean * math.cos(way)
                    lean_y += lean * math.sin(way)
                head = 0.085 / max(height, 0.1)
            elif kind == f.WINDROW:
                if s[8] > 0.75:
                    continue
                height = 0.02 + 0.10 * s[6]
                lean_x *= 40.0
                lean_y *= 40.0
            elif kind == f.GRASS:
                if s[8] > 0.5:
                    continue
                height = 0.03 + 0.09 * s[6]
                lean_x *= 8.0
                lean_y *= 8.0
            else:
                height = 0.07 + 0.07 * s[6]
                lean_x *= 2.5
                lean_y *= 2.5
            ax = x - view.x
            ay = y - view.y
            az = -view.z
            bx = ax + height * lean_x
            by = ay + height * lean_y
            bz = az + height
            z0 = R[2, 0] * ax + R[2, 1] * ay + R[2, 2] * az
            z1 = R[2, 0] * bx + R[2, 1] * by + R[2, 2] * bz
            if z0 < 0.3 or z1 < 0.3:
                continue
            a0 = (R[0, 0] * ax + R[0, 1] * ay + R[0, 2] * az) / z0
            b0 = (R[1, 0] * ax + R[1, 1] * ay + R[1, 2] * az) / z0
            a1 = (R[0, 0] * bx + R[0, 1] * by + R[0, 2] * bz) / z1
            b1 = (R[1, 0] * bx + R[1, 1] * by + R[1, 2] * bz) / z1
            # Beyond twice the picture's corner the distortion polynomial is meaningless.
            r0 = min(a0 * a0 + b0 * b0, 2.0)
            r1 = min(a1 * a1 + b1 * b1, 2.0)
            g0 = F * (1.0 + r0 * (view.k1 + r0 * view.k2))
            g1 = F * (1.0 + r1 * (view.k1 + r1 * view.k2))
            v0 = b0 * g0 + view.cv
            v1 = b1 * g1 + view.cv
            u0 = a0 * g0 + view.cu + view.shear * (v0 / rows - 0.5)
            u1 = a1 * g1 + view.cu + view.shear * (v1 / rows - 0.5)
            if v1 > rows or v0 < 0 or v0 - v1 < 0.7:
                continue
            if min(u0, u1) > columns + 8 or max(u0, u1) < -8:
                continue
            visible = 1.0
            if tall:
                # Crop that stands 0.45 m nearer hides all but the top.
                near = 0.45 / math.sqrt(ax * ax + ay * ay)
                ni = int((x - near * ax - scene.x0) * inv)
                nj = int((y - near * ay - scene.y0) * inv)
                if 0 <= ni < n_i and 0 <= nj < n_j and _standing(scene.kind[nj, ni]):
                    visible = 0.42
            e = out[first[k] + n]
            e[0] = u0
            e[1] = v0
            e[2] = z0
            e[3] = u1
            e[4] = v1
            e[5] = z1
            scale = F / z1 * wider
            e[6] = (0.0019 if tall else 0.0026) * scale
            e[7] = 0.0050 * scale if tall else 0.0
            e[8] = head
            e[16] = s[7] * scale / wider if tall else 0.0
            e[9] = visible
            e[10] = height
            e[11] = scene.stand[cj, ci, _SUNLIT]
            if tall:
                e[12] = STANDING if kind == f.CROP else NEIGHBOUR
            elif kind == f.WINDROW:
                e[12] = STRAW
            elif kind == f.GRASS:
                e[12] = WEEDS
            else:
                e[12] = STUBBLE
            shade = s[5] * (0.86 + 0.28 * scene.stand[cj, ci, _TONE])
            if not tall:
                shade *= 1.12
            green = 0.0
            if tall:
                green = scene.stand[cj, ci, _GREEN] * (0.75 + 0.5 * s[6])
                if scene.stand[cj, ci, _WEED] > 0.3 and s[8] < 0.5:
                    green = 1.0
                green = min(1.0, green)
            elif kind == f.GRASS:
                green = 1.0
            for c in range(3):
                ripe = paint.crop_bgr[c] if tall else paint.straw_bgr[c]
                e[13 + c] = shade * (ripe + green * (paint.green_bgr[c] - ripe)) * s[9 + c]
            n += 1
        drawn[k] = n


@njit(cache=True, nogil=True, error_model="numpy")
def _draw(
    image: NDArray[np.uint8],
    depth: NDArray[np.float32],
    label: NDArray[np.uint8],
    left: int,
    right: int,
    first: NDArray[np.int64],
    drawn: NDArray[np.int64],
    stalks: NDArray[np.float32],
    paint: Paint,
) -> None:
    """Draws the stalks into columns [left, right), front to back.

    A stalk: base u, v, z; top u, v, z; half widths of stem and ear in px; the ear's share of the
    length; visible share from the top; height in m; height above which the sun reaches; label; BGR;
    how far the ear's tip nods aside in px.
    """
    rows = depth.shape[0]
    for k in range(drawn.shape[0]):
        for n in range(first[k], first[k] + drawn[k]):
            e = stalks[n]
            u0 = e[0]
            u1 = e[3]
            wide = max(e[6], e[7]) + abs(e[16]) + 1.0
            if max(u0, u1) + wide < left or min(u0, u1) - wide > right:
                continue
            v0 = e[1]
            v1 = e[4]
            long = v0 - v1
            per = 1.0 / long
            slant = 0.5 * abs(u1 - u0) * per
            ears = int(u1)
            va = max(0, math.ceil(v1 - 0.5))
            vb = min(rows - 1, math.floor(v0 - 0.5), int(v1 + long * e[9]))
            z0 = e[2]
            z1 = e[5]
            fog = 0.5 * (z0 + z1) * paint.haze
            fog = fog / (1.0 + fog)
            here = int(e[12])
            shaded = 0.22 if e[8] > 0.0 else 0.0
            for v in range(va, vb + 1):
                a = max(0.0, (v + 0.5 - v1) * per)
                z = z1 + (z0 - z1) * a
                uc = u1 + (u0 - u1) * a
                gain = 1.0
                if a < e[8]:
                    p = a / e[8]
                    w = e[7] * (0.4 + 2.4 * p * (1.0 - p))
                    uc += e[16] * (1.0 - p) * (1.0 - p)
                    gain = 1.08 if (v + ears) & 3 else 0.92
                else:
                    w = e[6]
                    if e[8] > 0.0:
                        gain = 0.93
                w = max(w, slant)
                ua = math.floor(uc - w + 0.5)
                ub = math.floor(uc + w + 0.5)
                if ub <= ua:
                    ub = ua + 1
                ua = max(ua, left)
                ub = min(ub, right)
                if ua >= ub or (z >= depth[v, ua] and z >= depth[v, ub - 1]):
                    continue
                over = (1.0 - a) * e[10] - e[11]
                seen = min(1.0, max(shaded, over * 4.0 + 0.4))
                gain *= 1.0 - 0.22 * a * e[9]
                si = int(255.0 * seen)
                c0 = min(255.0, e[13] * gain * paint.light[si, 0])
                c1 = min(255.0, e[14] * gain * paint.light[si, 1])
                c2 = min(255.0, e[15] * gain * paint.light[si, 2])
                c0 += fog * (paint.haze_bgr[0] - c0)
                c1 += fog * (paint.haze_bgr[1] - c1)
                c2 += fog * (paint.haze_bgr[2] - c2)
                for u in range(ua, ub):
                    if z < depth[v, u]:
                        depth[v, u] = z
                        label[v, u] = here
                        image[v, u, 0] = int(c0)
                        image[v, u, 1] = int(c1)
                        image[v, u, 2] = int(c2)


_PUFFS: Final = 14
_PUFF_LIFE_S: Final = 1.6


@njit(cache=True, nogil=True, error_model="numpy")
def _puff(
    veil: NDArray[np.float32],
    mount: NDArray[np.float64],
    focal: float,
    scale: int,
    seed: int,
    t: float,
    drift: NDArray[np.float64],
    ahead: float,
    half_width: float,
    density: float,
) -> None:
    """Lays the blade's dust over `veil` (rows, columns at 1/`scale` of the picture): opacity 0..1.

    A puff is born along the blade's line every life/_PUFFS seconds, rises, grows, drifts by `drift`
    (m/s in the vehicle frame) and fades. `mount` (4, 3): right, down, forward of the camera in the
    vehicle frame, and its place."""
    rows, columns = veil.shape
    every = _PUFF_LIFE_S / _PUFFS
    newest = math.floor(t / every)
    for k in range(_PUFFS):
        index = newest - k
        age = t - index * every
        share = age / _PUFF_LIFE_S
        if share >= 1.0:
            continue
        px = ahead + drift[0] * age - mount[3, 0]
        py = (2.0 * noise.uniform(seed, index, 1) - 1.0) * half_width + drift[1] * age - mount[3, 1]
        pz = 0.15 + (0.25 + 0.3 * noise.uniform(seed, index, 2)) * age - mount[3, 2]
        z = mount[2, 0] * px + mount[2, 1] * py + mount[2, 2] * pz
        if z < 0.3:
            continue
        u = (focal * (mount[0, 0] * px + mount[0, 1] * py + mount[0, 2] * pz) / z) / scale
        v = (focal * (mount[1, 0] * px + mount[1, 1] * py + mount[1, 2] * pz) / z) / scale
        u += 0.5 * columns
        v += 0.5 * rows
        radius = focal * (0.22 + 0.35 * age) / z / scale
        strength = density * (1.0 - share) * (0.4 + 0.6 * noise.uniform(seed, index, 3))
        for j in range(max(0, int(v - radius)), min(rows, int(v + radius) + 1)):
            for i in range(max(0, int(u - radius)), min(columns, int(u + radius) + 1)):
                d = ((i - u) ** 2 + (j - v) ** 2) / (radius * radius)
                if d < 1.0:
                    cloud = 0.7 + 0.6 * noise.smooth(seed + index, i * 0.1, j * 0.1)
                    veil[j, i] += (1.0 - veil[j, i]) * min(1.0, strength * (1.0 - d) ** 2 * cloud)


@njit(cache=True, nogil=True)
def _veil(image: NDArray[np.uint8], opacity: NDArray[np.uint8], bgr: NDArray[np.float32]) -> None:
    """Blends a colour over a picture in place; opacity 0..255 per pixel."""
    rows, columns = opacity.shape
    b = int(bgr[0])
    g = int(bgr[1])
    r = int(bgr[2])
    for v in range(rows):
        for u in range(columns):
            a = int(opacity[v, u])
            if a > 0:
                image[v, u, 0] += ((b - int(image[v, u, 0])) * a) >> 8
                image[v, u, 1] += ((g - int(image[v, u, 1])) * a) >> 8
                image[v, u, 2] += ((r - int(image[v, u, 2])) * a) >> 8


@njit(cache=True, nogil=True, error_model="numpy")
def _draw_crowns(
    image: NDArray[np.uint8],
    depth: NDArray[np.float32],
    label: NDArray[np.uint8],
    left: int,
    right: int,
    crowns: NDArray[np.float64],
    view: View,
    paint: Paint,
) -> None:
    """Draws the trees' crowns (n, 4: x, y, z, radius in m) into columns [left, right): balls of
    leaves, lit from above."""
    rows = depth.shape[0]
    R = view.axes
    for k in range(crowns.shape[0]):
        ax = crowns[k, 0] - view.x
        ay = crowns[k, 1] - view.y
        az = crowns[k, 2] - view.z
        z = R[2, 0] * ax + R[2, 1] * ay + R[2, 2] * az
        if z < 0.5:
            continue
        uc = view.focal * (R[0, 0] * ax + R[0, 1] * ay + R[0, 2] * az) / z + view.cu
        vc = view.focal * (R[1, 0] * ax + R[1, 1] * ay + R[1, 2] * az) / z + view.cv
        radius = view.focal * crowns[k, 3] / z
        leaf = 40.0 / radius
        fog = paint.haze * z / (1.0 + paint.haze * z)
        for v in range(max(0, int(vc - radius)), min(rows, int(vc + radius) + 1)):
            for u in range(max(left, int(uc - radius)), min(right, int(uc + radius) + 1)):
                dx = (u - uc) / radius
                dy = (v - vc) / radius
                clump = noise.smooth(k + 7, dx * 4.0 + 9.0, dy * 4.0 + 9.0)
                fine = noise.smooth(k + 8, (u - uc) * leaf + 99.0, (v - vc) * leaf + 99.0)
                if dx * dx + dy * dy > 0.45 + 0.5 * clump + 0.25 * fine or z >= depth[v, u]:
                    continue
                depth[v, u] = z
                label[v, u] = BACKGROUND
                lit = int(255.0 * min(1.0, max(0.0, 0.55 - 0.5 * dy + 0.9 * (clump + fine - 1.0))))
                for q in range(3):
                    x = (42.0, 84.0, 66.0)[q] * (0.7 + 0.6 * fine) * paint.light[lit, q]
                    image[v, u, q] = int(min(255.0, x + fog * (paint.haze_bgr[q] - x)))


def _bake_packs(rng: np.random.Generator, spec: f.FieldSpec) -> NDArray[np.float32]:
    """(packs, stalks, 12): x, y in the block; height factor; lean x, y; shade; stub 0..1; nod of
    the ear (m); rank 0..1 (density, flutter); BGR tint."""
    n = max(1, round(spec.stalks_per_m2 * _BLOCK_M**2))
    shape = (_PACKS, n)
    s = np.empty((*shape, 12), np.float32)
    s[..., 0] = rng.random(shape) * _BLOCK_M
    s[..., 1] = rng.random(shape) * _BLOCK_M
    if spec.drilled:
        row = rng.integers(0, 3, shape) + 0.5
        s[..., 1] = (row * _BLOCK_M / 3 + rng.normal(0, 0.02, shape)).clip(0, _BLOCK_M - 1e-3)
    s[..., 2] = rng.normal(1, 0.06, shape).clip(0.8, 1.15)
    s[..., 3:5] = rng.normal(0, 0.06, (*shape, 2)).clip(-0.16, 0.16)
    s[..., 5] = rng.uniform(0.72, 1.1, shape)
    s[..., 6] = rng.random(shape)
    s[..., 7] = rng.normal(0, 0.022, shape)
    s[..., 8] = rng.random(shape)
    s[..., 9:12] = rng.normal(1, 0.035, (*shape, 3))
    return s


@dataclass(frozen=True, slots=True)
class Shot:
    """Everything that a picture depends on, taken at the shutter: develop it in any thread."""

    t: float
    x: float
    y: float
    yaw: float
    roll: float
    pitch: float
    v: float
    yaw_rate: float
    blade_on: bool
    change: tuple[int, int, NDArray[np.uint8]] | None


class Camera:
    """Renders one field from one mount. `shutter` is called where the field changes; `develop` may
    run in another thread meanwhile, one shot after the other, in order. `capture` does both."""

    def __init__(
        self,
        field: f.Field,
        spec: CameraSpec | None = None,
        weather: WeatherSpec | None = None,
        seed: int = 0,
        threads: int = 2,
        *,
        blade_x_m: float = 1.5,
        blade_width_m: float = 1.0,
    ) -> None:
        """The blade's place (ahead of the rear axle) and width are where its dust rises."""
        self._blade_x_m = blade_x_m
        self._blade_width_m = blade_width_m
        self.spec = spec or CameraSpec()
        self.weather = weather or WeatherSpec()
        self._seed = seed
        self._threads = max(1, threads)
        self._pool = ThreadPoolExecutor(self._threads) if self._threads > 1 else None
        self._watch = field.watch()
        self._sun = sky.sun(self.weather)
        rng = np.random.default_rng(seed)
        coarse = field.height.shape
        stand = np.zeros((*coarse, 8), np.float32)
        for channel, grid in (
            (_HEIGHT, field.height),
            (_GREEN, field.green),
            (_DENSITY, field.density),
            (_WEED, field.weed),
            (_LODGE, field.lodge),
            (_TONE, field.tone),
        ):
            stand[..., channel] = grid
        self._scene = Scene(
            kind=field.kind.copy(),
            clear=np.zeros(coarse, np.float32),
            stand=stand,
            x0=field.origin[0],
            y0=field.origin[1],
            cell=field.cell,
            beyond_is_crop=field.spec.neighbours != "none",
            canopy=0.8 * field.tallest_crop_m,
        )
        self._coarse = field.coarse
        self._tallest = field.tallest_crop_m
        crowns = [
            (t.x_m, t.y_m, t.height_m - t.crown_radius_m, t.crown_radius_m)
            for t in field.spec.trees
        ]
        self._crowns = np.array(crowns, np.float64).reshape(-1, 4)
        corner = np.array([*field.origin, 0.0, 0.0])
        self._crowns_in_cells = (self._crowns - corner) / self._coarse
        self._refresh(0, coarse[0], 0, coarse[1])
        soil, straw, crop = (82.0, 110.0, 142.0), (106.0, 156.0, 200.0), (92.0, 142.0, 196.0)
        tiles, levels = texture.bake(seed, soil, straw, crop)
        self._paint = Paint(
            tiles=tiles,
            levels=levels,
            panorama=sky.panorama(self.weather, rng),
            light=sky.light_table(self.weather),
            sky_gain=float(np.mean(sky.light_table(self.weather)[255])),
            haze=self.weather.haze,
            haze_bgr=np.array([196.0, 208.0, 214.0], np.float32),
            crop_bgr=np.array(crop, np.float32),
            green_bgr=np.array([56.0, 138.0, 118.0], np.float32),
            straw_bgr=np.array(straw, np.float32),
        )
        self._packs = _bake_packs(rng, field.spec)
        s = self.spec
        h, w = s.height_px, s.width_px
        self._rays = self._bake_rays()
        # Azimuths reach past the picture's sides: pitch and roll spread them.
        half_fov = math.atan(float(np.linalg.norm(self._rays[-1, 0])))
        self._tangent = math.tan(min(1.5, 1.25 * half_fov + 0.1))
        bins = 2 * w
        middles = ((np.arange(bins) + 0.5) / bins * 2 - 1) * self._tangent
        self._stretch = np.sqrt(1 + middles**2)
        self._start = np.zeros((bins, _SEGMENTS), np.float32)
        self._top = np.zeros((bins, _SEGMENTS), np.float32)
        self._count = np.zeros(bins, np.int32)
        self._image = np.zeros((h, w, 3), np.uint8)
        self._depth = np.zeros((h, w), np.float32)
        self._label = np.zeros((h, w), np.uint8)
        self._records = np.zeros((0, 17), np.float32)
        tile = rng.normal(0, s.noise, (h + 128, w + 128, 3)).clip(-127, 127)
        self._noise = np.rint(tile).astype(np.int16)
        radius = np.linalg.norm(self._rays, axis=2) / np.linalg.norm(self._rays[0, 0])
        self._vignette = np.rint(255 * (1 - 0.22 * radius**2)).astype(np.uint8)[..., None]
        self._vignette = np.repeat(self._vignette, 3, axis=2)

    def _bake_rays(self) -> NDArray[np.float32]:
        s = self.spec
        u = (np.arange(s.width_px) + 0.5 - s.width_px / 2) / s.focal_px
        v = (np.arange(s.height_px) + 0.5 - s.height_px / 2) / s.focal_px
        distorted = np.stack(np.meshgrid(u, v), axis=2)
        ideal = distorted.copy()
        for _ in range(20):
            r = np.sum(ideal**2, axis=2, keepdims=True)
            ideal = distorted / (1 + r * (s.k1 + r * s.k2))
        return ideal.astype(np.float32)

    def _refresh(self, j0: int, j1: int, i0: int, i1: int) -> None:
        """Derived grids of the coarse cells [j0, j1) x [i0, i1), after `kind` changed there."""
        scene = self._scene
        rows, columns = scene.clear.shape
        # Distances beyond this are capped, so that a change reaches no further than the cap.
        cap = 1.5
        pad = math.ceil(cap / self._coarse)
        a, b = max(0, j0 - 2 * pad), min(rows, j1 + 2 * pad)
        c, d = max(0, i0 - 2 * pad), min(columns, i1 + 2 * pad)
        fine = scene.kind[2 * a : 2 * b, 2 * c : 2 * d]
        solid = np.isin(fine, (f.OBSTACLE, f.TRUNK))
        crop: NDArray[Any] = np.isin(fine, (f.CROP, f.NEIGHBOUR)).astype(np.uint8)
        # A strip left standing that is narrower than this is a row of stalks without a body.
        narrowest = max(2, round(0.25 / scene.cell))
        block = np.ones((narrowest, narrowest), np.uint8)
        crop = cv2.morphologyEx(crop, cv2.MORPH_OPEN, block, borderType=cv2.BORDER_REPLICATE)
        body = (crop > 0) | solid
        body = body[::2, ::2] | body[1::2, ::2] | body[::2, 1::2] | body[1::2, 1::2]
        free = (~body).astype(np.uint8)
        cells = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        # The diagonal: the point and the crop may each lie at the far corner of their cells.
        clear = np.clip((cells - 1.4143) * self._coarse, 0, cap)
        p, q = max(0, j0 - pad), min(rows, j1 + pad)
        r, s = max(0, i0 - pad), min(columns, i1 + pad)
        scene.clear[p:q, r:s] = clear[p - a : q - a, r - c : s - c]
        scene.stand[p:q, r:s, _BODY] = body[p - a : q - a, r - c : s - c]
        # Only crop is ever cut, so a change lengthens or shortens no longer shadow than the crop's.
        flat = math.hypot(self._sun.east, self._sun.north) / max(self._sun.up, 0.03)
        reach = math.ceil(self._tallest * flat / self._coarse) + 1
        _shade(
            scene.stand,
            self._coarse,
            self._sun.east,
            self._sun.north,
            self._sun.up,
            self._crowns_in_cells,
            max(0, j0 - reach),
            min(rows, j1 + reach),
            max(0, i0 - reach),
            min(columns, i1 + reach),
        )

    # ---- taking a picture -----------------------------------------------------------------------

    def shutter(
        self,
        t: float,
        x: float,
        y: float,
        yaw: float,
        roll: float = 0.0,
        pitch: float = 0.0,
        v: float = 0.0,
        yaw_rate: float = 0.0,
        blade_on: bool = False,
    ) -> Shot:
        """Freezes what a picture at time `t` (s) from a pose depends on. Roll is positive clockwise
        seen from behind, pitch nose down; both in radians, from the ground below the vehicle."""
        return Shot(t, x, y, yaw, roll, pitch, v, yaw_rate, blade_on, self._watch.take())

    def capture(
        self,
        t: float,
        x: float,
        y: float,
        yaw: float,
        roll: float = 0.0,
        pitch: float = 0.0,
        v: float = 0.0,
        yaw_rate: float = 0.0,
        blade_on: bool = False,
    ) -> NDArray[np.uint8]:
        """The picture (height, width, 3) BGR before JPEG; see `shutter`."""
        return self.develop(self.shutter(t, x, y, yaw, roll, pitch, v, yaw_rate, blade_on))

    def develop(self, shot: Shot) -> NDArray[np.uint8]:
        """The picture of a shot: (height, width, 3) BGR, a new array."""
        self._render(shot)
        return self._sense(shot)

    def labels(
        self,
        t: float,
        x: float,
        y: float,
        yaw: float,
        roll: float = 0.0,
        pitch: float = 0.0,
        v: float = 0.0,
        yaw_rate: float = 0.0,
        blade_on: bool = False,
    ) -> NDArray[np.uint8]:
        """What each pixel of `capture` with the same arguments shows: (height, width) uint8 of the
        label constants."""
        self._render(self.shutter(t, x, y, yaw, roll, pitch, v, yaw_rate, blade_on))
        label = self._label.copy()
        # Single stalks stand out of the crop's outline: close their gaps before taking the border.
        crop = (label == STANDING).astype(np.uint8)
        solid = cv2.morphologyEx(crop, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
        solid = cv2.morphologyEx(solid, cv2.MORPH_OPEN, np.ones((9, 9), np.uint8))
        right = np.zeros_like(solid)
        right[:, :-2] = solid[:, 2:]
        open_ground = np.isin(label, (STUBBLE, STRAW, SOIL, WEEDS)).astype(np.uint8)
        beside = cv2.dilate(open_ground, np.ones((1, 15), np.uint8))
        label[(solid == 1) & (right == 0) & (beside == 1)] = EDGE
        return label

    def encode(self, bgr: NDArray[np.uint8]) -> bytes:
        """The JPEG file of a picture at the spec's quality."""
        ok, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, self.spec.jpeg_quality])
        if not ok:
            raise ValueError(f"cannot encode a picture of shape {bgr.shape} as JPEG")
        return data.tobytes()

    # ---- rendering ------------------------------------------------------------------------------

    def _view(self, shot: Shot) -> View:
        s = self.spec
        yaw = shot.yaw + math.radians(s.yaw_deg)
        pitch = shot.pitch + math.radians(s.pitch_deg)
        roll = shot.roll + math.radians(s.roll_deg)
        forward = np.array(
            [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch)]
        )
        level = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
        under = np.cross(forward, level)
        axes = np.stack(
            [
                math.cos(roll) * level + math.sin(roll) * under,
                math.cos(roll) * under - math.sin(roll) * level,
                forward,
            ]
        )
        c, n = math.cos(shot.yaw), math.sin(shot.yaw)
        # The mount tips with the vehicle about its ground point.
        ahead = s.x_m + s.z_m * math.sin(shot.pitch)
        aside = s.y_m - s.z_m * math.sin(shot.roll)
        up = s.z_m - s.x_m * math.sin(shot.pitch) + s.y_m * math.sin(shot.roll)
        return View(
            x=shot.x + ahead * c - aside * n,
            y=shot.y + ahead * n + aside * c,
            z=max(0.05, up),
            axes=axes,
            focal=s.focal_px,
            cu=s.width_px / 2,
            cv=s.height_px / 2,
            k1=s.k1,
            k2=s.k2,
            shear=s.focal_px * shot.yaw_rate * s.readout_s,
            rays=self._rays,
            tangent=self._tangent,
            stretch=self._stretch,
        )

    def _render(self, shot: Shot) -> None:
        scene, paint = self._scene, self._paint
        if shot.change is not None:
            j0, i0, kinds = shot.change
            j1, i1 = j0 + kinds.shape[0], i0 + kinds.shape[1]
            scene.kind[j0:j1, i0:i1] = kinds
            self._refresh(j0 // 2, (j1 + 1) // 2, i0 // 2, (i1 + 1) // 2)
        view = self._view(shot)

        # Level of detail: distant blocks draw a prefix of their stalks, wider.
        limit = int((2 * _REACH_M / _BLOCK_M + 2) ** 2)
        blocks = np.empty((limit, 2), np.int32)
        away = np.empty(limit, np.float32)
        corner = float(np.linalg.norm(self._rays[-1, 0]))
        found = _blocks_in_view(view, math.atan(corner) + 0.05, scene, blocks, away)
        order = np.argsort(away[:found], kind="stable")
        blocks, away = blocks[order], away[order]
        share = np.clip(3.5 / np.maximum(away, 0.1), 0.08, 1.0)
        first = np.zeros(found + 1, np.int64)
        np.cumsum(np.ceil(self._packs.shape[1] * share).astype(np.int64), out=first[1:])
        if first[-1] > len(self._records):
            self._records = np.zeros((int(first[-1] * 1.3), 17), np.float32)
        drawn = np.zeros(found, np.int64)
        weather = self.weather
        toward = math.radians(90 - weather.wind_from_deg + 180)
        sway = 0.012 * weather.wind_mps
        sway_x, sway_y = sway * math.cos(toward), sway * math.sin(toward)

        records, bins, width = self._records, len(self._count), self.spec.width_px

        def prepare(part: int) -> None:
            k0, k1 = (
                int(np.searchsorted(first, first[-1] * p / _STRIPS)) for p in (part, part + 1)
            )
            _project(
                blocks, self._packs, first, scene, view, paint, self._seed, shot.t,
                sway_x, sway_y, 0.35, k0, found if part + 1 == _STRIPS else k1, records, drawn,
            )  # fmt: skip
            b0, b1 = bins * part // _STRIPS, bins * (part + 1) // _STRIPS
            _profile(scene, view, b0, b1, self._start, self._top, self._count)

        def draw(part: int) -> None:
            left, right = width * part // _STRIPS, width * (part + 1) // _STRIPS
            canvas = self._image, self._depth, self._label, left, right
            _find(*canvas[1:], view, self._start, self._top, self._count)
            _draw_crowns(*canvas, self._crowns, view, paint)
            _draw(*canvas, first, drawn, records, paint)
            _fill(*canvas, scene, view, paint)

        for stage in (prepare, draw):
            if self._pool is None:
                for part in range(_STRIPS):
                    stage(part)
            else:
                list(self._pool.map(stage, range(_STRIPS)))

        if shot.blade_on and self.weather.dust > 0:
            self._raise_dust(shot)

    def _raise_dust(self, shot: Shot) -> None:
        s, weather = self.spec, self.weather
        pitch, yaw, scale = math.radians(s.pitch_deg), math.radians(s.yaw_deg), 4
        forward = (
            math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch)
        )  # fmt: skip
        right = (math.sin(yaw), -math.cos(yaw), 0.0)
        mount = np.array([right, np.cross(forward, right), forward, (s.x_m, s.y_m, s.z_m)])
        toward = math.radians(90 - weather.wind_from_deg + 180) - shot.yaw
        wind = 0.4 * weather.wind_mps  # near the ground
        drift = np.array([wind * math.cos(toward) - shot.v, wind * math.sin(toward)])
        veil = np.zeros((s.height_px // scale, s.width_px // scale), np.float32)
        _puff(
            veil, mount, s.focal_px, scale, self._seed + 13, shot.t, drift, self._blade_x_m,
            self._blade_width_m / 2, weather.dust,
        )  # fmt: skip
        coarse = np.rint(veil * 255).astype(np.uint8)
        opacity: NDArray[Any] = cv2.resize(
            coarse, (s.width_px, s.height_px), interpolation=cv2.INTER_LINEAR
        )
        _veil(self._image, opacity, np.array([160.0, 182.0, 200.0], np.float32))

    # ---- sensor ---------------------------------------------------------------------------------

    def _sense(self, shot: Shot) -> NDArray[np.uint8]:
        s = self.spec
        image: NDArray[Any] = cv2.GaussianBlur(self._image, (3, 3), 0)
        smear = round(s.focal_px * abs(shot.yaw_rate) * s.shutter_s)
        if smear > 1:
            image = cv2.blur(image, (smear, 1))
        image = cv2.multiply(image, self._vignette, scale=1 / 255)
        mean = max(8.0, float(image[::8, ::8].mean()))
        wander = 1 + 0.04 * (noise.smooth(self._seed + 5, shot.t * 0.4, 0.5) - 0.5)
        gain = wander * (s.target / mean) ** s.exposure
        tint = noise.smooth(self._seed + 6, shot.t * 0.1, 0.5) - 0.5
        level = np.arange(256, dtype=np.float64)[:, None] * gain
        level = level * np.array([1 + 0.05 * tint, 1.0, 1 - 0.05 * tint])
        # A shoulder above 200 keeps highlights from clipping hard.
        level = np.where(level > 200, 200 + 55 * (1 - np.exp(-(level - 200) / 55)), level)
        table = np.rint(np.clip(level, 0, 255)).astype(np.uint8)[None]
        image = cv2.LUT(image, table)
        h = noise.mix(self._seed, round(shot.t * 1e6), 9)
        dv, du = int(h) % 128, (int(h) >> 8) % 128
        rough = self._noise[dv : dv + s.height_px, du : du + s.width_px]
        return np.asarray(cv2.add(image, rough, dtype=cv2.CV_8U))
