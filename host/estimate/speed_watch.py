"""Whether the wheels' sensor counts what the machine drives: against the drive duty, which tells a
gross error within seconds, against the receiver's speed, which tells a small one on a side, and
against both together, which tell of pulses too many wherever the machine is."""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

from host.core.messages import Fix, Telemetry
from host.core.vehicle import Vehicle
from host.estimate.mean import mean_and_error

STEADY_S: Final = 1.0
"""With the drive on, until the speed is no longer the start's."""
GROSS: Final = (0.28, 2.2)
"""The sensor's speed over the duty's: less or more is no slope, crop or battery, ..."""
LOAD_SHARE: Final = 0.37
"""... unless what is missing is less than this share of the speed at full duty: a load takes the
same speed off any duty, and at a creep that may be all of it. A slope of 5 degrees takes 0.23 of
it, one of 7 degrees and crop before the blade all of this."""
GROSS_S: Final = 1.2
MOVING_MPS: Final = 0.2
STRAIGHT_RAD: Final = math.radians(10)
RECEIVER_S: Final = 5.0
"""At one speed, until the receiver's own filter shows it too."""
SAME_MPS: Final = 0.05
FALLS_S, FALLS_SHARE = 3.0, 0.25
"""While the speed was not this share higher so long ago, a receiver that smooths shows no more than
the machine drives: a sensor that says less then loses pulses. So a machine that stops and goes, and
a sensor with few pulses a second, show it too."""
UNDERWAY_SHARE: Final = 0.7
"""Of the cutting speed, that the drive duty must give for that: at a creep the receiver's error is
a large share. Whatever the receiver itself says must not decide it: of a machine that is a little
slower only those fixes would count that show too much."""
MOST_FIXES: Final = 30
OFF: Final = ((10, 0.15), (4, 0.35))
"""Share by which sensor and receiver may differ on the mean of so many fixes: what commissioning
leaves, wheel slip, and a receiver that smooths."""
SIGNIFICANT: Final = 4.0
"""Standard errors of the mean."""
LEAST_MPS: Final = 0.1
"""That a receiver is taken to have shown: one that hangs at 0 shows no ratio."""
SHOWN_TIMES: Final = 1.3
"""The receiver's way, at most, that a sensor may count: what both err, and tyres that slip."""
TOO_MANY_M: Final = 1.5
"""Counted that neither receiver nor drive explains: more than a receiver shows late."""
SINCE_S: Final = 2.0
"""A fix speaks of the time since the one before, but of no more than this."""


class _Ways(NamedTuple):
    """Between two fixes, or over many, m."""

    counted: float = 0.0
    shown: float = 0.0
    """By the receiver's speed;"""
    driven: float = 0.0
    """and what the drive duty gives on level ground."""

    @property
    def too_many(self) -> float:
        """What neither explains; negative: they explain more."""
        return self.counted - max(SHOWN_TIMES * self.shown, self.driven)

    def plus(self, more: _Ways) -> _Ways:
        """Both together."""
        counted, shown, driven = more
        return _Ways(self.counted + counted, self.shown + shown, self.driven + driven)


class SpeedWatch:
    """Fed with all telemetry and all fixes; without a sensor it says nothing."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._stamp = -math.inf
        self._driven_s = 0.0
        self._same_s = 0.0
        self._same_mps = 0.0
        self._gross_s = 0.0
        self._ratio = 1.0
        self._speeds: deque[tuple[float, float]] = deque(maxlen=MOST_FIXES)
        """By sensor and receiver, at one speed;"""
        self._least: deque[tuple[float, float]] = deque(maxlen=MOST_FIXES)
        """and at any that does not fall: the sensor's are too large, if anything."""
        self._past: deque[tuple[float, float]] = deque()
        """(stamp, speed that the sensor showed) of late."""
        self._ways = _Ways()
        """Since the last fix;"""
        self._unexplained = _Ways()
        """and since the sensor last counted what is explained."""
        self._fix_stamp = -math.inf
        self._by_receiver = ""
        """What they show to be wrong."""

    def take_telemetry(self, telemetry: Telemetry) -> None:
        """Compares sensor and duty."""
        dt = telemetry.stamp - self._stamp
        self._stamp = telemetry.stamp
        if not 0 < dt < 1.0 or telemetry.speed_mps is None:
            return
        self._past.append((telemetry.stamp, telemetry.speed_mps))
        while self._past[0][0] < telemetry.stamp - FALLS_S:
            self._past.popleft()
        duty = self._vehicle.duty_speed(telemetry.drive_duty, telemetry.battery_v)
        self._ways = self._ways.plus(_Ways(abs(telemetry.speed_mps) * dt, 0.0, abs(duty) * dt))
        self._driven_s = self._driven_s + dt if abs(duty) > MOVING_MPS else 0.0
        same = abs(telemetry.speed_mps - self._same_mps) < SAME_MPS
        self._same_s = self._same_s + dt if same else 0.0
        if not same:
            self._same_mps = telemetry.speed_mps
        if self._driven_s < STEADY_S:
            self._gross_s = 0.0
            return
        self._ratio = abs(telemetry.speed_mps / duty)
        low, high = GROSS
        missing = abs(duty) - abs(telemetry.speed_mps)
        loaded = missing < LOAD_SHARE * self._vehicle.full_duty_speed_mps
        gross = self._ratio > high or (self._ratio < low and not loaded)
        self._gross_s = self._gross_s + dt if gross else 0.0

    def take_fix(self, fix: Fix, telemetry: Telemetry) -> None:
        """Compares ways wherever the machine drives, and speeds while it drives straight."""
        counted = telemetry.speed_mps
        ways, self._ways = self._ways, _Ways()
        since_s, self._fix_stamp = fix.stamp - self._fix_stamp, fix.stamp
        if counted is None or fix.speed_mps is None or fix.quality == 0:
            return
        if 0.0 < since_s < SINCE_S:
            self._count(ways._replace(shown=fix.speed_mps * since_s), since_s)
        if abs(telemetry.angle_rad) >= STRAIGHT_RAD:
            return
        both = counted, fix.speed_mps
        if self._same_s > RECEIVER_S and counted > MOVING_MPS:
            self._speeds.append(both)
        highest = max((speed for _, speed in self._past), default=math.inf)
        duty = abs(self._vehicle.duty_speed(telemetry.drive_duty, telemetry.battery_v))
        underway = duty > UNDERWAY_SHARE * self._vehicle.cutting_speed_mps
        if underway and counted > max(0.0, (1.0 - FALLS_SHARE) * highest):
            self._least.append(both)
        self._by_receiver = _compared(self._speeds) or _compared(self._least, less=True)

    def _count(self, ways: _Ways, since_s: float) -> None:
        """Of a creep a phone may show nothing."""
        if ways.counted < MOVING_MPS * since_s:
            ways = ways._replace(counted=0.0)
        unexplained = self._unexplained.plus(ways)
        self._unexplained = unexplained if unexplained.too_many > 0.0 else _Ways()

    @property
    def wrong(self) -> str:
        """What is wrong with the sensor, in words; empty where nothing is known to be."""
        if self._gross_s > GROSS_S:
            return (
                f"the wheels' sensor says {self._ratio:.2f} of the speed that the drive duty gives"
            )
        if self._unexplained.too_many > TOO_MANY_M:
            counted, shown, driven = self._unexplained
            return (
                f"the wheels' sensor has counted {counted:.1f} m, the receiver shows {shown:.1f} m "
                f"and the drive duty gives {driven:.1f} m"
            )
        return self._by_receiver


def _compared(speeds: deque[tuple[float, float]], *, less: bool = False) -> str:
    """What these show to be wrong, in words; `less`: only that the sensor says less. The ratio of
    their means: the mean of ratios is too large where the receiver errs."""
    off = next((share for count, share in OFF if len(speeds) >= count), math.inf)
    if math.isinf(off):
        return ""
    shown = max(sum(shown for _, shown in speeds) / len(speeds), LEAST_MPS)
    ratio = sum(counted for counted, _ in speeds) / len(speeds) / shown
    _, error = mean_and_error([(counted - ratio * one) / shown for counted, one in speeds])
    wrong = max(off, SIGNIFICANT * error)
    if ratio < 1.0 - wrong or (ratio > 1.0 + wrong and not less):
        return f"the wheels' sensor says {ratio:.2f} of the receiver's speed"
    return ""
