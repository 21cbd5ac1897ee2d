"""A small steering actuator for the firmware's own tests: motor with lag, stiction and slew limit,
backlash, and a noisy potentiometer. `sim_plant` has the real plant; this one depends on nothing."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

COULOMB = 0.75
"""Friction in motion as a share of stiction."""


@dataclass(frozen=True)
class ActuatorSpec:
    """Angles in degrees, duties of 255, times in seconds."""

    slew_degps: float = 60.0
    """Speed at full duty."""
    lag_s: float = 0.07
    stiction_duty: float = 45.0
    backlash_deg: float = 1.0
    noise_counts: float = 2.0
    """Bound of the potentiometer's uniform noise."""
    counts_per_deg: float = 4.5
    centre_counts: float = 512.0
    coasts: bool = True
    """Released, the motor is an open circuit (a VNH5019, its PWM low)."""
    polarity: int = 1


class Actuator:
    """State of one actuator; `step` advances it."""

    def __init__(self, spec: ActuatorSpec, angle_deg: float = 0.0, seed: int = 0) -> None:
        self.spec = spec
        self.shaft_deg = angle_deg
        self.angle_deg = angle_deg
        self.rate_degps = 0.0
        self.jammed = False
        self._random = random.Random(seed)

    def step(self, duty: int, dt: float) -> None:
        """duty: -255..255, positive left."""
        spec = self.spec
        gain = spec.slew_degps / (255 - COULOMB * spec.stiction_duty)
        push = gain * duty * spec.polarity
        friction = gain * COULOMB * spec.stiction_duty
        if self.rate_degps == 0.0 and abs(push) <= gain * spec.stiction_duty:
            push = friction = 0.0
        direction = math.copysign(1.0, self.rate_degps or push)
        damping = 0.0 if duty == 0 and spec.coasts else self.rate_degps
        rate = self.rate_degps + dt / spec.lag_s * (push - damping - direction * friction)
        stopped = self.rate_degps * rate < 0.0 or self.jammed
        self.rate_degps = 0.0 if stopped else rate
        self.shaft_deg += self.rate_degps * dt
        slack = spec.backlash_deg / 2
        low, high = self.shaft_deg - slack, self.shaft_deg + slack
        self.angle_deg = min(max(self.angle_deg, low), high)

    def pot_mv(self) -> int:
        """What the potentiometer reads now, 5 V over 1023 counts."""
        spec = self.spec
        counts = spec.centre_counts + spec.counts_per_deg * self.angle_deg
        counts += self._random.uniform(-spec.noise_counts, spec.noise_counts)
        return round(min(max(counts, 0.0), 1023.0) * 5000 / 1023)
