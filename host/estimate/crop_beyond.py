"""How far before the blade the next crop stands, by looks from several places on the way to it.

A picture shows under which angle below the horizon its foot stands. That is off by the camera's
pitch: its mount's, and that of the ground which the machine stands on, within half a metre much the
same. And it shows how high the crop looks, which no pitch changes, but the next crop need not be as
high as the field's. So looks from different distances tell the distance, the pitch and how much
higher it is: least squares by Gauss and Newton. A tuft of grass before the crop makes a look quite
another; such a one counts the less, the farther it is from what the others show.

Where looks show several places, which do the tufts stand at, and which does the crop? Each place is
tried, and the one that explains all looks best is taken: a tuft hides what stands behind it, and
hardly anything lets a place be seen through the crop. Until one explains them by far the best, the
place is not known.
"""

from __future__ import annotations

import math
from statistics import median
from typing import Final

import numpy as np

from host.core.vehicle import LOW, Vehicle
from host.estimate.kalman import Array

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
"""Standard deviations within which how high it looks agrees with the rest."""
STEPS: Final = 12
"""Of Gauss and Newton: by then it has settled to a centimetre."""
TUFT: Final = 0.05
"""Probability that a look shows something nearer than the crop: 4 of 95 of the model eyes' drives.
"""
AGAIN: Final = 0.3
"""That another look shows the same tuft, or what a blade has left of the crop's last tip;"""
SAME_M: Final = 0.4
"""within which it does."""
THROUGH: Final = 0.005
"""That it shows something farther: none of these did by half a metre."""
AS_SAID: Final = 0.9
"""Probability that the next crop stands where it was said to;"""
SAID_M: Final = 0.25
"""give or take so much;"""
ANYWHERE_M: Final = 3.0
"""and otherwise anywhere in this."""
SPREAD_RAD: Final = math.radians(20.0)
"""Over which such a look may show anything."""
RIVAL: Final = math.log(20.0)
"""By less than that factor likelier, a place is not surely the one;"""
APART_M: Final = 0.5
"""than another that is so far away."""


class CropBeyond:
    """Of one stand, and the places that the machine goes to from it."""

    def __init__(self, vehicle: Vehicle, said_m: float = math.inf) -> None:
        """`said_m`: how far before the blade at the first place it should stand."""
        self._said_m = said_m
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
        look. What was said only decides between places that explain the looks alike."""
        if not self._looks:
            return None
        shown = [at + ahead for at, ahead, _ in self._looks]
        fits = [self._fit(place_m) for place_m in (median(shown), *shown)]
        place_m, sigma_m, best = max(fits, key=lambda fit: fit[2])
        apart_m = max(abs(other - place_m) for other, _, likely in fits if best - likely < RIVAL)
        return place_m, math.hypot(sigma_m, apart_m) if apart_m > APART_M else sigma_m

    def _fit(self, place_m: float) -> tuple[float, float, float]:
        """The place that least squares come to from one nearby, how surely, m, and the logarithm of
        how likely all looks are there."""
        at, ahead, by_height = np.array(self._looks).T
        shown = np.arctan2(HEIGHT_M, self._blade_m + ahead)
        high = np.isfinite(by_height)
        apart = np.log(np.maximum(self._blade_m + by_height[high], HEIGHT_M))
        pitch, higher = 0.0, 0.0
        flat, one = np.zeros(len(at)), np.ones(len(at))
        prior = np.array([0.0, PITCH_RAD**-2, HIGHER**-2])
        covariance = np.eye(3)
        for _ in range(STEPS):
            far = np.maximum(self._blade_m + place_m - at, HEIGHT_M)
            per_m = HEIGHT_M / (far**2 + HEIGHT_M**2)
            noise = np.hypot(UNEVEN_RAD, FOOT_M * per_m)
            off = (shown - np.arctan2(HEIGHT_M, far) - pitch) / noise
            tops_off = (apart - np.log(far[high]) + higher) / TOPS
            slopes = np.column_stack([-per_m, one, flat]) / noise[:, None]
            tops = np.column_stack([1.0 / far, flat, -one])[high] / TOPS
            usual, odd = _explained(off, noise)
            agrees = usual / (usual + odd)
            agree = slopes.T * agrees
            tops_agree = tops.T * agrees[high] / (1.0 + (tops_off / LIKELY) ** 2)
            covariance = np.linalg.inv(agree @ slopes + tops_agree @ tops + np.diag(prior))
            step = agree @ off + tops_agree @ tops_off - prior * np.array([0.0, pitch, higher])
            place_m, pitch, higher = np.array([place_m, pitch, higher]) + covariance @ step
        # What stands nearer than the crop is one tuft in all the looks that show it there.
        tuft_at, tufts = (at + ahead)[(off > 0.0) & (odd > usual)], 0.0
        if len(tuft_at) > 1:
            same = np.abs(tuft_at - np.median(tuft_at)) < SAME_M
            tufts = max(0, same.sum() - 1) * math.log(AGAIN * float(usual.max() / odd.max()))
        explained = float(np.log(usual + odd).sum()) + tufts - (pitch / PITCH_RAD) ** 2 / 2
        return float(place_m), math.sqrt(covariance[0, 0]), explained + self._expected(place_m)

    def _expected(self, place_m: float) -> float:
        """The logarithm of how likely it is to stand there by what was said."""
        if math.isinf(self._said_m):
            return 0.0
        off = (place_m - self._said_m) / SAID_M
        said = AS_SAID * math.exp(-off * off / 2) / (math.sqrt(math.tau) * SAID_M)
        return math.log(said + (1.0 - AS_SAID) / ANYWHERE_M)


def _explained(off: Array, noise_rad: Array) -> tuple[Array, Array]:
    """(n,) each, 1/rad: how likely looks that are so many standard deviations off are, as looks at
    the crop, and as such at something else."""
    usual = (1.0 - TUFT) * np.exp(-(off**2) / 2) / (math.sqrt(math.tau) * noise_rad)
    return usual, np.where(off > 0.0, TUFT, THROUGH) / SPREAD_RAD
