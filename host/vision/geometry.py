"""The camera's geometry: between the vehicle frame's metres and the picture's pixels.

Vehicle frame: origin on the ground below the rear axle, x forward, y left, z up. Picture: u right,
v down. A ray is the direction, in the vehicle frame, in which a pixel looks.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from host.core.compiled import compiled
from host.core.vehicle import Mount

Array = NDArray[np.float64]


class Camera:
    """A pinhole with OpenCV's lens distortion, where a `Mount` puts it. Immutable."""

    def __init__(self, mount: Mount) -> None:
        self.mount = mount
        self.size = (mount.width_px, mount.height_px)
        self.position: Array = np.array([mount.x_m, mount.y_m, mount.z_m])
        yaw, pitch, roll = (
            math.radians(a) for a in (mount.yaw_deg, mount.pitch_deg, mount.roll_deg)
        )
        forward = np.array(
            [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch)]
        )
        level = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
        below = np.cross(forward, level)
        right = math.cos(roll) * level + math.sin(roll) * below
        down = math.cos(roll) * below - math.sin(roll) * level
        self.rotation: Array = np.stack([right, down, forward])
        """Rows are the camera's right, down and forward axes in the vehicle frame."""
        cx, cy = mount.centre
        self.matrix: Array = np.array([[mount.focal, 0, cx], [0, mount.focal, cy], [0, 0, 1.0]])
        self.distortion: Array = np.array(mount.distortion)

    def project(self, points: ArrayLike) -> Array:
        """Vehicle-frame points (..., 3) in metres to pixels (..., 2); NaN at or behind the lens."""
        p = np.asarray(points, dtype=np.float64)
        q = (p.reshape(-1, 3) - self.position) @ self.rotation.T
        uv = np.empty((len(q), 2))
        _project(q, self.mount.focal, self.mount.centre, self.distortion, uv)
        return uv.reshape(*p.shape[:-1], 2)

    def rays(self, pixels: ArrayLike) -> Array:
        """Directions (..., 3) in the vehicle frame of pixels (..., 2); not normalised."""
        px = np.asarray(pixels, dtype=np.float64)
        flat = px.reshape(-1, 1, 2)
        if self.distortion.any():
            xy = cv2.undistortPoints(flat, self.matrix, self.distortion).reshape(-1, 2)
        else:
            xy = (flat[:, 0] - self.matrix[:2, 2]) / self.matrix[0, 0]
        d = np.column_stack([xy, np.ones(len(xy))]) @ self.rotation
        return np.asarray(d.reshape(*px.shape[:-1], 3))

    def on_height(self, pixels: ArrayLike, z_m: float) -> Array:
        """(x, y) where pixels (..., 2) meet the horizontal plane at height `z_m`; NaN where their
        rays never do (at the horizon or on its other side)."""
        return self.rays_on_height(self.rays(pixels), z_m)

    def rays_on_height(self, rays: Array, z_m: float) -> Array:
        """The same of rays (..., 3) that are known already."""
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (z_m - self.position[2]) / rays[..., 2]
        t = np.where((t > 0) & np.isfinite(t), t, np.nan)
        return np.asarray(self.position[:2] + t[..., None] * rays[..., :2])

    def upright_vanishing_point(self) -> tuple[float, float] | None:
        """Pixel in which the images of all true verticals meet (lens distortion left out); None for
        a level camera, whose verticals stay parallel."""
        down = self.rotation @ np.array([0.0, 0.0, -1.0])
        if abs(down[2]) < 1e-9:
            return None
        f = self.matrix[0, 0]
        return (
            float(self.matrix[0, 2] + f * down[0] / down[2]),
            float(self.matrix[1, 2] + f * down[1] / down[2]),
        )

    def lean_rad(self, pixels: ArrayLike) -> Array:
        """How far a true vertical through each pixel (..., 2) leans in the picture, positive where
        its upper end leans to the right."""
        px = np.asarray(pixels, dtype=np.float64)
        point = self.upright_vanishing_point()
        if point is None:
            down = self.rotation @ np.array([0.0, 0.0, -1.0])
            return np.full(px.shape[:-1], math.atan2(-down[0], down[1]))
        du, dv = point[0] - px[..., 0], point[1] - px[..., 1]
        upward = np.where(dv < 0, 1.0, -1.0)
        return np.asarray(np.arctan2(upward * du, -upward * dv))

    def stem_rows_px(self, height_m: float) -> NDArray[np.float32]:
        """For every picture row, the rows that a stem of `height_m` covers whose foot is seen there
        (middle column, level ground); 0 at and above the horizon."""
        _, h = self.size
        v = np.arange(h, dtype=np.float64)
        uv = np.column_stack([np.full(h, self.matrix[0, 2]), v])
        ground = self.on_height(uv, 0.0)
        seen = np.isfinite(ground[:, 0])
        rows = np.zeros(h, np.float32)
        if seen.any():
            top = np.column_stack([ground[seen], np.full(int(seen.sum()), height_m)])
            rows[seen] = np.maximum(0.0, v[seen] - self.project(top)[:, 1])
        return rows


@compiled("(f8[:, ::1], f8, UniTuple(f8, 2), f8[::1], f8[:, ::1])")
def _project(
    points: Array, focal: float, centre: tuple[float, float], distortion: Array, uv: Array
) -> None:
    """Points (n, 3) in the camera's axes to pixels (n, 2), NaN at or behind the lens: as
    cv2.projectPoints, which takes ten times as long for a few."""
    k1, k2, p1, p2, k3 = distortion
    for i in range(points.shape[0]):
        depth = points[i, 2]
        if not depth > 1e-6:
            uv[i] = np.nan
            continue
        x, y = points[i, 0] * (1.0 / depth), points[i, 1] * (1.0 / depth)
        r2 = x * x + y * y
        r4 = r2 * r2
        radial = 1.0 + k1 * r2 + k2 * r4 + k3 * (r4 * r2)
        xy = 2.0 * x * y
        u = x * radial + p1 * xy + p2 * (r2 + 2.0 * x * x)
        v = y * radial + p1 * (r2 + 2.0 * y * y) + p2 * xy
        uv[i, 0], uv[i, 1] = u * focal + centre[0], v * focal + centre[1]
