"""Facts about the steering laws: their poles, their margins, and which sense is right."""

from __future__ import annotations

import math
from pathlib import Path

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from host.core.errors import EXIT_USER
from host.core.frames import Pose2
from host.core.vehicle import Vehicle
from host.estimate.lane import Lane
from host.estimate.odometry import Motion
from host.estimate.position import Position
from host.pilot import steering_law
from host.pilot.planned_strip import BEND_AHEAD_M
from host.route.side import Side
from host.tune.follow_margins import LAWS, SPEEDS_MPS, Law, gains, margins, opened
from tests.helpers.console import Cli
from tests.helpers.places import OnLane

VEHICLE = Vehicle()
SPEED = VEHICLE.cutting_speed_mps
LAG_S = VEHICLE.steer_lag_s


@given(st.sampled_from(SPEEDS_MPS), st.floats(0.5, 2.0), st.floats(0.6, 1.2), st.floats(0.02, 0.4))
def test_the_state_law_puts_the_poles_where_it_says(
    speed: float, frequency: float, damping: float, lag: float
) -> None:
    vehicle = Vehicle(follow_frequency_1pm=frequency, follow_damping=damping, steer_lag_s=lag)
    loop = opened(gains("state", speed, vehicle), speed, lag, dead_time_s=0.0)
    w = frequency * speed
    wanted = np.polymul([1, 2 * damping * w, w * w], [1, 1 / lag])
    assert np.poly(control.feedback(loop, 1).poles()).real == pytest.approx(wanted, rel=1e-3)


@pytest.mark.parametrize("speed", SPEEDS_MPS)
def test_the_state_law_keeps_its_margins_at_every_speed(speed: float) -> None:
    found = margins(opened(gains("state", speed, VEHICLE), speed, LAG_S), speed)
    assert found.phase_deg > 55
    assert found.gain_db > 12
    assert found.sensitivity < 1.5
    assert found.settling_m < 6


@pytest.mark.parametrize("lag", [0.05, 0.15, 0.4])
def test_the_machine_may_lag_otherwise_than_the_file_says(lag: float) -> None:
    found = margins(opened(gains("state", SPEED, VEHICLE), SPEED, lag), SPEED)
    assert found.phase_deg > 45
    assert found.gain_db > 8


def test_the_papers_law_is_stable_and_has_less_margin() -> None:
    paper, state = (
        margins(opened(gains(law, SPEED, VEHICLE), SPEED, LAG_S), SPEED)
        for law in ("proportional", "state")
    )
    assert 0.3 < paper.damping < state.damping
    assert paper.phase_deg < state.phase_deg


@pytest.mark.parametrize("law", LAWS)
def test_the_papers_literal_sense_has_an_unstable_pole(law: Law) -> None:
    """II, case 1: E_outer left of O_map, "vehicle moves towards right"."""
    feedback = gains(law, SPEED, VEHICLE)
    right, wrong = (
        control.feedback(opened(sense * feedback, SPEED, LAG_S), 1).poles() for sense in (1, -1)
    )
    assert right.real.max() < 0
    assert wrong.real.max() > 0.3, "the offset grows e-fold in less than 3 s"


def test_the_command_prints_the_margins_and_refuses_a_machine_without_any(
    cli: Cli, tmp_path: Path
) -> None:
    code, out, err = cli("tune", "follow")
    assert (code, err) == (0, "")
    assert len([line for line in out.splitlines() if line.startswith(LAWS)]) == 8
    wild = tmp_path / "vehicle.yaml"
    wild.write_text("{follow_frequency_1pm: 3, cutting_speed_mps: 1.5, steer_lag_s: 0.6}")
    code, _, err = cli("tune", "follow", "--vehicle", str(wild))
    assert code == EXIT_USER
    assert "lower follow_frequency_1pm" in err


def driven(vehicle: Vehicle, offset: float, heading: float, backwards: bool = False) -> float:
    """The largest offset or heading after 12 m of an ideal vehicle with lag."""
    bend, dt = 0.0, 0.01
    lane = OnLane(vehicle).lane
    v = -vehicle.manoeuvre_speed_mps if backwards else vehicle.cutting_speed_mps
    for _ in range(round(12 / abs(v) / dt)):
        if backwards:
            angle = steering_law.reverse(offset, heading, vehicle)
        else:
            lane.place(offset, heading, 0.1, 0.1)
            angle = steering_law.follow(lane, Motion(0.0, v, bend, 0.0, 0.0, 0.0, 0.0), vehicle)
        assert abs(angle) <= math.radians(vehicle.steer_limit_deg) + 1e-12
        wanted = math.tan(angle) / vehicle.wheelbase_m
        bend += (wanted - bend) * dt / vehicle.steer_lag_s
        offset += v * math.sin(heading) * dt
        heading += v * bend * dt
    return max(abs(offset), abs(heading))


@pytest.mark.parametrize("offset", [-0.4, 0.3])
@pytest.mark.parametrize("heading", [-0.3, 0.0, 0.2])
def test_the_laws_bring_the_vehicle_onto_the_lane(offset: float, heading: float) -> None:
    assert driven(Vehicle(steering_law="state"), offset, heading) < 0.01
    assert driven(Vehicle(steering_law="proportional"), offset, heading) < 0.02
    assert driven(VEHICLE, offset, heading, backwards=True) < 0.02


def test_what_is_already_steered_is_not_asked_for_again() -> None:
    off = steering_law.state(0.1, 0.0, 0.0, 0.5, VEHICLE)
    turning = steering_law.state(0.1, 0.0, -0.1, 0.5, VEHICLE)
    assert off < turning < 0


def test_standing_still_the_law_is_that_of_a_steering_without_lag() -> None:
    frequency, damping = VEHICLE.follow_frequency_1pm, VEHICLE.follow_damping
    expected = (frequency**2, 2 * damping * frequency, 0.0)
    assert steering_law.state_gains(0.0, VEHICLE) == pytest.approx(expected)


@pytest.mark.parametrize("bend_deg", [-30.0, -10.0, 20.0, 33.0])
def test_round_a_bend_the_blade_goes_on_along_its_lane(bend_deg: float) -> None:
    """What it leaves beside that is the next round's edge. A law that brings the rear axle onto the
    lane beyond lets the blade run 0.12 m past a bend of 30 degrees, for two metres."""
    bend_at_m, dt = 6.0, 0.02
    bend_rad = math.radians(bend_deg)
    whole = Side(0.0, 0.0, 0.0, 14.0, VEHICLE.pass_m, 0.0, bends=((bend_at_m, bend_rad),))
    (_, first), (_, second) = whole.pieces()
    position = Position(VEHICLE)
    lane = Lane(position, VEHICLE.blade_x_m)
    position.place(first, 0.0, 0.0, 0.0)
    x, y, yaw, run, curvature, piece = 0.0, 0.0, 0.0, 0.0, 0.0, first
    off, speed = [], VEHICLE.cutting_speed_mps
    for k in range(round(10.0 / speed / dt)):
        motion = Motion(k * dt, speed, curvature, run, yaw, x, y)
        position.predict(motion, cutting=False)
        if piece is first and position.along(first) > bend_at_m - BEND_AHEAD_M:
            lane.bends(bend_rad)
            piece = second
            position.begin(second, straight=False)
        blade = Pose2(*position.pose).ahead(VEHICLE.blade_x_m)
        lanes = [Pose2(*each.pose(0.0, VEHICLE.inset_m)) for each in (first, second)]
        off.append(min(abs(each.seen_from(*blade[:2])[1]) for each in lanes))
        angle = steering_law.follow(lane, motion, VEHICLE)
        assert abs(angle) <= math.radians(VEHICLE.steer_limit_deg)
        wanted = math.tan(angle) / VEHICLE.wheelbase_m
        curvature += (wanted - curvature) * dt / VEHICLE.steer_lag_s
        x, y = x + speed * math.cos(yaw) * dt, y + speed * math.sin(yaw) * dt
        run, yaw = run + speed * dt, yaw + speed * curvature * dt
    assert max(off) < 0.07
    assert math.sqrt(np.mean(np.square(off))) < 0.015
    assert lane.heading_rad == pytest.approx(0.0, abs=0.05)
