"""Sun, daylight and the far background: what lights and closes a picture of the field."""

from __future__ import annotations

import datetime
import math
from dataclasses import dataclass
from typing import Annotated, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field as Limits

from sim_plant.strict import NotNegative, Share, Strict

PANORAMA_TOP: Final = 0.84
"""Tangent of the elevation of the panorama's first row."""
PANORAMA_BOTTOM: Final = -0.04
_GAMMA: Final = 1 / 2.2
"""Of the display that pictures are made for."""


class WeatherSpec(Strict):
    """Day, hour, air and wind."""

    hour: Annotated[float, Limits(ge=0, lt=24)] = 11.0
    """Solar time: 12 is the sun's highest."""
    date: datetime.date = datetime.date(2026, 4, 28)
    latitude_deg: Annotated[float, Limits(ge=-66, le=66)] = 31.5
    haze: NotNegative = 0.004
    """Share of the light lost per metre of sight."""
    dust: Share = 0.3
    """Density of the puffs that the spinning blade raises."""
    cloud: Share = 0.0
    """0 clear sun, 1 overcast: no shadows."""
    wind_mps: NotNegative = 2.0
    wind_from_deg: float = 270.0
    """Compass direction that the wind comes from."""


@dataclass(frozen=True, slots=True)
class Sun:
    """Unit vector towards the sun (x east, y north, z up)."""

    east: float
    north: float
    up: float

    @property
    def elevation(self) -> float:
        """Radians above the horizon."""
        return math.asin(self.up)


def sun(weather: WeatherSpec) -> Sun:
    """Position by solar declination (Cooper 1969) and hour angle."""
    day = weather.date.timetuple().tm_yday
    dec = math.radians(23.45) * math.sin(2 * math.pi * (284 + day) / 365)
    hour_angle = math.radians(15 * (weather.hour - 12))
    lat = math.radians(weather.latitude_deg)
    return Sun(
        east=-math.cos(dec) * math.sin(hour_angle),
        north=math.cos(lat) * math.sin(dec) - math.sin(lat) * math.cos(dec) * math.cos(hour_angle),
        up=math.sin(lat) * math.sin(dec) + math.cos(lat) * math.cos(dec) * math.cos(hour_angle),
    )


def daylight(weather: WeatherSpec) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(direct, ambient) light as linear BGR on a horizontal-to-upright mean surface.

    Direct light falls and reddens with the air mass (Kasten and Young 1989); 1 is about noon.
    """
    elevation = max(sun(weather).elevation, math.radians(2.0))
    degrees = math.degrees(elevation)
    mass = 1 / (math.sin(elevation) + 0.50572 * (degrees + 6.07995) ** -1.6364)
    depth = np.array([0.30, 0.19, 0.13]) * (1 + 12 * weather.haze)
    direct = 1.35 * np.exp(-depth * mass) / np.exp(-depth[1])
    clear = 1 - 0.95 * weather.cloud
    ambient = np.array([0.30, 0.25, 0.22]) * (0.55 + 0.45 * math.sin(elevation))
    ambient = ambient * (1 + 1.2 * weather.cloud)
    return direct * clear, ambient


def light_table(weather: WeatherSpec) -> NDArray[np.float32]:
    """(256, 3) float32 BGR: the factor on a display-referred (gamma 2.2) colour of a surface that
    sees i/255 of the sun. Products of linear light stay products under a power law."""
    direct, ambient = daylight(weather)
    seen = np.linspace(0.0, 1.0, 256)[:, None]
    return np.asarray((ambient + seen * direct) ** _GAMMA, np.float32)


def panorama(
    weather: WeatherSpec, rng: np.random.Generator, columns: int = 4096, rows: int = 320
) -> NDArray[np.uint8]:
    """The far background on a cylinder, (rows, columns, 3) BGR: sky with clouds, a line of trees
    and houses. Rows are even in the tangent of the elevation, PANORAMA_TOP to PANORAMA_BOTTOM;
    column 0 looks west and azimuth grows counter-clockwise."""
    tangent = np.linspace(PANORAMA_TOP, PANORAMA_BOTTOM, rows, dtype=np.float32)[:, None]
    elevation = np.degrees(np.arctan(tangent))
    direct, _ = daylight(weather)
    low_sun = float(np.clip(1.2 - direct.mean(), 0, 1))
    horizon = np.array([214, 216, 208], np.float32) - np.array([40, 14, 0], np.float32) * low_sun
    zenith = np.array([205, 160, 118], np.float32)
    blend = np.clip(elevation / 35, 0, 1)[..., None] ** 0.7
    image = np.repeat((1 - blend) * horizon + blend * zenith, columns, axis=1)

    def octave(r: int, c: int) -> NDArray[np.float32]:
        grid = rng.random((r, c), dtype=np.float32)
        grid = np.hstack([grid, grid[:, :1]])
        return np.asarray(cv2.resize(grid, (columns, rows), interpolation=cv2.INTER_LINEAR))

    clouds = octave(9, 40) + 0.5 * octave(20, 130) + 0.25 * octave(50, 400)
    cover = np.clip((clouds - 1.12 + 0.8 * weather.cloud) * 2.0, 0, 0.85)[..., None]
    image = image * (1 - cover) + np.array([240, 240, 238], np.float32) * cover

    ridge = 0.8 + 1.8 * octave(1, 60)[:1] + 1.0 * octave(1, 300)[:1] + 0.35 * octave(1, 1400)[:1]
    leaves = octave(rows // 4, columns // 3) * 0.5 + octave(rows // 2, columns) * 0.4
    hazy = float(np.clip(60 * weather.haze, 0.12, 0.9))
    # Trees stand low: the rows above the ridge's highest point are sky already.
    low = slice(int(np.argmax(elevation[:, 0] < ridge.max())), rows)
    tree = np.array([60, 86, 72], np.float32) * (0.62 + 0.7 * leaves[low, :, None])
    tree = tree * (0.62 + 0.38 * np.clip(elevation[low] / (ridge + 0.01), 0, 1))[..., None]
    mask = (elevation[low] < ridge) & (tangent[low] > PANORAMA_BOTTOM)
    image[low] = np.where(mask[..., None], tree * (1 - hazy) + horizon * hazy, image[low])

    per_degree = rows / (PANORAMA_TOP - PANORAMA_BOTTOM) * np.pi / 180
    ground = int(PANORAMA_TOP / (PANORAMA_TOP - PANORAMA_BOTTOM) * rows)
    for _ in range(12):
        left = int(rng.integers(0, columns - 120))
        width = int(rng.integers(24, 90))
        high = int(rng.uniform(1.0, 2.2) * per_degree)
        wall = np.array([168, 188, 200]) * rng.uniform(0.6, 1.0) * (1 - hazy) + horizon * hazy
        roof = np.array([70, 88, 150]) * rng.uniform(0.6, 1.0) * (1 - hazy) + horizon * hazy
        image[ground - high : ground + 4, left : left + width] = wall
        image[ground - high - 3 : ground - high, left - 2 : left + width + 2] = roof
        for k in range(6, width - 8, 16):
            image[ground - high + 4 : ground - high + 9, left + k : left + k + 5] = wall * 0.5
    return np.asarray(np.clip(image, 0, 255), np.uint8)
