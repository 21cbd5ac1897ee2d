"""The drive measured on free ground: two speeds, there and back, and a tape along the first way.

With a wheel sensor one tape tells its scale, and it counts the rest. Without one every way is
taped, and timed by the commands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from host.core.errors import UserError
from host.core.messages import Telemetry
from host.core.vehicle import Vehicle
from host.tune.drive_curve import (
    DriveCurve,
    Leg,
    Start,
    drive_curve,
    drive_lag_s,
    duty_share,
)
from host.tune.free_ground import Driver, driver
from host.tune.pot_calibration import straightened
from host.tune.taped_drive import TAPE_SIGMA_M, TapedDrive, taped_drive
from host.tune.wire import Wire

SLOW: Final = 0.4
"""Of the fast legs' speed, which is the cutting speed: about as slow as the pilot drives."""
SLOW_UNCOUNTED: Final = 0.65
"""The same where no sensor counts: whose dead duty is not known yet goes much slower than asked."""
SETTLES_S: Final = 2.5
"""From the command until speed and duty are steady: ramp and lag of a heavy machine."""
STEADY_S: Final = 3.0
"""And so long it must then last, at least."""
START_S: Final = 4.0
"""In which the lag shows, and the slope under the first metre."""
SHORTEST_M: Final = 0.5
"""Of a taped way: the tape's 2 cm are 4 % of it. Where no sensor counts and the dead duty is not
known yet, the machine comes less far than it is asked to."""
TOO_LONG: Final = 3.0
"""Times what a way should take: then something slips, jams or does not count."""
COUNTED_M: Final = 0.02
"""What a count of pulses may miss between two moments: a pulse at 50 a metre."""
TIMED_S: Final = 0.15
"""What ramps, lag and coasting leave between a command's time and the drive's."""


@dataclass(frozen=True, slots=True)
class Way:
    """One of the ways to be driven."""

    number: int
    speed_mps: float
    """Negative: back."""
    length_m: float

    def __str__(self) -> str:
        back = "back" if self.speed_mps < 0 else "ahead"
        return f"{self.length_m:g} m {back} at {abs(self.speed_mps):.2g} m/s"


@dataclass(frozen=True, slots=True)
class Taped:
    """What a tape says of a way: along the line on which the machine set off, without sign, and to
    the left of it."""

    along_m: float
    aside_m: float = 0.0


Tape = Callable[[Way], Taped]
"""Asked when the machine stands."""
Ready = Callable[[Way], None]
"""Told before the machine sets off on a way; UserError where it must not."""


@dataclass(frozen=True, slots=True)
class _Driven:
    way: Way
    seen: list[Telemetry]
    commanded_s: float
    taped: Taped | None

    def between(self, begin_s: float, end_s: float) -> list[Telemetry]:
        """Since it was commanded."""
        start = self.seen[0].firmware_s
        return [t for t in self.seen if begin_s <= t.firmware_s - start <= end_s]

    @property
    def steady(self) -> list[Telemetry]:
        """Without start and stop."""
        return self.between(SETTLES_S, self.commanded_s)

    def leg(self, nominal_v: float, scale: float) -> Leg:
        """`scale`: true metres in one that the sensor counts; 0 where none counts."""
        steady = self.steady
        duty = sum(abs(duty_share(t, nominal_v)) for t in steady) / len(steady)
        if scale == 0.0:
            assert self.taped is not None
            speed = self.taped.along_m / self.commanded_s
            off = math.hypot(TIMED_S / self.commanded_s, TAPE_SIGMA_M / self.taped.along_m)
            return Leg(duty, speed, speed * off)
        lasted = steady[-1].firmware_s - steady[0].firmware_s
        counted = abs(steady[-1].distance_m - steady[0].distance_m)
        return Leg(duty, scale * counted / lasted, COUNTED_M / lasted)

    def start(self, nominal_v: float, scale: float) -> Start:
        """Until it is steady."""
        seen = self.between(0.0, START_S)
        return Start(
            np.array([t.firmware_s for t in seen]),
            np.array([abs(duty_share(t, nominal_v)) for t in seen]),
            scale * np.array([abs(t.distance_m - seen[0].distance_m) for t in seen]),
        )


@dataclass(frozen=True, slots=True)
class MeasuredDrive:
    """What was found."""

    curve: DriveCurve
    taped: TapedDrive

    def params(self, before: Mapping[str, float]) -> dict[str, float]:
        """The firmware's parameters of it. `before`: those that it has."""
        values = self.curve.params() | straightened(before, self.taped.steer_off_deg)
        if self.taped.pulses_per_m is not None:
            values["hall_per_metre"] = round(self.taped.pulses_per_m, 1)
        return values

    def told(self, vehicle: Vehicle) -> Vehicle:
        """The vehicle file with it."""
        pulses = self.taped.pulses_per_m
        known = vehicle.model_copy(update={"hall_pulses_per_m": round(pulses or 0.0, 1)})
        return self.curve.told(known)


def ways(fast_mps: float, length_m: float, *, counted: bool) -> tuple[Way, ...]:
    """Slow ahead and back, fast ahead and back: it ends where it began. Slow first: nobody knows
    the drive yet."""
    slow_mps = (SLOW if counted else SLOW_UNCOUNTED) * fast_mps
    speeds = slow_mps, -slow_mps, fast_mps, -fast_mps
    return tuple(Way(k, speed, length_m) for k, speed in enumerate(speeds))


def measure_drive(
    wire: Wire,
    name: str,
    vehicle: Vehicle,
    params: Mapping[str, float],
    length_m: float,
    tape: Tape,
    ready: Ready = lambda _: None,
) -> MeasuredDrive:
    """Drives the ways and fits. Armed for each way alone: whoever tapes stands beside it. `params`:
    the firmware's parameters. UserError where a way does not tell, FaultError where the firmware
    stops the machine."""
    pulses = params["hall_per_metre"]
    driven: list[_Driven] = []
    fast_mps = min(vehicle.cutting_speed_mps, params["speed_max"])
    for way in ways(fast_mps, length_m, counted=pulses > 0):
        ready(way)
        with driver(wire, name) as armed:
            armed.steer(0.0)
            seen, commanded_s = _drive(armed, way, counted=pulses > 0)
        taped = tape(way) if pulses <= 0 or not driven else None
        if taped is not None and taped.along_m < SHORTEST_M:
            raise UserError(
                f"{way}: it came {taped.along_m:g} m; at least {SHORTEST_M:g} m are needed"
            )
        driven.append(_Driven(way, seen, commanded_s, taped))
    first = driven[0]
    assert first.taped is not None
    counted_m = abs(first.seen[-1].distance_m - first.seen[0].distance_m)
    found = taped_drive(
        counted_m if pulses > 0 else None,
        pulses,
        first.taped.along_m,
        first.taped.aside_m,
        vehicle.wheelbase_m,
        vehicle.hall_left_m,
    )
    # Of the machine's middle: the way was bent, and a wheel beside it came less far or farther.
    bend_1pm = math.tan(math.radians(found.steer_off_deg)) / vehicle.wheelbase_m
    of_the_middle = 1.0 - vehicle.hall_left_m * bend_1pm
    scale = pulses / found.pulses_per_m / of_the_middle if found.pulses_per_m else 0.0
    nominal_v = vehicle.nominal_battery_v
    legs = [each.leg(nominal_v, scale) for each in driven]
    curve = drive_curve(slow=legs[:2], fast=legs[2:])
    if scale:
        starts = [each.start(nominal_v, scale) for each in driven]
        curve = curve.with_lag(drive_lag_s(starts, curve))
    return MeasuredDrive(curve, found)


def _drive(armed: Driver, way: Way, *, counted: bool) -> tuple[list[Telemetry], float]:
    """The way's telemetry, until the machine stands again, and how long it was commanded."""
    begin = armed.last
    usual_s = way.length_m / abs(way.speed_mps)

    def there(told: Telemetry) -> bool:
        return counted and abs(told.distance_m - begin.distance_m) >= way.length_m

    seen = armed.drive(way.speed_mps, 0.0, TOO_LONG * usual_s if counted else usual_s, there)
    if counted and not there(seen[-1]):
        came_m = abs(seen[-1].distance_m - begin.distance_m)
        raise UserError(
            f"{way}: the wheels' sensor has counted {came_m:.2f} m in {TOO_LONG * usual_s:.0f} s. "
            "See that the wheels turn, that nothing is in their way, and check the sensor"
        )
    if seen[-1].firmware_s - seen[0].firmware_s < SETTLES_S + STEADY_S:
        raise UserError(f"{way}: too short to become steady; drive a longer way")
    commanded_s = seen[-1].firmware_s - seen[0].firmware_s
    rest = armed.stop()
    return [*seen, *rest], commanded_s
