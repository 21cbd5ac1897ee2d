"""Pictures that are not what the host takes them for: the camera was knocked while the machine
drove, or the phone's app turns them over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np

from hil.bench.eyes import PictureEyes
from hil.bench.lockstep import Bench
from hil.bench.model_eyes import ModelEyes
from host.core.errors import UserError
from host.sensors.jpeg import Bgr
from host.vision.view import Detector
from sim_plant.camera import CameraSpec

FLIPS: Final = {"mirrored": 1, "upside down": -1}
"""What an app may do to every picture, as cv2.flip numbers it."""


@dataclass(frozen=True, slots=True)
class WrongPictures:
    """What is wrong with them."""

    flip: str = ""
    """One of FLIPS; empty: none. Only pictures can be turned over, no model of a detector."""
    knocked_at_s: float = 0.0
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0
    roll_deg: float = 0.0
    """By how much the mount is knocked then."""

    def eyes(self, bench: Bench) -> WrongEyes:
        """Of a bench's machine."""
        return WrongEyes(self, bench)

    def knocked(self, lens: CameraSpec) -> CameraSpec:
        """The camera after the knock."""
        angles = ("pitch_deg", "yaw_deg", "roll_deg")
        turned = {name: getattr(lens, name) + getattr(self, name) for name in angles}
        return lens.model_copy(update=turned)


class WrongEyes:
    """The scenario's own eyes, whose pictures are wrong."""

    def __init__(self, wrong: WrongPictures, bench: Bench) -> None:
        model = bench.scenario.eyes == "model"
        if model and wrong.flip:
            raise UserError(f"model eyes know no picture that is {wrong.flip}: use --eyes picture")
        self._wrong = wrong
        self._bench = bench
        self._eyes = ModelEyes(bench) if model else PictureEyes(bench)
        self._knocked = (wrong.pitch_deg, wrong.yaw_deg, wrong.roll_deg) == (0.0, 0.0, 0.0)
        self.takes_pictures = self._eyes.takes_pictures

    def shutter(self) -> Any:
        """As the eyes', after the knock by the camera as it looks then."""
        if not self._knocked and self._bench.now >= self._wrong.knocked_at_s:
            self._knocked = True
            self._eyes.knock(self._wrong.knocked(self._bench.world.lens))
        return self._eyes.shutter()

    def develop(self, shot: Any) -> tuple[bytes, Bgr]:
        """As the eyes', turned over by the app, which packs the file anew."""
        data, bgr = self._eyes.develop(shot)
        if not self._wrong.flip:
            return data, bgr
        over = np.ascontiguousarray(cv2.flip(bgr, FLIPS[self._wrong.flip]))
        data = cv2.imencode(".jpg", over)[1].tobytes()
        return data, self.decode(data)

    def decode(self, data: bytes) -> Bgr:
        """As the eyes'."""
        return self._eyes.decode(data)

    def detector(self) -> Detector:
        """The eyes' own, which knows nothing of it."""
        return self._eyes.detector()
