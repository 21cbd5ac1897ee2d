"""Facts about poses and the field frame."""

from __future__ import annotations

import math

import pytest

from host.core.frames import LocalFrame, Pose2

NORTH = Pose2(2.0, 3.0, math.pi / 2)


def test_ahead_and_left_are_the_poses_own() -> None:
    there = NORTH.ahead(5.0, 1.0)
    assert there[:2] == pytest.approx((1.0, 8.0))
    assert there.heading_rad == NORTH.heading_rad


def test_a_place_is_seen_as_far_ahead_and_left_as_it_was_put() -> None:
    pose = Pose2(-1.0, 4.0, 0.7)
    assert pose.seen_from(*pose.ahead(2.5, -0.4)[:2]) == pytest.approx((2.5, -0.4))


def test_a_place_comes_back_from_the_earth_where_it_was() -> None:
    frame = LocalFrame(31.5, 74.3)
    assert frame.to_local(*frame.to_wgs84(120.0, -45.0)) == pytest.approx((120.0, -45.0), abs=1e-6)
    north_lat, north_lon = frame.to_wgs84(0.0, 100.0)
    assert (north_lat > 31.5, north_lon) == (True, pytest.approx(74.3))
