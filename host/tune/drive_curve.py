"""The drive's model, by which firmware and host turn a speed into a duty and back, from steady legs
of which duty, battery and speed are known.

    v = full * (|u| * battery / nominal - dead) / (1 - dead),  reached with a first-order lag

u is the duty as a share of 255. A bridge's drop, the motor's resistance under the rolling load and
its back-EMF make that line (DC motor at a steady load). A slope moves it to and fro: legs there and
back over the same ground give its middle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from host.core.errors import UserError
from host.core.messages import Telemetry
from host.core.vehicle import Vehicle

Floats = NDArray[np.float64]

FULL_DUTY: Final = 255.0
APART: Final = 1.4
"""Of the fast legs' speed over the slow ones': nearer together they do not tell where the line
begins."""
DEAD_MOST: Final = 0.45
"""Of the full duty: a drive of which more is lost leaves nothing for crop and slopes."""
LAG_S: Final = (0.03, 2.0)
"""Bounds of the lag that is looked for,"""
LAG_BEGIN_S: Final = 0.25
"""and where the search begins."""
DUTY_SIGMA: Final = 1.0 / FULL_DUTY
"""Of a leg's mean duty: ground that is softer here than there, and the loop's own unrest."""


@dataclass(frozen=True, slots=True)
class Leg:
    """One steady way, ahead or back."""

    duty: float
    """Mean share of the full duty at the nominal voltage, without its sign."""
    speed_mps: float
    """Without its sign."""
    speed_sigma: float


@dataclass(frozen=True, slots=True)
class DriveCurve:
    """What the drive is, each with its standard deviation."""

    full_mps: float
    full_sigma: float
    dead: float
    """Share of the full duty that only just overcomes bridge and friction."""
    dead_sigma: float
    lag_s: float | None = None
    """None: no wheel sensor has shown how the speed follows."""

    def with_lag(self, lag_s: float) -> DriveCurve:
        """The same with its lag."""
        return replace(self, lag_s=lag_s)

    def params(self) -> dict[str, float]:
        """The firmware's parameters of it."""
        values = {"speed_full": round(self.full_mps, 3), "drive_min_duty": self.min_duty}
        if self.lag_s is not None:
            values["drive_lag"] = round(self.lag_s, 2)
        return values

    @property
    def min_duty(self) -> float:
        """As the firmware counts."""
        return float(round(self.dead * FULL_DUTY))

    def told(self, vehicle: Vehicle) -> Vehicle:
        """The vehicle file with it."""
        update: dict[str, float] = {
            "full_duty_speed_mps": round(self.full_mps, 3),
            "dead_duty": round(self.dead, 3),
        }
        if self.lag_s is not None:
            update["drive_lag_s"] = round(self.lag_s, 2)
        return vehicle.model_copy(update=update)


def duty_share(telemetry: Telemetry, nominal_v: float) -> float:
    """The share of the full duty that this one would be at the nominal voltage, with its sign."""
    return telemetry.drive_duty / FULL_DUTY * telemetry.battery_v / nominal_v


def drive_curve(slow: Sequence[Leg], fast: Sequence[Leg]) -> DriveCurve:
    """The line through the middle of the slow legs and that of the fast ones. UserError where they
    make none."""
    low, high = (
        np.mean([(leg.duty, leg.speed_mps) for leg in legs], axis=0) for legs in (slow, fast)
    )
    if high[0] <= low[0] or high[1] < APART * low[1]:
        raise UserError(
            f"the drive's ways do not tell: {low[1]:.2f} m/s at {100 * low[0]:.0f} % of the duty "
            f"and {high[1]:.2f} m/s at {100 * high[0]:.0f} %. Drive them on firm, level ground"
        )
    full, dead = _line(low, high)
    if dead > DEAD_MOST:
        raise UserError(
            f"the drive needs {100 * dead:.0f} % of the full duty only to move: see whether a "
            "wheel or the brake drags, the tyres are flat, the bridge or the battery is weak"
        )
    off = []
    for which, legs in enumerate((slow, fast)):
        share = 1.0 / math.sqrt(len(legs))
        sigmas = DUTY_SIGMA * share, share * float(np.mean([leg.speed_sigma for leg in legs]))
        for axis, sigma in enumerate(sigmas):
            ends = [low.copy(), high.copy()]
            ends[which][axis] += sigma
            moved = _line(*ends)
            off.append((moved[0] - full, moved[1] - dead))
    full_sigma, dead_sigma = np.sqrt(np.sum(np.square(off), axis=0)).tolist()
    return DriveCurve(full, full_sigma, max(dead, 0.0), dead_sigma)


def _line(low: Floats, high: Floats) -> tuple[float, float]:
    """(speed at full duty, dead share) of the line through two (duty, speed)."""
    slope = (high[1] - low[1]) / (high[0] - low[0])
    dead = low[0] - low[1] / slope
    return float(slope * (1.0 - dead)), float(dead)


@dataclass(frozen=True, slots=True)
class Start:
    """A way (n,) from standing, at `stamps` (n,), and the shares of the full duty (n,) as
    duty_share has them, both without sign."""

    stamps: Floats
    duties: Floats
    way_m: Floats


def drive_lag_s(starts: Sequence[Start], curve: DriveCurve) -> float:
    """The lag with which the ways follow the duties. Every start has a slope of its own: a bump
    under the wheels does to a short way what a lag does."""
    slope = curve.full_mps / (1.0 - curve.dead)

    def missed(tried: Floats) -> Floats:
        off = [
            _reckoned(s, slope, dead, tried[0]) for s, dead in zip(starts, tried[1:], strict=True)
        ]
        return np.concatenate([way - s.way_m for way, s in zip(off, starts, strict=True)])

    count = len(starts)
    begin = np.array([LAG_BEGIN_S, *[curve.dead] * count])
    low, high = [LAG_S[0], *[-1.0] * count], [LAG_S[1], *[1.0] * count]
    return float(least_squares(missed, begin, bounds=(low, high)).x[0])


def _reckoned(start: Start, slope: float, dead: float, lag_s: float) -> Floats:
    """The way of a model with that slope and dead share."""
    target = slope * np.maximum(0.0, start.duties - dead)
    steps = np.diff(start.stamps)
    speed = np.zeros(len(target))
    for k, share in enumerate(1.0 - np.exp(-steps / lag_s)):
        speed[k + 1] = speed[k] + share * (target[k] - speed[k])
    return np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * steps)])
