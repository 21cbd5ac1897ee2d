"""The phone's picture of the field: mount, lens, light and sensor around the kernels of `render`.

A picture depends on (seed, time, pose, field) and on nothing else, the number of threads least of
all.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Annotated, Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field as Limits

from sim_plant import disturbance, labels, noise, render, sky, texture
from sim_plant.disturbance import DisturbanceSpec
from sim_plant.field import Field
from sim_plant.sky import WeatherSpec
from sim_plant.strict import NotNegative, Positive, Share, Strict


def axes(yaw: float, pitch: float, roll: float) -> NDArray[np.float64]:
    """(3, 3): a camera's right, down and forward axes as rows; radians, yaw to the left, pitch
    downward, roll clockwise."""
    return np.array(_axes(yaw, pitch, roll))


_Row = tuple[float, float, float]


def _axes(yaw: float, pitch: float, roll: float) -> tuple[_Row, _Row, _Row]:
    """`axes` as plain numbers, which takes a fifth of the time."""
    cp, sp, cy, sy = math.cos(pitch), math.sin(pitch), math.cos(yaw), math.sin(yaw)
    cr, sr = math.cos(roll), math.sin(roll)
    ux, uy, uz = -cy * sp, -sy * sp, -cp
    return (
        (cr * sy + sr * ux, -cr * cy + sr * uy, sr * uz),
        (cr * ux - sr * sy, cr * uy + sr * cy, cr * uz),
        (cy * cp, sy * cp, -sp),
    )


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
    vibration_deg: NotNegative = 0.1
    """Standard deviation of the mount's roll and pitch from the engine."""
    machine_in_view: bool = False
    """Draws the reaper's header where it is in view."""
    jpeg_quality: Annotated[int, Limits(ge=1, le=100)] = 80
    delay_s: NotNegative = 0.1
    """From the shutter to the host, in the mean: exposure, file, network."""
    jitter_s: NotNegative = 0.02
    """Standard deviation of that, s: a Wi-Fi that is shared, a phone that does other things. An
    estimate; a recorded drive's arrivals would tell."""
    stall_share: Share = 0.01
    """Of the pictures, that lose a segment on the way: they come `network.STALL_S` later, and what
    is behind them at once with them."""
    disturbance: DisturbanceSpec = DisturbanceSpec()
    """What is wrong with it."""

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.width_px / 2 / math.tan(math.radians(self.hfov_deg) / 2)

    @property
    def axes(self) -> NDArray[np.float64]:
        """`axes` of the mount, in the vehicle frame."""
        return axes(*(math.radians(a) for a in (self.yaw_deg, self.pitch_deg, self.roll_deg)))


_VEIL_SCALE: Final = 4
"""The blade's dust is drawn so much smaller; `render.cpp` knows it, too."""
_DUST_BGR: Final = np.array([160.0, 182.0, 200.0])
"""Of dry soil's dust in sunlight; by eye."""
_NOISE_ROWS: Final = 96
_GUSTS: Final = 0.35
"""Of the mean lean, what gusts add and take."""

LOW = CameraSpec(x_m=0.1, z_m=0.6, pitch_deg=5.0)
"""Below the crop's top, as the paper's rule needs."""
MAST = CameraSpec(x_m=0.0, z_m=1.6, pitch_deg=28.0)
"""Looking over the crop."""
MOUNTS: Final = {"low": LOW, "mast": MAST}


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


def _scene_of(field: Field) -> render.Scene:
    """The grids of a field, none of the derived ones filled."""
    coarse = field.height.shape
    stand = np.zeros((*coarse, 8), np.uint16)
    for channel, grid in (
        (render.HEIGHT, field.height),
        (render.GREEN, field.green),
        (render.DENSITY, field.density),
        (render.WEED, field.weed),
        (render.LODGE, field.lodge),
        (render.TONE, field.tone),
    ):
        stand[..., channel] = np.clip(grid / render.UNIT + 0.5, 0, 65535)
    land = np.zeros(coarse, render.LAND)
    land["looks"] = stand[..., render.TONE] | stand[..., render.GREEN].astype(np.int32) << 16
    return render.Scene(
        kind=field.kind.copy(),
        way=np.zeros(coarse, render.WAY),
        land=land,
        stand=stand,
        x0=float(field.origin[0]),
        y0=float(field.origin[1]),
        cell=field.cell,
    )


def _crowns_of(field: Field) -> NDArray[np.float64]:
    """(x, y, height of the lowest leaves, radius) of each tree's crown, metres."""
    crowns = [
        (t.x_m, t.y_m, t.height_m - t.crown_radius_m, t.crown_radius_m) for t in field.spec.trees
    ]
    return np.array(crowns, np.float64).reshape(-1, 4)


def _noise_of(spec: CameraSpec, rng: np.random.Generator) -> NDArray[np.int8]:
    """The sensor's: rows wider than a picture's, so that each begins elsewhere in one of them. As
    many as stay in a processor's nearer caches."""
    shape = _NOISE_ROWS, spec.width_px + render.NOISE_OFFSETS, 3
    return np.asarray(np.rint(rng.normal(0, spec.noise, shape).clip(-127, 127)), np.int8)


def _vignette_of(rays: NDArray[np.float32]) -> NDArray[np.uint8]:
    """(height, width): how much of the light a lens lets through, of 255."""
    radius = np.linalg.norm(rays, axis=2) / np.linalg.norm(rays[0, 0])
    return np.asarray(np.rint(255 * (1 - 0.22 * radius**2)), np.uint8)


class Camera:
    """Renders one field from one mount. `shutter` is called where the field changes; `develop` may
    run in another thread meanwhile, one shot after the other, in order. `capture` does both."""

    def __init__(
        self,
        field: Field,
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
        self._pool = ThreadPoolExecutor(self._threads - 1) if self._threads > 1 else None
        self._watch = field.watch()
        self._sun = sky.sun(self.weather)
        rng = np.random.default_rng(seed)
        coarse = field.height.shape
        self.scene = _scene_of(field)
        """The grids that pictures are made from: the field as of the last shot developed."""
        self._tallest = float(self.scene.stand[..., render.HEIGHT].max() * render.UNIT)
        self._crowns = _crowns_of(field)
        blocks = tuple(math.ceil(n * field.coarse / render.BLOCK_M - 1e-9) for n in coarse)
        self._known = np.zeros(blocks, np.uint8)
        # A strip left standing that is narrower than this is a row of stalks without a body.
        self._narrowest = max(2, round(0.25 / field.cell))
        # Drawn from `rng` in this order, which fixes a seed's pictures.
        panorama = sky.panorama(self.weather, rng)
        packs = render.bake_packs(rng, field.spec)
        h, w = self.spec.height_px, self.spec.width_px
        self._noise = _noise_of(self.spec, rng)
        self.rays = self._bake_rays()
        """(height, width, 2): right and down per metre ahead of every pixel, undistorted."""
        self._image = np.zeros((h, w, 3), np.uint8)
        self._kernels = self._bind(field, panorama, packs)
        self._kernels.refresh(0, coarse[0], 0, coarse[1], self._narrowest)
        self._header = self._bake_header() if self.spec.machine_in_view else None
        self._place = np.vstack([self.spec.axes, (self.spec.x_m, self.spec.y_m, self.spec.z_m)])
        self._veil = np.zeros((h // _VEIL_SCALE, w // _VEIL_SCALE), np.float32)
        self._clouds = noise.smooth_grid(
            seed + 14,
            self._veil.shape[0] + render.CLOUD_OFFSETS,
            self._veil.shape[1] + render.CLOUD_OFFSETS,
            1.0,
            render.CLOUD_PX,
        )
        wrong, s = self.spec.disturbance, self.spec
        dirt = wrong.spots > 0 or wrong.straws > 0 or wrong.mud > 0
        self._lens, self._shake = None, None
        if dirt or wrong.flare > 0:
            self._lens = disturbance.Lens(wrong, self.rays, s.focal_px, seed)
        if wrong.shake_deg > 0:
            self._shake = disturbance.Shake(
                wrong, (w, h), s.focal_px, s.readout_s, s.shutter_s, seed
            )
        self._vignette = _vignette_of(self.rays)

    def _bind(
        self, field: Field, panorama: NDArray[np.uint8], packs: NDArray[Any]
    ) -> render.Kernels:
        """All that stays the same from picture to picture, handed to the kernels."""
        s, scene, weather, spec = self.spec, self.scene, self.weather, field.spec
        h, w = s.height_px, s.width_px
        crop, straw, green = np.array(spec.crop_bgr), spec.straw_bgr, np.array((56.0, 138.0, 118.0))
        tiles = texture.bake(self._seed, spec.soil_bgr, straw, spec.crop_bgr)
        light = sky.light_table(weather)
        brighter = np.minimum(255, np.arange(256) * float(np.mean(light[255]))).astype(np.int32)
        bright = brighter[panorama]
        # Azimuths reach past the picture's sides: pitch and roll spread them.
        corner = float(np.linalg.norm(self.rays[-1, 0]))
        tangent = math.tan(min(1.5, 1.25 * math.atan(corner) + 0.1))
        # Whole vectors of floats.
        stride = h + 16
        # As wide as two of the picture's columns.
        bins = math.ceil(w / 2 * tangent / float(np.abs(self.rays[0, 0, 0])))
        most = -(-packs.shape[1] // 16) * 16
        toward = math.radians(90 - weather.wind_from_deg + 180)
        sway = 0.012 * weather.wind_mps
        block_rows, block_columns = self._known.shape
        picture = render.Picture(
            x0=scene.x0, y0=scene.y0, cell=scene.cell, canopy=0.8 * field.tallest_crop_m,
            tallest=field.tallest_crop_m, roof=self._tallest,
            focal=s.focal_px, cu=w / 2, cv=h / 2, k1=s.k1, k2=s.k2, tangent=tangent, corner=corner,
            sway_x=sway * math.cos(toward), sway_y=sway * math.sin(toward), gust=_GUSTS,
            haze=weather.haze, haze_bgr=(196.0, 208.0, 214.0), crop_bgr=tuple(crop),
            green_bgr=tuple(green), straw_bgr=straw, unripe_loss=tuple(1 - green / crop),
            coarse_rows=scene.way.shape[0], coarse_columns=scene.way.shape[1],
            block_rows=block_rows, block_columns=block_columns,
            beyond_is_crop=spec.neighbours != "none", pack_size=packs.shape[1], most=most,
            crown_count=len(self._crowns), tile_size=tiles.shape[1],
            panorama_rows=panorama.shape[0], panorama_columns=panorama.shape[1],
            rows=h, columns=w, bins=bins, seed=self._seed, parts=render.PARTS, stride=stride,
            lens=tuple(self._undistortion()), sun=(self._sun.east, self._sun.north, self._sun.up),
            light=self._light_terms(light),
        )  # fmt: skip
        kernels = render.Kernels(picture)
        kernels.hold(
            kind=scene.kind, way=scene.way, land=scene.land, stand=scene.stand, packs=packs,
            # Pages that no block in view has touched take no memory.
            grown=np.zeros((block_rows * block_columns, render.GROWN_FIELDS, most), np.float32),
            known=self._known, grown_count=np.zeros(self._known.size, np.int32),
            crowns=self._crowns, tiles=tiles,
            panorama=bright[..., 0] | bright[..., 1] << 8 | bright[..., 2] << 16,
            profiles=np.zeros((bins, render.PIECES, render.PIECE_BYTES), np.uint8),
            pieces=np.zeros(bins, np.int32),
            blocks=np.zeros(render.MOST_BLOCKS, np.int32),
            first=np.zeros(render.MOST_BLOCKS + 1, np.int64),
            drawn=np.zeros((render.PARTS, 2), np.int64),
            sorted=np.zeros((render.PARTS, render.PALETTE_STALKS), np.int32),
            dealt=np.zeros(render.PARTS, np.int64),
            image=self._image,
        )  # fmt: skip
        return kernels

    def _bake_rays(self) -> NDArray[np.float32]:
        s = self.spec
        u = (np.arange(s.width_px) + 0.5 - s.width_px / 2) / s.focal_px
        v = (np.arange(s.height_px) + 0.5 - s.height_px / 2) / s.focal_px
        # Across and down apart: numpy adds up the squares of pairs three times more slowly.
        distorted = np.meshgrid(u, v)
        x, y = distorted
        for _ in range(20):
            r = x**2 + y**2
            shrunk = 1 + r * (s.k1 + r * s.k2)
            x, y = distorted[0] / shrunk, distorted[1] / shrunk
        return np.stack([x, y], axis=2).astype(np.float32)

    @staticmethod
    def _light_terms(table: NDArray[np.float32]) -> tuple[tuple[float, ...], ...]:
        """A light table's (256, 3) columns as polynomials of the share of the sun."""
        seen = np.linspace(0.0, 1.0, len(table))[:, None] ** np.arange(render.LIGHT_TERMS)
        return tuple(tuple(k) for k in np.linalg.lstsq(seen, table, rcond=None)[0].T.tolist())

    def _undistortion(self) -> NDArray[np.float64]:
        """The lens's inverse as a polynomial: undistorted radius over distorted less 1 is r² times
        these coefficients of 1, r², r⁴, r⁶, r being the distorted radius."""
        ideal = np.linalg.norm(self.rays[0, : self.spec.width_px // 2 + 1], axis=1)
        ideal = np.linspace(0.02, 1.0, 200) * float(ideal[0])
        r = ideal**2
        distorted = ideal * (1 + r * (self.spec.k1 + r * self.spec.k2))
        powers = distorted[:, None] ** np.arange(2, 10, 2)
        return np.asarray(np.linalg.lstsq(powers, ideal / distorted - 1, rcond=None)[0])

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
        seen from behind, pitch nose down; both in radians and against the field's plane
        (`Field.bumps`)."""
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
        label = np.empty(self._image.shape[:2], np.uint8)
        self._kernels.hold(labels=label)
        self._render(self.shutter(t, x, y, yaw, roll, pitch, v, yaw_rate, blade_on))
        self._kernels.picture.labels = None
        if self._header is not None:
            label[self._header[1]] = labels.MACHINE
        # Single stalks stand out of the crop's outline: close their gaps before taking the border.
        crop = (label == labels.STANDING).astype(np.uint8)
        solid = cv2.morphologyEx(crop, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
        solid = cv2.morphologyEx(solid, cv2.MORPH_OPEN, np.ones((9, 9), np.uint8))
        right = np.zeros_like(solid)
        right[:, :-2] = solid[:, 2:]
        open_ground = np.isin(
            label, (labels.STUBBLE, labels.STRAW, labels.SOIL, labels.WEEDS)
        ).astype(np.uint8)
        beside = cv2.dilate(open_ground, np.ones((1, 15), np.uint8))
        label[(solid == 1) & (right == 0) & (beside == 1)] = labels.EDGE
        return label

    def encode(self, bgr: NDArray[np.uint8]) -> bytes:
        """The JPEG file of a picture at the spec's quality."""
        ok, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, self.spec.jpeg_quality])
        if not ok:
            raise ValueError(f"cannot encode a picture of shape {bgr.shape} as JPEG")
        return data.tobytes()

    # ---- rendering ------------------------------------------------------------------------------

    def view(self, shot: Shot) -> render.View:
        """Where the camera truly is at a shot, above the field's plane, bumps and vibration
        included."""
        s = self.spec
        instant = round(shot.t * 1e6)
        shake = [s.vibration_deg * noise.normal(self._seed + k, instant, 0) for k in (3, 4)]
        mount = _axes(
            math.radians(s.yaw_deg),
            math.radians(s.pitch_deg + shake[0]),
            math.radians(s.roll_deg + shake[1]),
        )
        # The mount tips with the vehicle about its ground point: about the vehicle's axes, not the
        # camera's own, about which a roll would turn a pitched camera's view aside.
        right, down, forward = _axes(shot.yaw, shot.pitch, shot.roll)
        vehicle = tuple(zip(forward, (-r for r in right), (-d for d in down), strict=True))
        x, y, z = (s.x_m * f + s.y_m * left + s.z_m * up for f, left, up in vehicle)
        seen = [[a * f + b * left + c * up for f, left, up in vehicle] for a, b, c in mount]
        return render.View(
            x=shot.x + x,
            y=shot.y + y,
            z=max(0.05, z),
            axes=np.array(seen),
            focal=s.focal_px,
            cu=s.width_px / 2,
            cv=s.height_px / 2,
            shear=s.focal_px * shot.yaw_rate * s.readout_s,
        )

    def _render(self, shot: Shot) -> None:
        if shot.change is not None:
            j0, i0, kinds = shot.change
            j1, i1 = j0 + kinds.shape[0], i0 + kinds.shape[1]
            self.scene.kind[j0:j1, i0:i1] = kinds
            self._kernels.refresh(j0 // 2, (j1 + 1) // 2, i0 // 2, (i1 + 1) // 2, self._narrowest)
        view = self.view(shot)
        kernels = self._kernels
        picture = kernels.picture
        picture.t = shot.t
        picture.x, picture.y, picture.z = view.x, view.y, view.z
        picture.axes[:] = view.axes.ravel().tolist()
        picture.shear = view.shear
        stalks = kernels.plan()
        if stalks > picture.capacity:
            picture.capacity = int(1.3 * stalks)
            kernels.hold(
                stalks=np.empty((picture.capacity, render.STALK_BYTES), np.uint8),
                spans=np.empty((picture.capacity, 2), np.int16),
            )
        self._shared(kernels.prepare)
        kernels.sort()
        self._shared(kernels.draw)
        if self._header is not None:
            header, mask = self._header
            self._image[mask] = header[mask]
        if shot.blade_on and self.weather.dust > 0:
            self._raise_dust(shot)

    def _shared(self, work: Callable[[int, int], None]) -> None:
        """Does all PARTS of a work, in as many threads as there are."""
        if self._pool is None:
            work(0, render.PARTS)
            return
        parts = iter(range(render.PARTS))

        def some() -> None:
            for part in parts:
                work(part, part + 1)

        helpers = [self._pool.submit(some) for _ in range(self._threads - 1)]
        some()
        for helper in helpers:
            # One that never came to begin is not waited for.
            if not helper.cancel():
                helper.result()

    def _bake_header(self) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """The machine's own parts as the camera sees them, and where: blade bar, frame and the
        dividers at its ends. They keep their place in the picture."""
        s = self.spec
        half, front = self._blade_width_m / 2, self._blade_x_m
        steel, paint = (96, 100, 104), (40, 48, 150)
        parts = [
            (paint, [(front - 0.12, y, z) for y, z in ((half, 0.4), (-half, 0.4))]
             + [(front - 0.06, y, z) for y, z in ((-half, 0.16), (half, 0.16))]),
            (steel, [(front - 0.06, -half, 0.16), (front - 0.06, half, 0.16),
                     (front, half, 0.12), (front, -half, 0.12)]),
            *((paint, [(front - 0.12, y, 0.42), (front - 0.12, y, 0.12), (front + 0.2, y, 0.12),
                       (front + 0.05, y + 0.03, 0.22)]) for y in (half, -half)),
        ]  # fmt: skip
        picture = np.zeros((s.height_px, s.width_px, 3), np.uint8)
        drawn = np.zeros((s.height_px, s.width_px), np.uint8)
        axes, place = s.axes, np.array([s.x_m, s.y_m, s.z_m])
        for colour, corners in parts:
            right, down, ahead = axes @ (np.array(corners) - place).T
            if ahead.min() < 0.1:
                continue
            a, b = right / ahead, down / ahead
            r = a * a + b * b
            lens = s.focal_px * (1 + r * (s.k1 + r * s.k2))
            points = np.stack([a * lens + s.width_px / 2, b * lens + s.height_px / 2], 1)
            polygon = np.rint(points).astype(np.int32)
            cv2.fillPoly(picture, [polygon], colour)
            cv2.fillPoly(drawn, [polygon], 1)
        return picture, drawn > 0

    def _raise_dust(self, shot: Shot) -> None:
        s, weather = self.spec, self.weather
        toward = math.radians(90 - weather.wind_from_deg + 180) - shot.yaw
        wind = 0.4 * weather.wind_mps  # near the ground
        drift = (wind * math.cos(toward) - shot.v, wind * math.sin(toward))
        render.raise_dust(
            self._image, self._veil, self._place, s.focal_px, self._seed + 13, shot.t, drift,
            self._blade_x_m, self._blade_width_m / 2, weather.dust, self._clouds, _DUST_BGR,
        )  # fmt: skip

    # ---- sensor ---------------------------------------------------------------------------------

    def _sense(self, shot: Shot) -> NDArray[np.uint8]:
        s = self.spec
        seen = self._image
        if self._shake is not None:
            seen = self._shake(seen, shot.t)
        if self._lens is not None:
            towards = self.view(shot).axes @ (self._sun.east, self._sun.north, self._sun.up)
            seen = self._lens(seen, towards, 1 - self.weather.cloud)
        smear = round(s.focal_px * abs(shot.yaw_rate) * s.shutter_s)
        smeared = smear > 1
        image: NDArray[Any] = np.ascontiguousarray(seen)
        if smeared:
            image = cv2.blur(cv2.GaussianBlur(image, (3, 3), 0), (smear, 1))
        mean = max(8.0, render.mean_light(image, self._vignette, soft=smeared))
        wander = 1 + 0.04 * (noise.smooth(self._seed + 5, shot.t * 0.4, 0.5) - 0.5)
        gain = wander * (s.target / mean) ** s.exposure
        tint = noise.smooth(self._seed + 6, shot.t * 0.1, 0.5) - 0.5
        cast = np.array([1 + 0.05 * tint, 1.0, 1 - 0.05 * tint], np.float32) * np.float32(gain)
        cast *= disturbance.white_balance(s.disturbance, self._seed, shot.t).astype(np.float32)
        cast *= np.float32(disturbance.hunting(s.disturbance, self._seed, shot.t))
        draw = int(noise.mix(self._seed, round(shot.t * 1e6), 9))
        return render.expose(image, self._vignette, cast, self._noise, draw, soft=smeared)
