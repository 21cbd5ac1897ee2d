"""A machine whose wheels' sensor, pot and phone err as told, against dead reckoning."""

from __future__ import annotations

import math
import random

from host.core.messages import State, Telemetry, Turned
from host.core.vehicle import Vehicle
from host.estimate.estimator import Estimator
from host.route.plan import Plan

STEP_S = 0.05
QUARTER = math.radians(90)


class Drive:
    """A machine that drives and turns truly, with a pot and a gyroscope that err."""

    def __init__(
        self,
        *,
        pot_off_rad: float = 0.0,
        pot_scale: float = 1.0,
        offset_radps: float = 0.0,
        late_s: float = 0.1,
        unknown_s: float = 0.0,
    ) -> None:
        """`unknown_s`: of late_s, what its stamps do not know."""
        self.estimate = Estimator(Vehicle(), Plan())
        self.pot_off, self.pot_scale = pot_off_rad, pot_scale
        self.offset, self.late, self.unknown = offset_radps, late_s, unknown_s
        self.gyro_turns, self.breaks = True, False
        self.scale = 1.0
        """What it shows, over what is turned."""
        self.counts = 1.0
        """What the hall sensor counts, over what is driven."""
        self.counted = True
        """Whether a hall sensor counts; no speed is known without it."""
        self.nose_up = math.nan
        """How far its camera looks above the horizon, rad; NaN: no accelerometer tells."""
        self.shake, self.random = 0.0, random.Random(1)
        self.now = self.distance = self.odometer = self.yaw = self.shown = 0.0
        self._sent: list[Turned] = []

    def go(
        self,
        seconds: float,
        speed: float,
        steer_rad: float = 0.0,
        *,
        duty: int | None = None,
        driven: float | None = None,
    ) -> None:
        """At that speed and true steering angle. The wheels' sensor counts whole pulses, as the
        machine was `driven` last: forward (1.0) or back (-1.0), whichever way it goes."""
        pulse_m = 1.0 / Vehicle().hall_pulses_per_m
        for _ in range(round(seconds / STEP_S)):
            self.now += STEP_S
            self.distance += speed * STEP_S
            counted = speed if driven is None else math.copysign(speed, driven)
            self.odometer += self.counts * counted * STEP_S
            turn = speed * STEP_S * math.tan(steer_rad)
            self.yaw += turn
            self.shown += (self.scale * turn if self.gyro_turns else 0.0) + self.offset * STEP_S
            self.shown += self.random.gauss(0.0, self.shake) * STEP_S
            since = self.now if self.breaks else 0.0
            self._sent.append(Turned(self.now + self.unknown, self.shown, since, self.nose_up))
            known = self.late - self.unknown
            while self._sent and self._sent[0].stamp <= self.now - known + 1e-9:
                self.estimate.take_turned(self._sent.pop(0))
            self.estimate.take_telemetry(
                Telemetry(
                    stamp=self.now,
                    state=State.RUNNING,
                    faults=0,
                    setpoint_rad=0.0,
                    angle_rad=steer_rad * self.pot_scale - self.pot_off,
                    steer_duty=0,
                    drive_duty=round(255 * speed) if duty is None else duty,
                    blade=False,
                    speed_mps=counted if self.counted else None,
                    distance_m=self._pulses(pulse_m) if self.counted else 0.0,
                    battery_v=12.0,
                    last_seq=0,
                    frames_bad=0,
                )
            )

    def _pulses(self, pulse_m: float) -> float:
        return math.floor(self.odometer / pulse_m + 1e-9) * pulse_m

    def quarter(self) -> None:
        """Turns left by a quarter on the lock, and stands."""
        self.go(QUARTER / (0.3 * math.tan(math.radians(45))), 0.3, math.radians(45))
        self.go(1.0, 0.0)

    @property
    def error_m(self) -> float:
        """Of the way by dead reckoning."""
        return self.estimate.motion.distance_m - self.distance

    @property
    def error_rad(self) -> float:
        """Of the yaw by dead reckoning."""
        return self.estimate.motion.yaw_rad - self.yaw
