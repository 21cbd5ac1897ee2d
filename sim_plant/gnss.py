"""The phone's position receiver: truth plus a correlated error, spoken as NMEA once a second.

The error is a slow first-order Gauss-Markov walk (multipath, atmosphere) with a small white part,
steps when the satellites in use change, and outages. Sentences and their fields follow the stream
of a real phone: GSV, GSA, VTG, RMC, GGA per epoch, positions to 1e-6 minutes.
"""

from __future__ import annotations

import datetime
import math
from typing import Annotated

import numpy as np
from pydantic import Field as Limits

from sim_plant.strict import NotNegative, Positive, Share, Strict

_CEP_PER_SIGMA = math.sqrt(2 * math.log(2))
"""Median of the distance of a circular normal error with unit standard deviation per axis."""


class GnssSpec(Strict):
    """How good the positions are and where the field lies."""

    cep_m: NotNegative = 2.5
    """Half the fixes are nearer to the truth than this, over times far above `correlation_s`."""
    correlation_s: Positive = 180.0
    white_m: NotNegative = 0.05
    """Standard deviation per axis of the part that is new in every fix."""
    jumps_per_hour: NotNegative = 2.0
    jump_m: NotNegative = 4.0
    """Median length of a jump; the error then creeps back at the correlation time."""
    outages_per_hour: NotNegative = 1.0
    outage_s: Positive = 8.0
    """Mean length of an outage."""
    canopy_loss: Share = 0.0
    """Share of epochs without a fix under trees."""
    speed_noise_mps: NotNegative = 0.05
    antenna_x_m: float = 0.0
    """The antenna ahead of the rear axle,"""
    antenna_y_m: float = 0.0
    """and left of its middle."""
    smoothing_s: NotNegative = 0.0
    """Time constant of the receiver's own filter on speed and course."""
    lag_s: NotNegative = 0.0
    """The position said is that of so long ago."""
    first_fix_s: NotNegative = 0.0
    """Until then the receiver speaks without a fix."""
    lat_deg: Annotated[float, Limits(ge=-85, le=85)] = 31.5
    """WGS 84 position of the field frame's origin."""
    lon_deg: Annotated[float, Limits(ge=-180, le=180)] = 74.3
    altitude_m: float = 217.0
    start: datetime.datetime = datetime.datetime(2026, 4, 28, 5, 30)
    """UTC at simulated time 0."""


def sentence(body: str) -> str:
    """An NMEA sentence: `$body*checksum`."""
    total = 0
    for byte in body.encode("ascii"):
        total ^= byte
    return f"${body}*{total:02X}"


def _degrees_minutes(value: float, width: int) -> str:
    """ddmm.mmmmmm or dddmm.mmmmmm of an absolute value in degrees."""
    millionths = round(abs(value) * 60e6)
    degrees, rest = divmod(millionths, 60_000_000)
    return f"{degrees:0{width}d}{rest // 1_000_000:02d}.{rest % 1_000_000:06d}"


class Gnss:
    """One receiver. Epochs must be asked in order of time; deterministic by (spec, seed)."""

    def __init__(self, spec: GnssSpec | None = None, seed: int = 0) -> None:
        self.spec = spec or GnssSpec()
        self._rng = np.random.default_rng([seed, 0x6E73])
        self._sigma = self.spec.cep_m / _CEP_PER_SIGMA
        self._error = self._rng.normal(0.0, self._sigma, 2)
        self._last: float | None = None
        self._smooth: tuple[float, float] | None = None
        self._out_until = -math.inf
        # WGS 84 radii of curvature at the origin; the field is small enough for a tangent plane.
        lat = math.radians(self.spec.lat_deg)
        e2 = 6.69437999014e-3
        w = math.sqrt(1 - e2 * math.sin(lat) ** 2)
        self._north_m = math.radians(1) * 6378137.0 * (1 - e2) / w**3
        self._east_m = math.radians(1) * 6378137.0 / w * math.cos(lat)
        count = 9
        prn = self._rng.permutation(np.arange(1, 33))[:count]
        self._satellites = [
            (int(p), int(self._rng.integers(12, 80)), int(self._rng.integers(0, 360))) for p in prn
        ]

    def to_wgs84(self, x: float, y: float) -> tuple[float, float]:
        """Latitude and longitude (degrees) of a point of the field frame (m)."""
        return self.spec.lat_deg + y / self._north_m, self.spec.lon_deg + x / self._east_m

    def _advance(self, t: float) -> None:
        s = self.spec
        dt = 1.0 if self._last is None else max(0.0, t - self._last)
        self._last = t
        keep = math.exp(-dt / s.correlation_s)
        spread = self._sigma * math.sqrt(1 - keep**2)
        self._error = keep * self._error + self._rng.normal(0.0, 1.0, 2) * spread
        draw = self._rng.random(2)
        way, far = self._rng.uniform(0, 2 * math.pi), self._rng.lognormal(0, 0.5)
        if draw[0] < s.jumps_per_hour * dt / 3600:
            self._error = self._error + s.jump_m * far * np.array([math.cos(way), math.sin(way)])
        length = self._rng.exponential(s.outage_s)
        if draw[1] < s.outages_per_hour * dt / 3600:
            self._out_until = t + length

    def epoch(
        self, t: float, x: float, y: float, vx: float, vy: float, *, under_trees: bool = False
    ) -> list[str]:
        """The sentences of the epoch at time `t` (s) for the true antenna position (m) and velocity
        (m/s) in the field frame, without line ends."""
        s = self.spec
        vx, vy = self._filtered(t, vx, vy)
        x, y = x - vx * s.lag_s, y - vy * s.lag_s
        self._advance(t)
        white = self._rng.normal(0.0, 1.0, 2) * s.white_m
        v_noise = self._rng.normal(0.0, 1.0, 2) * s.speed_noise_mps
        blocked = self._rng.random() < s.canopy_loss and under_trees
        strength = self._rng.integers(-3, 4, len(self._satellites))
        fixed = t >= s.first_fix_s and t >= self._out_until and not blocked
        when = s.start + datetime.timedelta(seconds=t)
        if not fixed:
            return [
                *self._in_view(strength - 14),
                sentence("GPGSA,A,1,,,,,,,,,,,,,,,"),
                sentence("GPVTG,,T,,M,,N,,K,N"),
                sentence("GPRMC,,V,,,,,,,,,,N"),
                sentence("GPGGA,,,,,,0,,,,,,,,"),
            ]
        lat, lon = self.to_wgs84(x + self._error[0] + white[0], y + self._error[1] + white[1])
        ve, vn = vx + v_noise[0], vy + v_noise[1]
        speed = math.hypot(ve, vn)
        course = math.degrees(math.atan2(ve, vn)) % 360
        knots = speed / 0.514444
        hdop = 0.7 + 0.1 * float(round(abs(self._error[0]) % 3))
        used = len(self._satellites)
        place = (
            f"{_degrees_minutes(lat, 2)},{'N' if lat >= 0 else 'S'},"
            f"{_degrees_minutes(lon, 3)},{'E' if lon >= 0 else 'W'}"
        )
        clock = f"{when:%H%M%S}"
        ids = ",".join(f"{p:02d}" for p, _, _ in self._satellites) + "," * (12 - used)
        return [
            *self._in_view(strength),
            sentence(f"GPGSA,A,3,{ids},1.3,{hdop:.1f},1.0"),
            sentence(f"GPVTG,{course:.1f},T,{course:.1f},M,{knots:.1f},N,{speed * 3.6:.1f},K,A"),
            sentence(f"GPRMC,{clock},A,{place},{knots:.1f},{course:.1f},{when:%d%m%y},,,A"),
            sentence(
                f"GPGGA,{clock},{place},1,{used:02d},{hdop:.1f},{s.altitude_m:.1f},M,-36.0,M,,"
            ),
        ]

    def _filtered(self, t: float, vx: float, vy: float) -> tuple[float, float]:
        """The velocity as the receiver's filter has it; before `_advance`."""
        if self._smooth is None or self._last is None or self.spec.smoothing_s == 0.0:
            self._smooth = (vx, vy)
        else:
            new = 1 - math.exp(-max(0.0, t - self._last) / self.spec.smoothing_s)
            old_x, old_y = self._smooth
            self._smooth = (old_x + new * (vx - old_x), old_y + new * (vy - old_y))
        return self._smooth

    def _in_view(self, strength: np.ndarray[tuple[int], np.dtype[np.int64]]) -> list[str]:
        total = math.ceil(len(self._satellites) / 4)
        lines = []
        for k in range(total):
            part = ",".join(
                f"{p:02d},{el:02d},{az:03d},{max(0, 24 + el // 5 + int(d)):02d}"
                for (p, el, az), d in list(zip(self._satellites, strength, strict=True))[
                    4 * k : 4 * k + 4
                ]
            )
            lines.append(sentence(f"GPGSV,{total},{k + 1},{len(self._satellites):02d},{part}"))
        return lines
