"""Crop on both sides: a machine that has lost the edge, and cuts with crop right of it, is too far
left. What it would leave standing there is its own: between two fields lies a gap."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from host.vision.view import CropView

INSIDE_M: Final = 0.1
"""How far beside the blade crop goes on before it, at least: the detector's own error."""
RIGHT_M: Final = 0.3
"""How far crop goes on, at least, that stands beside the blade: its first rows are seen, and nobody
sees through them."""
OF, LEAST = 10, 8
"""In how many of the latest pictures, a second's: no clump, nor a whim of dust."""


class InCrop:
    """The pictures of a way without a sure edge."""

    def __init__(self) -> None:
        self._latest: deque[bool] = deque(maxlen=OF)

    @property
    def surely(self) -> bool:
        """Whether the latest pictures agree."""
        return sum(self._latest) >= LEAST

    def forget(self) -> None:
        """An edge is seen, or another strip begins."""
        self._latest.clear()

    def note(self, view: CropView) -> float:
        """One more picture. The edge lies no farther left than this by it, m on the view's scale;
        NaN: it shows no crop on the right."""
        most_m = view.edge_offset_most_m
        if view.crop_right:
            most_m = -RIGHT_M if math.isnan(most_m) else min(most_m, -RIGHT_M)
        inside = most_m < -INSIDE_M
        self._latest.append(inside)
        return most_m if inside else math.nan
