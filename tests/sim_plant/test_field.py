"""The blade cuts what it sweeps and nothing else; the truth helpers agree with geometry."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from sim_plant import ground
from sim_plant.blade import blade_ends
from sim_plant.field import Field
from sim_plant.field_spec import FieldSpec, Tree

PLAIN = FieldSpec(
    size_m=(4.0, 3.0),
    gap_m=1.0,
    neighbour_depth_m=1.0,
    edge_wobble_m=0,
    weeds=0,
    thin=0,
    green=0,
    bare=0,
    grass=0,
    windrow_m=(0.1, 0.0),
)


def test_the_crop_fills_the_polygon_and_the_neighbours_stand_behind_the_gap() -> None:
    field = Field(PLAIN)
    assert field.missed_m2() == pytest.approx(12.0)
    assert field.kind_at(0.01, 0.01) == ground.CROP
    assert field.kind_at(-0.01, 0.01) == ground.SOIL
    assert field.kind_at(-0.98, 1.0) == ground.SOIL
    assert field.kind_at(-1.02, 1.0) == ground.NEIGHBOUR


def test_only_the_sides_asked_for_have_neighbours() -> None:
    field = Field(PLAIN.model_copy(update={"neighbours": ("east",)}))
    assert field.kind_at(5.5, 1.5) == ground.NEIGHBOUR
    assert {field.kind_at(-1.5, 1.5), field.kind_at(2, -1.5), field.kind_at(2, 4.5)} == {
        ground.SOIL
    }


def test_a_straight_swath_cuts_its_rectangle_exactly() -> None:
    field = Field(PLAIN)
    # The blade's line runs from x = 0.5 to x = 2.5, y from 0.5 to 1.5.
    field.cut((-1.0, 1.0, 0.0), (1.0, 1.0, 0.0))
    assert field.coverage() == pytest.approx(2.0 / 12.0, abs=1e-9)
    assert field.missed_m2() == pytest.approx(10.0, abs=1e-9)
    stubble = np.argwhere(field.kind == ground.STUBBLE) * field.cell
    assert np.ptp(stubble, axis=0) == pytest.approx([1.0 - field.cell, 2.0 - field.cell])


def test_the_neighbours_crop_is_counted_apart() -> None:
    field = Field(PLAIN)
    field.cut((3.0, 1.5, 0.0), (4.5, 1.5, 0.0))
    # Blade from x = 4.5 to 6.0; the neighbour begins at 5.0 and the grid ends at 6.0.
    assert field.neighbour_cut_m2() == pytest.approx(1.0, abs=1e-9)
    assert field.coverage() == 0.0


@settings(max_examples=40, deadline=None)
@given(
    x=st.floats(-1, 3),
    y=st.floats(0, 3),
    yaw=st.floats(-math.pi, math.pi),
    way=st.floats(-1.0, 1.0),
    parts=st.integers(2, 40),
)
def test_a_straight_cut_is_the_same_in_one_step_or_in_many(
    x: float, y: float, yaw: float, way: float, parts: int
) -> None:
    one, many = Field(PLAIN), Field(PLAIN)
    path = [
        (x + s * math.cos(yaw), y + s * math.sin(yaw), yaw) for s in np.linspace(0, way, parts + 1)
    ]
    one.cut(path[0], path[-1])
    for a, b in itertools.pairwise(path):
        many.cut(a, b)
    # Cells whose centre lies on a border within rounding may fall either way.
    assert np.count_nonzero(one.kind != many.kind) <= 2


@settings(max_examples=40, deadline=None)
@given(
    x=st.floats(-1, 3),
    y=st.floats(0, 3),
    yaw=st.floats(-math.pi, math.pi),
    speed=st.floats(0.2, 3.0),
    rate=st.floats(-1.5, 1.5),
)
def test_a_turning_blade_leaves_no_gap_in_its_wake(
    x: float, y: float, yaw: float, speed: float, rate: float
) -> None:
    field = Field(PLAIN)
    pose = (x, y, yaw)
    swept = []
    for _ in range(10):
        dt = 0.02
        new = (
            pose[0] + speed * dt * math.cos(pose[2]),
            pose[1] + speed * dt * math.sin(pose[2]),
            pose[2] + rate * dt,
        )
        field.cut(pose, new)
        a, b = (blade_ends(*p, 1.5, -0.5, 0.5) for p in (pose, new))
        # A blade that turns about a point of its own sweeps a bow tie.
        swept.append(shapely.make_valid(shapely.Polygon([a[:2], a[2:], b[2:], b[:2]])))
        pose = new
    wake = shapely.unary_union(swept).buffer(-1e-6)
    j, i = np.nonzero(np.isin(field.kind, (ground.CROP, ground.NEIGHBOUR)))
    standing_x = field.origin[0] + (i + 0.5) * field.cell
    standing_y = field.origin[1] + (j + 0.5) * field.cell
    assert not shapely.contains_xy(wake, standing_x, standing_y).any()


def test_counts_agree_with_the_grid_after_any_cut() -> None:
    field = Field(FieldSpec(size_m=(4, 4), windrow_m=(0.1, 0.4)), seed=5)
    before = np.count_nonzero(field.kind == ground.CROP)
    for k in range(100):
        field.cut((-2 + 0.05 * k, 0.5, 0.01 * k), (-2 + 0.05 * (k + 1), 0.5, 0.01 * (k + 1)))
    left = np.count_nonzero(field.kind == ground.CROP)
    assert field.coverage() == pytest.approx(1 - left / before)
    assert np.count_nonzero(field.kind == ground.WINDROW) > 100


def test_the_edge_offset_is_positive_where_the_edge_lies_to_the_left() -> None:
    field = Field(PLAIN)
    field.cut((-1.5, 0.5, 0.0), (2.5, 0.5, 0.0))  # cuts y from 0 to 1: the edge is y = 1
    cell = field.cell
    assert field.true_edge_offset(1.0, 0.7, 0.0) == pytest.approx(0.3, abs=cell)
    assert field.true_edge_offset(1.0, 1.2, 0.0) == pytest.approx(-0.2, abs=cell)
    assert field.true_edge_offset(1.0, 0.7, 0.2) == pytest.approx(0.3 / math.cos(0.2), abs=cell)
    assert math.isnan(field.true_edge_offset(1.0, 0.7, math.pi, reach_m=0.9))


def test_a_bare_spot_is_not_an_edge() -> None:
    field = Field(PLAIN)
    field.cut((-1.5, 0.5, 0.0), (2.5, 0.5, 0.0))
    x0, y0 = field.origin
    j, i = math.floor((1.1 - y0) / field.cell), math.floor((1.0 - x0) / field.cell)
    field.kind[j : j + 4, i - 20 : i + 20] = ground.SOIL  # 0.1 m wide
    assert field.true_edge_offset(1.0, 1.4, 0.0) == pytest.approx(-0.4, abs=field.cell)


def test_the_crop_ahead_is_seen_over_the_blades_width() -> None:
    field = Field(PLAIN)
    assert field.crop_ahead(-1.0, 1.5, 0.0) == pytest.approx(1.0, abs=field.cell)
    assert field.crop_ahead(-1.0, -0.3, 0.0) == pytest.approx(1.0, abs=field.cell)
    assert field.crop_ahead(-1.0, -0.6, 0.0) == math.inf


def test_the_straw_is_laid_right_of_the_blade() -> None:
    field = Field(PLAIN.model_copy(update={"windrow_m": (0.1, 0.45)}))
    field.cut((-1.5, 0.5, 0.0), (2.5, 0.5, 0.0))  # the blade's right end runs along y = 0
    rows = np.flatnonzero((field.kind == ground.WINDROW).any(axis=1))
    y = field.origin[1] + (rows + 0.5) * field.cell
    assert (y.min(), y.max()) == pytest.approx((-0.55, -0.1), abs=field.cell)


def test_a_watcher_gets_each_change_once() -> None:
    field = Field(PLAIN)
    watch = field.watch()
    assert watch.take() is None
    field.cut((-1.0, 1.0, 0.0), (-0.9, 1.0, 0.0))
    change = watch.take()
    assert change is not None
    j, i, kinds = change
    assert np.array_equal(kinds, field.kind[j : j + kinds.shape[0], i : i + kinds.shape[1]])
    assert np.count_nonzero(kinds == ground.STUBBLE) == np.count_nonzero(
        field.kind == ground.STUBBLE
    )
    assert watch.take() is None


def test_the_permitted_area_ends_at_the_neighbours_and_at_obstacles() -> None:
    spec = PLAIN.model_copy(update={"trees": (Tree(x_m=2.0, y_m=1.0, trunk_radius_m=0.3),)})
    area = Field(spec).permitted(margin_m=0.2)
    assert area.contains(shapely.Point(-0.75, 1))
    assert not area.contains(shapely.Point(-0.85, 1))
    assert not area.contains(shapely.Point(2.2, 1))


def test_a_crown_covers_what_is_below_it() -> None:
    tree = Tree(x_m=2.0, y_m=1.0, crown_radius_m=1.5)
    field = Field(PLAIN.model_copy(update={"trees": (tree,)}))
    assert field.under_trees(3.4, 1.0)
    assert not field.under_trees(3.6, 1.0)


def test_patches_cover_their_share() -> None:
    spec = PLAIN.model_copy(update={"size_m": (20.0, 20.0), "lodged": 0.2, "green": 0.1})
    field = Field(spec, seed=2)
    assert (field.lodge > 0.6).mean() == pytest.approx(0.2, abs=0.01)
    assert (field.green > 0.5).mean() == pytest.approx(0.1, abs=0.01)


def test_the_neighbours_crop_is_as_much_higher_as_is_said() -> None:
    same, lower = (
        Field(FieldSpec(crop_height_sd_m=0.0, lodged=0.0, neighbour_height=times), 1)
        for times in (1.0, 0.7)
    )
    shares = lower.height / same.height
    kind = lower.kind[::2, ::2]
    assert shares[kind == ground.NEIGHBOUR] == pytest.approx(0.7, abs=1e-3)
    assert shares[kind == ground.CROP] == pytest.approx(1.0)


def test_lodged_crop_is_lower() -> None:
    spec = PLAIN.model_copy(update={"size_m": (20.0, 20.0), "lodged": 0.3})
    field = Field(spec, seed=2)
    assert np.median(field.height[field.lodge > 1.1]) < 0.45
    assert np.median(field.height[field.lodge == 0]) == pytest.approx(0.9, abs=0.05)


def test_a_field_is_the_same_for_the_same_seed_and_another_for_another() -> None:
    spec = FieldSpec(size_m=(5, 5), weeds=0.1, lodged=0.1)
    a, b, c = (Field(spec, seed) for seed in (3, 3, 4))
    for name in ("kind", "height", "green", "density", "lodge", "tone", "weed"):
        assert np.array_equal(getattr(a, name), getattr(b, name)), name
    assert not np.array_equal(a.kind, c.kind)


def test_slopes_turn_with_the_vehicle() -> None:
    field = Field(PLAIN.model_copy(update={"side_slope_deg": 5.0, "bump_sd_deg": 0.0}))
    east, north = field.slopes(1, 1, 0.0), field.slopes(1, 1, math.pi / 2)
    # Driving east with the ground rising to the north: the right side is lower.
    assert east == pytest.approx((math.radians(5), 0.0))
    # Driving north: uphill, nose up.
    assert north == pytest.approx((0.0, -math.radians(5)))


LEVEL, SLOPING = (
    Field(PLAIN.model_copy(update={"side_slope_deg": slope, "bump_sd_deg": 1.0}))
    for slope in (0.0, 5.0)
)


@given(x=st.floats(0.1, 6.0), y=st.floats(0.0, 6.0), yaw=st.floats(-3.1, 3.1))
def test_against_the_plane_a_vehicle_tips_by_the_bumps_alone(
    x: float, y: float, yaw: float
) -> None:
    tipped = SLOPING.bumps(x, y, yaw)
    assert tipped == LEVEL.bumps(x, y, yaw) == LEVEL.slopes(x, y, yaw)
    assert tipped != (0.0, 0.0)


@pytest.mark.parametrize(
    ("bad", "word"),
    [
        ({"polygon": ((0, 0), (1, 1))}, "three corners"),
        ({"polygon": ((0, 0), (1, 1), (1, 0), (0, 1))}, "do not cross"),
        ({"gap": 2.0}, "Extra inputs"),
        ({"lodged": 1.5}, "less than or equal to 1"),
    ],
)
def test_a_wrong_field_says_what_is_wrong(bad: dict[str, object], word: str) -> None:
    with pytest.raises(ValidationError, match=word):
        FieldSpec.model_validate(bad)
