"""What vision tells the pilot about one picture, in metres and radians of the vehicle frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

NAN = float("nan")
LIES = "what lies ahead is neither stubble nor standing: crop that lies?"
BESIDE_M = (0.4, 2.0)
"""Before the blade's line, where crop beside the machine's way is looked for,"""
BESIDE_AHEAD_M = sum(BESIDE_M) / 2
"""and the middle of that."""


@dataclass(frozen=True, slots=True)
class CropView:
    """One picture's interpretation. NaN where a quantity is not observable in this picture.

    `confidence` (0..1) is the probability that the edge is where `edge_offset_m` says, within
    0.1 m; below 0.5 a pilot must not steer by it.
    """

    confidence: float
    edge_offset_m: float = NAN
    """E_outer against O_map at the blade's line: positive where the crop's outer edge appears left
    of where it should be (the blade's right end), so a positive offset asks to steer left."""
    edge_offset_most_m: float = NAN
    """Crop goes on without a break from the blade's way to here, on the same scale: however little
    is known of the edge, it lies no further left. NaN: no crop stands at the blade."""
    edge_beside_m: float = NAN
    """The right end of the crop that stands beside the machine's way, left of it, `BESIDE_AHEAD_M`
    before the blade's line, on the same scale. NaN: none is seen there."""
    crop_right: bool = False
    """Crop stands right of the blade, beside what it has just cut: the machine is in the crop,
    inside of its edge. False: none does, or it is not in view."""
    edge_ahead_m: float = 0.0
    """How far ahead of the blade's line the edge was seen, along the vehicle: before crop that is
    not being cut yet, `edge_offset_m` is that of its near corner, and says of the blade's line only
    as much as the heading is known."""
    edge_heading_rad: float = NAN
    """Direction of the edge line against the vehicle's x axis, positive where it runs left."""
    crop_ahead_m: float = NAN
    """From the blade's line to the nearest standing crop ahead within the blade's width; 0 while
    cutting, inf where none stands in view, NaN where unknown."""
    ahead_confidence: float = 0.0
    """The same meaning for `crop_ahead_m`, within 0.25 m."""
    ahead_by_height_m: float = NAN
    """The same by how high that crop looks, if it is as high as what was cut: how the camera is
    pitched leaves it as it is. NaN: not known."""
    lies_confidence: float = 0.0
    """That crop lies flattened at the blade, where `crop_ahead_m` says that none stands. Swath that
    an earlier strip has left across the way looks alike: `with_lying` is for who knows that none
    is there."""
    tip_share: float = NAN
    """Share of the blade's width down to which crop that is being cut still counts as ahead: at a
    slanting end it says how near the last tip that is lost. NaN: as the plan has it."""
    end_of_field: float = 0.0
    """Evidence 0..1 of the mode's own rule (the paper's: l_height below l_reference by over
    3 % of the rows)."""
    e_outer_px: float = NAN
    """Column of E_outer at the row where the blade's line meets the picture."""
    o_map_px: float = NAN
    l_height_px: float = NAN
    l_reference_px: float = NAN
    standing: NDArray[np.bool_] | None = None
    """Mask of standing crop, the picture's size."""
    edge_px: NDArray[np.float32] | None = None
    """(n, 2) points (u, v) on the edge."""
    reason: str = ""
    """Why the confidence is low, in words."""
    hidden: bool = False
    """Stems right before the lens hide all else: nobody knows whose they are."""
    usable: bool = True
    """False where the picture shows nothing of the world of now, whatever is in it."""
    shown_turn_rad: float = NAN
    """How far the camera has turned left since the picture before, by how the scene has shifted;"""
    shown_way_m: float = NAN
    """and how far it has gone forward, if the ground were level and bare."""
    same_ago: int = 0
    """How many pictures ago the first one came that this one is the same as, but for its noise; 0:
    it is like none. At a stand all are the same."""
    stages: dict[str, NDArray[np.uint8]] = field(default_factory=dict)
    """The intermediate pictures (SY, TSY, VTSY, lines) when they were asked for."""

    def with_lying(self) -> CropView:
        """The same where crop that seems to lie is crop: at the blade, its right end unsure."""
        if self.lies_confidence < 0.5:
            return self
        return replace(
            self,
            confidence=0.5 * self.confidence,
            crop_ahead_m=0.0,
            ahead_confidence=self.lies_confidence,
            edge_offset_most_m=NAN,
            reason=LIES,
        )


class Detector(Protocol):
    """Picture in, CropView out. May track over pictures; the mount and the vehicle are its own."""

    def see(self, bgr: NDArray[np.uint8], *, stages: bool = False) -> CropView:
        """`bgr` is (height, width, 3) of the mount's size."""
        ...

    def glance(self, bgr: NDArray[np.uint8]) -> CropView:
        """Whether a picture is usable, and why not; nothing is measured in it, nor remembered."""
        ...

    def next_crop(self, gap_m: float) -> None:
        """From here on: behind the crop that is being cut the next stands no nearer than that."""
        ...

    def restart(self, *, turned: bool = True) -> None:
        """Forgets what was tracked; references set from the first picture of the run (O_map,
        l_reference) stay. `turned`: the crop ahead is another than before; else it is what was cut
        last, or the clear ground behind it, without dust before it."""
        ...
