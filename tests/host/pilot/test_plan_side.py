"""A side of the plan: where it may end, shows an edge, and has crop that is surely its own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from host.estimate.states import CORNERS
from host.field.areas import GAP_MARGIN_M, outline_of, placed
from host.pilot.planned_strip import PlannedStrip
from host.route.plan import spiral
from host.route.side import NO_EDGE, Side, lane_pose
from tests.helpers.behaving import PLAN, VEHICLE, on_side


def test_a_side_does_not_run_on_over_ground_that_is_cut_but_for_what_it_may_have_left() -> None:
    inner = replace(PLAN.sides[0], fence_m=PLAN.sides[0].length_m + 9.0)
    plan = replace(PLAN, sides=(inner, *PLAN.sides[1:]))
    for past_m, ends in ((0.5, False), (5.0, True)):
        strip = on_side(plan=plan, cut_m=inner.length_m + past_m).strip
        assert strip.overrun() is ends


@pytest.mark.parametrize(("tip_m", "shows"), [(0.0, True), (3.0, False), (6.0, True)])
def test_a_border_that_hardly_slants_is_an_edge(tip_m: float, shows: bool) -> None:
    """By 17 degrees it is none, by 9 it is followed."""
    side = replace(PLAN.sides[0], edge_begin_m=tip_m, edge_end_m=tip_m)
    for along_m in (1.0, side.length_m - 1.0):
        strip = on_side(plan=replace(PLAN, sides=(side, *PLAN.sides[1:]))).strip
        assert strip.shows_edge(along_m) is shows


@pytest.mark.parametrize(("turn_deg", "shows"), [(12.0, False), (30.0, False), (90.0, True)])
@pytest.mark.parametrize("named", [True, False])
def test_where_the_border_goes_on_round_an_arc_it_is_no_edge_of_this_side(
    turn_deg: float, shows: bool, named: bool
) -> None:
    """Followed for one, it turned the map of a round field by 17 degrees at the end of each side
    (outline 183), whether or not the plan says which border ends it."""
    turn = math.radians(turn_deg)
    far = (10.0 + 10.0 * math.cos(turn), 10.0 * math.sin(turn))
    ring = ((0.0, 0.0), (10.0, 0.0), far, (far[0] - 5.0, 20.0), (0.0, 20.0))
    side = Side(
        0.0, 0.0, 0.0, 10.0, 0.9, 10.0, edge_end_m=4.3, edges=(0,), ends_at=1 if named else NO_EDGE
    )
    context = on_side(0, replace(PLAN, sides=(side, side), boundary=ring), cut_m=3.0)
    assert context.strip.shows_edge(5.0)
    assert context.strip.shows_edge(6.5) is shows


@pytest.mark.parametrize(
    ("begins_m", "along_m", "own"),
    [(4.0, 0.5, True), (4.0, 1.5, False), (8.0, 0.5, False), (5.5, 0.5, True), (6.5, 0.5, False)],
)
def test_crop_is_the_fields_own_as_long_as_the_field_goes_on_and_the_strip_does_not_end(
    begins_m: float, along_m: float, own: bool
) -> None:
    """Of a strip of 2 m inside a field of 10 m: no belief errs by more than 3 m."""
    strip = Side(5.0, begins_m, math.pi / 2, 2.0, 0.9, fence_m=10.0 - begins_m)
    context = on_side(0, replace(PLAN, sides=(strip, strip)), cut_m=along_m)
    assert context.strip.along_m(context.motion) == pytest.approx(along_m, abs=0.01)
    assert context.strip.surely_own is own
    assert not context.strip.surely_crop
    position = context.estimate.position
    position.keep_apart(np.zeros(len(position.x)), 1e-6 * np.eye(len(position.x)), 0.3)
    assert not context.strip.surely_own, "where it may be at two places nothing beyond the strip is"


@pytest.mark.parametrize(
    ("index", "left_m", "its"),
    [
        (1, 8.0, True),
        (1, 0.5, True),
        (1, -0.2, True),
        (1, -3.0, False),
        (3, 8.0, True),
        (3, 0.5, False),
        (4, 8.0, True),
        (4, 0.5, False),
    ],
)
def test_what_lies_at_an_end_across_which_nobody_has_driven_is_crop_and_elsewhere_may_be_swath(
    index: int, left_m: float, its: bool
) -> None:
    """The first round's last side ends where its first has left swath."""
    plan = replace(PLAN, sigma_m=0.3)
    context = on_side(index, plan, cut_m=plan.sides[index].length_m - left_m)
    assert context.strip.lies_its_crop is its


@pytest.mark.parametrize(("index", "its"), [(1, True), (5, False)])
def test_what_lies_where_a_strip_inside_ends_at_no_border_may_be_swath(
    index: int, its: bool
) -> None:
    side = replace(PLAN.sides[index], ends_at=NO_EDGE)
    sides = (*PLAN.sides[:index], side, *PLAN.sides[index + 1 :])
    context = on_side(index, replace(PLAN, sides=sides), cut_m=side.length_m - 0.5)
    assert context.strip.lies_its_crop is its


@pytest.mark.parametrize(
    ("x_m", "sigma_m", "own"), [(5.0, 0.2, True), (2.5, 0.2, False), (5.0, 0.6, False)]
)
def test_deep_inside_a_boundary_that_was_found_what_stands_is_the_fields(
    x_m: float, sigma_m: float, own: bool
) -> None:
    """On a short strip whose end is near, by more than the place errs."""
    strip = Side(x_m, 4.0, math.pi / 2, 2.0, 0.9, fence_m=2.0)
    plan = replace(PLAN, sides=(strip, strip), sigma_m=sigma_m)
    context = on_side(0, plan, cut_m=1.0)
    assert context.strip.surely_own is own
    position = context.estimate.position
    position.keep_apart(np.zeros(len(position.x)), 1e-6 * np.eye(len(position.x)), 0.3)
    assert not context.strip.surely_own


@pytest.mark.parametrize(("apart_m", "own"), [((0.4, 0.6), True), ((3.0, 0.0), False)])
@pytest.mark.parametrize("corner", [False, True])
def test_crop_is_the_fields_own_wherever_it_is_of_two_places_if_the_strip_goes_on_from_both(
    apart_m: tuple[float, float], own: bool, corner: bool
) -> None:
    """At the beginning of a strip of 10 m a machine stood for a minute, and gave up, as it might
    have been 0.8 m from there (model fields 11361 and 11362): the place or a corner."""
    context = on_side(0, replace(PLAN, sigma_m=0.1), cut_m=4.0)
    assert context.strip.surely_own and context.strip.surely_crop
    position = context.estimate.position
    apart = np.zeros(len(position.x))
    apart[CORNERS : CORNERS + 2] = apart_m
    if not corner:
        apart = np.roll(apart, -CORNERS)
    position.keep_apart(apart, 1e-6 * np.eye(len(apart)), 0.3)
    assert context.strip.surely_own is own and context.strip.surely_crop is own


@pytest.mark.parametrize("sigma_m", [0.0, 0.5])
def test_a_boundary_that_is_said_to_be_known_exactly_does_not_give_way_by_metres(
    sigma_m: float,
) -> None:
    """Said to be 2 m longer than the field, it had taken the machine's place to be wrong instead,
    and led it 1.8 m into the neighbour's field (belief "said 2 m longer, surely")."""
    strip = on_side(0, replace(PLAN, sigma_m=sigma_m), cut_m=8.0).strip
    length_m = PLAN.sides[0].length_m
    assert strip.may_end_at(length_m - 1.5) is (sigma_m > 0.0)
    assert strip.may_end_at(length_m - 0.7)


def test_put_down_at_a_blunt_corner_it_stands_where_it_just_has_room() -> None:
    """Its blade, counted from where vision would see the crop begin: that is not the first tip."""
    corners = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (-15.0, 20.0)]
    gap_m = 1.5
    strip = on_side(0, spiral(corners, 0, VEHICLE, gap_m=gap_m), cut_m=None).strip
    assert isinstance(strip, PlannedStrip)
    along_m, _ = strip.put_down(0.0)
    side = strip.side
    assert side.begin_seen_m > 0.1
    permitted = shapely.Polygon(corners).buffer(gap_m - GAP_MARGIN_M, join_style="mitre")

    def has_room(seen_m: float) -> bool:
        at = lane_pose(side, side.begin_seen_m + seen_m, VEHICLE)
        return bool(permitted.contains(shapely.Polygon(placed(outline_of(VEHICLE), *at))))

    assert has_room(along_m + 0.02)
    assert not has_room(along_m - 0.02)


@pytest.mark.parametrize(
    ("gap_m", "index", "lying_m"),
    [(2.0, 1, 0.5), (1.5, 1, 0.1), (1.2, 1, 0.0), (None, 1, 0.0), (2.0, 3, 0.0)],
)
def test_ground_on_which_crop_seems_to_lie_may_be_longer_by_half_a_metre_where_the_gap_is_wide(
    gap_m: float | None, index: int, lying_m: float
) -> None:
    """Ground in the gap may look so: the blade must stop before the neighbour's crop."""
    plan = replace(PLAN, gap_m=gap_m)
    context = on_side(index, plan, cut_m=PLAN.sides[index].length_m - 0.5)
    assert context.strip.lying_m == pytest.approx(lying_m)
