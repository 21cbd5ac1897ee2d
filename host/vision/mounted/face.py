"""The face of the standing crop, in metres, from a picture of its upright stems.

While cutting, the crop ahead ends in a face across the vehicle's path at the blade's line; after a
turn the face stands further ahead. Its foot tells the distance, its right end is E_outer. Both come
from where stems stand, so that neither the crop's height nor the camera's side of it matters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import Vehicle
from host.vision.geometry import Camera
from host.vision.pictures import Mask, u8
from host.vision.view import NAN

Floats = NDArray[np.float32]
Sums = NDArray[np.float64]

LOGARITHM = np.round(255 * np.log1p(np.arange(256) / 10.0) / np.log1p(25.5)).astype(np.uint8)
"""Brightness to its logarithm, both 0..255."""
BIN_M = 0.005
"""Across the face."""
SPAN_M = (-1.6, 1.0)
"""Of the face that is looked at, from right to left of the vehicle."""
LOWEST_M = 0.06
"""On the face: below this, stubble's specks."""
HIGHEST_SHARE = 0.9
"""Of the crop's height on the face: above this, ragged tops."""
TALLEST = 1.1
"""Of the crop's height: what the next field's tops may reach."""
HIDDEN_M = 0.3
"""Crop that seems this much further away than it is known to stand is hidden by dust."""
CUT_HIDDEN_M = 0.05
"""Likewise while it is being cut: then it stands at the blade."""
SLACK_M = 0.3
NOD_RAD = math.radians(2.0)
"""While cutting, no crop begins anew nearer than the least gap less this and what a machine that
nods by so much misjudges: what seems to is the upper border of dust."""
HIDDEN_PX = 300.0
HIDDEN_DENSE = 0.05
"""From this distance on a face is doubted whose foot dust may hide; what may stand at the blade is
judged by at least so many pixels and this share of stems among them: only ears reach that high."""
LATE_M, LATE_DENSE, LATE_SURE = 0.5, 0.08, 0.9
"""The last of the crop, so far ahead of the blade, shows by its ears: what a camera below the tops
sees of it reaches above all that stands half a gap further away. At least so dense, and how sure
that is."""
GAP_M = 2.0
"""Least gap to the next crop behind: what a camera sees of that must not count as this face."""
OWN_M = 0.2
"""While cutting, what ends further to the left is the border of the machine's own swath, where the
crop beside it stands nearer than the face."""
TRACK_M = 0.08
"""The right end moves by a centimetre from picture to picture; what is this far from where it was
is more likely something else, an end of dust for one."""
ELSEWHERE = 0.35
"""Factor on how much such a place differs, squared."""
BORDER_M = 0.06
"""Crop that goes on to so near the picture's border ends there for the picture alone."""
WINDOW_M = 0.3
"""Looked at on either side of a possible right end."""
NARROW_M = 0.12
AROUND_M = 0.06
"""Which of two grounds a place belongs to shows in a wide window, where exactly they meet in a
narrow one: looked for so far around."""
AGAIN_M = (0.05, 0.1)
"""From the right end, and how wide: pieces of the face beside it."""
AGAIN_PIXELS = 50.0
DENSE = 0.10
"""Share of lit pixels that makes a neighbourhood standing crop."""
OPEN, OPEN_PER_STEP = 1.1, 2.0
"""While cutting, ground right of the crop's end has few steps to the crop's, 0.03 to 0.2 times as
many. Where it has 0.3 times, crop goes on behind the dust that seemed to be its end: the confidence
is at most the former less the latter times that share."""
WITHIN_M = 0.2
"""That goes for an end so far inside the blade's: dust never makes it seem too far right, and
beside a machine that is too far left uncut stalks stand before the ground."""
BLOCK_PX = 16
"""Columns that share a foot."""
BESIDE_M = (0.05, 0.3)
"""Right and left of the right end, once crop is not being cut: the feet there tell how far away it
is."""
BESIDE_BLOCKS = 3
ASKEW_M = 0.4
"""The right end's distance and the nearest one's differ by less, where both are the same face's."""
FOOT_M = 0.5
"""The stems' lower ends fade in shade and dust: the foot is looked for this much nearer."""
LOWER = 0.7
"""Of the height above the horizon at which the tops of crop that is being cut were seen: the next
crop's, a gap further away, are lower than this."""
UPRIGHT = 3.5
"""Where crop stands, squared steps across the picture are greater than those along it by this."""
GRAIN = (1, 5)
"""Columns and rows over which grey is averaged along an edge before its step is taken."""
LEAST_STEP2 = 8.0
"""Mean squared step, in 255ths of the logarithmic range, below which there is but noise."""
FOOT_WINDOW_M = 0.12
"""On the face, above and below a possible foot."""
REACH_M = 12.0
"""Feet further than this from the camera are not told apart from the horizon."""
DARK = float(LOGARITHM[16])
"""Mean grey level below the horizon under which steps are the sensor's own noise."""
WAY_M = 1.5
"""Of the blade's way, ahead of it, that must be seen before "no crop" is believed."""
SEEN_SHARE = 25.0
"""Times the share of steps there: the confidence."""
VEIL_SHARE = 0.015
"""Of steps in one of the ninths of that ground: below it dust lies over it."""
FAR_M = 2.5
"""Beyond this the right end of what stands there is of no use to a pilot."""
NEAR_SHARE = 0.2
"""Share of the blade's width that must be reached for crop to count as ahead."""
SPREAD = np.array([0.10, 0.10, 20.0])
"""Within one kind of ground: of the shares of stems and of steps, and of the grey level. A feature
counts by how far it differs in these units."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a mode's own stages say of one picture; all (height, width)."""

    upright: Mask
    """255 on the standing crop's stems (VTSY)."""
    steps: Mask
    """255 on every step of brightness across the picture."""
    grey: Mask
    """Brightness, by its logarithm."""


@dataclass(frozen=True, slots=True)
class Face:
    """What was found; NaN and 0 where nothing was."""

    ahead_m: float
    """From the blade's line to the face; inf where none is in reach."""
    ahead_confidence: float
    right_m: float
    """Lateral position of the face's right end in the vehicle frame (left positive)."""
    right_confidence: float
    at_x_m: float
    """Of the face, in the vehicle frame: where `right_m` was measured."""
    standing: NDArray[np.bool_]
    veiled: bool = False
    """Dust lies over a part of the ground that the blade is about to reach."""
    tops_px: float = NAN
    """Rows between the horizon and the tops of what stands in the blade's way."""


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _profile(
    upright: Mask,
    steps: Mask,
    grey: Mask,
    across: Floats,
    upward: Floats,
    reach: Floats,
    scale: float,
    origin: tuple[float, float],
    bands: tuple[float, float, float, float],
    right: float,
    sums: Sums,
) -> None:
    """Per lateral bin of the face's two bands of height (lower from, to, upper from, to), from the
    right end: pixels, stems, steps, grey (n, 4). `reach`: least and greatest `upward` of each row.

    Counts share a word, three of 20 bits; the first and the last bin are for what is outside."""
    height, width = upright.shape
    bins = sums.shape[0]
    low = np.float32((bands[0] - origin[1]) / scale), np.float32((bands[2] - origin[1]) / scale)
    high = np.float32((bands[1] - origin[1]) / scale), np.float32((bands[3] - origin[1]) / scale)
    first, per = np.float32((origin[0] - right) / BIN_M + 1.0), np.float32(scale / BIN_M)
    none, last = np.float32(0.0), np.float32(bins + 1)
    counts = np.zeros((bins + 2, 2), np.int64)
    place, word = np.empty(width, np.int32), np.empty(width, np.int64)
    for v in range(height):
        least, most = reach[v]
        if not ((least <= high[0] and most >= low[0]) or (least <= high[1] and most >= low[1])):
            continue
        stem, step, level, aside, z = upright[v], steps[v], grey[v], across[v], upward[v]
        for u in range(width):
            inside = ((low[0] <= z[u]) & (z[u] <= high[0])) | ((low[1] <= z[u]) & (z[u] <= high[1]))
            b = min(last, max(none, first + per * aside[u]))
            place[u] = np.int32(b) if inside else np.int32(0)
        for u in range(width):
            word[u] = 1 | np.int64(stem[u] & 1) << 20 | np.int64(step[u] & 1) << 40
        for u in range(width):
            counts[place[u], 0] += word[u]
            counts[place[u], 1] += level[u]
    field = (1 << 20) - 1
    for b in range(bins):
        pixels = counts[b + 1, 0]
        sums[b, 0], sums[b, 1] = pixels & field, pixels >> 20 & field
        sums[b, 2], sums[b, 3] = pixels >> 40, counts[b + 1, 1]


@numba.njit(cache=True, nogil=True, boundscheck=False)
def _blocks(steps: Mask, grey: Mask, sums: NDArray[np.int32]) -> None:
    """Sums of steps and of grey per block of columns and row, running from the top:
    (2, rows + 1, blocks)."""
    for v in range(steps.shape[0]):
        for b in range(sums.shape[2]):
            step, level = np.int32(0), np.int32(0)
            for u in range(b * BLOCK_PX, (b + 1) * BLOCK_PX):
                step += np.int32(steps[v, u] & 1)
                level += np.int32(grey[v, u])
            sums[0, v + 1, b] = sums[0, v, b] + step
            sums[1, v + 1, b] = sums[1, v, b] + level


@numba.njit(cache=True, nogil=True)
def _feet(
    dense: Mask,
    sums: NDArray[np.int32],
    horizon: int,
    limit: NDArray[np.int32],
    windows: NDArray[np.int32],
    spread: Sums,
    feet: NDArray[np.int32],
) -> None:
    """Per block of columns the row of its foot, -1 without: below the lowest dense row, the
    division of the rows above from those below with the greatest difference, at most down to
    `limit` of the dense row."""
    height = dense.shape[0]
    for b in range(feet.shape[0]):
        feet[b] = -1
        middle = b * BLOCK_PX + BLOCK_PX // 2
        rough = -1
        for v in range(height - 1, horizon - 1, -1):
            if dense[v, middle]:
                rough = v
                break
        if rough < 0:
            continue
        best, at = -1.0, rough
        for v in range(rough - windows[rough] // 2, min(height - 2, limit[rough]) + 1):
            n = windows[v]
            lo, hi = max(0, v - n), min(height, v + max(3, n // 2))
            above, below = float((v - lo) * BLOCK_PX), float((hi - v) * BLOCK_PX)
            if above <= 0.0 or below <= 0.0:
                continue
            score = 0.0
            for k in range(2):
                d = (sums[k, v, b] - sums[k, lo, b]) / above
                d -= (sums[k, hi, b] - sums[k, v, b]) / below
                if k == 0 and d < 0.0:
                    d = 0.0
                score += (d / spread[k + 1]) ** 2
            if score > best:
                best, at = score, v
        feet[b] = at


@numba.njit(cache=True, nogil=True)
def _step(
    sums: Sums, window: int, last: int, expected: float, spread: Sums
) -> tuple[int, float, float, float]:
    """The bin, before `last`, where the crop on the left (higher bins) ends towards the right, the
    shares of stems on the crop's side and on the other, and by how many spreads the sides differ;
    -1 without.

    It is the division with the greatest difference of the windows on either side, or one as good
    that lies wholly right of it: a stand beside the others is the outer one. What is far from the
    bin that is `expected` (NaN: nowhere) must differ by more."""
    n = sums.shape[0]
    run = np.zeros((n + 1, 4))
    for i in range(n):
        for k in range(4):
            run[i + 1, k] = run[i, k] + sums[i, k]
    score = np.zeros(n)
    inside = np.zeros(n)
    outside = np.zeros(n)
    at = -1
    for i in range(4, min(n - 4, last)):
        lo, hi = max(0, i - window), min(n, i + window)
        below, above = run[i, 0] - run[lo, 0], run[hi, 0] - run[i, 0]
        if above < 1.0 or below < 1.0:
            continue
        outside[i], inside[i] = (run[i, 1] - run[lo, 1]) / below, (run[hi, 1] - run[i, 1]) / above
        if inside[i] < 0.03 or inside[i] <= 2.0 * outside[i]:
            continue
        total = 0.0
        for k in range(1, 4):
            d = (run[i, k] - run[lo, k]) / below - (run[hi, k] - run[i, k]) / above
            total += (d / spread[k - 1]) ** 2
        share = above / (above + below)
        score[i] = total * 4.0 * share * (1.0 - share)
        if abs(i - expected) > TRACK_M / BIN_M:
            score[i] *= ELSEWHERE
        if at < 0 or score[i] > score[at]:
            at = i
    if at < 0:
        return -1, 0.0, 0.0, 0.0
    further = at
    for i in range(4, at - window):
        if score[i] > 0.5 * score[at] and (further == at or score[i] > score[further]):
            further = i
    differ = score[further]
    if abs(further - expected) > TRACK_M / BIN_M:
        differ /= ELSEWHERE
    return _meet(run, further, spread), inside[further], outside[further], math.sqrt(differ)


@numba.njit(cache=True, nogil=True)
def _meet(run: Sums, at: int, spread: Sums) -> int:
    """The bin near `at` where narrow windows differ most; `run` are running sums."""
    narrow, around = round(NARROW_M / BIN_M), round(AROUND_M / BIN_M)
    best, found = 0.0, at
    for i in range(max(narrow, at - around), min(run.shape[0] - narrow, at + around + 1)):
        below = run[i, 0] - run[i - narrow, 0]
        above = run[i + narrow, 0] - run[i, 0]
        if below < 1.0 or above < 1.0:
            continue
        total = 0.0
        for k in range(1, 4):
            d = (run[i + narrow, k] - run[i, k]) / above - (run[i, k] - run[i - narrow, k]) / below
            if k > 1 or d > 0.0:
                total += (d / spread[k - 1]) ** 2
        if total > best:
            best, found = total, i
    return found


def _dense(seen: Evidence) -> Mask:
    """255 where stems are so many that crop stands."""
    near = cv2.boxFilter(seen.upright, cv2.CV_8U, (17, 9))
    return u8(cv2.threshold(near, 255 * DENSE, 255, cv2.THRESH_BINARY)[1])


def _again(sums: Sums, at: int) -> float:
    """The greatest share of stems right of an end: of a true one nothing stands there, but what
    dust or weeds hide of a face goes on behind them."""
    beyond, wide = (round(m / BIN_M) for m in AGAIN_M)
    count = max(0, at - beyond) // wide
    first = at - beyond - count * wide
    pieces = sums[first : first + count * wide].reshape(count, wide, 4).sum(axis=1)
    pieces = pieces[pieces[:, 0] > AGAIN_PIXELS]
    return float((pieces[:, 1] / pieces[:, 0]).max(initial=0.0))


def _steps_beyond(sums: Sums, at: int) -> float:
    """The share of steps in the window right of a bin over that in the window left of it."""
    window = round(WINDOW_M / BIN_M)
    beyond, within = sums[max(0, at - window) : at].sum(0), sums[at : at + window].sum(0)
    share = float(within[2]) / max(1.0, float(within[0]))
    return float(beyond[2]) / max(1.0, float(beyond[0])) / max(share, 1e-3)


class FaceFinder:
    """Finds the face in pictures of one mount."""

    def __init__(self, camera: Camera, vehicle: Vehicle) -> None:
        self._camera = camera
        self._vehicle = vehicle
        width, height = camera.size
        u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        pixels = np.stack([u, v], -1)
        rays = camera.rays(pixels)
        forward = np.where(rays[..., 0] > 1e-6, rays[..., 0], np.nan)
        far = 1e6
        self._across = np.nan_to_num(rays[..., 1] / forward, nan=far).astype(np.float32)
        self._upward = np.nan_to_num(rays[..., 2] / forward, nan=far).astype(np.float32)
        self._reach = np.stack([self._upward.min(1), self._upward.max(1)], 1)
        x = np.nan_to_num(camera.on_height(pixels, 0.0)[..., 0], nan=far)
        self._ground_x = np.minimum(x, far).astype(np.float32)
        middle = self._ground_x[:, width // 2]
        self._horizon = int(np.argmax(middle < REACH_M)) if middle.min() < REACH_M else height
        x_c = float(camera.position[0])
        beyond = vehicle.blade_x_m + GAP_M - x_c
        self._no_crop_m = GAP_M - SLACK_M - NOD_RAD * beyond**2 / float(camera.position[2])
        # rows that a face's foot may be lower than its stems seem to end
        nearer = np.maximum(middle - FOOT_M, x_c + 0.05)
        order = np.searchsorted(-middle, -nearer)
        self._limit = np.minimum(order, height - 1).astype(np.int32)
        rows = camera.matrix[0, 0] * FOOT_WINDOW_M / np.maximum(middle - x_c, 0.1)
        self._way = self._corridor(camera, vehicle)
        self._face = self._cut_face()
        above = vehicle.crop_height_m - float(camera.position[2])
        self._usual_tops_px = camera.matrix[0, 0] * above / (vehicle.blade_x_m - x_c)
        self._level_px = int(np.argmin(np.abs(self._upward[:, width // 2])))
        self._middle = self._face[0][1]
        # from beside it stubble is as upright as crop
        self._from_above = float(camera.position[2]) > vehicle.crop_height_m
        self._windows = np.clip(rows, 4, 40).astype(np.int32)

    @staticmethod
    def _corridor(camera: Camera, vehicle: Vehicle) -> tuple[slice, slice]:
        """Rows and columns of the ground that the blade is about to reach."""
        half, near = 0.5 * vehicle.blade_width_m, vehicle.blade_x_m
        far = near + WAY_M
        corners = camera.project([[near, half, 0], [near, -half, 0], [far, 0, 0]])
        width, height = camera.size
        top, bottom = (int(np.clip(v, 0, height)) for v in (corners[2, 1], corners[:2, 1].max()))
        left, right = (int(np.clip(u, 0, width)) for u in (corners[0, 0], corners[1, 0]))
        return slice(min(top, bottom - 1), bottom), slice(left, max(right, left + 1))

    def _cut_face(self) -> tuple[tuple[slice, slice], Mask]:
        """Where crop that is being cut shows its face: rows and columns, and 255 on it in those
        rows and columns less one all round."""
        x_c, y_c, z_c = (float(c) for c in self._camera.position)
        x = self._vehicle.blade_x_m
        _, highest, _, _ = self._bands(x, GAP_M)
        y, z = y_c + (x - x_c) * self._across, z_c + (x - x_c) * self._upward
        half = 0.4 * self._vehicle.blade_width_m
        inside = (np.abs(y) < half) & (z > LOWEST_M) & (z < highest)
        inside[[0, -1]], inside[:, [0, -1]] = False, False
        rows, columns = np.flatnonzero(inside.any(1)), np.flatnonzero(inside.any(0))
        if not len(rows):
            return (slice(0, 3), slice(0, 3)), np.zeros((1, 1), np.uint8)
        top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
        box = slice(top - 1, bottom + 1), slice(left - 1, right + 1)
        return box, np.where(inside[top:bottom, left:right], 255, 0).astype(np.uint8)

    def find(
        self,
        seen: Evidence,
        stands_m: float = math.inf,
        expected_m: float = NAN,
        tops_px: float = NAN,
    ) -> Face:
        """The face in one picture. `stands_m`: crop is known to stand at most this far ahead of the
        blade's line, 0 while it is being cut; the blade's dust may hide its foot. `expected_m`:
        where the right end was in the pictures before. `tops_px`: how high above the horizon the
        tops of what is being cut were seen (NaN: not yet; those of usual crop are taken)."""
        dense = _dense(seen)
        standing = np.asarray(dense > 0)
        if cv2.mean(seen.grey[self._horizon :])[0] < DARK:
            return Face(NAN, 0.0, NAN, 0.0, NAN, standing)
        sight, veiled = self._sight(seen)
        x, y = self._contour(seen, dense)
        ahead, sight = self._ahead(x, y, sight)
        dust, tops = 0.0, self._tops(dense)
        hidden = CUT_HIDDEN_M if stands_m == 0.0 else HIDDEN_M
        if ahead > stands_m + hidden:
            if stands_m == 0.0 and self._from_above:
                at_blade = self._upright(seen.grey)
            else:
                known = self._usual_tops_px if math.isnan(tops_px) else tops_px
                lower = stands_m == 0.0 and tops < LOWER * known
                at_blade = not lower and self._stands_at(seen, stands_m, ahead)
            if at_blade or ahead < stands_m + self._no_crop_m:
                dust, ahead = ahead - stands_m, stands_m
        if ahead > FAR_M:
            return Face(ahead, sight, NAN, 0.0, NAN, standing, veiled)
        face_x = self._vehicle.blade_x_m + ahead
        left = OWN_M if stands_m == 0.0 else SPAN_M[1]
        right, sure = self._right_end(seen, face_x, dust, left, expected_m)
        if stands_m > 0.0 and dust == 0.0:
            # a machine that stands askew sees a face askew: nearer or further at its right end
            beside = x[(y > right - BESIDE_M[0]) & (y < right + BESIDE_M[1])]
            beside = beside[np.abs(beside - face_x) < ASKEW_M]
            if len(beside) >= BESIDE_BLOCKS:
                face_x = float(np.median(beside))
                right, sure = self._right_end(seen, face_x, dust, left, expected_m)
        return Face(ahead, sight, right, sure, face_x, standing, veiled, tops)

    def last(self, faint: Evidence, seems: Face) -> Face:
        """What `seems` clear ground to a camera below the tops, looked at again without dust in the
        air by fainter stems: the last of the crop may stand on it. Nothing new of its right end."""
        ahead, sight = self._ahead(*self._contour(faint, _dense(faint)), seems.ahead_confidence)
        if ahead > LATE_M:
            if not self._stands_at(faint, LATE_M, LATE_M + GAP_M / 2, LATE_DENSE):
                return seems
            ahead, sight = LATE_M, max(sight, LATE_SURE)
        return replace(seems, ahead_m=ahead, ahead_confidence=sight)

    def _contour(self, seen: Evidence, dense: Mask) -> tuple[Floats, Floats]:
        """(x, y) on the ground of the foot of each block of columns that has one."""
        blocks = seen.upright.shape[1] // BLOCK_PX
        sums = np.zeros((2, seen.upright.shape[0] + 1, blocks), np.int32)
        feet = np.empty(blocks, np.int32)
        _blocks(seen.steps, seen.grey, sums)
        _feet(dense, sums, self._horizon, self._limit, self._windows, SPREAD, feet)
        columns = np.arange(blocks) * BLOCK_PX + BLOCK_PX // 2
        rows, columns = feet[feet >= 0], columns[feet >= 0]
        x = self._ground_x[rows, columns]
        x_c, y_c, _ = self._camera.position
        return x, np.asarray(y_c + self._across[rows, columns] * (x - x_c), np.float32)

    def _ahead(self, x: Floats, y: Floats, sight: float) -> tuple[float, float]:
        """Distance from the blade's line to the nearest face that fills a share of its width."""
        vehicle = self._vehicle
        near = np.sort(x[np.abs(y) < 0.5 * vehicle.blade_width_m])
        width = BLOCK_PX * (near - self._camera.position[0]) / self._camera.matrix[0, 0]
        reached = np.cumsum(width)
        enough = int(np.searchsorted(reached, NEAR_SHARE * vehicle.blade_width_m))
        if enough >= len(near):
            return math.inf, sight
        distance = float(near[enough]) - vehicle.blade_x_m
        return max(0.0, distance), max(sight, 0.9 if reached[-1] > 0.3 else 0.5)

    def _sight(self, seen: Evidence) -> tuple[float, bool]:
        """How surely the picture would show crop in the blade's way, and whether a part of it is
        veiled: ground there has steps too, dust, glare and a covered lens have none."""
        ninths = cv2.resize(seen.steps[self._way], (3, 3), interpolation=cv2.INTER_AREA) / 255.0
        return min(0.95, SEEN_SHARE * float(ninths.mean())), bool(ninths.min() < VEIL_SHARE)

    def _tops(self, dense: Mask) -> float:
        """Rows from the tops of the stems in the blade's way down to the horizon; NaN without."""
        lit = dense[: self._level_px, self._middle] > 0
        some = lit.any(0)
        if some.mean() < 0.5:
            return NAN
        return float(self._level_px - np.median(lit.argmax(0)[some]))

    def _upright(self, grey: Mask) -> bool:
        """Whether crop stands at the blade's line by the direction of the texture where its face
        would be: stems are upright, ground is not, and dust takes contrast from both directions
        alike."""
        box, face = self._face
        g = grey[box]
        across = cv2.absdiff(cv2.blur(g[:, 2:], GRAIN), cv2.blur(g[:, :-2], GRAIN))[1:-1]
        along = cv2.absdiff(cv2.blur(g[2:], GRAIN[::-1]), cv2.blur(g[:-2], GRAIN[::-1]))[:, 1:-1]
        n = max(1, cv2.countNonZero(face))
        x2 = cv2.norm(across, cv2.NORM_L2SQR, mask=face) / n
        y2 = cv2.norm(along, cv2.NORM_L2SQR, mask=face) / n
        return bool(x2 > LEAST_STEP2 and x2 > UPRIGHT * y2)

    def _right_end(
        self, seen: Evidence, face_x: float, dust: float, left_m: float, expected_m: float
    ) -> tuple[float, float]:
        """Lateral position of the face's right end on the plane at `face_x`, right of `left_m`, and
        confidence; `expected_m` is where it was before (NaN: unknown). `dust`: how far ahead its
        upper border made the foot appear, 0 without; only what rises above it is then looked at.
        The confidence is that of this picture alone."""
        bands = self._bands(face_x, GAP_M)
        if dust > 0.0:
            highest = TALLEST * self._vehicle.crop_height_m
            if dust > HIDDEN_M and highest > bands[2] + HIDDEN_M / 10:
                bands = (1.0, 0.0, bands[2], highest)
            else:
                x_c, _, z_c = (float(c) for c in self._camera.position)
                border = z_c * dust / (face_x - x_c + dust)
                bands = (min(border, bands[1] - 0.1), bands[1], bands[2], bands[3])
        sums = self._sums(seen, face_x, bands)
        at, inside, outside, differ = _step(
            sums,
            round(WINDOW_M / BIN_M),
            round((left_m - SPAN_M[0]) / BIN_M),
            (expected_m - SPAN_M[0]) / BIN_M,
            SPREAD,
        )
        if at < 0:
            return NAN, 0.0
        contrast = (inside - outside) / (inside + outside)
        if (at - int(np.argmax(sums[:, 0] > 0.0))) * BIN_M < BORDER_M:
            return SPAN_M[0] + at * BIN_M, 0.0
        again = _again(sums, at) / inside
        sure = min(0.95, 1.5 * contrast - 0.4, 0.4 * differ, 1.5 - 5.0 * again)
        right = SPAN_M[0] + at * BIN_M
        if left_m == OWN_M and right > WITHIN_M - 0.5 * self._vehicle.blade_width_m:
            sure = min(sure, OPEN - OPEN_PER_STEP * _steps_beyond(sums, at))
        return right, max(0.0, sure)

    def _bands(self, face_x: float, gap_m: float) -> tuple[float, float, float, float]:
        """Heights on the face where nothing that stands `gap_m` or more behind it is seen: below
        that crop's foot and, for a camera beneath the tops, above its tops."""
        x_c, _, z_c = (float(c) for c in self._camera.position)
        height = self._vehicle.crop_height_m
        share = (face_x - x_c) / (face_x - x_c + gap_m)
        foot = z_c * (1.0 - share)
        tops = z_c + (TALLEST * height - z_c) * share
        highest = HIGHEST_SHARE * height
        return LOWEST_M, min(highest, foot - 0.02), tops + 0.02, highest

    def _sums(
        self, seen: Evidence, face_x: float, bands: tuple[float, float, float, float]
    ) -> Sums:
        x_c, y_c, z_c = (float(c) for c in self._camera.position)
        sums = np.zeros((round((SPAN_M[1] - SPAN_M[0]) / BIN_M), 4))
        _profile(
            seen.upright,
            seen.steps,
            seen.grey,
            self._across,
            self._upward,
            self._reach,
            face_x - x_c,
            (y_c, z_c),
            bands,
            SPAN_M[0],
            sums,
        )
        return sums

    def _stands_at(
        self, seen: Evidence, stands_m: float, ahead: float, density: float = HIDDEN_DENSE
    ) -> bool:
        """Whether crop stands `stands_m` before the blade though its foot is not seen: dust hides
        it, and what was taken for the foot is the upper border of the dust. Crop that began `ahead`
        would leave the bands of `_bands` empty."""
        vehicle = self._vehicle
        x = vehicle.blade_x_m + stands_m
        bands = self._bands(x, ahead - stands_m)
        sums = self._sums(seen, x, (1.0, 0.0, bands[2], TALLEST * vehicle.crop_height_m))
        half = 0.5 * vehicle.blade_width_m
        inside = slice(round((-half - SPAN_M[0]) / BIN_M), round((half - SPAN_M[0]) / BIN_M))
        pixels, stems = sums[inside, 0].sum(), sums[inside, 1].sum()
        return bool(pixels > HIDDEN_PX and stems > density * pixels)
