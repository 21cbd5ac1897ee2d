"""The phone's gyroscope and accelerometer, as an app serves them.

A MEMS gyroscope shows the true rate times its scale, plus an offset that wanders, plus noise, plus
what the machine shakes. Figures of a phone's part (Bosch BMI160 data sheet, rev 1.2, table 2):
noise density 0.007 deg/s per root hertz, zero-rate offset 3 deg/s over life and temperature, 0.05
deg/s per kelvin, sensitivity within 1 %. Android takes most of the offset off (TYPE_GYROSCOPE is
the calibrated sensor).

The form is IP Webcam's /sensors.json: by sensor, a unit and a list of [milliseconds of the phone's
clock, [x, y, z]], the newest last. Axes are Android's, of the phone: x right, y up, z out of the
screen of a phone held upright. On the machine it lies on its side with the camera looking ahead:
its x points up, its y left.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from sim_plant.strict import NotNegative, Positive, Strict

GRAVITY: Final = 9.81
SHAKEN: Final = 0.5
"""m/s² that a moving machine shakes the accelerometer by, for each degree a second of the other."""
MOVES_MPS: Final = 0.01
"""Slower than this nothing shakes."""
EPOCH_S: Final = 1_777_354_200.0
"""What the phone's clock shows at simulated time 0: Unix time, of its own."""


class GyroSpec(Strict):
    """How good it is."""

    fitted: bool = True
    """Cheap phones have none, and some apps do not serve it."""
    rate_hz: Positive = 50.0
    """Android's SENSOR_DELAY_GAME."""
    noise_dps: NotNegative = 0.1
    """Standard deviation of a sample: twice the data sheet's at this rate."""
    offset_dps: NotNegative = 0.3
    """Standard deviation of what each axis shows at rest when the run begins,"""
    walk_dps: NotNegative = 0.003
    """and of its change, per square root of a second: the part warms up."""
    scale_error: float = 0.005
    """A share of the rate."""
    vibration_dps: NotNegative = 0.5
    """Standard deviation of a sample while the machine moves."""
    delay_s: NotNegative = 0.1
    """From a sample to the host."""


class Sample(NamedTuple):
    """One of both sensors, in the phone's axes."""

    clock_s: float
    """The phone's."""
    rate_radps: tuple[float, float, float]
    force_mps2: tuple[float, float, float]
    """What an accelerometer at rest shows upwards."""


class Gyro:
    """One phone's. Samples must be asked in order of time; deterministic by (spec, seed)."""

    def __init__(self, spec: GyroSpec, seed: int, pitch_rad: float) -> None:
        """`pitch_rad`: how far the phone looks down."""
        self.spec = spec
        self._rng = np.random.default_rng([seed, 0x6779])
        self._offset: list[float] = self._rng.normal(0.0, math.radians(spec.offset_dps), 3).tolist()
        c, s = math.cos(pitch_rad), math.sin(pitch_rad)
        self._axes = ((s, 0.0, c), (0.0, 1.0, 0.0), (-c, 0.0, s))
        """Rows: the phone's axes in the vehicle's frame."""

    @staticmethod
    def clock_s(t: float) -> float:
        """What the phone's clock shows at simulated time t."""
        return EPOCH_S + t

    def sample(self, t: float, yaw_radps: float, roll: float, pitch: float, v: float) -> Sample:
        """At simulated time t, on a machine that turns at that rate about its own vertical, banks
        and climbs by these angles, rad, and moves at v, m/s."""
        spec, offset = self.spec, self._offset
        walk = math.radians(spec.walk_dps) / math.sqrt(spec.rate_hz)
        shake = spec.vibration_dps if abs(v) > MOVES_MPS else 0.0
        noise = math.radians(math.hypot(spec.noise_dps, shake))
        felt = 0.02 + SHAKEN * shake
        # Three for the walk, three for the rate, three for the force. In plain numbers: to call
        # numpy for three takes five times as long.
        drawn = self._rng.standard_normal(9).tolist()
        turned = yaw_radps * (1.0 + spec.scale_error)
        ux, uy, uz = math.sin(pitch), -math.sin(roll), math.cos(pitch) * math.cos(roll)
        rate, force = [], []
        for k, (ax, ay, az) in enumerate(self._axes):
            offset[k] += walk * drawn[k]
            rate.append(az * turned + offset[k] + noise * drawn[3 + k])
            force.append(GRAVITY * (ax * ux + ay * uy + az * uz) + felt * drawn[6 + k])
        x, y, z = rate
        fx, fy, fz = force
        return Sample(self.clock_s(t), (x, y, z), (fx, fy, fz))


_ROW: Final = "[%d, [%.6f, %.6f, %.6f]]"
_SENSORS: Final = tuple(
    json.dumps({"unit": unit, "desc": axes, "data": []}).removesuffix("]}")
    for unit, axes in (
        ("rad/s", ["Gyro X", "Gyro Y", "Gyro Z"]),
        ("m/s\u00b2", ["Ax", "Ay", "Az"]),
    )
)
"""What stands before each sensor's rows."""


def sensors_json(samples: Iterable[Sample]) -> bytes:
    """The app's answer. Put together as text: `json.dumps` takes four times as long."""
    rates, forces = [], []
    for clock_s, (x, y, z), (fx, fy, fz) in samples:
        at = round(clock_s * 1e3)
        rates.append(_ROW % (at, x, y, z))
        forces.append(_ROW % (at, fx, fy, fz))
    gyro, accel = _SENSORS
    return (
        f'{{"gyro": {gyro}{", ".join(rates)}]}}, "accel": {accel}{", ".join(forces)}]}}}}'
    ).encode()
