"""Facts about which manoeuvre is chosen between two sides."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from host.core.vehicle import Vehicle
from host.field.areas import GAP_MARGIN_M, Geofence, areas_of
from host.route.plan import Plan
from host.route.side import Side
from host.route.turn_choice import (
    EARLY_M,
    ROOM_M,
    SHUTTLE_ROOM_M,
    SWINGS,
    next_turn,
    room_along,
)
from host.route.turn_legs import (
    SHUTTLE_CLEAR_M,
    Follow,
    Goal,
    NewLane,
    Turn,
    arc,
    lane_beside,
    path,
    shuttle,
    shuttle_length,
    shuttle_room_m,
    three_point,
)

VEHICLE = Vehicle()
FIRST = Side(0.0, 0.0, 0.0, 10.0, VEHICLE.pass_m, 10.0)
CORNER = Side(10.0, VEHICLE.pass_m, math.pi / 2, 9.0, VEHICLE.pass_m, 9.0)
AGAIN = replace(FIRST, y_m=VEHICLE.pass_m)
LANE = NewLane(VEHICLE.blade_x_m - VEHICLE.inset_m, VEHICLE.pass_m - VEHICLE.inset_m, 0.0)
"""Of the corner, in the turn's frame."""
TURNS = [three_point(VEHICLE, math.pi / 2, LANE, swing=swing) for swing in SWINGS]


def enough(_turn: Turn) -> float:
    return ROOM_M


def chosen(*sides: Side, turn: str = "three_point") -> Turn:
    return next_turn(Plan(sides, turn), 0, VEHICLE, enough)


def test_with_room_the_first_swing_is_driven() -> None:
    assert chosen(FIRST, CORNER) == TURNS[0]


@pytest.mark.parametrize("wide", range(len(SWINGS)))
def test_the_first_swing_that_has_room_is_driven(wide: int) -> None:
    def room(turn: Turn) -> float:
        return ROOM_M if turn in TURNS[wide:] else ROOM_M - 0.01

    assert next_turn(Plan((FIRST, CORNER)), 0, VEHICLE, room) == TURNS[wide]


@pytest.mark.parametrize("most", range(len(SWINGS)))
def test_where_none_has_room_it_is_the_one_with_most(most: int) -> None:
    def room(turn: Turn) -> float:
        return 0.2 if turn == TURNS[most] else 0.1

    assert next_turn(Plan((FIRST, CORNER)), 0, VEHICLE, room) == TURNS[most]


def test_rounding_does_not_choose_between_turns_with_the_same_room() -> None:
    def room(turn: Turn) -> float:
        return 0.2 + 1e-12 * TURNS.index(turn)

    assert next_turn(Plan((FIRST, CORNER)), 0, VEHICLE, room) == TURNS[0]


def test_the_papers_arc_is_driven_where_the_plan_says_so() -> None:
    assert chosen(FIRST, CORNER, turn="arc") == arc(VEHICLE, math.pi / 2, LANE)


@pytest.mark.parametrize("turn", ["three_point", "arc"])
def test_the_same_edge_again_is_reached_backwards(turn: str) -> None:
    shuttle = chosen(FIRST, AGAIN, turn=turn)
    assert all(leg.reverse for leg in shuttle.legs)
    assert shuttle.legs[-1].follow is Follow.NEW_LANE
    # Back by the whole side, and no farther.
    longer = chosen(replace(FIRST, length_m=10.5), AGAIN, turn=turn)
    assert longer.legs[0].value - shuttle.legs[0].value == pytest.approx(-0.5)
    assert shuttle.legs[0].goal is Goal.ALONG


def test_a_lane_that_is_shifted_is_where_the_turn_ends() -> None:
    usual, shifted = chosen(FIRST, CORNER), chosen(FIRST, replace(CORNER, shift_m=0.2))
    # To the right of a lane that runs to the old side's left is farther along the old side.
    assert (shifted.lane_x_m, shifted.lane_y_m) == pytest.approx(
        (usual.lane_x_m + 0.2, usual.lane_y_m)
    )


def test_without_a_plan_every_corner_is_a_right_angle() -> None:
    turn = next_turn(Plan(), 0, VEHICLE, enough)
    planned = chosen(FIRST, CORNER)
    assert turn.lane_rad == planned.lane_rad == math.pi / 2
    x, y, _ = path(VEHICLE, planned, 0.01)[-1]
    assert turn.offset(x, y) == pytest.approx(planned.offset(x, y))
    assert turn.along(x, y) - turn.crop_begins_m == pytest.approx(
        planned.along(x, y) - planned.crop_begins_m
    )


@given(st.floats(math.radians(25), math.radians(155)), st.floats(-math.pi, math.pi))
def test_a_turn_leads_to_the_plans_next_lane_at_any_corner(corner: float, first: float) -> None:
    """In the field: the blade at the end of a side; where the turn ends, the next side's lane."""
    c, s = math.cos(first), math.sin(first)
    this = replace(FIRST, heading_rad=first, shift_m=0.1)
    following = replace(
        CORNER, x_m=9.0 * c - 0.7 * s, y_m=9.0 * s + 0.7 * c, heading_rad=first + corner
    )
    turn = chosen(this, following)
    x, y, turned = path(VEHICLE, turn, 0.005)[-1]
    x, y = x + this.length_m - VEHICLE.blade_x_m, y + VEHICLE.inset_m - this.shift_m
    dx, dy = c * x - s * y - following.x_m, s * x + c * y - following.y_m
    c, s = math.cos(following.heading_rad), math.sin(following.heading_rad)
    assert turned == pytest.approx(corner, abs=0.02)
    assert c * dy - s * dx == pytest.approx(VEHICLE.inset_m, abs=0.03)
    assert -1.0 < c * dx + s * dy + VEHICLE.blade_x_m < 0.0, "before the crop"


def test_the_room_is_that_of_the_tightest_place() -> None:
    fence = Geofence(areas_of(shapely.box(-20, -20, 20, 20), 2.0))
    turn = TURNS[0]
    middle = room_along(turn, (0.0, 0.0, 0.0), VEHICLE, fence)
    for heading in (0.0, math.pi / 2, 2.0):
        c, s = math.cos(heading), math.sin(heading)
        at = (5.0 * c, 5.0 * s, heading)
        assert room_along(turn, at, VEHICLE, fence) < middle
    assert room_along(turn, (21.0, 0.0, 0.0), VEHICLE, fence) < 0


def test_at_the_room_that_the_plan_asks_for_a_shuttle_keeps_its_distance_to_the_border() -> None:
    gap_m = 2.0
    least = shuttle_length(VEHICLE, VEHICLE.pass_m, 0.0)
    back_m = least - shuttle_room_m(VEHICLE, 0.0, gap_m)
    sides = (FIRST, replace(AGAIN, back_m=back_m))
    turn = next_turn(Plan(sides, gap_m=gap_m), 0, VEHICLE, enough)
    shift = replace(turn, legs=turn.legs[:-1])
    rear = path(VEHICLE, shift, 0.01)[-1][0] - VEHICLE.rear_overhang_m
    border = VEHICLE.blade_x_m - FIRST.length_m - back_m - (gap_m - GAP_MARGIN_M)
    assert rear - border == pytest.approx(SHUTTLE_CLEAR_M, abs=0.03)


@pytest.mark.parametrize("tight", [0, 2, len(EARLY_M) - 1])
def test_where_room_lacks_behind_a_shuttle_it_begins_sooner(tight: int) -> None:
    """The room of the S counts: the geofence may end the straight way after it."""
    begins = VEHICLE.blade_x_m - FIRST.length_m

    def room(turn: Turn) -> float:
        assert turn.legs[-1].goal is Goal.HEADING
        early = turn.legs[0].value - begins
        return SHUTTLE_ROOM_M if early > EARLY_M[tight] - 0.01 else SHUTTLE_ROOM_M - 0.01

    turn = next_turn(Plan((FIRST, AGAIN), gap_m=1.0), 0, VEHICLE, room)
    ends = path(VEHICLE, replace(turn, legs=turn.legs[:-1]), 0.01)[-1]
    usual = next_turn(Plan((FIRST, AGAIN), gap_m=1.0), 0, VEHICLE, enough)
    as_usual = path(VEHICLE, replace(usual, legs=usual.legs[:-1]), 0.01)[-1]
    assert ends[0] - as_usual[0] == pytest.approx(EARLY_M[tight])
    assert ends[1:] == pytest.approx(as_usual[1:])
    assert turn.legs[-1] == usual.legs[-1]
    assert (turn.pressed_m, usual.pressed_m) == (EARLY_M[tight], 0.0)


def test_a_small_shift_takes_no_s() -> None:
    beside, apart = (shuttle(VEHICLE, -8.0, shift_m, 3.0) for shift_m in (0.1, 0.3))
    assert [leg.goal for leg in beside.legs] == [Goal.ALONG, Goal.ALONG]
    assert [leg.goal for leg in apart.legs] == [Goal.ALONG, Goal.HEADING, Goal.HEADING, Goal.ALONG]
    assert (beside.lane_y_m, apart.lane_y_m) == (0.1, 0.3)


@pytest.mark.parametrize("corner_deg", [50.0, 90.0, 130.0])
def test_without_a_plan_crop_begins_where_the_blades_first_end_leaves_the_swath(
    corner_deg: float,
) -> None:
    corner, half = math.radians(corner_deg), VEHICLE.blade_width_m / 2
    lane = lane_beside(VEHICLE, corner)
    middle = lane.y_m + lane.begins_m * math.sin(corner)
    ends = [middle + lateral * math.cos(corner) for lateral in (-half, half)]
    assert max(ends) == pytest.approx(half)


@pytest.mark.parametrize(
    "turn", [TURNS[0], arc(VEHICLE, math.pi / 2, LANE), shuttle(VEHICLE, -8.0, 0.9, 3.0)]
)
def test_every_turn_leaves_the_steering_room_before_its_limit(turn: Turn) -> None:
    """The PID overshoots, and beyond the limit the firmware stops the machine."""
    steepest = max(abs(math.degrees(leg.steer_rad)) for leg in turn.legs)
    assert 0.0 < steepest <= VEHICLE.steer_limit_deg - 1.5
