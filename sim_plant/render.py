"""The kernels that draw a picture of the field: numba, in float64, without a state of their own.

A picture is made in five passes over fixed strips of columns, so that the number of threads cannot
matter: `profile` (what heights each azimuth crosses), `find` (where each pixel's ray ends),
`draw_crowns` and `draw_stalks` (z-buffered, front to back), `fill` (what no stalk hides). Colours
are display-referred BGR; light multiplies them by a factor from `Paint.light`.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numba
import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim_plant import field as f
from sim_plant import labels, noise, sky, texture

BLOCK_M: Final = 0.5
"""Side of a block of stalks."""
PACKS: Final = 64
"""Different blocks; which one stands where is drawn per block."""
SUNLIT, HEIGHT, GREEN, DENSITY, WEED, LODGE, TONE, BODY = range(8)
UNIT: Final = 1.0 / 4096.0
"""Of `Scene.stand`."""
_SKY, _CANOPY, _FACE, _GROUND = range(100, 104)
"""Pixels that are found but not painted yet, among the labels."""
_WIDE: Final = 8
_GROUND_WIDE: Final = 4
_HIGH: Final = 2
"""Of a cell of the picture, px: its pixels that met the same share light, haze, tile and label.
Narrower on the ground, where shadows have an edge."""
_KNOWN, _TILE, _HERE, _KIND, _BASE, _MASK, _GAIN, _, _, _FOG, _, _ = range(12)
_BACKGROUND: Final = labels.BACKGROUND << 24
_FLAT: Final = -1
"""Instead of a tile: no texture."""
_CANOPY_BACK_M: Final = 0.25
_FACE_BACK_M: Final = 0.30
"""How far behind its front the body of the crop lies: stalks fill the space between."""
SEGMENTS: Final = 48
"""Changes of height along an azimuth that a profile holds."""
LIMIT, RISE, BACK, MET = range(4)
"""Of a profile's piece."""
STRIPS: Final = 6
"""The picture is drawn in so many strips of columns, whatever the number of threads."""
REACH_M: Final = 24.0
"""Stalks are drawn up to here; the canopy's texture beyond."""


Canvas = NDArray[np.int64]
"""(rows, columns): a pixel's depth in 1/DEPTHS_PER_M in the upper half, then its label, red, green
and blue: what is nearer is the lesser number."""
DEPTHS_PER_M: Final = 65536.0
_ONE: Final = 4294967296.0
FARTHEST_M: Final = 32767.0


GROWN: Final = np.dtype(
    [
        ("x", np.float32),  # in its block, m
        ("y", np.float32),
        ("height", np.float32),  # factor on the field's
        ("lean_x", np.float32),  # horizontal per vertical
        ("lean_y", np.float32),
        ("shade", np.float32),
        ("stub", np.float32),  # 0..1, of what remains when cut
        ("nod", np.float32),  # of the ear's tip aside, m
        ("rank", np.float32),  # 0..1: the thin crop's stalks have the low ones
        ("blue", np.float32),  # tint, about 1
        ("green", np.float32),
        ("red", np.float32),
    ]
)
"""A stalk as it grows in a block."""

STALK: Final = np.dtype(
    [
        ("u0", np.float32),  # base in the picture, px, and its depth, m
        ("v0", np.float32),
        ("z0", np.float32),
        ("u1", np.float32),  # top
        ("v1", np.float32),
        ("z1", np.float32),
        ("stem", np.float32),  # half widths, px
        ("ear", np.float32),
        ("ear_share", np.float32),  # of the length, from the top
        ("visible", np.float32),  # share of the length, from the top
        ("height", np.float32),  # m
        ("sunlit", np.float32),  # above this height, m
        ("label", np.float32),
        ("blue", np.float32),
        ("green", np.float32),
        ("red", np.float32),
        ("nod", np.float32),  # px
    ]
)
"""A stalk as it is drawn."""


class Scene(NamedTuple):
    """The grids as the renderer reads them; coarse ones have half of `kind`'s rows and columns."""

    kind: NDArray[np.uint8]
    clear: NDArray[np.float32]
    """Coarse: a lower bound of the distance to standing crop, m."""
    stand: NDArray[np.uint16]
    """Coarse, (rows, columns, 8), in 1/UNIT: `SUNLIT` (above this height in m the sun reaches) and
    the field's attributes; together and small, because a lookup costs a cache line."""
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
    rays_a: NDArray[np.float32]
    """(rows, columns): undistorted normalised image coordinate to the right."""
    rays_b: NDArray[np.float32]
    """The same downward."""
    tangent: float
    """Of the largest azimuth that the profiles hold, either side of the heading."""


class Paint(NamedTuple):
    """Colours: tiles, background, light and haze, all BGR."""

    tiles: NDArray[np.int32]
    """(tile, texel), packed: blue in the lowest byte, then green and red."""
    levels: NDArray[np.int32]
    panorama: NDArray[np.int32]
    """Packed like a texel, as bright as the sky is at this hour."""
    light: NDArray[np.float32]
    haze: float
    haze_bgr: NDArray[np.float32]
    crop_bgr: NDArray[np.float32]
    green_bgr: NDArray[np.float32]
    straw_bgr: NDArray[np.float32]
    unripe_loss: NDArray[np.float32]
    """1 - green/crop: what unripe crop lacks of the ripe one's colour."""


class Wind(NamedTuple):
    """How the stalks sway at time `t`, s: tangents of the mean lean, and the gusts' share."""

    t: float
    sway_x: float
    sway_y: float
    gust: float


class Stalks(NamedTuple):
    """The blocks in view, near ones first, and their stalks in the picture."""

    blocks: NDArray[np.int32]
    """(blocks, 2): row and column."""
    packs: NDArray[Any]
    """(PACKS, stalks) of GROWN."""
    first: NDArray[np.int64]
    """Of block k, the place of its first stalk in `records` and `spans`."""
    drawn: NDArray[np.int64]
    """Of block k, how many stalks from there on are in the picture."""
    records: NDArray[Any]
    """Of STALK."""
    spans: NDArray[np.int16]
    """(stalks, 2): the columns that each covers."""


class Profiles(NamedTuple):
    """What the rays of each azimuth meet; see `profile`."""

    pieces: NDArray[np.float32]
    counts: NDArray[np.int32]


@njit(cache=True, nogil=True)
def _standing(kind: int) -> bool:
    return kind in (f.CROP, f.NEIGHBOUR)


@njit(cache=True, nogil=True)
def _solid(kind: int) -> bool:
    return kind in (f.OBSTACLE, f.TRUNK)


@njit(cache=True, nogil=True, error_model="numpy")
def shade(
    stand: NDArray[np.uint16],
    coarse: float,
    tallest: float,
    east: float,
    north: float,
    up: float,
    crowns: NDArray[np.float64],
    j0: int,
    j1: int,
    i0: int,
    i1: int,
) -> None:
    """Fills SUNLIT in a range of coarse cells: how high the shadow of what stands sunward reaches.

    Nothing is higher than `tallest`. `crowns` (n, 4): x, y, z and radius of the trees' crowns in
    coarse cells from the grid's corner.
    """
    rows, columns = stand.shape[:2]
    flat = math.hypot(east, north)
    tangent = up / max(flat, 1e-6)
    dx = east / max(flat, 1e-6)
    dy = north / max(flat, 1e-6)
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
                if stand[q, p, BODY] > 0:
                    h = UNIT * stand[q, p, HEIGHT] - s * tangent
                    highest = max(highest, h)
                s += 0.05
            stand[j, i, SUNLIT] = np.uint16(min(65535.0, highest / UNIT + 0.5))


@njit(cache=True, nogil=True, error_model="numpy")
def profile(
    scene: Scene,
    view: View,
    b0: int,
    b1: int,
    profiles: Profiles,
) -> None:
    """What the rays of azimuths b0..b1 meet, by their slope (rise per horizontal distance).

    Of a ray of bin b the first of `counts[b]` pieces with slope < `pieces[b, k, LIMIT]` says what
    it meets (MET) and its depth: RISE over the direction's z, plus BACK over its horizontal length.
    Piece `counts[b]` is sky. The azimuth of bin b is atan(_bin_tangent(b)) to the left of the
    view's heading. Free ground is crossed by leaps of the clear distance, crop by steps of 8 cm and
    more with the distance.
    """
    pieces, counts = profiles
    n_j, n_i = scene.clear.shape
    inv = 0.5 / scene.cell
    hx = view.axes[2, 0]
    hy = view.axes[2, 1]
    norm = math.sqrt(hx * hx + hy * hy)
    hx /= norm
    hy /= norm
    bins = pieces.shape[0]
    px0 = (view.x - scene.x0) * inv
    py0 = (view.y - scene.y0) * inv
    start = np.empty(SEGMENTS)
    top = np.empty(SEGMENTS)
    for b in range(b0, b1):
        lateral = _bin_tangent(b, bins, view.tangent)
        stretch = math.sqrt(1.0 + lateral * lateral)
        dx = (hx - lateral * hy) / stretch * inv
        dy = (hy + lateral * hx) / stretch * inv
        n = 0
        r = 0.0
        now = -1.0
        while n < SEGMENTS - 1 and r < 80.0:
            px = px0 + r * dx
            py = py0 + r * dy
            if px < 0.0 or py < 0.0 or px >= n_i or py >= n_j:
                break
            i = int(px)
            j = int(py)
            height = 0.0
            leap = float(scene.clear[j, i])
            if leap > 0.0:
                # Along an edge the distance to it would make the steps too many.
                leap = max(leap + 0.005, 0.008 * r)
            else:
                leap = 0.5 * scene.cell
                if scene.stand[j, i, BODY] > 0:
                    kind = scene.kind[int(2.0 * py), int(2.0 * px)]
                    if _standing(kind):
                        height = 0.8 * UNIT * scene.stand[j, i, HEIGHT]
                        leap = 0.08 + 0.03 * r
                    elif _solid(kind):
                        height = UNIT * scene.stand[j, i, HEIGHT]
            entered = (height > 0.0) != (now > 0.0)
            if now < 0.0 or entered or abs(height - now) > 0.06:
                start[n] = r
                top[n] = height
                if entered and height > 0.0 and leap > 0.5 * scene.cell:
                    # The crop's upper border is ragged.
                    top[n] += 0.16 * noise.uniform(5, int(30.0 * px), int(30.0 * py)) - 0.10
                n += 1
                now = height
            r += leap
        start[n] = r
        top[n] = scene.canopy if scene.beyond_is_crop else 0.0

        m = 0
        highest = -math.inf
        for k in range(n + 1):
            rise = top[k] - view.z
            limit = rise / max(start[k], 1e-6)
            if limit > highest:
                highest = limit
                pieces[b, m, LIMIT] = limit
                pieces[b, m, RISE] = 0.0
                pieces[b, m, BACK] = start[k] + _FACE_BACK_M
                pieces[b, m, MET] = _FACE
                m += 1
            if rise < 0.0:
                limit = rise / (start[k + 1] if k < n else 240.0)
                if limit > highest:
                    highest = limit
                    pieces[b, m, LIMIT] = limit
                    pieces[b, m, RISE] = rise
                    pieces[b, m, BACK] = _CANOPY_BACK_M if top[k] > 0.0 else 0.0
                    pieces[b, m, MET] = _CANOPY if top[k] > 0.0 else _GROUND
                    m += 1
        pieces[b, m, LIMIT] = math.inf
        pieces[b, m, RISE] = 0.0
        pieces[b, m, BACK] = 1e9
        pieces[b, m, MET] = _SKY
        counts[b] = m


@njit(cache=True, nogil=True)
def _bin_tangent(b: float, bins: int, tangent: float) -> float:
    return ((b + 0.5) / bins * 2.0 - 1.0) * tangent


@njit(cache=True, nogil=True)
def _heading(view: View) -> NDArray[np.float32]:
    """The view's axes in the heading frame, (right, down, forward) x (ahead, left, up): float32,
    so that the loops over a row run several pixels at once."""
    hx = view.axes[2, 0]
    hy = view.axes[2, 1]
    norm = math.sqrt(hx * hx + hy * hy)
    out = np.empty((3, 3), np.float32)
    for k in range(3):
        out[k, 0] = (view.axes[k, 0] * hx + view.axes[k, 1] * hy) / norm
        out[k, 1] = (view.axes[k, 1] * hx - view.axes[k, 0] * hy) / norm
        out[k, 2] = view.axes[k, 2]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def find(
    canvas: Canvas,
    left: int,
    right: int,
    view: View,
    profiles: Profiles,
) -> None:
    """Where the rays of columns [left, right) end, from the profile of each one's azimuth.

    The depth becomes the distance along the optical axis, a little behind canopy and face so that
    the foremost stalks stand out; the label becomes what was met: _SKY, _CANOPY, _FACE or
    _GROUND."""
    pieces, counts = profiles
    rows = canvas.shape[0]
    n = right - left
    axes = _heading(view)
    ra, rl, rz = axes[0]
    da, dl, dz = axes[1]
    fa, fl, fz = axes[2]
    one = np.float32(1.0)
    tiny = np.float32(1e-7)
    bins = pieces.shape[0]
    tangent = np.float32(view.tangent)
    to_bin = np.float32(0.5 * bins / view.tangent)
    most = np.float32(bins - 1)
    none = np.float32(0.0)
    per_flat = np.empty(n, np.float32)
    up = np.empty(n, np.float32)
    bin_of = np.empty(n, np.int32)
    rise = np.empty(n + 1, np.float32)
    back = np.empty(n + 1, np.float32)
    met = np.empty(n + 1, np.int32)
    farthest = np.float32(FARTHEST_M)
    per_m = np.float32(DEPTHS_PER_M)
    for v in range(rows):
        a_row = view.rays_a[v, left:right]
        b_row = view.rays_b[v, left:right]
        shift = np.float32(view.shear * ((v + 0.5) / rows - 0.5) / view.focal)
        for i in range(n):
            a = a_row[i] - shift
            b = b_row[i]
            per_ahead = one / max(tiny, a * ra + b * da + fa)
            lateral = (a * rl + b * dl + fl) * per_ahead
            z = a * rz + b * dz + fz
            up[i] = z if abs(z) > tiny else -tiny
            per_flat[i] = per_ahead / np.sqrt(one + lateral * lateral)
            bin_of[i] = np.int32(min(max((lateral + tangent) * to_bin, none), most))
        k = 0
        for i in range(0, n, 2):
            which = bin_of[i]
            slope = up[i] * per_flat[i]
            # Neighbours mostly meet the same; a pair always does.
            k = min(k, counts[which])
            while k > 0 and slope < pieces[which, k - 1, LIMIT]:
                k -= 1
            while slope >= pieces[which, k, LIMIT]:
                k += 1
            rise[i] = rise[i + 1] = pieces[which, k, RISE]
            back[i] = back[i + 1] = pieces[which, k, BACK]
            met[i] = met[i + 1] = np.int32(pieces[which, k, MET])
        row = canvas[v, left:right]
        for i in range(n):
            far = min(abs(rise[i] / up[i]) + back[i] * per_flat[i], farthest)
            row[i] = np.int64(np.int32(far * per_m)) << 32 | np.int64(met[i]) << 24


@njit(cache=True, nogil=True)
def _masonry(kind: int, hit: int, x: float, y: float, z: float) -> int:
    """A trunk's bark, a house's roof, or its wall with windows, packed as a tile's texel."""
    if kind == f.TRUNK:
        return 38 | 52 << 8 | 66 << 16
    if hit == _CANOPY:
        return 70 | 84 << 8 | 150 << 16
    along = 0.6 * (x + y)
    if along - math.floor(along) < 0.3 and 0.9 < z < 1.9:
        return 62 | 66 << 8 | 70 << 16
    return 160 | 186 << 8 | 198 << 16


@njit(cache=True, nogil=True)
def _between(grids: NDArray[np.uint16], x: float, y: float, channel: int) -> float:
    """Bilinear interpolation between cells of `Scene.stand`, clamped at the border."""
    rows, columns = grids.shape[:2]
    i = min(max(int(x), 0), columns - 2)
    j = min(max(int(y), 0), rows - 2)
    fx = min(1.0, max(0.0, x - i))
    fy = min(1.0, max(0.0, y - j))
    low = grids[j, i, channel] * (1.0 - fx) + grids[j, i + 1, channel] * fx
    high = grids[j + 1, i, channel] * (1.0 - fx) + grids[j + 1, i + 1, channel] * fx
    return float(low * (1.0 - fy) + high * fy) * UNIT


@njit(cache=True, nogil=True, error_model="numpy")
def _azimuth(tangent: Any) -> Any:
    """atan in float32, to 1e-5: a series, so that several run at once."""
    one = np.float32(1.0)
    steep = abs(tangent) > one
    x = one / tangent if steep else tangent
    q = x * x
    series = np.float32(0.05265332) - np.float32(0.0117212) * q
    series = np.float32(0.19354346) + q * (series * q - np.float32(0.11643287))
    angle = x * (np.float32(0.99997726) + q * (series * q - np.float32(0.33262347)))
    right = np.float32(math.pi / 2)
    beyond = right - angle if tangent > np.float32(0.0) else -right - angle
    return beyond if steep else angle


@njit(cache=True, nogil=True, error_model="numpy")
def fill(
    image: NDArray[np.uint8],
    canvas: Canvas,
    left: int,
    right: int,
    scene: Scene,
    view: View,
    paint: Paint,
) -> None:
    """Paints and labels what `find` met in columns [left, right) and no stalk hides; then copies
    the colours of all into `image`.

    Pixels of a cell that met the same share light, haze, tile and label; each has its own texel."""
    rows = canvas.shape[0]
    n = right - left
    n_j, n_i = scene.clear.shape
    inv = 0.5 / scene.cell
    slab = scene.canopy
    tiles = paint.tiles.ravel()
    tile_size = paint.tiles.shape[1]
    side = texture.SIDE
    texels_per_m = 1.0 / (side * texture.TEXEL_M)
    per_footprint = 1.0 / (view.focal * texture.TEXEL_M)
    sky_top = np.float32(sky.PANORAMA_TOP)
    lowest = np.float32(paint.panorama.shape[0] - 1)
    per_row = np.float32(paint.panorama.shape[0] / (sky.PANORAMA_TOP - sky.PANORAMA_BOTTOM))
    per_column = np.float32(paint.panorama.shape[1] / (2 * math.pi))
    # A turn more than the panorama's beginning, so that no column is negative.
    ahead = np.float32(math.atan2(view.axes[2, 1], view.axes[2, 0]) + 3 * math.pi)
    axes = view.axes.astype(np.float32)
    rx, ry, rz = axes[0]
    dx, dy, dz = axes[1]
    fx, fy, fz = axes[2]
    heading = _heading(view)
    ra, rl = heading[0, 0], heading[0, 1]
    da, dl = heading[1, 0], heading[1, 1]
    fa = heading[2, 0]
    x0 = np.float32(view.x)
    y0 = np.float32(view.y)
    z0 = np.float32(view.z)
    one = np.float32(1.0)
    none = np.float32(0.0)
    depth_unit = np.float32(1.0 / DEPTHS_PER_M)
    offset = np.float32(65536.0)
    tiny = np.float32(1e-7)
    canopy_back = np.float32(_CANOPY_BACK_M)
    face_back = np.float32(_FACE_BACK_M - 0.01)
    haze_blue = 256.0 * paint.haze_bgr[0]
    haze_green = 256.0 * paint.haze_bgr[1]
    haze_red = 256.0 * paint.haze_bgr[2]
    across = (n + _WIDE - 1) // _WIDE
    met = np.zeros((2 * across + (n + _GROUND_WIDE - 1) // _GROUND_WIDE, 12), np.int32)
    where = np.empty((len(met), 4), np.float32)
    of = np.empty(n + 1, np.int32)
    sky_of = np.empty(n + 1, np.int32)
    hits = np.empty(n, np.int32)
    cells = np.empty(n, np.int32)
    at = np.empty(n, np.int32)
    texels = np.empty(n, np.int32)
    ups = np.empty(n, np.float32)
    ts = np.empty(n, np.float32)
    xs = np.empty(n, np.float32)
    ys = np.empty(n, np.float32)
    zs = np.empty(n, np.float32)
    for v in range(rows):
        a_row = view.rays_a[v, left:right]
        b_row = view.rays_b[v, left:right]
        row = canvas[v, left:right]
        shift = np.float32(view.shear * ((v + 0.5) / rows - 0.5) / view.focal)
        for i in range(n):
            a = a_row[i] - shift
            b = b_row[i]
            east = a * rx + b * dx + fx
            north = a * ry + b * dy + fy
            up = a * rz + b * dz + fz
            hit = np.int32(row[i] >> 24) & np.int32(255)
            hits[i] = hit
            forward = canopy_back if hit == _CANOPY else none
            forward = face_back if hit == _FACE else forward
            deep = np.float32(np.int32(row[i] >> 32)) * depth_unit
            t = deep - forward / np.sqrt(east * east + north * north)
            ups[i] = up
            ts[i] = t
            xs[i] = x0 + t * east
            ys[i] = y0 + t * north
            zs[i] = z0 + t * up
        if v % _HIGH == 0:
            met[:, _KNOWN] = 0
        # Without a branch, which no one could foretell.
        covered = 0
        skies = 0
        for i in range(n):
            hit = hits[i]
            of[covered] = i
            covered += hit > _SKY
            sky_of[skies] = i
            skies += hit == _SKY
        if skies > 0:
            for i in range(n):
                a = a_row[i] - shift
                b = b_row[i]
                per = one / max(tiny, a * ra + b * da + fa)
                lateral = (a * rl + b * dl) * per
                steep = ups[i] * per / np.sqrt(one + lateral * lateral)
                at[i] = np.int32(min(max((sky_top - steep) * per_row, none), lowest))
                cells[i] = np.int32((ahead + _azimuth(lateral)) * per_column)
            for k in range(skies):
                i = sky_of[k]
                c = cells[i]
                while c >= paint.panorama.shape[1]:
                    c -= paint.panorama.shape[1]
                row[i] = _BACKGROUND | paint.panorama[at[i], c]
        cell = -1
        tile = 0
        kind = 0
        base = 0
        mask = 0
        ax = none
        ay = none
        cy = none
        cz = none
        for k in range(covered):
            i = of[k]
            hit = hits[i]
            mine = (hit - _CANOPY) * across + (i // _GROUND_WIDE if hit == _GROUND else i // _WIDE)
            if mine != cell and met[mine, _KNOWN] == 0:
                t = float(ts[i])
                wx = float(xs[i])
                wy = float(ys[i])
                wz = float(zs[i])
                px = (wx - scene.x0) * inv
                py = (wy - scene.y0) * inv
                ao = 1.0
                unripe = 0.0
                stretch = 1.0
                kind = f.SOIL
                if px < 0.0 or py < 0.0 or px >= n_i or py >= n_j:
                    # Fields beyond the grid: blocks of some 40 m, ripe or grass.
                    far = noise.mix(77, math.floor(wx * 0.025), math.floor(wy * 0.04))
                    tile = texture.TOP if hit != _GROUND or far & 3 else texture.GRASS
                    here = labels.NEIGHBOUR if hit != _GROUND else labels.BACKGROUND
                    seen = 0.85
                else:
                    ci = int(px)
                    cj = int(py)
                    kind = scene.kind[int(2 * py), int(2 * px)]
                    shadow = UNIT * scene.stand[cj, ci, SUNLIT]
                    ao = 0.8 + 0.4 * UNIT * scene.stand[cj, ci, TONE]
                    if hit == _GROUND:
                        shadow = _between(scene.stand, px - 0.5, py - 0.5, SUNLIT)
                        seen = 1.0 - 0.88 * min(1.0, shadow * 8.0)
                        if kind in (f.STUBBLE, f.NEIGHBOUR_STUBBLE):
                            tile = texture.STUBBLE
                            here = labels.STUBBLE
                        elif kind == f.WINDROW:
                            tile = texture.STRAW
                            here = labels.STRAW
                        elif kind == f.GRASS:
                            tile = texture.GRASS
                            here = labels.WEEDS
                        else:
                            tile = texture.SOIL
                            here = labels.SOIL
                    elif _solid(kind):
                        here = labels.BACKGROUND
                        tile = _FLAT
                        seen = min(1.0, max(0.0, (wz - shadow) * 3.0 + 0.3))
                    else:
                        here = labels.STANDING if kind == f.CROP else labels.NEIGHBOUR
                        unripe = UNIT * scene.stand[cj, ci, GREEN]
                        if hit == _CANOPY:
                            tile = texture.TOP
                            far_lit = min(0.9, 0.25 + 0.035 * t)
                            seen = max(far_lit, min(1.0, (wz - shadow) * 4.0 + 0.3))
                            ao *= min(1.0, 0.85 + 0.01 * t)
                        else:
                            tile = texture.WALL
                            stretch = 3.0 if t < 2.0 else 1.0
                            seen = min(0.9, max(0.12, (wz - shadow) * 3.0 + 0.5))
                            ao *= min(1.0, 0.6 + 0.4 * wz / slab)
                seen_i = int(255.0 * min(1.0, max(0.0, seen)))
                fog = paint.haze * t / (1.0 + paint.haze * t)
                bright = 256.0 * ao * (1.0 - fog)
                blue = bright * paint.light[seen_i, 0]
                green = bright * paint.light[seen_i, 1]
                red = bright * paint.light[seen_i, 2]
                if unripe > 0.0:
                    blue *= 1.0 - unripe * paint.unripe_loss[0]
                    green *= 1.0 - unripe * paint.unripe_loss[1]
                    red *= 1.0 - unripe * paint.unripe_loss[2]
                foot = t * per_footprint
                if hit != _FACE:
                    foot /= 0.3 + 0.7 * min(1.0, abs(ups[i]) * 2.0)
                level = 0
                m = side
                while foot > 1.4 and m > 8:
                    foot *= 0.5
                    level += 1
                    m >>= 1
                scale = m * texels_per_m
                met[mine, _KNOWN] = 1
                met[mine, _TILE] = tile
                met[mine, _HERE] = here
                met[mine, _KIND] = kind
                met[mine, _BASE] = tile * tile_size + paint.levels[level]
                met[mine, _MASK] = m - 1
                # Colours in 1/256.
                met[mine, _GAIN + 0] = int(blue)
                met[mine, _GAIN + 1] = int(green)
                met[mine, _GAIN + 2] = int(red)
                met[mine, _FOG + 0] = int(fog * haze_blue)
                met[mine, _FOG + 1] = int(fog * haze_green)
                met[mine, _FOG + 2] = int(fog * haze_red)
                upright = tile == texture.WALL
                where[mine, 0] = scale * 1.5 * 0.83 * stretch if upright else scale
                where[mine, 1] = scale * 1.5 * 0.57 * stretch if upright else 0.0
                where[mine, 2] = 0.0 if upright else scale
                where[mine, 3] = -scale * stretch if upright else 0.0
            if mine != cell:
                cell = mine
                tile = met[mine, _TILE]
                kind = met[mine, _KIND]
                base = met[mine, _BASE]
                mask = met[mine, _MASK]
                ax, ay, cy, cz = where[mine]
            cells[k] = cell
            if tile == _FLAT:
                at[k] = -1
                texels[k] = _masonry(kind, hit, xs[i], ys[i], zs[i])
            else:
                # The offset, a multiple of every tile's side, makes truncation a floor.
                ti = np.int32(xs[i] * ax + ys[i] * ay + offset) & mask
                tj = np.int32(ys[i] * cy + zs[i] * cz + offset) & mask
                at[k] = base + texture.SPREAD[ti] + 2 * texture.SPREAD[tj]
        # Apart from what comes before and after, so that many texels are on their way at once.
        for k in range(covered):
            if at[k] >= 0:
                texels[k] = tiles[at[k]]
        for k in range(covered):
            texel = texels[k]
            c = met[cells[k]]
            blue = min(255, ((texel & 255) * c[_GAIN] + c[_FOG]) >> 8)
            green = min(255, ((texel >> 8 & 255) * c[_GAIN + 1] + c[_FOG + 1]) >> 8)
            red = min(255, ((texel >> 16) * c[_GAIN + 2] + c[_FOG + 2]) >> 8)
            row[of[k]] = np.int64(c[_HERE]) << 24 | red << 16 | green << 8 | blue
        image_row = image[v, left:right]
        for i in range(n):
            word = row[i]
            image_row[i, 0] = np.uint8(word & 255)
            image_row[i, 1] = np.uint8(word >> 8 & 255)
            image_row[i, 2] = np.uint8(word >> 16 & 255)


@njit(cache=True, nogil=True, error_model="numpy")
def blocks_in_view(
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
    i0 = max(0, int((view.x - scene.x0 - REACH_M) / BLOCK_M))
    i1 = min(int(width / BLOCK_M), int((view.x - scene.x0 + REACH_M) / BLOCK_M) + 1)
    j0 = max(0, int((view.y - scene.y0 - REACH_M) / BLOCK_M))
    j1 = min(int(height / BLOCK_M), int((view.y - scene.y0 + REACH_M) / BLOCK_M) + 1)
    count = 0
    for j in range(j0, j1):
        for i in range(i0, i1):
            ax = scene.x0 + (i + 0.5) * BLOCK_M - view.x
            ay = scene.y0 + (j + 0.5) * BLOCK_M - view.y
            ahead = ax * hx + ay * hy
            aside = abs(ax * hy - ay * hx)
            d = math.sqrt(ax * ax + ay * ay)
            if d > REACH_M or ahead < -0.4 or aside * cos - ahead * sin > 0.6:
                continue
            found[count, 0] = j
            found[count, 1] = i
            away[count] = d
            count += 1
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def project(
    stalks: Stalks, k0: int, k1: int, scene: Scene, view: View, paint: Paint, seed: int, wind: Wind
) -> None:
    """Projects the stalks of blocks k0..k1: `drawn`, `records` and `spans` of them; see
    `draw_stalks`."""
    blocks, packs, first, drawn, out, spans = stalks
    t, sway_x, sway_y, gust = wind
    R = view.axes
    n_j, n_i = scene.kind.shape
    inv = 1.0 / scene.cell
    rows, columns = view.rays_a.shape
    F = view.focal
    kinds = np.empty(packs.shape[1], np.uint8)
    densities = np.empty(packs.shape[1], np.uint16)
    for k in range(k0, k1):
        bj = blocks[k, 0]
        bi = blocks[k, 1]
        pack = noise.mix(seed, bi, bj) & (PACKS - 1)
        x_block = scene.x0 + bi * BLOCK_M
        y_block = scene.y0 + bj * BLOCK_M
        shown = first[k + 1] - first[k]
        wider = min(3.0, packs.shape[1] / max(1, shown))
        wave = 0.55 + 0.45 * math.sin(1.3 * x_block + 0.7 * y_block - 2.2 * t)
        n = 0
        # Looked up apart from what hangs on it, so that many cells are on their way at once.
        for q in range(shown):
            s = packs[pack, q]
            i = int((x_block + s.x - scene.x0) * inv)
            j = int((y_block + s.y - scene.y0) * inv)
            kinds[q] = f.SOIL
            if i < n_i and j < n_j:
                kinds[q] = scene.kind[j, i]
                densities[q] = scene.stand[j >> 1, i >> 1, DENSITY]
        for q in range(shown):
            s = packs[pack, q]
            kind = kinds[q]
            if kind == f.SOIL or _solid(kind) or s.rank > UNIT * densities[q]:
                continue
            x = x_block + s.x
            y = y_block + s.y
            ci = int((x - scene.x0) * inv) >> 1
            cj = int((y - scene.y0) * inv) >> 1
            tall = _standing(kind)
            lean_x = s.lean_x
            lean_y = s.lean_y
            head = 0.0
            if tall:
                lodge = UNIT * scene.stand[cj, ci, LODGE]
                height = UNIT * scene.stand[cj, ci, HEIGHT] * s.height
                phase = 1.1 * t + 37.0 * s.rank
                flutter = 4.0 * abs(phase - math.floor(phase) - 0.5) - 1.0
                bend = wave + gust * flutter
                lean_x += sway_x * bend
                lean_y += sway_y * bend
                if lodge > 0.05:
                    lean = math.tan(lodge)
                    way = 6.28 * UNIT * scene.stand[cj, ci, TONE]
                    lean_x += lean * math.cos(way)
                    lean_y += lean * math.sin(way)
                head = 0.085 / max(height, 0.1)
            elif kind == f.WINDROW:
                if s.rank > 0.75:
                    continue
                height = 0.02 + 0.10 * s.stub
                lean_x *= 40.0
                lean_y *= 40.0
            elif kind == f.GRASS:
                if s.rank > 0.5:
                    continue
                height = 0.03 + 0.09 * s.stub
                lean_x *= 8.0
                lean_y *= 8.0
            else:
                height = 0.07 + 0.07 * s.stub
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
            per_z0 = 1.0 / z0
            per_z1 = 1.0 / z1
            a0 = (R[0, 0] * ax + R[0, 1] * ay + R[0, 2] * az) * per_z0
            b0 = (R[1, 0] * ax + R[1, 1] * ay + R[1, 2] * az) * per_z0
            a1 = (R[0, 0] * bx + R[0, 1] * by + R[0, 2] * bz) * per_z1
            b1 = (R[1, 0] * bx + R[1, 1] * by + R[1, 2] * bz) * per_z1
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
            e.u0 = u0
            e.v0 = v0
            e.z0 = z0
            e.u1 = u1
            e.v1 = v1
            e.z1 = z1
            scale = F * per_z1 * wider
            e.stem = (0.0019 if tall else 0.0026) * scale
            e.ear = 0.0050 * scale if tall else 0.0
            e.ear_share = head
            e.nod = s.nod * scale / wider if tall else 0.0
            e.visible = visible
            e.height = height
            e.sunlit = UNIT * scene.stand[cj, ci, SUNLIT]
            if tall:
                e.label = labels.STANDING if kind == f.CROP else labels.NEIGHBOUR
            elif kind == f.WINDROW:
                e.label = labels.STRAW
            elif kind == f.GRASS:
                e.label = labels.WEEDS
            else:
                e.label = labels.STUBBLE
            wide = max(e.stem, e.ear) + abs(e.nod) + 1.5
            spans[first[k] + n, 0] = np.int16(max(-32e3, min(u0, u1) - wide))
            spans[first[k] + n, 1] = np.int16(min(32e3, max(u0, u1) + wide))
            shade = s.shade * (0.86 + 0.28 * UNIT * scene.stand[cj, ci, TONE])
            if not tall:
                shade *= 1.12
            green = 0.0
            if tall:
                green = UNIT * scene.stand[cj, ci, GREEN] * (0.75 + 0.5 * s.stub)
                if UNIT * scene.stand[cj, ci, WEED] > 0.3 and s.rank < 0.5:
                    green = 1.0
                green = min(1.0, green)
            elif kind == f.GRASS:
                green = 1.0
            ripe = paint.crop_bgr if tall else paint.straw_bgr
            e.blue = shade * (ripe[0] + green * (paint.green_bgr[0] - ripe[0])) * s.blue
            e.green = shade * (ripe[1] + green * (paint.green_bgr[1] - ripe[1])) * s.green
            e.red = shade * (ripe[2] + green * (paint.green_bgr[2] - ripe[2])) * s.red
            n += 1
        drawn[k] = n


@njit(cache=True, nogil=True, error_model="numpy")
def draw_stalks(
    canvas: Canvas,
    left: int,
    right: int,
    stalks: Stalks,
    paint: Paint,
) -> None:
    """Draws the projected stalks into columns [left, right), front to back."""
    _, _, first, drawn, records, spans = stalks
    rows = canvas.shape[0]
    for k in range(drawn.shape[0]):
        for n in range(first[k], first[k] + drawn[k]):
            if spans[n, 1] < left or spans[n, 0] >= right:
                continue
            e = records[n]
            u1 = float(e.u1)
            v0 = float(e.v0)
            v1 = float(e.v1)
            long = v0 - v1
            per = 1.0 / long
            du = (e.u0 - u1) * per
            dz = (e.z0 - e.z1) * per
            slant = 0.5 * abs(du)
            va = max(0, math.ceil(v1 - 0.5))
            vb = min(rows - 1, math.floor(v0 - 0.5), int(v1 + long * e.visible))
            head = float(e.ear_share)
            # Interior crop sinks into its body, from there on down it is hidden.
            sinks = e.visible < 1.0
            vh = min(vb + 1, max(va, math.ceil(v1 - 0.5 + head * long)))
            fog = 0.5 * (e.z0 + e.z1) * paint.haze
            fog = fog / (1.0 + fog)
            here = int(e.label) << 24
            ears = int(u1)
            darker = 0.22 * e.visible
            shaded = 0.22 if head > 0.0 else 0.0
            blue = e.blue * (1.0 - fog)
            green = e.green * (1.0 - fog)
            red = e.red * (1.0 - fog)
            fog_blue = fog * paint.haze_bgr[0]
            fog_green = fog * paint.haze_bgr[1]
            fog_red = fog * paint.haze_bgr[2]
            # How far above the shadow's border the top is, x 4, plus 0.4; and its change by row.
            lit = 4.0 * (e.height - e.sunlit) + 0.4
            lit_by_row = -4.0 * per * e.height
            below = va + 0.5 - v1
            z = e.z1 + dz * below
            uc = u1 + du * below + 0.5
            per_head = 1.0 / max(1e-6, head)
            nod = float(e.nod)
            for v in range(va, vh):
                a = (v + 0.5 - v1) * per
                p = max(0.0, a * per_head)
                w = max(slant, e.ear * (0.4 + 2.4 * p * (1.0 - p)))
                at = uc + nod * (1.0 - p) * (1.0 - p)
                uc += du
                key = int(z * DEPTHS_PER_M) << 32
                z += dz
                # The offset makes truncation a floor.
                ua = int(at - w + 4096.0) - 4096
                ub = max(ua + 1, int(at + w + 4096.0) - 4096)
                ua = max(ua, left)
                ub = min(ub, right)
                if ua >= ub or (key >= canvas[v, ua] and key >= canvas[v, ub - 1]):
                    continue
                gain = (1.08 if (v + ears) & 3 else 0.92) * (1.0 - darker * a)
                seen = lit + (v + 0.5 - v1) * lit_by_row
                si = int(255.0 * min(1.0, max(shaded, seen)))
                key |= here | int(min(255.0, blue * gain * paint.light[si, 0] + fog_blue))
                key |= int(min(255.0, green * gain * paint.light[si, 1] + fog_green)) << 8
                key |= int(min(255.0, red * gain * paint.light[si, 2] + fog_red)) << 16
                for u in range(ua, ub):
                    canvas[v, u] = min(canvas[v, u], key)
            # In fixed point from here on: 32 bits after the point.
            stem = max(float(e.stem), slant)
            low = int((uc - stem) * _ONE)
            high = int((uc + stem) * _ONE)
            by_row = int(du * _ONE)
            deep = int(z * (DEPTHS_PER_M * _ONE))
            deeper = int(dz * (DEPTHS_PER_M * _ONE))
            stem_gain = 0.93 if head > 0.0 else 1.0
            fresh = 0
            colour = 0
            for v in range(max(va, vh), vb + 1):
                ua = low >> 32
                ub = max(ua + 1, high >> 32)
                ua = max(ua, left)
                ub = min(ub, right)
                key = deep >> 32 << 32
                low += by_row
                high += by_row
                deep += deeper
                if ua >= ub:
                    continue
                if key >= canvas[v, ua] and key >= canvas[v, ub - 1]:
                    if sinks and canvas[v, ua] >> 24 & 255 >= _SKY:
                        break
                    continue
                if v >= fresh:
                    # A stem changes little over four rows.
                    fresh = v + 4
                    gain = stem_gain * (1.0 - darker * (v + 0.5 - v1) * per)
                    seen = lit + (v + 0.5 - v1) * lit_by_row
                    si = int(255.0 * min(1.0, max(shaded, seen)))
                    colour = here | int(min(255.0, blue * gain * paint.light[si, 0] + fog_blue))
                    colour |= int(min(255.0, green * gain * paint.light[si, 1] + fog_green)) << 8
                    colour |= int(min(255.0, red * gain * paint.light[si, 2] + fog_red)) << 16
                key |= colour
                for u in range(ua, ub):
                    canvas[v, u] = min(canvas[v, u], key)


_PUFFS: Final = 14
_PUFF_LIFE_S: Final = 1.6
CLOUD_OFFSETS: Final = 256
CLOUD_PX: Final = 10.0
"""Wavelength of the noise in a puff, px of the veil."""


@njit(cache=True, nogil=True, error_model="numpy")
def puff(
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
    clouds: NDArray[np.float32],
) -> None:
    """Lays the blade's dust over `veil` (rows, columns at 1/`scale` of the picture): opacity 0..1.

    A puff is born along the blade's line every life/_PUFFS seconds, rises, grows, drifts by `drift`
    (m/s in the vehicle frame) and fades. `mount` (4, 3): right, down, forward of the camera in the
    vehicle frame, and its place. `clouds` (`CLOUD_OFFSETS` larger than `veil` each way): noise."""
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
        across = noise.mix(seed, index, 4) & (CLOUD_OFFSETS - 1)
        down = noise.mix(seed, index, 5) & (CLOUD_OFFSETS - 1)
        per_square = 1.0 / (radius * radius)
        for j in range(max(0, int(v - radius)), min(rows, int(v + radius) + 1)):
            for i in range(max(0, int(u - radius)), min(columns, int(u + radius) + 1)):
                d = ((i - u) ** 2 + (j - v) ** 2) * per_square
                if d < 1.0:
                    cloud = 0.7 + 0.6 * clouds[down + j, across + i]
                    veil[j, i] += (1.0 - veil[j, i]) * min(1.0, strength * (1.0 - d) ** 2 * cloud)


@njit(cache=True, nogil=True)
def veil(image: NDArray[np.uint8], opacity: NDArray[np.uint8], bgr: NDArray[np.float32]) -> None:
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
def expose(
    light: NDArray[np.uint8],
    vignette: NDArray[np.uint8],
    gain: NDArray[np.float32],
    rough: NDArray[np.int8],
) -> NDArray[np.uint8]:
    """The sensor's answer, (rows, columns times 3): gain by colour (3), a shoulder above 200 counts
    that keeps highlights from clipping hard, and noise."""
    rows, n = light.shape
    out = np.empty((rows, n), np.uint8)
    gains = np.empty(n, np.float32)
    for i in range(n):
        gains[i] = gain[i % 3] / np.float32(255.0)
    # All in float32, so that a row runs several pixels at once.
    none = np.float32(0.0)
    half = np.float32(0.5)
    one = np.float32(1.0)
    third = np.float32(1.0 / 6.0)
    fourth = np.float32(1.0 / 24.0)
    knee = np.float32(200.0)
    span = np.float32(55.0)
    per_span = np.float32(1.0 / 55.0)
    most = np.float32(255.0)
    for v in range(rows):
        light_row = light[v]
        vignette_row = vignette[v]
        rough_row = rough[v]
        out_row = out[v]
        for i in range(n):
            x = np.float32(light_row[i]) * np.float32(vignette_row[i]) * gains[i]
            d = max(none, x - knee) * per_span
            # The exponential's series.
            grown = one + d * (one + d * (half + d * (third + d * fourth)))
            y = min(x, knee) + span - span / grown + np.float32(rough_row[i]) + half
            out_row[i] = np.uint8(np.int32(min(max(y, none), most)))
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def draw_crowns(
    canvas: Canvas,
    left: int,
    right: int,
    crowns: NDArray[np.float64],
    view: View,
    paint: Paint,
) -> None:
    """Draws the trees' crowns (n, 4: x, y, z, radius in m) into columns [left, right): balls of
    leaves, lit from above."""
    rows = canvas.shape[0]
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
        key = int(z * DEPTHS_PER_M) << 32 | _BACKGROUND
        fog = paint.haze * z / (1.0 + paint.haze * z)
        for v in range(max(0, int(vc - radius)), min(rows, int(vc + radius) + 1)):
            for u in range(max(left, int(uc - radius)), min(right, int(uc + radius) + 1)):
                dx = (u - uc) / radius
                dy = (v - vc) / radius
                clump = noise.smooth(k + 7, dx * 4.0 + 9.0, dy * 4.0 + 9.0)
                fine = noise.smooth(k + 8, (u - uc) * leaf + 99.0, (v - vc) * leaf + 99.0)
                if dx * dx + dy * dy > 0.45 + 0.5 * clump + 0.25 * fine or key >= canvas[v, u]:
                    continue
                word = key
                lit = int(255.0 * min(1.0, max(0.0, 0.55 - 0.5 * dy + 0.9 * (clump + fine - 1.0))))
                for q in range(3):
                    x = (42.0, 84.0, 66.0)[q] * (0.7 + 0.6 * fine) * paint.light[lit, q]
                    word |= int(min(255.0, x + fog * (paint.haze_bgr[q] - x))) << 8 * q
                canvas[v, u] = word


@njit(cache=True, nogil=True)
def draw(
    image: NDArray[np.uint8],
    canvas: Canvas,
    left: int,
    right: int,
    scene: Scene,
    view: View,
    paint: Paint,
    profiles: Profiles,
    crowns: NDArray[np.float64],
    stalks: Stalks,
) -> None:
    """Columns [left, right) of a picture, in one call: what is passed costs as much as a kernel."""
    find(canvas, left, right, view, profiles)
    draw_crowns(canvas, left, right, crowns, view, paint)
    draw_stalks(canvas, left, right, stalks, paint)
    fill(image, canvas, left, right, scene, view, paint)


@njit(cache=True, nogil=True)
def prepare(
    blocks: tuple[int, int],
    azimuths: tuple[int, int],
    scene: Scene,
    view: View,
    paint: Paint,
    profiles: Profiles,
    stalks: Stalks,
    seed: int,
    wind: Wind,
) -> None:
    """What `draw` needs: the stalks of these blocks, the profiles of these azimuths."""
    project(stalks, blocks[0], blocks[1], scene, view, paint, seed, wind)
    profile(scene, view, azimuths[0], azimuths[1], profiles)


class Direct:
    """Calls a kernel whose arguments have the same types each time. Numba's dispatcher would work
    out the types of the tuples' arrays at every call, with the interpreter locked, which costs as
    much as a small kernel does."""

    def __init__(self, dispatcher: Any) -> None:
        self._dispatcher = dispatcher
        self._entry: Any = None

    def __call__(self, *arguments: Any) -> None:
        """The kernel's call."""
        if self._entry is None:
            types = tuple(numba.typeof(a) for a in arguments)  # type: ignore[no-untyped-call]
            self._dispatcher.compile(types)
            self._entry = self._dispatcher.overloads[types].entry_point
        self._entry(*arguments)


def bake_packs(rng: np.random.Generator, spec: f.FieldSpec) -> NDArray[Any]:
    """(PACKS, stalks) of GROWN: the blocks that the field's spec asks for."""
    n = max(1, round(spec.stalks_per_m2 * BLOCK_M**2))
    shape = (PACKS, n)
    s = np.zeros(shape, GROWN)
    s["x"] = rng.random(shape) * BLOCK_M
    s["y"] = rng.random(shape) * BLOCK_M
    if spec.drilled:
        row = rng.integers(0, 3, shape) + 0.5
        s["y"] = (row * BLOCK_M / 3 + rng.normal(0, 0.02, shape)).clip(0, BLOCK_M - 1e-3)
    s["height"] = rng.normal(1, 0.06, shape).clip(0.8, 1.15)
    lean = rng.normal(0, 0.06, (*shape, 2)).clip(-0.16, 0.16)
    s["lean_x"], s["lean_y"] = lean[..., 0], lean[..., 1]
    s["shade"] = rng.uniform(0.72, 1.1, shape)
    s["stub"] = rng.random(shape)
    s["nod"] = rng.normal(0, 0.03, shape)
    s["rank"] = rng.random(shape)
    tint = rng.normal(1, 0.045, (*shape, 3))
    s["blue"], s["green"], s["red"] = tint[..., 0], tint[..., 1], tint[..., 2]
    return s
