"""Whether a mount, as the vehicle's file has it, can show what the detectors look for."""

from __future__ import annotations

import numpy as np

from host.core.errors import UserError
from host.core.vehicle import Mount, Vehicle
from host.core.vehicle_file import mount_of
from host.vision.geometry import Camera
from host.vision.view import BESIDE_AHEAD_M


def check_view(camera: Camera, vehicle: Vehicle) -> None:
    """UserError where neither foot nor top of the crop before the blade's middle lies in the
    picture, or an end of the blade does not lie before the lens."""
    line_m, half_m = vehicle.blade_x_m, vehicle.blade_width_m / 2
    blade = camera.project([[line_m, -half_m, 0.0], [line_m, half_m, 0.0]])
    ahead_m, top_m = line_m + BESIDE_AHEAD_M, vehicle.crop_height_m
    crop = camera.project([[ahead_m, 0.0, 0.0], [ahead_m, 0.0, top_m]])
    shown = ((crop >= 0) & (crop < camera.size)).all(axis=1).any()
    if shown and np.isfinite(blade).all():
        return
    mount = camera.mount
    raise UserError(
        f"the camera cannot show the blade's way {BESIDE_AHEAD_M:g} m ahead of it: at x_m "
        f"{mount.x_m:g} and z_m {mount.z_m:g} it looks down by pitch_deg {mount.pitch_deg:g} and "
        f"left by yaw_deg {mount.yaw_deg:g}; correct the mount, or wheelbase_m and blade_ahead_m, "
        "in the vehicle file"
    )


def seeing_mount(vehicle: Vehicle, name: str) -> Mount:
    """A mount by its name. UserError names those that there are, or says why it cannot show what
    the detectors look for."""
    mount = mount_of(vehicle, name)
    check_view(Camera(mount), vehicle)
    return mount
