"""Rendered views of what drives along edges hold little of: crop beside a machine that has come off
its strip, or that cuts inside of its edge, what an earlier strip has left beside the edge that is
cut, and the next field's crop beside a narrow gap.

`daranti-hil vision --beside N`. The machine stands, or all but stands; a view is a function of
(seed, number, kind) alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.bench.sight import BESIDE_LEFT_M
from hil.studies.vision_drives import Drive, Edge, prepared
from host.estimate.crop_ahead import CONFIDENT, END_CLEAR_M
from host.vision.mounted.detector import make_detector
from host.vision.view import BESIDE_AHEAD_M, CropView
from sim_plant.camera import Camera

Kind = Literal["beside", "far", "remnant", "plain", "flank", "inside", "narrow"]
KINDS: tuple[Kind, ...] = ("beside", "far", "remnant", "plain", "flank", "inside", "narrow")
OFF_M: Final = {"beside": (0.95, 1.6), "far": (2.4, 4.0), "flank": (0.85, 1.0)}
"""How far right of its lane the machine stands: off its crop, out of reach of any, and on the lane
before, as it backs beside the next strip."""
GAP_M, WIDE_M = (0.3, 0.8), (0.15, 0.4)
"""Between the edge and what an earlier strip has left, and how wide that is."""
INSIDE_M: Final = (0.3, 1.5)
"""How far inside of the edge the machine cuts."""
NARROW_M: Final = (1.0, 1.5)
"""The gap to the next field's crop beside the machine."""
ASKEW_RAD: Final = {"beside": 0.12, "far": 0.12, "flank": 0.04}
STANDS_M: Final = (4.0, 9.0)
"""Along the edge."""
PICTURES: Final = 4
"""Of a view, the last of which counts: the detector remembers."""
WITHIN_M: Final = 0.12
"""Of the true edge: the one that is meant."""
NEXT_M: Final = BESIDE_LEFT_M[1] + 0.6
"""Left of where an edge should be, crop that is out of reach: half a blade, and what views err."""
FAR_M: Final = 60.0
"""Farther than any field reaches."""


@dataclass(frozen=True, slots=True)
class Judged:
    """Views of one kind from one mount."""

    views: int
    seen: int
    """Where the edge that is asked for was said; of far crop: where any was."""
    rms_m: float
    """Of those, NaN without."""
    sure: int
    """Of the edge before the blade."""
    crop_right: int
    """Views that say that crop stands right of the blade."""


def _cleared(edge: Edge, below_m: float, above_m: float = -FAR_M, to_x: float = FAR_M) -> None:
    """Cuts all crop between two lines along the edge, up to a place along it."""
    edge.crop.clear(((-FAR_M, above_m), (to_x, above_m), (to_x, below_m), (-FAR_M, below_m)))


def views(
    seed: int, count: int, mount: str, kind: Kind, *, told: bool = True
) -> Iterator[tuple[CropView, float]]:
    """What the detector says, and how much farther left than it should the true edge lies
    (`edge_offset_m`): the one beside the machine's way, or the one before its blade. `told`:
    whether the detector knows how wide the gap is."""
    for number in range(count):
        edge = prepared(Drive(seed, number, mount, "robust", 20.0, "", dust=0.0))
        rng = np.random.default_rng((seed, number, KINDS.index(kind)))
        v = edge.vehicle
        lane_m = 0.5 * v.blade_width_m - v.overlap_m
        x, next_m = float(rng.uniform(*STANDS_M)), math.inf
        if kind in OFF_M:
            askew = ASKEW_RAD[kind]
            off_m, yaw = float(rng.uniform(*OFF_M[kind])), float(rng.uniform(-askew, askew))
            y = edge.depth_m + lane_m - off_m
            _cleared(edge, edge.depth_m)
            ahead_m = v.blade_x_m + BESIDE_AHEAD_M
            true_m = (off_m - lane_m) / math.cos(yaw) - math.tan(yaw) * ahead_m + v.inset_m
        else:
            off_m, yaw = float(rng.uniform(-0.1, 0.1)), float(rng.uniform(-0.05, 0.05))
            line_m = edge.depth_m + 1.6
            y = line_m + lane_m + off_m
            gap_m, wide_m = float(rng.uniform(*GAP_M)), float(rng.uniform(*WIDE_M))
            if kind == "inside":
                _cleared(edge, line_m - float(rng.uniform(*INSIDE_M)))
            elif kind == "narrow":
                next_m = float(rng.uniform(*NARROW_M))
                _cleared(edge, line_m, line_m - next_m)
            elif kind == "remnant":
                _cleared(edge, line_m - gap_m - wide_m)
                _cleared(edge, line_m, line_m - gap_m)
            else:
                _cleared(edge, line_m)
            _cleared(edge, line_m + 1.0, line_m, x + v.blade_x_m + float(rng.uniform(0.0, 0.05)))
            true_m = -off_m - math.tan(yaw) * v.blade_x_m
        yield _seen(edge, (x, y, yaw), next_m if told else math.inf), true_m


def _seen(edge: Edge, pose: tuple[float, float, float], gap_m: float) -> CropView:
    scenario = edge.scenario
    camera = Camera(edge.crop, scenario.world.lens, scenario.weather, scenario.seed, threads=1)
    detector = make_detector("robust", edge.vehicle, scenario.mount)
    detector.next_crop(gap_m)
    roll, pitch = edge.crop.bumps(*pose)
    view = CropView(0.0)
    for k in range(PICTURES):
        bgr = camera.capture(0.1 * k, *pose, roll, pitch, 0.0, 0.0, False)
        coded: NDArray[np.uint8] = np.frombuffer(camera.encode(bgr), np.uint8)
        view = detector.see(np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.uint8))
    return view


def judged(seed: int, count: int, mount: str, kind: Kind, *, told: bool = True) -> Judged:
    """All views of a kind. Crop beside the way is asked for only where it is within reach, and none
    is said ahead; on a strip's flank whatever is said ahead."""
    asked = seen = sure = crop_right = 0
    errors: list[float] = []
    for view, true_m in views(seed, count, mount, kind, told=told):
        sure += view.confidence >= CONFIDENT
        crop_right += view.crop_right
        if kind in ("remnant", "plain", "inside", "narrow"):
            asked += 1
            off = view.edge_offset_m - true_m
            if abs(off) < WITHIN_M:
                seen += 1
                errors.append(off)
            continue
        within = true_m > NEXT_M if kind == "far" else true_m < BESIDE_LEFT_M[1]
        blocked = kind != "flank" and view.crop_ahead_m < END_CLEAR_M
        if blocked or not within:
            continue
        asked += 1
        if math.isfinite(view.edge_beside_m):
            seen += 1
            errors.append(view.edge_beside_m - true_m)
    rms = math.sqrt(float(np.mean(np.square(errors)))) if errors else math.nan
    return Judged(asked, seen, rms, sure, crop_right)
