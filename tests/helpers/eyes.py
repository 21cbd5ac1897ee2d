"""Eyes for a pilot in the plane world: what it shows, and what a test does to that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from host.vision.view import CropView
from tests.helpers.simple_world import SimpleWorld


class ToldEnd(NamedTuple):
    """What the pilot told the position of a side's end."""

    ago_m: float
    drift_m: float
    doubt_m: float
    elsewhere_m: float


class Eyes:
    """The world's vision, with what a test does to its views, and when it was asked: looks, those
    that were but glances, its restarts, and those for which the machine had turned."""

    def __init__(self, world: SimpleWorld, spoil: Callable[[CropView], CropView]) -> None:
        self.world = world
        self.spoil = spoil
        self.restarts: list[float] = []
        self.turned: list[float] = []
        self.looks: list[float] = []
        self.glances: list[float] = []

    def see(self, bgr: np.ndarray, *, stages: bool = False) -> CropView:
        self.looks.append(self.world.now)
        return self.spoil(self.world.see(bgr, stages=stages))

    def glance(self, bgr: np.ndarray) -> CropView:
        self.looks.append(self.world.now)
        self.glances.append(self.world.now)
        return self.spoil(self.world.glance(bgr))

    def next_crop(self, gap_m: float) -> None:
        """Nothing is hidden by dust."""

    def restart(self, *, turned: bool = True) -> None:
        self.restarts.append(self.world.now)
        if turned:
            self.turned.append(self.world.now)


def beside(offset_m: float) -> Callable[[CropView], CropView]:
    return lambda view: replace(view, edge_offset_m=view.edge_offset_m + offset_m)
