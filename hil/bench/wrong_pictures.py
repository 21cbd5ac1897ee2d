"""Pictures that are not what the host takes them for: the camera was knocked while the machine
drove, the phone's app turns them over, or sends old ones again."""

from __future__ import annotations

import math
from collections import deque
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
NOISE_LEVELS: Final = 3.0
"""Standard deviation of the fresh noise of an old picture, in grey levels of 255: by that it is not
the same file again, as a watch for repeated pictures would see at once."""


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
    old_from_s: float = math.inf
    """From then on the app sends old pictures, with fresh noise:"""
    old_s: float = 0.0
    """those of so long before, over and over; 0: the last one alone. Pictures only, as FLIPS."""

    @property
    def only_pictures(self) -> bool:
        """Whether model eyes, which draw no picture, cannot show it."""
        return bool(self.flip) or math.isfinite(self.old_from_s)

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
        if model and wrong.only_pictures:
            what = wrong.flip or "old"
            raise UserError(f"model eyes know no picture that is {what}: use --eyes picture")
        self._wrong = wrong
        self._bench = bench
        self._eyes = ModelEyes(bench) if model else PictureEyes(bench)
        self._knocked = (wrong.pitch_deg, wrong.yaw_deg, wrong.roll_deg) == (0.0, 0.0, 0.0)
        self.takes_pictures = self._eyes.takes_pictures
        self._kept: deque[tuple[float, Bgr]] = deque()
        """(time of the shutter, picture) of those that are to be sent again, the next one first."""
        self._rng = np.random.default_rng(bench.scenario.seed)

    def shutter(self) -> Any:
        """As the eyes', after the knock by the camera as it looks then."""
        if not self._knocked and self._bench.now >= self._wrong.knocked_at_s:
            self._knocked = True
            self._eyes.knock(self._wrong.knocked(self._bench.world.lens))
        return self._bench.now, self._eyes.shutter()

    def develop(self, shot: Any) -> tuple[bytes, Bgr]:
        """As the eyes', turned over or replaced by the app, which packs the file anew."""
        stamp, taken = shot
        data, bgr = self._eyes.develop(taken)
        over = bgr
        if self._wrong.flip:
            over = np.ascontiguousarray(cv2.flip(bgr, FLIPS[self._wrong.flip]))
        elif math.isfinite(self._wrong.old_from_s):
            over = self._again(stamp, bgr)
        if over is bgr:
            return data, bgr
        data = cv2.imencode(".jpg", over)[1].tobytes()
        return data, self.decode(data)

    def _again(self, stamp: float, bgr: Bgr) -> Bgr:
        """The picture that the app sends then: this one, or an old one."""
        kept, wrong = self._kept, self._wrong
        if stamp < wrong.old_from_s:
            kept.append((stamp, bgr))
            while kept[0][0] < stamp - wrong.old_s:
                kept.popleft()
            return bgr
        old = kept[0][1]
        kept.rotate(-1)
        noisy = old + self._rng.normal(0.0, NOISE_LEVELS, old.shape)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)

    def decode(self, data: bytes) -> Bgr:
        """As the eyes'."""
        return self._eyes.decode(data)

    def detector(self) -> Detector:
        """The eyes' own, which knows nothing of it."""
        return self._eyes.detector()
