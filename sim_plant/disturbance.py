"""What a real camera does to a picture besides: its lens is dirty, the sun shines into it, its
mount shakes while the rows are read, its automatics do not come to rest.

Everything here is a function of (seed, time, where the sun stands before the lens) alone. Light is
reckoned in linear units; pictures hold its root of 2.2.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field as Limits

from sim_plant import noise
from sim_plant.strict import Positive, Share, Strict

Picture = NDArray[np.uint8]
Floats = NDArray[np.float32]


class DisturbanceSpec(Strict):
    """What is wrong with the camera; nothing by default."""

    white_balance_mired: Annotated[float, Limits(ge=0, le=150)] = 0.0
    """How far the automatic white balance drifts to either side of the light's true colour
    temperature, in micro reciprocal degrees: what colours shift by is about even in these. 50 turns
    noon (5500 K) into 4300 or 7600 K."""
    white_balance_s: Positive = 8.0
    """How long it drifts one way."""
    hunting_ev: Annotated[float, Limits(ge=0, le=3)] = 0.0
    """Stops that the automatic exposure overshoots to either side while it hunts."""
    hunting_s: Positive = 1.5
    """Of one swing there and back."""
    flare: Share = 0.0
    """Share of the sun's light on the lens that is scattered into the picture, of what a smeared
    lens scatters; 0.15 is a clean phone. Without the sun before the lens there is no flare."""
    spots: Share = 0.0
    """Share of the lens under specks of dust and dried drops, which dim and scatter."""
    straws: Annotated[int, Limits(ge=0, le=20)] = 0
    """Pieces of straw and chaff that stick to the lens."""
    mud: Annotated[float, Limits(ge=0, le=0.6)] = 0.0
    """Share of the lens under mud, which lets nothing through."""
    shake_deg: Annotated[float, Limits(ge=0, le=3)] = 0.0
    """Amplitude of the mount's swing about each axis while the rows are read and exposed."""
    shake_hz: Annotated[float, Limits(gt=0, le=200)] = 31.5
    """Of that swing. A power tiller's handle shakes most at 31.5 Hz (Ahmadian, Hassan-Beygi and
    Ghobadian 2013, Journal of Vibroengineering 15(3))."""


_GAMMA: Final = 2.2
"""Of a display, about what sRGB has (IEC 61966-2-1)."""
_LINEAR: Final = ((np.arange(256) / 255.0) ** _GAMMA).astype(np.float32)
_ROOTS: Final = 4096
"""Steps of light in the table that turns it into a display's values: finer than any of these."""
_DISPLAY: Final = np.rint(255 * (np.arange(_ROOTS) / (_ROOTS - 1)) ** (1 / _GAMMA)).astype(np.uint8)
_PRIMARIES_M: Final = np.array([465e-9, 545e-9, 610e-9])
"""About where blue, green and red of a display lie in the spectrum."""
_SECOND_RADIATION: Final = 1.4388e-2
"""Metre kelvins, of Planck's law."""
_DAYLIGHT_MIRED: Final = 1e6 / 5500
_TINT: Final = 0.25
"""Of a drift from blue to red, what goes from green to magenta."""
_GLOW_DEG: Final = 12.0
"""From the sun within which flare's light stays about the same; further off it falls with the
square of the angle, as the eye's own does (CIE 146:2002)."""
_VEIL: Final = 0.35
"""Of the scattered light, what lies over the whole picture alike (ISO 9358's veiling glare)."""
_FULL_FLARE: Final = 3.0
"""Light that flare 1 lays next to the sun, in units of white."""
_GHOSTS: Final = ((-0.35, 0.06, 0.10), (-0.8, 0.10, 0.07), (0.4, 0.04, 0.08), (-1.3, 0.16, 0.05))
"""Reflections between the lens's faces, on the line from the sun through the middle: where on it,
radius as a share of the width, light as a share of flare's."""
_SPOT_SHARE: Final = (0.008, 0.035)
"""Radius of specks, of the width: seen out of focus they are as large as the lens."""
_DEFOCUS_SHARE: Final = 0.012
"""Of the width: the blur of what lies on the lens."""
_MUD_SHARE: Final = 0.15
"""Of the width: how large a splash is."""
_STRAW_LIGHT: Final = np.array([0.10, 0.20, 0.28], np.float32)
_MUD_LIGHT: Final = np.array([0.02, 0.03, 0.045], np.float32)
"""What straw and mud on the lens show themselves, blue, green, red, of white."""
_EXPOSED_AT: Final = (-0.5, 0.0, 0.5)
"""Of the exposure time: moments that a blurred row is the mean of."""


def white_balance(spec: DisturbanceSpec, seed: int, t: float) -> NDArray[np.float64]:
    """(3,) factors on blue, green and red of a picture (display-referred), green about 1, at time
    `t` (s): the light's colour over the one that was meant, by Planck's law at the display's
    primaries, and a lesser error from green to magenta."""
    if spec.white_balance_mired == 0.0:
        return np.ones(3)
    between, aside = (
        2 * noise.smooth(seed + k, t / spec.white_balance_s, 0.5) - 1 for k in (21, 22)
    )
    factors = 1 / _radiance(spec.white_balance_mired * between)
    factors[1] *= _radiance(_TINT * spec.white_balance_mired * aside)[0]
    return np.asarray(factors ** (1 / _GAMMA))


def _radiance(mired: float) -> NDArray[np.float64]:
    """(3,): of a black body so many mired redder than daylight at the primaries, over daylight's;
    green is 1."""

    def planck(m: float) -> NDArray[np.float64]:
        return np.asarray(_PRIMARIES_M**-5 / np.expm1(_SECOND_RADIATION * m / (1e6 * _PRIMARIES_M)))

    out = planck(_DAYLIGHT_MIRED + mired) / planck(_DAYLIGHT_MIRED)
    return np.asarray(out / out[1])


def hunting(spec: DisturbanceSpec, seed: int, t: float) -> float:
    """Factor on a picture (display-referred) at time `t` (s): a control that takes even steps and
    learns late whether they were enough overshoots by turns. libcamera's simple one did, by steps
    of a tenth (its patch 26238 of 2026, "Replace bang-bang controller with proportional")."""
    if spec.hunting_ev == 0.0:
        return 1.0
    phase = t / spec.hunting_s + 0.5 * noise.smooth(seed + 23, 0.2 * t / spec.hunting_s, 0.5)
    saw = abs(4 * (phase - math.floor(phase)) - 2) - 1
    return float(2.0 ** (spec.hunting_ev * saw / _GAMMA))


class Lens:
    """The dirt on a lens and the light that strays in it, for pictures of one size."""

    def __init__(self, spec: DisturbanceSpec, rays: Floats, focal_px: float, seed: int) -> None:
        """`rays` (height, width, 2): right and down per metre ahead of every pixel."""
        self._spec = spec
        self._focal_px = focal_px
        height, width = rays.shape[:2]
        self._size = (width, height)
        self._passed, self._own, self._strayed = _dirt(spec, width, height, seed)
        self._dirty = bool(self._passed.min() < 1)
        ahead = np.ones((*rays.shape[:2], 1), np.float32)
        small = np.concatenate([rays, ahead], axis=2)[4::8, 4::8]
        self._looks = small / np.linalg.norm(small, axis=2, keepdims=True)

    def __call__(self, bgr: Picture, sun: NDArray[np.float64], sunlight: float) -> Picture:
        """What gets through the lens. `sun`: unit vector right, down, forward of the camera towards
        it; `sunlight`: its share that is not behind clouds. What flare adds to the whole is
        answered by a shorter exposure, so that nothing is burnt that the sensor would not burn."""
        flare = self._flare(sun, sunlight)
        if not self._dirty and flare is None:
            return bgr
        light = _LINEAR[bgr]
        mean = cv2.mean(light)[:3]
        if self._dirty:
            stray = np.array(mean, np.float32) * self._strayed
            light = light * self._passed + stray + self._own
        if flare is not None:
            light = light + flare
            light *= np.float32(sum(mean) / max(sum(cv2.mean(light)[:3]), 1e-6))
        steps = np.minimum(light * (_ROOTS - 1) + 0.5, _ROOTS - 1).astype(np.uint16)
        return np.asarray(_DISPLAY[steps], np.uint8)

    def _flare(self, sun: NDArray[np.float64], sunlight: float) -> Floats | None:
        """(height, width, 3) of light, or None where the sun is not before the lens. A veil, a glow
        about the sun and ghosts opposite to it, as Wu et al. compose it (How to Train Neural
        Networks for Flare Removal, ICCV 2021)."""
        amount = self._spec.flare * sunlight * float(sun[2])
        if amount <= 0.0:
            return None
        angle = np.degrees(np.arccos(np.clip(self._looks @ sun.astype(np.float32), -1, 1)))
        glow = _VEIL / _FULL_FLARE + 1 / (1 + (angle / _GLOW_DEG) ** 2)
        width, height = self._size
        ghosts = np.zeros(angle.shape, np.float32)
        if sun[2] > 0.1:
            columns = angle.shape[1]
            from_middle = sun[:2] / sun[2] * self._focal_px / width
            far = float(np.linalg.norm(from_middle))
            # The sun itself may be far out of the picture; its ghosts gather about the middle.
            from_middle *= min(1.0, 1.0 / max(far, 1e-6))
            for along, radius, share in _GHOSTS:
                place = (from_middle * along + (0.5, 0.5 * height / width)) * columns
                disc = np.zeros_like(ghosts)
                at = (round(float(place[0])), round(float(place[1])))
                cv2.circle(disc, at, max(1, round(radius * columns)), share, -1)
                ghosts += np.asarray(cv2.blur(disc, (5, 5)), np.float32)
        light = (amount * _FULL_FLARE * (glow + ghosts)).astype(np.float32)
        grown = cv2.resize(light, (width, height), interpolation=cv2.INTER_LINEAR)
        return np.asarray(grown[..., None] * np.array([0.85, 0.95, 1.0], np.float32), np.float32)


def _dirt(
    spec: DisturbanceSpec, width: int, height: int, seed: int
) -> tuple[Floats, Floats, Floats]:
    """What lies on a lens: the share of light that passes (height, width, 1), the light that it
    shows itself (height, width, 3), and the share of the picture's mean light that it strays there
    (height, width, 1). Attenuated, scattered and out of focus as in Gu et al., Removing Image
    Artifacts Due to Dirty Camera Lenses and Thin Occluders (ACM TOG 28(5), 2009)."""
    rng = np.random.default_rng([seed, 0x1E25])
    dim = np.zeros((height, width), np.float32)
    straw, mud = np.zeros_like(dim), np.zeros_like(dim)
    covered, room = 0.0, spec.spots * width * height
    while covered < room:
        radius = float(rng.uniform(*_SPOT_SHARE)) * width
        at = (int(rng.integers(width)), int(rng.integers(height)))
        cv2.circle(dim, at, max(1, round(radius)), float(rng.uniform(0.3, 0.8)), -1)
        covered += math.pi * radius**2
    for _ in range(spec.straws):
        middle = rng.random(2) * (width, height)
        around = float(rng.uniform(0, math.pi))
        half = 0.5 * float(rng.uniform(0.15, 0.6)) * width
        reach = half * np.array([math.cos(around), math.sin(around)])
        ends = [tuple(int(k) for k in np.rint(middle + s * reach)) for s in (-1, 1)]
        thick = max(1, round(float(rng.uniform(0.012, 0.035)) * width))
        cv2.line(straw, ends[0], ends[1], float(rng.uniform(0.6, 0.95)), thick)
    if spec.mud > 0:
        swell = noise.smooth_grid(seed + 24, height, width, 1.0, _MUD_SHARE * width)
        mud[swell > np.quantile(swell, 1 - spec.mud)] = 1.0
    sigma = _DEFOCUS_SHARE * width

    def unsharp(layer: Floats) -> Floats:
        return np.asarray(cv2.GaussianBlur(layer, (0, 0), sigma)[..., None], np.float32)

    dim, straw, mud = unsharp(dim), unsharp(straw), unsharp(mud)
    passed = (1 - dim) * (1 - straw) * (1 - 0.98 * mud)
    own = (straw * _STRAW_LIGHT * (1 - mud) + mud * _MUD_LIGHT).astype(np.float32)
    strayed = 0.6 * dim * (1 - straw) * (1 - mud)
    return passed.astype(np.float32), own, strayed.astype(np.float32)


class Shake:
    """Rows that a shaking mount takes one after the other, as the camera turns about its place
    (Forssén and Ringaby, Rectifying rolling shutter video from hand-held devices, CVPR 2010)."""

    def __init__(
        self,
        spec: DisturbanceSpec,
        size: tuple[int, int],
        focal_px: float,
        readout_s: float,
        shutter_s: float,
        seed: int,
    ) -> None:
        """`size`: width and height in px; `readout_s` from the first to the last row."""
        self._spec, self._focal_px, self._seed = spec, focal_px, seed
        self._readout_s, self._shutter_s = readout_s, shutter_s
        width, height = size
        self._u = np.arange(width, dtype=np.float32)[None, :]
        self._v = np.arange(height, dtype=np.float32)[:, None]
        self._middle = (0.5 * width, 0.5 * height)

    def turned_rad(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3): the mount's swing to the right, down and clockwise at times (n,) in s. Its phase
        wanders, as an engine's speed does."""
        spec = self._spec
        # An engine's speed wanders: no swing keeps step with the camera's frames.
        wander = 3.0 * noise.smooth(self._seed + 25, 0.7 * float(t.mean()), 0.5)
        start = np.array([noise.uniform(self._seed, k, 26) for k in range(3)])
        turns = spec.shake_hz * t[:, None] + wander + start
        return np.asarray(math.radians(spec.shake_deg) * np.sin(math.tau * turns))

    def __call__(self, bgr: Picture, t: float) -> Picture:
        """The picture whose middle row was taken at `t` (s)."""
        height, width = bgr.shape[:2]
        rows = t + ((np.arange(height) + 0.5) / height - 0.5) * self._readout_s
        taken = [self._taken(bgr, rows + k * self._shutter_s) for k in _EXPOSED_AT]
        if self._shutter_s == 0.0:
            return taken[1]
        total = np.zeros((height, width, 3), np.uint16)
        for picture in taken:
            total += picture
        return ((total + len(taken) // 2) // len(taken)).astype(np.uint8)

    def _taken(self, bgr: Picture, t: NDArray[np.float64]) -> Picture:
        right, down, around = (a[:, None].astype(np.float32) for a in self.turned_rad(t).T)
        focal = np.float32(self._focal_px)
        u = self._u + focal * right - (self._v - self._middle[1]) * around
        v = self._v + focal * down + (self._u - self._middle[0]) * around
        moved: NDArray[Any] = cv2.remap(
            bgr,
            u.astype(np.float32),
            v.astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return np.asarray(moved, np.uint8)
