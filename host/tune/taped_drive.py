"""Wheel scale and the steering's middle from one straight drive beside a tape."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from host.core.errors import UserError

TAPE_SIGMA_M: Final = 0.02
"""Of a tape over 10 m of stubble; by judgement."""
LEAST_M: Final = 3.0
"""What a tape errs is below a per cent of it."""


@dataclass(frozen=True, slots=True)
class TapedDrive:
    """What the wheels' sensor and the steering pot are, each with its standard deviation."""

    pulses_per_m: float | None
    """None: there is no wheel sensor."""
    pulses_sigma: float
    steer_off_deg: float
    """Where the wheel truly stands, positive left, when the pot says straight ahead."""
    steer_sigma_deg: float


def taped_drive(
    counted_m: float | None,
    pulses_per_m: float,
    taped_m: float,
    aside_m: float,
    wheelbase_m: float,
    hall_left_m: float = 0.0,
) -> TapedDrive:
    """From a drive that was told to go straight: what was counted with the present pulses a metre
    (None: nothing counts), and by tape how far it came and how far to the left of straight. A
    sensor at a wheel `hall_left_m` left of the middle counts that one's arc, not the middle's.
    UserError for a drive that is too short, or a sensor that counted nothing."""
    if taped_m < LEAST_M:
        raise UserError(f"a drive of {taped_m:g} m tells little: drive at least {LEAST_M:g} m")
    if counted_m is not None and (counted_m <= 0 or pulses_per_m <= 0):
        raise UserError("the wheels' sensor counted nothing: check its magnets and its wire")
    # the way was a circle's arc that begins straight ahead
    bend = 2 * aside_m / (taped_m**2 + aside_m**2)
    turned = 2 * math.atan2(aside_m, taped_m)
    way = turned / bend if abs(bend) > 1e-6 else taped_m
    wheels_way = way - hall_left_m * turned
    found = None if counted_m is None else pulses_per_m * counted_m / wheels_way
    unsure = 2 * TAPE_SIGMA_M / taped_m**2
    return TapedDrive(
        found,
        (found or 0.0) * TAPE_SIGMA_M / taped_m,
        math.degrees(math.atan(bend * wheelbase_m)),
        math.degrees(unsure * wheelbase_m),
    )
