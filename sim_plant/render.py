"""What `render.cpp` draws a picture from, and its calls.

A picture is made in passes over parts of the picture that any number of threads may share:
`Kernels.plan` lists the blocks of stalks in view, `prepare` projects their stalks and notes what
heights each azimuth crosses, `sort` deals the stalks out to strips of columns, `draw` finds where
each pixel's ray ends, draws stalks over that and paints what no stalk hides. Colours are
display-referred BGR; light multiplies them by a factor from the light table.
"""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_int64, c_uint32, c_void_p
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_plant import native
from sim_plant.field_spec import FieldSpec

BLOCK_M: Final = 0.5
"""Side of a block of stalks."""
PACKS: Final = 64
"""Different blocks; which one stands where is drawn per block."""
SUNLIT, HEIGHT, GREEN, DENSITY, WEED, LODGE, TONE, BODY = range(8)
"""Of a cell of `Picture.stand`: SUNLIT is the height in m above which the sun reaches."""
UNIT: Final = 1.0 / 4096.0
"""Of `Picture.stand`."""
SEGMENTS: Final = 48
"""Changes of height along an azimuth that a profile holds."""
PIECES: Final = 2 * SEGMENTS + 1
PARTS: Final = 6
"""A picture's work is dealt out in so many parts, whatever the number of threads."""
REACH_M: Final = 16.0
"""Stalks are drawn up to here; the canopy's texture beyond."""
GROWN_FIELDS: Final = 17
"""Floats that `render.cpp` keeps of a stalk where it stands."""
LIGHT_TERMS: Final = 5
"""Of the polynomial that gives a colour's light by its share of the sun: to a grey level."""
PALETTE_STALKS: Final = 10_880
"""So many stalks are drawn in a part's columns: the nearest."""
MOST_BLOCKS: Final = 100 * 100
"""More than are ever in view."""
CLOUD_OFFSETS: Final = 256
"""How much larger than the veil the noise of the dust's puffs is."""
NOISE_OFFSETS: Final = 128
"""How many pixels wider than a picture the sensor's noise is."""
CLOUD_PX: Final = 10.0
"""Wavelength of the noise in a puff, px of the veil."""

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
PIECE_BYTES: Final = 16
"""Of a piece of a profile."""
STALK_BYTES: Final = 68
"""Of a stalk as it is drawn."""

BODY_FROM: Final = 1024
"""Of `next` of WAY."""
WAY: Final = np.dtype(
    [
        # The squared distance to the nearest body, in cells; where a body stands, BODY_FROM and its
        # HEIGHT.
        ("next", np.uint16),
        ("kinds", np.uint16),  # of the cell's four quarters, 4 bit each
    ]
)
"""What a ray along the ground asks of a coarse cell: in one place of memory, since the cells that
rays meet lie far apart."""
LAND: Final = np.dtype(
    [
        ("marks", np.int32),  # SUNLIT, then `kinds` of WAY
        ("looks", np.int32),  # TONE, then GREEN
    ]
)
"""What a coarse cell's light and colour follow from."""


class Scene(NamedTuple):
    """The field's grids as the renderer reads them; see `Picture`."""

    kind: NDArray[np.uint8]
    way: NDArray[Any]
    land: NDArray[Any]
    stand: NDArray[np.uint16]
    x0: float
    y0: float
    cell: float


class View(NamedTuple):
    """Pinhole with radial distortion. `axes` rows: right, down, forward in field coordinates."""

    x: float
    y: float
    z: float
    axes: NDArray[np.float64]
    focal: float
    cu: float
    cv: float
    shear: float
    """Rolling shutter: horizontal shift in px from first to last row."""


class Picture(ctypes.Structure):
    """Everything that the kernels read and write; as in `render.cpp`."""

    _fields_ = (
        # The field. Coarse grids have half of `kind`'s rows and columns.
        ("kind", c_void_p),  # uint8
        ("way", c_void_p),  # coarse, of WAY
        ("land", c_void_p),  # coarse, of LAND
        ("stand", c_void_p),  # uint16, coarse (rows, columns, 8), in 1/UNIT
        ("packs", c_void_p),  # (PACKS, stalks) of GROWN
        ("grown", c_void_p),  # float32 (blocks, GROWN_FIELDS, most): stalks looked up before
        ("known", c_void_p),  # uint8, of a block: whether `grown` holds it as it is now
        ("grown_count", c_void_p),  # int32, of a block
        ("crowns", c_void_p),  # float64 (n, 4): x, y, z, radius in m
        # Paint.
        ("tiles", c_void_p),  # int32 (tile, texel), packed: blue in the lowest byte, green, red
        ("panorama", c_void_p),  # int32, packed like a texel, as bright as the sky is at this hour
        # Work.
        ("profiles", c_void_p),  # (bins, PIECES) of PIECE_BYTES
        ("pieces", c_void_p),  # int32 (bins)
        ("blocks", c_void_p),  # int32: those in view
        ("first", c_void_p),  # int64: of the k-th block in view, its first place among the stalks
        ("drawn", c_void_p),  # int64 (parts, 2): the stalks that a part prepared
        ("stalks", c_void_p),  # (capacity) of STALK_BYTES
        ("spans", c_void_p),  # int16 (capacity, 2): columns that a stalk covers
        ("sorted", c_void_p),  # int32 (parts, PALETTE_STALKS): the stalks of a part's columns
        ("dealt", c_void_p),  # int64 (parts): how many they are
        ("image", c_void_p),  # uint8 (rows, columns, 3)
        ("labels", c_void_p),  # uint8 (rows, columns), or none are wanted
        # of a strip that is being drawn, by columns
        ("depth", c_void_p),  # float32 (columns, stride), m along the optical axis
        ("key", c_void_p),  # uint32 (columns, stride): depth, then whose colour
        ("colour", c_void_p),  # uint32 (columns, stride): label, red, green, blue
        ("x0", c_double),
        ("y0", c_double),
        ("cell", c_double),
        ("canopy", c_double),  # height of the canopy's body below the ears at its tallest, m
        ("tallest", c_double),  # crop, m
        ("roof", c_double),  # nothing that stands is higher, m
        ("x", c_double),
        ("y", c_double),
        ("z", c_double),
        ("axes", c_double * 9),  # rows right, down, forward in field coordinates
        ("focal", c_double),
        ("cu", c_double),
        ("cv", c_double),
        ("k1", c_double),
        ("k2", c_double),
        ("shear", c_double),  # rolling shutter: horizontal shift in px from first to last row
        ("tangent", c_double),  # of the largest azimuth that profiles hold, either side
        ("corner", c_double),  # of the picture: its distance from the middle, normalised
        ("lens", c_double * 4),  # undistorted radius over distorted: 1 + r²(l0 + r²(l1 + ...))
        ("sun", c_double * 3),  # unit vector east, north, up
        ("t", c_double),
        ("sway_x", c_double),  # tangents of the stalks' mean lean
        ("sway_y", c_double),
        ("gust", c_double),  # what gusts add and take of it
        ("haze", c_double),
        (
            "light",
            (c_double * LIGHT_TERMS) * 3,
        ),  # BGR, of the share of the sun: a polynomial's terms
        ("haze_bgr", c_double * 3),
        ("crop_bgr", c_double * 3),
        ("green_bgr", c_double * 3),
        ("straw_bgr", c_double * 3),
        ("unripe_loss", c_double * 3),  # 1 - green/crop
        ("coarse_rows", c_int64),
        ("coarse_columns", c_int64),
        ("block_rows", c_int64),
        ("block_columns", c_int64),
        ("beyond_is_crop", c_int64),
        ("pack_size", c_int64),
        ("most", c_int64),
        ("crown_count", c_int64),
        ("tile_size", c_int64),
        ("panorama_rows", c_int64),
        ("panorama_columns", c_int64),
        ("rows", c_int64),
        ("columns", c_int64),
        ("bins", c_int64),
        ("block_count", c_int64),
        ("capacity", c_int64),
        ("seed", c_int64),
        ("parts", c_int64),
        ("stride", c_int64),  # pixels from a column to the next
        ("bin_from", c_int64),  # the azimuths in the picture
        ("bin_to", c_int64),
    )


class Kernels:
    """The calls into `render.cpp` on one picture. Holds the arrays that the picture points into."""

    def __init__(self, picture: Picture) -> None:
        self.picture = picture
        self._held: dict[str, NDArray[Any]] = {}
        self._at = ctypes.addressof(picture)
        library = native.library()
        self._plan, self._prepare = library.plan, library.prepare
        self._sort, self._draw = library.sort_stalks, library.draw
        self._refresh = library.refresh
        self._refresh.argtypes = [c_void_p, *[c_int64] * 5]
        self._refresh.restype = None
        self._plan.argtypes = self._sort.argtypes = [c_void_p]
        self._plan.restype, self._sort.restype = c_int64, None
        for call in (self._prepare, self._draw):
            call.argtypes = [c_void_p, c_int64, c_int64]
            call.restype = None

    def hold(self, **arrays: NDArray[Any]) -> None:
        """Points the picture's fields at arrays, which must be contiguous."""
        for name, array in arrays.items():
            if not array.flags.c_contiguous:
                raise ValueError(f"{name} is not contiguous")
            self._held[name] = array
            setattr(self.picture, name, array.ctypes.data)

    def held(self, name: str) -> NDArray[Any]:
        """The array that a field of the picture points at."""
        return self._held[name]

    def refresh(self, j0: int, j1: int, i0: int, i1: int, narrowest: int) -> None:
        """Fills the derived grids where `kind` changed in the coarse cells [j0, j1) x [i0, i1).
        Crop that stands narrower than `narrowest` cells has no body."""
        self._refresh(self._at, j0, j1, i0, i1, narrowest)

    def plan(self) -> int:
        """Fills `blocks` and `first`; returns how many stalks they hold at most."""
        return int(self._plan(self._at))

    def prepare(self, begin: int, end: int) -> None:
        """What `draw` needs: the parts [begin, end) of `parts`; all must be done before."""
        self._prepare(self._at, begin, end)

    def sort(self) -> None:
        """Deals the stalks out to the parts of `draw`."""
        self._sort(self._at)

    def draw(self, begin: int, end: int) -> None:
        """The strips [begin, end) of `parts` of the image's columns."""
        self._draw(self._at, begin, end)


def raise_dust(
    image: NDArray[np.uint8],
    veil: NDArray[np.float32],
    mount: NDArray[np.float64],
    focal: float,
    seed: int,
    t: float,
    drift: tuple[float, float],
    ahead: float,
    half_width: float,
    density: float,
    clouds: NDArray[np.float32],
    bgr: NDArray[np.float64],
) -> None:
    """Lays the blade's dust over an image (rows, columns, 3) in place.

    A puff is born along the blade's line again and again, rises, grows, drifts by `drift` (m/s in
    the vehicle frame) and fades. `mount` (4, 3): right, down, forward of the camera in the vehicle
    frame, and its place. `veil`: room for the opacity, at a fraction of the image's size; `clouds`
    (`CLOUD_OFFSETS` larger than `veil` each way): noise."""
    rows, columns = image.shape[:2]
    native.library().raise_dust(
        c_void_p(image.ctypes.data), c_int64(rows), c_int64(columns), c_void_p(veil.ctypes.data),
        c_void_p(mount.ctypes.data), c_double(focal), c_int64(seed),
        c_double(t), c_double(drift[0]), c_double(drift[1]), c_double(ahead), c_double(half_width),
        c_double(density), c_void_p(clouds.ctypes.data), c_void_p(bgr.ctypes.data),
    )  # fmt: skip


def mean_light(image: NDArray[np.uint8], vignette: NDArray[np.uint8], *, soft: bool) -> float:
    """The mean of every eighth pixel of every eighth row of an image (rows, columns, 3) behind
    `vignette` (rows, columns) of 255; not `soft`: and behind the lens's blur."""
    rows, columns, _ = image.shape
    call = native.library().mean_light
    call.restype = c_double
    return float(
        call(
            c_void_p(image.ctypes.data), c_int64(soft), c_void_p(vignette.ctypes.data),
            c_int64(rows), c_int64(columns),
        )
    )  # fmt: skip


def expose(
    light: NDArray[np.uint8],
    vignette: NDArray[np.uint8],
    gain: NDArray[np.float32],
    rough: NDArray[np.int8],
    draw: int,
    *,
    soft: bool,
) -> NDArray[np.uint8]:
    """The sensor's answer (rows, columns, 3) to light of that shape, `soft` or still to be blurred
    by 3 by 3 pixels: `vignette` (rows, columns) of 255, gain by blue, green and red, a shoulder
    above 200 counts that keeps highlights from clipping hard, and noise `rough` (any number of
    rows, columns + NOISE_OFFSETS, 3). Each row of the picture takes one of its rows and a beginning
    in that by chance, by the number `draw`."""
    rows, columns, _ = light.shape
    out = np.empty_like(light)
    steps = np.minimum(gain * (32 * 65536 / 255), 65535).astype(np.uint16)
    native.library().expose(
        c_void_p(light.ctypes.data), c_int64(soft), c_void_p(vignette.ctypes.data),
        c_void_p(steps.ctypes.data), c_void_p(rough.ctypes.data), c_int64(len(rough)),
        c_uint32(draw), c_void_p(out.ctypes.data), c_int64(rows), c_int64(columns),
    )  # fmt: skip
    return out


def smooth(seed: int, x: float, y: float) -> float:
    """`noise.smooth` as the kernels draw it."""
    call = native.library().noise_smooth
    call.restype = c_double
    return float(call(c_int64(seed), c_double(x), c_double(y)))


def bake_packs(rng: np.random.Generator, spec: FieldSpec) -> NDArray[Any]:
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
