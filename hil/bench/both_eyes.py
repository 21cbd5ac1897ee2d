"""The model's eyes drive, and the real detector is shown pictures of the same moments: what it says
of situations that the model has led the pilot into."""

from __future__ import annotations

from typing import Any

from hil.bench.eyes import WitnessedEyes
from hil.bench.model_eyes import ModelEyes
from host.sensors.jpeg import Bgr
from host.vision.view import CropView, Detector


class BothEyes:
    """A model's eyes and a witness beside them."""

    takes_pictures = False

    def __init__(self, model: ModelEyes, witness: WitnessedEyes) -> None:
        self.witness = witness
        self.answers: list[CropView] = []
        """The model's to each picture that `witness.seen` has."""
        self._model = model
        self._pictures: dict[bytes, Bgr] = {}

    def shutter(self) -> tuple[int, Any]:
        """The model's shot and the camera's."""
        return self._model.shutter(), self.witness.shutter()

    def develop(self, shot: tuple[int, Any]) -> tuple[bytes, Bgr]:
        """As the model's; the picture is kept for the detector that is shown it."""
        number, taken = shot
        data, bgr = self._model.develop(number)
        if taken is not None:
            _, self._pictures[data] = self.witness.develop(taken)
            while len(self._pictures) > 16:
                self._pictures.pop(next(iter(self._pictures)))
        return data, bgr

    def decode(self, data: bytes) -> Bgr:
        """As the model's."""
        return self._model.decode(data)

    def detector(self) -> Detector:
        """The model's, whose pictures the real one is shown too."""
        return _Both(self, self._model.detector(), self.witness.detector())

    def picture(self, bgr: Bgr) -> Bgr | None:
        """What the camera took when the model was shown this; None where it did not."""
        return self._pictures.get(bgr.tobytes())


class _Both:
    def __init__(self, eyes: BothEyes, model: Detector, real: Detector) -> None:
        self._eyes, self._model, self._real = eyes, model, real

    def see(self, bgr: Bgr, *, stages: bool = False) -> CropView:
        view = self._model.see(bgr, stages=stages)
        picture = self._eyes.picture(bgr)
        if picture is not None:
            known = len(self._eyes.witness.seen)
            self._real.see(picture)
            if len(self._eyes.witness.seen) > known:
                self._eyes.answers.append(view)
        return view

    def glance(self, bgr: Bgr) -> CropView:
        picture = self._eyes.picture(bgr)
        if picture is not None:
            self._real.glance(picture)
        return self._model.glance(bgr)

    def next_crop(self, gap_m: float) -> None:
        self._real.next_crop(gap_m)

    def restart(self, *, turned: bool = True) -> None:
        self._real.restart(turned=turned)
        self._model.restart(turned=turned)
