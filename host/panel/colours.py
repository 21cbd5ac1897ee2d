"""The sliders for the paper's colours, on a picture of the machine's own camera."""

from __future__ import annotations

import datetime
from pathlib import Path

from pydantic import ValidationError

from host.core.errors import UserError
from host.core.vehicle import Mount, Vehicle
from host.panel.colour_page import Tuner
from host.panel.snapshot import Json
from host.runs.drive import fits, fitted
from host.sensors.camera_stream import Picture
from host.sensors.jpeg import JpegDecoder
from host.vision.mounted.detector import MountedDetector, make_detector
from host.vision.mounted.paper import PaperParams
from host.vision.tuning.profiles import DATABASE, Circumstance, Profiles
from host.vision.tuning.search import mounted_contrast


class ColourDesk:
    """One picture and its tuner. Slow: the panel calls it in a thread."""

    def __init__(
        self, vehicle: Vehicle, mount: Mount, name: str, database: Path = DATABASE
    ) -> None:
        """`name`: the mount's."""
        self._vehicle, self._mount, self._name = vehicle, mount, name
        self._database = database
        self._tuner: Tuner | None = None
        self._params = PaperParams()

    def do(self, wish: Json, jpeg: bytes | None) -> Json:
        """The answer to one wish; `jpeg`: the camera's newest picture."""
        try:
            return {"kind": "colour", **self._do(wish, jpeg)}
        except (UserError, ValidationError) as error:
            first = error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error)
            return {"kind": "colour", "error": first}

    def _do(self, wish: Json, jpeg: bytes | None) -> Json:
        what = wish.get("do")
        if self._tuner is None or what == "colour_take":
            self._take(jpeg)
        tuner = self._tuner
        assert tuner is not None
        if what in ("colour_begin", "colour_take"):
            begun = tuner.begin()
            return {**begun, **tuner.look(0, tuner.start)}
        params = PaperParams.model_validate(wish.get("params") or {})
        match what:
            case "colour_best":
                found = tuner.best(params)
                best = PaperParams.model_validate(found["params"])
                return {**tuner.look(0, best), **found}
            case "colour_save":
                return tuner.save(params)
            case _:
                return tuner.look(0, params)

    def _take(self, jpeg: bytes | None) -> None:
        if jpeg is None:
            raise UserError("no picture from the camera yet")
        frame = fitted(Picture(0.0, jpeg), JpegDecoder(), self._mount, 0.0)
        if not fits(frame, self._mount):
            raise UserError("the camera's picture has another size than the mount")

        def make(params: PaperParams) -> MountedDetector:
            return make_detector("paper", self._vehicle, self._mount, params=params)

        now = datetime.datetime.now().astimezone()
        where = Circumstance(now.hour + now.minute / 60, mount=self._name)
        with Profiles(self._database) as profiles:
            near = profiles.nearest(where)
        start = near.params if near else PaperParams()
        contrast = mounted_contrast([frame.bgr], make)
        pictures = [("now", frame.bgr)]
        self._tuner = Tuner(
            pictures,
            lambda _, params: make(params),
            contrast,
            start,
            self._database,
            where,
            lambda: datetime.datetime.now().astimezone(),
        )
