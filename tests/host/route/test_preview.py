"""Facts about the preview of a harvest."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from host.core.frames import LocalFrame
from host.core.vehicle import Vehicle
from host.field.areas import Geofence, areas_of
from host.field.boundary_file import boundary_of, save_field
from host.route.field_plan import plan_field
from host.route.plan import Plan
from host.route.preview import Preview, drive_turn, preview
from host.route.side import Side, lane_pose
from host.route.turn_legs import arc, lane_beside, three_point, turning_radius
from tests.helpers.console import Cli

VEHICLE = Vehicle()
PASS_M = VEHICLE.blade_width_m - VEHICLE.overlap_m
SQUARE = shapely.box(0, 0, 20, 20)
FRAME = LocalFrame(31.5, 74.3)


def of(
    field: shapely.Polygon, turn: str = "three_point", gap: float = 2.0, inset: float = 0.0
) -> Preview:
    areas = areas_of(field, gap, inset_m=inset)
    return preview(plan_field(areas, (0.0, 0.0), VEHICLE, turn), areas, VEHICLE)


@pytest.mark.parametrize("kind", [arc, three_point])
@pytest.mark.parametrize("corner_deg", [50, 90, 120])
def test_a_turn_driven_without_error_ends_on_the_new_lane(kind: object, corner_deg: float) -> None:
    assert kind in (arc, three_point)
    corner = math.radians(corner_deg)
    turn = (arc if kind is arc else three_point)(VEHICLE, corner, lane_beside(VEHICLE, corner))
    poses, way, seconds = drive_turn(turn, VEHICLE)
    x, y, heading = poses[-1]
    assert turn.offset(x, y) == pytest.approx(0, abs=1e-9)
    assert heading == pytest.approx(math.radians(corner_deg))
    assert seconds > way / VEHICLE.manoeuvre_speed_mps


@given(st.floats(0.7, 2.2))
def test_no_step_of_a_turn_is_tighter_than_the_steering_allows(corner: float) -> None:
    radius, _ = turning_radius(VEHICLE)
    poses, way, _ = drive_turn(three_point(VEHICLE, corner, lane_beside(VEHICLE, corner)), VEHICLE)
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    bends = np.abs(np.diff(poses[:, 2]))
    assert (bends <= 2 * np.arcsin(steps / (2 * radius)) + 1e-9).all()
    assert steps.sum() == pytest.approx(way, rel=0.01)


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3, 3), st.floats(0, 20))
def test_on_a_lane_the_blades_right_end_is_the_overlap_outside_the_edge(
    x: float, y: float, heading: float, along: float
) -> None:
    side = Side(x, y, heading, 20.0, 0.95, 20.0)
    px, py, h = lane_pose(side, along, VEHICLE)
    c, s = math.cos(h), math.sin(h)
    half = VEHICLE.blade_width_m / 2
    end = (px + c * VEHICLE.blade_x_m + s * half, py + s * VEHICLE.blade_x_m - c * half)
    dx, dy = end[0] - x, end[1] - y
    assert dx * c + dy * s == pytest.approx(along, abs=1e-9)
    assert -dx * s + dy * c == pytest.approx(-VEHICLE.overlap_m, abs=1e-9)


def test_three_point_turns_leave_nothing_of_a_square() -> None:
    found = of(SQUARE)
    assert found.leftover.area == 0
    assert found.coverage == pytest.approx(1.0, abs=1e-4), "the last sliver is below MIN_STRIP_M2"
    assert found.warnings == []
    # Every strip is one effective width: their lengths sum to the area over it, and the overlaps.
    assert found.cutting_m == pytest.approx(400 / PASS_M, rel=0.01)
    assert len(found.turns) == len(found.plan.sides) - 1


def test_the_paper_s_arc_leaves_the_corners_but_needs_less_room_and_time() -> None:
    square, arcs = of(SQUARE), of(SQUARE, "arc")
    assert arcs.leftover.area > 20
    assert arcs.coverage == pytest.approx(1 - arcs.leftover.area / 400, abs=2e-3)
    assert arcs.room_m < square.room_m
    assert arcs.time_s < square.time_s


def test_the_time_is_that_of_the_ways_and_the_pauses() -> None:
    found = of(SQUARE)
    driving = found.cutting_m / VEHICLE.cutting_speed_mps
    driving += found.turning_m / VEHICLE.manoeuvre_speed_mps
    assert driving < found.time_s < 1.5 * driving


def test_a_gap_too_narrow_for_the_turns_is_said_before_anything_moves() -> None:
    assert of(SQUARE, gap=2.0).warnings == []
    narrow = of(SQUARE, gap=1.0)
    assert any("turns leave the permitted area" in text for text in narrow.warnings)
    assert any("at the start the machine stands" in text for text in narrow.warnings)


def test_an_inset_costs_what_the_areas_say() -> None:
    found = of(SQUARE, inset=0.5)
    assert found.leftover.area == 0
    # The blade's overlap reaches into what was to stay standing.
    assert 1 - found.areas.price < found.coverage < 1 - found.areas.price + 0.02


def test_a_side_into_a_keep_out_is_said() -> None:
    pond = shapely.Polygon(SQUARE.exterior, [shapely.box(9, 9, 11, 11).exterior])
    areas = areas_of(pond, 2.0)
    plain = areas_of(SQUARE, 2.0)
    plan = plan_field(plain, (0.0, 0.0), VEHICLE, "three_point")
    assert any(
        "would cut into keep-out 1" in text for text in preview(plan, areas, VEHICLE).warnings
    )


@pytest.mark.parametrize(
    ("corner", "heading"), [((0, 0), 0.0), ((20, 0), 90.0), ((20, 20), 180.0), ((0, 20), -90.0)]
)
def test_the_spiral_begins_at_the_corner_that_was_chosen(
    corner: tuple[float, float], heading: float
) -> None:
    for inset in (0.0, 0.5):
        side = plan_field(areas_of(SQUARE, 2.0, inset_m=inset), corner, VEHICLE, "arc").sides[0]
        assert math.dist((side.x_m, side.y_m), corner) == pytest.approx(inset * math.sqrt(2))
        turn = math.remainder(side.heading_rad - math.radians(heading), math.tau)
        assert turn == pytest.approx(0, abs=1e-9)


@settings(max_examples=25, deadline=None)
@given(st.floats(8, 40), st.floats(8, 40), st.floats(0, 5), st.floats(0, 5))
def test_what_is_cut_and_what_stays_make_the_crop(a: float, b: float, c: float, d: float) -> None:
    field = shapely.Polygon([(0, 0), (a, 0), (a + c, b), (-d, b)])
    found = of(field, "arc")
    whole = found.cut.intersection(found.areas.crop).area + found.leftover.area
    assert whole == pytest.approx(found.areas.crop.area, abs=0.5)
    assert 0 <= found.coverage <= 1 + 1e-9


def test_the_same_edge_again_is_reached_by_backing_up() -> None:
    first = Side(0.0, 0.0, 0.0, 20.0, PASS_M, 20.0)
    plan = Plan((first, replace(first, y_m=PASS_M)))
    found = preview(plan, areas_of(SQUARE, 2.0), VEHICLE)
    (turn,) = found.turns
    assert turn[-1] == pytest.approx(lane_pose(plan.sides[1], -0.1, VEHICLE))
    # Along the swath, then an S of two arcs to the next lane, then what is left of the way.
    assert math.hypot(20.1, PASS_M) < found.turning_m < 20.1 + PASS_M
    assert np.abs(turn[:, 2]).max() > math.radians(30), "wheels do not go sideways"
    assert found.shuttles == 1
    again = preview(Plan((first, replace(first, y_m=PASS_M, heading_rad=2e-16))), AREAS, VEHICLE)
    assert again.turning_m == pytest.approx(found.turning_m)
    assert found.cut.intersection(SQUARE).area == pytest.approx(20 * 2 * PASS_M)


AREAS = areas_of(SQUARE, 2.0)
WELL = shapely.box(9, 9, 10, 10)
WITH_WELL = shapely.Polygon(SQUARE.exterior.coords, [WELL.exterior.coords])


def test_a_bent_side_that_is_taken_again_is_gone_back_along_as_it_bends() -> None:
    """Straight on beside its first piece the way back would lie 20 m outside of the field."""
    field = shapely.Polygon([(0, 0), (20, 0), (37, 10), (37, 60), (0, 60)])
    areas = areas_of(field, 3.0)
    first = Side(0.0, 0.0, 0.0, 39.0, PASS_M, 39.0, bends=((20.0, math.radians(30.0)),))
    again = replace(first, y_m=PASS_M)
    plan = Plan((first, again), boundary=tuple(field.exterior.coords[:-1]), gap_m=3.0)
    shown = preview(plan, areas, VEHICLE)
    assert shown.shuttles == 1
    assert shown.room_m < 3.0
    assert not any("turns leave" in text for text in shown.warnings)


def test_bends_nearer_to_each_other_than_the_blade_is_wide_are_drawn() -> None:
    """The last side of a round field."""
    bends = ((0.18, 0.5), (0.22, 0.44), (0.29, 0.55))
    last = Side(10.0, 10.0, 0.0, 0.45, 0.2, 10.0, bends=bends)
    shown = preview(Plan((last,), "three_point"), areas_of(SQUARE, 2.0), VEHICLE)
    assert shown.cutting_m == pytest.approx(0.45)


def test_a_keep_out_is_planned_around_and_what_stays_is_expected() -> None:
    found = of(WITH_WELL)
    assert len(found.plan.keep_outs) == 1
    assert not found.cut.intersects(WELL.buffer(0.3))
    assert found.shuttles > 0
    assert 1.0 < found.leftover.area < 12.0
    assert found.leftover.distance(WELL) < 1.0
    assert found.coverage == pytest.approx(found.cut.intersection(WITH_WELL).area / WITH_WELL.area)
    plain = of(SQUARE)
    assert plain.shuttles == 0


def test_a_swath_or_a_turn_that_touches_a_keep_out_is_said() -> None:
    side = Side(0.0, 9.0, 0.0, 20.0, PASS_M, 20.0)
    through = preview(Plan((side,)), areas_of(WITH_WELL, 2.0), VEHICLE)
    assert through.warnings == ["side 1 would cut into keep-out 1"]
    short = replace(side, length_m=8.0)
    then = Side(8.0, 9.0, math.pi / 2, 11.0, PASS_M, 11.0)
    turning = preview(Plan((short, then)), areas_of(WITH_WELL, 2.0), VEHICLE)
    assert any("1 turns would touch keep-out 1, first at the end of side 1" in text
               for text in turning.warnings)  # fmt: skip


def test_without_a_gap_nothing_is_said_of_the_room_but_it_is_measured() -> None:
    areas = areas_of(SQUARE, None)
    assert areas.permitted is None
    found = preview(plan_field(areas, (0.0, 0.0), VEHICLE, "three_point"), areas, VEHICLE)
    assert found.warnings == []
    assert found.room_m == pytest.approx(of(SQUARE).room_m, abs=0.5)
    with pytest.raises(ValueError, match="needs the gap's width"):
        Geofence(areas)


def test_a_wider_blade_needs_fewer_sides() -> None:
    wide = replace_blade(1.4)
    areas = areas_of(SQUARE, 2.0)
    assert len(plan_field(areas, (0, 0), wide, "arc").sides) < len(of(SQUARE).plan.sides)
    side = of(SQUARE).plan.sides[0]
    assert lane_pose(replace(side, x_m=5.0), 0.0, wide)[0] == pytest.approx(5 - wide.blade_x_m)


def replace_blade(width_m: float) -> Vehicle:
    return VEHICLE.model_copy(update={"blade_width_m": width_m})


# ---- the command ---------------------------------------------------------------------------------


def field_file(folder: Path) -> Path:
    path = folder / "field.geojson"
    save_field(path, boundary_of(SQUARE, FRAME, "Square"))
    return path


def test_the_command_compares_the_turns_and_writes_a_picture(tmp_path: Path, cli: Cli) -> None:
    code, out, err = cli("plan", str(field_file(tmp_path)), "--inset", "0.2", "--start", "1")
    assert (code, err) == (0, "")
    assert "Square: 400 m2, 4 corners, 0 keep-outs, start at corner 1" in out
    assert "15.8 m2, 3.96 % of the crop" in out
    assert "three_point" in out
    assert "arc" in out
    assert (tmp_path / "field.plan.png").stat().st_size > 10_000


@pytest.mark.parametrize("folder", [".", "..", "TASKDATA"])
def test_a_task_set_may_be_the_folder_that_one_stands_in(
    tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch, folder: str
) -> None:
    inside = tmp_path / "TASKDATA" / "more"
    inside.mkdir(parents=True)
    save_field(inside.parent / "TASKDATA.XML", boundary_of(SQUARE, FRAME, "Square"))
    monkeypatch.chdir({".": inside.parent, "..": inside, "TASKDATA": tmp_path}[folder])
    code, _, err = cli("plan", folder, "--gap", "2")
    assert (code, err) == (0, "")
    assert (tmp_path / "TASKDATA.plan.png").is_file()


def test_without_a_gap_the_command_says_what_is_not_watched(tmp_path: Path, cli: Cli) -> None:
    code, out, _ = cli("plan", str(field_file(tmp_path)))
    assert code == 0
    assert "no --gap: whether the turns have room is not checked" in out
    assert "no geofence" in out
    assert "no --gap" not in cli("plan", str(field_file(tmp_path)), "--gap", "2")[1]


def test_a_table_line_is_not_broken(tmp_path: Path, cli: Cli) -> None:
    _, out, _ = cli("plan", str(field_file(tmp_path)), "--gap", "2")
    (line,) = [line for line in out.splitlines() if line.startswith("three_point")]
    assert line.split()[1:3] == ["43", "0"]
    assert line.endswith(" m")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--start", "4"], "has the corners 0 to 3"),
        (["--inset", "11"], "nothing is left to cut"),
        (["--gap", "0"], "no room for the machine's wheels"),
        (["--out", "/nowhere/plan.png"], "there is no folder /nowhere"),
        (["--out", "plan"], "its suffix names no format"),
        (["--out", "plan.xyz"], "its suffix names no format"),
        (["--vehicle", "/nowhere.yaml"], "cannot read the vehicle file"),
    ],
)
def test_bad_input_is_one_message(
    tmp_path: Path, cli: Cli, options: list[str], message: str
) -> None:
    code, out, err = cli("plan", str(field_file(tmp_path)), *options)
    assert code == 2
    assert out == "", "it is said before the work"
    assert message in err
    assert len(err.splitlines()) == 1
