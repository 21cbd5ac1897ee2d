"""What the camera shows while the machine rolls straight on: how it is really mounted, and how late
its pictures come.

Stubble beside the crop is a plane. Points on it, tracked from one picture to another, must move as
the mount's angles and the distance rolled say; the angles that explain their movement best are the
camera's. Lucas-Kanade tracks, least squares with a robust loss.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from host.core.vehicle import Mount
from host.vision.geometry import Camera

APART_M: Final = (0.08, 0.3)
"""Distance rolled between the two pictures of a pair."""
NEAR_M: Final = 3.6
"""Ground farther ahead moves too little, and a gap's far side bears crop."""
BESIDE_M: Final = (0.9, 2.6)
"""To the right, where no crop stands: beyond the machine, short of the neighbour's."""
POINTS: Final = 150
TRACKED: Final = 25
"""Fewer points say nothing."""
PAIRS: Final = 5
SHARE: Final = 0.15
"""How well the way between two pictures is known, as a share of it."""
CURVED_1PM: Final = 0.05
"""Curvature of a way that is meant to be straight: 3 degrees at the front wheel."""
ROLL_DEG: Final = 1.0
"""How much a camera is tilted sideways, commonly: ground on one side tells little of it."""
FEW_PICTURES: Final = 8
SLOWEST_MPS: Final = 0.05
LAGS_S: Final = (-0.1, 1.5, 0.02)
UNLIKE: Final = 0.1
"""Share of the way seen by which wheels and picture may differ for the delay to be known."""


@dataclass(frozen=True, slots=True)
class Rolled:
    """One picture while rolling. `stamp`: when it came; `distance_m`: rolled since the start."""

    stamp: float
    distance_m: float
    grey: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Mounted:
    """What the camera's angles are off by, in degrees, and how well that explains the movement."""

    pitch_deg: float
    yaw_deg: float
    roll_deg: float
    residual_px: float
    points: int


def _follow(a: NDArray[np.uint8], b: NDArray[np.uint8], points: Any) -> Any:
    lucas_kanade: Any = cv2.calcOpticalFlowPyrLK
    return lucas_kanade(a, b, points, None, winSize=(21, 21), maxLevel=4)


def _tracks(
    first: NDArray[np.uint8], second: NDArray[np.uint8], camera: Camera
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pixels of the same ground in both pictures, on the machine's right, where no crop stands."""
    height, width = first.shape
    v, u = np.mgrid[0:height:8, 0:width:8]
    ground = camera.on_height(np.dstack([u, v]).astype(np.float64), 0.0)
    x, y = ground[..., 0], ground[..., 1]
    good = np.isfinite(x) & (x < NEAR_M) & (y < -BESIDE_M[0]) & (y > -BESIDE_M[1])
    mask = np.kron(good.astype(np.uint8) * 255, np.ones((8, 8), np.uint8))[:height, :width]
    found_corners: Any = cv2.goodFeaturesToTrack(first, POINTS, 0.01, 6, mask=mask)
    corners = found_corners
    if corners is None:
        return np.zeros((0, 2)), np.zeros((0, 2))
    found, status, _ = _follow(first, second, corners)
    back, again, _ = _follow(second, first, found)
    same = np.hypot(*(back - corners).reshape(-1, 2).T) < 0.7
    fine = (status.ravel() == 1) & (again.ravel() == 1) & same
    return corners.reshape(-1, 2)[fine].astype(float), found.reshape(-1, 2)[fine].astype(float)


def mounted(pictures: Sequence[Rolled], mount: Mount) -> Mounted | None:
    """The camera's angles against the mount's. None where too little of the ground was tracked."""
    camera = Camera(mount)
    pairs: list[tuple[NDArray[np.float64], NDArray[np.float64], float]] = []
    for k, second in enumerate(pictures):
        first = next(
            (
                p
                for p in pictures[:k]
                if APART_M[0] <= second.distance_m - p.distance_m <= APART_M[1]
            ),
            None,
        )
        if first is None:
            continue
        a, b = _tracks(first.grey, second.grey, camera)
        if len(a) >= TRACKED:
            pairs.append((a, b, second.distance_m - first.distance_m))
    pairs = pairs[:: max(1, len(pairs) // PAIRS)]
    if not pairs:
        return None

    count = len(pairs)

    def view_of(off: NDArray[np.float64]) -> Camera:
        return Camera(
            mount.model_copy(
                update={
                    "pitch_deg": mount.pitch_deg + off[0],
                    "yaw_deg": mount.yaw_deg + off[1],
                    "roll_deg": mount.roll_deg + off[2],
                }
            )
        )

    def misses(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        view = view_of(unknown[:3])
        out = []
        for (a, b, distance), share in zip(pairs, unknown[4:], strict=True):
            ground = view.on_height(a, 0.0)
            way = distance * share
            turned = unknown[3] * way
            x, y = ground[:, 0] - way, ground[:, 1] - turned * way / 2
            ahead = np.column_stack([x + turned * y, y - turned * x, np.zeros(len(a))])
            out.append(np.nan_to_num(view.project(ahead) - b, nan=50.0).ravel())
        return np.concatenate(out)

    def residuals(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        # A picture comes late by more or less: the way between two is known roughly only.
        # And a wheel that stands straight by its pot leads a little aside.
        known = [(unknown[4:] - 1) / SHARE, unknown[2:3] / ROLL_DEG, unknown[3:4] / CURVED_1PM]
        return np.concatenate([misses(unknown), *known])

    begin = np.concatenate([np.zeros(4), np.ones(count)])
    fit = least_squares(residuals, begin, loss="soft_l1", f_scale=1.0, max_nfev=60)
    away = np.abs(misses(fit.x))
    pitch, yaw, roll = (float(value) for value in fit.x[:3])
    return Mounted(pitch, yaw, roll, float(np.median(away)), sum(len(a) for a, _, _ in pairs))


def delay_s(
    pictures: Sequence[tuple[float, NDArray[np.uint8]]],
    speeds: Sequence[tuple[float, float]],
    mount: Mount,
) -> float | None:
    """How much later the ground in the picture moves than the wheels do. `pictures`: (arrival,
    grey); `speeds`: (stamp, m/s), from rest to rolling. None where the ground does not tell."""
    if len(pictures) < FEW_PICTURES or max((abs(v) for _, v in speeds), default=0.0) < SLOWEST_MPS:
        return None
    camera = Camera(mount)
    at, steps = [], []
    for (_, first), (arrived, second) in itertools.pairwise(pictures):
        a, b = _tracks(first, second, camera)
        if len(a) >= TRACKED // 3:
            at.append(arrived)
            steps.append(np.median(b - a, axis=0))
    if len(at) < FEW_PICTURES:
        return None
    moved = np.array(steps)
    # The machine shakes: only what adds up is its way.
    way = moved[len(moved) // 2 :].mean(0)
    gone = np.cumsum(moved @ (way / max(1e-9, float(np.hypot(*way)))))
    stamps, speed = np.array(speeds).T
    rolled = np.concatenate([[0.0], np.cumsum(np.abs(speed[1:]) * np.diff(stamps))])
    lags = np.arange(*LAGS_S)
    misses = [_miss(gone, np.interp(np.array(at) - lag, stamps, rolled)) for lag in lags]
    best = int(np.argmin(misses))
    return float(lags[best]) if misses[best] < UNLIKE * float(np.ptp(gone)) else None


def _miss(seen: NDArray[np.float64], rolled: NDArray[np.float64]) -> float:
    """rms distance of `seen` from what is proportional to `rolled`."""
    table = np.column_stack([rolled, np.ones(len(rolled))])
    share, *_ = np.linalg.lstsq(table, seen, rcond=None)
    return float(np.sqrt(np.mean((seen - table @ share) ** 2)))
