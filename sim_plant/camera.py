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

from sim_plant import field as f
from sim_plant import labels, noise, render, sky, texture
from sim_plant.field import NotNegative, Positive, Share, Strict
from sim_plant.sky import WeatherSpec


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
    """From the shutter to the host: exposure, file, network."""

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.width_px / 2 / math.tan(math.radians(self.hfov_deg) / 2)


_VEIL_SCALE: Final = 4
"""The blade's dust is drawn so much smaller."""
_GUSTS: Final = 0.35
"""Of the mean lean, what gusts add and take."""

LOW = CameraSpec(x_m=0.1, z_m=0.6, pitch_deg=5.0)
MAST = CameraSpec(x_m=0.0, z_m=1.6, pitch_deg=28.0)
MOUNTS: Final = {"low": LOW, "mast": MAST}


def cells_to(body: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(rows, columns): how far the nearest cell of `body`, of the same shape, is away, in cells.
    The last bits of OpenCV's answer depend on where its arrays lie in memory; the square of a
    distance between cells is a whole number."""
    cells = cv2.distanceTransform((~body).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.sqrt(np.rint(np.square(cells, dtype=np.float32)))


def _axes(yaw: float, pitch: float, roll: float) -> NDArray[np.float64]:
    """Rows right, down, forward of a camera; pitch positive downward, roll clockwise."""
    cp, sp, cy, sy, cr, sr = (g(a) for a in (pitch, yaw, roll) for g in (math.cos, math.sin))
    level = (sy, -cy, 0.0)
    under = (-cy * sp, -sy * sp, -cp)
    return np.array(
        [
            [cr * a + sr * b for a, b in zip(level, under, strict=True)],
            [cr * b - sr * a for a, b in zip(level, under, strict=True)],
            [cy * cp, sy * cp, -sp],
        ]
    )


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
        self._pool = ThreadPoolExecutor(self._threads - 1) if self._threads > 1 else None
        self._watch = field.watch()
        self._sun = sky.sun(self.weather)
        rng = np.random.default_rng(seed)
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
        self._tallest = float(stand[..., render.HEIGHT].max() * render.UNIT)
        self._scene = render.Scene(
            kind=field.kind.copy(),
            clear=np.zeros(coarse, np.float32),
            stand=stand,
            x0=float(field.origin[0]),
            y0=float(field.origin[1]),
            cell=field.cell,
            beyond_is_crop=field.spec.neighbours != "none",
            canopy=0.8 * field.tallest_crop_m,
        )
        self._coarse = field.coarse
        self._tallest_crop = field.tallest_crop_m
        crowns = [
            (t.x_m, t.y_m, t.height_m - t.crown_radius_m, t.crown_radius_m)
            for t in field.spec.trees
        ]
        self._crowns = np.array(crowns, np.float64).reshape(-1, 4)
        corner = np.array([*field.origin, 0.0, 0.0])
        self._crowns_in_cells = (self._crowns - corner) / self._coarse
        self._refresh(0, coarse[0], 0, coarse[1])
        crop, straw = field.spec.crop_bgr, field.spec.straw_bgr
        green = (56.0, 138.0, 118.0)
        tiles, levels = texture.bake(seed, field.spec.soil_bgr, straw, crop)
        gain = float(np.mean(sky.light_table(self.weather)[255]))
        panorama = np.minimum(255, sky.panorama(self.weather, rng) * gain)
        self._paint = render.Paint(
            tiles=tiles,
            levels=levels,
            panorama=panorama.astype(np.int32) @ np.array([1, 1 << 8, 1 << 16], np.int32),
            light=sky.light_table(self.weather),
            haze=self.weather.haze,
            haze_bgr=np.array([196.0, 208.0, 214.0], np.float32),
            crop_bgr=np.array(crop, np.float32),
            green_bgr=np.array(green, np.float32),
            straw_bgr=np.array(straw, np.float32),
            unripe_loss=np.array(1 - np.array(green) / np.array(crop), np.float32),
        )
        self._packs = render.bake_packs(rng, field.spec)
        s = self.spec
        h, w = s.height_px, s.width_px
        self._rays = self._bake_rays()
        # Azimuths reach past the picture's sides: pitch and roll spread them.
        half_fov = math.atan(float(np.linalg.norm(self._rays[-1, 0])))
        self._tangent = math.tan(min(1.5, 1.25 * half_fov + 0.1))
        self._rays_a, self._rays_b = (self._rays[..., k].copy() for k in (0, 1))
        pieces = np.zeros((w, 2 * render.SEGMENTS + 1, 4), np.float32)
        self._profiles = render.Profiles(pieces, np.zeros(w, np.int32))
        self._image = np.zeros((h, w, 3), np.uint8)
        self._prepare = render.Direct(render.prepare)
        self._draw = render.Direct(render.draw)
        self._canvas = np.zeros((h, w), np.int64)
        self._records = np.zeros(0, render.STALK)
        self._spans = np.zeros((0, 2), np.int16)
        self._header = self._bake_header() if s.machine_in_view else None
        tile = rng.normal(0, s.noise, (h + 128, w + 128, 3)).clip(-127, 127)
        self._noise = np.rint(tile).astype(np.int8).reshape(h + 128, -1)
        self._clouds = noise.smooth_grid(
            seed + 14,
            h // _VEIL_SCALE + render.CLOUD_OFFSETS,
            w // _VEIL_SCALE + render.CLOUD_OFFSETS,
            1.0,
            render.CLOUD_PX,
        )
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
        solid = (fine == f.OBSTACLE) | (fine == f.TRUNK)
        crop: NDArray[Any] = ((fine == f.CROP) | (fine == f.NEIGHBOUR)).view(np.uint8)
        # A strip left standing that is narrower than this is a row of stalks without a body.
        narrowest = max(2, round(0.25 / scene.cell))
        block = np.ones((narrowest, narrowest), np.uint8)
        crop = cv2.morphologyEx(crop, cv2.MORPH_OPEN, block, borderType=cv2.BORDER_REPLICATE)
        body = (crop > 0) | solid
        body = body[::2, ::2] | body[1::2, ::2] | body[::2, 1::2] | body[1::2, 1::2]
        # The diagonal: the point and the crop may each lie at the far corner of their cells.
        clear = np.clip((cells_to(body) - 1.4143) * self._coarse, 0, cap)
        p, q = max(0, j0 - pad), min(rows, j1 + pad)
        r, s = max(0, i0 - pad), min(columns, i1 + pad)
        scene.clear[p:q, r:s] = clear[p - a : q - a, r - c : s - c]
        scene.stand[p:q, r:s, render.BODY] = body[p - a : q - a, r - c : s - c]
        # Only crop is ever cut, so a change lengthens or shortens no longer shadow than the crop's.
        flat = math.hypot(self._sun.east, self._sun.north) / max(self._sun.up, 0.03)
        reach = math.ceil(self._tallest_crop * flat / self._coarse) + 1
        render.shade(
            scene.stand,
            self._coarse,
            self._tallest,
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
        label = (self._canvas >> 24 & 255).astype(np.uint8)
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

    def _view(self, shot: Shot) -> render.View:
        s = self.spec
        instant = round(shot.t * 1e6)
        shake = [s.vibration_deg * noise.normal(self._seed + k, instant, 0) for k in (3, 4)]
        mount = _axes(
            *(math.radians(a) for a in (s.yaw_deg, s.pitch_deg + shake[0], s.roll_deg + shake[1]))
        )
        # The mount tips with the vehicle about its ground point: about the vehicle's axes, not the
        # camera's own, about which a roll would turn a pitched camera's view aside.
        right, down, forward = _axes(shot.yaw, shot.pitch, shot.roll)
        vehicle = np.stack([forward, -right, -down])
        at = np.array([s.x_m, s.y_m, s.z_m]) @ vehicle
        return render.View(
            x=shot.x + at[0],
            y=shot.y + at[1],
            z=max(0.05, at[2]),
            axes=mount @ vehicle,
            focal=s.focal_px,
            cu=s.width_px / 2,
            cv=s.height_px / 2,
            k1=s.k1,
            k2=s.k2,
            shear=s.focal_px * shot.yaw_rate * s.readout_s,
            rays_a=self._rays_a,
            rays_b=self._rays_b,
            tangent=self._tangent,
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
        limit = int((2 * render.REACH_M / render.BLOCK_M + 2) ** 2)
        blocks = np.empty((limit, 2), np.int32)
        away = np.empty(limit, np.float32)
        corner = float(np.linalg.norm(self._rays[-1, 0]))
        found = render.blocks_in_view(view, math.atan(corner) + 0.05, scene, blocks, away)
        order = np.argsort(away[:found], kind="stable")
        blocks, away = blocks[order], away[order]
        near = np.maximum(away, 0.1)
        share = np.clip(2.8 / near, 0.06, 1.0)
        first = np.zeros(found + 1, np.int64)
        np.cumsum(np.ceil(self._packs.shape[1] * share).astype(np.int64), out=first[1:])
        if first[-1] > len(self._records):
            self._records = np.zeros(int(first[-1] * 1.3), render.STALK)
            self._spans = np.zeros((len(self._records), 2), np.int16)
        drawn = np.zeros(found, np.int64)
        weather = self.weather
        toward = math.radians(90 - weather.wind_from_deg + 180)
        sway = 0.012 * weather.wind_mps
        wind = render.Wind(float(shot.t), sway * math.cos(toward), sway * math.sin(toward), _GUSTS)

        # Blocks are dealt out so that every part gets about as many stalks.
        share_of = np.searchsorted(first, first[-1] * np.arange(render.STRIPS + 1) / render.STRIPS)
        share_of[-1] = found
        stalks = render.Stalks(blocks, self._packs, first, drawn, self._records, self._spans)
        profiles, width = self._profiles, self.spec.width_px
        bins = len(profiles.counts)

        def prepare(part: int) -> None:
            self._prepare(
                (int(share_of[part]), int(share_of[part + 1])),
                (bins * part // render.STRIPS, bins * (part + 1) // render.STRIPS),
                scene, view, paint, profiles, stalks, self._seed, wind,
            )  # fmt: skip

        def draw(part: int) -> None:
            left, right = width * part // render.STRIPS, width * (part + 1) // render.STRIPS
            self._draw(
                self._image, self._canvas, left, right, scene, view, paint, profiles,
                self._crowns, stalks,
            )  # fmt: skip

        self._shared(prepare)
        self._shared(draw)

        if self._header is not None:
            picture, mask = self._header
            self._image[mask] = picture[mask]
        if shot.blade_on and self.weather.dust > 0:
            self._raise_dust(shot)

    def _shared(self, work: Callable[[int], None]) -> None:
        """Does each of the STRIPS parts of a work once, in as many threads as there are."""
        parts = iter(range(render.STRIPS))

        def some() -> None:
            for part in parts:
                work(part)

        helpers = [self._pool.submit(some) for _ in range(self._threads - 1)] if self._pool else []
        some()
        for helper in helpers:
            # One that never came to begin is not waited for.
            if not helper.cancel():
                helper.result()

    def _mount_axes(self) -> NDArray[np.float64]:
        """Right, down and forward of the camera in the vehicle frame."""
        s = self.spec
        return _axes(*(math.radians(a) for a in (s.yaw_deg, s.pitch_deg, s.roll_deg)))

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
        axes, place = self._mount_axes(), np.array([s.x_m, s.y_m, s.z_m])
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
        scale = _VEIL_SCALE
        mount = np.vstack([self._mount_axes(), (s.x_m, s.y_m, s.z_m)])
        toward = math.radians(90 - weather.wind_from_deg + 180) - shot.yaw
        wind = 0.4 * weather.wind_mps  # near the ground
        drift = np.array([wind * math.cos(toward) - shot.v, wind * math.sin(toward)])
        veil = np.zeros((s.height_px // scale, s.width_px // scale), np.float32)
        render.puff(
            veil, mount, s.focal_px, scale, self._seed + 13, shot.t, drift, self._blade_x_m,
            self._blade_width_m / 2, weather.dust, self._clouds,
        )  # fmt: skip
        coarse = np.rint(veil * 255).astype(np.uint8)
        opacity: NDArray[Any] = cv2.resize(
            coarse, (s.width_px, s.height_px), interpolation=cv2.INTER_LINEAR
        )
        render.veil(self._image, opacity, np.array([160.0, 182.0, 200.0], np.float32))

    # ---- sensor ---------------------------------------------------------------------------------

    def _sense(self, shot: Shot) -> NDArray[np.uint8]:
        s = self.spec
        image: NDArray[Any] = cv2.GaussianBlur(self._image, (3, 3), 0)
        smear = round(s.focal_px * abs(shot.yaw_rate) * s.shutter_s)
        if smear > 1:
            image = cv2.blur(image, (smear, 1))
        sample = image[::8, ::8] * (self._vignette[::8, ::8] / np.float32(255))
        mean = max(8.0, float(sample.mean()))
        wander = 1 + 0.04 * (noise.smooth(self._seed + 5, shot.t * 0.4, 0.5) - 0.5)
        gain = wander * (s.target / mean) ** s.exposure
        tint = noise.smooth(self._seed + 6, shot.t * 0.1, 0.5) - 0.5
        gains = np.array([1 + 0.05 * tint, 1.0, 1 - 0.05 * tint], np.float32) * np.float32(gain)
        h = noise.mix(self._seed, round(shot.t * 1e6), 9)
        dv, du = int(h) % 128, (int(h) >> 8) % 128
        rough = self._noise[dv : dv + s.height_px, 3 * du : 3 * (du + s.width_px)]
        flat = s.height_px, 3 * s.width_px
        answer = render.expose(image.reshape(flat), self._vignette.reshape(flat), gains, rough)
        return answer.reshape(self._image.shape)
