"""Facts about random fields: what a seed draws is sound, and all kinds are drawn."""

from __future__ import annotations

import math
from typing import cast

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

from hil.judge.metrics import Truth, depth_m
from hil.scenario.random_fields import (
    AREA_M2,
    CONVEX_DEG,
    KEEP_OUT_FREE_M,
    MIN_NECK_M,
    MIN_SIDE_M,
    REFLEX_DEG,
    corner_angles_deg,
    good,
    machine_size,
    neck_m,
    random_field,
)
from hil.scenario.scenario import Scenario, changed
from host.core.vehicle import Vehicle
from host.pilot.pilot import Pilot
from host.vision.geometry import Camera as Eye
from host.vision.view import Detector
from sim_plant.field import Field
from sim_plant.machine import MachineSpec

IDLE = Pilot(Vehicle(), cast(Detector, None))
"""Only asked for its phase."""
MANY = [random_field(seed) for seed in range(200)]


@settings(max_examples=40)
@given(st.integers(0, 2**31 - 1))
def test_a_field_lies_within_the_stated_limits_and_is_the_same_again(seed: int) -> None:
    scenario = random_field(seed)
    assert scenario == random_field(seed)
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario
    boundary = scenario.field.boundary
    ring = np.array(boundary.exterior.coords[:-1])
    assert boundary.is_valid
    assert AREA_M2[0] <= boundary.area <= AREA_M2[1]
    size = machine_size(scenario.machine)
    assert 1.0 <= size < 1.3
    assert np.hypot(*(np.roll(ring, -1, axis=0) - ring).T).min() >= MIN_SIDE_M * size
    assert neck_m(ring) >= MIN_NECK_M * size
    for angle in corner_angles_deg(ring):
        assert CONVEX_DEG[0] <= angle <= CONVEX_DEG[1] or REFLEX_DEG[0] <= angle <= REFLEX_DEG[1]
    for keep_out in map(shapely.Polygon, scenario.field.keep_outs):
        assert boundary.exterior.distance(keep_out) >= KEEP_OUT_FREE_M * size - 0.02
    assert 9 <= scenario.weather.hour <= 16
    assert 0.5 <= scenario.gnss.cep_m <= 2.5
    assert 1.5 * size - 1e-3 <= scenario.field.gap_m <= 3.0 * size + 1e-3


def test_no_two_machines_have_the_same_lengths_and_every_blade_is_wider_than_its_wheels() -> None:
    lengths = {(s.machine.wheelbase_m, s.machine.blade_ahead_m) for s in MANY}
    assert len(lengths) == len(MANY)
    blades = [s.machine.blade_width_m for s in MANY]
    assert min(blades) < 0.87 and max(blades) > 1.23
    for scenario in MANY:
        machine = scenario.machine
        assert machine.half_width_m <= machine.blade_width_m / 2 - 0.049
        # the plant's own limits: a front wheel that carries nothing does not steer
        assert machine.front_load >= 0.3


def test_a_wheel_s_sensor_sits_on_either_wheel_or_on_the_axle() -> None:
    places = [s.machine.drive.hall_left_m / s.machine.half_width_m for s in MANY]
    assert {-1, 0, 1} == {round(place) for place in places}
    assert all(place == 0.0 or 0.7 < abs(place) < 0.95 for place in places)


def test_a_mast_shows_the_blade_s_line_at_the_lower_border_of_its_picture() -> None:
    """By the host's projection, not by the formula that tilts the phone."""
    masts = [s for s in MANY if s.camera == "mast"]
    rows = []
    for scenario in masts:
        exact = changed(scenario, {"belief": "exact", "lens": {"k1": 0.0, "k2": 0.0}})
        exact = changed(exact, {"lens": {"yaw_deg": 0.0, "roll_deg": 0.0, "y_m": 0.0}})
        blade = np.array([[exact.vehicle.blade_x_m, 0.0, 0.0]])
        rows.append(float(Eye(exact.mount).project(blade)[0][1]) / exact.mount.height_px)
    assert min(rows) >= 0.815 and max(rows) <= 0.955
    assert len({s.lens["hfov_deg"] for s in MANY}) > 190
    assert {s.lens["z_m"] < 0.71 for s in MANY if s.camera == "low"} == {True}


def test_every_kind_of_field_is_drawn() -> None:
    kinds = {scenario.name.removesuffix(" with a keep-out") for scenario in MANY}
    assert kinds == {"random rectangle", "random trapezoid", "random L", "random irregular"}
    assert {scenario.camera for scenario in MANY} == {"low", "mast"}
    assert {len(scenario.world.corners) for scenario in MANY} == set(range(4, 10))
    convex = {bool((corner_angles_deg(np.array(s.world.corners)) < 180).all()) for s in MANY}
    assert convex == {True, False}
    with_keep_out = [scenario for scenario in MANY if scenario.field.keep_outs]
    higher = [scenario.field.neighbour_height for scenario in MANY]
    assert min(higher) < 0.87 and max(higher) > 1.13
    gaps_m = [scenario.field.gap_m for scenario in MANY]
    assert min(gaps_m) < 1.6 and max(gaps_m) > 2.95
    assert 0.1 < len(with_keep_out) / len(MANY) < 0.3
    assert {bool(scenario.field.trees) for scenario in with_keep_out} == {True, False}


def begins(scenario: Scenario) -> tuple[float, float]:
    """How far before its plan's first side the machine's axle is put down at most, by what was
    drawn; and where it is."""
    exact = changed(scenario, {"belief": "exact", "start": {"lateral_error_m": 0.0}})
    side, vehicle = exact.plan().sides[0], exact.vehicle
    x, y, _ = exact.start_pose()
    c, s = math.cos(side.heading_rad), math.sin(side.heading_rad)
    along = (x - side.x_m) * c + (y - side.y_m) * s
    across = -(x - side.x_m) * s + (y - side.y_m) * c
    assert across == pytest.approx(vehicle.inset_m - side.shift_m)
    return -vehicle.blade_x_m - scenario.start.before_m, along


def test_the_machine_begins_on_the_lane_of_the_plan_s_first_side() -> None:
    usual = {"field": {"gap_m": 2.0}, "machine": MachineSpec().model_dump()}
    for scenario in MANY[:12]:
        farthest, along = begins(changed(scenario, usual))
        assert farthest - 1e-9 <= along < -1.0


def test_with_whatever_gap_it_begins_there_but_for_how_a_slanting_border_is_seen() -> None:
    """World and plan each look for the strip's first crop within a millimetre of the edge."""
    for scenario in MANY[:12]:
        farthest, along = begins(scenario)
        # a blade is two thirds of its way from the axle before the crop at least
        assert farthest - 1e-3 <= along < -scenario.machine.blade_x_m / 1.5


def test_the_machine_begins_inside_the_permitted_area() -> None:
    for scenario in MANY[:12]:
        truth = Truth(scenario.world, Field(scenario.field))
        truth.step(0.0, scenario.start_pose(), 0, IDLE)
        assert truth.outside_m == 0, scenario.seed
        assert truth.keep_out_m == 0


def test_the_host_is_told_of_the_keep_outs_and_the_world_has_them() -> None:
    scenario = next(s for s in MANY if s.field.keep_outs)
    assert len(scenario.plan().keep_outs) == 1
    x, y = shapely.Polygon(scenario.field.keep_outs[0]).centroid.coords[0]
    assert not Field(scenario.field).permitted().contains(shapely.Point(x, y))


# ---- what is a good field ------------------------------------------------------------------------

SQUARE = np.array([(0.0, 0.0), (12.0, 0.0), (12.0, 12.0), (0.0, 12.0)])


@pytest.mark.parametrize(
    ("ring", "what"),
    [
        (SQUARE[::-1], "clockwise"),
        (SQUARE * 0.5, "too small"),
        (SQUARE * 2, "too large"),
        (np.array([(0, 0), (12, 12), (12, 0), (0, 12.0)]), "crossing"),
        (np.array([(0, 0), (50, 0), (50, 3), (0, 3.0)]), "a strip narrower than a turn"),
        (np.array([(0, 0), (30, 0), (0, 12.0)]), "a sharp corner"),
        (np.array([(0, 0), (6, -0.5), (12, 0), (12, 12), (0, 12.0)]), "a corner that is none"),
        (np.array([(0, 0), (10, 0), (12, 1), (12, 12), (0, 12.0)]), "a short side"),
    ],
)
def test_a_field_that_no_such_machine_can_harvest_is_not_drawn(ring: np.ndarray, what: str) -> None:
    assert good(SQUARE)
    assert not good(ring), what


def test_a_longer_machine_needs_longer_sides() -> None:
    short = np.array([(0, 0), (9, 0), (12, 2), (12, 12), (0, 12.0)])
    assert good(short)
    assert not good(short, 1.25)


# ---- how deep in a keep-out ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("x", "depth"), [(2.0, 0.0), (1.0, 0.0), (0.9, 0.1), (0.6, 0.4), (-3.0, 0.0)]
)
def test_the_depth_in_a_keep_out_is_that_of_the_part_furthest_in(x: float, depth: float) -> None:
    machine = shapely.box(0, -0.5, 2, 0.5)
    well = shapely.box(0, -1, 1, 1)
    assert depth_m(affinity.translate(machine, x), well) == pytest.approx(depth)


def test_a_pole_between_the_wheels_is_touched_too() -> None:
    assert depth_m(shapely.box(0, -0.5, 2, 0.5), shapely.box(1, -0.1, 1.2, 0.1)) == pytest.approx(
        0.4
    )
