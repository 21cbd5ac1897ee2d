"""A detector that reads the truth, and scenarios whose pictures cost nothing: for tests in which
vision is not the subject."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.bench.harvest import Harvest
from hil.bench.lockstep import Bench
from hil.judge.metrics import OVERLAP_M
from hil.scenario.scenario import Scenario
from host.vision.view import CropView

PROBES_M = (0.1, 0.6)
"""The edge is read this far before the blade."""


class Oracle:
    """Sees the field's own grid, at the moment when it is asked."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    def see(self, bgr: NDArray[np.uint8], *, stages: bool = False) -> CropView:
        del bgr, stages
        bench = self._bench
        v = bench.world.machine
        x, y, yaw = bench.pose
        c, s = math.cos(yaw), math.sin(yaw)
        right = -v.blade_width_m / 2
        crop = bench.field
        found = []
        for probe in PROBES_M:
            ahead = v.blade_x_m + probe
            at = x + ahead * c - right * s, y + ahead * s + right * c
            found.append(crop.true_edge_offset(*at, yaw, 0.6))
        bx, by = x + v.blade_x_m * c, y + v.blade_x_m * s
        ahead_m = crop.crop_ahead(bx, by, yaw, 0.9 * v.blade_width_m, 5.0)
        if not all(map(math.isfinite, found)):
            return CropView(0.0, crop_ahead_m=ahead_m, ahead_confidence=1.0, reason="no edge")
        return CropView(
            0.95,
            edge_offset_m=found[0] - OVERLAP_M,
            edge_heading_rad=math.atan2(found[1] - found[0], PROBES_M[1] - PROBES_M[0]),
            crop_ahead_m=ahead_m,
            ahead_confidence=1.0,
        )

    def glance(self, bgr: NDArray[np.uint8]) -> CropView:
        return self.see(bgr)

    def next_crop(self, gap_m: float) -> None:
        """Nothing is hidden by dust."""

    def restart(self, *, turned: bool = True) -> None:
        """Nothing is tracked."""


def quick(**changes: Any) -> Scenario:
    """A small field, tiny pictures, ten seconds."""
    values: dict[str, Any] = {
        "name": "quick",
        "field": {"size_m": (4.0, 3.0), "neighbour_depth_m": 2.0},
        "lens": {"width_px": 64, "height_px": 48},
        "belief": "exact",
        "limits": {"time_s": 10.0},
    }
    return Scenario.model_validate(values | changes)


def run_for_ever(path: str) -> None:
    """Records a run that somebody else must end."""
    cv2.setNumThreads(1)
    Harvest(quick(limits={"time_s": 1e6}), Path(path), detector=Oracle).run()
