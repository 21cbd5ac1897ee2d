"""A way to a lane from wherever the machine stands."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from host.core.frames import Pose2
from host.core.vehicle import Vehicle
from host.field.areas import outline_of, placed
from host.route.manoeuvre import SHORT_M, Lane, Room, way
from host.route.turn_legs import Follow as Along
from host.route.turn_legs import Goal, Leg, Turn, driven

VEHICLE = Vehicle()
HALF = VEHICLE.blade_width_m / 2 - VEHICLE.overlap_m
CLEAR_M = 0.1
ENDS_M = -0.3 - VEHICLE.blade_x_m
"""With the blade so far before crop that begins at 0."""
OPEN = Lane(ENDS_M, 0.0, (-HALF, 0.0))
"""Beyond the old side's swath, which the lane runs beside, all is crop."""


def box(x0: float, y0: float, x1: float, y1: float) -> NDArray[np.float64]:
    """The sides of a rectangle."""
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return np.array([[*a, *b] for a, b in zip(corners, corners[1:] + corners[:1], strict=True)])


def room(*shapes: NDArray[np.float64]) -> Room:
    """Within the first, outside of the others."""
    sides = np.concatenate(shapes)
    return Room(sides, np.array([[CLEAR_M] * len(sides), [0.0] * len(sides)]))


def poses(start: Pose2, legs: tuple[Leg, ...]) -> list[Pose2]:
    """Driven without error, in the lane's frame."""
    turn = Turn(legs, 0.0, 0.0, 0.0, 0.0)
    return [pose for leg in driven(VEHICLE, turn, at=start) for pose in leg.poses]


@settings(deadline=None, max_examples=60)
@given(x=st.floats(-3.0, 2.0), y=st.floats(-2.0, 2.0), heading=st.floats(-math.pi, math.pi))
def test_in_open_ground_every_way_ends_on_the_lane_behind_its_crop(
    x: float, y: float, heading: float
) -> None:
    start = Pose2(x, y, heading)
    legs = way(VEHICLE, start, OPEN, room(box(-20.0, -20.0, 20.0, 20.0)))
    assert legs is not None
    last = poses(start, legs)[-1]
    assert last.x_m <= ENDS_M + 0.01
    assert abs(last.y_m) < 0.02
    assert abs(math.remainder(last.heading_rad, math.tau)) < math.radians(1.0)


@settings(deadline=None, max_examples=40)
@given(
    gap_m=st.floats(1.3, 2.2),
    start=st.sampled_from([Pose2(0.42, 1.2, -math.pi / 2), Pose2(0.0, 1.4, -1.2)]),
    width=st.floats(0.0, 1.0),
)
def test_on_its_way_the_machine_leaves_no_permitted_area_and_touches_no_keep_out(
    gap_m: float, start: Pose2, width: float
) -> None:
    """At a corner, the old side coming down and the new one going right."""
    keep_out = box(2.0, 2.0, 2.0 + width + 0.1, 2.1)
    around = room(box(-gap_m, -HALF - gap_m, 12.0, 12.0), keep_out)
    lane = Lane(0.84 - 0.3 - VEHICLE.blade_x_m, 0.84, (0.84, math.pi / 2))
    legs = way(VEHICLE, start, lane, around)
    if legs is None:
        return
    permitted = shapely.box(-gap_m, -HALF - gap_m, 12.0, 12.0)
    tree = shapely.box(2.0, 2.0, 2.0 + width + 0.1, 2.1)
    *before, last = (leg for leg in driven(VEHICLE, Turn(legs, 0.0, 0.0, 0.0, 0.0), at=start))
    for leg in before:
        for pose in leg.poses:
            hull = shapely.convex_hull(shapely.MultiPoint(placed(outline_of(VEHICLE), *pose)))
            assert permitted.contains(hull)
            assert not tree.intersects(hull)
    assert last.poses[-1].x_m <= lane.ends_m + SHORT_M[0]


def test_at_a_corner_with_a_usual_gap_there_is_a_way() -> None:
    lane = Lane(0.84 - 0.3 - VEHICLE.blade_x_m, 0.84, (0.84, math.pi / 2))
    start = Pose2(0.42, VEHICLE.blade_x_m - HALF, -math.pi / 2)
    for gap_m in (1.2, 1.5, 1.8):
        around = room(box(-gap_m, -HALF - gap_m, 12.0, 12.0))
        assert way(VEHICLE, start, lane, around) is not None


NARROW = room(box(-0.8, -9.0, 9.0, 9.0))
"""Behind the lane's crop, which begins at 0, there is no room for the machine."""


@pytest.mark.parametrize("askew_deg", [-45.0, -25.0, 30.0])
def test_without_room_behind_the_crop_a_way_comes_into_line_inside_it(askew_deg: float) -> None:
    start = Pose2(0.5, -0.3, math.radians(askew_deg))
    assert way(VEHICLE, start, OPEN, NARROW) is None
    legs = way(VEHICLE, start, OPEN, NARROW, SHORT_M[1])
    assert legs is not None
    *before, _ = (leg for leg in driven(VEHICLE, Turn(legs, 0.0, 0.0, 0.0, 0.0), at=start))
    last = before[-1].poses[-1]
    assert 0.0 < last.x_m - ENDS_M <= SHORT_M[1] + 0.8
    assert abs(last.y_m) < 0.02
    assert abs(math.remainder(last.heading_rad, math.tau)) < math.radians(1.0)


def test_a_way_past_what_stands_beside_the_lane_leads_to_it_behind_that_and_not_back() -> None:
    start, post = Pose2(0.0, 0.0, 0.0), box(2.5, 0.1, 3.0, 0.6)
    past = OPEN._replace(past_m=0.5)
    around = room(box(-20.0, -20.0, 20.0, 20.0), post)
    legs = way(VEHICLE, start, past, around)
    assert legs is not None
    tree = shapely.Polygon(post[:, :2])
    driven_poses = poses(start, legs)
    for pose in driven_poses:
        hull = shapely.convex_hull(shapely.MultiPoint(placed(outline_of(VEHICLE), *pose)))
        assert not tree.intersects(hull)
    last = driven_poses[-1]
    assert last.x_m - VEHICLE.rear_overhang_m > 3.0
    assert abs(last.y_m) < 0.02
    assert abs(math.remainder(last.heading_rad, math.tau)) < math.radians(1.0)


def test_past_what_is_too_long_there_is_no_way() -> None:
    wall = box(2.5, 0.1, 18.0, 0.6)
    past = OPEN._replace(past_m=0.5)
    around = room(box(-20.0, -20.0, 20.0, 20.0), wall)
    assert way(VEHICLE, Pose2(0.0, 0.0, 0.0), past, around) is None


def test_without_room_there_is_no_way() -> None:
    start = Pose2(0.0, 0.0, math.radians(90.0))
    assert way(VEHICLE, start, OPEN, room(box(-0.8, -0.7, 0.8, 1.9))) is None


def test_a_machine_beyond_the_border_has_no_way() -> None:
    start = Pose2(0.0, 0.0, math.radians(90.0))
    assert way(VEHICLE, start, OPEN, room(box(-0.8, 0.0, 8.0, 9.0))) is None


@settings(deadline=None, max_examples=40)
@given(
    off_m=st.floats(0.02, 0.35),
    askew=st.floats(-0.6, 0.6),
    x=st.floats(-3.0, 1.0),
)
def test_a_machine_that_stands_too_near_to_the_border_does_nothing_but_lead_away_from_it(
    off_m: float, askew: float, x: float
) -> None:
    wanted_m, hull = 0.4, outline_of(VEHICLE)
    start = Pose2(x, 1.0, askew)
    border = float(placed(hull, *start)[:, 1].max()) + off_m
    sides = box(-20.0, -20.0, 20.0, border)
    legs = way(VEHICLE, start, OPEN, Room(sides, np.array([[wanted_m] * 4, [0.0] * 4])))
    if legs is None:
        return
    off = [border - float(placed(hull, *pose)[:, 1].max()) for pose in poses(start, legs)]
    near = list(itertools.takewhile(lambda clear_m: clear_m < wanted_m - 0.01, off))
    assert all(later > before - 1e-3 for before, later in itertools.pairwise([off_m, *near]))
    assert all(clear_m > wanted_m - 0.05 for clear_m in off[len(near) :])


def test_a_machine_that_stands_too_near_to_the_border_leads_away_from_it() -> None:
    start = Pose2(-1.0, 1.0, 0.0)
    near = room(box(-9.0, -9.0, 9.0, 1.0 + VEHICLE.blade_width_m / 2 + CLEAR_M / 2))
    legs = way(VEHICLE, start, OPEN, near)
    assert legs is not None
    left = [float(placed(outline_of(VEHICLE), *pose)[:, 1].max()) for pose in poses(start, legs)]
    assert max(left) <= 1.0 + VEHICLE.blade_width_m / 2 + CLEAR_M / 2


def test_rather_than_over_crop_it_goes_around_it() -> None:
    """The lane's beginning lies to the right, its crop between: backing first keeps off it."""
    start = Pose2(1.0, 1.0, 0.0)
    wide = room(box(-20.0, -20.0, 20.0, 20.0))
    legs = way(VEHICLE, start, Lane(ENDS_M, 0.0, (-HALF, 0.0)), wide)
    assert legs is not None
    assert legs[0].reverse


@pytest.mark.parametrize("heading_deg", [0.0, 30.0, 180.0])
def test_legs_follow_each_other_with_another_steering_or_the_other_way(heading_deg: float) -> None:
    start = Pose2(-1.0, 1.0, math.radians(heading_deg))
    legs = way(VEHICLE, start, OPEN, room(box(-20.0, -20.0, 20.0, 20.0)))
    assert legs is not None
    for one, other in itertools.pairwise(legs[:-1]):
        assert (one.steer_rad, one.reverse) != (other.steer_rad, other.reverse)
    assert legs[-1].goal is Goal.ALONG


FAR = OPEN._replace(border=(math.inf, 0.0), from_m=ENDS_M - 1.5)
"""Wherever it comes from, the machine comes to the lane just before its crop."""


@settings(deadline=None, max_examples=40)
@given(far=st.floats(6.0, 25.0), to=st.floats(-math.pi, math.pi), heading=st.floats(-3.1, 3.1))
def test_from_far_away_every_way_ends_on_the_lane_near_its_crop(
    far: float, to: float, heading: float
) -> None:
    start = Pose2(far * math.cos(to), far * math.sin(to), heading)
    legs = way(VEHICLE, start, FAR, room(box(-60.0, -60.0, 60.0, 60.0)))
    assert legs is not None
    last = poses(start, legs)[-1]
    assert ENDS_M - 1.6 < last.x_m <= ENDS_M + 0.01
    assert abs(last.y_m) < 0.02
    assert abs(math.remainder(last.heading_rad, math.tau)) < math.radians(1.0)
    driven_m = sum(
        leg.value if leg.goal is Goal.WAY else 0.0
        for leg in legs
        if leg.follow is not Along.NEW_LANE
    )
    assert driven_m < 2.0 * far + 10.0


def test_from_far_away_a_way_leads_around_what_stands() -> None:
    start, stands = Pose2(-14.0, 0.0, 0.0), box(-9.0, -3.0, -6.0, 3.0)
    legs = way(VEHICLE, start, FAR, room(box(-60.0, -60.0, 60.0, 60.0), stands))
    assert legs is not None
    crop = shapely.box(-9.0, -3.0, -6.0, 3.0)
    for pose in poses(start, legs):
        assert not shapely.Polygon(placed(outline_of(VEHICLE), *pose)).intersects(crop)
