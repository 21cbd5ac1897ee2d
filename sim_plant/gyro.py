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
from numba import njit
from numpy.typing import NDArray

from sim_plant.strict import NotNegative, Positive, Strict

Floats = NDArray[np.float64]
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
    force_zero_mps2: NotNegative = 0.2
    """Standard deviation of what each axis of the accelerometer shows too much: half of the data
    sheet's 40 mg."""
    delay_s: NotNegative = 0.1
    """From a sample to the host."""


class Sample(NamedTuple):
    """One of both sensors, in the phone's axes."""

    clock_s: float
    """The phone's."""
    rate_radps: tuple[float, float, float]
    force_mps2: tuple[float, float, float]
    """What an accelerometer at rest shows upwards."""


class Part(NamedTuple):
    """What compiled loops need of one phone's sensors, SI units."""

    walk: float
    """Standard deviation of an offset's change from sample to sample."""
    still: float
    """Standard deviation of the rate's noise on a machine that stands, and on one that moves;"""
    moving: float
    force_still: float
    """the same of the force's."""
    force_moving: float
    force_zero: tuple[float, float, float]
    """What each axis shows too much."""
    scale: float


class Gyro:
    """One phone's. Samples must be asked in order of time; deterministic by (spec, seed)."""

    def __init__(self, spec: GyroSpec, seed: int, pitch_rad: float) -> None:
        """`pitch_rad`: how far the phone looks down."""
        self.spec = spec
        self._rng = np.random.default_rng([seed, 0x6779])
        self.offset: Floats = self._rng.normal(0.0, math.radians(spec.offset_dps), 3)
        """(3,) that each axis shows at rest, rad/s."""
        # Drawn apart, so that what the accelerometer errs leaves the gyroscope's draws as they are.
        zero = np.random.default_rng([seed, 0x6163]).normal(0.0, spec.force_zero_mps2, 3)
        c, s = math.cos(pitch_rad), math.sin(pitch_rad)
        self.axes: Floats = np.array(((s, 0.0, c), (0.0, 1.0, 0.0), (-c, 0.0, s)))
        """Rows: the phone's axes in the vehicle's frame."""
        still, moving = (
            math.radians(math.hypot(spec.noise_dps, shake)) for shake in (0.0, spec.vibration_dps)
        )
        self.part = Part(
            math.radians(spec.walk_dps) / math.sqrt(spec.rate_hz),
            still,
            moving,
            0.02,
            0.02 + SHAKEN * spec.vibration_dps,
            (float(zero[0]), float(zero[1]), float(zero[2])),
            1.0 + spec.scale_error,
        )

    @staticmethod
    def clock_s(t: float) -> float:
        """What the phone's clock shows at simulated time t."""
        return EPOCH_S + t

    def drawn(self, count: int) -> Floats:
        """(count, 9) for the next samples: three for the walk, three for the rate, three for the
        force."""
        return self._rng.standard_normal((count, 9))

    def sample(self, t: float, yaw_radps: float, roll: float, pitch: float, v: float) -> Sample:
        """At simulated time t, on a machine that turns at that rate about its own vertical and
        moves at v, m/s; `roll` positive clockwise seen from behind, `pitch` nose down, rad."""
        out = np.empty(6)
        feel(self.part, self.axes, self.offset, self.drawn(1)[0], yaw_radps, roll, pitch, v, out)
        return self.sampled(t, out)

    def sampled(self, t: float, felt: Floats) -> Sample:
        """A sample of time t from what `feel` gives."""
        x, y, z, fx, fy, fz = felt.tolist()
        return Sample(self.clock_s(t), (x, y, z), (fx, fy, fz))


@njit(cache=True, nogil=True)
def feel(
    part: Part,
    axes: Floats,
    offset: Floats,
    drawn: Floats,
    yaw_radps: float,
    roll: float,
    pitch: float,
    v: float,
    out: Floats,
) -> None:
    """`Gyro.sample` with what was drawn for it, (9,), into `out`: three rates, rad/s, then three
    forces, m/s². Moves the offset on."""
    moves = abs(v) > MOVES_MPS
    noise = part.moving if moves else part.still
    felt = part.force_moving if moves else part.force_still
    turned = yaw_radps * part.scale
    ux, uy, uz = -math.sin(pitch), math.sin(roll), math.cos(pitch) * math.cos(roll)
    for k in range(3):
        ax, ay, az = axes[k]
        offset[k] += part.walk * drawn[k]
        out[k] = az * turned + offset[k] + noise * drawn[3 + k]
        out[3 + k] = GRAVITY * (ax * ux + ay * uy + az * uz) + felt * drawn[6 + k]
        out[3 + k] += part.force_zero[k]


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
