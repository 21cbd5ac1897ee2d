"""How far before the blade the next crop stands, by looks from several places on the way to it.

A picture shows under which angle below the horizon its foot stands. That is off by the camera's
pitch: its mount's, and that of the ground which the machine stands on, within half a metre much the
same. So looks from different distances tell both the distance and the pitch: least squares by
Gauss and Newton. A tuft of grass before the crop makes a look quite another; such a one counts the
less, the farther it is from what the others show.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from host.core.vehicle import LOW, Vehicle

HEIGHT_M: Final = LOW.z_m
"""Of the camera that errs more: from the mast a look errs by half as much."""
PITCH_RAD: Final = math.radians(1.4)
"""What mount and ground err by: so much explains the errors of 346 looks of the model eyes' drives,
0.5 m from the low camera at 2 m;"""
UNEVEN_RAD: Final = math.radians(0.5)
"""and by which it is another half a metre farther on."""
FOOT_M: Final = 0.05
"""By which a border is no line."""
LIKELY: Final = 2.0
"""Standard deviations within which a look agrees with the others."""
STEPS: Final = 12
"""Of Gauss and Newton: by then it has settled to a centimetre."""


class CropBeyond:
    """Of one stand, and the places that the machine goes to from it."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._blade_m = vehicle.blade_x_m
        """Before the rear axle, near which the cameras sit."""
        self._looks: list[tuple[float, float]] = []

    def see(self, at_m: float, ahead_m: float) -> None:
        """A look from at_m nearer than the first place shows it ahead_m before the blade."""
        self._looks.append((at_m, ahead_m))

    @property
    def known(self) -> tuple[float, float] | None:
        """How far before the blade at the first place it stands, and how surely, m; None without a
        look."""
        if not self._looks:
            return None
        at, ahead = np.array(self._looks).T
        shown = np.arctan2(HEIGHT_M, self._blade_m + ahead)
        place_m, pitch, covariance = float(np.median(at + ahead)), 0.0, np.eye(2)
        for _ in range(STEPS):
            far = np.maximum(self._blade_m + place_m - at, HEIGHT_M)
            per_m = HEIGHT_M / (far**2 + HEIGHT_M**2)
            noise = np.hypot(UNEVEN_RAD, FOOT_M * per_m)
            slopes = np.column_stack([-per_m, np.ones(len(at))]) / noise[:, None]
            off = (shown - np.arctan2(HEIGHT_M, far) - pitch) / noise
            agree = slopes.T / (1.0 + (off / LIKELY) ** 2)
            covariance = np.linalg.inv(agree @ slopes + np.diag([0.0, PITCH_RAD**-2]))
            step = covariance @ (agree @ off - np.array([0.0, pitch / PITCH_RAD**2]))
            place_m, pitch = place_m + step[0], pitch + step[1]
        return float(place_m), math.sqrt(covariance[0, 0])
