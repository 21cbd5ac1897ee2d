"""What the camera shows while the machine rolls straight on: how it is really mounted, and how late
its pictures come.

Everything that stands flows away from one point of the picture: the one towards which the camera
moves. Where it lies tells pitch and yaw, whatever the distance and the height of what is seen. Two
things besides the way forward move a camera on a machine: the body rolls and pitches over uneven
ground, and swings the camera with it (1 degree on a mast of 1.6 m is 3 cm, as much as 6 degrees of
yaw over 0.25 m); and a wheel that is meant to stand straight leads a little aside. Both turn the
picture as well, and are estimated with it. The roll is told by the ground beside the crop, a plane.
Lucas-Kanade tracks, least squares with a robust loss.
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

Pixels = NDArray[np.float64]

WAY_M: Final = 0.25
"""Rolled between the two pictures of a pair."""
PAIRS: Final = 6
CORNERS: Final = 700
"""Points that are followed from the first picture of a pair on."""
BACK_PX: Final = 0.5
"""A point that is followed there and back again ends so near to where it began, or is dropped."""
FOCUS_RAD: Final = 0.02
"""Nearer to the point that everything flows away from, a movement has no direction."""
SWAY_DEG: Final = (0.5, 0.5, 0.3)
"""Roll, pitch and yaw of the body over a pair's way, commonly."""
CURVED_1PM: Final = 0.03
"""Curvature of a way that is meant to be straight: 2 degrees at the front wheel."""
NEAR_M: Final = 3.6
"""Ground farther ahead moves too little, and a gap's far side bears crop."""
BESIDE_M: Final = (0.9, 2.6)
"""To the right, where no crop stands: beyond the machine, short of the neighbour's."""
POINTS: Final = 150
TRACKED: Final = 25
"""Fewer points say nothing."""
SHARE: Final = 0.15
"""How well the way between two pictures is known, as a share of it."""
ROLL_DEG: Final = 1.0
"""How much a camera is tilted sideways, commonly: ground on one side tells little of it."""
FEW_PICTURES: Final = 8
LEAST_M: Final = 0.2
"""A shorter way tells nothing of when it was rolled."""
LAGS_S: Final = (-0.2, 1.5, 0.02)
"""Among which the delay is sought. Pulses come up to one late: a sensor with 20 of them a metre may
seem a quarter of a second slower than it is."""
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
    return lucas_kanade(a, b, points, None, winSize=(15, 15), maxLevel=3)


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


@dataclass(frozen=True, slots=True)
class _Pair:
    """Pixels of the same points in two pictures, and the way rolled between them."""

    a: Pixels
    b: Pixels
    way_m: float


def _followed(greys: Sequence[NDArray[np.uint8]]) -> tuple[Pixels, Pixels]:
    """Points of the first picture, followed through all the others to the last."""
    corners: Any = cv2.goodFeaturesToTrack(greys[0], CORNERS, 0.003, 5)
    if corners is None:
        return np.zeros((0, 2)), np.zeros((0, 2))
    fine = np.ones(len(corners), bool)
    points = corners
    for first, second in itertools.pairwise(greys):
        found, status, _ = _follow(first, second, points)
        back, again, _ = _follow(second, first, found)
        same = np.hypot(*(back - points).reshape(-1, 2).T) < BACK_PX
        fine &= (status.ravel() == 1) & (again.ravel() == 1) & same
        points = found
    return corners.reshape(-1, 2)[fine].astype(float), points.reshape(-1, 2)[fine].astype(float)


def _pairs(pictures: Sequence[Rolled], camera: Camera) -> list[_Pair]:
    """From the beginning of the way to its end. Only what is lower than the camera: ears above it
    sway, and hide or show what is behind them. In 22 rolls with drawn mounts they turned the low
    camera's yaw by 1.1 degrees; without them it errs by 0.3."""
    ways = np.array([picture.distance_m for picture in pictures])
    if not len(ways) or ways[-1] < WAY_M:
        return []
    found = []
    for begin in np.linspace(ways[0], ways[-1] - WAY_M, PAIRS):
        first = int(np.searchsorted(ways, begin, "right")) - 1
        last = int(np.searchsorted(ways, ways[first] + WAY_M))
        if last >= len(ways):
            continue
        a, b = _followed([picture.grey for picture in pictures[first : last + 1]])
        lower = camera.rays(a)[:, 2] < 0.0 if len(a) else np.zeros(0, np.bool_)
        a, b = a[lower], b[lower]
        if len(a) >= TRACKED:
            found.append(_Pair(a, b, float(ways[last] - ways[first])))
    return found


def _turned(mount: Mount, off_deg: Pixels, roll_deg: float) -> Camera:
    """The camera so much farther round; `off_deg`: pitch and yaw."""
    off = {"pitch_deg": off_deg[0], "yaw_deg": off_deg[1], "roll_deg": roll_deg}
    return Camera(mount.model_copy(update={k: getattr(mount, k) + v for k, v in off.items()}))


def _unit(rays: Pixels) -> Pixels:
    return np.asarray(rays / np.linalg.norm(rays, axis=1)[:, None])


def _flow(pairs: Sequence[_Pair], camera: Camera) -> tuple[Pixels, Pixels, float]:
    """(pitch and yaw that the camera is off by (rad), how the body turned over each pair (pairs, 3)
    (rad), the median miss in pixels)."""
    rays = [(_unit(camera.rays(pair.a)), _unit(camera.rays(pair.b))) for pair in pairs]
    focal, count = camera.mount.focal, len(pairs)
    up = np.array([0.0, 0.0, 1.0])

    def sways(unknown: Pixels) -> Pixels:
        ways = np.array([pair.way_m for pair in pairs])
        return np.asarray(unknown[3:].reshape(-1, 3) + np.outer(ways * unknown[2], up))

    def misses(unknown: Pixels) -> Pixels:
        out = []
        for (a, b), pair, sway in zip(rays, pairs, sways(unknown), strict=True):
            way = np.array([1.0, -unknown[1], unknown[0]])
            way = way + np.cross(sway, camera.position) / pair.way_m
            still = a - np.cross(sway, a)
            across = np.cross(way / np.linalg.norm(way), still)
            out.append((b * across).sum(1) / np.maximum(np.linalg.norm(across, axis=1), FOCUS_RAD))
        return np.concatenate(out) * focal

    def residuals(unknown: Pixels) -> Pixels:
        known = unknown[3:].reshape(-1, 3) / np.radians(SWAY_DEG)
        return np.concatenate([misses(unknown), known.ravel(), unknown[2:3] / CURVED_1PM])

    fit = least_squares(residuals, np.zeros(3 + 3 * count), loss="soft_l1", f_scale=0.5, ftol=1e-4)
    return fit.x[:2], sways(fit.x), float(np.median(np.abs(misses(fit.x))))


def _roll_deg(pairs: Sequence[_Pair], mount: Mount, off_deg: Pixels, sways: Pixels) -> float:
    """How much the camera is tilted sideways, from the ground at the right."""
    camera = _turned(mount, off_deg, 0.0)
    lying = []
    for pair, sway in zip(pairs, sways, strict=True):
        ground = camera.on_height(pair.a, 0.0)
        x, y = ground[:, 0], ground[:, 1]
        beside = np.isfinite(x) & (x < NEAR_M) & (y < -BESIDE_M[0]) & (y > -BESIDE_M[1])
        lying.append((pair.a[beside], pair.b[beside], pair.way_m, sway))

    def residuals(unknown: Pixels) -> Pixels:
        view = _turned(mount, off_deg, unknown[0])
        out = [unknown[:1] / ROLL_DEG, (unknown[1:] - 1) / SHARE]
        for (a, b, way, sway), share in zip(lying, unknown[1:], strict=True):
            if not len(a):
                continue
            seen = view.on_height(a, 0.0)
            there = np.column_stack([seen, np.zeros(len(seen))]) - np.array([way * share, 0, 0])
            ahead = there - np.cross(sway, there)
            out.append(np.nan_to_num(view.project(ahead) - b, nan=50.0).ravel())
        return np.concatenate(out)

    begin = np.concatenate([np.zeros(1), np.ones(len(pairs))])
    return float(least_squares(residuals, begin, loss="soft_l1", ftol=1e-4).x[0])


def mounted(pictures: Sequence[Rolled], mount: Mount) -> Mounted | None:
    """The camera's angles against the mount's. None where too little was tracked."""
    pairs = _pairs(pictures, Camera(mount))
    if not pairs:
        return None
    off, sways, miss = _flow(pairs, Camera(mount))
    pitch, yaw = np.degrees(off)
    roll = _roll_deg(pairs, mount, np.array([pitch, yaw]), sways)
    return Mounted(float(pitch), float(yaw), roll, miss, sum(len(pair.a) for pair in pairs))


def delay_s(
    pictures: Sequence[tuple[float, NDArray[np.uint8]]],
    ways: Sequence[tuple[float, float]],
    mount: Mount,
) -> float | None:
    """How much later the ground in the picture moves than the wheels do. `pictures`: (arrival,
    grey); `ways`: (stamp, m rolled by the wheels' pulses), from rest to rolling: a speed is known
    only once pulses have been timed. None where the ground does not tell."""
    if len(pictures) < FEW_PICTURES or len(ways) < FEW_PICTURES:
        return None
    stamps, rolled = np.array(ways).T
    if np.ptp(rolled) < LEAST_M:
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
    lags = np.arange(*LAGS_S)
    misses = [_miss(gone, np.interp(np.array(at) - lag, stamps, rolled)) for lag in lags]
    best = int(np.argmin(misses))
    found = 0 < best < len(lags) - 1 and misses[best] < UNLIKE * float(np.ptp(gone))
    return max(0.0, float(lags[best])) if found else None


def _miss(seen: NDArray[np.float64], rolled: NDArray[np.float64]) -> float:
    """rms distance of `seen` from what is proportional to `rolled`."""
    table = np.column_stack([rolled, np.ones(len(rolled))])
    share, *_ = np.linalg.lstsq(table, seen, rcond=None)
    return float(np.sqrt(np.mean((seen - table @ share) ** 2)))
