"""The detectors judged on labelled photographs, each side given: the photographs' own as it is, the
mounted one by guessed mounts, since nobody knows where these photographs were taken from."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.studies.vision_drives import Said
from host.core.vehicle import Mount, Vehicle
from host.vision.mounted.detector import make_detector
from host.vision.photo.detector import RobustPhoto
from host.vision.photo.score import Labelled, lateral_error
from host.vision.view import CropView

MOUNTS: Final = {
    "low": Mount(x_m=0.1, y_m=0.0, z_m=0.6, pitch_deg=5.0),
    "mast": Mount(x_m=0.0, y_m=0.0, z_m=1.6, pitch_deg=28.0),
    "cab": Mount(x_m=0.0, y_m=0.0, z_m=2.8, pitch_deg=32.0),
    "high cab": Mount(x_m=0.0, y_m=0.0, z_m=3.5, pitch_deg=45.0),
}
"""Guesses of where a photograph was taken from, all with a phone's 62° along the longer side."""
HFOV_DEG: Final = 62.0
WIDTH_PX: Final = 640
"""To which a photograph is brought for a mounted detector."""
WRONG: Final = 0.10
"""Of the picture's width: an edge so far from the true one is wrong, for both detectors."""


def as_mounted(
    items: list[Labelled], guess: str, mode: Literal["robust", "paper"] = "robust"
) -> Iterator[tuple[Labelled, Said, CropView]]:
    """What the detector that drives says of each photograph, shown alone, as if taken from one of
    MOUNTS, off by a share of the width; only those with the crop to a side, mirrored where it
    stands right."""
    vehicle = Vehicle()
    for item in items:
        if not item.lateral:
            continue
        bgr, standing = item.picture(), item.standing()
        if item.side == "right":
            bgr, standing = bgr[:, ::-1], standing[:, ::-1]
        height = round(WIDTH_PX * bgr.shape[0] / bgr.shape[1])
        size = (WIDTH_PX, height)
        small = np.ascontiguousarray(cv2.resize(bgr, size, interpolation=cv2.INTER_AREA), np.uint8)
        label = cv2.resize(standing.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
        across = HFOV_DEG
        if height > WIDTH_PX:
            tangent = math.tan(math.radians(HFOV_DEG) / 2) * WIDTH_PX / height
            across = math.degrees(2 * math.atan(tangent))
        mount = MOUNTS[guess].model_copy(
            update={"width_px": WIDTH_PX, "height_px": height, "hfov_deg": across}
        )
        view = make_detector(mode, vehicle, mount).see(small)
        yield item, (view.confidence, off_by(view, np.asarray(label > 0))), view


def off_by(view: CropView, standing: NDArray[np.bool_]) -> float | None:
    """The median distance between the said and the labelled edge, as a share of the width, over the
    points of the said one whose row has one labelled edge; None where no such point is."""
    if view.edge_px is None:
        return None
    height, width = standing.shape
    errors = []
    for u, v in view.edge_px:
        if not (math.isfinite(u) and math.isfinite(v) and 0 <= v < height):
            continue
        changes = np.flatnonzero(standing[int(v), 1:] != standing[int(v), :-1])
        if len(changes) == 1:
            errors.append(abs(float(u) - (changes[0] + 1)) / width)
    return float(np.median(errors)) if errors else None


def as_photographs(items: list[Labelled]) -> Iterator[tuple[Labelled, Said]]:
    """What the photographs' detector says of each, off by a share of the width."""
    for item in items:
        if not item.lateral:
            continue
        view = RobustPhoto(item.side).see(item.picture())
        if view.standing is None:
            yield item, (view.confidence, None)
            continue
        yield item, (view.confidence, lateral_error(item.standing(), view.standing))
