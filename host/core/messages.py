"""What flows through the pilot: frames, fixes and telemetry in, commands out. SI units throughout.

Every `stamp` and `now` is in seconds of one clock that the caller owns; nothing here reads a clock.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Frame:
    """One camera picture. `stamp` is the time of the shutter; `bgr` is (height, width, 3) uint8."""

    stamp: float
    bgr: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Fix:
    """One GNSS epoch (WGS 84). `quality` is GGA's: 0 none, 1 alone, 2 differential, 4/5 RTK."""

    stamp: float
    lat_deg: float
    lon_deg: float
    quality: int
    hdop: float
    satellites: int
    speed_mps: float | None = None
    course_rad: float | None = None
    """Counter-clockwise from east, as headings in the field frame are."""


@dataclass(frozen=True, slots=True)
class Turned:
    """What the phone's gyroscope has turned about the vertical, up to `stamp`."""

    stamp: float
    yaw_rad: float
    """Counter-clockwise, unwrapped, with all that the gyroscope errs, from `since` on."""
    since: float
    """Since when no sample is missing; what was turned before is not known."""
    nose_up_rad: float = math.nan
    """How far the phone's back camera looks above the horizon, as its accelerometer has shown since
    the last; NaN: it has shown nothing."""


class State(enum.IntEnum):
    """The firmware supervisor's state; the values are the wire's (firmware/protocol.toml)."""

    SAFE = 0
    ARMED = 1
    RUNNING = 2
    FAULT = 3


@dataclass(frozen=True, slots=True)
class Telemetry:
    """One telemetry message in SI units, as received at `stamp` on the host's clock."""

    stamp: float
    state: State
    faults: int
    """Bits of protocol.Fault."""
    setpoint_rad: float
    angle_rad: float
    steer_duty: int
    """-255..255, positive to the left."""
    drive_duty: int
    """-255..255, positive forward."""
    blade: bool
    speed_mps: float | None
    """Measured by the hall sensor; None where none is configured."""
    distance_m: float
    """Signed odometer since reset; 0 where no hall sensor is configured."""
    battery_v: float
    last_seq: int
    frames_bad: int
    firmware_s: float = 0.0
    """When it was sent, on the firmware's clock since its start."""
    refusal: str = ""
    """Why the firmware refused the last request; empty where it took it."""


class Request(enum.Enum):
    """What a command asks of the firmware's supervisor."""

    DRIVE = "drive"
    STOP = "stop"
    ARM = "arm"
    CLEAR = "clear"


@dataclass(frozen=True, slots=True)
class Command:
    """The pilot's output. The motion fields matter with DRIVE only."""

    request: Request
    steer_rad: float = 0.0
    """Positive to the left."""
    speed_mps: float = 0.0
    """Negative reverses."""
    blade: bool = False
    reason: str = ""
    """Why, in words for the operator and the record."""

    def because(self, reason: str) -> Command:
        """The same for that reason."""
        return Command(self.request, self.steer_rad, self.speed_mps, self.blade, reason)
