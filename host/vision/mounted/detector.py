"""The detectors that drive: pictures of a known mount in, CropView in metres out."""

from __future__ import annotations

import math
import statistics
from collections import deque
from itertools import pairwise
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import Mount, Vehicle
from host.vision.geometry import Camera
from host.vision.mounted.before_lens import HIDES, before_lens
from host.vision.mounted.evidence import Evidence
from host.vision.mounted.face import (
    FAR_M,
    FOOT_HIDDEN,
    HIDDEN_DENSE,
    LOWEST_M,
    Face,
    FaceFinder,
)
from host.vision.mounted.in_view import check_view
from host.vision.mounted.lens import LensWatch
from host.vision.mounted.lying import AHEAD_M, LyingCrop
from host.vision.mounted.paper import (
    L_TOLERANCE,
    Chain,
    PaperParams,
    l_height,
    staged_pictures,
)
from host.vision.mounted.profile import TRACK_M
from host.vision.mounted.scale import Scale, scale_of
from host.vision.mounted.stems import FAINTER, Stems
from host.vision.pictures import Picture
from host.vision.view import NAN, CropView

Mode = Literal["paper", "robust"]

Pictures = dict[str, Picture]
Edge = NDArray[np.float32]

AT_BLADE_M = 0.3
"""Crop nearer than this is being cut."""
NEAR_M = 1.0
"""Crop that was seen so near does not recede before a machine that follows it."""
APPROACH_M = 0.03
"""It comes nearer by at least this from picture to picture: 0.3 m/s."""
SURE = 0.5
"""Confidence from which a picture may set the references."""
TRACK = 11
"""Clear right ends that are remembered: a second."""
GROWN = 300
"""Pictures of crop at the blade by which its height is judged: 15 m at cutting speed, so that a
patch that lies does not count."""
TRACKED = 3
"""Of them from which on their median is where the next is expected."""
LEAP_M = 0.3
"""The right end moves no further left while it is out of sight, and begins no further from O_map
where crop is already being cut: what seems to is an end of dust."""
BELIEVED = 30
"""Pictures that an end further away must stay to be believed after all."""
DOUBT = 0.5
"""Factor on the confidence in what has not stayed for long enough."""
WANDERED = 10
"""Pictures over which it is watched whether the crop ahead comes and goes: a second."""
WANDER_RAD = math.radians(3.0)
"""By how much its foot may rise in the picture within them. It sinks before a machine that comes
nearer, and a machine that nods lifts it by a degree; what rises more is no foot, but where blur,
glare or shade lets stems fade."""
BESIDE_M = 0.2
"""To either side of the right end, so far is looked for what covers the lens,"""
BELOW_CAMERA = 0.85
"""and up to this share of the camera's height: what is seen above that lies far off and hardly
moves, lens or not."""
COVERED = 0.2
"""Share of either side from which on the right end may be the border of what covers it. Chosen with
`BESIDE_M` on twelve drives of seed 31."""
HIDDEN_NEAR_M = 1.0
"""Before the blade, at most, that it must stand by its tops alone, for clear ground to be doubted:
0.8 m of that end a side, and 0.2 m more for what the tops err."""
CLEAR, CLEAR_VEILED = 2, 5
"""Pictures without crop near ahead, while cutting, until they are no whim of dust; the latter where
dust lies over the ground that should be seen."""


class Source(Protocol):
    """A mode's own stages."""

    def look(self, bgr: Picture, stages: bool, cutting: bool) -> tuple[Evidence, Pictures]: ...


class PaperSource:
    """Colour, threshold and upright lines, as in the paper."""

    def __init__(self, params: PaperParams, camera: Camera, vehicle: Vehicle) -> None:
        self._chain = Chain(params, camera.size, camera, vehicle.blade_height_m)

    def look(self, bgr: Picture, stages: bool, cutting: bool) -> tuple[Evidence, Pictures]:
        s = self._chain.run(bgr, FAINTER if cutting else 1.0)
        evidence = Evidence(s.upright, s.steps, s.grey)
        return evidence, staged_pictures(bgr, s) if stages else {}


class RobustSource:
    """Stems by brightness alone."""

    def __init__(self, camera: Camera, vehicle: Vehicle) -> None:
        self._stems = Stems(camera, vehicle)

    def look(self, bgr: Picture, stages: bool, cutting: bool) -> tuple[Evidence, Pictures]:
        seen = self._stems.run(bgr, cutting)
        pictures = {"grey": seen.grey, "steps": seen.steps, "stems": seen.upright}
        return seen, {k: np.dstack([p] * 3) for k, p in pictures.items()} if stages else {}


class MountedDetector:
    """A mode's evidence, measured by the mount's geometry (`Detector` in view.py)."""

    def __init__(
        self, source: Source, camera: Camera, vehicle: Vehicle, scale: Scale | None = None
    ) -> None:
        """`scale`: between the pictures that are seen and those of `camera`; None: the same."""
        self._source = source
        self._scale = scale or Scale(camera.size, camera.mount)
        self._camera = camera
        self._vehicle = vehicle
        self._finder = FaceFinder(camera, vehicle)
        x, y, z = (float(c) for c in camera.position)
        level = float(camera.project([[x + FAR_M * 100, y, z]])[0, 1])
        self._level = int(min(max(level, 0.0), camera.size[1] - 1.0))
        self._lens = LensWatch(camera.size, self._level)
        self._lying = LyingCrop(camera, vehicle)
        self._drawn_z = np.concatenate(
            [[LOWEST_M, LOWEST_M], np.linspace(0.0, vehicle.crop_height_m, 10)]
        )
        """Heights of what is drawn: E_outer, O_map, the border of the face."""
        self._expected_m = -vehicle.inset_m
        self._l_reference = NAN
        # such a camera looks through the blade's dust; one above the tops looks over most of it
        self._below_tops = float(camera.position[2]) < vehicle.crop_height_m
        self._cutting = False
        self._near = False
        """Whether what the blade cuts, or has just cut, is before it."""
        self._dustless = TRACKED
        """Pictures of crop at the blade until its dust may hide where that ends: so many must be
        believed for a place to be known."""
        self._stands_m = math.inf
        self._track: deque[float] = deque(maxlen=TRACK)
        self._tops: deque[float] = deque(maxlen=TRACK)
        self._all_tops: deque[float] = deque(maxlen=GROWN)
        self._below_level: deque[float] = deque(maxlen=WANDERED)
        """How far below the horizon the foot of crop ahead was seen, rad."""
        self._elsewhere = 0
        self._clear = 0
        self._lay = False
        """Whether the last picture showed crop that lies."""

    def see(self, bgr: Picture, *, stages: bool = False) -> CropView:
        return self._scale.grown(self._see(self._scale.shrunk(bgr), stages))

    def _see(self, bgr: Picture, stages: bool) -> CropView:
        seen, pictures = self._source.look(bgr, stages, self._cutting and self._below_tops)
        if self._below_tops and before_lens(seen.grey[self._level :]):
            return CropView(0.0, hidden=True, reason=HIDES, stages=pictures)
        expected = self._expected()
        stands = 0.0 if self._cutting else max(0.0, self._stands_m - APPROACH_M)
        tops = statistics.median(self._tops) if len(self._tops) >= TRACKED else NAN
        grown = statistics.median(self._all_tops) if len(self._all_tops) >= TRACK else NAN
        self._lens.see(seen.grey)
        meets = not (self._cutting or self._near)
        face = self._finder.find(seen, stands, expected, tops, grown, meets=meets)
        late = self._near and not self._cutting and self._below_tops
        if late and face.ahead_m > NEAR_M:
            face = self._finder.last(self._source.look(bgr, False, True)[0], face, grown)
        lies = self._lies(bgr, face, expected)
        if self._cutting and face.ahead_m < AT_BLADE_M and math.isfinite(face.tops_px):
            self._tops.append(face.tops_px)
            self._all_tops.append(face.tops_px)
        if face.ahead_confidence >= SURE:
            self._stands_m = face.ahead_m if face.ahead_m < NEAR_M else math.inf
            self._cutting = self._cutting or face.ahead_m < AT_BLADE_M
            self._near = self._near or self._cutting
        wanders = self._wanders(face)
        covered = self._covered(face)
        by_height_m = self._by_height(face, grown)
        confidence = face.right_confidence * self._steadiness(face, expected)
        ahead_confidence = face.ahead_confidence * self._lasting(face)
        if self._foot_hidden(face, by_height_m, grown):
            ahead_confidence *= DOUBT
        if covered or wanders:
            confidence *= DOUBT
        if wanders:
            # behind what was cut last, the next crop comes and goes about where it is out of sight
            ahead_confidence *= 1.0 if self._near else DOUBT
        self._dustless = max(0, self._dustless - self._cutting)
        height = l_height(seen.upright)
        if math.isnan(self._l_reference) and confidence >= SURE:
            self._l_reference = height
        offset = face.right_m - self._expected_m
        e_outer, o_map, edge = self._drawn(face)
        return CropView(
            confidence if math.isfinite(offset) else 0.0,
            edge_offset_m=offset,
            edge_offset_most_m=self._most(face),
            edge_beside_m=face.beside_m - self._expected_m,
            crop_right=face.crop_right,
            edge_ahead_m=max(0.0, face.at_x_m - self._vehicle.blade_x_m),
            crop_ahead_m=face.ahead_m,
            ahead_confidence=ahead_confidence,
            ahead_by_height_m=by_height_m,
            tip_share=HIDDEN_DENSE if self._below_tops else NAN,
            end_of_field=self._end_of_field(height),
            e_outer_px=e_outer,
            o_map_px=o_map,
            l_height_px=height,
            l_reference_px=self._l_reference,
            standing=face.standing,
            edge_px=edge,
            lies_confidence=lies,
            reason=self._reason(face, confidence, wanders, covered),
            stages=pictures,
        )

    def glance(self, bgr: Picture) -> CropView:
        del bgr
        return CropView(0.0, reason="not looked at: it turns")

    def next_crop(self, gap_m: float) -> None:
        """As `Detector.next_crop`."""
        self._finder.next_crop(gap_m)

    def restart(self, *, turned: bool = True) -> None:
        """The blade is out of the crop; the paper's references stay."""
        self._cutting = False
        self._near = self._near and not turned
        self._dustless = TRACKED
        self._stands_m = math.inf
        self._track.clear()
        self._tops.clear()
        self._below_level.clear()
        self._elsewhere = 0
        self._clear = 0

    def _expected(self) -> float:
        """Where the right end should be by what was seen before; NaN: nothing was. Of two places
        never one between them."""
        return statistics.median_low(self._track) if len(self._track) >= TRACKED else NAN

    def _most(self, face: Face) -> float:
        at_blade = face.ahead_m < AT_BLADE_M and face.ahead_confidence >= SURE
        return face.out_to_m - self._expected_m if at_blade else NAN

    def _by_height(self, face: Face, grown_px: float) -> float:
        """`CropView.ahead_by_height_m`."""
        known = math.isfinite(face.ahead_m + face.tops_px + grown_px)
        return self._finder.by_height_m(face, grown_px) if known and self._below_tops else NAN

    def _foot_hidden(self, face: Face, by_height_m: float, grown_px: float) -> bool:
        """Whether crop looks so high that it stands nearer than its foot seems to, and near."""
        if not self._finder.by_tops_m(face, grown_px) < HIDDEN_NEAR_M:
            return False
        behind_m = self._vehicle.blade_x_m - float(self._camera.position[0])
        return behind_m + by_height_m < FOOT_HIDDEN * (behind_m + face.ahead_m)

    def _steadiness(self, face: Face, expected: float) -> float:
        """Remembers a clear right end; factor on the confidence in it."""
        if self._cutting and face.ahead_m >= NEAR_M:
            return DOUBT  # not the face that is being cut
        known = math.isfinite(expected)
        if not known and self._cutting and self._track and self._dustless:
            expected = self._track[0]
        elif not known and self._cutting and not self._dustless:
            expected = self._expected_m
        away = abs(face.right_m - expected)
        if face.right_confidence >= SURE:
            # what dust hides makes the end seem too far left, never too far right
            leapt = face.right_m - expected > LEAP_M
            self._elsewhere = self._elsewhere + 1 if leapt else 0
            if self._elsewhere > BELIEVED:
                self._track.extend([face.right_m] * TRACK)
                return 1.0
            if not leapt:
                self._track.append(face.right_m)
        return DOUBT if away > (TRACK_M if known else LEAP_M) else 1.0

    def _lies(self, bgr: Picture, face: Face, expected: float) -> float:
        """How surely crop lies at the blade, where none stands."""
        if self._cutting and face.ahead_m < AT_BLADE_M:
            if min(face.ahead_confidence, face.right_confidence) >= SURE:
                self._lying.learn(bgr, face.right_m)
            return 0.0
        if not self._near or face.ahead_m < AHEAD_M:
            return 0.0
        lies = self._lying.confidence(bgr, expected)
        if self._lay and lies < SURE:
            self._clear = 0  # what is clear now was not before
        self._lay = lies >= SURE
        return lies

    def _covered(self, face: Face) -> bool:
        """Whether something on the lens hides where the crop ends."""
        if not (self._lens.covered.any() and math.isfinite(face.right_m + face.at_x_m)):
            return False
        top = min(self._vehicle.crop_height_m, BELOW_CAMERA * float(self._camera.position[2]))
        aside, z = np.meshgrid(np.linspace(0.01, BESIDE_M, 6), np.linspace(LOWEST_M, top, 12))
        x = np.full(aside.size, face.at_x_m)
        return any(
            self._lens.share(
                self._camera.project(
                    np.column_stack([x, face.right_m + side * aside.ravel(), z.ravel()])
                )
            )
            > COVERED
            for side in (-1.0, 1.0)
        )

    def _wanders(self, face: Face) -> bool:
        """Whether the crop ahead, before it is cut, seems to come and go."""
        if self._cutting:
            self._below_level.clear()
            return False
        if math.isnan(face.ahead_m):
            return False
        x_c, _, z_c = (float(c) for c in self._camera.position)
        away = self._vehicle.blade_x_m - x_c + min(face.ahead_m, FAR_M)
        self._below_level.append(math.atan2(z_c, away))
        risen = sum(max(0.0, before - now) for before, now in pairwise(self._below_level))
        return face.ahead_m < FAR_M and risen > WANDER_RAD

    def _lasting(self, face: Face) -> float:
        """Counts the pictures without crop near ahead; factor on the confidence in them."""
        if not self._cutting or face.ahead_m < NEAR_M:
            self._clear = 0
            return 1.0
        self._clear += 1
        return DOUBT if self._clear <= (CLEAR_VEILED if face.veiled else CLEAR) else 1.0

    def _end_of_field(self, height: float) -> float:
        """The paper's rule: l_height below l_reference by more than the tolerance; 0.5 at it."""
        if math.isnan(height) or math.isnan(self._l_reference):
            return 0.0
        tolerance = L_TOLERANCE * self._camera.size[1]
        # seen from above the tops, what is further away appears higher, not lower
        sense = 1.0 if self._below_tops else -1.0
        beyond = sense * (height - self._l_reference) / tolerance
        return float(min(1.0, max(0.0, 0.5 * beyond)))

    def _drawn(self, face: Face) -> tuple[float, float, Edge | None]:
        """Columns of E_outer and O_map, NaN without, and the upright border of the face, from the
        ground to the tops. All at once: a call takes as long for one point as for twelve."""
        x = face.at_x_m if math.isfinite(face.at_x_m) else self._vehicle.blade_x_m
        points = np.empty((12, 3))
        points[:2, 0], points[2:, 0] = x, face.at_x_m
        points[:, 1], points[1, 1] = face.right_m, self._expected_m
        points[:, 2] = self._drawn_z
        pixels = self._camera.project(points)
        known = not math.isnan(face.right_m)
        edge = pixels[2:].astype(np.float32) if known else None
        return float(pixels[0, 0]), float(pixels[1, 0]), edge

    @staticmethod
    def _reason(face: Face, confidence: float, wanders: bool, covered: bool) -> str:
        if confidence >= SURE:
            return ""
        if covered:
            return "something on the lens hides where the crop ends: wipe it"
        if wanders:
            return "the crop ahead seems to come and go: blur, glare or shade hides its foot"
        if face.right_confidence >= SURE:
            return "the crop's right end seems to have jumped"
        if face.ahead_confidence < SURE:
            return "the picture shows too little to say anything"
        if not math.isfinite(face.at_x_m):
            return "no standing crop near ahead"
        return "the crop ahead has no clear right end"


def make_detector(
    mode: Mode,
    vehicle: Vehicle,
    mount: Mount,
    *,
    side: Literal["left"] = "left",
    params: PaperParams | None = None,
) -> MountedDetector:
    """The detector of `mode` for a mount; `side` is where the crop stands, seen from the cut.
    UserError where the mount cannot show it."""
    if side != "left":
        raise ValueError(f"side {side!r}: the machine keeps the standing crop to its left")
    scale = scale_of(mount)
    camera = Camera(scale.mount)
    check_view(camera, vehicle)
    source: Source
    if mode == "paper":
        source = PaperSource(params or PaperParams(), camera, vehicle)
    else:
        source = RobustSource(camera, vehicle)
    return MountedDetector(source, camera, vehicle, scale)
