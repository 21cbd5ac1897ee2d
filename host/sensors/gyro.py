"""The phone's gyroscope, as IP Webcam's /sensors.json gives it, into what the machine has turned.

The answer holds the latest samples of each sensor, each with the phone's own time, so an answer
that is late loses nothing. The accelerometer shows which of the phone's axes is up: however the
phone is mounted, the rate about the vertical is what counts.
"""

from __future__ import annotations

import http.client
import math
import socket
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final
from urllib.parse import urlsplit

from pydantic_core import from_json

from host.core.errors import UserError
from host.core.messages import Turned
from host.sensors.camera_stream import fetch, refusal
from host.sensors.newest import Feed, SourceLostError

PATH: Final = "/sensors.json"
UNDERWAY_S: Final = 0.05
"""From a sample to the laptop at the least: half the app's own period and a wireless network."""
POLL_S: Final = 0.1
MOST_BYTES: Final = 4 * 1024 * 1024
"""Of one answer; an app that keeps a minute of every sensor sends a tenth."""
GAP_S: Final = 0.25
"""Between two samples; across a longer one nothing is known. A machine turns 5 degrees in it."""
LEVEL_S: Final = 5.0
"""Time constant of the vertical: longer than the machine shakes."""
GRAVITY_MPS2: Final = (7.0, 13.0)
"""What an accelerometer on earth shows, however it is shaken: else it is none."""
MOST_RADPS: Final = 3.5
"""200 degrees a second about any axis: no reaper turns so fast, and what it shakes is faster only
for a part of a sample."""
UNHURRIED: Final = 1e-4
"""Share of the time by which the phone's clock may run otherwise than the laptop's."""

FOR_EVER: Final = (400, 403, 405, 410, 501)
"""Answers, besides 404, of an app that has no sensors. It is not asked again: many an app serves
one client at a time, and that has to be the camera."""
NO_ANSWER: Final = "what comes is no list of sensors; give their address, or none"

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Samples:
    """One sensor's: the phone's time in s, and x, y, z in SI units."""

    clock_s: list[float]
    xyz: list[Vector]


class NoSensorError(ValueError):
    """The answer lacks a sensor that it must have."""


def parsed(answer: bytes) -> tuple[Samples, Samples]:
    """(gyroscope in rad/s, accelerometer in m/s²) of an answer. NoSensorError where one is missing,
    ValueError where it is not what the app sends."""
    try:
        message = from_json(answer)
    except ValueError as error:
        raise ValueError(NO_ANSWER) from error
    if not isinstance(message, dict):
        raise ValueError(NO_ANSWER)
    return _sensor(message, "gyro"), _sensor(message, "accel")


def _sensor(message: dict[str, object], name: str) -> Samples:
    sensor = message.get(name)
    if not isinstance(sensor, dict):
        raise NoSensorError(f"the app does not give {name!r}")
    unit, data = str(sensor.get("unit", "")), sensor.get("data")
    scale = math.pi / 180 if "deg" in unit or "°" in unit else 1.0
    if not isinstance(data, list):
        raise ValueError(f"{name} has no data")
    clock: list[float] = []
    xyz: list[Vector] = []
    for row in data:
        try:
            milliseconds, (x, y, z) = row
            x, y, z = float(x) * scale, float(y) * scale, float(z) * scale
            at = float(milliseconds) / 1e3
        except (TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"{name} has a sample that is none") from error
        # A sum that overflows is refused, too: nothing turns so fast.
        if not math.isfinite(at + x + y + z):
            raise ValueError(f"{name} has a sample that is no number")
        clock.append(at)
        xyz.append((x, y, z))
    return Samples(clock, xyz)


class Turning:
    """Answers in, what was turned out. No I/O."""

    def __init__(self) -> None:
        self._clock: float | None = None
        """Of the last sample, by the phone."""
        self._levelled: float | None = None
        self._rate = 0.0
        self._up: Vector | None = None
        self._forces: Vector = (0.0, 0.0, 0.0)
        """The sum of what the accelerometer has shown since the last word."""
        self._behind = math.inf
        """Least that the laptop's time was ahead of the phone's at an answer."""
        self._heard = -math.inf
        self._yaw = 0.0
        self._since = 0.0

    def feed(self, now: float, answer: bytes) -> Turned | None:
        """An answer that came at `now`; None where it holds nothing new. ValueError as `parsed`."""
        gyro, accel = parsed(answer)
        if self._clock is not None and max(gyro.clock_s, default=math.inf) < self._clock - GAP_S:
            self._restart()  # somebody, or a time server, has set the phone's clock back
        self._level(accel)
        up = self._up
        fresh = [k for k, t in enumerate(gyro.clock_s) if self._clock is None or t > self._clock]
        if up is None or not fresh:
            return None
        fresh.sort(key=gyro.clock_s.__getitem__)
        newest = gyro.clock_s[fresh[-1]]
        drifted = UNHURRIED * max(0.0, now - self._heard) if math.isfinite(self._heard) else 0.0
        self._behind = min(self._behind + drifted, now - newest)
        self._heard = now
        for k in fresh:
            self._take(gyro.clock_s[k], gyro.xyz[k], up)
        stamp = newest + self._behind - UNDERWAY_S
        return Turned(stamp, self._yaw, self._since, self._nose_up())

    def _nose_up(self) -> float:
        """Android's z axis points out of the screen, against the way that the back camera looks."""
        x, y, z = self._forces
        self._forces = (0.0, 0.0, 0.0)
        size = math.sqrt(x * x + y * y + z * z)
        return -math.asin(z / size) if size > 0.0 else math.nan

    def _restart(self) -> None:
        self._clock = self._levelled = None
        self._behind, self._heard = math.inf, -math.inf

    def _take(self, clock: float, xyz: Vector, up: Vector) -> None:
        (x, y, z), (ux, uy, uz) = xyz, up
        rate = x * ux + y * uy + z * uz
        broken = max(abs(x), abs(y), abs(z)) > MOST_RADPS
        if self._clock is None or clock - self._clock > GAP_S or broken:
            self._yaw, self._since = 0.0, clock + self._behind
        else:
            self._yaw += (clock - self._clock) * (rate + self._rate) / 2
        self._clock, self._rate = clock, 0.0 if broken else rate

    def _level(self, accel: Samples) -> None:
        low, high = GRAVITY_MPS2
        for clock, (fx, fy, fz) in sorted(zip(accel.clock_s, accel.xyz, strict=True)):
            if self._levelled is not None and clock <= self._levelled:
                continue
            size = math.sqrt(fx * fx + fy * fy + fz * fz)
            if not low < size < high:
                continue
            if self._up is None or self._levelled is None:
                blend = 1.0
            else:
                blend = 1.0 - math.exp(-(clock - self._levelled) / LEVEL_S)
            self._levelled = clock
            sx, sy, sz = self._forces
            self._forces = (sx + fx, sy + fy, sz + fz)
            x, y, z = fx / size, fy / size, fz / size
            ux, uy, uz = self._up or (x, y, z)
            ux, uy, uz = ux + blend * (x - ux), uy + blend * (y - uy), uz + blend * (z - uz)
            length = math.sqrt(ux * ux + uy * uy + uz * uz)
            self._up = (ux / length, uy / length, uz / length) if length > 0.1 else None


def beside(camera: str) -> str | None:
    """Where the app that serves this camera's pictures serves its sensors; None where it cannot."""
    parts = urlsplit(camera)
    if parts.scheme not in ("http", "https") or not parts.netloc:
        return None
    return f"{parts.scheme}://{parts.netloc}{PATH}"


def _from_app(url: str, feed: Feed[Turned]) -> Iterator[Turned]:
    parts = urlsplit(url)
    kind = http.client.HTTPSConnection if parts.scheme == "https" else http.client.HTTPConnection
    connection = kind(parts.hostname or "", parts.port, timeout=feed.silence_s)
    path = (parts.path or PATH) + (f"?{parts.query}" if parts.query else "")
    turning = Turning()
    heard = feed.clock()
    try:
        while not feed.stopping:
            response = fetch(connection, path, parts)
            answer = response.read(MOST_BYTES)
            if response.status == http.HTTPStatus.NOT_FOUND:
                raise SourceLostError("the app gives no sensors: no /sensors.json", final=True)
            if response.status != http.HTTPStatus.OK:
                raise refusal(response, final=response.status in FOR_EVER)
            if response.headers.get_content_type() == "text/html":
                raise SourceLostError(NO_ANSWER, final=True)
            now = feed.clock()
            turned = turning.feed(now, answer)
            if turned is not None:
                heard = now
                yield turned
            elif now - heard > feed.silence_s:
                raise SourceLostError(
                    "no new samples: switch on the gyroscope and the accelerometer in the app"
                )
            feed.pause(POLL_S)
    except TimeoutError as error:
        raise SourceLostError(f"silent for {feed.silence_s:.0f} s") from error
    except socket.gaierror as error:
        raise SourceLostError(f"no such host: {parts.hostname}") from error
    except NoSensorError as error:
        raise SourceLostError(f"{error}: switch it on in the app's sensor settings") from error
    except (OSError, http.client.HTTPException, ValueError) as error:
        raise SourceLostError(str(error) or type(error).__name__) from error
    finally:
        connection.close()


def gyro_feed(url: str, clock: Callable[[], float], report: Callable[[str], None]) -> Feed[Turned]:
    """`url`: http(s)://HOST:PORT/sensors.json. The feed runs when it is started. Raises UserError
    on what cannot mean that."""
    parts = urlsplit(url)
    try:
        usable = parts.scheme in ("http", "https") and bool(parts.hostname)
        usable = usable and (parts.port is None or parts.port > 0)
    except ValueError:
        usable = False
    if not usable:
        raise UserError(
            f"gyroscope address {url}: give http://HOST:PORT{PATH}, or none to drive without one"
        )
    return Feed("gyroscope", partial(_from_app, url), clock, report)


def gyro_of(
    given: str | None, camera: str, clock: Callable[[], float], report: Callable[[str], None]
) -> Feed[Turned] | None:
    """The feed that an operator means: `given` an address, "none", or None for what the camera's
    app gives; None where there is none. UserError as `gyro_feed`."""
    url = beside(camera) if given is None else None if given == "none" else given
    return None if url is None else gyro_feed(url, clock, report)
