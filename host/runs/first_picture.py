"""The first picture of a run's camera, and what is chosen by it."""

from __future__ import annotations

import datetime
from pathlib import Path

from host.core.errors import UserError
from host.core.messages import Frame
from host.core.vehicle import Mount, Vehicle
from host.runs.drive import fits, fitted
from host.sensors.camera_stream import Picture, without_password
from host.sensors.jpeg import MAX_PIXELS, JpegDecoder, size_of
from host.sensors.newest import Feed
from host.vision.mounted.detector import MountedDetector, make_detector
from host.vision.mounted.paper import PaperParams
from host.vision.tuning.profiles import Circumstance
from host.vision.tuning.search import first_params

FIRST_PICTURE_S = 10.0
"""How long the first picture is waited for."""


def first_picture(pictures: Feed[Picture], url: str, mount: Mount) -> Frame | None:
    """None where it is spoiled; UserError where none comes, or its size is not the mount's."""
    if not pictures.wait(FIRST_PICTURE_S):
        raise UserError(
            f"no picture from the camera {without_password(url)} within {FIRST_PICTURE_S:g} s: "
            f"{pictures.problem}; start the phone's camera app and check the address"
        )
    picture = pictures.take()
    return None if picture is None else fitting(picture, mount)


def fitting(picture: Picture, mount: Mount) -> Frame | None:
    """None where a picture is spoiled; UserError where its size is not the mount's."""
    size = size_of(picture.jpeg) if picture.jpeg is not None else None
    if size is not None and size[0] * size[1] > MAX_PIXELS:
        raise UserError(
            f"the camera sends {size[0]}x{size[1]} pixels, more than can be looked at in time: set "
            f"the phone to {mount.width_px}x{mount.height_px}"
        )
    frame = fitted(picture, JpegDecoder(), mount, 0.0)
    if frame.bgr.size == 0:
        return None
    if not fits(frame, mount):
        height, width = frame.bgr.shape[:2]
        raise UserError(
            f"the camera sends {width}x{height} pixels, the mount expects {mount.width_px}x"
            f"{mount.height_px}: set the phone's resolution, or the mount in the vehicle file"
        )
    return frame


def paper_params(
    database: Path, name: str, first: Frame, vehicle: Vehicle, mount: Mount
) -> tuple[PaperParams, str]:
    """The paper's colour thresholds for this hour and mount, and where they are from."""
    now = datetime.datetime.now().astimezone()
    where = Circumstance(now.hour + now.minute / 60, mount=name)

    def make(params: PaperParams) -> MountedDetector:
        return make_detector("paper", vehicle, mount, params=params)

    return first_params(database, where, first.bgr, make)
