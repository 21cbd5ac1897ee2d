"""The face of the standing crop, in metres, from a picture of its upright stems.

While cutting, the crop ahead ends in a face across the vehicle's path at the blade's line; after a
turn the face stands further ahead. Its foot tells the distance, its right end is E_outer. Both come
from where stems stand, so that neither the crop's height nor the camera's side of it matters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import Vehicle
from host.vision.geometry import Camera
from host.vision.mounted.beside import right_end_beside, stands_right
from host.vision.mounted.density import PIXELS, mark_dense, mean_of, shares, tops_of
from host.vision.mounted.evidence import LOGARITHM, Evidence, Floats, Sums
from host.vision.mounted.feet import Figures, Flat, contour, reached
from host.vision.mounted.grain import NOISE2, squared_steps
from host.vision.mounted.profile import BIN_M, profile, right_side, stems_beyond, steps_beyond
from host.vision.pictures import Mask
from host.vision.view import NAN

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
SHORT_M = 0.5
"""Of the next crop beside the gap, the span that is looked at ends so far: stems that are seen
farther right may be that crop's. Behind a gap of 1.7 m or more the whole span is free of it."""
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
LEAST_GAP_M, GAP_M = 0.8, 2.0
"""Clear ground that ends a side: no narrower gap is told from dust. And the gap to the next crop
behind where none, or a wider one, is known: what a camera sees of that crop must not count as this
face."""
NARROWEST_M = 1.0
"""Gap that any field is harvested beside: whether crop ends at the blade, or only dust does, must
not hang on what was said of the gap."""
OWN_M = 0.2
"""While cutting, what ends further to the left is the border of the machine's own swath, where the
crop beside it stands nearer than the face."""
WAY_SHARE = 0.4
"""Of the blade's width: the left half of its way, but for its border, is crop where any is."""
BORDER_M = 0.06
"""Crop that goes on to so near the picture's border ends there for the picture alone."""
DENSE = 0.10
"""Share of lit pixels that makes a neighbourhood standing crop."""
LEAST_LIT = next(n for n in range(PIXELS) if round(255 * n / PIXELS) > 255 * DENSE)
"""Of a neighbourhood's pixels; the share in whole 255ths."""
OPEN, OPEN_PER_STEP = 1.1, 2.0
"""While cutting, ground right of the crop's end has few steps to the crop's, 0.03 to 0.2 times as
many. Where it has 0.3 times, crop goes on behind the dust that seemed to be its end: the confidence
is at most the former less the latter times that share."""
WITHIN_M = 0.2
"""That goes for an end so far inside the blade's: dust never makes it seem too far right, and
beside a machine that is too far left uncut stalks stand before the ground."""
BESIDE_M = (0.05, 0.3)
"""Right and left of the right end, once crop is not being cut: the feet there tell how far away it
is."""
BESIDE_BLOCKS = 3
"""Blocks of columns with a foot, at least, for them to tell the distance."""
ASKEW_M = 0.4
"""The right end's distance and the nearest one's differ by less, where both are the same face's."""
FOOT_M = 0.5
"""The stems' lower ends fade in shade and dust: the foot is looked for this much nearer."""
LOOKS_HIGHER = 1.05
"""Than at the blade crop looks some metres away: its first stems tell the foot, its last ears the
tops. Chosen on eight drives; of six others 1.05, too."""
FOOT_HIDDEN = 0.75
"""Of the distance of its foot, from the camera: crop that looks so high as to stand nearer than
that has stalks or dust before its foot. Of pictures at a field's border one in 70 looks so, where
the neighbour's crop is as high as the field's."""
TALLER_M = 0.15
"""By which crop that is still to be met may be taller than is known of the field's, by tape and by
eye, and still stands where its foot is."""
ROUGH = 0.15
"""Share of steps on the blade's way from which on stalks may lie there: bare ground before a
neighbour's crop that is taller has fewer. On six random fields with a low camera, from their starts
on for 130 s, all of 54 pictures of crop whose foot was hidden had more (fields 10578 and 10581),
and 5 of 803 of clear ground would have passed for such. On five others, on which it was not chosen,
5 of 5 and 1 of 543; without it, 59."""
LOWER = 0.7
"""Of the height above the horizon at which the tops of crop that is being cut were seen: the next
crop's, a gap further away, are lower than this."""
UPRIGHT = 3.5
"""Where crop stands, squared steps across the picture are greater than those along it by this."""
FLAT_TO_M = 0.6
"""Before the blade: so far, a camera above the tops tells a swath from crop, which is upright and
higher."""
GRAIN_TO, FLAT_BELOW, UPRIGHT_LEAST = 0.45, 0.65, 2.2
"""Of the crop's height: up to which the texture above a foot tells how it runs, and below which all
of what lies flat is seen, if it stood at its foot; and squared steps across the picture over those
along it that upright stems have at least. Chosen on the fields 10550, 10557 and 10594: of
1,546 pictures in the crop 3 fewer show it at the blade, and of 539 of clear ground 18 instead of
106. On eight others, in two of which much crop lies, 7 fewer of 3,449, and 39 instead of 61 of
1,853."""
NEXT_NEARER_M = 0.1
"""Than was said of the gap, the next crop's foot may seem; it is no part of what lies before."""
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
    out_to_m: float = NAN
    """To where crop goes on to the right of the machine's way without a break; NaN: not known."""
    beside_m: float = NAN
    """The right end of crop beside the machine's way (`host.vision.mounted.beside`)."""
    crop_right: bool = False
    """Whether crop stands beside the blade, right of its end."""
    tops_px: float = NAN
    """Rows between the horizon and the tops of what stands in the blade's way."""


def _dense(seen: Evidence) -> Mask:
    """1 where stems are so many that crop stands."""
    out = np.empty_like(seen.upright)
    mark_dense(seen.upright, LEAST_LIT, out)
    return out


class FaceFinder:
    """Finds the face in pictures of one mount."""

    def __init__(self, camera: Camera, vehicle: Vehicle) -> None:
        self._camera = camera
        self._vehicle = vehicle
        x, y, z = camera.position
        self._at = float(x), float(y), float(z)
        self._focal = float(camera.matrix[0, 0])
        width, height = camera.size
        u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        pixels = np.stack([u, v], -1)
        rays = camera.rays(pixels)
        forward = np.where(rays[..., 0] > 1e-6, rays[..., 0], np.nan)
        far = 1e6
        self._across = np.nan_to_num(rays[..., 1] / forward, nan=far).astype(np.float32)
        self._upward = np.nan_to_num(rays[..., 2] / forward, nan=far).astype(np.float32)
        self._reach = np.stack([self._upward.min(1), self._upward.max(1)], 1)
        x = np.nan_to_num(camera.rays_on_height(rays, 0.0)[..., 0], nan=far)
        self._ground_x = np.minimum(x, far).astype(np.float32)
        middle = self._ground_x[:, width // 2]
        self._horizon = int(np.argmax(middle < REACH_M)) if middle.min() < REACH_M else height
        x_c = float(camera.position[0])
        # rows that a face's foot may be lower than its stems seem to end
        nearer = np.maximum(middle - FOOT_M, x_c + 0.05)
        order = np.searchsorted(-middle, -nearer)
        self._limit = np.minimum(order, height - 1).astype(np.int32)
        rows = camera.matrix[0, 0] * FOOT_WINDOW_M / np.maximum(middle - x_c, 0.1)
        self._way = self._corridor(camera, vehicle)
        # from beside it stubble is as upright as crop
        self._from_above = self._at[2] > vehicle.crop_height_m
        self.next_crop(GAP_M)
        above = vehicle.crop_height_m - float(camera.position[2])
        self._usual_tops_px = camera.matrix[0, 0] * above / (vehicle.blade_x_m - x_c)
        self._level_px = int(np.argmin(np.abs(self._upward[:, width // 2])))
        self._windows = np.clip(rows, 4, 40).astype(np.int32)

    def next_crop(self, gap_m: float) -> None:
        """Behind the crop that is being cut the next stands no nearer than that."""
        x_c, _, z_c = self._at
        self._gap_m = min(max(gap_m, LEAST_GAP_M), GAP_M)
        beside_m = self._vehicle.inset_m + self._gap_m - SHORT_M
        self._right_m = max(SPAN_M[0], -beside_m)
        self._left_bin = round((WAY_SHARE * self._vehicle.blade_width_m - self._right_m) / BIN_M)
        surely_m = min(self._gap_m, NARROWEST_M)
        beyond = self._vehicle.blade_x_m + surely_m - x_c
        self._no_crop_m = surely_m - SLACK_M - NOD_RAD * beyond**2 / z_c
        self._face = self._cut_face(surely_m)
        self._middle = self._face[0][1]
        blade_x, crop_m = self._vehicle.blade_x_m, self._vehicle.crop_height_m
        flat = Flat(
            to_x_m=blade_x + FLAT_TO_M if self._from_above else -math.inf,
            low_m=LOWEST_M,
            high_m=GRAIN_TO * crop_m,
            below_m=FLAT_BELOW * crop_m,
            clear_to_m=HIGHEST_SHARE * crop_m,
            next_x_m=blade_x + self._gap_m - NEXT_NEARER_M,
            upright=UPRIGHT_LEAST,
        )
        self._flat: Figures = (*flat,)

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

    def _cut_face(self, gap_m: float) -> tuple[tuple[slice, slice], Mask]:
        """Where crop that is being cut shows its face, and none that stands gap_m behind it: rows
        and columns, and 255 on it in those rows and columns less one all round."""
        x_c, y_c, z_c = self._at
        x = self._vehicle.blade_x_m
        _, highest, _, _ = self._bands(x, gap_m, self._vehicle.crop_height_m)
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
        grown_px: float = NAN,
        *,
        meets: bool = False,
    ) -> Face:
        """The face in one picture. `stands_m`: crop is known to stand at most this far ahead of the
        blade's line, 0 while it is being cut; the blade's dust may hide its foot. `expected_m`:
        where the right end was in the pictures before. `tops_px`: how high above the horizon the
        tops of what is being cut were seen (NaN: not yet; those of usual crop are taken);
        `grown_px`: the same of the field's crop, from a longer way. `meets`: the crop ahead is
        still to be met."""
        dense = _dense(seen)
        standing = dense.view(np.bool_)
        if mean_of(seen.grey[self._horizon :]) < DARK:
            return Face(NAN, 0.0, NAN, 0.0, NAN, standing)
        sight, veiled = self._sight(seen)
        x, y = self._contour(seen, dense)
        ahead, sight = self._ahead(x, y, sight)
        dust, tops = 0.0, self._tops(dense)
        if meets and self._stands_nearer(seen, ahead, tops, grown_px):
            nearer = max(0.0, self._by_tops_m(tops, grown_px))
            dust, ahead = ahead - nearer, nearer
        hidden = CUT_HIDDEN_M if stands_m == 0.0 else HIDDEN_M
        if ahead > stands_m + hidden:
            if stands_m == 0.0 and self._from_above:
                at_blade = self._upright(seen.grey)
            else:
                known = self._usual_tops_px if math.isnan(tops_px) else tops_px
                lower = stands_m == 0.0 and tops < LOWER * known
                height = self._height(grown_px)
                at_blade = not lower and self._stands_at(seen, stands_m, ahead, height)
            if at_blade or ahead < stands_m + self._no_crop_m:
                dust, ahead = ahead - stands_m, stands_m
        stands_beside = right_end_beside(x, y, self._vehicle.blade_x_m)
        crop_right = stands_right(x, y, self._vehicle.blade_x_m, -self._vehicle.inset_m)
        if ahead > FAR_M:
            nothing = (NAN, 0.0, NAN, standing, veiled)
            return Face(
                ahead,
                sight,
                *nothing,
                beside_m=stands_beside,
                crop_right=crop_right,
                tops_px=tops,
            )
        face_x = self._vehicle.blade_x_m + ahead
        left = OWN_M if stands_m == 0.0 else SPAN_M[1]
        height = self._height(grown_px)
        right, sure, out_to = self._right_end(seen, face_x, dust, left, expected_m, height)
        if stands_m > 0.0 and dust == 0.0:
            # a machine that stands askew sees a face askew: nearer or further at its right end
            beside = x[(y > right - BESIDE_M[0]) & (y < right + BESIDE_M[1])]
            beside = beside[np.abs(beside - face_x) < ASKEW_M]
            if len(beside) >= BESIDE_BLOCKS:
                face_x = float(np.median(beside))
                right, sure, out_to = self._right_end(seen, face_x, dust, left, expected_m, height)
        return Face(
            ahead,
            sight,
            right,
            sure,
            face_x,
            standing,
            veiled,
            out_to,
            stands_beside,
            crop_right,
            tops,
        )

    def last(self, faint: Evidence, seems: Face, grown_px: float = NAN) -> Face:
        """What `seems` clear ground to a camera below the tops, looked at again without dust in the
        air by fainter stems: the last of the crop may stand on it. Nothing new of its right end.
        `grown_px`: as for `find`."""
        ahead, sight = self._ahead(*self._contour(faint, _dense(faint)), seems.ahead_confidence)
        if ahead > LATE_M:
            next_m = LATE_M + self._gap_m / 2
            if not self._stands_at(faint, LATE_M, next_m, self._height(grown_px), LATE_DENSE):
                return seems
            ahead, sight = LATE_M, max(sight, LATE_SURE)
        return replace(seems, ahead_m=ahead, ahead_confidence=sight)

    def by_tops_m(self, face: Face, grown_px: float) -> float:
        """How far before the blade's line it is by how high its tops look above the horizon, if its
        height is that of the field's crop, whatever hides its foot; inf where none do."""
        return self._by_tops_m(face.tops_px, grown_px)

    def _by_tops_m(self, tops_px: float, grown_px: float, taller_m: float = 0.0) -> float:
        x_c, _, z_c = self._at
        above = self._height(grown_px) + taller_m - z_c
        away = self._focal * above / tops_px if tops_px > 0.0 else math.inf
        return away - (self._vehicle.blade_x_m - x_c)

    def _stands_nearer(
        self, seen: Evidence, ahead_m: float, tops_px: float, grown_px: float
    ) -> bool:
        """Whether what has its foot ahead_m before the blade looks too high to stand there, and
        what lies before that is no bare ground."""
        if self._from_above or not math.isfinite(ahead_m):
            return False
        behind = self._vehicle.blade_x_m - self._at[0]
        nearer = behind + self._by_tops_m(tops_px, grown_px, TALLER_M)
        if not nearer < FOOT_HIDDEN * (behind + ahead_m):
            return False
        return shares(seen.steps[self._way])[0] > ROUGH

    def by_height_m(self, face: Face, grown_px: float) -> float:
        """How far before the blade's line what stands at the face's distance is by the angle
        between its foot and its tops, if its height is that of the field's crop (`grown_px` as for
        `find`); NaN where that is not known."""
        x_c, _, z_c = self._at
        behind = self._vehicle.blade_x_m - x_c
        foot = z_c / (behind + face.ahead_m)
        looks = foot + face.tops_px / self._focal
        return LOOKS_HIGHER * self._height(grown_px) / looks - behind

    def _height(self, tops_px: float) -> float:
        """Of the crop: as its tops were seen at the blade, else as the vehicle file has it. In the
        former is most of what the file and the mount's height and pitch err."""
        if math.isnan(tops_px):
            return self._vehicle.crop_height_m
        x_c, _, z_c = self._at
        away = self._vehicle.blade_x_m - x_c
        return z_c + tops_px * away / self._focal

    def _contour(self, seen: Evidence, dense: Mask) -> tuple[Floats, Floats]:
        """(x, y) on the ground of the foot of each block of columns that has one."""
        x, y = contour(
            seen.steps,
            seen.grey,
            dense,
            self._horizon,
            self._limit,
            self._windows,
            SPREAD,
            self._ground_x,
            self._across,
            self._upward,
            self._at,
            self._flat,
        )
        return x, y

    def _ahead(self, x: Floats, y: Floats, sight: float) -> tuple[float, float]:
        """Distance from the blade's line to the nearest face that fills a share of its width."""
        vehicle = self._vehicle
        width = vehicle.blade_width_m
        at, filled = reached(x, y, 0.5 * width, NEAR_SHARE * width, self._at[0], self._focal)
        if math.isinf(at):
            return math.inf, sight
        return max(0.0, at - vehicle.blade_x_m), max(sight, 0.9 if filled > 0.3 else 0.5)

    def _sight(self, seen: Evidence) -> tuple[float, bool]:
        """How surely the picture would show crop in the blade's way, and whether a part of it is
        veiled: ground there has steps too, dust, glare and a covered lens have none."""
        mean, least = shares(seen.steps[self._way])
        return min(0.95, SEEN_SHARE * mean), least < VEIL_SHARE

    def _tops(self, dense: Mask) -> float:
        """Rows from the tops of the stems in the blade's way down to the horizon; NaN without."""
        return float(tops_of(dense[: self._level_px, self._middle]))

    def _upright(self, grey: Mask) -> bool:
        """Whether crop stands at the blade's line by the direction of the texture where its face
        would be: stems are upright, ground is not, and dust takes contrast from both directions
        alike."""
        box, face = self._face
        x2, y2 = squared_steps(grey[box], face)
        return x2 > NOISE2 and x2 > UPRIGHT * y2

    def _right_end(
        self,
        seen: Evidence,
        face_x: float,
        dust: float,
        left_m: float,
        expected_m: float,
        height: float,
    ) -> tuple[float, float, float]:
        """Lateral position of the face's right end on the plane at `face_x`, right of `left_m`, the
        confidence in it by this picture alone, and to where the face surely goes on. `expected_m`
        is where it was before (NaN: unknown). `dust`: how far ahead its upper border, or that of
        stalks which lie before it, made the foot appear, 0 without; only what rises above it is
        then looked at."""
        bands = self._bands(face_x, self._gap_m, height)
        if dust > 0.0:
            highest = TALLEST * height
            if dust > HIDDEN_M and highest > bands[2] + HIDDEN_M / 10:
                bands = (1.0, 0.0, bands[2], highest)
            else:
                x_c, _, z_c = self._at
                border = z_c * dust / (face_x - x_c + dust)
                bands = (min(border, bands[1] - 0.1), bands[1], bands[2], bands[3])
        sums = self._sums(seen, face_x, bands)
        found = right_side(
            sums,
            round((left_m - self._right_m) / BIN_M),
            (expected_m - self._right_m) / BIN_M,
            SPREAD,
            (self._left_bin, round(-self._right_m / BIN_M)),
        )
        at, inside, outside, differ, from_border, out_bin = found
        out_to = self._right_m + out_bin * BIN_M
        if at < 0:
            return NAN, 0.0, out_to
        contrast = (inside - outside) / (inside + outside)
        if from_border * BIN_M < BORDER_M:
            return self._right_m + at * BIN_M, 0.0, out_to
        again = stems_beyond(sums, at) / inside
        sure = min(0.95, 1.5 * contrast - 0.4, 0.4 * differ, 1.5 - 5.0 * again)
        right = self._right_m + at * BIN_M
        if left_m == OWN_M and right > WITHIN_M - 0.5 * self._vehicle.blade_width_m:
            sure = min(sure, OPEN - OPEN_PER_STEP * steps_beyond(sums, at))
        return right, max(0.0, sure), out_to

    def _bands(
        self, face_x: float, gap_m: float, height: float
    ) -> tuple[float, float, float, float]:
        """Heights on the face where nothing that stands `gap_m` or more behind it is seen: below
        that crop's foot and, for a camera beneath the tops, above its tops."""
        x_c, _, z_c = self._at
        share = (face_x - x_c) / (face_x - x_c + gap_m)
        foot = z_c * (1.0 - share)
        tops = z_c + (TALLEST * height - z_c) * share
        highest = HIGHEST_SHARE * height
        return LOWEST_M, min(highest, foot - 0.02), tops + 0.02, highest

    def _sums(
        self, seen: Evidence, face_x: float, bands: tuple[float, float, float, float]
    ) -> Sums:
        x_c, y_c, z_c = self._at
        sums = np.empty((round((SPAN_M[1] - self._right_m) / BIN_M), 4))
        profile(
            seen.upright,
            seen.steps,
            seen.grey,
            self._across,
            self._upward,
            self._reach,
            face_x - x_c,
            (y_c, z_c),
            bands,
            self._right_m,
            sums,
        )
        return sums

    def _stands_at(
        self,
        seen: Evidence,
        stands_m: float,
        ahead: float,
        height: float,
        density: float = HIDDEN_DENSE,
    ) -> bool:
        """Whether crop stands `stands_m` before the blade though its foot is not seen: dust hides
        it, and what was taken for the foot is the upper border of the dust. Crop that began `ahead`
        would leave the bands of `_bands` empty."""
        vehicle = self._vehicle
        x = vehicle.blade_x_m + stands_m
        bands = self._bands(x, ahead - stands_m, height)
        sums = self._sums(seen, x, (1.0, 0.0, bands[2], TALLEST * height))
        half = 0.5 * vehicle.blade_width_m
        inside = slice(
            round((-half - self._right_m) / BIN_M), round((half - self._right_m) / BIN_M)
        )
        pixels, stems = sums[inside, 0].sum(), sums[inside, 1].sum()
        return bool(pixels > HIDDEN_PX and stems > density * pixels)
