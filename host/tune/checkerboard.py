"""Lens and mount from pictures of a printed checkerboard.

Lens: several pictures of the board held at many angles. Mount: one picture of the board lying on
the ground at a measured place ahead of the machine, its longer side square to the machine's
length."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from host.core.errors import UserError
from host.core.vehicle import Mount
from host.vision.pictures import Picture

LEAST_PICTURES = 5
"""Fewer leave focal length and distortion undetermined."""
SUBPIXEL = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
"""When the refinement of a corner ends: 40 rounds, or less than a thousandth of a pixel."""
LARGER = 2
"""How much larger a picture is drawn in which no board is found at first."""
WITHIN_PX = 5
"""About a corner, at most, and"""
NEXT_CORNER = 0.4
"""share of the way to the next one."""


@dataclass(frozen=True, slots=True)
class Board:
    """Inner corners along and across, and the squares' side."""

    columns: int = 9
    rows: int = 6
    square_m: float = 0.04

    def points(self) -> NDArray[np.float32]:
        """(n, 3) corners in the board's plane, as `corners` orders them."""
        grid = np.mgrid[0 : self.columns, 0 : self.rows].T.reshape(-1, 2)
        return np.column_stack([grid * self.square_m, np.zeros(len(grid))]).astype(np.float32)


@dataclass(frozen=True, slots=True)
class Lens:
    """Intrinsics of one picture size."""

    size: tuple[int, int]
    focal_px: float
    centre_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float]
    error_px: float
    """Root mean square distance between seen and computed corners."""


def corners(bgr: Picture, board: Board) -> NDArray[np.float32] | None:
    """(n, 2) inner corners to a fraction of a pixel; None where the board is not seen whole."""
    grey = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
    # A board that lies before a low camera is a few pixels high for each row.
    for larger in (1, LARGER):
        size = (larger * grey.shape[1], larger * grey.shape[0])
        drawn = grey if larger == 1 else cv2.resize(grey, size, interpolation=cv2.INTER_CUBIC)
        found, points = cv2.findChessboardCorners(drawn, (board.columns, board.rows))
        if found:
            within = _within_px(np.asarray(points, np.float32), board)
            fine = cv2.cornerSubPix(drawn, points, (within, within), (-1, -1), SUBPIXEL)
            return np.asarray((fine.reshape(-1, 2) + 0.5) / larger - 0.5, np.float32)
    return None


def _within_px(points: NDArray[np.float32], board: Board) -> int:
    """How far about a corner it is sought to a fraction of a pixel: not as far as the next one."""
    grid = points.reshape(board.rows, board.columns, 2)
    apart = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
    return int(np.clip(NEXT_CORNER * min(apart), 1, WITHIN_PX))


def calibrate_lens(
    seen: Sequence[NDArray[np.float32]], size: tuple[int, int], board: Board
) -> Lens:
    """The lens from the corners of at least five pictures of one size; square pixels."""
    if len(seen) < LEAST_PICTURES:
        raise UserError(
            f"the board was found whole in {len(seen)} pictures, {LEAST_PICTURES} are needed; take "
            "more, sharp, at different angles and places, and check --columns and --rows"
        )
    start = np.array([[size[0], 0, size[0] / 2], [0, size[0], size[1] / 2], [0, 0, 1]], np.float64)
    error, matrix, lens, _, _ = cv2.calibrateCamera(
        [board.points()] * len(seen),
        [points.reshape(-1, 1, 2) for points in seen],
        size,
        start,
        np.zeros(5),
        flags=cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_USE_INTRINSIC_GUESS,
    )
    k1, k2, p1, p2, k3 = (float(k) for k in np.asarray(lens).ravel()[:5])
    return Lens(
        size,
        float(matrix[0, 0]),
        (float(matrix[0, 2]), float(matrix[1, 2])),
        (k1, k2, p1, p2, k3),
        float(error),
    )


def calibrate_mount(
    seen: NDArray[np.float32], lens: Lens, board: Board, ahead_m: float, left_m: float = 0.0
) -> Mount:
    """Where the camera sits, from a board on the ground whose middle is `ahead_m` ahead of the rear
    axle and `left_m` to the left, its longer side across the machine."""
    flat = board.points()[:, :2]
    middle = 0.5 * board.square_m * np.array([board.columns - 1, board.rows - 1])
    candidates = []
    # the corners' order may start at any corner of the board: columns run left or right
    for sign in (-1.0, 1.0):
        ground = np.column_stack(
            [
                ahead_m - sign * (flat[:, 1] - middle[1]),
                left_m - sign * (flat[:, 0] - middle[0]),
                np.zeros(len(flat)),
            ]
        )
        matrix = np.array(
            [
                [lens.focal_px, 0, lens.centre_px[0]],
                [0, lens.focal_px, lens.centre_px[1]],
                [0, 0, 1],
            ]
        )
        good, turn, shift = cv2.solvePnP(ground, seen, matrix, np.array(lens.distortion))
        if not good:
            continue
        rotation, _ = cv2.Rodrigues(turn)
        position = (-rotation.T @ shift).ravel()
        forward = rotation[2]
        if position[2] > 0 and forward[0] > 0:
            candidates.append((position, np.asarray(rotation, np.float64)))
    if not candidates:
        raise UserError(
            "the board gives no camera above ground that looks ahead; lay it flat on the ground "
            "with its longer side across the machine and measure --ahead again"
        )
    position, rotation = candidates[0]
    right, _, forward = rotation
    pitch = math.asin(-forward[2])
    yaw = math.atan2(forward[1], forward[0])
    level = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
    below = np.cross(forward, level)
    roll = math.atan2(float(right @ below), float(right @ level))
    width, height = lens.size
    try:
        return Mount(
            x_m=round(float(position[0]), 4),
            y_m=round(float(position[1]), 4),
            z_m=round(float(position[2]), 4),
            pitch_deg=round(math.degrees(pitch), 3),
            yaw_deg=round(math.degrees(yaw), 3),
            roll_deg=round(math.degrees(roll), 3),
            width_px=width,
            height_px=height,
            hfov_deg=round(2 * math.degrees(math.atan(width / 2 / lens.focal_px)), 3),
            focal_px=round(lens.focal_px, 3),
            centre_px=(round(lens.centre_px[0], 3), round(lens.centre_px[1], 3)),
            distortion=lens.distortion,
        )
    except ValidationError as error:
        raise UserError(
            f"the camera would sit {position[2]:.2f} m above the ground, {position[0]:.2f} m ahead "
            f"of the rear axle and {position[1]:.2f} m to the left, with a field of view of "
            f"{2 * math.degrees(math.atan(width / 2 / lens.focal_px)):.0f} degrees: that is no "
            "reaper's; measure --square, --ahead and --left again, in metres"
        ) from error
