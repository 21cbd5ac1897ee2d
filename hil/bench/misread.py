"""What a host makes of a point in the picture whose camera, lens or blade is not where it believes.

A point of the crop's face goes through the true camera to a pixel, and from there through the
believed one to where the host takes it to be. Without errors of the belief nothing is misread.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from host.core.vehicle import Mount, Vehicle
from sim_plant.camera import CameraSpec, axes

Floats = NDArray[np.float64]
EDGE_HEIGHT_M: Final = 0.35
"""Of the stems by which the face's right end is found."""


def _camera(
    place: tuple[float, float, float],
    angles_deg: tuple[float, float, float],
    lens: tuple[float, float, float, float, float],
) -> Floats:
    """(17,): place, the axes right, down, forward (yaw, pitch, roll), focal length and centre in
    pixels, k1, k2."""
    rows = axes(*(math.radians(a) for a in angles_deg))
    return np.concatenate([place, rows.ravel(), lens])


@njit(cache=True, nogil=True)
def _read(true: Floats, believed: Floats, x: float, y: float, z: float, out: Floats) -> bool:
    """The direction, in the vehicle frame, in which the host believes a point to lie. False where
    the camera does not see it."""
    dx, dy, dz = x - true[0], y - true[1], z - true[2]
    depth = true[9] * dx + true[10] * dy + true[11] * dz
    if depth < 0.05:
        return False
    a = (true[3] * dx + true[4] * dy + true[5] * dz) / depth
    b = (true[6] * dx + true[7] * dy + true[8] * dz) / depth
    r = a * a + b * b
    bent = 1.0 + r * (true[15] + r * true[16])
    u = true[13] + true[12] * a * bent
    v = true[14] + true[12] * b * bent
    u = (u - believed[13]) / believed[12]
    v = (v - believed[14]) / believed[12]
    a, b = u, v
    for _ in range(8):
        r = a * a + b * b
        bent = 1.0 + r * (believed[15] + r * believed[16])
        a, b = u / bent, v / bent
    for k in range(3):
        out[k] = believed[9 + k] + a * believed[3 + k] + b * believed[6 + k]
    return True


@njit(cache=True, nogil=True)
def _misread(
    true: Floats,
    believed: Floats,
    blade_x: float,
    believed_blade_x: float,
    ahead: float,
    right: float,
    cutting: bool,
    out: Floats,
) -> None:
    way = np.empty(3)
    out[0], out[1] = ahead, right
    face = believed_blade_x + ahead
    if not cutting and _read(true, believed, blade_x + ahead, 0.0, 0.0, way) and way[2] < -1e-3:
        face = believed[0] - believed[2] / way[2] * way[0]
        out[0] = face - believed_blade_x
    if math.isnan(right):
        return
    if _read(true, believed, blade_x + ahead, right, EDGE_HEIGHT_M, way) and way[0] > 1e-3:
        out[1] = believed[1] + (face - believed[0]) * way[1] / way[0]


class Misreading:
    """Of one machine and what its host believes of it."""

    def __init__(self, lens: CameraSpec, blade_x_m: float, mount: Mount, vehicle: Vehicle) -> None:
        centre = (lens.width_px / 2, lens.height_px / 2)
        self._true = _camera(
            (lens.x_m, lens.y_m, lens.z_m),
            (lens.yaw_deg, lens.pitch_deg, lens.roll_deg),
            (lens.focal_px, *centre, lens.k1, lens.k2),
        )
        self._believed = _camera(
            (mount.x_m, mount.y_m, mount.z_m),
            (mount.yaw_deg, mount.pitch_deg, mount.roll_deg),
            (mount.focal, *mount.centre, mount.distortion[0], mount.distortion[1]),
        )
        self._blade = blade_x_m, vehicle.blade_x_m

    def of(self, ahead_m: float, right_m: float, *, cutting: bool) -> tuple[float, float]:
        """What the host would read as the distance ahead of its blade and as the right end's place:
        of crop that is being cut the distance is taken for known."""
        if not math.isfinite(ahead_m):
            return ahead_m, right_m
        out = np.empty(2)
        _misread(self._true, self._believed, *self._blade, ahead_m, right_m, cutting, out)
        return float(out[0]), float(out[1])
