"""Poles and stability margins of the loop that follows the edge, by law and
speed, for the machine in the vehicle file.

The vehicle: offset' = v heading, heading' = v curvature, the curvature a first-order lag behind
what is asked for, and a dead time between decision and motor. Camera and vision delay nothing here:
the filter predicts from the shutter to now.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, get_args

import control
import numpy as np
from numpy.typing import NDArray

from host.core.errors import UserError
from host.core.vehicle import Vehicle
from host.pilot import steering_law

Law = Literal["state", "proportional"]
LAWS: Final[tuple[Law, ...]] = get_args(Law)
DEAD_TIME_S: Final = 0.1
"""From a decision to the steering motor: command period, serial line, firmware's tick."""
PADE: Final = 3
"""Order of the dead time's rational approximation."""
STEP: Final = 1e-6
"""Of the difference quotient that linearises the steering law."""
PHASE_DEG: Final = 45.0
"""Less is too little for a machine on real ground."""
LEAST_DEG: Final = 30.0
"""With less nothing is driven: the loop swings for metres after each disturbance. A frequency ten
times the default's leaves 12 degrees, a tenth of its damping 7."""
SPEEDS_MPS: Final = (0.15, 0.3, 0.5, 0.8)
"""At which margins are shown: creeping, turning, cutting, and faster."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Margins:
    """Of the loop opened where the command goes to the motor."""

    gain_db: float
    phase_deg: float
    sensitivity: float
    """Largest |S|: how much a disturbance is amplified at its worst."""
    damping: float
    """Of the least damped pole of the closed loop."""
    settling_m: float
    """Way in which the slowest pole decays to 2 %; infinite where it does not."""


def gains(law: Law, speed_mps: float, vehicle: Vehicle) -> Floats:
    """(3,) curvature asked for per unit of offset, heading and curvature, negative: read off the
    law itself by small differences, so that nothing is designed that is not driven."""

    def curvature(offset: float, heading: float, bend: float) -> float:
        if law == "proportional":
            blade = offset + vehicle.blade_x_m * math.sin(heading)
            angle = steering_law.proportional(blade, vehicle)
        else:
            angle = steering_law.state(offset, heading, bend, speed_mps, vehicle)
        return math.tan(angle) / vehicle.wheelbase_m

    return np.array([-curvature(*row) / STEP for row in (STEP * np.eye(3)).tolist()])


def opened(
    feedback: Floats, speed_mps: float, lag_s: float, dead_time_s: float = DEAD_TIME_S
) -> control.StateSpace:
    """From the command to the feedback that it brings back, dead time included (Padé)."""
    a = [[0.0, speed_mps, 0.0], [0.0, 0.0, speed_mps], [0.0, 0.0, -1.0 / lag_s]]
    b = [[0.0], [0.0], [1.0 / lag_s]]
    vehicle = control.ss(a, b, feedback.reshape(1, 3), [[0.0]])
    if dead_time_s == 0.0:
        return vehicle
    return control.series(control.ss(control.tf(*control.pade(dead_time_s, PADE))), vehicle)


def margins(loop: control.StateSpace, speed_mps: float) -> Margins:
    """Stability margins of a loop."""
    gain, phase, modulus, *_ = control.stability_margins(loop)
    poles = control.feedback(loop, 1).poles()
    slowest = float(poles.real.max())
    return Margins(
        gain_db=20 * math.log10(gain) if 0 < gain < math.inf else math.inf,
        phase_deg=float(phase),
        sensitivity=1.0 / float(modulus),
        damping=float((-poles.real / np.abs(poles)).min()),
        settling_m=math.log(50) / -slowest * speed_mps if slowest < 0 else math.inf,
    )


def at_cutting_speed(vehicle: Vehicle) -> Margins:
    """Of the vehicle's own law at the speed at which it cuts."""
    speed = vehicle.cutting_speed_mps
    feedback = gains(vehicle.steering_law, speed, vehicle)
    return margins(opened(feedback, speed, vehicle.steer_lag_s), speed)


def check_steady(vehicle: Vehicle) -> None:
    """UserError where the machine would swing beside the edge instead of following it."""
    found = at_cutting_speed(vehicle)
    if found.phase_deg < LEAST_DEG or not math.isfinite(found.settling_m):
        raise UserError(
            f"with follow_frequency_1pm {vehicle.follow_frequency_1pm:g}, follow_damping "
            f"{vehicle.follow_damping:g} and cutting_speed_mps {vehicle.cutting_speed_mps:g} the "
            f"machine would swing instead of following the edge (phase margin "
            f"{found.phase_deg:.0f} degrees, {LEAST_DEG:g} at least): correct the vehicle file; "
            "`daranti tune follow` shows what fits"
        )
