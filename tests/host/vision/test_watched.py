"""Facts about the watched detector: it sees what the picture watch believes, and nothing else."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from host.core.vehicle import MAST
from host.vision.view import CropView
from host.vision.watched import PROVED, WatchedDetector
from tests.helpers.shots import Picture, scene, shot


class Counting:
    """A detector that says how often it was asked."""

    def __init__(self) -> None:
        self.seen = self.glances = 0
        self.restarts: list[bool] = []
        self.gaps: list[float] = []

    def see(self, bgr: Picture, *, stages: bool = False) -> CropView:
        del bgr, stages
        self.seen += 1
        return CropView(0.9, edge_offset_m=0.1)

    def glance(self, bgr: Picture) -> CropView:
        del bgr
        self.glances += 1
        return CropView(0.0)

    def next_crop(self, gap_m: float) -> None:
        self.gaps.append(gap_m)

    def restart(self, *, turned: bool = True) -> None:
        self.restarts.append(turned)


def test_the_detector_sees_what_is_believed_and_nothing_else() -> None:
    behind = Counting()
    made, picture = WatchedDetector(behind, MAST), shot(scene())
    first, second = made.see(picture), made.see(picture)
    assert (first.usable, first.confidence) == (True, 0.9)
    assert (second.usable, second.confidence, second.ahead_confidence) == (False, 0.0, 0.0)
    assert "repeats" in second.reason
    third = made.glance(picture)
    assert (third.usable, behind.glances) == (False, 0)
    made.restart()
    made.restart(turned=False)
    made.next_crop(1.2)
    assert behind.gaps == [1.2]
    assert (behind.seen, behind.restarts) == (1, [True, False])


def test_a_view_says_how_the_camera_has_moved_and_whether_it_was_there_before() -> None:
    made, world = WatchedDetector(Counting(), MAST), scene()
    made.see(shot(world, 100, 0))
    turned = made.see(shot(world, 80, 1))
    assert turned.shown_turn_rad == pytest.approx(20 / MAST.focal, rel=0.3), "to the left"
    assert turned.same_ago == 0
    back = made.glance(shot(world, 100, 2))
    assert back.shown_turn_rad == pytest.approx(-20 / MAST.focal, rel=0.3)
    assert back.same_ago == 2


def test_a_picture_of_quite_another_place_shows_nothing_but_that_the_camera_lives() -> None:
    """Stalks right before the lens, in a turn: nothing is measured in them, but nothing stops."""
    behind = Counting()
    made = WatchedDetector(behind, MAST)
    here, there = shot(scene(1)), cv2.bitwise_not(shot(scene(1))).astype(np.uint8)
    assert made.see(here).confidence == 0.9
    view = made.see(there)
    assert (view.usable, view.confidence, view.ahead_confidence) == (True, 0.0, 0.0)
    assert "another" in view.reason
    assert behind.seen == 1
    assert made.see(shot(255 - scene(1), 3)).usable


def test_just_after_a_jump_pictures_tell_of_no_motion() -> None:
    """Stalks right before the lens of a camera that comes out of them (random field 10127)."""
    made, world = WatchedDetector(Counting(), MAST), scene()
    made.see(shot(world, 100, 0))
    told = [math.isfinite(made.see(shot(world, 80 + k, k)).shown_turn_rad) for k in range(1, 3)]
    made.see(255 - shot(world, 80, 9))
    after = [math.isfinite(made.see(shot(world, 80 + k, k)).shown_turn_rad) for k in range(10, 15)]
    assert told == [True, True]
    assert after == [False] * PROVED + [True] * (5 - PROVED)


class Stalks(Counting):
    """A detector that sees stems before the lens in the pictures of these numbers."""

    def __init__(self, hidden: frozenset[int]) -> None:
        super().__init__()
        self._hidden = hidden

    def see(self, bgr: Picture, *, stages: bool = False) -> CropView:
        view = super().see(bgr, stages=stages)
        if self.seen - 1 in self._hidden:
            return CropView(0.0, hidden=True, reason="stems")
        return view


def test_just_after_a_jump_nothing_is_measured() -> None:
    made, world = WatchedDetector(Counting(), MAST), scene()
    shots = [shot(world, 100, 0), *[255 - shot(world, 80 + k, k) for k in range(1, 5)]]
    views = [made.see(picture) for picture in shots]
    assert [view.confidence for view in views] == [0.9, *[0.0] * PROVED, 0.9]
    assert all(view.usable for view in views)


def test_between_stems_before_the_lens_nothing_is_measured() -> None:
    """Pictures between stalks pass for open ground (picture field 10423)."""
    made, world = WatchedDetector(Stalks(frozenset({1, 2, 4})), MAST), scene()
    views = [made.see(shot(world, k, k)) for k in range(9)]
    assert [view.hidden for view in views] == [k in (1, 2, 4) for k in range(9)]
    sure = [view.confidence > 0.0 for view in views]
    assert sure == [True, *[False] * 4, *[False] * (PROVED - 1), True, True]
    assert views[3].reason == "stems"
    assert [math.isfinite(view.shown_way_m) for view in views[3:7]] == [False] * 4


def test_after_a_spoiled_picture_three_sound_ones_in_a_row_are_believed() -> None:
    made, view = WatchedDetector(Counting(), MAST), scene()
    shots = [shot(view, k, k) for k in range(8)]
    shots[1] = np.zeros_like(shots[1])
    shots[4] = shots[3]
    usable = [made.see(picture).usable for picture in shots]
    assert usable == [True, False, False, False, False, False, False, True]


def test_a_glance_counts_as_a_picture_and_measures_nothing() -> None:
    behind, view = Counting(), scene()
    made = WatchedDetector(behind, MAST)
    shots = [shot(view, k, k) for k in range(6)]
    shots[1] = np.zeros_like(shots[1])
    usable = [made.glance(picture).usable for picture in shots]
    assert usable == [True, False, False, False, True, True]
    assert (behind.seen, behind.glances) == (0, 3)
