"""The receiver's Doppler speed, for what the wheels lose of their way. Hardly anything else tells
that: the ends of strips do not, for the boundary's corners are known no better.

A receiver's Doppler has next to no error of scale in the open: a phone's log of 1.2 km has 0.009,
what its positions wander included (`host.field.smoothing.SCALE`).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from host.estimate.kalman import Array, Measurement
from host.estimate.measurements.course import SHARE
from host.estimate.odometry import DOPPLER_MPS
from host.estimate.states import GRADE_X, GRADE_Y, SCALE, SLIP, YAW

GATE: Final = 9.0
"""Three standard deviations (Bar-Shalom et al. 2001): a receiver that hangs, or echoes from trees,
tell nothing of the wheels."""


def speed(x: Array, wheels_mps: float, ahead_mps: float, *, cutting: bool) -> Measurement:
    """The wheels count wheels_mps (negative: backwards), and over ground the machine goes ahead_mps
    in its direction. `cutting`: it pushes its blade through crop."""
    run = abs(wheels_mps)
    h = np.zeros((1, len(x)))
    h[0, SCALE] = -wheels_mps
    h[0, SLIP] = -wheels_mps if cutting else 0.0
    h[0, [GRADE_X, GRADE_Y]] = -run * math.cos(x[YAW]), -run * math.sin(x[YAW])
    return Measurement(
        "speed",
        h,
        np.array([ahead_mps - wheels_mps]) - h @ x,
        np.array([(SHARE * DOPPLER_MPS) ** 2]),
        GATE,
    )
