"""A drive in curves that tells how late a camera's pictures come: the machine weaves, and what its
pictures show of the turning is compared with what its wheels and its steering say."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np

from host.core.errors import FaultError, UserError
from host.core.vehicle import Vehicle
from host.estimate.odometry import Odometry
from host.sensors.camera_stream import Picture
from host.sensors.jpeg import JpegDecoder
from host.sensors.picture_watch import PictureWatch
from host.tune.camera_delay import Delay, Grey, delay_of, far_part, shift_px
from host.tune.free_ground import Driver, driver
from host.tune.wire import Wire

WEAVE_MPS: Final = 0.3
"""A pace (m/s) to walk beside."""
WEAVE_RAD: Final = math.radians(25.0)
"""The wheel's angle to either side: half of what it can; 8 degrees of turning a second."""
PERIOD_S: Final = 5.0
"""To the left and back, s: a machine of 1 m wheelbase turns to and fro by 20 degrees in it."""
PERIODS: Final = 3
"""Whole ones, from their middle on: the machine ends straight ahead of where it began."""
WEAVE_S: Final = PERIODS * PERIOD_S
WEAVE_M: Final = WEAVE_MPS * WEAVE_S
"""What it takes: seconds, and metres ahead."""
LOOK_S: Final = 0.05
"""Between looks at the camera, s: the pilot's period."""
LOST_S: Final = 1.5
"""Without a picture that can be used, s, until the drive ends: 0.5 m. Phones stall for half a
second now and then."""
FIRST_S: Final = 3.0
"""For the first one that can be used, s: forty come in it."""
DAMAGED: Final = "its files are damaged"
"""A camera's, of whose pictures none is whole."""


class Camera(Protocol):
    """Where pictures come from: a `Feed` of them, or the bench's."""

    @property
    def problem(self) -> str | None:
        """Why nothing comes at present."""
        ...

    def take(self) -> Picture | None:
        """The newest picture, once."""
        ...


@dataclass
class Seen:
    """What a camera has shown that can be used."""

    camera: Camera
    since: float
    """When the last picture came that can be used; before the first: since when it is awaited."""
    arrived_s: list[float] = field(default_factory=list)
    parts: list[Grey] = field(default_factory=list)
    _wrong: str = ""
    _decoder: JpegDecoder = field(default_factory=JpegDecoder)
    _watch: PictureWatch | None = None

    def look(self) -> None:
        """Takes the newest picture, if there is one that came since the last."""
        picture = self.camera.take()
        if picture is None or picture.stamp < self.since:
            return
        bgr = picture.frame(self._decoder).bgr
        if self._watch is None and bgr.size:
            self._watch = PictureWatch(bgr.shape[1], bgr.shape[0])
        self._wrong = self._watch.problem(bgr) if self._watch is not None else DAMAGED
        if not self._wrong:
            self.since = picture.stamp
            self.arrived_s.append(picture.stamp)
            self.parts.append(far_part(bgr))

    def why_none(self) -> str:
        """Why there is none that can be used, in words."""
        return self.camera.problem or self._wrong or "no picture comes"


def measured_delay(
    wire: Wire,
    name: str,
    vehicle: Vehicle,
    camera: Camera,
    tell: Callable[[float], None] = lambda _: None,
) -> Delay:
    """Weaves some metres ahead on free ground, and finds the camera's delay. `tell`: the share of
    the drive that is done. UserError where the camera shows nothing, the machine does not drive or
    the two do not agree, FaultError where the camera is lost on the way. Whatever happens, the
    machine is stopped."""
    seen = Seen(camera, wire.now)
    while not seen.parts:
        if wire.now - seen.since > FIRST_S:
            raise UserError(f"no picture to measure by: {seen.why_none()}; nothing has moved")
        wire.poll()
        seen.look()
    with driver(wire, name) as machine:
        _weave(wire, machine, seen, tell)
        machine.stop()
    odometry = Odometry(vehicle)
    motion = [odometry.update(telemetry) for telemetry in machine.trace]
    stamps = np.array([each.stamp for each in motion])
    yaws = np.array([each.yaw_rad for each in motion])
    shifts = [shift_px(before, after) for before, after in itertools.pairwise(seen.parts)]
    return delay_of(seen.arrived_s, shifts, stamps, yaws)


def _weave(wire: Wire, machine: Driver, seen: Seen, tell: Callable[[float], None]) -> None:
    begun = wire.now
    while (gone_s := wire.now - begun) < WEAVE_S - 1e-9:
        side = math.cos(math.tau * gone_s / PERIOD_S)
        machine.drive(WEAVE_MPS, math.copysign(WEAVE_RAD, side), LOOK_S)
        seen.look()
        if wire.now - seen.since > LOST_S:
            raise FaultError(f"the camera is lost on the way: {seen.why_none()}")
        tell(min(1.0, gone_s / WEAVE_S))
