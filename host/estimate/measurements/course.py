"""The receiver's Doppler course, for the position's direction: no strip turns it, as each may turn
the next. A walked boundary is some degrees off: what the courses differ by along the outer edge is
the plan's, a state of its own."""

from __future__ import annotations

import math

import numpy as np

from host.estimate.kalman import Array, Measurement
from host.estimate.odometry import DOPPLER_MPS
from host.estimate.states import CRAB, PLAN_YAW, YAW

SHARE = 1.2
"""A phone's course is smoothed: one fix errs much like the last, and each counts as one this much
worse than its speed is."""


def course(x: Array, left_rad: float, speed_mps: float) -> Measurement:
    """The course lies left_rad left of the yaw, at that speed over ground. A machine that drifts
    aside goes elsewhere than it heads."""
    h = np.zeros((1, len(x)))
    h[0, [YAW, PLAN_YAW, CRAB]] = 1.0
    sigma = math.atan2(SHARE * DOPPLER_MPS, abs(speed_mps))
    return Measurement(
        "course", h, np.array([left_rad - x[PLAN_YAW] - x[CRAB]]), np.array([sigma**2])
    )
