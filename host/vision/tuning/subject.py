"""What is tuned: the detector of photographs, or that of a camera on the machine, and how well it
tells crop from stubble on given pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from host.core.errors import UserError
from host.core.vehicle import Vehicle
from host.vision.mounted.detector import MountedDetector, make_detector
from host.vision.mounted.paper import PaperParams, PaperPhoto
from host.vision.photo.split import Side
from host.vision.pictures import Picture
from host.vision.tuning.search import Contrast, mounted_contrast, photo_contrast

PHOTO = "photo"
"""In place of a mount: any picture."""


@dataclass(frozen=True, slots=True)
class Subject:
    """`eye` makes the detector of a picture's name and parameters; `contrast` is over all of
    them."""

    eye: Callable[[str, PaperParams], PaperPhoto | MountedDetector]
    contrast: Contrast


def subject_of(
    mount: str, taken: Sequence[tuple[str, Picture]], side_of: Callable[[str], Side]
) -> Subject:
    """`mount`: PHOTO or a mount's name; `side_of`: where the crop stands on a photograph of a name.
    UserError where there is no such mount, or the pictures are not its."""
    if mount == PHOTO:
        return Subject(
            lambda name, params: PaperPhoto(side_of(name), params),
            photo_contrast([(bgr, side_of(name)) for name, bgr in taken]),
        )
    detector = _mounted(mount, taken)
    return Subject(
        lambda _, params: detector(params), mounted_contrast([bgr for _, bgr in taken], detector)
    )


def _mounted(
    name: str, taken: Sequence[tuple[str, Picture]]
) -> Callable[[PaperParams], MountedDetector]:
    """Makes the detector of a mount for given parameters, once the pictures turn out to be its."""
    vehicle = Vehicle()
    if name not in vehicle.mounts:
        known = ", ".join(["photo", *vehicle.mounts])
        raise UserError(f"--mount {name}: no such mount; choose one of {known}")
    mount = vehicle.mounts[name]
    for label, bgr in taken:
        if (bgr.shape[1], bgr.shape[0]) != (mount.width_px, mount.height_px):
            raise UserError(
                f"{label}: {bgr.shape[1]}x{bgr.shape[0]} pixels, but the mount {name} takes "
                f"{mount.width_px}x{mount.height_px}; use its own pictures or --mount photo"
            )

    def make(params: PaperParams) -> MountedDetector:
        return make_detector("paper", vehicle, mount, params=params)

    return make
