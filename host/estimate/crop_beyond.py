"""How far before the blade the next crop stands, by looks from several places on the way to it.

A picture shows under which angle below the horizon its foot stands. That is off by the camera's
pitch: its mount's, and that of the ground which the machine stands on, within half a metre much the
same. And it shows how high the crop looks, which no pitch changes, but the next crop need not be as
high as the field's. So looks from different distances tell the distance, the pitch and how much
higher it is: least squares by Gauss and Newton. A tuft of grass before the crop makes a look quite
another; such a one counts the less, the farther it is from what the others show.
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
HIGHER: Final = 0.12
"""How much higher or lower than the field's the next crop may be, as a share;"""
TOPS: Final = 0.06
"""and by which a look errs in how high it is: 0.2 m at 2 m, in 193 pictures of eleven drives."""
LIKELY: Final = 2.0
"""Standard deviations within which a look agrees with the others."""
STEPS: Final = 12
"""Of Gauss and Newton: by then it has settled to a centimetre."""


class CropBeyond:
    """Of one stand, and the places that the machine goes to from it."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._blade_m = vehicle.blade_x_m
        """Before the rear axle, near which the cameras sit."""
        self._looks: list[tuple[float, float, float]] = []

    def see(self, at_m: float, ahead_m: float, by_height_m: float = math.nan) -> None:
        """A look from at_m nearer than the first place shows it ahead_m before the blade, and
        by_height_m if it is as high as the field's crop."""
        self._looks.append((at_m, ahead_m, by_height_m))

    @property
    def known(self) -> tuple[float, float] | None:
        """How far before the blade at the first place it stands, and how surely, m; None without a
        look."""
        if not self._looks:
            return None
        at, ahead, by_height = np.array(self._looks).T
        shown = np.arctan2(HEIGHT_M, self._blade_m + ahead)
        high = np.isfinite(by_height)
        apart = np.log(np.maximum(self._blade_m + by_height[high], HEIGHT_M))
        place_m, pitch, higher = float(np.median(at + ahead)), 0.0, 0.0
        prior = np.array([0.0, PITCH_RAD**-2, HIGHER**-2])
        covariance = np.eye(3)
        for _ in range(STEPS):
            far = np.maximum(self._blade_m + place_m - at, HEIGHT_M)
            per_m = HEIGHT_M / (far**2 + HEIGHT_M**2)
            noise = np.hypot(UNEVEN_RAD, FOOT_M * per_m)
            flat, one = np.zeros(len(at)), np.ones(len(at))
            foot = np.column_stack([-per_m, one, flat]) / noise[:, None]
            tops = np.column_stack([1.0 / far, flat, -one])[high] / TOPS
            off = np.concatenate(
                [
                    (shown - np.arctan2(HEIGHT_M, far) - pitch) / noise,
                    (apart - np.log(far[high]) + higher) / TOPS,
                ]
            )
            slopes = np.concatenate([foot, tops])
            agree = slopes.T / (1.0 + (off / LIKELY) ** 2)
            covariance = np.linalg.inv(agree @ slopes + np.diag(prior))
            step = covariance @ (agree @ off - prior * np.array([0.0, pitch, higher]))
            place_m, pitch, higher = np.array([place_m, pitch, higher]) + step
        return float(place_m), math.sqrt(covariance[0, 0])
