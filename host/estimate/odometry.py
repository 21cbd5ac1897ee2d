"""Dead reckoning from what the machine reports: steering angle, drive duty, hall sensor if fitted,
and the phone's gyroscope where it has one.

Without a hall sensor the speed is what the duty gives (duty_speed.py).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from host.core.messages import Fix, Telemetry, Turned
from host.core.vehicle import Vehicle
from host.estimate.duty_speed import DutySpeed
from host.estimate.gyroscope import WINDOW_S, Gyroscope, Stand
from host.estimate.rolling import Rolling
from host.estimate.wheel_sensor import LEG_RAD, WheelPlace, wheel_share

HISTORY_S = 1.5
HALL_SIGMA = 0.005
"""Wheel slip, besides what the position learns of it."""
DOPPLER_MPS = 0.06
"""Standard deviation of a phone's speed over ground, and of its velocity across the course."""
STRAIGHT_RAD = math.radians(8)
TRIM_LIMIT_RAD = math.radians(5)
"""What a pot's zero and a side slope make at most, unless the pot is loose or miscalibrated."""
YAW_GAIN_PRIOR = (1.0, 0.03)
"""Mean and standard deviation, before any turn, of what the machine turns, over what its steering
angle says: tyres slip sideways, most at full lock, and a pot's scale is not exact."""
YAW_GAIN_LIMITS = (0.85, 1.15)
TURN_SIGMA_RAD = 0.02
"""How well the lanes before and after a turn show how far the machine has turned."""
TOO_FAST = 2.0
"""Times the speed at full duty: more than any slope gives."""
TOO_FAST_S = 0.1
"""For so long: one pulse too many is noise."""
FRESH_S = 0.5
"""What the gyroscope says is older than this only where the phone's network falters; the steering
angle bridges it."""
RESTS_S = 0.5
"""Without a pulse of the hall sensor, or by the duty model alone, until the machine stands."""
CREEPS_MPS = 0.01
UNSEEN_MPS = 0.05
"""At which a braked machine may creep down a slope of some degrees, where no sensor counts it
(docs/understand/firmware.md: 0.08 on five degrees)."""
UNSEEN_RADPS = math.radians(0.1)
"""That it may turn unseen by such a creep and still rest, as the gyroscope's offset needs it."""
TRIM_M = 2.0
"""Way in which the gyroscope's straight driving turns the trim: a side slope's changes so fast."""
SURELY = 3.0
"""Standard deviations of the speed that the duty gives, beyond which the steering angle tells
against the gyroscope."""
TOLD_MPS = 0.25
"""From which the duty tells the way well enough for the trim."""
LEG_SHARE = 0.2
"""Of what the yaw gain lacks, learned from one leg beside the gyroscope."""


@dataclass(frozen=True, slots=True)
class Motion:
    """What has been travelled since the start, at `stamp`. `distance_m` is signed (reverse counts
    down), `yaw_rad` unwrapped, x_m and y_m in the frame of the first pose."""

    stamp: float
    speed_mps: float
    curvature_1pm: float
    distance_m: float
    yaw_rad: float
    x_m: float
    y_m: float
    gyro_noise: float = 0.0
    """What the gyroscope errs that tells the yaw, rad over the square root of a second; 0: the
    steering angle alone tells it."""
    rolls: bool = False
    """Whether it moves with its drive off, long after that could still be coasting: which way, one
    hall sensor does not tell;"""
    roll_doubt_m: float = 0.0
    """of how much of that, since its drive was switched off, neither the ground nor the gyroscope
    told which way."""

    @property
    def by_gyro(self) -> bool:
        """Whether the gyroscope tells the yaw."""
        return self.gyro_noise > 0.0


class _Reckoned(NamedTuple):
    """By steering angle and way alone."""

    stamp: float
    yaw_rad: float
    distance_m: float
    unsure_rad: float
    """What of that may be otherwise, to and fro: rolled with the drive off, this way or that, or
    turned on a way that no sensor counts."""


class Odometry:
    """Integrates telemetry; keeps a short history so that a delayed picture finds its own pose."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._by_duty = DutySpeed(vehicle)
        self._speed = 0.0
        self._odometer: float | None = None
        self._too_fast_s = 0.0
        self.rolling = Rolling(vehicle)
        self.wheel_place = WheelPlace()
        self._history: deque[Motion] = deque()
        self.gyroscope = Gyroscope()
        """Its offset is the filter's to say."""
        self._by_angle: deque[_Reckoned] = deque([_Reckoned(-math.inf, 0.0, 0.0, 0.0)])
        self._missed_rad = 0.0
        """What the gyroscope has shown besides, still to be taken."""
        self._compared = self._by_angle[0]
        self._trims: deque[tuple[float, float]] = deque([(-math.inf, 0.0)])
        """(stamp, trim) since the gyroscope's comparison begins: what it taught may be wrong."""
        self._still_since = math.inf
        """Since when no sensor has shown it move."""
        self.trim_rad = 0.0
        """True steering angle minus the pot's, as the filter learns it: its calibration, and
        what a side slope does."""
        self._middle_rad = TRIM_LIMIT_RAD
        """What the pot's middle may be off besides what the gyroscope has taught of it."""
        self.yaw_gain, self._yaw_gain_sigma = YAW_GAIN_PRIOR
        """True yaw over what the steering angle and the way say, as learned in turns."""
        self._bends = (0.0, 0.0)
        """Turned to and fro since it was last learned, rad; and by how much more that would be with
        a gain of twice as much: by more than itself on the wheel's inner side, for the way that
        such a wheel has counted is then the longer for the middle."""
        self.now = Motion(-math.inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def scale_sigma(self) -> float:
        """Standard deviation of a travelled distance, as a share of it."""
        return HALL_SIGMA if self._odometer is not None else self._by_duty.scale_sigma

    @property
    def pot_off_rad(self) -> float:
        """How far left of what the pot says the machine steers, where that is more than a pot that
        was calibrated leaves; else 0."""
        return self.trim_rad if abs(self.trim_rad) >= TRIM_LIMIT_RAD else 0.0

    @property
    def impossible(self) -> bool:
        """Whether the hall sensor counts faster than the machine can drive."""
        return self._too_fast_s > TOO_FAST_S

    def curvature_1pm(self, angle_rad: float) -> float:
        """Of the rear axle's middle, positive to the left, where the pot shows that angle."""
        tangent = math.tan(angle_rad + self.trim_rad)
        return tangent / self._vehicle.wheelbase_m * self.yaw_gain

    def update(self, telemetry: Telemetry) -> Motion:
        """Advances to the telemetry's stamp. Older or repeated telemetry changes nothing."""
        past = self.now
        dt = telemetry.stamp - past.stamp
        if dt <= 0:
            return past
        dt = dt if math.isfinite(dt) else 0.0
        vehicle = self._vehicle
        curvature = self.curvature_1pm(telemetry.angle_rad)
        middle_1pm = (curvature + past.curvature_1pm) / 2
        if telemetry.speed_mps is not None:
            step = (
                telemetry.distance_m - self._odometer
                if self._odometer is not None
                else telemetry.speed_mps * dt
            )
            self._odometer = telemetry.distance_m
            straight = abs(telemetry.angle_rad) < STRAIGHT_RAD
            yaw_step = step * middle_1pm
            step, yaw_step, self._speed = self.rolling.take(
                step, yaw_step, telemetry, dt, past.yaw_rad, straight=straight
            )
            too_fast = abs(self._speed) > TOO_FAST * vehicle.full_duty_speed_mps
            self._too_fast_s = self._too_fast_s + dt if too_fast else 0.0
        else:
            before = self._speed
            self._speed = self._by_duty.advance(telemetry, past.yaw_rad, dt)
            step = (before + self._speed) / 2 * dt
            yaw_step = step * middle_1pm
        share = wheel_share(vehicle.hall_left_m, middle_1pm)
        self._bends = self._bends[0] + abs(yaw_step), self._bends[1] + abs(yaw_step) / share
        rolls = self.rolling.off and step != 0.0
        unsure_rad = 2.0 * abs(yaw_step) if rolls else 0.0
        if telemetry.speed_mps is None and telemetry.drive_duty != 0:
            unsure_rad = SURELY * self._by_duty.unsure_mps * dt * abs(middle_1pm)
        self._reckon(telemetry, step, yaw_step, unsure_rad)
        yaw_step, self._missed_rad = yaw_step + self._missed_rad, 0.0
        middle = past.yaw_rad + yaw_step / 2
        self.now = Motion(
            telemetry.stamp,
            self._speed,
            curvature,
            past.distance_m + step,
            past.yaw_rad + yaw_step,
            past.x_m + step * math.cos(middle),
            past.y_m + step * math.sin(middle),
            self._gyro_noise(telemetry.stamp),
            rolls,
            self.rolling.doubt_m,
        )
        self._history.append(self.now)
        while self._history[0].stamp < self.now.stamp - HISTORY_S:
            self._history.popleft()
        return self.now

    def _gyro_noise(self, stamp: float) -> float:
        gyroscope = self.gyroscope
        tells = gyroscope.useful and stamp - gyroscope.known_to < FRESH_S
        return gyroscope.noise if tells else 0.0

    def _reckon(
        self, telemetry: Telemetry, step_m: float, yaw_step: float, unsure_rad: float
    ) -> None:
        before = self._by_angle[-1]
        stamp = telemetry.stamp
        distance, yaw = before.distance_m + step_m, before.yaw_rad + yaw_step
        unsure = before.unsure_rad + unsure_rad
        self._by_angle.append(_Reckoned(stamp, yaw, distance, unsure))
        while self._by_angle[0].stamp < stamp - HISTORY_S:
            self._by_angle.popleft()
        moves = telemetry.drive_duty != 0 or step_m != 0.0
        if telemetry.speed_mps is None:
            moves = telemetry.drive_duty != 0 or abs(self._speed) > CREEPS_MPS
        self._still_since = math.inf if moves else min(self._still_since, stamp)

    def take_turned(self, turned: Turned) -> None:
        """What the gyroscope says; it may be some tenths of a second old."""
        gyroscope = self.gyroscope
        at = self._angle_at(turned.stamp)
        stand = self._stand(gyroscope.stamp)
        believed = not gyroscope.contradicted
        way = doubt = 0.0
        before = self._compared
        if at is not None:
            way = at.distance_m - before.distance_m
            doubt = abs(way) * math.tan(self._middle_rad) / self._vehicle.wheelbase_m
            doubt += at.unsure_rad - before.unsure_rad
            self._compared = at
        if self.rolling.steady:
            lasted_s = turned.stamp - gyroscope.stamp
            self.rolling.climb.learn(self.now.yaw_rad, turned.nose_up_rad, lasted_s)
        missed = gyroscope.take(turned, at.yaw_rad if at else None, stand, doubt)
        self._missed_rad += missed
        if believed and gyroscope.contradicted:
            self.trim_rad = self._trims[0][1]
            self._trims.clear()
        self._trims.append((turned.stamp, self.trim_rad))
        while self._trims[0][0] < turned.stamp - WINDOW_S:
            self._trims.popleft()
        if at is None:
            return
        if self._odometer is not None:
            self.wheel_place.take(*gyroscope.leg, ended=stand is not None)
        if stand is not None:
            self._learn_gain(*gyroscope.take_leg())
        elif gyroscope.useful:
            self._learn_trim(missed, way)
            seen_rad = missed + at.yaw_rad - before.yaw_rad
            self.rolling.shown(seen_rad, self.now.curvature_1pm)

    def _stand(self, stamp: float) -> Stand | None:
        """Whether the machine stood then, and did not turn. Between two pulses of its sensor it may
        creep: no faster than one pulse in the time that has passed."""
        lasted = stamp - self._still_since
        if lasted < RESTS_S:
            return None
        pulses_per_m = self._vehicle.hall_pulses_per_m
        counted = self._odometer is not None and pulses_per_m > 0.0
        creeps = min(UNSEEN_MPS, 1.0 / (pulses_per_m * lasted)) if counted else UNSEEN_MPS
        unseen = creeps * abs(self.at(stamp).curvature_1pm)
        return Stand(lasted, unseen) if unseen <= UNSEEN_RADPS else None

    def _angle_at(self, stamp: float) -> _Reckoned | None:
        """As reckoned at a time within the history; a newer one is now."""
        later = self._by_angle[-1]
        if stamp < self._by_angle[0].stamp or not math.isfinite(later.stamp):
            return None
        for each in reversed(self._by_angle):
            if each.stamp <= stamp:
                span = later.stamp - each.stamp
                share = min(1.0, (stamp - each.stamp) / span) if 0 < span < math.inf else 0.0
                yaw = each.yaw_rad + share * (later.yaw_rad - each.yaw_rad)
                distance = each.distance_m + share * (later.distance_m - each.distance_m)
                unsure = each.unsure_rad + share * (later.unsure_rad - each.unsure_rad)
                return _Reckoned(stamp, yaw, distance, unsure)
            later = each
        return later

    def _learn_trim(self, missed_rad: float, way_m: float) -> None:
        """What the gyroscope shows besides, driving straight, is the pot's zero or a slope's."""
        straight = math.tan(STRAIGHT_RAD) / self._vehicle.wheelbase_m
        if self._odometer is None and abs(self._speed) < TOLD_MPS:
            return  # nobody knows the way of a creep
        if way_m != 0.0 and abs(self.now.curvature_1pm) < straight:
            share = min(1.0, abs(way_m) / TRIM_M)
            self._middle_rad *= 1.0 - share
            self.turn_trim(missed_rad / way_m * share)

    def _learn_gain(self, seen_rad: float, reckoned_rad: float) -> None:
        """What a leg of a turn has turned, over what it was reckoned to: the pot's scale, and the
        slip of tyres. Compared at a stand, where nothing lags behind."""
        if not self.gyroscope.useful or abs(reckoned_rad) < LEG_RAD:
            return
        low, high = YAW_GAIN_LIMITS
        more = LEG_SHARE * (seen_rad / reckoned_rad - 1.0)
        self.yaw_gain = min(high, max(low, self.yaw_gain * (1.0 + more)))

    def turn_trim(self, curvature_1pm: float) -> None:
        """Takes a curvature that nearly straight driving showed besides what the pot said."""
        trim = self.trim_rad + math.atan(curvature_1pm * self._vehicle.wheelbase_m)
        self.trim_rad = min(TRIM_LIMIT_RAD, max(-TRIM_LIMIT_RAD, trim))

    def turned(self, reckoned_rad: float, true_rad: float, sigma_rad: float = 0.0) -> None:
        """Learns from a turn of which both are known, the reckoned one with the present gain, the
        true one but for sigma_rad by which the corner's angle may be otherwise. What the gyroscope
        tells, the filter learns of."""
        turned, bent = self._bends
        self._bends = (0.0, 0.0)
        if self.now.by_gyro:
            return
        noise = TURN_SIGMA_RAD**2 + sigma_rad**2
        slope = reckoned_rad / self.yaw_gain * (bent / turned if turned > 0.0 else 1.0)
        variance = (slope * self._yaw_gain_sigma) ** 2 + noise
        blend = slope * self._yaw_gain_sigma**2 / variance
        low, high = YAW_GAIN_LIMITS
        gain = self.yaw_gain + blend * (true_rad - reckoned_rad)
        self.yaw_gain = min(high, max(low, gain))
        self._yaw_gain_sigma *= math.sqrt(noise / variance)

    def learn(self, fix: Fix, telemetry: Telemetry, dt: float) -> None:
        """Corrects the speed without a wheel sensor by a Doppler speed that lasted `dt` seconds."""
        if telemetry.speed_mps is None and abs(telemetry.angle_rad) < STRAIGHT_RAD:
            self._by_duty.learn(fix, dt)

    def at(self, stamp: float) -> Motion:
        """The motion at an earlier time, the nearest recorded one within the history."""
        best = self.now
        for motion in reversed(self._history):
            best = motion
            if motion.stamp <= stamp:
                break
        return best
