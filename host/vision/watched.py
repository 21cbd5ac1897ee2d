"""A detector behind its camera's watch: how every run, bench and replay puts one together."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import Mount, Vehicle
from host.sensors.picture_watch import PictureWatch
from host.vision.mounted.detector import Mode, make_detector
from host.vision.mounted.paper import PaperParams
from host.vision.shown_motion import ShownMotion
from host.vision.view import NAN, CropView, Detector

PROVED: Final = 3
"""Sound pictures in a row after a spoiled one until they are believed: of spoiled files one in ten
looks sound, and would keep a blind machine driving. And so many without a jump, or without stems
right before the lens, until they tell of motion and are measured: of 114 that a low camera took
between such stems (picture field 10423), 35 surely showed open ground."""
JUMPED: Final = "the camera's picture is quite another than the one before"
"""In words, for the view."""


class WatchedDetector:
    """A detector that is shown only what its camera's watch believes."""

    def __init__(self, detector: Detector, mount: Mount) -> None:
        self._detector = detector
        self._watch = PictureWatch(mount.width_px, mount.height_px)
        self._motion = ShownMotion(mount, *self._watch.small_size)
        self._spoilt = ""
        self._upset = ""
        self._calm = PROVED
        """How many pictures ago the last one was upset: jumped, or showed stems before the lens."""
        self._sound = PROVED

    def see(self, bgr: NDArray[np.uint8], *, stages: bool = False) -> CropView:
        """The detector's view, or one without any confidence that says why."""
        problem = self._problem(bgr)
        return self._moved(problem or self._calmed(self._detector.see(bgr, stages=stages)))

    def glance(self, bgr: NDArray[np.uint8]) -> CropView:
        """Likewise, of a picture in which nothing is to be measured."""
        problem = self._problem(bgr)
        return self._moved(problem or self._calmed(self._detector.glance(bgr)))

    def _calmed(self, view: CropView) -> CropView:
        """The view, if no picture just before it was upset."""
        if view.hidden:
            self._calm, self._upset = 0, view.reason
            return view
        return view if self._calm >= PROVED else CropView(0.0, reason=self._upset)

    def _moved(self, view: CropView) -> CropView:
        """The view, and how the camera has moved. Just after a jump what still stands right before
        the lens would pass for the ground."""
        watch = self._watch
        turn_rad, way_m = self._motion.take(watch.small)
        if self._calm < PROVED:
            turn_rad = way_m = NAN
        return replace(view, shown_turn_rad=turn_rad, shown_way_m=way_m, same_ago=watch.same_ago)

    def _problem(self, bgr: NDArray[np.uint8]) -> CropView | None:
        problem = self._watch.problem(bgr)
        self._sound = 0 if problem else self._sound + 1
        self._spoilt = problem or self._spoilt
        self._calm += 1
        if self._sound < PROVED:
            return CropView(0.0, usable=False, reason=self._spoilt)
        if self._watch.jumped:
            # Stalks right before the lens do that: nothing to be measured, but no dead camera.
            self._calm, self._upset = 0, JUMPED
            return CropView(0.0, reason=JUMPED)
        return None

    def next_crop(self, gap_m: float) -> None:
        """As the detector's."""
        self._detector.next_crop(gap_m)

    def restart(self, *, turned: bool = True) -> None:
        """As the detector's; the camera is still the same."""
        self._detector.restart(turned=turned)


def watched_detector(
    mode: Mode, vehicle: Vehicle, mount: Mount, params: PaperParams | None = None
) -> WatchedDetector:
    """The detector of a mode on a mount of the machine; `params`: of the paper's mode."""
    return WatchedDetector(make_detector(mode, vehicle, mount, params=params), mount)
