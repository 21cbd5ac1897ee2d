"""Pictures of any size, brought to the scale at which this package's lengths in pixels hold.

Stems are a pixel or two wide and steps of brightness are taken from pixel to pixel: at three times
the size neither is what it was. What counts is the pixels per radian, not the picture's size.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from host.core.vehicle import Mount
from host.vision.pictures import Picture, u8
from host.vision.view import CropView

FOCAL_PX = 532.0
"""Focal length of 640 pixels over 62°, for which the lengths in pixels were chosen."""
AS_IT_IS = (0.8, 1.25)
"""Times that focal length, between which a picture is taken as it is."""
LEAST_PX, LARGEST_PX = 64, 2048
"""Sides of the picture that a detector works on, least and greatest."""


@dataclass(frozen=True, slots=True)
class Scale:
    """Between a camera's pictures and those that a detector works on."""

    given: tuple[int, int]
    """Width and height of the camera's pictures."""
    mount: Mount
    """Of the pictures that are worked on."""

    @property
    def _factors(self) -> tuple[float, float]:
        return self.mount.width_px / self.given[0], self.mount.height_px / self.given[1]

    def shrunk(self, bgr: Picture) -> Picture:
        """The picture that is worked on."""
        size = (self.mount.width_px, self.mount.height_px)
        if size == self.given or bgr.shape[1::-1] != self.given:
            return bgr
        smaller = size[0] < self.given[0]
        way = cv2.INTER_AREA if smaller else cv2.INTER_CUBIC
        return u8(cv2.resize(bgr, size, interpolation=way))

    def grown(self, view: CropView) -> CropView:
        """The view in the camera's own pixels; its stages stay as they were worked on."""
        if (self.mount.width_px, self.mount.height_px) == self.given:
            return view
        across, along = self._factors
        edge = None
        if view.edge_px is not None:
            edge = np.asarray(view.edge_px / np.array([across, along]), np.float32)
        return replace(
            view,
            e_outer_px=view.e_outer_px / across,
            o_map_px=view.o_map_px / across,
            l_height_px=view.l_height_px / along,
            l_reference_px=view.l_reference_px / along,
            standing=None if view.standing is None else self._mask(view.standing),
            edge_px=edge,
        )

    def _mask(self, standing: NDArray[np.bool_]) -> NDArray[np.bool_]:
        grown = cv2.resize(standing.view(np.uint8), self.given, interpolation=cv2.INTER_NEAREST)
        return np.asarray(grown > 0)


def scale_of(mount: Mount) -> Scale:
    """For a camera's mount; a focal length near the usual one leaves pictures as they are."""
    given = (mount.width_px, mount.height_px)
    factor = FOCAL_PX / mount.focal
    sides = tuple(round(factor * side) for side in given)
    if AS_IT_IS[0] <= 1 / factor <= AS_IT_IS[1] or min(sides) < LEAST_PX or max(sides) > LARGEST_PX:
        return Scale(given, mount)
    width, height = sides
    across, along = width / given[0], height / given[1]
    u, v = mount.centre
    less = mount.model_copy(
        update={
            "width_px": width,
            "height_px": height,
            "focal_px": mount.focal * across,
            "centre_px": (u * across, v * along),
        }
    )
    return Scale(given, less)
