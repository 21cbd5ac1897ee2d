"""Upright pieces."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from host.core.vehicle import MAST
from host.vision.geometry import Camera
from host.vision.mounted.lines import GROUP, Rails, least_length_px, rails, upright_pieces
from host.vision.pictures import Mask


def drawn(angle_deg: float, length: float) -> Mask:
    picture = np.zeros((240, 320), np.uint8)
    a = math.radians(angle_deg)
    end = (round(160 + length * math.sin(a)), round(200 - length * math.cos(a)))
    cv2.line(picture, (160, 200), end, 255, 3)
    return picture


def kept(picture: Mask, least: float, tilts: tuple[float, ...] = (-5.0, 0.0, 5.0)) -> float:
    tracks = [rails(320, 240, None, tilt) for tilt in tilts]
    out = upright_pieces(picture, tracks, np.full(240, least, np.float32), 2)
    assert not (out & ~picture).any()
    return cv2.countNonZero(out) / cv2.countNonZero(picture)


@pytest.mark.parametrize("angle", [-5.0, -2.0, 0.0, 3.0, 5.0])
def test_a_long_line_within_the_tilt_is_kept(angle: float) -> None:
    assert kept(drawn(angle, 100), 30) > 0.5


@pytest.mark.parametrize("angle", [-40.0, 25.0, 85.0])
def test_a_line_beyond_the_tilt_is_dropped(angle: float) -> None:
    assert kept(drawn(angle, 100), 30) == 0


def test_a_line_shorter_than_the_least_length_is_dropped() -> None:
    assert kept(drawn(0, 20), 30) == 0


def test_the_least_length_counts_where_the_line_stands() -> None:
    picture = drawn(0, 40)
    tracks = [rails(320, 240, None, 0.0)]
    least = np.full(240, 10, np.float32)
    least[190:] = 60
    assert not upright_pieces(picture, tracks, least, 2).any()
    assert upright_pieces(picture, tracks, least[::-1].copy(), 2).any()


@pytest.mark.parametrize("camera", [None, Camera(MAST)])
@pytest.mark.parametrize("tilt", [-5.0, 0.0, 5.0])
def test_rails_visit_every_pixel(camera: Camera | None, tilt: float) -> None:
    on = np.full((480, 640), 255, np.uint8)
    track = rails(640, 480, camera, tilt)
    out = upright_pieces(on, [track], np.full(480, 2, np.float32), 2)
    assert cv2.countNonZero(out) > 0.995 * out.size


def test_a_true_vertical_at_the_side_is_kept_only_when_the_mount_is_known() -> None:
    camera = Camera(MAST)
    picture = np.zeros((480, 640), np.uint8)
    foot, top = camera.project([[1.6, -0.75, 0.0], [1.6, -0.75, 0.9]])
    cv2.line(picture, [round(c) for c in foot], [round(c) for c in top], 255, 1)
    least = np.full(480, 60, np.float32)
    blind = upright_pieces(picture, [rails(640, 480, None, 0.0)], least, 2)
    knowing = upright_pieces(picture, [rails(640, 480, camera, 0.0)], least, 2)
    assert cv2.countNonZero(knowing) > 0.8 * cv2.countNonZero(picture)
    assert cv2.countNonZero(blind) == 0


def test_stubble_is_shorter_than_the_least_length_at_every_row() -> None:
    camera = Camera(MAST)
    rows = camera.stem_rows_px(0.12)
    assert (least_length_px(camera, 0.12) > rows).all()


def _followed(on: Mask, track: Rails, least: int, width: int) -> Mask:
    """The pieces along rails, by one rail after the other: pairs of rows, no gaps bridged."""
    lit = (on[::2] | on[1::2]) > 0
    out = np.zeros_like(on)
    columns = np.repeat(track.firsts, GROUP, 1) + track.offsets.astype(np.int16) - 1
    for places in columns.T:
        inside = (places >= 0) & (places < width)
        rows = np.flatnonzero(inside)[lit[inside, places[inside]]]
        for piece in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            if len(piece) >= least:
                out[2 * piece, places[piece]] = out[2 * piece + 1, places[piece]] = 255
    return out & on


@pytest.mark.parametrize("camera", [None, Camera(MAST)])
def test_pieces_are_those_of_each_rail_by_itself(camera: Camera | None) -> None:
    rng = np.random.default_rng(1)
    on = np.where(rng.random((480, 640)) < 0.4, 255, 0).astype(np.uint8)
    track = rails(640, 480, camera, 3.5)
    out = upright_pieces(on, [track], np.full(480, 10, np.float32), 1)
    assert 0.05 < (out > 0).mean() < 0.3
    assert np.array_equal(out, _followed(on, track, 5, 640))
