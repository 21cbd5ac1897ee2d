"""Facts about commissioning: what an owner finds is near the truth, and a harvest is given it."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from hil.bench.harvest import Harvest
from hil.firmware import provision, targets
from hil.scenario.belief import Draw, Walk, in_words, wrong_by
from hil.scenario.random_fields import random_field
from hil.scenario.scenario import changed, load
from hil.studies.actuators import truth
from hil.studies.beliefs import CASES, harmless, scenario_of
from hil.studies.commissioning import (
    GROUND_BOARD,
    board_picture,
    commission,
    found_by_tape,
    found_delay,
    found_lens,
    found_mount,
    free_ground,
)
from hil.studies.steering_setup import steering_setup
from hil.studies.yard_wire import BenchWire
from host.core.errors import UserError
from host.link import protocol
from host.pilot.phase import Phase
from host.tune.checkerboard import Lens, corners
from host.tune.measured_drive import Taped, Way, measure_drive
from sim_plant.drive_response import drive_response

PARAMS = {name: spec.from_raw(spec.default_raw) for name, spec in protocol.PARAMS.items()}
needs_firmware = pytest.mark.skipif(
    not targets.DESK_LIBRARY.exists(), reason="needs the desk firmware: make build"
)


@pytest.mark.parametrize("camera", ["mast", "low"])
def test_boards_tell_lens_and_mount(camera: str) -> None:
    world = load("default", {"camera": camera, "lens": {"yaw_deg": 1.5, "hfov_deg": 64.0}}).world
    rng = Draw(4).rng("boards")
    lens = found_lens(world, rng)
    assert lens.focal_px == pytest.approx(world.lens.focal_px, rel=0.005)
    mount = found_mount(world, lens, rng)
    for name in ("pitch_deg", "yaw_deg", "roll_deg"):
        assert getattr(mount, name) == pytest.approx(getattr(world.lens, name), abs=0.8)
    assert mount.z_m == pytest.approx(world.lens.z_m, abs=0.03)


NARROW_VIEW, FLAT_VIEW, MAST, SLOW_STEERING = 12085, 12100, 12091, 12103
"""Seeds: two low cameras, of which one sees little of the ground before it and the other sees the
board's rows close together; a mast; a wheel of 24 degrees a second."""


@pytest.mark.parametrize("seed", [NARROW_VIEW, FLAT_VIEW, MAST])
def test_a_board_on_the_ground_is_not_mixed_up_with_its_own_next_row(seed: int) -> None:
    world = random_field(seed).world
    lens = world.lens
    known = Lens(
        (lens.width_px, lens.height_px),
        lens.focal_px,
        (lens.width_px / 2, lens.height_px / 2),
        (lens.k1, lens.k2, 0.0, 0.0, 0.0),
        0.1,
    )
    mount = found_mount(world, known, Draw(seed).rng("boards"))
    assert mount.pitch_deg == pytest.approx(lens.pitch_deg, abs=0.2)
    assert mount.z_m == pytest.approx(lens.z_m, abs=0.01)


def test_a_board_far_before_a_low_camera_is_seen_whole_whatever_the_noise() -> None:
    lens = random_field(NARROW_VIEW).world.lens
    # its columns run to the right, its rows towards the machine
    rotation = lens.axes @ np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    middle = 0.5 * GROUND_BOARD.square_m * np.array([8.0, 5.0, 0.0])
    to_board = np.array([1.9, 0.0, 0.0]) - np.array([lens.x_m, lens.y_m, lens.z_m])
    shift = lens.axes @ to_board - rotation @ middle
    for seed in range(4):
        rng = np.random.default_rng(seed)
        picture = board_picture(lens, GROUND_BOARD, rotation, shift, rng)
        assert corners(picture, GROUND_BOARD) is not None


@needs_firmware
def test_a_slow_steering_turns_the_machine_enough_to_tell_the_camera_s_delay() -> None:
    scenario = random_field(SLOW_STEERING)
    told = scenario.told
    found, _ = found_delay(scenario, told.vehicle, told.parameters)
    assert found == pytest.approx(scenario.world.lens.delay_s, abs=0.03)


@needs_firmware
def test_what_commissioning_leaves_is_what_the_host_is_told(tmp_path: Path) -> None:
    world = {
        "lens": {"delay_s": 0.2},
        "machine": {"drive": {"hall_pulses_per_m": 46.0}, "steering": {"pot_centre_counts": 520.0}},
        "field": {"size_m": [14.0, 11.0]},
    }
    scenario = load("default", world)
    values = commission(scenario, tmp_path, Walk(laps=2, cep_m=0.5))
    told = changed(scenario, {"belief": {"folder": str(tmp_path)}}).told
    wrong = wrong_by(told, scenario.world)
    bounds = {"boundary_m": 0.7, "pitch_deg": 0.8, "yaw_deg": 0.8, "camera_delay_s": 0.04}
    bounds |= {"hall_percent": 3.0, "pot_deg": 0.5, "gap_m": 0.05, "focal_percent": 1.0}
    bounds |= {"full_speed_percent": 4.0, "dead_duty_percent": 1.5}
    for name, bound in bounds.items():
        assert abs(wrong[name]) <= bound, name
    assert told.vehicle.camera_delay_s == pytest.approx(values["camera_delay_s"].found, abs=1e-3)
    assert in_words(wrong).startswith("believed wrong: boundary 0.")
    page = (tmp_path / "commissioning.md").read_text()
    assert all(name in page for name in values)
    # The board that it leaves arms: a firmware that has not been told its drivers would not.
    brief = {"belief": {"folder": str(tmp_path)}, "eyes": "model", "limits": {"time_s": 6.0}}
    run = Harvest(changed(scenario, brief))
    try:
        run.run()
    finally:
        run.close()
    assert run.pilot.phase is not Phase.CONNECT


@needs_firmware
@pytest.mark.parametrize("seed", [3, 5, 8])
def test_a_drive_of_any_motors_is_found(seed: int) -> None:
    scenario = random_field(seed)
    spec = scenario.world.machine
    true = drive_response(spec, scenario.told.vehicle.nominal_battery_v)
    pulses = spec.drive.hall_pulses_per_m
    new = {"speed_full": PARAMS["speed_full"], "drive_min_duty": 0.0}
    centre = spec.steering.pot_centre_counts
    askew = {name: scenario.told.parameters[name] + 9.0 for name in ("pot_left", "pot_right")}
    askew["pot_centre"] = round(centre) + 9.0
    by_hand = scenario.told.parameters | new | askew
    by_hand["hall_per_metre"] = round(0.96 * pulses, 1)
    found = found_by_tape(scenario, scenario.told.vehicle, by_hand, Draw(seed).rng("tape"))
    assert found.curve.full_mps == pytest.approx(true.full_mps, rel=0.03)
    assert found.curve.dead == pytest.approx(true.dead, abs=0.01)
    assert found.curve.lag_s == pytest.approx(true.lag_s, rel=0.3)
    # tyres slip: the ground passes by a little slower than the wheels
    assert found.params(PARAMS | by_hand)["pot_centre"] == pytest.approx(centre, abs=2.0)
    assert found.taped.pulses_per_m is not None
    assert 1.0 <= found.taped.pulses_per_m / pulses < 1.03


@needs_firmware
def test_before_each_way_it_is_asked_whether_the_machine_may_go() -> None:
    """Whoever has taped a way stands in the next one."""
    scenario = random_field(3)
    held = PARAMS | scenario.told.parameters
    asked: list[float] = []

    def ready(way: Way) -> None:
        asked.append(way.speed_mps)
        if len(asked) == 2:
            raise UserError("somebody stands there")

    with free_ground(scenario, scenario.told.parameters) as bench:
        begun = bench.pose

        def tape(_: Way) -> Taped:
            return Taped(bench.pose[0] - begun[0])

        with pytest.raises(UserError, match="somebody"):
            measure_drive(BenchWire(bench), "yard", scenario.told.vehicle, held, 6.0, tape, ready)
        stood = bench.pose
        bench.advance(bench.now + 3.0)
        assert bench.pose[0] == pytest.approx(stood[0], abs=0.02)
    assert asked == pytest.approx([0.2, -0.2])
    assert stood[0] - begun[0] == pytest.approx(6.0, abs=0.5)


@needs_firmware
def test_without_a_wheel_sensor_every_way_is_taped() -> None:
    scenario = changed(random_field(3), {"machine": {"drive": {"hall_pulses_per_m": 0.0}}})
    true = drive_response(scenario.world.machine, scenario.told.vehicle.nominal_battery_v)
    new = {"speed_full": PARAMS["speed_full"], "drive_min_duty": 0.0}
    none = scenario.told.parameters | new | {"hall_per_metre": 0.0}
    found = found_by_tape(scenario, scenario.told.vehicle, none, Draw(3).rng("tape"))
    assert found.taped.pulses_per_m is None
    assert found.curve.lag_s is None
    assert found.curve.full_mps == pytest.approx(true.full_mps, rel=0.06)
    assert found.curve.dead == pytest.approx(true.dead, abs=0.02)
    assert "hall_per_metre" not in found.params(PARAMS)
    assert found.told(scenario.told.vehicle).hall_pulses_per_m == 0.0


@needs_firmware
def test_a_steering_that_was_tuned_once_is_set_up_again() -> None:
    scenario = random_field(1)
    spec = scenario.world.machine.steering
    yard = partial(free_ground, scenario)
    first, _ = steering_setup(yard, provision.FITTED, spec.stop_deg)
    again, model = steering_setup(yard, first, spec.stop_deg)
    assert first["stall_time"] < PARAMS["stall_time"], "a tuned board sees a stall sooner"
    for found in (first, again):
        assert found["pot_centre"] == pytest.approx(spec.pot_centre_counts, abs=2.0)
        slope = (found["pot_left"] - found["pot_centre"]) / found["angle_left"]
        assert slope == pytest.approx(spec.pot_counts_per_deg, rel=0.02)
    assert model.slew_degps == pytest.approx(truth(scenario.world.machine).slew_degps, rel=0.1)


def test_a_folder_without_commissioning_is_one_message(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"vehicle\.yaml"):
        assert load("default", {"belief": {"folder": str(tmp_path)}}).told


@pytest.mark.parametrize("case", CASES)
def test_every_wrong_belief_is_a_sound_scenario(case: str) -> None:
    scenario = scenario_of(case, "model")
    assert scenario.plan().sides
    assert len(scenario.start_pose()) == 3


@pytest.mark.parametrize(
    ("cut_m2", "outside_m", "good"), [(0.0, 0.1, True), (0.01, 0.0, False), (0.0, 0.11, False)]
)
def test_harm_is_any_of_the_neighbours_crop_or_a_tenth_of_a_metre(
    cut_m2: float, outside_m: float, good: bool
) -> None:
    assert harmless({"neighbour_cut_m2": cut_m2, "outside_m": outside_m}) is good
